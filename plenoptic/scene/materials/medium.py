"""Homogeneous media that absorb and scatter light: water, fog, milk."""

from __future__ import annotations

from typing import Any

from plenoptic.core.values import check_kind, checked_field, finite, value
from plenoptic.errors import InvalidValueError, SceneError
from plenoptic.scene.textures.color import Colour, as_colour

_WATER = ((0.2224e-3, 0.0434e-3, 0.00922e-3), (0.00105e-3, 0.00177e-3, 0.00354e-3))

_JERLOV = {
    "I": ((0.228, 0.062, 0.046, 0.018), (0.00122, 0.0017, 0.00205, 0.00381)),
    "IA": ((0.228, 0.0622, 0.0468, 0.0221), (0.00283, 0.00354, 0.00402, 0.00631)),
    "IB": ((0.2278, 0.0623, 0.0469, 0.0235), (0.0488, 0.0536, 0.0565, 0.068)),
    "II": ((0.228, 0.0622, 0.0469, 0.0241), (0.309, 0.358, 0.387, 0.504)),
    "III": ((0.229, 0.0646, 0.0507, 0.0388), (0.845, 0.98, 1.06, 1.38)),
    "1C": ((0.236, 0.076, 0.068, 0.105), (0.314, 0.365, 0.395, 0.514)),
    "3C": ((0.239, 0.082, 0.078, 0.154), (0.916, 1.06, 1.15, 1.5)),
    "5C": ((0.259, 0.117, 0.127, 0.297), (1.147, 1.33, 1.44, 1.87)),
    "7C": ((0.301, 0.195, 0.233, 0.542), (2.03, 2.35, 2.54, 3.3)),
    "9C": ((0.39, 0.348, 0.43, 0.943), (2.69, 3.12, 3.38, 4.39)),
}
"""Absorption and scattering of Jerlov's types at 600, 550, 525 and 450 nm, 1/m; see `jerlov_water`."""
_PARTICLE_COSINE = 0.924


def _asymmetry(g: Any, name: str) -> float:
    number = finite(g, name)
    if not -1 < number < 1:
        raise SceneError(f"{name} is {number:g}; it must be between -1 and 1, such as 0 (alike in all directions)")
    return number


@value
class HenyeyGreenstein:
    """Phase function of L. G. Henyey and J. L. Greenstein, Astrophys. J. 93, 70 (1941), doi 10.1086/144246.

    Parameters
    ----------
    g : float
        Mean cosine of the angle of scattering, between -1 and 1: above 0 forwards, below 0 backwards.

    Raises
    ------
    InvalidValueError
        Not a number.
    SceneError
        Not between -1 and 1.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.materials.HenyeyGreenstein(0.9)
    HenyeyGreenstein(g=0.9)
    """

    g: float = checked_field(_asymmetry, default=0.0)


@value
class Medium:
    """A homogeneous medium: of `Scene(medium=)`, or of the body of a `Dielectric(medium=)`.

    Parameters
    ----------
    absorption, scattering : float or (float, float, float)
        Coefficients per mm, 0 or more: of radiance, exp(-(absorption + scattering) t) is left after t mm.
    phase : HenyeyGreenstein
        Directions into which light is scattered.

    Raises
    ------
    InvalidValueError
        Not numbers, or not a phase function.
    SceneError
        A negative coefficient.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.materials.Medium(absorption=1e-4, scattering=(1e-3, 2e-3, 3e-3))
    Medium(absorption=0.0001, scattering=(0.001, 0.002, 0.003))
    """

    absorption: Colour = checked_field(as_colour, default=0.0)
    scattering: Colour = checked_field(as_colour, default=0.0)
    phase: HenyeyGreenstein = HenyeyGreenstein()

    def __post_init__(self) -> None:
        check_kind(self.phase, "phase", HenyeyGreenstein, "pl.materials.HenyeyGreenstein(0.9)")


