"""Kernels: refraction at one conic, or one even asphere with or without a freeform term."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.kernels.ray_blocks import (
    BLOCK,
    CLIPPED,
    MISSED,
    NOT_FINITE,
    STATUS,
    TOTAL_REFLECTION,
    L,
    M,
    N,
    X,
    Y,
    Z,
)
from plenoptic.core.numba.jit import device
from plenoptic.optics.lens.kernels.conditioning_probes import NEWTON, STEPS
from plenoptic.optics.lens.kernels.first_crossing import EPS, first_crossing, height
from plenoptic.optics.lens.kernels.freeform_term import fill_freeform_term, freeform_term_at
from plenoptic.optics.lens.lens_record import FIRST_TERM, ROUNDING, SHARPEST, STEEPEST, TALLEST

NEWTON_STEPS = 12
"""Largest number of joint Newton steps of a block; rays that need more are treated one by one."""

AT_VERTEX = 1e-20
"""Largest distance of a point from the surface at its vertex, over the largest sag."""

TERM, TERM_DX, TERM_DY, HEIGHT_ROWS = 5, 6, 7, 10
"""Rows of `heights` at a freeform surface: sag and derivatives of its term, before two buffers; others have 5 rows."""


@device
def refract_conic(ray, row, conic, index_ratios, s, code):
    """Refract rays at one conic: as `refract_sphere`, with the factor 1 + k of z^2.

    The normal (-c x, -c y, 1 - c (1 + k) z) has the squared length 1 - k c^2 (x^2 + y^2).
    """
    c, index_ratio, semi_diameter2, max_depth = row.curvature, row.index_ratio, row.semi_diameter2, row.max_depth
    kz = 1.0 + conic
    for i in range(BLOCK):
        mu = index_ratio if index_ratios is None else index_ratios[i]
        x, y, z = ray[X + i], ray[Y + i], ray[Z + i]
        l, m, n = ray[L + i], ray[M + i], ray[N + i]
        e = -(x * l + y * m + z * n)
        x += e * l
        y += e * m
        z += e * n
        f = c * (x * x + y * y + kz * z * z) - 2.0 * z
        g = n - c * (x * l + y * m + kz * z * n)
        quadratic = c * (1.0 + conic * n * n)
        q2 = g * g - quadratic * f
        q = math.sqrt(max(q2, 0.0))
        along = s * g >= 0.0
        divisor = g + s * q if along else quadratic
        t = (f if along else g - s * q) / divisor
        x += t * l
        y += t * m
        z += t * n
        r2 = x * x + y * y
        steep2 = 1.0 - conic * c * c * r2
        per_length = 1.0 / math.sqrt(max(steep2, 0.0))
        cos_i = q * per_length
        cos2 = 1.0 - mu * mu * (1.0 - cos_i * cos_i)
        cos_t = math.sqrt(max(cos2, 0.0))
        a = s * ((1.0 - mu * mu) / (cos_t + mu * cos_i)) * per_length
        ac = a * c
        ray[X + i] = x
        ray[Y + i] = y
        ray[Z + i] = z
        ray[L + i] = mu * l - ac * x
        ray[M + i] = mu * m - ac * y
        ray[N + i] = mu * n + (a - ac * kz * z)
        lost = 0.0 if cos2 >= 0.0 else code + TOTAL_REFLECTION
        lost = lost if r2 <= semi_diameter2 else code + CLIPPED
        lost = lost if r2 < math.inf else code + NOT_FINITE
        lost = code + MISSED if q2 <= 0.0 or (divisor == 0.0 and g == g) or c * kz * z > max_depth else lost
        was = ray[STATUS + i]
        ray[STATUS + i] = was if was != 0.0 else lost


@device
def _to_conic_of_asphere(ray, heights, conic):
    """Move rays to the asphere's base conic, or to their closest approach if they miss it; store the closest
    approach."""
    c, kz = conic
    for i in range(BLOCK):
        x, y, z = ray[X + i], ray[Y + i], ray[Z + i]
        l, m, n = ray[L + i], ray[M + i], ray[N + i]
        e = -(x * l + y * m + z * n)
        x += e * l
        y += e * m
        z += e * n
        heights[2, i], heights[3, i], heights[4, i] = x, y, z
        f = c * (x * x + y * y + kz * z * z) - 2.0 * z
        g = n - c * (x * l + y * m + kz * z * n)
        q2 = g * g - c * (1.0 + (kz - 1.0) * n * n) * f
        t = f / (g + math.copysign(math.sqrt(max(q2, 0.0)), g))
        t = t if q2 >= 0.0 and c * kz * (z + t * n) < 1.0 else 0.0
        ray[X + i] = x + t * l
        ray[Y + i] = y + t * m
        ray[Z + i] = z + t * n


@device
def _fill_heights(heights, ray, conic, aspheric, freeform):
    """Fill `height` for all rays of a block: sag and its derivative by r^2; and the freeform term, if there is one.

    The loop over terms is outermost, for SIMD.
    """
    c, kz = conic
    for i in range(BLOCK):
        heights[0, i] = 0.0
        heights[1, i] = 0.0
    for j in range(aspheric.size - 1, FIRST_TERM - 1, -1):
        a = aspheric[j]
        for i in range(BLOCK):
            r2 = ray[X + i] * ray[X + i] + ray[Y + i] * ray[Y + i]
            terms = heights[0, i]
            heights[1, i] = heights[1, i] * r2 + terms
            heights[0, i] = terms * r2 + a
    for i in range(BLOCK):
        r2 = ray[X + i] * ray[X + i] + ray[Y + i] * ray[Y + i]
        w = math.sqrt(1.0 - kz * c * c * r2)
        conic_factor = c / (w * (1.0 + w))
        terms = heights[0, i]
        heights[0, i] = r2 * (conic_factor * w + terms)
        heights[1, i] = 0.5 * conic_factor * (1.0 + w) + (heights[1, i] * r2 + terms)
    if freeform is not None:
        fill_freeform_term(heights[TERM:], ray, freeform)


@device
def _newton(ray, heights, shape, freeform, semi_diameter2, probes):
    """Newton's method for all rays of a block together, until the next step is below the rounding error.

    `probes`, if given, counts the steps of each ray up to its own convergence.
    """
    conic, aspheric = shape
    sharpest = aspheric[SHARPEST]
    if freeform is not None:
        sharpest += freeform[SHARPEST]
    for _ in range(NEWTON_STEPS):
        _fill_heights(heights, ray, conic, aspheric, freeform)
        far = 0
        for i in range(BLOCK):
            x, y, z = ray[X + i], ray[Y + i], ray[Z + i]
            l, m, n = ray[L + i], ray[M + i], ray[N + i]
            sag, slope = heights[0, i], n - 2.0 * heights[1, i] * (x * l + y * m)
            if freeform is not None:
                sag += heights[TERM, i]
                slope -= heights[TERM_DX, i] * l + heights[TERM_DY, i] * m
            step = (sag - z) / slope
            # Remaining error: the step squared times half the second derivative of z - sag along the ray, over its
            # slope.
            left = 0.5 * sharpest * step * step - EPS * abs(slope) * (abs(x) + abs(y) + abs(z))
            # Rays that are lost, outside the clear cylinder or without a sag do not delay convergence.
            going = ray[STATUS + i] == 0.0 and x * x + y * y <= semi_diameter2 and step - step == 0.0
            step = step if going else 0.0
            ray[X + i] = x + step * l
            ray[Y + i] = y + step * m
            ray[Z + i] = z + step * n
            far += 1 if going and left > 0.0 else 0
            if probes is not None:  # noqa: SIM102 - nested for compile-time pruning
                if going:
                    probes[NEWTON, i] = min(max(probes[NEWTON, i], 1.0) + (1.0 if left > 0.0 else 0.0), NEWTON_STEPS)
        if far == 0:
            return


@device
def _search_first_crossings(ray, heights, shape, freeform, semi_diameter2, s, code, probes):
    """Search the first intersection of each ray for which Newton's method may have found another one.

    The root is certain if the point lies on the surface, in the clear cylinder, and the ray can cross only once.
    """
    conic, aspheric = shape
    _fill_heights(heights, ray, conic, aspheric, freeform)
    # At the vertex all coordinates vanish, and so does a tolerance relative to them.
    steepest, rounding = aspheric[STEEPEST], AT_VERTEX * aspheric[TALLEST]
    if freeform is not None:
        steepest += freeform[STEEPEST]
        rounding += AT_VERTEX * freeform[TALLEST] + freeform[ROUNDING]
    steepest2 = steepest * steepest
    unsettled = 0
    for i in range(BLOCK):
        x, y, z = ray[X + i], ray[Y + i], ray[Z + i]
        l, m, n = ray[L + i], ray[M + i], ray[N + i]
        sag_by_r2 = heights[1, i]
        slope = n - 2.0 * sag_by_r2 * (x * l + y * m)
        out = abs(x) + abs(y)
        gap, steep = z - heights[0, i], 1.0 + 2.0 * abs(sag_by_r2) * out
        if freeform is not None:
            gap -= heights[TERM, i]
            slope -= heights[TERM_DX, i] * l + heights[TERM_DY, i] * m
            steep += abs(heights[TERM_DX, i]) + abs(heights[TERM_DY, i])
        close = abs(gap) <= 8.0 * EPS * (out + abs(z)) * steep + rounding
        # An unlimited surface has no known slope bound, so the root of Newton's method is accepted.
        single_crossing = n * n > steepest2 * (l * l + m * m) or semi_diameter2 == math.inf
        settled = close and x * x + y * y <= semi_diameter2 and s * slope > 0.0 and single_crossing
        heights[0, i] = 1.0 if settled or ray[STATUS + i] != 0.0 else 0.0
        unsettled += 0 if settled or ray[STATUS + i] != 0.0 else 1
    if unsettled == 0:
        return
    for i in range(BLOCK):
        if heights[0, i] == 1.0:
            continue
        # Start again from the closest approach: large Newton steps leave the ray by their rounding error.
        x, y, z = heights[2, i], heights[3, i], heights[4, i]
        l, m, n = ray[L + i], ray[M + i], ray[N + i]
        steps = None if probes is None else probes[STEPS, i : i + 1]
        t, lost = first_crossing((x, y, z), (l, m, n), conic, aspheric, freeform, semi_diameter2, s, steps)
        ray[X + i] = x + t * l
        ray[Y + i] = y + t * m
        ray[Z + i] = z + t * n
        r2 = ray[X + i] ** 2 + ray[Y + i] ** 2
        _, heights[1, i] = height(r2, conic, aspheric)
        if freeform is not None:
            _, heights[TERM_DX, i], heights[TERM_DY, i] = freeform_term_at(ray[X + i], ray[Y + i], freeform)
        # The exit from the cylinder is undefined where l^2 + m^2 underflows to 0.
        lost = lost if r2 <= semi_diameter2 * (1.0 + 16.0 * EPS) or lost != 0.0 else CLIPPED
        if lost != 0.0:
            finite = x - x == 0.0 and y - y == 0.0 and z - z == 0.0
            ray[STATUS + i] = code + (lost if finite else NOT_FINITE)


@device
def refract_asphere(ray, row, shape, freeform, index_ratios, s, code, probes):
    """Refract rays at one even asphere; `shape` is its pair of curvature and 1 + k, and its row of
    `LensRecord.aspheric`, `freeform` its row of `LensRecord.freeform`, None without a freeform term.

    `probes` (PROBE_ROWS, BLOCK), if given, counts the steps; see `conditioning_probes`. A ray steeper against the
    vertex plane than the surface is anywhere has at most one intersection, which Newton's method finds. All other rays
    are searched for their first intersection inside the semi-diameter.
    """
    heights = np.empty((TERM if freeform is None else HEIGHT_ROWS, BLOCK))
    index_ratio, semi_diameter2 = row.index_ratio, row.semi_diameter2
    _to_conic_of_asphere(ray, heights, shape[0])
    _newton(ray, heights, shape, freeform, semi_diameter2, probes)
    _search_first_crossings(ray, heights, shape, freeform, semi_diameter2, s, code, probes)
    for i in range(BLOCK):
        mu = index_ratio if index_ratios is None else index_ratios[i]
        x, y = ray[X + i], ray[Y + i]
        l, m, n = ray[L + i], ray[M + i], ray[N + i]
        sag_by_r2 = heights[1, i]
        r2 = x * x + y * y
        if freeform is None:
            nz = 1.0 / math.sqrt(1.0 + 4.0 * sag_by_r2 * sag_by_r2 * r2)
            nx, ny = -2.0 * sag_by_r2 * x * nz, -2.0 * sag_by_r2 * y * nz
        else:
            dx, dy = 2.0 * sag_by_r2 * x + heights[TERM_DX, i], 2.0 * sag_by_r2 * y + heights[TERM_DY, i]
            nz = 1.0 / math.sqrt(1.0 + dx * dx + dy * dy)
            nx, ny = -dx * nz, -dy * nz
        cos_i = s * (nx * l + ny * m + nz * n)
        cos2 = 1.0 - mu * mu * (1.0 - cos_i * cos_i)
        cos_t = math.sqrt(max(cos2, 0.0))
        a = s * ((1.0 - mu * mu) / (cos_t + mu * cos_i))
        ray[L + i] = mu * l + a * nx
        ray[M + i] = mu * m + a * ny
        ray[N + i] = mu * n + a * nz
        lost = 0.0 if cos2 >= 0.0 else code + TOTAL_REFLECTION
        lost = lost if r2 < math.inf else code + NOT_FINITE
        was = ray[STATUS + i]
        ray[STATUS + i] = was if was != 0.0 else lost
