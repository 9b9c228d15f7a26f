"""Light that the sides of plano-convex microlenses and their glass take."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.optics.coatings.surface_powers import ordered_powers
from plenoptic.optics.glass.absorption import attenuation
from plenoptic.optics.glass.media import AIR, Medium
from plenoptic.optics.lens.loss_record import LossRecord, transmittance_table
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
    table = transmittance_table(array.coating, low_high, wavelengths, tuple((ratio >= 1.0).tolist()))
    # As of a lens: a cosine of 1 is interpolated towards one more node.
    tables = np.concatenate([table, table[:, -1:]], axis=1)[np.newaxis]
    per_mm = np.array([[attenuation(array.medium, each) for each in wavelengths]])
    absorbs = (per_mm, np.ones(1, dtype=np.bool_)) if per_mm.any() else (None, None)
    return record._replace(model=plate._replace(losses=LossRecord(tables, *absorbs)))


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
