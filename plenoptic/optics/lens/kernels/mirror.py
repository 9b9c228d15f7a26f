"""Kernels: normals of surfaces at intersections, and reflection of rays there."""

from __future__ import annotations

from plenoptic.core.kernels.ray_blocks import BLOCK, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device
from plenoptic.optics.element_record import ASPHERE, FREEFORM
from plenoptic.optics.lens.kernels.first_crossing import height
from plenoptic.optics.lens.kernels.freeform import freeform_at


@device
def normal_at(x, y, z, lens, k):
    """Normal of any length at a point of the surface in row k, whose vertex is the origin.

    The normal of a conic is the gradient of its implicit equation, which holds beyond the equator too.
    """
    row = lens.rows[k]
    c, kz = row.curvature, 1.0 if lens.conic is None else 1.0 + lens.conic[k]
    nx, ny, nz = -c * x, -c * y, 1.0 - c * kz * z
    if lens.aspheric is not None:
        if row.kind == ASPHERE:
            _, bend = height(x * x + y * y, (c, kz), lens.aspheric[k])
            nx, ny, nz = -2.0 * bend * x, -2.0 * bend * y, 1.0
        if lens.freeform is not None:  # noqa: SIM102 - nested for compile-time pruning
            if row.kind == FREEFORM:
                _, dx, dy = freeform_at(x, y, (c, kz), lens.aspheric[k], lens.freeform[k])
                nx, ny, nz = -dx, -dy, 1.0
    return nx, ny, nz


@device
def reflect(ray, lens, k):
    """Reflect rays at the surface in row k, whose vertex is the origin: d - 2 (d . n) n / n^2, with n of any length."""
    for i in range(BLOCK):
        l, m, n = ray[L + i], ray[M + i], ray[N + i]
        nx, ny, nz = normal_at(ray[X + i], ray[Y + i], ray[Z + i], lens, k)
        twice = 2.0 * (nx * l + ny * m + nz * n) / (nx * nx + ny * ny + nz * nz)
        ray[L + i] = l - twice * nx
        ray[M + i] = m - twice * ny
        ray[N + i] = n - twice * nz
