"""Pinholes: the kernel."""

from __future__ import annotations

from plenoptic.core.jit import kernel
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, L, M, N, X, Y, Z
from plenoptic.optics.microlens.kernels.to_lens import distance_to_sensor, head_for, weigh


@kernel
def fill_pinholes(blocks, sensor, z_plane):
    """Rays from the sensor straight through the centres of the cells in which they were aimed."""
    distance = sensor.distance
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        weigh(ray, distance, sensor.tilt)
        for i in range(BLOCK):
            h = distance_to_sensor(ray, i, distance, sensor.tilt)
            # The point aimed at less what leads there from the sensor is the point on the sensor.
            u = (ray[Z + i] - (ray[X + i] - ray[L + i])) / h
            v = (ray[N + i] - (ray[Y + i] - ray[M + i])) / h
            ray[X + i] = ray[Z + i]
            ray[Y + i] = ray[N + i]
            head_for(ray, i, (u, v), z_plane)
