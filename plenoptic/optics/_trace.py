"""Rays through a stack of spheres, planes and stops: the kernels.

A bundle lies in memory as blocks of `BLOCK` rays; in a block, the eight fields of a ray (position,
direction, weight, status) are eight rows one behind the other. All rays of a block go through one element
before the next element is looked at: the inner loops have a fixed length, no branch and no calls, so that
the compiler turns them into vector instructions, and a ray's result does not depend on its neighbours.

A status is 0 for a ray that is on its way and otherwise `cause + CAUSES * (element + 1)`; the first
cause stays. A lost ray is carried along as numbers without meaning.
"""

from __future__ import annotations

import math

import numpy as np

from plenoptic._jit import device, kernel

BLOCK = 256
"""Rays in a block. Its 8 rows of 256 float64 are 16 KiB: half a first-level cache."""

X, Y, Z, L, M, N, WEIGHT, STATUS = (row * BLOCK for row in range(8))
RAY = 8 * BLOCK
"""Length of a block in float64."""

EQUATOR_TOLERANCE = 1e-12
"""A rim that is the equator itself belongs to the surface."""

CAUSES = 8
MISSED, CLIPPED, TOTAL_REFLECTION, NOT_FINITE, OUTSIDE_MICROLENS = 1.0, 2.0, 3.0, 4.0, 5.0

SURFACE, CIRCLE, POLYGON = 0, 1, 2


@device
def _enter(ray, z_first):
    """Move rays to the point closest to the lens origin, then measure z from the first vertex."""
    for i in range(BLOCK):
        x, y, z = ray[X + i], ray[Y + i], ray[Z + i]
        l, m, n = ray[L + i], ray[M + i], ray[N + i]
        e = -(x * l + y * m + z * n)
        ray[X + i] = x + e * l
        ray[Y + i] = y + e * m
        ray[Z + i] = (z + e * n) - z_first


@device
def refract_block(ray, c, mu, clear, s, code):
    """Through one sphere or plane of curvature c, whose vertex is the origin of the rays' z.

    Closest-approach form: with the ray's point nearest to the vertex as its start, F and G suffer no
    cancellation on flat surfaces, tiny radii or distant origins. `s` is the direction of travel along
    the stack, `mu` the ratio of indices, `clear` the squared semi-diameter: a surface that has one is the part of the
    sphere on the vertex's side of the equator, and a ray that could only meet the other half has missed it.
    """
    bend = 1.0 - mu * mu
    equator = 1.0 + EQUATOR_TOLERANCE if clear < math.inf else math.inf
    for i in range(BLOCK):
        x, y, z = ray[X + i], ray[Y + i], ray[Z + i]
        l, m, n = ray[L + i], ray[M + i], ray[N + i]
        e = -(x * l + y * m + z * n)
        x += e * l
        y += e * m
        z += e * n
        f = c * (x * x + y * y + z * z) - 2.0 * z
        g = n - c * (x * l + y * m + z * n)
        q2 = g * g - c * f
        q = math.sqrt(max(q2, 0.0))
        along = s * g >= 0.0
        t = (f if along else g - s * q) / (g + s * q if along else c)
        x += t * l
        y += t * m
        z += t * n
        cos2 = 1.0 - mu * mu * (1.0 - q * q)
        cos_t = math.sqrt(max(cos2, 0.0))
        r2 = x * x + y * y
        a = s * (bend / (cos_t + mu * q))
        ac = a * c
        ray[X + i] = x
        ray[Y + i] = y
        ray[Z + i] = z
        ray[L + i] = mu * l - ac * x
        ray[M + i] = mu * m - ac * y
        ray[N + i] = mu * n + (a - ac * z)
        lost = 0.0 if cos2 >= 0.0 else code + TOTAL_REFLECTION
        lost = lost if r2 <= clear else code + CLIPPED
        lost = lost if r2 < math.inf else code + NOT_FINITE
        lost = code + MISSED if q2 < 0.0 or c * z > equator else lost
        was = ray[STATUS + i]
        ray[STATUS + i] = was if was != 0.0 else lost


