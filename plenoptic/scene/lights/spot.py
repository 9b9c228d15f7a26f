"""Lights without size that shine into a cone."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import Floats, Given, checked_field, finite, numbers, value
from plenoptic.errors import InvalidValueError
from plenoptic.scene.lights.fields import channel_mean, direction_towards, place_in_mm, times, unit_vector
from plenoptic.scene.textures.color import Colour, as_colour


@value
class SpotLight:
    """A point that emits into a cone, fully inside an inner one, and less and less between the two.

    At the angle a from the axis the intensity is `intensity` times s^2, where s = (cos a - cos outer_angle) /
    (cos inner_angle - cos outer_angle), but within 0 and 1. As for a `PointLight`, irradiance is intensity times cosine
    over distance squared, and no ray hits it.

    Parameters
    ----------
    position : (3,) array
        mm.
    direction : (3,) array
        The axis of the cone, the way its light travels; of any length above 0, kept with length 1.
    intensity : float or (float, float, float)
        On the axis: radiance in scene units times mm^2, 0 or more: one number, or (red, green, blue).
    inner_angle : float
        Radians from the axis, 0 or more: up to here the intensity is full.
    outer_angle : float
        Radians from the axis, above `inner_angle` and at most pi: from here on it is dark.

    Raises
    ------
    InvalidValueError
        Of another shape, angles out of range, or numbers that are not finite.
    SceneError
        A position that is not finite or beyond 1e15 mm, a direction without length, a negative intensity.

    References
    ----------
    Khronos Group, glTF 2.0 extension KHR_lights_punctual, "Inner and Outer Cone Angles".

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.lights.SpotLight((0, 300, -400), (0, -2, 0), intensity=1e5, inner_angle=0.2, outer_angle=0.4)
    SpotLight(position=[0.0, 300.0, -400.0], direction=[0.0, -1.0, 0.0],
        intensity=100000.0, inner_angle=0.2, outer_angle=0.4)
    """

    position: Given[Floats, ArrayLike] = checked_field(place_in_mm)
    direction: Given[Floats, ArrayLike] = checked_field(unit_vector)
    intensity: Colour = checked_field(as_colour, default=1.0)
    inner_angle: float = checked_field(finite, default=0.0)
    outer_angle: float = checked_field(finite, default=math.pi / 4)

    def __post_init__(self) -> None:
        inner, outer = self.inner_angle, self.outer_angle
        if not 0 < outer <= math.pi:
            raise InvalidValueError(f"outer_angle is {outer:g} rad; it must be above 0 and at most pi")
        if inner < 0:
            raise InvalidValueError(f"inner_angle is {inner:g} rad; it must be 0 or more")
        # Closer together than this their cosines may be the same number.
        if not inner < outer or not math.cos(inner) - math.cos(outer) >= 1e-12:
            raise InvalidValueError(
                f"inner_angle is {inner:g} rad and outer_angle {outer:g} rad; the cosine of the inner one must be "
                "larger by 1e-12 or more, so reduce inner_angle or increase outer_angle"
            )

    @classmethod
    def facing(
        cls,
        position: ArrayLike,
        target: ArrayLike,
        *,
        intensity: Colour = 1.0,
        inner_angle: float = 0.0,
        outer_angle: float = math.pi / 4,
    ) -> SpotLight:
        """A spot whose axis goes through a point.

        Parameters
        ----------
        position, target : (3,) array
            mm, the light, and the point at which it looks.
        intensity, inner_angle, outer_angle
            As in `SpotLight`.

        Raises
        ------
        SceneError
            The target is the light's own position.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.lights.SpotLight.facing((0, 300, -404), (0, 0, -404), intensity=1e5).direction.tolist()
        [0.0, -1.0, 0.0]
        """
        start = place_in_mm(position, "position")
        return cls(start, direction_towards(start, target, "position"), intensity, inner_angle, outer_angle)

    def falloff(self, angle: ArrayLike) -> Floats:
        """Share of the intensity, within 0 and 1, that it has at angles (in radians, of any shape) from its axis.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.lights.SpotLight((0, 0, 0), (0, 0, -1), outer_angle=1.0).falloff([0.0, 0.5, 1.0]).round(3).tolist()
        [1.0, 0.538, 0.0]
        """
        inner, outer = math.cos(self.inner_angle), math.cos(self.outer_angle)
        fraction = (np.cos(numbers(angle, "angle")) - outer) / (inner - outer)
        return np.asarray(np.clip(fraction, 0.0, 1.0) ** 2)

    @property
    def power(self) -> float:
        """All the light it emits, the mean of its channels, radiance mm^2 sr.

        The falloff integrated over all directions: 2 pi intensity (1 - cos inner + (cos inner - cos outer) / 3).

        Examples
        --------
        >>> import math, plenoptic as pl
        >>> round(pl.lights.SpotLight((0, 0, 0), (0, 0, -1), 3.0, 0.0, math.pi / 2).power, 6)
        6.283185
        """
        # 1 - cos a is 2 sin^2(a / 2), which small angles do not cancel.
        inner, outer = (2 * math.sin(angle / 2) ** 2 for angle in (self.inner_angle, self.outer_angle))
        return 2 * math.pi * channel_mean(self.intensity) * (inner + (outer - inner) / 3)

    def moved(self, matrix: Floats, scale: float) -> SpotLight:
        """The light where a (4, 4) similarity of that scale puts it; irradiances stay, so it grows by scale^2."""
        position, direction = matrix[:3, :3] @ self.position + matrix[:3, 3], matrix[:3, :3] @ self.direction
        intensity = times(self.intensity, scale**2)
        return dataclasses.replace(self, position=position, direction=direction, intensity=intensity)

    def row(self) -> tuple[float, ...]:
        """Row of POINT_LIGHT."""
        return (*self.position, *self.direction, math.cos(self.outer_angle), math.cos(self.inner_angle))
