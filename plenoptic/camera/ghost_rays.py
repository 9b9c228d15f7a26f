"""Rays from the opening at the rear of a lens along the paths of its ghosts, each along a pair that it draws."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, WEIGHT, Z
from plenoptic.core.values import Floats
from plenoptic.optics.lens.kernels.trace import fill_through_lens
from plenoptic.optics.lens.lens_record import LensRecord


class GhostRecord(NamedTuple):
    """Unfolded stacks of pairs of reflecting surfaces for kernels, in the reverse direction."""

    lenses: tuple[LensRecord, ...]
    shifts: Floats
    """(pairs, 2): z in the frame of the stack minus that in the frame of the opening, behind and in front, mm."""
    probability: Floats
    """(pairs,) with which a ray draws each pair."""
    cumulative: Floats
    guide: NDArray[np.int64]
    elements: int
    """Elements of the longest stack."""
    bands: NDArray[np.int64] | None
    """(W,): column of the records for each wavelength that paths draw; None if all have the camera's."""


def fill_ghost_rays(
    bundle: Floats, ghosts: GhostRecord, pairs: NDArray[np.int64], waves: NDArray[np.int64] | None
) -> None:
    """Trace the rays of a bundle at the opening along their pairs, in place; weights get the inverse probability."""
    rows, trace = bundle.reshape(-1, RAY // BLOCK, BLOCK), fill_through_lens.specialize()
    for pair in np.unique(pairs).tolist():
        rays = np.flatnonzero(pairs == pair)
        whole = np.append(rays, np.full(-len(rays) % BLOCK, rays[0]))  # whole blocks
        block, place = np.divmod(whole, BLOCK)
        part = np.ascontiguousarray(rows[block, :, place].reshape(-1, BLOCK, RAY // BLOCK).transpose(0, 2, 1))
        part[:, Z // BLOCK] += ghosts.shifts[pair, 0]
        trace(
            part.reshape(-1),
            ghosts.lenses[pair],
            None if waves is None or ghosts.bands is None else ghosts.bands[waves[whole]],
        )
        part[:, Z // BLOCK] -= ghosts.shifts[pair, 1]
        part[:, WEIGHT // BLOCK] /= ghosts.probability[pair]
        rows[block[: len(rays)], :, place[: len(rays)]] = part.transpose(0, 2, 1).reshape(-1, RAY // BLOCK)[: len(rays)]
