"""Bounds on the directions from which the wells of a pixel get light: kernels."""

from __future__ import annotations

import math

from plenoptic.core.kernels.polygons import cut
from plenoptic.core.numba.jit import device
from plenoptic.optics.microlens.kernels.to_lens import slope_in_stack
from plenoptic.optics.sensor.dual_pixels import INDEX2

_ROUNDING = 1e-6
"""Added to slopes, for rounding and for the curvature of the chief rays' slopes over a group of pixels."""


@device
def _aim_range(start, wells, bounds):
    """Range of aim points along an axis, of light that reaches wells (low, high) from pixels about `start`.

    `start` is the place along this and along the other axis. Light with a slope s inside the stack has the slope
    s sqrt(n^2 + (n^2 - 1) t^2), where t^2 is the squared slope along both axes, from 0 to farthest2.
    """
    record, distance, half, farthest2 = bounds
    inverse, oblique, axial = record.inverse_pupil, math.sqrt(INDEX2 + (INDEX2 - 1.0) * farthest2), math.sqrt(INDEX2)
    low = slope_in_stack(-(start[0] + half) * inverse, start[1] * inverse) + wells[0] / record.depth
    high = slope_in_stack(-(start[0] - half) * inverse, start[1] * inverse) + wells[1] / record.depth
    low, high = low * (oblique if low < 0.0 else axial), high * (oblique if high > 0.0 else axial)
    return start[0] - half + distance * (low - _ROUNDING), start[0] + half + distance * (high + _ROUNDING)


@device
def clip_to_wells(polygon, n, start, bounds):
    """Clip a polygon of aim points to those whose light can reach wells from a group about `start`.

    `bounds` are a `WellsRecord`, the distance of the aim points from the sensor and the half side of the group. Returns
    the number of corners.
    """
    (wells, distance, half), farthest2 = bounds, 0.0
    for q in range(n):
        dx, dy = abs(polygon[0, q] - start[0]) + half, abs(polygon[1, q] - start[1]) + half
        farthest2 = max(farthest2, (dx * dx + dy * dy) / (distance * distance))
    limits, columns, rows = (wells, distance, half, farthest2), wells.columns, wells.rows
    left, right = _aim_range(start, (columns[0, 0], columns[-1, 1]), limits)
    low, high = _aim_range((start[1], start[0]), (-rows[-1, 1], -rows[0, 0]), limits)  # rows run downwards
    n = cut(polygon, 0, n, 1.0, 0.0, right)
    n = cut(polygon, 0, n, -1.0, 0.0, -left)
    n = cut(polygon, 0, n, 0.0, 1.0, high)
    return cut(polygon, 0, n, 0.0, -1.0, -low)
