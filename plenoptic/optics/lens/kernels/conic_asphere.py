"""Rays through one conic or one even asphere: the kernels that spherical lenses do without."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.kernels.ray_blocks import (
    BLOCK,
    CLIPPED,
    MISSED,
    NOT_CONVERGED,
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
from plenoptic.optics.lens.kernels.freeform_term import freeform_bending, freeform_term_at
from plenoptic.optics.lens.kernels.notes import NEWTON, STEPS
from plenoptic.optics.lens.lens_record import FIRST_TERM, ROUNDING, SHARPEST, STEEPEST, TALLEST

NEWTON_STEPS = 12
"""Steps that all rays of a block may take together; those that need more are looked at one by one."""

MOST_STEPS = 400
"""Steps that one ray may take in the search for its first crossing; each is as long as is surely safe."""

EPS = 2.220446049250313e-16
TINY = 1e-300
AT_VERTEX = 1e-20
"""How far from the surface, over its largest sag, a point may be at its vertex."""


@device
def refract_conic(ray, row, conic, index_ratios, s, code):
    """Through one conic: as `refract_sphere`, with the factor 1 + k where z is squared.

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
def height(r2, conic, aspheric):
    """Sag of an even asphere, and the derivative of the sag by r^2; nan beyond the equator of its conic.

    Here and below, `conic` is its curvature and 1 + k.
    """
    c, kz = conic
    w = math.sqrt(1.0 - kz * c * c * r2)
    share = c / (w * (1.0 + w))
    terms = 0.0
    change = 0.0
    for j in range(aspheric.size - 1, FIRST_TERM - 1, -1):
        change = change * r2 + terms
        terms = terms * r2 + aspheric[j]
    return r2 * (share * w + terms), 0.5 * share * (1.0 + w) + (change * r2 + terms)


@device
def _rounding(r2, z, conic, aspheric):
    """Rounding error of z - sag: eps times the sum of the sizes of all terms."""
    c, kz = conic
    size = 0.0
    for j in range(aspheric.size - 1, FIRST_TERM - 1, -1):
        size = size * r2 + abs(aspheric[j])
    return EPS * (abs(z) + r2 * (abs(c) / (1.0 + math.sqrt(1.0 - kz * c * c * r2)) + size)) + TINY


@device
def first_crossing(point, direction, conic, aspheric, freeform, semi_diameter2, s, steps):
    """First intersection of a ray with the surface within the clear cylinder, in the direction of the stack.

    Returns the distance along the ray and a status: NOT_CONVERGED where the limit of iterations is reached, CLIPPED
    where the ray does not come into the cylinder or passes it without a crossing, MISSED where there is no cylinder.
    """
    (x, y, z), (l, m, n) = point, direction
    if semi_diameter2 == math.inf:
        return 0.0, MISSED
    sin2 = l * l + m * m
    half = x * l + y * m
    apart = half * half - sin2 * (x * x + y * y - semi_diameter2)
    if not (apart > 0.0 or x * x + y * y <= semi_diameter2):
        return 0.0, CLIPPED
    root = math.sqrt(max(apart, 0.0))
    begin = (-half - root) / sin2 if sin2 > 0.0 else -math.inf
    end = (-half + root) / sin2 if sin2 > 0.0 else math.inf
    # A ray nearly along the axis leaves the cylinder far away: the surface lies within its own largest sag.
    tall = aspheric[TALLEST] + TINY
    if freeform is not None:
        tall += freeform[TALLEST]
    if n != 0.0:
        near, far = (-tall - z) / n, (tall - z) / n
        begin, end = max(begin, min(near, far)), min(end, max(near, far))
    if not begin <= end:
        return 0.0, CLIPPED
    return _climb((begin, end), (point, direction), conic, aspheric, freeform, semi_diameter2, s, steps)


@device
def _bend_ahead(r, half, sin2, conic, aspheric, semi_diameter2):
    """Length ahead for which a bound on the second derivative of the sag along a ray holds, that bound, and the square
    of the largest distance from the axis on that length.

    Along a ray it is at most sin^2 times the second derivative by r, since sag' / r is a mean of that. Both parts are
    largest at the largest r: inwards that of the ray's point, until it is as far from the axis again; outwards, half of
    the rest to the rim is looked ahead.
    """
    c, kz = conic
    edge = math.sqrt(semi_diameter2)
    outwards = half >= 0.0
    ahead = 0.5 * (edge - r) / math.sqrt(sin2) if outwards else -2.0 * half / sin2
    r2 = (0.5 * (r + edge)) ** 2 if outwards else r * r
    w2 = max(min(1.0 - kz * c * c * r2, 1.0), 0.0)
    terms = 0.0
    for j in range(aspheric.size - 1, FIRST_TERM - 1, -1):
        power = 2.0 * (j - FIRST_TERM) + 2.0
        terms = terms * r2 + power * (power - 1.0) * abs(aspheric[j])
    return ahead, sin2 * (abs(c) / (w2 * math.sqrt(w2)) + terms), r2


