"""Record of the light that a lens takes from rays: transmittance of surfaces, and attenuation in glass."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.optics.coatings.coating import Coating, Reflectance, SurfaceCoating
from plenoptic.optics.coatings.surface_powers import is_from_front, ordered_powers, surface_powers
from plenoptic.optics.glass.absorption import attenuation
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.surfaces.mirror import Mirror
from plenoptic.optics.surfaces.surface import Surface

if TYPE_CHECKING:
    from plenoptic.optics.lens.stack import LensStack

_INTERVALS = 1024
"""Intervals of the squared cosine, which needs no square root, for one wavelength. Linear interpolation is within 3e-7
for bare glass up to 60 degrees, 5e-6 up to 75, 2e-4 up to 85; errors of films rise with the square of their
thickness."""
_DISPERSED_INTERVALS, _TOLERANCE = (64, 128, 256, 512, 1024), 6e-7
"""Numbers of intervals of the cosine for many wavelengths, whose tables must stay in caches: the first whose cubic
interpolation is within the tolerance halfway between nodes up to 75 degrees. Bare glass and single layers need 64, by
which they are within 2e-6 up to 85 degrees and 5e-6 beyond."""


class LossRecord(NamedTuple):
    """Losses of the elements of a `LensRecord`, in the order of travel, at its wavelengths."""

    transmittance: Floats | None
    """(n, nodes + 1) for unpolarised light, at uniform squares of the cosine in the medium of lower index, the last one
    twice; 1 for stops. None if each ray has its own wavelength."""
    dispersed: Floats | None
    """(n, wavelengths, nodes + 2) for rays with wavelengths of their own, at uniform cosines, and extrapolated by one
    node at both ends. None if there are none."""
    attenuation: Floats | None
    """(n, wavelengths) attenuation coefficient in 1/mm in front of each element, 0 for the first; None if all are 0."""
    absorbing: NDArray[np.bool_] | None
    """(n,) True if it is not 0."""

    def part(self, begin: int, end: int) -> LossRecord:
        """Losses of elements begin ... end - 1; before the first one nothing attenuates light."""
        transmittance, dispersed = (None if table is None else table[begin:end] for table in self[:2])
        if self.attenuation is None or self.absorbing is None:
            return LossRecord(transmittance, dispersed, None, None)
        attenuation, absorbing = self.attenuation[begin:end].copy(), self.absorbing[begin:end].copy()
        attenuation[0], absorbing[0] = 0.0, False
        return LossRecord(transmittance, dispersed, attenuation, absorbing)


def table_cosines() -> Floats:
    """Rising cosines of the angles at which tables are computed."""
    return np.union1d(
        np.sqrt(np.linspace(0.0, 1.0, _INTERVALS + 1)), np.linspace(0.0, 1.0, _DISPERSED_INTERVALS[-1] + 1)
    )


def has_losses(lens: LensStack) -> bool:
    """True if images include the losses of a lens: it is traced exactly, and a surface has a coating."""
    coatings = (element.coating for element in lens.elements if isinstance(element, Surface))
    return lens.model is LensModel.EXACT and any(coating is not None for coating in coatings)


def loss_record(lens: LensStack, wavelength: float | Floats, *, reverse: bool) -> LossRecord | None:
    """Losses of a lens at a wavelength in nm, or at those of rays; None if it has no coating."""
    if not has_losses(lens):
        return None
    wavelengths = tuple(np.array(wavelength, dtype=np.float64, ndmin=1).tolist())
    indices = np.array([lens.indices(each) for each in wavelengths])
    media, order = lens.gap_media, slice(None, None, -1 if reverse else 1)
    tables = loss_tables(
        lambda cosines: _tables(lens, wavelengths, indices, cosines)[order], isinstance(wavelength, np.ndarray)
    )
    # Before the first element, the origin of a ray is arbitrary.
    per_mm = np.array([[attenuation(medium, each) for each in wavelengths] for medium in media])
    per_mm = per_mm[1:][order] if reverse else per_mm[:-1].copy()
    per_mm[0] = 0.0
    absorbing = np.asarray(per_mm.any(axis=1))
    if not absorbing.any():
        return LossRecord(*tables, None, None)
    return LossRecord(*tables, np.ascontiguousarray(per_mm), absorbing)


def loss_tables(light: Callable[[tuple[float, ...]], Floats], dispersed: bool) -> tuple[Floats | None, Floats | None]:
    """Tables of a `LossRecord`, of one wavelength or of many, from light (n, wavelengths, cosines) at cosines."""
    if not dispersed:
        table = light(tuple(np.sqrt(np.linspace(0.0, 1.0, _INTERVALS + 1)).tolist()))[:, 0]
        # A cosine of 1 is interpolated towards one more node.
        return np.concatenate([table, table[:, -1:]], axis=1), None
    for intervals in _DISPERSED_INTERVALS:
        fine = light(tuple(np.linspace(0.0, 1.0, 2 * intervals + 1).tolist()))
        table = fine[..., ::2]
        before, behind = (
            4.0 * (ends[..., :1] + ends[..., 2:3]) - 6.0 * ends[..., 1:2] - ends[..., 3:4]
            for ends in (table, table[..., ::-1])
        )
        table = np.concatenate([before, table, behind], axis=-1)
        halfway = (9.0 * (table[..., 1:-2] + table[..., 2:-1]) - table[..., :-3] - table[..., 3:]) / 16.0
        if np.abs(halfway - fine[..., 1::2])[..., intervals // 4 :].max() <= _TOLERANCE:
            break
    return None, np.ascontiguousarray(table)


def _tables(lens: LensStack, wavelengths: tuple[float, ...], indices: Floats, cosines: tuple[float, ...]) -> Floats:
    """Light (n, wavelengths, cosines) that goes on behind each element, at cosines in the medium of lower index.

    `indices` (wavelengths, n + 1) are those of the lens.
    """
    media = lens.gap_media
    transmittance = np.ones((len(lens.elements), len(wavelengths), len(cosines)))
    for k, element in enumerate(lens.elements):
        if isinstance(element, Surface):
            front, behind = indices[:, k], indices[:, k + 1]
            in_order = np.full(len(wavelengths), fill_value=True)
            if isinstance(element.coating, Coating) and len(element.coating.layers) > 1:
                from_front = [is_from_front(media[k : k + 2], each) for each in wavelengths]
                in_order = (front <= behind) == from_front
            low_high = tuple(np.minimum(front, behind).tolist()), tuple(np.maximum(front, behind).tolist())
            transmittance[k] = _table(element, low_high, wavelengths, in_order, cosines)
    return transmittance


def _table(
    element: Surface,
    low_high: tuple[tuple[float, ...], tuple[float, ...]],
    wavelengths: tuple[float, ...],
    in_order: NDArray[np.bool_],
    cosines: tuple[float, ...],
) -> Floats:
    """Light (wavelengths, nodes) that goes on behind a surface between media of a lower and a higher index.

    `in_order`: films are described from the lower one.
    """
    if isinstance(element.medium, Mirror):
        if not isinstance(element.coating, Reflectance):
            return np.ones((len(wavelengths), len(cosines)))
        low, high, nm = (np.array(each)[:, np.newaxis] for each in (*low_high, wavelengths))
        return surface_powers(element.coating, low, high, cosines, nm).reflectance
    return transmittance_table(element.coating, low_high, wavelengths, tuple(in_order.tolist()), cosines)


@functools.lru_cache(maxsize=256)
def transmittance_table(
    coating: SurfaceCoating | None,
    low_high: tuple[tuple[float, ...], tuple[float, ...]],
    wavelengths: tuple[float, ...],
    in_order: tuple[bool, ...],
    cosines: tuple[float, ...],
) -> Floats:
    """Table (wavelengths, cosines) of a refracting surface between a lower and a higher index at each wavelength.

    Unfolded stacks of ghosts pass the same surfaces many times.
    """
    n_low, n_high, nm, order = (np.array(each)[:, np.newaxis] for each in (*low_high, wavelengths, in_order))
    return ordered_powers(coating, n_low, n_high, cosines, nm, order).transmittance
