"""Rays through one surface without rotational symmetry: an even asphere with a freeform term."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.kernels.ray_blocks import BLOCK, CLIPPED, NOT_FINITE, STATUS, TOTAL_REFLECTION, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device
from plenoptic.optics.lens.kernels.aspheric_refraction import (
    AT_VERTEX,
    EPS,
    NEWTON_STEPS,
    first_crossing,
    height,
    to_conic_of_asphere,
)
from plenoptic.optics.lens.kernels.conditioning_probes import (
    NEWTON,
    ROUNDED_LENGTH,
    STEPS,
    record_refraction,
    rounded_length,
)
from plenoptic.optics.lens.kernels.freeform_term import freeform_term_at
from plenoptic.optics.lens.lens_record import FIRST_TERM, ROUNDING, SHARPEST, STEEPEST, TALLEST


@device
def freeform_at(x, y, conic, aspheric, freeform):
    """Sag and its derivatives by x and y; `conic` is the curvature and 1 + k."""
    sag, by_r2 = height(x * x + y * y, conic, aspheric)
    added, dx, dy = freeform_term_at(x, y, freeform)
    return sag + added, 2.0 * by_r2 * x + dx, 2.0 * by_r2 * y + dy


@device
def _newton(point, direction, conic, aspheric, freeform, semi_diameter2):
    """Newton's method from a point of a ray, until the next step is below the rounding error: final point and step
    count."""
    (x, y, z), (l, m, n) = point, direction
    sharpest = aspheric[SHARPEST] + freeform[SHARPEST]
    n_steps = 0
    for _ in range(NEWTON_STEPS):
        sag, dx, dy = freeform_at(x, y, conic, aspheric, freeform)
        slope = n - (dx * l + dy * m)
        step = (sag - z) / slope
        if not (x * x + y * y <= semi_diameter2 and step - step == 0.0):
            break
        x += step * l
        y += step * m
        z += step * n
        n_steps += 1
        # Remaining error: the step squared times half the second derivative of z - sag along the ray, over its slope.
        if 0.5 * sharpest * step * step <= EPS * abs(slope) * (abs(x) + abs(y) + abs(z)):
            break
    return x, y, z, n_steps


@device
def _is_first(point, direction, conic, aspheric, freeform, semi_diameter2, s):
    """True if a point is certainly the first intersection: on the surface, in the cylinder, on a ray with one
    crossing."""
    (x, y, z), (l, m, n) = point, direction
    sag, dx, dy = freeform_at(x, y, conic, aspheric, freeform)
    slope, steepest = n - (dx * l + dy * m), aspheric[STEEPEST] + freeform[STEEPEST]
    size = (abs(x) + abs(y) + abs(z)) * (1.0 + abs(dx) + abs(dy))
    rounding = 8.0 * EPS * size + freeform[ROUNDING] + AT_VERTEX * (aspheric[TALLEST] + freeform[TALLEST])
    # An unlimited surface has no known slope bound, so the root of Newton's method is accepted.
    single_crossing = n * n > steepest * steepest * (l * l + m * m) or semi_diameter2 == math.inf
    return abs(z - sag) <= rounding and x * x + y * y <= semi_diameter2 and s * slope > 0.0 and single_crossing


@device
def refract_freeform(ray, lens, k, index_ratios, s, code, probes):
    """Refract rays at the surface in row k; `probes` (elements, PROBE_ROWS, BLOCK), if given, counts the steps.

    A ray steeper than the maximum slope of the surface has one intersection, which Newton's method finds. All other
    rays are searched for their first intersection inside the semi-diameter, by steps that cannot skip one.
    """
    row, aspheric, freeform = lens.rows[k], lens.aspheric[k], lens.freeform[k]
    conic, semi_diameter2 = (row.curvature, 1.0 + lens.conic[k]), row.semi_diameter2
    nearest = np.empty((5, BLOCK))
    to_conic_of_asphere(ray, nearest, conic)
    for i in range(BLOCK):
        if ray[STATUS + i] != 0.0:
            continue
        direction = l, m, n = ray[L + i], ray[M + i], ray[N + i]
        x, y, z, n_steps = _newton(
            (ray[X + i], ray[Y + i], ray[Z + i]), direction, conic, aspheric, freeform, semi_diameter2
        )
        if probes is not None:
            probes[k, NEWTON, i] = n_steps
        lost = 0.0
        if not _is_first((x, y, z), direction, conic, aspheric, freeform, semi_diameter2, s):
            # Start again from the closest approach: large Newton steps leave the ray by their rounding error.
            start = x, y, z = nearest[2, i], nearest[3, i], nearest[4, i]
            steps = None if probes is None else probes[k, STEPS, i : i + 1]
            t, lost = first_crossing(start, direction, conic, aspheric, freeform, semi_diameter2, s, steps)
            finite = x - x == 0.0 and y - y == 0.0 and z - z == 0.0
            x += t * l
            y += t * m
            z += t * n
            # The exit from the cylinder is undefined where l^2 + m^2 underflows to 0.
            lost = lost if x * x + y * y <= semi_diameter2 * (1.0 + 16.0 * EPS) or lost != 0.0 else CLIPPED
            lost = lost if lost == 0.0 or finite else NOT_FINITE
        mu = row.index_ratio if index_ratios is None else index_ratios[i]
        _, dx, dy = freeform_at(x, y, conic, aspheric, freeform)
        nz = 1.0 / math.sqrt(1.0 + dx * dx + dy * dy)
        nx, ny = -dx * nz, -dy * nz
        cos_i = s * (nx * l + ny * m + nz * n)
        cos2 = 1.0 - mu * mu * (1.0 - cos_i * cos_i)
        a = s * ((1.0 - mu * mu) / (math.sqrt(max(cos2, 0.0)) + mu * cos_i))
        ray[X + i], ray[Y + i], ray[Z + i] = x, y, z
        ray[L + i] = mu * l + a * nx
        ray[M + i] = mu * m + a * ny
        ray[N + i] = mu * n + a * nz
        lost = lost if lost != 0.0 or cos2 >= 0.0 else TOTAL_REFLECTION
        lost = lost if lost != 0.0 or x * x + y * y < math.inf else NOT_FINITE
        ray[STATUS + i] = code + lost if lost != 0.0 else 0.0


@device
def record_freeform(probes, incident, ray, lens, k, index_ratios, origin_distance):
    """Record the conditioning at the surface in row k; `origin_distance` as in `record_conic`."""
    row, aspheric, freeform = lens.rows[k], lens.aspheric[k], lens.freeform[k]
    c, kz = row.curvature, 1.0 + lens.conic[k]
    for i in range(BLOCK):
        if ray[STATUS + i] != 0.0:
            continue
        x, y, z = ray[X + i], ray[Y + i], ray[Z + i]
        r2, term_sum = x * x + y * y, 0.0
        for j in range(aspheric.size - 1, FIRST_TERM - 1, -1):
            term_sum = term_sum * r2 + abs(aspheric[j])
        w = math.sqrt(max(1.0 - kz * c * c * r2, EPS))
        _, dx, dy = freeform_at(x, y, (c, kz), aspheric, freeform)
        length = math.sqrt(1.0 + dx * dx + dy * dy)
        terms = abs(z) + r2 * (abs(c) / (1.0 + w) * (1.0 + 0.5 / (w * (1.0 + w))) + term_sum) + freeform[ROUNDING] / EPS
        probes[k, ROUNDED_LENGTH, i] = rounded_length(incident, i, (x, y, z), terms / length, origin_distance)
        mu = row.index_ratio if index_ratios is None else index_ratios[i]
        record_refraction(probes[k], incident, i, (-dx, -dy, 1.0), length, mu)
