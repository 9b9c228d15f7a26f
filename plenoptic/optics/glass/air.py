"""Absolute refractive index of air, and of media whose catalogue index is relative to air."""

from __future__ import annotations

import enum
import math
from dataclasses import KW_ONLY

from plenoptic.core.values import check_kind, choice, finite, set_field, value
from plenoptic.errors import InvalidValueError
from plenoptic.optics.glass.media import Medium, checked_index, wavelength_within

AIR_WAVELENGTH_RANGE = (300.0, 1700.0)
"""Range of wavelengths in vacuum, nm, of both formulas."""

_LIMITS = {
    "temperature": (-40.0, 100.0, " deg C"),
    "pressure": (10.0, 140.0, " kPa"),
    "humidity": (0.0, 1.0, ""),
    "co2": (0.0, 2000.0, " ppm"),
}
_EDLEN_CO2 = 450.0


class AirFormula(enum.IntEnum):
    """Formula for the refractive index of air.

    - CIDDOR: from the densities of dry air and of water vapour. Its expected uncertainty is 2e-8 to 5e-8 in 350 to
      1300 nm, and it stays good in hot, cold and humid air.
    - EDLEN: Edlen's form as fitted anew by Birch and Downs, for air as in laboratories, with 450 ppm of carbon dioxide.
      There the two agree to 1e-8; in frost or in hot and humid air they differ by up to 2e-7.

    Examples
    --------
    >>> import plenoptic as pl
    >>> one, other = (pl.optics.Air(20.0, 101.325, formula=formula).index(633.0) for formula in pl.optics.AirFormula)
    >>> abs(one - other) < 1e-8
    True
    """

    CIDDOR = 0
    EDLEN = 1


def _vapour_pressure(air: Air) -> float:
    """Partial pressure of the water vapour in Pa, without other gases; Ciddor, appendix A, after Davis and Giacomo."""
    kelvin = air.temperature + 273.15
    if air.temperature < 0:
        return air.humidity * math.pow(10.0, -2663.5 / kelvin + 12.537)  # over ice
    return air.humidity * math.exp(
        1.2378847e-5 * kelvin**2 - 1.9121316e-2 * kelvin + 33.93711047 - 6.3431645e3 / kelvin
    )


def _vapour_fraction(air: Air) -> float:
    """Molar fraction of the water vapour."""
    pascal = air.pressure * 1e3
    enhancement = 1.00062 + 3.14e-8 * pascal + 5.6e-7 * air.temperature**2
    return enhancement * _vapour_pressure(air) / pascal


_VAPOUR_MASS = 0.018015  # kg/mol
_GAS_CONSTANT = 8.314510  # J/(mol K)


def _compressibility(kelvin: float, pascal: float, vapour: float) -> float:
    """Compressibility; equation 12 of Ciddor 1996."""
    t, ratio = kelvin - 273.15, pascal / kelvin
    linear = 1.58123e-6 - 2.9331e-8 * t + 1.1043e-10 * t**2
    linear += (5.707e-6 - 2.051e-8 * t) * vapour + (1.9898e-4 - 2.376e-6 * t) * vapour**2
    return 1.0 - ratio * linear + ratio**2 * (1.83e-11 - 0.765e-8 * vapour**2)


def _density(kelvin: float, pascal: float, vapour: float, mass: float) -> float:
    """Density, kg/m^3, of a mass per mol (the share that a component has of it) in moist air; Ciddor's equation 4."""
    return pascal * mass / (_compressibility(kelvin, pascal, vapour) * _GAS_CONSTANT * kelvin)


def _ciddor(air: Air, s: float) -> float:
    """Refractivity n - 1, by the squared wavenumber s in 1/um^2; Ciddor's equations 1 to 5."""
    dry = 1e-8 * (5792105.0 / (238.0185 - s) + 167917.0 / (57.362 - s)) * (1.0 + 0.534e-6 * (air.co2 - 450.0))
    wet = 1.022e-8 * (295.235 + 2.6422 * s - 0.032380 * s**2 + 0.004028 * s**3)
    air_mass = 1e-3 * (28.9635 + 12.011e-6 * (air.co2 - 400.0))
    kelvin, pascal, vapour = air.temperature + 273.15, air.pressure * 1e3, _vapour_fraction(air)
    # Each component counts by its density over that in its reference air.
    dry_share = _density(kelvin, pascal, vapour, air_mass * (1.0 - vapour)) / _density(288.15, 101325.0, 0.0, air_mass)
    wet_share = _density(kelvin, pascal, vapour, _VAPOUR_MASS * vapour) / _density(293.15, 1333.0, 1.0, _VAPOUR_MASS)
    return dry_share * dry + wet_share * wet


def _edlen(air: Air, s: float) -> float:
    """Refractivity n - 1, by the squared wavenumber s in 1/um^2; Birch and Downs 1994."""
    t, pascal = air.temperature, air.pressure * 1e3
    standard = 1e-8 * (8342.54 + 2406147.0 / (130.0 - s) + 15998.0 / (38.9 - s))
    dry = pascal * standard / 96095.43 * (1.0 + 1e-8 * (0.601 - 0.00972 * t) * pascal) / (1.0 + 0.0036610 * t)
    return dry - 1e-10 * (292.75 / (t + 273.15)) * (3.7345 - 0.0401 * s) * _vapour_pressure(air)


