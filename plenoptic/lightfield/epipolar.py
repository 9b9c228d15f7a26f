"""Disparity between views from the slopes of epipolar lines, and depth from disparity."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import array_axes
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.matching.consensus import limit_beside_edges, window_statistics
from plenoptic.lightfield.matching.image_stack import (
    MIN_MARGIN,
    ImageStack,
    Matches,
    noise_variance,
    spline_coefficients,
    with_margin,
)
from plenoptic.lightfield.matching.match import Matcher, match_stack
from plenoptic.lightfield.pinhole_model import depths_on_rays, lens_front_z
from plenoptic.lightfield.view_model import Moebius, ViewModel
from plenoptic.lightfield.views import LightField

_MAX_VIEWS = 24
"""Views with which the central one is compared, fewer than twice as many, along four directions from it."""
_MIN_LIGHT = 0.997
"""Light of a view through its own microlenses, over that of the best one, from which on it is compared: light through
others shows points many pixels away."""
_SHIFT_STEP = 1.0
"""Shift of the farthest view between neighbouring planes, in pixels."""
_MAX_PLANES = 512
_USUAL_DISPARITY, _MAX_SHIFT_FRACTION = 2.0, 0.5
"""Default search range of disparity in pixels, and the largest shift of a view as a fraction of its size."""


def default_range(field: LightField) -> tuple[float, float]:
    """Default disparities to search: up to 2 pixels, or less if views would move by half of their size."""
    _, offsets = _in_four_directions(field)
    farthest = min(_USUAL_DISPARITY, _MAX_SHIFT_FRACTION * min(field.views.shape[2:4]) / float(np.abs(offsets).max()))
    return -farthest, farthest


def match_views(field: LightField, bounds: tuple[float, float], radius: int, matcher: Matcher) -> Matches:
    """Disparity of the central view, its standard error, and the fraction of views that agree, (rows, columns)."""
    indices, offsets = _in_four_directions(field)
    low, high = bounds
    count = 2 + math.ceil((high - low) * float(np.hypot(*offsets.T).max()) / _SHIFT_STEP)
    if count > _MAX_PLANES:
        raise InvalidValueError(
            f"disparity_range is {bounds}: {count} planes to compare; narrow it to the disparities of the scene, "
            f"{_MAX_PLANES} planes at most"
        )
    planes, count = np.linspace(low, high, count), len(indices)
    values, valid, noise = _channel_means(field, np.vstack([(len(field.u) // 2, len(field.v) // 2), indices]))
    stack = ImageStack(
        np.where(valid, values, 0.0).astype(np.float32),
        _interpolation_mask(valid).astype(np.uint8),
        noise,
        first=np.array([0, count]),
        other=np.arange(1, count + 1),
        base=np.zeros((count, 2)),
        step=offsets,
        disparities=planes,
        window_radius=radius,
        max_compared=count,
        max_shift=math.inf,
        reach=(0.0, float(planes[1] - planes[0])),
        coefficients=spline_coefficients(values, valid),
    )
    if field.camera is not None:
        stack = _with_displacement(stack, field.model, indices)
    margin = max(MIN_MARGIN, radius)
    inner = np.s_[0, margin:-margin, margin:-margin]
    matches = Matches(*(plane[inner] for plane in match_stack(with_margin(stack, margin), matcher, 1)))
    valid = np.isfinite(matches.standard_error) & np.isfinite(matches.disparity)
    disparity, error, confidence = (np.where(valid, plane, np.nan) for plane in matches)
    owner = np.zeros(valid.shape, dtype=np.int64)
    _, farthest = window_statistics(-disparity, error, owner, radius)
    at_edge = farthest > stack.reach[1] - disparity
    return Matches(disparity, error, limit_beside_edges(confidence, at_edge))


def _with_displacement(stack: ImageStack, model: ViewModel, indices: NDArray[np.int64]) -> ImageStack:
    """The stack with the displacement of its views: near the axis as part of shifts and steps."""
    central, *others = (
        model.displacement(u, v) for u, v in [(len(model.step) // 2, model.step.shape[1] // 2), *indices]
    )
    displacement = np.stack([central, *others])
    change = displacement[:, model.axis[0], model.axis[1]] - central[model.axis]
    return stack._replace(
        base=stack.base + change[1:, 0],
        step=stack.step - change[1:, 1],
        residual_displacement=(displacement - change[:, None, None]).astype(np.float32),
    )


def _in_four_directions(field: LightField) -> tuple[NDArray[np.int64], Floats]:
    """Indices (n, 2) of views along u, v and both diagonals, and a point's shift (n, 2) at disparity 1, in pixels."""
    lit = np.asarray(np.isfinite(field.views).any(axis=(2, 3, 4)))
    if field.camera is not None:
        lit &= field.model.light > _MIN_LIGHT * field.model.light.max()
    u, v = (np.arange(len(offset)) - len(offset) // 2 for offset in (field.u, field.v))
    right, down = np.meshgrid(u, v, indexing="ij")
    straight = (right == 0) | (down == 0) | (np.abs(right) == np.abs(down))
    indices = np.argwhere(lit & straight & ((right != 0) | (down != 0)))
    if not len(indices) or not lit[len(u) // 2, len(v) // 2]:
        raise InvalidValueError("the light field has no views other than its central one; decode more of them")
    distances = [offset - offset[len(offset) // 2] for offset in (field.u, field.v)]
    offsets = np.column_stack([distances[1][indices[:, 1]] * down_over_across(field), distances[0][indices[:, 0]]])
    # An odd step keeps all directions.
    step = 2 * (len(indices) // (2 * _MAX_VIEWS)) + 1
    order = np.argsort(np.hypot(*offsets.T), kind="stable")[::step]
    return indices[order], offsets[order]


def down_over_across(field: LightField) -> float:
    """Ratio of the disparity along rows per pixel of v to that along columns per pixel of u; 1 if unknown."""
    ratio = field.spacing[0] / field.spacing[1]
    if math.isnan(ratio):
        across, down = _between_cameras(field)
        ratio = down / across
    return ratio if math.isfinite(ratio) else 1.0


def _between_cameras(field: LightField) -> tuple[float, float]:
    """Camera steps in pixels of the plane in focus, along columns and rows; nan if unknown."""
    u, v = len(field.u) // 2, len(field.v) // 2
    across = field.exit_pupil[u, v, 0] - field.exit_pupil[u - 1, v, 0] if u else math.nan
    down = field.exit_pupil[u, v - 1, 1] - field.exit_pupil[u, v, 1] if v else math.nan
    return float(across) / field.object_spacing[0], float(down) / field.object_spacing[1]


def _channel_means(field: LightField, indices: NDArray[np.int64]) -> tuple[Floats, NDArray[np.bool_], Floats]:
    """The views with given indices (n, 2), averaged over channels, where they are valid, and `noise_variance`."""
    values = np.stack([field.views[u, v] for u, v in indices]).mean(axis=-1, dtype=np.float64)
    valid = np.isfinite(values)
    variance = np.zeros_like(values)
    noise = field.standard_error if field.noise is None else field.noise[:, :, None, None, None]
    if noise is not None:
        error = np.stack([noise[u, v] for u, v in indices]).astype(np.float64)
        # Channels share their paths, and with them their errors.
        variance = variance + np.nan_to_num(error.mean(axis=-1) ** 2, nan=0.0, posinf=0.0)
    return values, valid, noise_variance(values, variance, valid)


def _interpolation_mask(valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Pixels of the central view, and of others (n, rows, columns) those in the middle of nine valid ones.

    Interpolation takes sixteen pixels, and those beyond the border are not known.
    """
    padded = np.pad(valid[1:], ((0, 0), (1, 1), (1, 1)))
    inner = np.lib.stride_tricks.sliding_window_view(padded, (3, 3), axis=(1, 2)).all(axis=(3, 4))
    return np.concatenate([valid[:1], inner])


def view_depths(field: LightField, disparity: Floats) -> Floats:
    """Depth -z in the camera's frame in mm at which `disparity_at` equals the disparity; nan if unknown."""
    if field.camera is None:
        with np.errstate(divide="ignore", invalid="ignore"):
            across, down = _between_cameras(field)
            # The disparity of a single column of views is measured along rows.
            z = field.z_focus / (1.0 + disparity / (down if math.isnan(across) else across))
        return np.asarray(np.where(z < 0, -z, np.nan))
    near_axis = Moebius(*(plane[field.model.axis] for plane in field.model.traced_disparity(1)))
    z = field.model.object_z(near_axis.inverse(disparity))
    return np.asarray(np.where(z < lens_front_z(field.camera), -z, np.nan))


def depth_of_matches(field: LightField, matches: Matches) -> tuple[Matches, Floats]:
    """Matches with traced disparities, see `DepthMap.disparity`, and depth (rows, columns)."""
    camera = field.camera
    if camera is None or camera.microlenses is None:
        return matches, view_depths(field, matches.disparity)
    traced, d = field.model.traced_disparity(1), matches.disparity
    z = field.model.object_z(d)
    on_array, pixel = field.on_array.reshape(-1, 2), field.pixel.reshape(-1, 2)
    depth = depths_on_rays(array_axes(camera), camera.microlenses, pixel, on_array, z.ravel(), 1).reshape(z.shape)
    per_disparity = (traced.b * traced.f + traced.a * traced.g) / (traced.f - traced.g * d) ** 2
    error = np.abs(per_disparity) * matches.standard_error
    return matches._replace(disparity=traced.of(d), standard_error=error), depth
