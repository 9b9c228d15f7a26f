"""Ideal microlenses in one plane: pinholes and thin lenses."""

from __future__ import annotations

from typing import TYPE_CHECKING

from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.trace import RayArrays, in_chunks
from plenoptic.optics.microlens.aperture import has_clear_gaps
from plenoptic.optics.microlens.model_rules import ArrayCrossing, LensletRows, ModelRules, TracedPaths, Waves

if TYPE_CHECKING:
    from plenoptic.core.rays import RayBundle
    from plenoptic.optics.microlens.array import MicrolensArray
    from plenoptic.optics.microlens.microlens_record import ArrayRecord


def _check_pinholes(array: MicrolensArray) -> None:
    if has_clear_gaps(array.aperture):
        raise InvalidValueError("light passes a PINHOLE only at its centre; give gaps=Gaps.OPAQUE")


def _pinholes_to_lens(blocks: Floats, lenslets: LensletRows, crossing: ArrayCrossing, _: Waves) -> None:
    from plenoptic.optics.microlens.kernels.ideal_microlenses import fill_pinholes

    if lenslets is not None:
        from plenoptic.optics.microlens.kernels.to_lens import fill_openings

        fill_openings(blocks, lenslets, crossing.array.opening)
    fill_pinholes(blocks, crossing.sensor, crossing.z_plane)


def _thin_to_lens(blocks: Floats, lenslets: LensletRows, crossing: ArrayCrossing, waves: Waves) -> None:
    from plenoptic.optics.microlens.kernels.ideal_microlenses import fill_thin

    if lenslets is not None:
        from plenoptic.optics.microlens.kernels.to_lens import fill_openings

        fill_openings(blocks, lenslets, crossing.array.opening)
    array, factors = crossing.array, crossing.array.power_factors
    fill_thin(
        blocks, lenslets, crossing.sensor, array.power, crossing.z_plane, factors, None if factors is None else waves
    )


def _thin_to_sensor(blocks: Floats, crossing: ArrayCrossing, differs: bool) -> None:
    from plenoptic.optics.microlens.kernels.ideal_microlenses import fill_thin_forward

    fill_thin_forward(blocks, crossing.z_plane, crossing.sensor, crossing.array, crossing.array if differs else None)


def _trace_thin(rays: RayBundle, traced: TracedPaths, array: ArrayRecord, differs: bool, _: float) -> RayBundle:
    from plenoptic.optics.microlens.kernels.ideal_microlenses import fill_thin_lenses

    def fill(out: RayArrays, rays_in: RayArrays, first: int, end: int) -> None:
        fill_thin_lenses(out, traced, rays_in, array, array if differs else None, first, end)

    return in_chunks(fill, rays)


PINHOLE = ModelRules(_pinholes_to_lens, None, focuses=False, check=_check_pinholes)
THIN = ModelRules(_thin_to_lens, _thin_to_sensor, trace_rays=_trace_thin)
