"""Lights without size that shine everywhere alike."""

from __future__ import annotations

import dataclasses
import math

from numpy.typing import ArrayLike

from plenoptic.core.values import Floats, Given, checked_field, value
from plenoptic.scene.lights.fields import channel_mean, place_in_mm, times
from plenoptic.scene.textures.color import Colour, as_colour


@value
class PointLight:
    """A point that emits the same intensity in all directions.

    On a surface at distance d whose normal makes the angle a with the way to the light, the irradiance is
    intensity cos(a) / d^2. A point has no area, so no ray hits it: neither the camera nor a mirror shows it.

    Parameters
    ----------
    position : (3,) array
        mm.
    intensity : float or (float, float, float)
        Radiance in scene units times mm^2, 0 or more: one number, or (red, green, blue). A small surface of area A and
        radiance L that faces you has the intensity L A.

    Raises
    ------
    InvalidValueError
        Of another shape, or an intensity that is not finite.
    SceneError
        A position that is not finite or beyond 1e15 mm, a negative intensity.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lamp = pl.lights.PointLight((0, 200, 0), intensity=4e4)       # irradiance 1 straight below, 200 mm away
    >>> lamp
    PointLight(position=[0.0, 200.0, 0.0], intensity=40000.0)
    """

    position: Given[Floats, ArrayLike] = checked_field(place_in_mm)
    intensity: Colour = checked_field(as_colour, default=1.0)

    @property
    def power(self) -> float:
        """All the light it emits, the mean of its channels, radiance mm^2 sr: 4 pi intensity.

        Examples
        --------
        >>> import plenoptic as pl
        >>> round(pl.lights.PointLight((0, 0, 0), intensity=100.0).power, 6)
        1256.637061
        """
        return 4 * math.pi * channel_mean(self.intensity)

    def moved(self, matrix: Floats, scale: float) -> PointLight:
        """The light where a (4, 4) similarity of that scale puts it; irradiances stay, so it grows by scale^2."""
        position = matrix[:3, :3] @ self.position + matrix[:3, 3]
        return dataclasses.replace(self, position=position, intensity=times(self.intensity, scale**2))

    def row(self) -> tuple[float, ...]:
        """Row of POINT_LIGHT."""
        return (*self.position, 0.0, 0.0, 0.0, -2.0, -2.0)
