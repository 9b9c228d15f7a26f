"""Whole scenes in other places and sizes: what a turn, a shift and a scale do to all that is in one."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import Floats, frozen_array
from plenoptic.errors import SceneError
from plenoptic.scene.file_cameras import View
from plenoptic.scene.lights.environment import EnvironmentMap

_ROUNDING = 1e-9


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


def placed_view(view: View, matrix: Floats) -> View:
    """A view from another place."""
    turn, shift = matrix[:3, :3], matrix[:3, 3]
    position, look_at = turn @ view.position + shift, turn @ view.look_at + shift
    return dataclasses.replace(view, position=position, look_at=look_at, up=turn @ view.up)


def placed_environment(environment: EnvironmentMap, matrix: Floats, scale: float) -> EnvironmentMap:
    """An environment turned with the scene."""
    turn = matrix[:3, :3] / scale
    # Rotations must be orthonormal to rounding, which a scaled one need not be.
    u, _, v = np.linalg.svd(turn)
    turned = u @ v
    rotation = turned if environment.rotation is None else turned @ environment.rotation
    return dataclasses.replace(environment, rotation=rotation)
