"""Directions about shading normals, and rays that leave surfaces: device functions."""

from __future__ import annotations

from plenoptic.core.kernels.vectors import dot, row_vector
from plenoptic.core.numba.jit import device
from plenoptic.scene.geometry.record import NORMAL, OFFSET, POINT


@device
def to_local(direction, frame, normal):
    """A direction of the world along two unit vectors across a normal, and along it."""
    return dot(direction, frame[0]), dot(direction, frame[1]), dot(direction, normal)


@device
def leaving_point(rows, i, beyond):
    """Origin of a ray that leaves a surface, offset to the side given by the sign of `beyond`, its direction along the
    normal.
    """
    off = rows[i, OFFSET] if beyond > 0.0 else -rows[i, OFFSET]
    p, n = row_vector(rows, i, POINT), row_vector(rows, i, NORMAL)
    return p[0] + off * n[0], p[1] + off * n[1], p[2] + off * n[2]
