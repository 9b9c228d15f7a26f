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
    """Index of the first sample of each cell, and the end of the last."""
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

    light = radiance.mean(axis=1)
    error = np.zeros_like(light) if variance is None else np.sqrt(variance).mean(axis=1)

    def misfits(cells: Cells, rows: NDArray[np.int64], nearness: Floats) -> Floats:
        position, misfit = picture_positions(rays, nearness, spacing)[rows], np.empty(len(rows))
        fill_misfits(misfit, cells, depth, (position, nearness[rows], light[rows], rays.lens[rows]))
        return misfit

    for _ in range(_ITERATIONS):
        lens = _lenses_with_edges(rays, nearness, depth)
        behind = np.empty(lens.shape)
        fill_behind(behind, rays.on_image(nearness, np.nan), lens, depth, _MAX_FATTENING)
        other = rays.at(behind)
        candidates = np.flatnonzero(np.isfinite(other))
        if not len(candidates):
            break
        cells = _in_cells(rays, nearness, light, spacing)
        misfit = misfits(cells, candidates, nearness)
        doubtful = misfit > error[candidates]
        candidates, misfit = candidates[doubtful], misfit[doubtful]
        wrong = candidates[misfits(cells, candidates, other) + error[candidates] < misfit]
        nearness = nearness.copy()
        nearness[wrong] = other[wrong]
    return nearness


def _lenses_with_edges(rays: PixelRays, nearness: Floats, depth: float) -> NDArray[np.int64]:
    """Microlens of each pixel (H, W) of the raw image; -1 where its pixels all lie within a depth."""
    first = np.flatnonzero(np.diff(rays.lens, prepend=-1))
    span = np.fmax.reduceat(nearness, first) - np.fmin.reduceat(nearness, first)
    has_edge = np.repeat(span > (1.0 - 1e-9) * depth, np.diff(first, append=len(nearness)))
    return rays.on_image(np.where(has_edge, rays.lens, -1), -1)


def picture_positions(rays: PixelRays, nearness: Floats, spacing: float) -> Floats:
    """Positions (n, 2) of pixels as seen from the centre of the pupil: down and along, in pixels of the picture."""
    return np.asarray((rays.through - rays.at_pupil * nearness[:, None])[:, ::-1] * (1.0, -1.0) / spacing)


def _in_cells(rays: PixelRays, nearness: Floats, light: Floats, spacing: float) -> Cells:
    position = picture_positions(rays, nearness, spacing)
    valid, cell = np.isfinite(position[:, 0] + position[:, 1]), np.rint(position)
    down, along = cell[valid].T
    top, left = int(down.min(initial=0)), int(along.min(initial=0))
    shape = (int(down.max(initial=0)) - top + 1, int(along.max(initial=0)) - left + 1)
    first, number = sort_by_cell(cell - (top, left), valid, shape)
    return Cells(first, (top, left), shape, position[number], nearness[number], light[number], rays.lens[number])


def edge_weights(rays: PixelRays, nearness: Floats, blur: Floats, depth: float) -> Floats:
    """Weights (n,) of pixels, small near depth edges; `blur` is the radius of a point's image in pixels."""
    from plenoptic.lightfield.kernels.depth_edges import fill_edge_mask

    lens = _lenses_with_edges(rays, nearness, depth)
    edge_mask = np.empty(lens.shape, dtype=np.uint8)
    fill_edge_mask(edge_mask, rays.on_image(nearness, np.nan), lens, rays.on_image(blur, 0.0), depth, _BLUR_RADIUS)
    return np.where(rays.at(edge_mask) > 0, _MIXED_WEIGHT, 1.0)
