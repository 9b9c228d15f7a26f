"""Edges of depth: pixels that have the depth of the surface before their own, and pixels in which light is mixed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.lightfield.focused.pixel_rays import PixelRays
from plenoptic.lightfield.focused.splats import sort_by_cell

_FAT = 4
"""Pixels by which surfaces reach beyond their edges in estimated maps, at most."""
_ROUNDS = 4
_MIXED = 0.05
"""Weight of pixels in which light of two surfaces is mixed."""
_BLURRED = 3
"""Pixels up to which they are looked for."""


class Cells(NamedTuple):
    """n samples of a picture in cells (rows, columns) of one pixel of it."""

    first: NDArray[np.int64]
    """Where those of each cell begin in `number`, and the last end."""
    number: NDArray[np.int64]
    origin: tuple[int, int]
    shape: tuple[int, int]
    place: Floats
    """(n, 2): down and along, pixels."""
    nearness: Floats
    light: Floats
    lens: NDArray[np.int64]


class Light(NamedTuple):
    """Radiance of n pixels, the mean of its channels, and its standard error."""

    value: Floats
    error: Floats


def light_of(radiance: Floats, variance: Floats | None) -> Light:
    """Of radiance (n, C) and its variance."""
    value, channels = radiance.mean(axis=1), radiance.shape[1]
    spread = np.zeros_like(value) if variance is None else np.sqrt(variance.sum(axis=1)) / channels
    return Light(value, spread)


def correct_edges(rays: PixelRays, nearness: Floats, light: Light, spacing: float, depth: float) -> Floats:
    """Nearness (n,) of pixels, where estimated surfaces are wider than their edges that of what is behind them.

    Which surface a pixel shows is judged by what other microlenses see at its places on both: its light is nearer to
    theirs, by more than its error. Surfaces differ by more than `depth`.
    """
    from plenoptic.lightfield.kernels.depth_edges import fill_behind, fill_misfits

    lens = rays.on_image(rays.lens, -1)
    for _ in range(_ROUNDS):
        behind = np.empty(lens.shape)
        fill_behind(behind, rays.on_image(nearness, np.nan), lens, depth, _FAT)
        other = rays.at(behind)
        k = np.flatnonzero(np.isfinite(other))
        if not len(k):
            break
        cells = _in_cells(rays, nearness, light.value, spacing)
        here, there = np.empty(len(k)), np.empty(len(k))
        fill_misfits(here, cells, depth, (cells.place[k], nearness[k], light.value[k], rays.lens[k]))
        fill_misfits(there, cells, depth, (_places(rays, other, spacing)[k], other[k], light.value[k], rays.lens[k]))
        wrong = k[there + light.error[k] < here]
        nearness = nearness.copy()
        nearness[wrong] = other[wrong]
    return nearness


def _places(rays: PixelRays, nearness: Floats, spacing: float) -> Floats:
    """Where pixels are seen from the middle of the pupil, (n, 2): down and along, in pixels of the picture."""
    return np.asarray((rays.through - rays.pupil * nearness[:, None])[:, ::-1] * (1.0, -1.0) / spacing)


def _in_cells(rays: PixelRays, nearness: Floats, light: Floats, spacing: float) -> Cells:
    place = _places(rays, nearness, spacing)
    known, cell = np.asarray(np.isfinite(place).all(axis=1)), np.rint(place)
    low, high = cell[known].min(axis=0, initial=0), cell[known].max(axis=0, initial=0)
    shape = (int(high[0] - low[0]) + 1, int(high[1] - low[1]) + 1)
    first, number = sort_by_cell(cell - low, known, shape)
    return Cells(first, number, (int(low[0]), int(low[1])), shape, place, nearness, light, rays.lens)


def edge_weights(rays: PixelRays, nearness: Floats, blur: Floats, depth: float) -> Floats:
    """Weights (n,) of pixels, small beside edges of depth; `blur` is the radius of the image of a point in pixels."""
    from plenoptic.lightfield.kernels.depth_edges import fill_mixed

    lens = rays.on_image(rays.lens, -1)
    mixed = np.empty(lens.shape, dtype=np.uint8)
    fill_mixed(mixed, rays.on_image(nearness, np.nan), lens, rays.on_image(blur, 0.0), depth, _BLURRED)
    return np.where(rays.at(mixed) > 0, _MIXED, 1.0)
