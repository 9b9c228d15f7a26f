"""Record of the light that a lens takes from rays: transmittance of surfaces, and attenuation in glass."""

from __future__ import annotations

import functools
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
"""Intervals of the squared cosine, which needs no square root. Linear interpolation is within 3e-7 for bare glass up to
60 degrees, 5e-6 up to 75, 2e-4 up to 85; errors of films rise with the square of their thickness."""


class LossRecord(NamedTuple):
    """Losses of the elements of a `LensRecord`, in the order of travel, at its wavelengths."""

    transmittance: Floats
    """(n, wavelengths, nodes + 1) for unpolarised light, at uniform squares of the cosine in the medium of lower index,
    the last one twice; 1 for stops."""
    attenuation: Floats | None
    """(n, wavelengths) attenuation coefficient in 1/mm in front of each element, 0 for the first; None if all are 0."""
    absorbing: NDArray[np.bool_] | None
    """(n,) True if it is not 0."""

    def part(self, begin: int, end: int) -> LossRecord:
        """Losses of elements begin ... end - 1; before the first one nothing attenuates light."""
        if self.attenuation is None or self.absorbing is None:
            return self._replace(transmittance=self.transmittance[begin:end])
        attenuation, absorbing = self.attenuation[begin:end].copy(), self.absorbing[begin:end].copy()
        attenuation[0], absorbing[0] = 0.0, False
        return LossRecord(self.transmittance[begin:end], attenuation, absorbing)


def table_cosines() -> Floats:
    """Rising cosines of the angles at which tables are computed."""
    return np.sqrt(np.linspace(0.0, 1.0, _INTERVALS + 1))


def has_losses(lens: LensStack) -> bool:
    """True if images include the losses of a lens: it is traced exactly, and a surface has a coating."""
    coatings = (element.coating for element in lens.elements if isinstance(element, Surface))
    return lens.model is LensModel.EXACT and any(coating is not None for coating in coatings)


def loss_record(lens: LensStack, wavelengths: tuple[float, ...], *, reverse: bool) -> LossRecord | None:
    """Losses of a lens at wavelengths in nm; None if it has no coating."""
    if not has_losses(lens):
        return None
    indices, media = np.array([lens.indices(each) for each in wavelengths]), lens.gap_media
    transmittance = np.ones((len(lens.elements), len(wavelengths), _INTERVALS + 1))
    for k, element in enumerate(lens.elements):
        if isinstance(element, Surface):
            front, behind = indices[:, k], indices[:, k + 1]
            in_order = np.full(len(wavelengths), fill_value=True)
            if isinstance(element.coating, Coating) and len(element.coating.layers) > 1:
                from_front = [is_from_front(media[k : k + 2], each) for each in wavelengths]
                in_order = (front <= behind) == from_front
            low, high = np.minimum(front, behind), np.maximum(front, behind)
            transmittance[k] = _table(element, (low, high), wavelengths, in_order)
    order = slice(None, None, -1 if reverse else 1)
    # A cosine of 1 is interpolated towards one more node.
    tables = np.ascontiguousarray(np.concatenate([transmittance, transmittance[:, :, -1:]], axis=2)[order])
    # Before the first element, the origin of a ray is arbitrary.
    per_mm = np.array([[attenuation(medium, each) for each in wavelengths] for medium in media])
    per_mm = per_mm[1:][order] if reverse else per_mm[:-1].copy()
    per_mm[0] = 0.0
    absorbing = np.asarray(per_mm.any(axis=1))
    if not absorbing.any():
        return LossRecord(tables, None, None)
    return LossRecord(tables, np.ascontiguousarray(per_mm), absorbing)


def _table(
    element: Surface, indices: tuple[Floats, Floats], wavelengths: tuple[float, ...], in_order: NDArray[np.bool_]
) -> Floats:
    """Light (wavelengths, nodes) that goes on behind a surface between media of a lower and a higher index.

    `in_order`: films are described from the lower one.
    """
    low, high = indices
    if isinstance(element.medium, Mirror):
        if not isinstance(element.coating, Reflectance):
            return np.ones((len(wavelengths), _INTERVALS + 1))
        nm, cosines = np.array(wavelengths)[:, np.newaxis], table_cosines()
        return surface_powers(element.coating, low[:, np.newaxis], high[:, np.newaxis], cosines, nm).reflectance
    low_high = tuple(low.tolist()), tuple(high.tolist())
    return transmittance_table(element.coating, low_high, wavelengths, tuple(in_order.tolist()))


@functools.lru_cache(maxsize=256)
def transmittance_table(
    coating: SurfaceCoating | None,
    low_high: tuple[tuple[float, ...], tuple[float, ...]],
    wavelengths: tuple[float, ...],
    in_order: tuple[bool, ...],
) -> Floats:
    """Table (wavelengths, nodes) of a refracting surface between a lower and a higher index at each wavelength.

    Unfolded stacks of ghosts pass the same surfaces many times.
    """
    n_low, n_high, nm, order = (np.array(each)[:, np.newaxis] for each in (*low_high, wavelengths, in_order))
    return ordered_powers(coating, n_low, n_high, table_cosines(), nm, order).transmittance
