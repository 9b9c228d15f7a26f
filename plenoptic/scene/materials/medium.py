"""Homogeneous media that absorb and scatter light: water, fog, milk."""

from __future__ import annotations

from typing import Any

from plenoptic.core.values import check_kind, checked_field, finite, value
from plenoptic.errors import InvalidValueError, SceneError
from plenoptic.scene.textures.color import Colour, as_colour

_WATER = ((0.2224e-3, 0.0434e-3, 0.00922e-3), (0.00105e-3, 0.00177e-3, 0.00354e-3))


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
