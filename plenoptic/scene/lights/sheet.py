"""Light sheets."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import Floats, Given, checked_field, finite, length_in_mm, numbers, value
from plenoptic.errors import InvalidValueError, SceneError
from plenoptic.scene.lights.fields import place_in_mm, unit_vector
from plenoptic.scene.textures.color import Colour, as_colour

_MOST_ALONG = 1e-6
"""Largest cosine between direction and normal of a sheet."""
_REACH = math.sqrt(math.log(1e6) / 2)
"""Distance from the middle plane over the half width at which the irradiance is 1e-6 of that in the middle."""


def _start_in_mm(start: Any, name: str) -> float | None:
    return None if start is None else finite(start, name)


@value
class Sheet:
    """A sheet of laser light with a Gaussian profile across it, even within its plane.

    At the distance a from its middle plane and s from its waist along the direction, the irradiance of a surface across
    the direction is irradiance (w0 / w) exp(-2 a^2 / w^2), with w^2 = w0^2 + (s tan divergence)^2 and w0 = thickness /
    2. Rays have the slope a s tan^2(divergence) / w^2 to the plane, with which all planes across the direction get the
    same power. It lights surfaces and media of a scene (`Scene.lights`) and particles (`Points.sheet`); no ray hits it.

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
        With a `start`, that without a medium.
    divergence : float
        Half angle of the 1 / e^2 widths far from the waist, in rad, from 0 to below pi/2.
    start : float, optional
        Plane at which the light begins, mm along the direction from `position`: nothing before it is lit, and a medium
        weakens the light from there on. None: infinitely far.

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
    start: float | None = checked_field(_start_in_mm, default=None)

    def __post_init__(self) -> None:
        if not 0 <= self.divergence < math.pi / 2:
            raise InvalidValueError(f"divergence is {self.divergence:g} rad; it must be from 0 to below pi/2")
        if abs(cosine := float(self.direction @ self.normal)) > _MOST_ALONG:
            raise SceneError(
                f"the direction of the sheet and its normal have the cosine {cosine:g}; they must be at right angles"
            )

    def irradiance_at(self, points: ArrayLike) -> Floats:
        """Irradiance (n,), or (n, 3) of a coloured sheet, at points (n, 3) in mm, on a surface that faces its rays.

        Examples
        --------
        See `Sheet`.
        """
        along, across, width, slope = self._at(points)
        profile = 0.5 * self.thickness / width * np.exp(-2.0 * (across / width) ** 2) * np.hypot(1.0, slope)
        if self.start is not None:
            profile = np.where(along < self.start, 0.0, profile)
        return np.asarray(np.multiply.outer(profile, np.asarray(self.irradiance)))

    def directions_at(self, points: ArrayLike) -> Floats:
        """Unit vectors (n, 3) in which the light travels at points (n, 3) in mm.

        Examples
        --------
        >>> import plenoptic as pl
        >>> sheet = pl.lights.Sheet((0, 0, 0), (1, 0, 0), (0, 0, 1), thickness=0.1, divergence=0.1)
        >>> sheet.directions_at([(100, 0, 0), (100, 0, 10)]).round(4).tolist()
        [[1.0, 0.0, 0.0], [0.995, 0.0, 0.0995]]
        """
        slope = self._at(points)[3]
        rays = self.direction + np.multiply.outer(slope, self.normal)
        return np.asarray(rays / np.hypot(1.0, slope)[..., None])

    def lengths_at(self, points: ArrayLike) -> Floats:
        """Distances (n,) in mm along the rays from the start to points (n, 3), infinite if it is infinitely far.

        Examples
        --------
        >>> import plenoptic as pl
        >>> sheet = pl.lights.Sheet((0, 0, 0), (1, 0, 0), (0, 0, 1), thickness=0.1, start=-50.0)
        >>> sheet.lengths_at([(10, 0, 0)]).tolist()
        [60.0]
        """
        along, _, _, slope = self._at(points)
        return np.asarray((along - (-math.inf if self.start is None else self.start)) * np.hypot(1.0, slope))

    def _at(self, points: ArrayLike) -> tuple[Floats, Floats, Floats, Floats]:
        """Distances (n,) along and across the sheet, its 1 / e^2 half width there in mm, and the slope of its rays."""
        offset = numbers(points, "points", columns=3) - self.position
        along, across, tangent = offset @ self.direction, offset @ self.normal, math.tan(self.divergence)
        width = np.hypot(0.5 * self.thickness, along * tangent)
        return along, across, width, across / width * (along * tangent / width) * tangent

    def reaches(self, box: Floats) -> bool:
        """True if a box (2, 3) in mm has a part behind the start with 1e-6 or more of the irradiance in the middle."""
        corners = np.stack(np.meshgrid(*box.T), axis=-1).reshape(-1, 3)
        along, across, width, _ = self._at(corners)
        gap = max(float(across.min()), -float(across.max()), 0.0)
        return (self.start is None or float(along.max()) >= self.start) and gap <= _REACH * float(width.max())

    def moved(self, matrix: Floats, scale: float) -> Sheet:
        """The sheet where a (4, 4) similarity of that scale puts it; irradiances stay."""
        turn = matrix[:3, :3]
        return dataclasses.replace(
            self,
            position=turn @ self.position + matrix[:3, 3],
            direction=turn @ self.direction,
            normal=turn @ self.normal,
            thickness=scale * self.thickness,
            start=None if self.start is None else scale * self.start,
        )

    def row(self) -> tuple[float, ...]:
        """Row of SHEET_LIGHT."""
        start = -math.inf if self.start is None else self.start
        half_width, tangent = 0.5 * self.thickness, math.tan(self.divergence)
        return (*self.position, *self.direction, *self.normal, half_width, tangent, start)
