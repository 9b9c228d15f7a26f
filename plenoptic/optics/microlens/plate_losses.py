"""Light that the sides of plano-convex microlenses and their glass take."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.values import Floats
from plenoptic.optics.coatings.surface_powers import ordered_powers
from plenoptic.optics.glass.absorption import attenuation
from plenoptic.optics.glass.media import AIR, Medium
from plenoptic.optics.lens.loss_record import LossRecord, loss_tables, transmittance_table
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.microlens_record import ArrayRecord
from plenoptic.optics.microlens.plano_convex import PlateRecord


def add_losses(
    record: ArrayRecord, array: MicrolensArray, wavelengths: tuple[float, ...], outside: Medium = AIR
) -> ArrayRecord:
    """The record with the losses at its wavelengths in nm of an array with a coating in a medium, `outside`."""
    if array.coating is None:
        return record
    plate = record.model
    assert isinstance(plate, PlateRecord)
    around = np.array([float(outside.index(each)) for each in wavelengths])
    ratio = np.array([array.index_at(each) for each in wavelengths])
    low_high = tuple((around * np.minimum(ratio, 1.0)).tolist()), tuple((around * np.maximum(ratio, 1.0)).tolist())
    # Both sides lie between the same media, and films are described from the lower index: one table for both.
    order, coating = tuple((ratio >= 1.0).tolist()), array.coating

    def light(cosines: tuple[float, ...], part: slice) -> Floats:
        low, high, nm, in_order = (each[part] for each in (*low_high, wavelengths, order))
        return transmittance_table(coating, (low, high), nm, in_order, cosines)[np.newaxis]

    table, _ = loss_tables(lambda cosines: light(cosines, slice(1)), dispersed=False)
    dispersed = None
    if len(wavelengths) > 1:
        _, dispersed = loss_tables(lambda cosines: light(cosines, slice(1, None)), dispersed=True)
    per_mm = np.array([[attenuation(array.medium, each) for each in wavelengths]])
    absorbs = (per_mm, np.ones(1, dtype=np.bool_)) if per_mm.any() else (None, None)
    return record._replace(model=plate._replace(losses=LossRecord(table, dispersed, *absorbs)))


def axial_transmission(array: MicrolensArray, wavelength: float, outside: Medium = AIR) -> float | None:
    """Fraction of the light along the axis that both sides and the glass of microlenses transmit; None uncoated."""
    if array.coating is None:
        return None
    return transmission_to_rear(array, wavelength, outside) * _side_transmittance(array, wavelength, outside)


def transmission_to_rear(array: MicrolensArray, wavelength: float, outside: Medium = AIR) -> float:
    """Fraction of the light along the axis that arrives at the rear side of microlenses; 1 uncoated."""
    if array.coating is None:
        return 1.0
    glass = math.exp(-attenuation(array.medium, wavelength) * array.thickness)
    return _side_transmittance(array, wavelength, outside) * glass


def _side_transmittance(array: MicrolensArray, wavelength: float, outside: Medium) -> float:
    ratio, around = array.index_at(wavelength), float(outside.index(wavelength))
    return float(ordered_powers(array.coating, around, around * ratio, 1.0, wavelength, True).transmittance)
