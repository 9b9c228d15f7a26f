"""Rays from the opening at the rear of a lens along the paths of its ghosts, each along a pair that it draws."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, STATUS, WEIGHT, Z
from plenoptic.core.values import Floats
from plenoptic.optics.lens.kernels.trace import fill_through_lens
from plenoptic.optics.lens.lens_record import LensRecord

if TYPE_CHECKING:
    from plenoptic.camera.ghosts.array_reflection import Detour


class GhostAims(NamedTuple):
    """Discs of the opening through which the light of each pair passes."""

    redirects: bool
    """True if rays are aimed at the discs, for pixels that see all of the opening. Otherwise most of those that pass it
    elsewhere are given up.
    """
    slope: Floats
    """(pairs,): centre of the disc over the position of the pixel, or of the ray on the array."""
    scale: Floats
    """(pairs,): radius of the disc over that of the opening."""
    radius: float
    """Of the opening, mm."""
    distance: float
    """From the opening to the sensor or array, mm."""


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
    """Of the draws: each pair for all of the opening, then for its disc."""
    guide: NDArray[np.int64]
    elements: int
    """Elements of the longest stack."""
    bands: NDArray[np.int64] | None
    """(W,): column of the records for each wavelength that paths draw; None if all have the camera's."""
    aims: GhostAims | None
    """None: paths are traced wherever they pass the opening, and draws are pairs."""

    @property
    def arrays(self) -> int:
        """Number of bands if the microlenses of detours differ between them, otherwise 1."""
        return max((len(each.reflection.arrays) for each in self.detours if each is not None), default=1)


WIDE = 0.2
"""Fraction of the rays of a pair that may pass all of the opening."""


def fill_ghost_rays(
    bundle: Floats, ghosts: GhostRecord, draws: NDArray[np.int64], waves: NDArray[np.int64] | None
) -> None:
    """Trace the rays of a bundle at the opening along their pairs, in place; weights get the inverse probability."""
    from plenoptic.camera.sampling.kernels.ghost_paths import fill_aims, fill_back, fill_part

    pairs, trace, collect, give_back = (
        draws,
        *(each.specialize() for each in (fill_through_lens, fill_part, fill_back)),
    )
    if ghosts.aims is not None:
        fill_aims(bundle, draws, ghosts.aims, WIDE)
        pairs = draws // 2
    bands = None if waves is None or ghosts.bands is None else ghosts.bands[waves[: len(draws)]]
    arrays = ghosts.arrays if bands is not None else 1
    groups = pairs if bands is None or arrays == 1 else pairs * arrays + bands
    fields = bundle.reshape(-1, RAY // BLOCK, BLOCK)
    lit = np.flatnonzero(fields[:, STATUS // BLOCK].ravel() == 0.0)
    lit = lit[np.argsort(groups[lit], kind="stable")]
    fields[:, WEIGHT // BLOCK][fields[:, STATUS // BLOCK] != 0.0] = 0.0
    numbers, begins = np.unique(groups[lit], return_index=True)
    if any(ghosts.detours):
        from plenoptic.camera.ghosts.array_reflection import fill_detour  # few ghosts return through microlenses
    for group, rays in zip(numbers.tolist(), np.split(lit, begins[1:]), strict=True):
        pair, band = divmod(group, arrays)
        blocks, detour = np.empty(-(-len(rays) // BLOCK) * RAY), ghosts.detours[pair]
        collect(blocks, bundle, rays)
        columns = None if bands is None else np.resize(bands[rays], len(blocks) // RAY * BLOCK)
        part = blocks.reshape(-1, RAY // BLOCK, BLOCK)
        part[:, Z // BLOCK] += ghosts.shifts[pair, 0]
        trace(blocks, ghosts.lenses[pair], columns)
        if detour is not None:
            fill_detour(blocks, detour, columns, band)
        part[:, Z // BLOCK] -= ghosts.shifts[pair, 1]
        part[:, WEIGHT // BLOCK] /= ghosts.probability[pair]
        give_back(bundle, blocks, rays)