@device
def _safe_step(gap, rate, sharp):
    """Safe length of a gap that closes at a rate which changes by at most `sharp` per length."""
    root = math.sqrt(rate * rate + 2.0 * sharp * gap)
    return 2.0 * gap / (rate + root) if rate > 0.0 else (root - rate) / sharp


@device
def _climb(bounds, ray, conic, aspheric, freeform, semi_diameter2, s, steps):
    """From the first of the bounds on, step by step, to where s (z - sag) first comes from below 0 to above.

    With f and g the function and its derivative and M a bound on its second derivative, f + g h + M h^2 / 2 is an upper
    bound: no step to its zero passes a crossing, and near a simple one it is Newton's step. Where a ray begins above
    the surface, it first goes down in the same way, and on by -g / M, where it is surely below. Of the bounds ahead and
    on the whole surface, the one that allows the longer step is taken.
    """
    ((x, y, z), (l, m, n)), (begin, end) = ray, bounds
    sin2 = l * l + m * m
    whole = sin2 * aspheric[SHARPEST]
    if freeform is not None:
        whole += sin2 * freeform[SHARPEST]
    below = False
    t = begin
    for _ in range(MOST_STEPS):
        if steps is not None:
            steps[0] += 1.0
        px, py, pz = x + t * l, y + t * m, z + t * n
        # At the equator itself the sag has no derivative.
        r2 = min(px * px + py * py, semi_diameter2 * (1.0 - 16.0 * EPS))
        half = px * l + py * m
        sag, bend = height(r2, conic, aspheric)
        f = s * (pz - sag)
        g = s * (n - 2.0 * bend * half)
        close = EPS * (abs(px) + abs(py) + abs(pz)) + TINY
        rounding = _rounding(r2, pz, conic, aspheric)
        ahead, sharp, farthest2 = _bend_ahead(math.sqrt(r2), half, sin2, conic, aspheric, semi_diameter2)
        if freeform is not None:
            added, dx, dy = freeform_term_at(px, py, freeform)
            f -= s * added
            g -= s * (dx * l + dy * m)
            rounding += freeform[ROUNDING] + EPS * abs(added)
            sharp += sin2 * freeform_bending(farthest2, freeform)
        if abs(f) <= rounding:
            if below or g > 0.0:
                return t, 0.0
            step = max(min(-g / sharp, ahead), -g / whole)
        else:
            if below and f > 0.0:
                # Only rounding leads past the zero of an upper bound.
                return t, 0.0 if f <= 16.0 * (rounding + abs(g) * close) else NOT_CONVERGED
            rate = -g if f > 0.0 else g
            step = min(_safe_step(abs(f), rate, sharp), ahead)
            step = max(step, _safe_step(abs(f), rate, whole)) if whole < math.inf else step
            if below and step <= close:
                return t, 0.0
            below = f < 0.0
        t += max(step, close)
        if not t <= end:
            return 0.0, CLIPPED
    return t, NOT_CONVERGED


@device
def to_conic_of_asphere(ray, heights, conic):
    """Move rays to the crossing of the asphere's conic, or to their closest approach where there is none; keep that."""
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
def _fill_heights(heights, ray, conic, aspheric):
    """`height` for all rays of a block: rows of its sag and its derivative. Term by term, so that loops are vectors."""
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
        share = c / (w * (1.0 + w))
        terms = heights[0, i]
        heights[0, i] = r2 * (share * w + terms)
        heights[1, i] = 0.5 * share * (1.0 + w) + (heights[1, i] * r2 + terms)


@device
def _newton(ray, heights, conic, aspheric, semi_diameter2, log):
    """Newton's method for all rays of a block together, until the next step would be below rounding.

    With `log`, each ray's own steps are counted: up to the first one of its own after which that is so.
    """
    sharpest = aspheric[SHARPEST]
    for _ in range(NEWTON_STEPS):
        _fill_heights(heights, ray, conic, aspheric)
        far = 0
        for i in range(BLOCK):
            x, y, z = ray[X + i], ray[Y + i], ray[Z + i]
            l, m, n = ray[L + i], ray[M + i], ray[N + i]
            slope = n - 2.0 * heights[1, i] * (x * l + y * m)
            step = (heights[0, i] - z) / slope
            # What a step leaves: its square times half the curvature of z - sag along the ray, over the slope.
            left = 0.5 * sharpest * step * step - EPS * abs(slope) * (abs(x) + abs(y) + abs(z))
            # Rays that are lost, outside the clear cylinder or without a height there wait for their turn.
            going = ray[STATUS + i] == 0.0 and x * x + y * y <= semi_diameter2 and step - step == 0.0
            step = step if going else 0.0
            ray[X + i] = x + step * l
            ray[Y + i] = y + step * m
            ray[Z + i] = z + step * n
            far += 1 if going and left > 0.0 else 0
            if log is not None:  # noqa: SIM102 - alone, so that it is pruned
                if going:
                    log[NEWTON, i] = min(max(log[NEWTON, i], 1.0) + (1.0 if left > 0.0 else 0.0), NEWTON_STEPS)
        if far == 0:
            return


