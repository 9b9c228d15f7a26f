"""Hit points of rays in the scene: depth, distance from the camera and position in the world."""

from __future__ import annotations

import math

from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, L, M, N, X, Y, Z
from plenoptic.core.kernels.vectors import cross, dot, vector
from plenoptic.core.numba.jit import device, kernel


@kernel
def fill_hit_points(points, blocks, pixels, distances):
    """Fill the points (n, 3) of traced rays at `distances` along them, in the lens's axes; others are unchanged."""
    for i in range(pixels.size):
        p = pixels[i]
        base = (p // BLOCK) * RAY + p % BLOCK
        points[p, 0] = blocks[base + X] + distances[i] * blocks[base + L]
        points[p, 1] = blocks[base + Y] + distances[i] * blocks[base + M]
        points[p, 2] = blocks[base + Z] + distances[i] * blocks[base + N]


@device
def _in_camera(x, y, z, frame):
    if frame is None:
        return x, y, z
    return (
        frame[0] * x + frame[1] * y + frame[2] * z + frame[9],
        frame[3] * x + frame[4] * y + frame[5] * z + frame[10],
        frame[6] * x + frame[7] * y + frame[8] * z + frame[11],
    )


@kernel
def fill_depth(depths, hit):
    """Fill the depths, -z in the camera's frame, mm."""
    points = hit.points
    for p in hit.pixels:
        _, _, z = _in_camera(points[p, 0], points[p, 1], points[p, 2], hit.frame)
        depths[p] = -z


@kernel
def fill_distance(distances, hit):
    """Fill the distances from the camera's origin, mm."""
    points = hit.points
    for p in hit.pixels:
        x, y, z = _in_camera(points[p, 0], points[p, 1], points[p, 2], hit.frame)
        distances[p] = math.sqrt(x * x + y * y + z * z)


@kernel
def fill_position(positions, hit):
    """Fill the positions in the world, mm."""
    points = hit.points
    for p in hit.pixels:
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        for axis in range(3):
            if hit.rotation is None:
                positions[p, axis] = points[p, axis]
            else:
                positions[p, axis] = (
                    hit.rotation[axis, 0] * x
                    + hit.rotation[axis, 1] * y
                    + hit.rotation[axis, 2] * z
                    + hit.position[axis]
                )


@kernel
def fill_incidence_angle(angles, sensor):
    """Fill the angles between rays and the sensor's normal in radians; by the tangent, exact for small angles."""
    normal = vector(sensor.normal, 0)
    for p in sensor.pixels:
        ray = vector(sensor.directions[p], 0)
        across = cross(ray, normal)
        angles[p] = math.atan2(math.sqrt(dot(across, across)), dot(ray, normal))
