"""Local frames about shading normals, and origins of rays that leave surfaces: device functions."""

from __future__ import annotations

from plenoptic.core.kernels.vectors import add, dot, row_vector, scale
from plenoptic.core.numba.jit import device
from plenoptic.scene.geometry.geometry_records import NORMAL, OFFSET, POINT

_GRAZING = 0.125
"""Least cosine at which the origin of a refracted ray lies on the ray."""


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


@device
def refracted_point(rows, i, direction, cosine):
    """Origin of a refracted ray, as `leaving_point`, but on the ray, so that it goes on where Snell's law says.

    Grazing rays, which would begin far along the surface, are offset along its normal.
    """
    if abs(cosine) < _GRAZING:
        return leaving_point(rows, i, cosine)
    return add(row_vector(rows, i, POINT), scale(direction, rows[i, OFFSET] / abs(cosine)))
