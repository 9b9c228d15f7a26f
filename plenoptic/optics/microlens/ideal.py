"""Ideal microlenses, which act in one plane: pinholes and thin lenses."""

from __future__ import annotations

from typing import TYPE_CHECKING

from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.trace import RayArrays, in_chunks
from plenoptic.optics.microlens.aperture import has_clear_gaps
from plenoptic.optics.microlens.model_rules import Crossing, FoundPaths, ModelRules, Own, Waves

if TYPE_CHECKING:
    from plenoptic.core.rays import RayBundle
    from plenoptic.optics.microlens.array import MicrolensArray
    from plenoptic.optics.microlens.record import ArrayRecord


def _check_pinholes(array: MicrolensArray) -> None:
    if has_clear_gaps(array.aperture):
        raise InvalidValueError("light passes a PINHOLE only at its centre; give gaps=Gaps.OPAQUE")


def _pinholes_to_lens(blocks: Floats, own: Own, at: Crossing, _: Waves) -> None:
    from plenoptic.optics.microlens.kernels.ideal import fill_pinholes

    if own is not None:
        from plenoptic.optics.microlens.kernels.to_lens import fill_openings

        fill_openings(blocks, own, at.array.opening)
    fill_pinholes(blocks, at.sensor, at.z_plane)


def _thin_to_lens(blocks: Floats, own: Own, at: Crossing, waves: Waves) -> None:
    from plenoptic.optics.microlens.kernels.ideal import fill_thin

    if own is not None:
        from plenoptic.optics.microlens.kernels.to_lens import fill_openings

        fill_openings(blocks, own, at.array.opening)
    factors = at.array.power_factors
    fill_thin(blocks, own, at.sensor, at.array.power, at.z_plane, factors, None if factors is None else waves)


def _thin_to_sensor(blocks: Floats, at: Crossing, differs: bool) -> None:
    from plenoptic.optics.microlens.kernels.ideal import fill_thin_forward

    fill_thin_forward(blocks, at.z_plane, at.sensor, at.array, at.array if differs else None)


def _thin_passed(rays: RayBundle, found: FoundPaths, array: ArrayRecord, differs: bool, _: float) -> RayBundle:
    from plenoptic.optics.microlens.kernels.ideal import fill_thin_lenses

    def fill(out: RayArrays, given: RayArrays, first: int, end: int) -> None:
        fill_thin_lenses(out, found, given, array, array if differs else None, first, end)

    return in_chunks(fill, rays)


PINHOLE = ModelRules(_pinholes_to_lens, None, focuses=False, check=_check_pinholes)
THIN = ModelRules(_thin_to_lens, _thin_to_sensor, passed=_thin_passed)