def pure_water() -> Medium:
    """Pure water at 600, 530 and 450 nm.

    Absorption of R. M. Pope and E. S. Fry, Appl. Opt. 36, 8710 (1997), doi 10.1364/AO.36.008710, table 3; scattering
    after A. Morel, in: Optical aspects of oceanography, 1974: 1.2e-4 / m at 1 um, by the power -4.24 of wavelength.
    Molecules scatter forwards as much as backwards; the phase function is taken as uniform.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.materials.pure_water().absorption
    (0.0002224, 4.34e-05, 9.22e-06)
    """
    return Medium(*_WATER)


def jerlov_water(water_type: str) -> Medium:
    """Sea water of one of N. G. Jerlov's types, from the clearest ocean to turbid coasts, at 600, 530 and 450 nm.

    Absorption and scattering of M. G. Solonenko and C. D. Mobley, Appl. Opt. 54, 5392 (2015),
    doi 10.1364/AO.54.005392, tables 4 to 8, linear between 525 and 550 nm. They were fitted to Jerlov's attenuation of
    daylight (1968), not measured. The row of 5C at 600 nm is misprinted there, and is that of C. A. Williamson and
    R. C. Hollins, Appl. Opt. 61, 9951 (2022), doi 10.1364/AO.470464.

    The mean cosine is an assumption: 0.924 of particles, that of the average of T. J. Petzold's measurements (C. D.
    Mobley, Light and Water, 1994), and 0 of pure water, weighed by their scattering at 530 nm.

    Parameters
    ----------
    water_type : str
        "I", "IA", "IB", "II" or "III" of the open ocean, "1C", "3C", "5C", "7C" or "9C" of coasts.

    Raises
    ------
    InvalidValueError
        Another type.

    Examples
    --------
    >>> import plenoptic as pl
    >>> coast = pl.materials.jerlov_water("1C")
    >>> coast.absorption, round(coast.phase.g, 3)
    ((0.000236, 6.96e-05, 0.000105), 0.92)
    """
    if not isinstance(water_type, str) or water_type not in _JERLOV:
        raise InvalidValueError(f"water_type is {water_type!r}; it must be one of {', '.join(_JERLOV)}")
    absorption, scattering = (_per_mm(*row) for row in _JERLOV[water_type])
    return Medium(absorption, scattering, HenyeyGreenstein(_PARTICLE_COSINE * (1.0 - _WATER[1][1] / scattering[1])))


def _per_mm(red: float, green_550: float, green_525: float, blue: float) -> tuple[float, float, float]:
    """Coefficients per mm at 600, 530 and 450 nm."""
    return round(1e-3 * red, 9), round(2e-4 * green_550 + 8e-4 * green_525, 9), round(1e-3 * blue, 9)


def fog(visibility: float, *, g: float = 0.85) -> Medium:
    """Fog of a meteorological visibility in mm, in which a black object has a contrast of 0.02: 3.912 / visibility.

    H. Koschmieder, Beitr. Phys. freien Atm. 12, 33 (1924). Droplets hardly absorb light.

    Raises
    ------
    InvalidValueError
        Not a number.
    SceneError
        A visibility that is not above 0, or g not between -1 and 1.

    Examples
    --------
    >>> import plenoptic as pl
    >>> round(pl.materials.fog(50_000).scattering, 8)  # 50 m
    7.824e-05
    """
    number = finite(visibility, "visibility")
    if not number > 0:
        raise SceneError(f"visibility is {number:g}; it must be above 0 mm")
    return Medium(0.0, 3.912 / number, HenyeyGreenstein(g))


def milk() -> Medium:
    """Whole milk, with the reduced scattering of H. W. Jensen et al., SIGGRAPH 2001.

    Figure 5 of doi 10.1145/383259.383319. Reduced coefficients are those for a uniform phase function.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.materials.milk().scattering
    (2.55, 3.21, 3.77)
    """
    return Medium((0.0011, 0.0024, 0.014), (2.55, 3.21, 3.77))


def as_medium(medium: Any, name: str) -> Medium | None:
    """A medium or None."""
    if medium is not None and not isinstance(medium, Medium):
        raise InvalidValueError(
            f"{name} is {type(medium).__name__}; it must be pl.materials.Medium(scattering=1e-3) or None"
        )
    return medium