@value
class Air:
    """Air, with its absolute refractive index: relative to vacuum.

    All other indices of this package, those of glass catalogues above all, are relative to air at standard conditions;
    in such a lens air is `AIR`, whose index is 1. To describe a lens in real air or in vacuum use absolute indices
    throughout: glasses as `Absolute(glass)`, and the gaps as `Air(...)` or `VACUUM`, which then are the
    `front_medium` and the `rear_medium`, too.

    Parameters
    ----------
    temperature : float, optional
        deg C, -40 to 100.
    pressure : float, optional
        kPa, 10 to 140.
    humidity : float, optional
        Relative, 0 to 1.
    co2 : float, optional
        Carbon dioxide in parts per million, 0 to 2000; with Edlen's formula 450.
    formula : AirFormula, optional
        CIDDOR or EDLEN.

    Raises
    ------
    InvalidValueError
        If a number is outside its range, the water vapour would have more than the whole pressure, or Edlen's formula
        is asked for another amount of carbon dioxide than 450 ppm.

    References
    ----------
    P. E. Ciddor, Refractive index of air: new equations for the visible and near infrared, Appl. Opt. 35, 1566 (1996),
    doi:10.1364/AO.35.001566. K. P. Birch and M. J. Downs, Correction to the updated Edlen equation for the refractive
    index of air, Metrologia 31, 315 (1994), doi:10.1088/0026-1394/31/4/006; its term for water vapour is scaled by
    292.75 K / T, and the ranges of both formulas are those of J. A. Stone and J. H. Zimmerman, Index of Refraction of
    Air, NIST Engineering Metrology Toolbox.

    Examples
    --------
    >>> import plenoptic as pl
    >>> round(pl.optics.Air(20.0, pressure=101.325).index(633.0), 9)
    1.0002718
    """

    temperature: float = 20.0
    pressure: float = 101.325
    _: KW_ONLY
    humidity: float = 0.0
    co2: float = 450.0
    formula: AirFormula = AirFormula.CIDDOR

    def __post_init__(self) -> None:
        for name, (low, high, unit) in _LIMITS.items():
            number = finite(getattr(self, name), name)
            if not low <= number <= high:
                raise InvalidValueError(f"{name} is {number:g}{unit}; the formulas hold for {low:g} to {high:g}{unit}")
            set_field(self, name, number)
        set_field(self, "formula", choice(self.formula, AirFormula, "formula"))
        if self.formula == AirFormula.EDLEN and self.co2 != _EDLEN_CO2:
            raise InvalidValueError(
                f"co2 is {self.co2:g} ppm; Edlen's formula is for {_EDLEN_CO2:g}: use that or AirFormula.CIDDOR"
            )
        if _vapour_fraction(self) > 1.0:
            raise InvalidValueError(
                f"humidity {self.humidity:g} at {self.temperature:g} deg C has a vapour pressure above the whole "
                f"pressure, {self.pressure:g} kPa; reduce the humidity or the temperature"
            )

    def index(self, wavelength: float) -> float:
        """Absolute refractive index at a wavelength in vacuum of 300 to 1700 nm; InvalidValueError outside."""
        vacuum = wavelength_within(wavelength, AIR_WAVELENGTH_RANGE, "air")
        wavenumber_squared = (1e3 / vacuum) ** 2
        refractivity = _ciddor if self.formula == AirFormula.CIDDOR else _edlen
        return checked_index(1.0 + refractivity(self, wavenumber_squared), vacuum, "air")


@value
class Absolute:
    """Absolute index of a medium whose index is relative to air: their product.

    Parameters
    ----------
    medium : Medium
        Medium whose index is relative to `air`, as in glass catalogues.
    air : Air, optional
        Reference air of the medium's index: dry air at 20 deg C and 101.325 kPa, as for most catalogues. The air around
        the lens is the medium of its gaps instead.

    Raises
    ------
    InvalidValueError
        If one of the two has another type.

    Examples
    --------
    >>> import plenoptic as pl
    >>> glass = pl.ModelGlass(1.5168, 64.17, "BK7")
    >>> round(pl.optics.Absolute(glass).index(587.5618), 5)
    1.51721
    """

    medium: Medium
    air: Air = Air()  # noqa: RUF009

    def __post_init__(self) -> None:
        check_kind(self.medium, "medium", Medium, "pl.ModelGlass(1.67, 47.1)")
        check_kind(self.air, "air", Air, "pl.optics.Air(temperature=22.0)")
        if isinstance(self.medium, Air | Absolute):
            raise InvalidValueError("the medium is absolute already; give one whose index is relative to air")

    def index(self, wavelength: float) -> float:
        """Absolute refractive index at a wavelength in nm within the ranges of the medium and of the air."""
        return self.medium.index(wavelength) * self.air.index(wavelength)
