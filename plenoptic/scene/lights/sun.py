"""Lights that are so far away that they shine on everything from the same direction."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import Floats, Given, checked_field, finite, radians, value
from plenoptic.errors import InvalidValueError, SceneError
from plenoptic.scene.lights.fields import unit_vector
from plenoptic.scene.textures.color import Colour, as_colour

SUN_RADIUS = 0.00465
"""rad: asin(695700 km / 149597870.7 km), the Sun's nominal radius (IAU 2015 Resolution B3) over 1 au."""

_SMALLEST_RADIUS = 1e-6


@value
class SunLight:
    """A disc at infinity of the same radiance all over, or parallel light.

    A surface whose normal makes the angle b with the way to the light, and from which all of the disc can be seen, has
    the irradiance `irradiance` cos(b), at any position. Rays that hit no surface see the disc, those of the camera and
    those from a mirror; parallel light has none, so it is not seen.

    Parameters
    ----------
    direction : (3,) array
        The way its light travels, from the middle of the disc; of any length above 0, kept with length 1.
    irradiance : float or (float, float, float)
        On a surface that faces it, radiance in scene units times sr, 0 or more: one number, or (red, green, blue).
        pi makes a white matt surface that faces it as bright as radiance 1.
    angular_radius : float
        Radians, of the disc, by default that of the Sun: from 1e-6 to below pi/2, or 0 for parallel light.

    Raises
    ------
    InvalidValueError
        Of another shape, an angular radius out of range, or numbers that are not finite.
    SceneError
        A direction without length, a negative irradiance, or one so large that the radiance overflows.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.SunLight((0, -3, -4), irradiance=3.0)
    SunLight(direction=[0.0, -0.6, -0.8], irradiance=3.0)
    """

    direction: Given[Floats, ArrayLike] = checked_field(unit_vector)
    irradiance: Colour = checked_field(as_colour, default=1.0)
    angular_radius: float = checked_field(finite, default=SUN_RADIUS)

    def __post_init__(self) -> None:
        radius = self.angular_radius
        if not (radius == 0 or _SMALLEST_RADIUS <= radius < math.pi / 2):
            raise InvalidValueError(
                f"angular_radius is {radius:g} rad; it must be 0, for parallel light, or within {_SMALLEST_RADIUS:g} "
                "and pi/2"
            )
        radiance = self.radiance
        if radiance is not None and not np.isfinite(radiance).all():
            raise SceneError(
                f"irradiance {self.irradiance} in a disc of angular_radius {radius:g} rad has infinite radiance; "
                "reduce the one or enlarge the other"
            )

    @classmethod
    def from_angles(
        cls, azimuth: float, elevation: float, *, irradiance: Colour = 1.0, angular_radius: float = SUN_RADIUS
    ) -> SunLight:
        """A sun by its position in the sky.

        Parameters
        ----------
        azimuth : float
            Radians, from straight ahead of a camera without pose (-z) to its right (+x): pi is the sun behind it.
        elevation : float
            Radians above the horizon (the plane of x and z) towards +y, within -pi/2 and pi/2.
        irradiance, angular_radius
            As in `SunLight`.

        Raises
        ------
        InvalidValueError
            An elevation beyond pi/2, or an angle that is not finite.

        Examples
        --------
        >>> import math, plenoptic as pl
        >>> sun = pl.SunLight.from_angles(azimuth=math.pi / 2, elevation=math.pi / 6)   # right, 30 degrees high
        >>> sun.direction.round(3).tolist()
        [-0.866, -0.5, 0.0]
        """
        turn, up = radians(azimuth, "azimuth"), finite(elevation, "elevation")
        if not abs(up) <= math.pi / 2:
            raise InvalidValueError(f"elevation is {up:g} rad; it must be within -pi/2 and pi/2")
        direction = (-math.cos(up) * math.sin(turn), -math.sin(up), math.cos(up) * math.cos(turn))
        return cls(direction, irradiance, angular_radius)

    @property
    def radiance(self) -> Colour | None:
        """Radiance of the disc, irradiance / (pi sin^2 angular_radius); None for parallel light, which has no disc.

        Examples
        --------
        >>> import plenoptic as pl
        >>> round(pl.SunLight((0, -1, 0), irradiance=1.0).radiance)
        14721
        """
        if self.angular_radius == 0:
            return None
        projected = math.pi * math.sin(self.angular_radius) ** 2
        if not isinstance(self.irradiance, tuple):
            return self.irradiance / projected
        red, green, blue = self.irradiance
        return red / projected, green / projected, blue / projected

    def moved(self, matrix: Floats, scale: float) -> SunLight:
        """The light turned by a (4, 4) similarity; its irradiance stays."""
        return dataclasses.replace(self, direction=matrix[:3, :3] @ self.direction)

    def row(self) -> tuple[float, ...]:
        """Direction to the sun, and 1 - cosine of its angular radius."""
        return (*(-self.direction), 2 * math.sin(self.angular_radius / 2) ** 2)
