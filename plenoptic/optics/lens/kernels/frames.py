"""Kernels: transforms of rays into the axes of a decentred or tilted element, and back."""

from __future__ import annotations

from plenoptic.core.kernels.ray_blocks import BLOCK, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device


@device
def into_frame(ray, frame):
    """Transform rays from the axes of the lens to those of an element; `frame` is a row of `LensRecord.frames`."""
    for i in range(BLOCK):
        x, y, z = ray[X + i] - frame[9], ray[Y + i] - frame[10], ray[Z + i] - frame[11]
        l, m, n = ray[L + i], ray[M + i], ray[N + i]
        ray[X + i] = frame[0] * x + frame[3] * y + frame[6] * z
        ray[Y + i] = frame[1] * x + frame[4] * y + frame[7] * z
        ray[Z + i] = frame[2] * x + frame[5] * y + frame[8] * z
        ray[L + i] = frame[0] * l + frame[3] * m + frame[6] * n
        ray[M + i] = frame[1] * l + frame[4] * m + frame[7] * n
        ray[N + i] = frame[2] * l + frame[5] * m + frame[8] * n


@device
def out_of_frame(ray, frame):
    """Transform rays from the axes of an element to those of the lens."""
    for i in range(BLOCK):
        x, y, z = ray[X + i], ray[Y + i], ray[Z + i]
        l, m, n = ray[L + i], ray[M + i], ray[N + i]
        ray[X + i] = frame[0] * x + frame[1] * y + frame[2] * z + frame[9]
        ray[Y + i] = frame[3] * x + frame[4] * y + frame[5] * z + frame[10]
        ray[Z + i] = frame[6] * x + frame[7] * y + frame[8] * z + frame[11]
        ray[L + i] = frame[0] * l + frame[1] * m + frame[2] * n
        ray[M + i] = frame[3] * l + frame[4] * m + frame[5] * n
        ray[N + i] = frame[6] * l + frame[7] * m + frame[8] * n