@device
def _to_plane(ray):
    """Move rays along themselves to the plane z = 0."""
    for i in range(BLOCK):
        t = -ray[Z + i] / ray[N + i]
        ray[X + i] += t * ray[L + i]
        ray[Y + i] += t * ray[M + i]
        ray[Z + i] = 0.0


@device
def _clip_circle(ray, clear, code):
    for i in range(BLOCK):
        r2 = ray[X + i] * ray[X + i] + ray[Y + i] * ray[Y + i]
        lost = 0.0 if r2 <= clear else code + CLIPPED
        lost = lost if r2 < math.inf else code + NOT_FINITE
        was = ray[STATUS + i]
        ray[STATUS + i] = was if was != 0.0 else lost


@device
def _clip_edge(ray, nx, ny, apothem, code):
    for i in range(BLOCK):
        inside = nx * ray[X + i] + ny * ray[Y + i] <= apothem
        was = ray[STATUS + i]
        ray[STATUS + i] = was if was != 0.0 or inside else code + CLIPPED


@device
def _leave(ray, z_last):
    for i in range(BLOCK):
        ray[Z + i] += z_last
        ray[WEIGHT + i] = ray[WEIGHT + i] if ray[STATUS + i] == 0.0 else 0.0


@device
def trace_block(ray, kind, z, c, mu, clear, number, edges, first_edge, s):
    """One block through all elements, in the order of travel; see `LensTables` for the columns."""
    _enter(ray, z[0])
    for k in range(kind.size):
        if k > 0:
            gap = z[k] - z[k - 1]
            for i in range(BLOCK):
                ray[Z + i] -= gap
        code = CAUSES * (number[k] + 1.0)
        if kind[k] == SURFACE:
            refract_block(ray, c[k], mu[k], clear[k], s, code)
        else:
            _to_plane(ray)
            _clip_circle(ray, clear[k], code)
            if kind[k] == POLYGON:
                for j in range(first_edge[k], first_edge[k + 1]):
                    _clip_edge(ray, edges[j, 0], edges[j, 1], edges[j, 2], code)
    _leave(ray, z[kind.size - 1])


@kernel
def fill_traced(blocks, kind, z, c, mu, clear, number, edges, first_edge, s):
    """Trace a bundle, shape (n_blocks * RAY,), in place."""
    for b in range(blocks.size // RAY):
        trace_block(blocks[b * RAY : (b + 1) * RAY], kind, z, c, mu, clear, number, edges, first_edge, s)


@kernel
def fill_traced_rows(
    out_origin,
    out_direction,
    out_weight,
    out_status,
    out_lost_at,
    origin,
    direction,
    weight,
    status,
    lost_at,
    kind,
    z,
    c,
    mu,
    clear,
    number,
    edges,
    first_edge,
    s,
):
    """Trace rays given as rows of points and directions. Lost rays end as NaN with weight 0 and a status."""
    ray = np.zeros(RAY)
    n = origin.shape[0]
    for start in range(0, n, BLOCK):
        filled = min(BLOCK, n - start)
        for i in range(filled):
            j = start + i
            ray[X + i] = origin[j, 0]
            ray[Y + i] = origin[j, 1]
            ray[Z + i] = origin[j, 2]
            ray[L + i] = direction[j, 0]
            ray[M + i] = direction[j, 1]
            ray[N + i] = direction[j, 2]
            ray[WEIGHT + i] = weight[j]
            ray[STATUS + i] = 0.0 if status[j] == 0 else status[j] + CAUSES * (lost_at[j] + 1.0)
        trace_block(ray, kind, z, c, mu, clear, number, edges, first_edge, s)
        for i in range(filled):
            j = start + i
            code = int(ray[STATUS + i])
            out_status[j] = code % CAUSES
            out_lost_at[j] = code // CAUSES - 1
            void = 0.0 if code == 0 else math.nan
            out_weight[j] = ray[WEIGHT + i]
            out_origin[j, 0] = ray[X + i] + void
            out_origin[j, 1] = ray[Y + i] + void
            out_origin[j, 2] = ray[Z + i] + void
            out_direction[j, 0] = ray[L + i] + void
            out_direction[j, 1] = ray[M + i] + void
            out_direction[j, 2] = ray[N + i] + void
