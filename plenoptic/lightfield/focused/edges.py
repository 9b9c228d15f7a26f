"""Depth edges: pixels with the depth of the surface in front of their own, and pixels of mixed light."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.lightfield.focused.pixel_rays import PixelRays
from plenoptic.lightfield.focused.splats import sort_by_cell

_MAX_FATTENING = 4
"""Largest width, in pixels, by which surfaces extend beyond their edges in estimated maps."""
_ITERATIONS = 4
_MIXED_WEIGHT = 0.05
"""Weight of pixels with mixed light of two surfaces."""
_BLUR_RADIUS = 3
"""Search radius of mixed pixels, in pixels."""


class Cells(NamedTuple):
    """n samples of a picture, sorted into cells (rows, columns) of one of its pixels each."""

    first: NDArray[np.int64]
    """Index in `number` of the first sample of each cell, and the end of the last."""
    number: NDArray[np.int64]
    origin: tuple[int, int]
    shape: tuple[int, int]
    position: Floats
    """(n, 2): down and along, pixels."""
    nearness: Floats
    light: Floats
    lens: NDArray[np.int64]


def correct_edges(
    rays: PixelRays, nearness: Floats, radiance: Floats, variance: Floats | None, spacing: float, depth: float
) -> Floats:
    """Correct the nearness (n,) of pixels where estimated surfaces extend beyond their edges.

    The pixel takes the nearness of the surface behind if its light, the mean of the channels of radiance (n, C),
    differs less there from that of other microlenses, by more than its error. Surfaces differ by more than `depth`.
    """
    from plenoptic.lightfield.kernels.depth_edges import fill_behind, fill_misfits

    lens, light = rays.on_image(rays.lens, -1), radiance.mean(axis=1)
    error = np.zeros_like(light) if variance is None else np.sqrt(variance).mean(axis=1)
    for _ in range(_ITERATIONS):
        behind = np.empty(lens.shape)
        fill_behind(behind, rays.on_image(nearness, np.nan), lens, depth, _MAX_FATTENING)
        other = rays.at(behind)
        candidates = np.flatnonzero(np.isfinite(other))
        if not len(candidates):
            break
        cells = _in_cells(rays, nearness, light, spacing)
        light_and_lens = light[candidates], rays.lens[candidates]
        position_behind = picture_positions(rays, other, spacing)
        misfit, misfit_behind = np.empty(len(candidates)), np.empty(len(candidates))
        fill_misfits(misfit, cells, depth, (cells.position[candidates], nearness[candidates], *light_and_lens))
        fill_misfits(misfit_behind, cells, depth, (position_behind[candidates], other[candidates], *light_and_lens))
        wrong = candidates[misfit_behind + error[candidates] < misfit]
        nearness = nearness.copy()
        nearness[wrong] = other[wrong]
    return nearness


def picture_positions(rays: PixelRays, nearness: Floats, spacing: float) -> Floats:
    """Positions (n, 2) of pixels as seen from the centre of the pupil: down and along, in pixels of the picture."""
    return np.asarray((rays.through - rays.at_pupil * nearness[:, None])[:, ::-1] * (1.0, -1.0) / spacing)


def _in_cells(rays: PixelRays, nearness: Floats, light: Floats, spacing: float) -> Cells:
    position = picture_positions(rays, nearness, spacing)
    valid, cell = np.asarray(np.isfinite(position).all(axis=1)), np.rint(position)
    low, high = cell[valid].min(axis=0, initial=0), cell[valid].max(axis=0, initial=0)
    shape = (int(high[0] - low[0]) + 1, int(high[1] - low[1]) + 1)
    first, number = sort_by_cell(cell - low, valid, shape)
    return Cells(first, number, (int(low[0]), int(low[1])), shape, position, nearness, light, rays.lens)


def edge_weights(rays: PixelRays, nearness: Floats, blur: Floats, depth: float) -> Floats:
    """Weights (n,) of pixels, small near depth edges; `blur` is the radius of a point's image in pixels."""
    from plenoptic.lightfield.kernels.depth_edges import fill_edge_mask

    lens = rays.on_image(rays.lens, -1)
    edge_mask = np.empty(lens.shape, dtype=np.uint8)
    fill_edge_mask(edge_mask, rays.on_image(nearness, np.nan), lens, rays.on_image(blur, 0.0), depth, _BLUR_RADIUS)
    return np.where(rays.at(edge_mask) > 0, _MIXED_WEIGHT, 1.0)
