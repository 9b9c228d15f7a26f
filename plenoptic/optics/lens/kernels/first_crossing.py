"""Kernels: sag of an even asphere, and the search for the first intersection of a ray with it.

`conic` is the pair of curvature in 1/mm and 1 + k; `aspheric` and `freeform` are rows of `LensRecord`.
"""

from __future__ import annotations

import math

from plenoptic.core.kernels.ray_blocks import CLIPPED, MISSED, NOT_CONVERGED
from plenoptic.core.numba.jit import device
from plenoptic.optics.lens.kernels.freeform_term import freeform_second_bound, freeform_term_at
from plenoptic.optics.lens.lens_record import FIRST_TERM, ROUNDING, SHARPEST, TALLEST

MOST_STEPS = 400
"""Largest number of steps of one ray in the search for its first intersection; each has the largest safe length."""

EPS = 2.220446049250313e-16
TINY = 1e-300


@device
def height(r2, conic, aspheric):
    """Sag of an even asphere, and the derivative of the sag by r^2; nan beyond the equator of its conic."""
    c, kz = conic
    w = math.sqrt(1.0 - kz * c * c * r2)
    conic_factor = c / (w * (1.0 + w))
    terms = 0.0
    second_by_r2 = 0.0
    for j in range(aspheric.size - 1, FIRST_TERM - 1, -1):
        second_by_r2 = second_by_r2 * r2 + terms
        terms = terms * r2 + aspheric[j]
    return r2 * (conic_factor * w + terms), 0.5 * conic_factor * (1.0 + w) + (second_by_r2 * r2 + terms)


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

    Returns the distance along the ray in mm and a status. NOT_CONVERGED: limit of iterations. CLIPPED: the ray misses
    the cylinder or leaves it without an intersection. MISSED: the surface has no cylinder.
    """
    (x, y, z), (l, m, n) = point, direction
    if semi_diameter2 == math.inf:
        return 0.0, MISSED
    sin2 = l * l + m * m
    half = x * l + y * m
    discriminant = half * half - sin2 * (x * x + y * y - semi_diameter2)
    if not (discriminant > 0.0 or x * x + y * y <= semi_diameter2):
        return 0.0, CLIPPED
    root = math.sqrt(max(discriminant, 0.0))
    begin = (-half - root) / sin2 if sin2 > 0.0 else -math.inf
    end = (-half + root) / sin2 if sin2 > 0.0 else math.inf
    # A ray nearly parallel to the axis leaves the cylinder far away: limit it by the largest sag.
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
def _second_derivative_ahead(r, half, sin2, conic, aspheric, semi_diameter2):
    """Look-ahead length, bound on the second derivative of the sag along the ray within it, and largest r^2 within it.

    The second derivative along a ray is at most sin^2 times that by r, since sag' / r is a mean of the latter. The
    bounds of conic and polynomial are largest at the largest r. For a ray towards the axis, this is its present r, and
    the length ends where it reaches that r again; for a ray away from the axis, the length is half the rest to the rim.
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
    """Safe step for a gap with a closing rate `rate` that changes by at most `sharp` per unit of length."""
    root = math.sqrt(rate * rate + 2.0 * sharp * gap)
    return 2.0 * gap / (rate + root) if rate > 0.0 else (root - rate) / sharp


@device
def _climb(bounds, ray, conic, aspheric, freeform, semi_diameter2, s, steps):
    """Step between the bounds to the first upward zero crossing of f = s (z - sag).

    With g = f' and M a bound on |f''|, f + g h + M h^2 / 2 is an upper bound of f. A step to its zero skips no
    intersection, and near a simple root it is Newton's step. A ray that starts above the surface first descends in the
    same way, then steps on by -g / M, where f < 0 for certain. M is the look-ahead bound or that of the whole surface,
    whichever allows the longer step.
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
        # The derivative of the sag is infinite at the equator.
        r2 = min(px * px + py * py, semi_diameter2 * (1.0 - 16.0 * EPS))
        half = px * l + py * m
        sag, sag_by_r2 = height(r2, conic, aspheric)
        f = s * (pz - sag)
        g = s * (n - 2.0 * sag_by_r2 * half)
        close = EPS * (abs(px) + abs(py) + abs(pz)) + TINY
        rounding = _rounding(r2, pz, conic, aspheric)
        ahead, sharp, farthest2 = _second_derivative_ahead(math.sqrt(r2), half, sin2, conic, aspheric, semi_diameter2)
        if freeform is not None:
            added, dx, dy = freeform_term_at(px, py, freeform)
            f -= s * added
            g -= s * (dx * l + dy * m)
            rounding += freeform[ROUNDING] + EPS * abs(added)
            sharp += sin2 * freeform_second_bound(farthest2, freeform)
        if abs(f) <= rounding:
            if below or g > 0.0:
                return t, 0.0
            step = max(min(-g / sharp, ahead), -g / whole)
        else:
            if below and f > 0.0:
                # Only rounding errors lead past the zero of an upper bound.
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
