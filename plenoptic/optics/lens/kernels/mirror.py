"""Kernel: reflection of rays at a surface, from their intersections with it."""

from __future__ import annotations

from plenoptic.core.kernels.ray_blocks import BLOCK, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device
from plenoptic.optics.element_record import ASPHERE, FREEFORM
from plenoptic.optics.lens.kernels.first_crossing import height
from plenoptic.optics.lens.kernels.freeform import freeform_at


@device
def reflect(ray, lens, k):
    """Reflect rays at the surface in row k, whose vertex is the origin: d - 2 (d . n) n / n^2, with n of any length.

    The normal of a conic is the gradient of its implicit equation, which holds beyond the equator too.
    """
    row = lens.rows[k]
    c, kz = row.curvature, 1.0 if lens.conic is None else 1.0 + lens.conic[k]
    for i in range(BLOCK):
        x, y = ray[X + i], ray[Y + i]
        l, m, n = ray[L + i], ray[M + i], ray[N + i]
        nx, ny, nz = -c * x, -c * y, 1.0 - c * kz * ray[Z + i]
        if lens.aspheric is not None:
            if row.kind == ASPHERE:
                _, bend = height(x * x + y * y, (c, kz), lens.aspheric[k])
                nx, ny, nz = -2.0 * bend * x, -2.0 * bend * y, 1.0
            if lens.freeform is not None:  # noqa: SIM102 - nested for compile-time pruning
                if row.kind == FREEFORM:
                    _, dx, dy = freeform_at(x, y, (c, kz), lens.aspheric[k], lens.freeform[k])
                    nx, ny, nz = -dx, -dy, 1.0
        twice = 2.0 * (nx * l + ny * m + nz * n) / (nx * nx + ny * ny + nz * nz)
        ray[L + i] = l - twice * nx
        ray[M + i] = m - twice * ny
        ray[N + i] = n - twice * nz
