"""Rotation matrices."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import Floats, frozen_array, radians
from plenoptic.errors import InvalidValueError

_DEFECT = 1e-9


def rotation_matrix(matrix: ArrayLike, *, remedy: str, name: str = "rotation") -> Floats:
    """(3, 3), read-only, or an error if the matrix is not right-handed and orthonormal to 1e-9."""
    array = frozen_array(matrix, name=name, shape=(3, 3))
    with np.errstate(all="ignore"):
        defect = float(np.abs(array @ array.T - np.eye(3)).max())
    if not defect <= _DEFECT or np.linalg.det(array) < 0:
        raise InvalidValueError(
            f"{name} is not a right-handed orthonormal matrix (defect {defect:.3g}, limit {_DEFECT:g}); {remedy}"
        )
    return array


def rotation_about(axis: ArrayLike, angle: float) -> Floats:
    """(3, 3) rotation about an axis of any length by radians, counter-clockwise seen from the tip of the axis."""
    direction = frozen_array(axis, name="axis", shape=(3,))
    length = float(np.linalg.norm(direction))
    if not 0 < length < np.inf:
        raise InvalidValueError(f"axis {direction.tolist()} has length {length:g}; it must be finite and above 0")
    x, y, z = direction / length
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    theta = radians(angle, "angle")
    # Rodrigues' formula; 1 - cos as a square keeps the digits of small angles.
    return np.asarray(np.eye(3) + math.sin(theta) * cross + 2 * math.sin(theta / 2) ** 2 * (cross @ cross))
