"""What surfaces are like where rays meet them: the kernels."""

from __future__ import annotations

import math

from plenoptic._jit import kernel
from plenoptic.scene._hit import meet


@kernel
def fill_normals(normals, lane_of, hits, rays, vertices, triangles):
    """Unit normal of the triangle that each ray meets, towards where the ray comes from; by rows `lane_of`."""
    for i in range(hits.size):
        _, _, _, x, y, z = meet(rays[i], vertices, triangles, hits[i])
        length = math.sqrt(x * x + y * y + z * z)
        if x * rays[i, 3] + y * rays[i, 4] + z * rays[i, 5] > 0.0:
            length = -length
        row = normals[lane_of[i]]
        row[0], row[1], row[2] = x / length, y / length, z / length
