"""From the frames of instanced meshes to the world: device functions.

The rows of `Geometry.instance_to_world` begin with the 12 numbers of a 3 x 4 matrix, row by row.
"""

from __future__ import annotations

import math

from plenoptic.core.jit import device
from plenoptic.scene.geometry.record import INSTANCE_DISTANCE


@device
def transform_point(m, p):
    """A point through a matrix."""
    return (
        m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3],
        m[4] * p[0] + m[5] * p[1] + m[6] * p[2] + m[7],
        m[8] * p[0] + m[9] * p[1] + m[10] * p[2] + m[11],
    )


@device
def transform_normal(m, n):
    """A normal by the cofactors of the 3 x 3 part of a matrix, at unit length; zeros stay."""
    x, y, z = n
    a = (m[5] * m[10] - m[6] * m[9]) * x + (m[6] * m[8] - m[4] * m[10]) * y + (m[4] * m[9] - m[5] * m[8]) * z
    b = (m[2] * m[9] - m[1] * m[10]) * x + (m[0] * m[10] - m[2] * m[8]) * y + (m[1] * m[8] - m[0] * m[9]) * z
    c = (m[1] * m[6] - m[2] * m[5]) * x + (m[2] * m[4] - m[0] * m[6]) * y + (m[0] * m[5] - m[1] * m[4]) * z
    length = math.sqrt(a * a + b * b + c * c)
    if not length > 0.0:
        return 0.0, 0.0, 0.0
    return a / length, b / length, c / length


@device
def is_mirrored(instance_to_world, instance):
    """Whether corners that run counter-clockwise in the frame of the mesh run clockwise in the world."""
    if instance_to_world is not None:
        if instance >= 0:
            m = instance_to_world[instance]
            x = m[5] * m[10] - m[6] * m[9]
            y = m[6] * m[8] - m[4] * m[10]
            z = m[4] * m[9] - m[5] * m[8]
            return m[0] * x + m[1] * y + m[2] * z < 0.0
    return False


@device
def instance_distance(instance_to_world, instance):
    """How far the middle of an instance's mesh is from that of the scene, see `ray_offset`; -1 for plain triangles."""
    if instance_to_world is not None:
        if instance >= 0:
            return instance_to_world[instance, INSTANCE_DISTANCE]
    return -1.0
