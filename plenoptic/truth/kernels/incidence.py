"""Angle of incidence of a pixel's ray on the sensor."""

from __future__ import annotations

import math

from plenoptic.core.kernels.vectors import cross, dot, vector
from plenoptic.core.numba.jit import kernel


@kernel
def fill_incidence_angle(angles, sensor):
    """Fill the angles between rays and the sensor's normal in radians; by the tangent, exact for small angles."""
    normal = vector(sensor.normal, 0)
    for p in sensor.pixels:
        ray = vector(sensor.directions[p], 0)
        across = cross(ray, normal)
        angles[p] = math.atan2(math.sqrt(dot(across, across)), dot(ray, normal))
