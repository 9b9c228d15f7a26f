"""Rays from the main lens through the microlenses to the sensor: kernels for light that travels forwards.

On entry blocks hold rays as `trace` leaves them, in the axes in which the array is traced. On exit X, Y is the
intersection with the sensor, in the sensor's own axes, Z, N is the lattice index of the microlens (FREE: number and 0),
and L, M are the slopes at the sensor, in the array's axes.

WEIGHT is etendue, area times projected solid angle. With slopes u, v per length of z and the angle a to the axis, it is
dx dy du dv cos^4 a, whichever axis is taken for z. Free space and true refraction preserve it. Ideal thin elements
preserve dx dy du dv about their own axis instead, since they only shear the slopes by the height. There the weight is
multiplied by the ratio of cos^4 after and before. It then is the etendue at the sensor, which a pixel measures, and
which does not depend on the tilt of the sensor.
"""

from __future__ import annotations

import numpy as np

from plenoptic.core.kernels.ray_blocks import BLOCK, MISSED, OUTSIDE_MICROLENS, RAY, STATUS, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device, kernel
from plenoptic.optics.lens.kernels.frames import into_frame
from plenoptic.optics.microlens.kernels.cell_lookup import INDEX_I, INDEX_J, LENS_ROWS, find_lens
from plenoptic.optics.microlens.kernels.dust_transmission import apply_affine


@device
def to_plane(ray, z):
    """Move rays along themselves to a plane, which becomes the origin of z."""
    for i in range(BLOCK):
        t = (z - ray[Z + i]) / ray[N + i]
        ray[X + i] += t * ray[L + i]
        ray[Y + i] += t * ray[M + i]
        ray[Z + i] = 0.0


@device
def reach_sensor(ray, lens_rows, sensor, array):
    """Move rays to the sensor, a `SensorPlane`, and keep the indices of their microlenses; lost rays have weight 0.

    If walls separate the cells, rays that meet the sensor behind another cell than theirs are lost.
    """
    distance = sensor.distance
    for i in range(BLOCK):
        n = ray[N + i]
        u, v = ray[L + i] / n, ray[M + i] / n
        x, y, t = ray[X + i], ray[Y + i], distance - ray[Z + i]
        if sensor.tilt is not None:
            tilt = sensor.tilt
            towards = 1.0 - tilt[0] * u - tilt[1] * v
            t = (t + tilt[0] * x + tilt[1] * y) / towards
            ray[STATUS + i] = ray[STATUS + i] if ray[STATUS + i] != 0.0 or towards > 0.0 else MISSED
        x, y = x + t * u, y + t * v
        if array is not None and array.walls is not None:  # noqa: SIM102 - nested for compile-time pruning
            if ray[STATUS + i] == 0.0:
                first, second, _, _, _, _ = find_lens(x, y, array)
                same_cell = first == lens_rows[INDEX_I + i] and second == lens_rows[INDEX_J + i]
                ray[STATUS + i] = 0.0 if same_cell else OUTSIDE_MICROLENS
        if sensor.axes is not None:
            x, y = apply_affine(sensor.axes, x, y)
        ray[X + i] = x
        ray[Y + i] = y
        ray[L + i] = u
        ray[M + i] = v
        ray[Z + i] = lens_rows[INDEX_I + i]
        ray[N + i] = lens_rows[INDEX_J + i]
        ray[WEIGHT + i] = ray[WEIGHT + i] if ray[STATUS + i] == 0.0 else 0.0


@kernel
def fill_aims(aims, blocks, sensor, sensor_axes):
    """Convert rays at the sensor to aimed samples between sensor and array (see `to_lens`), as the renderer has them.

    `aims` gets the intersections of their lines with the array's rear principal plane, the offsets of these points from
    the points on the sensor, and the weights. `sensor_axes` (2, 3) transforms x, y, 1 on the sensor to the local axes,
    None if they are the same; the sensor is a `SensorPlane` behind that plane.
    """
    for b in range(blocks.size // RAY):
        ray, aim = blocks[b * RAY : (b + 1) * RAY], aims[b * RAY : (b + 1) * RAY]
        for i in range(BLOCK):
            x, y = ray[X + i], ray[Y + i]
            if sensor_axes is not None:
                x, y = apply_affine(sensor_axes, x, y)
            h = sensor.distance if sensor.tilt is None else sensor.distance + sensor.tilt[0] * x + sensor.tilt[1] * y
            aim[L + i] = -h * ray[L + i]
            aim[M + i] = -h * ray[M + i]
            aim[X + i] = x + aim[L + i]
            aim[Y + i] = y + aim[M + i]
            aim[WEIGHT + i] = ray[WEIGHT + i]


@kernel
def fill_ideal_weights(blocks):
    """Convert weights behind an ideal main lens from dx dy du dv, which it preserves in its axes, to etendue."""
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        for i in range(BLOCK):
            cos2 = ray[N + i] * ray[N + i]
            ray[WEIGHT + i] *= cos2 * cos2


@kernel
def fill_in_array_axes(blocks, frame):
    """Transform rays from the lens's axes to the array's by `frame`, the rotation row by row and the shift."""
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        into_frame(ray, frame)
        for i in range(BLOCK):
            ray[STATUS + i] = ray[STATUS + i] if ray[STATUS + i] != 0.0 or ray[N + i] > 0.0 else MISSED


@kernel
def fill_straight_forward(blocks, sensor):
    """Trace rays to the sensor without microlenses."""
    lens_rows = np.zeros(LENS_ROWS * BLOCK)
    for b in range(blocks.size // RAY):
        reach_sensor(blocks[b * RAY : (b + 1) * RAY], lens_rows, sensor, None)