@device
def _settle(ray, heights, conic, aspheric, semi_diameter2, s, code, log):
    """Look at the rays one by one for which Newton's method did not surely find the first crossing.

    It did where the point lies on the surface, in the clear cylinder, and the ray can cross only once.
    """
    _fill_heights(heights, ray, conic, aspheric)
    steepest2 = aspheric[STEEPEST] * aspheric[STEEPEST]
    # At the vertex itself all coordinates vanish, and what is relative to them.
    at_vertex = AT_VERTEX * aspheric[TALLEST]
    unsettled = 0
    for i in range(BLOCK):
        x, y, z = ray[X + i], ray[Y + i], ray[Z + i]
        l, m, n = ray[L + i], ray[M + i], ray[N + i]
        bend = heights[1, i]
        slope = n - 2.0 * bend * (x * l + y * m)
        out = abs(x) + abs(y)
        close = abs(z - heights[0, i]) <= 8.0 * EPS * (out + abs(z)) * (1.0 + 2.0 * abs(bend) * out) + at_vertex
        # Without a rim the surface goes on where its slope is not known: what Newton's method finds is taken.
        alone = n * n > steepest2 * (l * l + m * m) or semi_diameter2 == math.inf
        settled = close and x * x + y * y <= semi_diameter2 and s * slope > 0.0 and alone
        heights[0, i] = 1.0 if settled or ray[STATUS + i] != 0.0 else 0.0
        unsettled += 0 if settled or ray[STATUS + i] != 0.0 else 1
    if unsettled == 0:
        return
    for i in range(BLOCK):
        if heights[0, i] == 1.0:
            continue
        # From the closest approach: wide steps of Newton's method lead off the ray by their own rounding.
        x, y, z = heights[2, i], heights[3, i], heights[4, i]
        l, m, n = ray[L + i], ray[M + i], ray[N + i]
        steps = None if log is None else log[STEPS, i : i + 1]
        t, lost = first_crossing((x, y, z), (l, m, n), conic, aspheric, None, semi_diameter2, s, steps)
        ray[X + i] = x + t * l
        ray[Y + i] = y + t * m
        ray[Z + i] = z + t * n
        r2 = ray[X + i] ** 2 + ray[Y + i] ** 2
        _, heights[1, i] = height(r2, conic, aspheric)
        # A direction so near the axis that its square is 0 says nothing about where the cylinder is left.
        lost = lost if r2 <= semi_diameter2 * (1.0 + 16.0 * EPS) or lost != 0.0 else CLIPPED
        if lost != 0.0:
            finite = x - x == 0.0 and y - y == 0.0 and z - z == 0.0
            ray[STATUS + i] = code + (lost if finite else NOT_FINITE)


@device
def refract_asphere(ray, row, conic, aspheric, index_ratios, s, code, log):
    """Through one even asphere; `aspheric` as in `LensRecord`. With `log` (LOG, BLOCK), steps are counted; see `notes`.

    A ray steeper against the vertex plane than the surface is anywhere crosses it at most once, and the crossing that
    Newton's method finds is that one. All others are searched for their first crossing inside the semi-diameter.
    """
    heights, shape = np.empty((5, BLOCK)), (row.curvature, 1.0 + conic)
    index_ratio, semi_diameter2 = row.index_ratio, row.semi_diameter2
    to_conic_of_asphere(ray, heights, shape)
    _newton(ray, heights, shape, aspheric, semi_diameter2, log)
    _settle(ray, heights, shape, aspheric, semi_diameter2, s, code, log)
    for i in range(BLOCK):
        mu = index_ratio if index_ratios is None else index_ratios[i]
        x, y = ray[X + i], ray[Y + i]
        l, m, n = ray[L + i], ray[M + i], ray[N + i]
        bend = heights[1, i]
        r2 = x * x + y * y
        nz = 1.0 / math.sqrt(1.0 + 4.0 * bend * bend * r2)
        nx, ny = -2.0 * bend * x * nz, -2.0 * bend * y * nz
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
