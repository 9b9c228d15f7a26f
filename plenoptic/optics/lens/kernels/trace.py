"""Rays through a stack of surfaces and stops: the kernels."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.jit import device, kernel
from plenoptic.core.kernels.ray_blocks import (
    BLOCK,
    CAUSES,
    CLIPPED,
    MISSED,
    NOT_FINITE,
    RAY,
    STATUS,
    TOTAL_REFLECTION,
    WEIGHT,
    L,
    M,
    N,
    X,
    Y,
    Z,
)
from plenoptic.optics.lens.kernels.conic_asphere import refract_asphere_block, refract_conic_block
from plenoptic.optics.lens.kernels.notes import CAME, begin_way, keep_way, note_asphere, note_conic, note_plane
from plenoptic.optics.lens.kernels.stops import clip_circle, clip_shape

SURFACE, CIRCLE, POLYGON, CONIC, ASPHERE, IDEAL, ARCS, STAR, MASK = range(9)


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
def refract_block(ray, c, mu, mus, clear, rim, s, code):
    """Through one sphere or plane of curvature c, whose vertex is the origin of the rays' z.

    Closest-approach form: with the ray's point nearest to the vertex as its start, F and G suffer no
    cancellation on flat surfaces, tiny radii or distant origins. `s` is the direction of travel along
    the stack, `mu` the ratio of indices or `mus` that of each ray, `clear` the squared semi-diameter, and `rim` how
    deep the surface reaches: up to c z = 1 it is the part of the sphere on the vertex's side of the equator, and a ray
    that could only meet the other half has missed it.
    """
    for i in range(BLOCK):
        ratio = mu if mus is None else mus[i]
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
        divisor = g + s * q if along else c
        t = (f if along else g - s * q) / divisor
        x += t * l
        y += t * m
        z += t * n
        cos2 = 1.0 - ratio * ratio * (1.0 - q * q)
        cos_t = math.sqrt(max(cos2, 0.0))
        r2 = x * x + y * y
        a = s * ((1.0 - ratio * ratio) / (cos_t + ratio * q))
        ac = a * c
        ray[X + i] = x
        ray[Y + i] = y
        ray[Z + i] = z
        ray[L + i] = ratio * l - ac * x
        ray[M + i] = ratio * m - ac * y
        ray[N + i] = ratio * n + (a - ac * z)
        lost = 0.0 if cos2 >= 0.0 else code + TOTAL_REFLECTION
        lost = lost if r2 <= clear else code + CLIPPED
        lost = lost if r2 < math.inf else code + NOT_FINITE
        lost = code + MISSED if q2 <= 0.0 or (divisor == 0.0 and g == g) or c * z > rim else lost
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
def _through_ideal_lens(ray, power, mus, shift):
    """A thick lens without aberrations: slopes change by height times power between the two principal planes.

    `mus` is how much stronger the lens is for each ray than `power`.
    """
    _to_plane(ray)
    for i in range(BLOCK):
        bend = power if mus is None else power * mus[i]
        # The slope is per length of travel, and so is the bend towards the axis.
        ahead = abs(ray[N + i])
        u = ray[L + i] / ahead - ray[X + i] * bend
        v = ray[M + i] / ahead - ray[Y + i] * bend
        cos = 1.0 / math.sqrt(1.0 + u * u + v * v)
        ray[Z + i] = shift
        ray[L + i] = u * cos
        ray[M + i] = v * cos
        ray[N + i] = math.copysign(cos, ray[N + i])


@device
def into_frame(ray, frame):
    """Rays in the axes of an element that is shifted and turned: `frame` as in `LensTables`."""
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
    for i in range(BLOCK):
        x, y, z = ray[X + i], ray[Y + i], ray[Z + i]
        l, m, n = ray[L + i], ray[M + i], ray[N + i]
        ray[X + i] = frame[0] * x + frame[1] * y + frame[2] * z + frame[9]
        ray[Y + i] = frame[3] * x + frame[4] * y + frame[5] * z + frame[10]
        ray[Z + i] = frame[6] * x + frame[7] * y + frame[8] * z + frame[11]
        ray[L + i] = frame[0] * l + frame[1] * m + frame[2] * n
        ray[M + i] = frame[3] * l + frame[4] * m + frame[5] * n
        ray[N + i] = frame[6] * l + frame[7] * m + frame[8] * n


@device
def _leave(ray, z_last):
    for i in range(BLOCK):
        ray[Z + i] += z_last
        ray[WEIGHT + i] = ray[WEIGHT + i] if ray[STATUS + i] == 0.0 else 0.0


@device
def _fill_ratios(mus, ratios, waves, first):
    """The ratio of indices for each ray of a block: `ratios` holds one for each wavelength."""
    for i in range(BLOCK):
        mus[i] = ratios[waves[first + i]]


@device
def trace_block(
    ray,
    mus,
    ratios,
    waves,
    first,
    kind,
    z,
    c,
    mu,
    clear,
    rim,
    number,
    edges,
    first_edge,
    conic,
    aspheric,
    frames,
    masks,
    s,
    told,
):
    """One block through all elements, in the order of travel; see `LensTables` for the columns.

    With `waves`, rays have wavelengths of their own: ray i of the block that of number waves[first + i]; `ratios` has a
    column for each, in place of `mu`, and `mus` is room for a block. With `told`
    (elements, TOLD, BLOCK), notes are taken; see `notes`.
    """
    if told is not None:
        came = np.empty((CAME, BLOCK))
        begin_way(came, ray)
    _enter(ray, z[0])
    for k in range(kind.size):
        if k > 0:
            gap = z[k] - z[k - 1]
            for i in range(BLOCK):
                ray[Z + i] -= gap
        code = CAUSES * (number[k] + 1.0)
        if waves is not None:
            _fill_ratios(mus, ratios[k], waves, first)
        if frames is not None:  # noqa: SIM102 - alone, so that it is pruned
            if frames[k, 12] != 0.0:
                into_frame(ray, frames[k])
        if told is not None:
            keep_way(came, told[k], ray)
        if kind[k] == SURFACE:
            refract_block(ray, c[k], mu[k], mus, clear[k], rim[k], s, code)
        elif kind[k] == CIRCLE or kind[k] == POLYGON or kind[k] >= ARCS:
            _to_plane(ray)
            clip_circle(ray, clear[k], code)
            if kind[k] != CIRCLE:
                clip_shape(ray, kind[k], edges[first_edge[k] : first_edge[k + 1]], masks, k, code)
        elif kind[k] == IDEAL:
            _through_ideal_lens(ray, c[k], mus, rim[k])
        elif conic is not None:
            if kind[k] == CONIC:
                refract_conic_block(ray, c[k], conic[k], mu[k], mus, clear[k], rim[k], s, code)
            elif aspheric is not None:
                heights = np.empty((5, BLOCK))
                noted = None if told is None else told[k]
                refract_asphere_block(ray, heights, c[k], conic[k], aspheric[k], mu[k], mus, clear[k], s, code, noted)
        if told is not None:
            place = abs(z[k]) if k == 0 or k == kind.size - 1 else 0.0
            kz = 1.0 if conic is None else 1.0 + conic[k]
            if kind[k] == SURFACE or kind[k] == CONIC:
                note_conic(told[k], came, ray, c[k], kz, mu[k], mus, place)
            elif kind[k] != ASPHERE:
                note_plane(told[k], came, ray, kind[k] == IDEAL, place)
            elif aspheric is not None:
                note_asphere(told[k], came, ray, c[k], kz, aspheric[k], mu[k], mus, place)
        if frames is not None:  # noqa: SIM102 - alone, so that it is pruned
            if frames[k, 12] != 0.0:
                out_of_frame(ray, frames[k])
    _leave(ray, z[kind.size - 1])


@kernel
def fill_traced(blocks, kind, z, c, mu, clear, rim, number, edges, first_edge, conic, aspheric, frames, masks, s):
    """Trace a bundle, shape (n_blocks * RAY,), in place."""
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        trace_block(
            ray,
            None,
            None,
            None,
            0,
            kind,
            z,
            c,
            mu,
            clear,
            rim,
            number,
            edges,
            first_edge,
            conic,
            aspheric,
            frames,
            masks,
            s,
            None,
        )


@kernel
def fill_traced_waves(
    blocks, waves, kind, z, c, mu, clear, rim, number, edges, first_edge, conic, aspheric, frames, masks, s
):
    """Trace a bundle whose rays have wavelengths of their own: `waves` (rays,) are columns of `mu`."""
    mus, common = np.empty(BLOCK), mu[:, 0].copy()
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        trace_block(
            ray,
            mus,
            mu,
            waves,
            b * BLOCK,
            kind,
            z,
            c,
            common,
            clear,
            rim,
            number,
            edges,
            first_edge,
            conic,
            aspheric,
            frames,
            masks,
            s,
            None,
        )


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
    rim,
    number,
    edges,
    first_edge,
    conic,
    aspheric,
    frames,
    masks,
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
        trace_block(
            ray,
            None,
            None,
            None,
            0,
            kind,
            z,
            c,
            mu,
            clear,
            rim,
            number,
            edges,
            first_edge,
            conic,
            aspheric,
            frames,
            masks,
            s,
            None,
        )
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
