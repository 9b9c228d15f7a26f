"""Rays from the opening at the rear of a lens along the paths of its ghosts, each along a pair that it draws."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.kernels.ray_blocks import BLOCK, MISSED, RAY, WEIGHT, Z
from plenoptic.core.values import Floats
from plenoptic.optics.lens.kernels.trace import fill_through_lens
from plenoptic.optics.lens.lens_record import LensRecord

if TYPE_CHECKING:
    from plenoptic.camera.array_reflection import Detour


class GhostAims(NamedTuple):
    """Discs of the opening through which the light of each pair passes, for cameras whose pixels see all of it."""

    slope: Floats
    """(pairs,): centre of the disc over the position of the pixel."""
    scale: Floats
    """(pairs,): radius of the disc over that of the opening."""
    radius: float
    """Of the opening, mm."""
    distance: float
    """From the opening to the sensor, mm."""


class GhostRecord(NamedTuple):
    """Unfolded stacks of pairs of reflecting surfaces for kernels, in the reverse direction."""

    lenses: tuple[LensRecord, ...]
    detours: tuple[Detour | None, ...]
    """Reflections behind the microlenses, and what follows in the stacks; None: both reflections are in the stack."""
    shifts: Floats
    """(pairs, 2): z in the frame of the stack minus that in the frame of the opening, behind and in front, mm."""
    probability: Floats
    """(pairs,) with which a ray draws each pair."""
    cumulative: Floats
    """Of the draws: pairs, or with aims each pair aimed at the opening, then at its disc."""
    guide: NDArray[np.int64]
    elements: int
    """Elements of the longest stack."""
    bands: NDArray[np.int64] | None
    """(W,): column of the records for each wavelength that paths draw; None if all have the camera's."""
    arrays: int
    """Number of bands if the microlenses of detours differ between them, otherwise 1."""
    aims: GhostAims | None
    """None if all rays stay aimed at the opening."""


WIDE = 0.2
"""Fraction of the rays of a pair that stay aimed at the whole opening."""


def fill_ghost_rays(
    bundle: Floats, ghosts: GhostRecord, draws: NDArray[np.int64], waves: NDArray[np.int64] | None
) -> None:
    """Trace the rays of a bundle at the opening along their pairs, in place; weights get the inverse probability."""
    rows, trace = bundle.reshape(-1, RAY // BLOCK, BLOCK), fill_through_lens.specialize()
    pairs = draws if ghosts.aims is None else draws // 2
    bands = None if waves is None or ghosts.bands is None else ghosts.bands[waves[: len(draws)]]
    arrays = ghosts.arrays if bands is not None else 1
    groups = pairs if arrays == 1 else pairs * arrays + bands
    if any(ghosts.detours):
        from plenoptic.camera.array_reflection import fill_detour  # few ghosts return through microlenses
    for group in np.unique(groups).tolist():
        pair, band = divmod(group, arrays)
        detour, rays = ghosts.detours[pair], np.flatnonzero(groups == group)
        whole = np.append(rays, np.full(-len(rays) % BLOCK, rays[0]))  # whole blocks
        block, place = np.divmod(whole, BLOCK)
        part = np.ascontiguousarray(rows[block, :, place].reshape(-1, BLOCK, RAY // BLOCK).transpose(0, 2, 1))
        blocks, columns = part.reshape(-1), None if bands is None else bands[whole]
        if ghosts.aims is not None:
            _fill_aims(part, ghosts.aims, pair, draws[whole].reshape(-1, BLOCK) % 2 == 1)
        part[:, Z // BLOCK] += ghosts.shifts[pair, 0]
        trace(blocks, ghosts.lenses[pair], columns)
        if detour is not None:
            fill_detour(blocks, detour, columns, band)
        part[:, Z // BLOCK] -= ghosts.shifts[pair, 1]
        part[:, WEIGHT // BLOCK] /= ghosts.probability[pair]
        rows[block[: len(rays)], :, place[: len(rays)]] = part.transpose(0, 2, 1).reshape(-1, RAY // BLOCK)[: len(rays)]


def _fill_aims(part: Floats, aims: GhostAims, pair: int, narrow: NDArray[np.bool_]) -> None:
    """Aim narrow rays at the disc of their pair; weights of all are over the density of both ways to aim.

    The balance heuristic: E. Veach, L. J. Guibas, SIGGRAPH 1995, 419.
    """
    x, y, _, l, m, n, weight, status = (part[:, row] for row in range(RAY // BLOCK))
    slope, scale = aims.slope[pair], aims.scale[pair]
    with np.errstate(invalid="ignore", divide="ignore"):
        sensor_x, sensor_y = x + aims.distance / n * l, y + aims.distance / n * m
        aimed_x = np.where(narrow, slope * sensor_x + scale * x, x)
        aimed_y = np.where(narrow, slope * sensor_y + scale * y, y)
        in_disc = np.hypot(aimed_x - slope * sensor_x, aimed_y - slope * sensor_y) <= scale * aims.radius
        across_x, across_y = aimed_x - sensor_x, aimed_y - sensor_y
        length = np.sqrt(across_x**2 + across_y**2 + aims.distance**2)
        weight *= (aims.distance / (length * n)) ** 4 / (WIDE + (1.0 - WIDE) * in_disc / scale**2)
        x[:], y[:], l[:], m[:], n[:] = aimed_x, aimed_y, across_x / length, across_y / length, -aims.distance / length
        status[(status == 0.0) & ~(np.hypot(x, y) <= aims.radius)] = MISSED
