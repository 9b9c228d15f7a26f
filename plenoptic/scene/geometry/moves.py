"""Moves in space: methods that follow from `transformed` and `rotated`, and moves of a whole scene."""

from __future__ import annotations

import math
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.motions.rotation import rotation_about
from plenoptic.core.values import Floats, finite, frozen_array, positive
from plenoptic.errors import SceneError

_ROUNDING = 1e-9


class _Movable(Protocol):
    def transformed(self: M, matrix: ArrayLike) -> M: ...


class _Turning(Protocol):
    def rotated(self: T, axis: ArrayLike, angle: float) -> T: ...


M = TypeVar("M", bound=_Movable)
T = TypeVar("T", bound=_Turning)


def translated(self: M, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> M:
    """The same, shifted by (x, y, z) mm.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.box(2).translated(z=-404).bounds[:, 2].tolist()
    [-405.0, -403.0]
    """
    matrix = np.eye(4)
    matrix[:3, 3] = finite(x, "x"), finite(y, "y"), finite(z, "z")
    return self.transformed(matrix)


def rotated(self: M, axis: ArrayLike, angle: float) -> M:
    """The same, turned about an axis through the origin of the world.

    Parameters
    ----------
    axis : (3,) array
        Direction of the axis, of any length above 0.
    angle : float
        Radians, counter-clockwise as seen by one whom the axis points at.

    Raises
    ------
    InvalidValueError
        An axis without length, an angle that is not finite.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> pl.box((4, 2, 1)).rotated((0, 0, 1), np.pi / 2).bounds[1].round(12).tolist()
    [1.0, 2.0, 0.5]
    """
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_about(axis, angle)
    return self.transformed(matrix)


def rotated_deg(self: T, axis: ArrayLike, angle_deg: float) -> T:
    """Rotate as `rotated` does, by an angle in degrees.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.box((4, 2, 1)).rotated_deg((0, 0, 1), 90).bounds[1].round(12).tolist()
    [1.0, 2.0, 0.5]
    """
    return self.rotated(axis, math.radians(math.fmod(finite(angle_deg, "angle_deg"), 360)))


def scaled(self: M, factor: float) -> M:
    """The same, enlarged about the origin of the world by a factor above 0, and distances with it.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.box(2).scaled(0.5).bounds[1].tolist()
    [0.5, 0.5, 0.5]
    """
    return self.transformed(np.diag([*3 * (positive(factor, "factor"),), 1.0]))


def similarity(matrix: ArrayLike) -> tuple[Floats, float]:
    """(4, 4) matrix and its scale, where it turns, shifts and scales equally in all directions; an error otherwise."""
    full = frozen_array(matrix, name="matrix", shape=(4, 4))
    linear = full[:3, :3]
    scale = float(np.linalg.norm(linear)) / math.sqrt(3)
    even = np.isfinite(full).all() and scale > 0 and full[3].tolist() == [0.0, 0.0, 0.0, 1.0]
    if not even or np.abs(linear @ linear.T - scale**2 * np.eye(3)).max() > _ROUNDING * scale**2:
        raise SceneError(
            f"matrix is {full.tolist()}; for a scene with lights or views it must turn, shift and scale equally in all "
            "directions, so that light stays what it is"
        )
    if np.linalg.det(linear) < 0:
        raise SceneError(
            f"matrix {linear.tolist()} mirrors; a scene with lights or views can be turned and scaled only"
        )
    return full, scale
