"""Points in front of a lens and behind it, at infinity too: their fields and directions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from plenoptic.core.values import Floats, frozen_array, number, numbers
from plenoptic.errors import InvalidValueError

if TYPE_CHECKING:
    from plenoptic.optics.lens.stack import LensStack


def angles_of(direction: Floats, sign: float) -> Floats:
    """Angle coordinates (n, 2) of directions (n, 3)."""
    across = np.hypot(direction[:, 0], direction[:, 1])
    theta = np.arctan2(across, sign * direction[:, 2])
    with np.errstate(invalid="ignore", divide="ignore"):
        stretch = np.where(across > 0, theta / across, 1.0)
    return np.asarray(direction[:, :2] * stretch[:, None])


def directions_of(angles: Floats, sign: float) -> Floats:
    """Unit vectors (n, 3) of angle coordinates (n, 2)."""
    theta = np.sqrt(angles[:, 0] ** 2 + angles[:, 1] ** 2)
    with np.errstate(invalid="ignore", divide="ignore"):
        shrink = np.where(theta > 0, np.sin(theta) / theta, 1.0)
    directions = np.empty((len(angles), 3))
    directions[:, :2] = angles * shrink[:, None]
    directions[:, 2] = sign * np.cos(theta)
    return directions


def field_text(field: Sequence[float] | Floats, z_object: float) -> str:
    """An object point with its unit."""
    x, y = field
    return f"({x + 0.0:g}, {y + 0.0:g}) {'rad' if math.isinf(z_object) else 'mm'}"


def checked_pair(values: float | Sequence[float] | Floats, name: str) -> Floats:
    """Two finite numbers (2,), the first one 0 if only one is given, or an error that names them."""
    array = numbers(values, name)
    pair = frozen_array(np.array([0.0, array]) if array.ndim == 0 else array, name=name, shape=(2,))
    if not np.isfinite(pair).all():
        raise InvalidValueError(f"{name} is {pair.tolist()}; it must be two finite numbers")
    return pair


def checked_aim(lens: LensStack, pair: Floats, z: float, *, scene: bool) -> Floats:
    """Target point of the rays, as in `Half.aim`."""
    name, sign = ("z_object", -1.0) if scene else ("z_image", 1.0)
    z_target = number(z, name)
    if z_target == sign * math.inf:
        if not math.hypot(*pair) < math.pi:
            subject = "field" if scene else "image_point"
            raise InvalidValueError(f"{subject} {pair.tolist()} is not below pi; give radians")
        return pair
    end = float(lens.vertices[0 if scene else -1])
    if not (math.isfinite(z_target) and sign * (z_target - end) > 0):
        side = "before the first element, below" if scene else "behind the last element, above"
        raise InvalidValueError(f"{name} is {z_target:g} mm; it must lie {side} {end:g}, or be {sign * math.inf:g}")
    return np.array([*pair, z_target])
