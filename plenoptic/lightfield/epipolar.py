"""Disparity between views, by the slopes of epipolar lines, and depth from it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.model_pupil import model_pupil
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.object_planes import lens_front_z
from plenoptic.lightfield.pinhole_model import object_z, planes_before_lens
from plenoptic.lightfield.plane_sweep import Images, Pairs, Sweep, extrapolate_border, plane_sweep, texture_floor
from plenoptic.lightfield.views import LightField

_MOST = 24
"""Views with which the central one is compared, less than twice as many, of those in four directions from it."""
_APART = 1.0
"""Pixels by which neighbouring planes move the farthest view."""
_MOST_PLANES = 512
_USUAL, _PART = 2.0, 0.5
"""Disparities that are looked for, in pixels, and by which part of its size a view moves then at most."""
_ERRORS = 2.0
"""Errors found over what independent residuals give: pixels of views are interpolated, and share their noise."""
_TRIED = 24
"""Distances behind the array at which a plane is looked for in front of the lens, up to a part of it."""
_REACH = 0.1


def default_range(field: LightField) -> tuple[float, float]:
    """Disparities that are looked for: up to 2 pixels, less where views would move by half of their size."""
    _, offsets = _in_four_directions(field)
    farthest = min(_USUAL, _PART * min(field.views.shape[2:4]) / float(np.abs(offsets).max()))
    return -farthest, farthest


def view_disparities(field: LightField, between: tuple[float, float], radius: int) -> tuple[Floats, Floats, Floats]:
    """Disparity of the central view, its standard error, and the share of views that show it, (rows, columns)."""
    chosen, offsets = _in_four_directions(field)
    low, high = between
    count = 2 + math.ceil((high - low) * float(np.hypot(*offsets.T).max()) / _APART)
    if count > _MOST_PLANES:
        raise InvalidValueError(
            f"between is {between}: {count} planes to compare; narrow it to what the scene has, {_MOST_PLANES} at most"
        )
    planes = np.linspace(low, high, count)
    sweep = Sweep(
        disparities=planes,
        radius=radius,
        compared=len(chosen),
        farthest=math.inf,
        reach=0.0,
        least_reach=float(planes[1] - planes[0]),
    )
    centre = (len(field.u) // 2, len(field.v) // 2)
    images = _pictures(field, np.vstack([centre, chosen]))
    count = len(chosen)
    pairs = Pairs(np.array([0, count]), np.arange(1, count + 1), np.zeros((count, 2)), offsets)
    disparity, error, share = (part[0] for part in plane_sweep(images, pairs, sweep, 1))
    known = np.isfinite(error) & np.isfinite(disparity)
    nothing = np.where(known, 0.0, np.nan)
    return disparity + nothing, _ERRORS * error + nothing, share + nothing


def _in_four_directions(field: LightField) -> tuple[NDArray[np.int64], Floats]:
    """Numbers (n, 2) of views along u, v and both diagonals, and how a point moves there at disparity 1, in pixels."""
    there = np.asarray(np.isfinite(field.views).any(axis=(2, 3, 4)))
    u, v = (np.arange(len(part)) - len(part) // 2 for part in (field.u, field.v))
    right, down = np.meshgrid(u, v, indexing="ij")
    straight = (right == 0) | (down == 0) | (np.abs(right) == np.abs(down))
    numbers = np.argwhere(there & straight & ((right != 0) | (down != 0)))
    if not len(numbers) or not there[len(u) // 2, len(v) // 2]:
        raise InvalidValueError("the light field has no views beside its central one; decode more of them")
    apart = [part - part[len(part) // 2] for part in (field.u, field.v)]
    offsets = np.column_stack([apart[1][numbers[:, 1]] * down_over_across(field), apart[0][numbers[:, 0]]])
    # An odd step keeps all directions.
    step = 2 * (len(numbers) // (2 * _MOST)) + 1
    order = np.argsort(np.hypot(*offsets.T), kind="stable")[::step]
    return numbers[order], offsets[order]


def down_over_across(field: LightField) -> float:
    """Disparity along rows for a pixel of v, over that along columns for a pixel of u; 1 where it is not known."""
    if field.camera is not None:
        return field.spacing[0] / field.spacing[1]
    across, down = _between_cameras(field)
    return down / across if np.isfinite(down / across) else 1.0


def _between_cameras(field: LightField) -> tuple[float, float]:
    """Steps of the cameras over the pixels in the plane in focus, along columns and rows; nan where not known."""
    u, v = len(field.u) // 2, len(field.v) // 2
    across = field.exit_pupil[u, v, 0] - field.exit_pupil[u - 1, v, 0] if u else math.nan
    down = field.exit_pupil[u, v - 1, 1] - field.exit_pupil[u, v, 1] if v else math.nan
    return float(across) / field.object_spacing[0], float(down) / field.object_spacing[1]


def _pictures(field: LightField, numbers: NDArray[np.int64]) -> Images:
    """The views of some numbers (n, 2), the mean over channels."""
    values = np.stack([field.views[u, v] for u, v in numbers]).mean(axis=-1, dtype=np.float64)
    known = np.isfinite(values)
    variance = np.zeros_like(values)
    if field.standard_error is not None:
        error = np.stack([field.standard_error[u, v] for u, v in numbers]).astype(np.float64)
        variance = np.nan_to_num((error**2).mean(axis=-1) / error.shape[-1], nan=0.0, posinf=0.0)
    return Images(extrapolate_border(values, known), known.astype(np.uint8), texture_floor(values, variance, known))


def view_depths(field: LightField, disparity: Floats) -> Floats:
    """-z in the camera's frame, mm, where `disparity_at` is the disparity; nan where it is not known."""
    camera = field.camera
    if camera is None:
        with np.errstate(divide="ignore", invalid="ignore"):
            across, down = _between_cameras(field)
            # Of a single column of views, disparity is that along rows.
            z = field.z_focus / (1.0 + disparity / (down if math.isnan(across) else across))
        return np.asarray(np.where(z < 0, -z, np.nan))
    lever = disparity * field.spacing[0] * camera.microlenses_to_sensor / camera.sensor.pixel_pitch
    gap = camera.stop_to_microlenses - model_pupil(camera)[0]
    # disparity_at has e D / (D + e) for the distance e of an image behind the array, with the pupil D before it.
    behind = lever / (1.0 - lever / gap)
    planes = planes_before_lens(camera, _REACH * camera.stop_to_microlenses * np.linspace(-1.0, 1.0, _TRIED))
    if len(planes) < 2:
        return np.full(disparity.shape, np.nan)
    z = object_z((planes[0], planes[-1]), behind)
    return np.asarray(np.where(z < lens_front_z(camera), -z, np.nan))
