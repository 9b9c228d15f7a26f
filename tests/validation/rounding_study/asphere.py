"""First crossing of a ray with an even asphere: found in float64, refined by Newton's method with many digits."""

import numpy as np
from mpmath import mp

SCAN = 2048
"""Parts of a ray's way through the clear cylinder of an asphere in which a change of sign is looked for."""

BESIDE = 1e-6
"""Error of a float64 root, in mm and as a share of the distance: at a tangent the root of eps."""

CLOSER, ZOOMS = 32, 8
"""Parts and number of the zooms around a near miss: 16^8 is 4e9."""

POLISH = 40
"""Most Newton steps. Each doubles the digits, but at a tangent, where it adds one bit."""


def first_crossing(surface, p, d, sign):
    """Distance of the first crossing in the clear cylinder at which sign (z - sag) rises from below 0; or None.

    p, d: point of the ray, from the vertex, in mm, and its unit direction; sign is 1 towards the sensor.
    """
    nearest = -(p @ d)
    start = p + d * nearest
    span = _span(surface, start, d)
    if span is None:
        return None
    for rough in _rises(surface, start.astype(float), d.astype(float), span, sign):
        t = _refine(surface, start, d, sign, rough)
        if t is not None:
            return nearest + t
    return None


def _refine(surface, p, d, sign, rough):
    """Crossing next to one of float64; None where float64 took the top of a hill for one."""
    t, close = mp.mpf(rough), mp.mpf(10) ** (8 - mp.dps)
    for _ in range(POLISH):
        point = p + d * t
        sag, by_r2, _ = exact_sag(surface, point)
        slope = d[2] - 2 * by_r2 * (point[0] * d[0] + point[1] * d[1])
        step = (point[2] - sag) / slope if slope != 0 else mp.inf
        t -= step
        if abs(t - rough) > BESIDE * (1 + abs(t)):
            return None
        if abs(step) <= close * (1 + abs(t)):
            return t if sign * slope > 0 else None
    return None


def exact_sag(surface, point):
    """Sag over the x and y of a point, and its first and second derivatives by r^2."""
    c, squash = 1 / mp.mpf(surface.radius), 1 + mp.mpf(surface.conic)
    r2 = point[0] ** 2 + point[1] ** 2
    w = mp.sqrt(1 - squash * c * c * r2)
    sag = [c * r2 / (1 + w), c / (2 * w), c**3 * squash / (4 * w**3)]
    for n, a in enumerate(map(mp.mpf, surface.aspheric), start=1):
        sag[0] += a * r2**n
        sag[1] += n * a * r2 ** (n - 1)
        sag[2] += n * (n - 1) * a * r2 ** max(n - 2, 0)
    return sag


def _span(surface, p, d):
    """Distances at which a ray enters and leaves the part of the clear cylinder in which the surface lies; or None."""
    tallest = 1.01 * float(np.abs(surface.sag(np.linspace(0, surface.semi_diameter, 1001))).max()) + 1e-300
    begin, end = -mp.inf, mp.inf
    if d[2] != 0:
        begin, end = sorted([(-tallest - p[2]) / d[2], (tallest - p[2]) / d[2]])
    sin2 = d[0] ** 2 + d[1] ** 2
    half, outside = p[0] * d[0] + p[1] * d[1], p[0] ** 2 + p[1] ** 2 - mp.mpf(surface.semi_diameter) ** 2
    if sin2 > 0:
        root2 = half * half - sin2 * outside
        if root2 < 0:
            return None
        begin, end = max(begin, (-half - mp.sqrt(root2)) / sin2), min(end, (-half + mp.sqrt(root2)) / sin2)
    elif outside > 0:
        return None
    return (float(begin), float(end)) if begin < end else None


def _rises(surface, p, d, span, sign):
    """Distances from p at which the ray seems to come from below the surface to above it, in float64."""

    def above(t):
        r = np.minimum(np.hypot(p[0] + t * d[0], p[1] + t * d[1]), surface.semi_diameter)
        return np.asarray(sign * (p[2] + t * d[2] - surface.sag(r)))

    t = np.linspace(*span, SCAN + 1)
    height = above(t)
    # A hill below 0, or a valley above it, may cross 0 twice between three samples.
    size, side = np.abs(height), height > 0
    alike = (side[:-2] == side[1:-1]) & (side[1:-1] == side[2:])
    hills = 1 + np.flatnonzero(alike & (size[1:-1] <= size[:-2]) & (size[1:-1] <= size[2:]))
    # Near the vertex at all scales: a ray along the vertex plane crosses twice within any distance.
    close = np.geomspace(1e-300, 1.0, 301) * max(map(abs, span))
    close = np.clip(np.concatenate([-close, close]), *span)
    t = np.sort(np.concatenate([t, close, *(_zoom(above, t[i - 1], t[i + 1]) for i in hills)]))
    height = above(t)
    for i in np.flatnonzero((height[:-1] <= 0) & (height[1:] > 0)):
        low, high = float(t[i]), float(t[i + 1])
        while low < (middle := 0.5 * (low + high)) < high:
            low, high = (low, middle) if above(np.array([middle]))[0] > 0 else (middle, high)
        yield low


def _zoom(above, low, high):
    """Distances around the one at which a ray comes closest to the surface, the closer the denser."""
    distances = []
    for _ in range(ZOOMS):
        t = np.linspace(low, high, CLOSER + 1)
        distances.append(t)
        nearest = int(np.abs(above(t)).argmin())
        low, high = float(t[max(nearest - 1, 0)]), float(t[min(nearest + 1, CLOSER)])
    return np.concatenate(distances)
