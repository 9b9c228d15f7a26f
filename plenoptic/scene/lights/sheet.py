"""Light sheets, which light particles."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import Floats, Given, checked_field, finite, length_in_mm, numbers, value
from plenoptic.errors import InvalidValueError, SceneError
from plenoptic.scene.lights.fields import place_in_mm, unit_vector
from plenoptic.scene.textures.color import Colour, as_colour

_MOST_ALONG = 1e-6
"""Largest cosine between direction and normal of a sheet."""


@value
class Sheet:
    """A sheet of laser light with a Gaussian profile across it, even within its plane.

    At the distance a from its plane and s from its waist along the direction, the irradiance is
    irradiance (w0 / w) exp(-2 a^2 / w^2), with w^2 = w0^2 + (s tan divergence)^2 and w0 = thickness / 2. It lights
    particles (`Points`), and is no light of surfaces.

    Parameters
    ----------
    position : (3,) array
        Point of the waist, in the middle plane, mm.
    direction : (3,) array
        Direction in which the light travels; of any length above 0, kept with length 1.
    normal : (3,) array
        Normal of the middle plane, at right angles to the direction; kept with length 1.
    thickness : float
        Full width at the waist where the irradiance is 1 / e^2 of that in the middle, mm.
    irradiance : float or (float, float, float)
        In the middle of the waist, on a surface that faces the light: radiance in scene units times sr, 0 or more.
    divergence : float
        Half angle of the 1 / e^2 widths far from the waist, in rad, from 0 to below pi/2.

    Raises
    ------
    InvalidValueError
        Of another shape, a thickness or divergence out of range, or numbers that are not finite.
    SceneError
        A position that is not finite, a direction or normal without length, not at right angles, or a negative
        irradiance.

    References
    ----------
    A. E. Siegman, Lasers (1986), section 17.1; the far field of one transverse dimension.

    Examples
    --------
    >>> import plenoptic as pl
    >>> sheet = pl.lights.Sheet((0, 0, -404), (1, 0, 0), (0, 0, 1), thickness=1.0, irradiance=5.0)
    >>> sheet.irradiance_at([(0, 9, -404), (0, 9, -403.5)]).round(3).tolist()
    [5.0, 0.677]
    """

    position: Given[Floats, ArrayLike] = checked_field(place_in_mm)
    direction: Given[Floats, ArrayLike] = checked_field(unit_vector)
    normal: Given[Floats, ArrayLike] = checked_field(unit_vector)
    thickness: float = checked_field(length_in_mm)
    irradiance: Colour = checked_field(as_colour, default=1.0)
    divergence: float = checked_field(finite, default=0.0)

    def __post_init__(self) -> None:
        if not 0 <= self.divergence < math.pi / 2:
            raise InvalidValueError(f"divergence is {self.divergence:g} rad; it must be from 0 to below pi/2")
        if abs(cosine := float(self.direction @ self.normal)) > _MOST_ALONG:
            raise SceneError(
                f"the direction of the sheet and its normal have the cosine {cosine:g}; they must be at right angles"
            )

    def irradiance_at(self, points: ArrayLike) -> Floats:
        """Irradiance (n,), or (n, 3) of a coloured sheet, at points (n, 3) in mm, on a surface that faces the light.

        Examples
        --------
        See `Sheet`.
        """
        offset = numbers(points, "points", columns=3) - self.position
        waist = 0.5 * self.thickness
        width = np.hypot(waist, offset @ self.direction * math.tan(self.divergence))
        profile = waist / width * np.exp(-2.0 * (offset @ self.normal / width) ** 2)
        return np.asarray(np.multiply.outer(profile, np.asarray(self.irradiance)))

    def under(self, matrix: Floats, scale: float) -> Sheet:
        """The sheet where a (4, 4) similarity of that scale puts it; irradiances stay."""
        turn = matrix[:3, :3]
        return dataclasses.replace(
            self,
            position=turn @ self.position + matrix[:3, 3],
            direction=turn @ self.direction,
            normal=turn @ self.normal,
            thickness=scale * self.thickness,
        )
