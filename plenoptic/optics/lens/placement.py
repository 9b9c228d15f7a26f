"""Placement of an element off the axis: decentred, tilted, or both."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import (
    Floats,
    Given,
    coefficients,
    coordinate,
    frozen_array,
    length_in_mm,
    positions,
    radians,
    set_field,
    value,
)
from plenoptic.errors import PrescriptionError

_ORTHONORMAL = 1e-12
"""Largest deviation of a rotation matrix from orthonormality; a product of a hundred rotations stays below it."""

_IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def rotation_about_axis(axis: int, angle: float) -> Floats:
    """Rotation matrix about the axis x (0), y (1) or z (2), by an angle in radians."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[i, i] = turn[j, j] = math.cos(angle)
    turn[j, i], turn[i, j] = math.sin(angle), -math.sin(angle)
    return turn


def rotation_about_axes(tilt: Sequence[float]) -> Floats:
    """Rotation matrix about x by tilt[0], then about y by tilt[1], then about z by tilt[2]; axes fixed, radians.

    Positive angles turn y towards z, z towards x, and x towards y.
    """
    expected = "three angles in radians, about x, y and z"
    angles = coefficients(tilt, "tilt", expected)
    if len(angles) != 3:
        raise PrescriptionError(f"tilt is {tilt!r}; it must be {expected}")
    if not max(abs(angles[0]), abs(angles[1])) < math.pi / 2:
        raise PrescriptionError(
            f"tilt is {tuple(tilt)!r} rad; about x and y it must be below pi / 2, or light arrives at the back of the "
            "element: give radians, such as math.radians(2.0)"
        )
    matrix = np.eye(3)
    for axis, angle in enumerate((*angles[:2], radians(angles[2], "tilt about z"))):
        matrix = rotation_about_axis(axis, angle) @ matrix
    return matrix


@value
class Placement:
    """Shift and rotation of an element relative to its nominal position on the axis; made by `LensStack.moved`.

    A point p of the element, relative to its vertex, lies at shift + rotation @ p from the nominal vertex on the axis.
    An element in its nominal position has no placement (None) and needs no extra time.

    Parameters
    ----------
    shift : (3,) array, optional
        mm.
    rotation : (3, 3) array, optional
        Rotation from the element's axes to the lens's; orthonormal, with determinant 1.

    Raises
    ------
    PrescriptionError
        If `rotation` is not a rotation matrix, or a number is not finite.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.optics.Placement(shift=(0.1, 0.0, 0.0)).shift.tolist()
    [0.1, 0.0, 0.0]
    """

    shift: Given[Floats, ArrayLike] = Given(default=(0.0, 0.0, 0.0))
    rotation: Given[Floats, ArrayLike] = Given(default=_IDENTITY)

    def __post_init__(self) -> None:
        shift = positions(self.shift, name="shift", shape=(3,))
        rotation = frozen_array(self.rotation, name="rotation", shape=(3, 3))
        if not np.isfinite(rotation).all():
            raise PrescriptionError("rotation holds a number that is not finite; correct it")
        deviation = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
        if deviation > _ORTHONORMAL or np.linalg.det(rotation) < 0:
            raise PrescriptionError(
                f"rotation differs from an orthonormal matrix of determinant 1 by {deviation:.1e}; it may differ by "
                f"{_ORTHONORMAL:g}: use lens.moved(..., tilt=...), which makes one from angles"
            )
        set_field(self, "shift", shift)
        set_field(self, "rotation", rotation)

    @property
    def is_identity(self) -> bool:
        """True if the placement is exactly the identity."""
        return bool(np.all(self.shift == 0) and np.array_equal(self.rotation, np.eye(3)))


def to_lens_axes(placement: Placement | None, points: Floats) -> Floats:
    """Points (..., 3) of an element in the axes of the lens, relative to its nominal vertex."""
    return points if placement is None else np.asarray(points @ placement.rotation.T + placement.shift)


def normalised_placement(placement: Placement | None) -> Placement | None:
    """Check a placement; the identity becomes None."""
    if placement is None:
        return None
    if not isinstance(placement, Placement):
        raise PrescriptionError(f"placement is {placement!r}; it must be a Placement or None, see LensStack.moved")
    return None if placement.is_identity else placement


def set_place(element: Any) -> None:
    """Check and set the common fields of all elements: semi-diameter and thickness in mm, and placement."""
    set_field(element, "semi_diameter", length_in_mm(element.semi_diameter, "semi_diameter"))
    set_field(element, "thickness", coordinate(element.thickness, "thickness"))
    set_field(element, "placement", normalised_placement(element.placement))
