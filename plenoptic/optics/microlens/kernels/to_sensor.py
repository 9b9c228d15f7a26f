"""Rays from the main lens through the microlenses onto the sensor: the kernels for light that travels forwards.

On entry blocks hold rays as `trace` leaves them, in the axes in which the array is traced. On exit X, Y is where a ray
meets the sensor, in the sensor's own axes, Z, N is the lattice index of the microlens that it passed (FREE: number and
0), and L, M are the slopes with which it arrives, in the array's axes.

WEIGHT is etendue, area times projected solid angle. With slopes u, v per length of z and the angle a to the axis, it is
dx dy du dv cos^4 a, whichever axis is taken for z. Free space and true refraction keep it. Ideal thin elements keep
dx dy du dv about their own axis instead, since they only shear the slopes by the height: there the weight is multiplied
by cos^4 after over cos^4 before. It then is the etendue at the sensor, the quantity that a pixel measures, which does
not depend on how the sensor is tilted.
"""

from __future__ import annotations

import numpy as np

from plenoptic.core.kernels.ray_blocks import BLOCK, MISSED, OUTSIDE_MICROLENS, RAY, STATUS, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device, kernel
from plenoptic.optics.lens.kernels.frames import into_frame
from plenoptic.optics.microlens.kernels.cell_lookup import FIRST, PLACE, SECOND, own_lens
from plenoptic.optics.microlens.kernels.dust import in_axes


@device
def to_plane(ray, z):
    """Move rays along themselves to a plane and measure z from there."""
    for i in range(BLOCK):
        t = (z - ray[Z + i]) / ray[N + i]
        ray[X + i] += t * ray[L + i]
        ray[Y + i] += t * ray[M + i]
        ray[Z + i] = 0.0


@device
def land(ray, place, sensor, array):
    """Move rays to the sensor, a `SensorPlane`; keep the indices of their microlenses. Lost rays carry no light.

    Rays are lost that land behind the cell of another microlens than theirs where walls separate these.
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
        if array is not None and array.walls is not None:  # noqa: SIM102 - alone, so that it is pruned
            if ray[STATUS + i] == 0.0:
                first, second, _, _, _, _ = own_lens(x, y, array)
                own = first == place[FIRST + i] and second == place[SECOND + i]
                ray[STATUS + i] = 0.0 if own else OUTSIDE_MICROLENS
        if sensor.axes is not None:
            x, y = in_axes(sensor.axes, x, y)
        ray[X + i] = x
        ray[Y + i] = y
        ray[L + i] = u
        ray[M + i] = v
        ray[Z + i] = place[FIRST + i]
        ray[N + i] = place[SECOND + i]
        ray[WEIGHT + i] = ray[WEIGHT + i] if ray[STATUS + i] == 0.0 else 0.0


@kernel
def fill_aims(aims, blocks, sensor, placed):
    """Rays that have landed, in the form in which the renderer aims samples between sensor and array (see `to_lens`).

    `aims` gets the points where their lines cross the array's rear principal plane, those points minus the points on
    the sensor, and the weights. `placed` (2, 3) leads from x, y, 1 on the sensor to the local axes, None where they are
    the same; the sensor is a `SensorPlane` behind that plane.
    """
    for b in range(blocks.size // RAY):
        ray, aim = blocks[b * RAY : (b + 1) * RAY], aims[b * RAY : (b + 1) * RAY]
        for i in range(BLOCK):
            x, y = ray[X + i], ray[Y + i]
            if placed is not None:
                x, y = in_axes(placed, x, y)
            h = sensor.distance if sensor.tilt is None else sensor.distance + sensor.tilt[0] * x + sensor.tilt[1] * y
            aim[L + i] = -h * ray[L + i]
            aim[M + i] = -h * ray[M + i]
            aim[X + i] = x + aim[L + i]
            aim[Y + i] = y + aim[M + i]
            aim[WEIGHT + i] = ray[WEIGHT + i]


@kernel
def fill_ideal_weights(blocks):
    """Behind an ideal main lens, in its axes: dx dy du dv, which it keeps, becomes etendue."""
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        for i in range(BLOCK):
            cos2 = ray[N + i] * ray[N + i]
            ray[WEIGHT + i] *= cos2 * cos2


@kernel
def fill_in_array_axes(blocks, frame):
    """Rays from the lens's axes to the array's, from which `frame` leads: the rotation row by row and the shift."""
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        into_frame(ray, frame)
        for i in range(BLOCK):
            ray[STATUS + i] = ray[STATUS + i] if ray[STATUS + i] != 0.0 or ray[N + i] > 0.0 else MISSED


@kernel
def fill_straight_forward(blocks, sensor):
    """No microlenses."""
    place = np.zeros(PLACE * BLOCK)
    for b in range(blocks.size // RAY):
        land(blocks[b * RAY : (b + 1) * RAY], place, sensor, None)
