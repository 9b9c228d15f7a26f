"""Rays through one conic or one even asphere: the kernels that spherical lenses do without."""

from __future__ import annotations

import math

from plenoptic._jit import device
from plenoptic.optics._blocks import (
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

NEWTON_STEPS = 12
"""Steps that all rays of a block may take together; those that need more are looked at one by one."""

PIECES = 32
"""Parts of a ray's way through the clear cylinder that are searched for its first crossing."""

MOST_STEPS = 100
"""Iterations that one ray may take in the end: bisection alone needs some 60."""

EPS = 2.220446049250313e-16
TINY = 1e-300
AT_VERTEX = 1e-20
"""How far from the surface, over its largest sag, a point may be at its vertex."""

STEEPEST, SHARPEST, TALLEST, FIRST_TERM = range(4)
"""Where a row of aspheric numbers has the largest slope, second derivative and sag inside the semi-diameter, and where
its coefficients begin."""


@device
def refract_conic_block(ray, c, conic, mu, clear, rim, s, code):
    """Through one conic: as `refract_block`, with the factor 1 + k where z is squared.

    The normal (-c x, -c y, 1 - c (1 + k) z) has the squared length 1 - k c^2 (x^2 + y^2).
    """
    bend = 1.0 - mu * mu
    kz = 1.0 + conic
    for i in range(BLOCK):
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
        t = (f if along else g - s * q) / (g + s * q if along else quadratic)
        x += t * l
        y += t * m
        z += t * n
        r2 = x * x + y * y
        steep2 = 1.0 - conic * c * c * r2
        per_length = 1.0 / math.sqrt(max(steep2, 0.0))
        cos_i = q * per_length
        cos2 = 1.0 - mu * mu * (1.0 - cos_i * cos_i)
        cos_t = math.sqrt(max(cos2, 0.0))
        a = s * (bend / (cos_t + mu * cos_i)) * per_length
        ac = a * c
        ray[X + i] = x
        ray[Y + i] = y
        ray[Z + i] = z
        ray[L + i] = mu * l - ac * x
        ray[M + i] = mu * m - ac * y
        ray[N + i] = mu * n + (a - ac * kz * z)
        lost = 0.0 if cos2 >= 0.0 else code + TOTAL_REFLECTION
        lost = lost if r2 <= clear else code + CLIPPED
        lost = lost if r2 < math.inf else code + NOT_FINITE
        lost = code + MISSED if q2 < 0.0 or c * kz * z > rim else lost
        was = ray[STATUS + i]
        ray[STATUS + i] = was if was != 0.0 else lost


@device
def height(r2, c, kz, aspheric):
    """Sag of an even asphere, and the derivative of the sag by r^2; nan beyond the equator of its conic."""
    w = math.sqrt(1.0 - kz * c * c * r2)
    share = c / (w * (1.0 + w))
    terms = 0.0
    change = 0.0
    for j in range(aspheric.size - 1, FIRST_TERM - 1, -1):
        change = change * r2 + terms
        terms = terms * r2 + aspheric[j]
    return r2 * (share * w + terms), 0.5 * share * (1.0 + w) + (change * r2 + terms)


@device
def _rounding(r2, z, c, kz, aspheric):
    """What rounding may leave of z - sag: eps times the sum of the sizes of all terms."""
    size = 0.0
    for j in range(aspheric.size - 1, FIRST_TERM - 1, -1):
        size = size * r2 + abs(aspheric[j])
    return EPS * (abs(z) + r2 * (abs(c) / (1.0 + math.sqrt(1.0 - kz * c * c * r2)) + size)) + TINY


@device
def _first_crossing(x, y, z, l, m, n, c, kz, aspheric, clear, s):
    """Where a ray first crosses the surface within the clear cylinder, going the way of the stack.

    Returns the distance along the ray and a status: NOT_CONVERGED where the limit of iterations is reached, CLIPPED
    where the ray does not come into the cylinder or passes it without a crossing, MISSED where there is no cylinder.
    """
    if clear == math.inf:
        return 0.0, MISSED
    sin2 = l * l + m * m
    half = x * l + y * m
    apart = half * half - sin2 * (x * x + y * y - clear)
    if not (apart > 0.0 or x * x + y * y <= clear):
        return 0.0, CLIPPED
    root = math.sqrt(max(apart, 0.0))
    begin = (-half - root) / sin2 if sin2 > 0.0 else -math.inf
    end = (-half + root) / sin2 if sin2 > 0.0 else math.inf
    # A ray nearly along the axis leaves the cylinder far away: the surface lies within its own largest sag.
    tall = aspheric[TALLEST] + TINY
    if n != 0.0:
        near, far = (-tall - z) / n, (tall - z) / n
        begin, end = max(begin, min(near, far)), min(end, max(near, far))
    if not begin <= end:
        return 0.0, CLIPPED
    # The surface is crossed where s f goes from below 0 to above.
    low = begin
    f_low = s * _distance(low, x, y, z, l, m, n, c, kz, aspheric, clear)
    pieces = 1 if abs(n) > aspheric[STEEPEST] * math.sqrt(sin2) else PIECES
    for j in range(1, pieces + 1):
        high = begin + (end - begin) * (j / pieces)
        f_high = s * _distance(high, x, y, z, l, m, n, c, kz, aspheric, clear)
        if f_low <= 0.0 <= f_high:
            return _bracketed(low, high, x, y, z, l, m, n, c, kz, aspheric, clear, s)
        low, f_low = high, f_high
    return 0.0, CLIPPED


@device
def _distance(t, x, y, z, l, m, n, c, kz, aspheric, clear):
    """Height over the surface of a point of a ray inside the clear cylinder, whose rim it may miss by rounding."""
    x, y = x + t * l, y + t * m
    sag, _ = height(min(x * x + y * y, clear), c, kz, aspheric)
    return (z + t * n) - sag


@device
def _bracketed(low, high, x, y, z, l, m, n, c, kz, aspheric, clear, s):
    """Newton's method that halves its bracket where a step would leave it."""
    t = 0.5 * (low + high)
    for _ in range(MOST_STEPS):
        px, py, pz = x + t * l, y + t * m, z + t * n
        r2 = min(px * px + py * py, clear)
        sag, bend = height(r2, c, kz, aspheric)
        f = s * (pz - sag)
        if f > 0.0:
            high = t
        else:
            low = t
        step = -f / (s * (n - 2.0 * bend * (px * l + py * m)))
        close = EPS * (abs(px) + abs(py) + abs(pz)) + TINY
        done = abs(step) <= close or abs(f) <= _rounding(r2, pz, c, kz, aspheric) or high - low <= close
        if done or t + step == t:
            return t, 0.0
        t = t + step if low < t + step < high else 0.5 * (low + high)
    return t, NOT_CONVERGED


@device
def _to_conic_of_asphere(ray, c, kz):
    """Move rays to the crossing of the asphere's conic, or to their closest approach where there is none."""
    for i in range(BLOCK):
        x, y, z = ray[X + i], ray[Y + i], ray[Z + i]
        l, m, n = ray[L + i], ray[M + i], ray[N + i]
        e = -(x * l + y * m + z * n)
        x += e * l
        y += e * m
        z += e * n
        f = c * (x * x + y * y + kz * z * z) - 2.0 * z
        g = n - c * (x * l + y * m + kz * z * n)
        q2 = g * g - c * (1.0 + (kz - 1.0) * n * n) * f
        t = f / (g + math.copysign(math.sqrt(max(q2, 0.0)), g))
        t = t if q2 >= 0.0 and c * kz * (z + t * n) < 1.0 else 0.0
        ray[X + i] = x + t * l
        ray[Y + i] = y + t * m
        ray[Z + i] = z + t * n


@device
def _fill_heights(heights, ray, c, kz, aspheric):
    """`height` for all rays of a block: rows of its sag and its derivative. Term by term, so that loops are vectors."""
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
def _newton(ray, heights, c, kz, aspheric, clear):
    """Newton's method for all rays of a block together, until the next step would be below rounding."""
    sharpest = aspheric[SHARPEST]
    for _ in range(NEWTON_STEPS):
        _fill_heights(heights, ray, c, kz, aspheric)
        far = 0
        for i in range(BLOCK):
            x, y, z = ray[X + i], ray[Y + i], ray[Z + i]
            l, m, n = ray[L + i], ray[M + i], ray[N + i]
            slope = n - 2.0 * heights[1, i] * (x * l + y * m)
            step = (heights[0, i] - z) / slope
            # What a step leaves: its square times half the curvature of z - sag along the ray, over the slope.
            left = 0.5 * sharpest * step * step - EPS * abs(slope) * (abs(x) + abs(y) + abs(z))
            # Rays that are lost, outside the clear cylinder or without a height there wait for their turn.
            going = ray[STATUS + i] == 0.0 and x * x + y * y <= clear and step - step == 0.0
            step = step if going else 0.0
            ray[X + i] = x + step * l
            ray[Y + i] = y + step * m
            ray[Z + i] = z + step * n
            far += 1 if going and left > 0.0 else 0
        if far == 0:
            return


@device
def _settle(ray, heights, c, kz, aspheric, clear, s, code):
    """Look at the rays one by one for which Newton's method did not surely find the first crossing.

    It did where the point lies on the surface, in the clear cylinder, and the ray can cross only once.
    """
    _fill_heights(heights, ray, c, kz, aspheric)
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
        alone = n * n > steepest2 * (l * l + m * m) or clear == math.inf
        settled = close and x * x + y * y <= clear and s * slope > 0.0 and alone
        heights[0, i] = 1.0 if settled or ray[STATUS + i] != 0.0 else 0.0
        unsettled += 0 if settled or ray[STATUS + i] != 0.0 else 1
    if unsettled == 0:
        return
    for i in range(BLOCK):
        if heights[0, i] == 1.0:
            continue
        x, y, z = ray[X + i], ray[Y + i], ray[Z + i]
        l, m, n = ray[L + i], ray[M + i], ray[N + i]
        e = -(x * l + y * m + z * n)
        x, y, z = x + e * l, y + e * m, z + e * n
        t, lost = _first_crossing(x, y, z, l, m, n, c, kz, aspheric, clear, s)
        ray[X + i] = x + t * l
        ray[Y + i] = y + t * m
        ray[Z + i] = z + t * n
        _, heights[1, i] = height(ray[X + i] ** 2 + ray[Y + i] ** 2, c, kz, aspheric)
        if lost != 0.0:
            finite = x - x == 0.0 and y - y == 0.0 and z - z == 0.0
            ray[STATUS + i] = code + (lost if finite else NOT_FINITE)


@device
def refract_asphere_block(ray, heights, c, conic, aspheric, mu, clear, s, code):
    """Through one even asphere; `aspheric` as in `LensTables`, `heights` (2, BLOCK) to work in.

    A ray steeper against the vertex plane than the surface is anywhere crosses it at most once, and the crossing that
    Newton's method finds is that one. All others are searched for their first crossing inside the semi-diameter.
    """
    kz = 1.0 + conic
    bend_index = 1.0 - mu * mu
    _to_conic_of_asphere(ray, c, kz)
    _newton(ray, heights, c, kz, aspheric, clear)
    _settle(ray, heights, c, kz, aspheric, clear, s, code)
    for i in range(BLOCK):
        x, y = ray[X + i], ray[Y + i]
        l, m, n = ray[L + i], ray[M + i], ray[N + i]
        bend = heights[1, i]
        r2 = x * x + y * y
        nz = 1.0 / math.sqrt(1.0 + 4.0 * bend * bend * r2)
        nx, ny = -2.0 * bend * x * nz, -2.0 * bend * y * nz
        cos_i = s * (nx * l + ny * m + nz * n)
        cos2 = 1.0 - mu * mu * (1.0 - cos_i * cos_i)
        cos_t = math.sqrt(max(cos2, 0.0))
        a = s * (bend_index / (cos_t + mu * cos_i))
        ray[L + i] = mu * l + a * nx
        ray[M + i] = mu * m + a * ny
        ray[N + i] = mu * n + a * nz
        lost = 0.0 if cos2 >= 0.0 else code + TOTAL_REFLECTION
        lost = lost if r2 < math.inf else code + NOT_FINITE
        was = ray[STATUS + i]
        ray[STATUS + i] = was if was != 0.0 else lost
