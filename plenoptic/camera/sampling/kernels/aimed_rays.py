"""Rays that are aimed at points of the array."""

from __future__ import annotations

from plenoptic.core.kernels.ray_blocks import STATUS, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device


@device
def set_aimed_ray(ray, i, piece, point, start, area):
    """Aim path i at a point of a piece, from its cell's centre; `area` is the weight of the sample in mm^2."""
    mx, my = piece.cell_x + point[0], piece.cell_y + point[1]
    ray[X + i] = mx
    ray[Y + i] = my
    ray[L + i] = mx - start[0]
    ray[M + i] = my - start[1]
    ray[Z + i] = piece.axis_x
    ray[N + i] = piece.axis_y
    ray[WEIGHT + i] = area
    ray[STATUS + i] = 0.0


@device
def displaced_point(piece, point, in_pixel):
    """Point of a piece from the centre of its cell, for the point `in_pixel` of a pixel."""
    u, v = in_pixel
    return point[0] + piece.xu * u + piece.xv * v, point[1] + piece.yu * u + piece.yv * v
