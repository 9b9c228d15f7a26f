"""Local frames about shading normals, and origins of rays that leave surfaces: device functions."""

from __future__ import annotations

from plenoptic.core.kernels.vectors import dot, row_vector
from plenoptic.core.numba.jit import device
from plenoptic.scene.geometry.geometry_records import NORMAL, OFFSET, POINT


@device
def to_local(direction, frame, normal):
    """Components of a world direction along two tangents and the normal."""
    return dot(direction, frame[0]), dot(direction, frame[1]), dot(direction, normal)


@device
def leaving_point(rows, i, cosine):
    """Origin of a ray that leaves a surface: offset to the side of the sign of its normal component `cosine`."""
    offset = rows[i, OFFSET] if cosine > 0.0 else -rows[i, OFFSET]
    p, n = row_vector(rows, i, POINT), row_vector(rows, i, NORMAL)
    return p[0] + offset * n[0], p[1] + offset * n[1], p[2] + offset * n[2]
