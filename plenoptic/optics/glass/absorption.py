"""Absorption in glass: internal transmittance by wavelength, as catalogues state it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import (
    Floats,
    Given,
    frozen_array,
    not_negative,
    plain_array,
    set_field,
    value,
    wavelength_in_nm,
)
from plenoptic.errors import InvalidValueError
from plenoptic.optics.glass.media import Medium, check_medium, wavelength_within

_DARKEST = 1e-12
"""Transmittance that stands for 0 in a table, whose logarithm is finite."""


def rising_wavelengths(values: ArrayLike, name: str) -> Floats:
    """Wavelengths (n,) of a table in nm, or an error if there is none or they do not rise."""
    table: Floats = frozen_array(values, name=name, shape=(None,))
    for nm in table.tolist():
        wavelength_in_nm(nm, name)
    if not table.size or (np.diff(table) <= 0).any():
        raise InvalidValueError(f"{name} must rise from each to the next, and there must be at least one")
    return table


def table_column(values: ArrayLike, name: str, count: int) -> Floats:
    """Column of a table of `count` rows, from as many numbers or one for all."""
    column = plain_array(values, name)
    return frozen_array(np.full(count, column) if column.ndim == 0 else column, name=name, shape=(count,))


@value
class AbsorbingGlass:
    """A medium with its internal transmittance: the light that remains behind a thickness, without reflections.

    Glasses of AGF files with lines IT are of this kind; see `load_glasses`. The bundled catalogues state none.

    Parameters
    ----------
    medium : Medium
        Medium that gives the index.
    wavelengths : (n,) array
        Rising wavelengths in nm.
    transmittance : (n,) array
        Internal transmittance at each, 0 to 1. Its logarithm is interpolated linearly.
    thickness : (n,) array or float, optional
        Thickness in mm to which each number belongs.

    Raises
    ------
    InvalidValueError
        If a number is out of range, or the lengths differ; a PrescriptionError if `medium` is none.

    Examples
    --------
    >>> import plenoptic as pl
    >>> dense = pl.optics.AbsorbingGlass(pl.glass("SF6"), [400.0, 500.0], [0.727, 0.989], thickness=10.0)
    >>> round(dense.internal_transmittance(400.0, 20.0), 4), dense.name        # 0.727^2
    (0.5285, 'SF6')
    """

    medium: Medium
    wavelengths: Given[Floats, ArrayLike]
    transmittance: Given[Floats, ArrayLike]
    thickness: Given[Floats, ArrayLike] = Given(default=10.0)

    def __post_init__(self) -> None:
        check_medium(self.medium, "medium")
        nm = rising_wavelengths(self.wavelengths, "wavelengths")
        set_field(self, "wavelengths", nm)
        passed = frozen_array(self.transmittance, name="transmittance", shape=nm.shape)
        if not ((passed >= 0.0) & (passed <= 1.0)).all():
            raise InvalidValueError(f"transmittance is from {passed.min():g} to {passed.max():g}; it must be in 0 to 1")
        set_field(self, "transmittance", passed)
        checked = table_column(self.thickness, "thickness", len(nm))
        if not ((checked > 0.0) & (checked < math.inf)).all():
            raise InvalidValueError(f"thickness has {checked.min():g} mm; it must be above 0 and finite")
        set_field(self, "thickness", checked)

    @property
    def name(self) -> str:
        """Name of the medium; empty if it has none."""
        return str(getattr(self.medium, "name", ""))

    def index(self, wavelength: float) -> float:
        """Refractive index of the medium at a wavelength in nm."""
        return self.medium.index(wavelength)

    def attenuation(self, wavelength: float) -> float:
        """Attenuation coefficient in 1/mm at a wavelength in nm; an InvalidValueError outside the table."""
        limits = float(self.wavelengths[0]), float(self.wavelengths[-1])
        nm = wavelength_within(wavelength, limits, f"the transmittance of {self.name or 'a glass'}")
        per_mm = -np.log(np.maximum(self.transmittance, _DARKEST)) / self.thickness
        return float(np.interp(nm, self.wavelengths, per_mm))

    def internal_transmittance(self, wavelength: float, thickness: float) -> float:
        """Fraction of the light that remains behind a thickness in mm."""
        return math.exp(-self.attenuation(wavelength) * not_negative(thickness, "thickness", "mm"))


def attenuation(medium: Any, wavelength: float) -> float:
    """Attenuation coefficient of a medium in 1/mm at a wavelength in nm; 0 if its transmittance is not stated."""
    inner = getattr(medium, "medium", None)
    if isinstance(medium, AbsorbingGlass):
        return medium.attenuation(wavelength)
    return 0.0 if inner is None else attenuation(inner, wavelength)
