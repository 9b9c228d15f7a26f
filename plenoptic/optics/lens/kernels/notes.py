"""Records of rays at each element on request: amplification of errors, and steps to the intersection.

Rows of a log for one element and one block; nan for rays that did not come to the element (NEWTON and STEPS) or not
through it (the others):

    INCIDENCE   1 / cos of the angle of incidence
    REFRACTION  change of the angle of refraction by that of incidence
    REACH       mm: the lengths that rounding sees on the way to the point, added up
    NEWTON      steps of Newton's method on an asphere
    STEPS       steps of the search for the first crossing
"""

from __future__ import annotations

import math

from plenoptic.core.kernels.ray_blocks import BLOCK, STATUS, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device
from plenoptic.optics.lens.lens_record import FIRST_TERM

INCIDENCE, REFRACTION, REACH, NEWTON, STEPS, LOG = range(6)

ARRIVAL = 7
"""Rows of what is kept of a block before an element: point, direction, and how far along itself it has been moved."""

EPS = 2.220446049250313e-16


@device
def begin_arrival(arrival, ray):
    """Rays as they were given: how far ahead they will be moved to the point closest to the lens origin."""
    for i in range(BLOCK):
        arrival[6, i] = -(ray[X + i] * ray[L + i] + ray[Y + i] * ray[M + i] + ray[Z + i] * ray[N + i])


@device
def keep_arrival(arrival, log, ray):
    """Rays before an element, in its axes."""
    for row in range(6):
        for i in range(BLOCK):
            arrival[row, i] = ray[row * BLOCK + i]
    for i in range(BLOCK):
        met = 0.0 if ray[STATUS + i] == 0.0 else math.nan
        log[NEWTON, i] = met
        log[STEPS, i] = met
        log[INCIDENCE, i] = math.nan
        log[REFRACTION, i] = math.nan
        log[REACH, i] = math.nan


@device
def note_reach(arrival, i, point, terms, place):
    """From the vertex to where the ray came from, from there to the point, and the terms of the surface."""
    ahead = arrival[6, i]
    fx = arrival[0, i] - ahead * arrival[3, i]
    fy = arrival[1, i] - ahead * arrival[4, i]
    fz = arrival[2, i] - ahead * arrival[5, i]
    arrival[6, i] = 0.0
    way = math.hypot(math.hypot(point[0] - fx, point[1] - fy), point[2] - fz)
    return math.hypot(math.hypot(fx, fy), fz) + way + terms + place


@device
def note_refraction(log, arrival, i, normal, length, mu):
    """Incidence and refraction at a surface, with a normal of the given length."""
    cos_i = abs(normal[0] * arrival[3, i] + normal[1] * arrival[4, i] + normal[2] * arrival[5, i]) / length
    cos2_t = 1.0 - mu * mu * (1.0 - cos_i * cos_i)
    log[INCIDENCE, i] = 1.0 / cos_i
    log[REFRACTION, i] = mu * cos_i / math.sqrt(max(cos2_t, 0.0))


@device
def note_conic(log, arrival, ray, row, kz, index_ratios, place):
    """At a sphere, plane or conic; `kz` is 1 + k, `place` the distance from the lens origin that counts.

    An error e of the terms of c (x^2 + y^2 + (1 + k) z^2) - 2 z moves the surface by e over twice the normal's length.
    """
    c, mu = row.curvature, row.index_ratio
    for i in range(BLOCK):
        if ray[STATUS + i] != 0.0:
            continue
        x, y, z = ray[X + i], ray[Y + i], ray[Z + i]
        r2, nz = x * x + y * y, 1.0 - c * kz * z
        length = math.sqrt(c * c * r2 + nz * nz)
        terms = (abs(c) * (r2 + abs(kz) * z * z) + 2.0 * abs(z)) / (2.0 * length)
        log[REACH, i] = note_reach(arrival, i, (x, y, z), terms, place)
        note_refraction(log, arrival, i, (-c * x, -c * y, nz), length, mu if index_ratios is None else index_ratios[i])


@device
def note_asphere(log, arrival, ray, row, shape, index_ratios, place):
    """At an asphere; `shape` is 1 + k and its aspheric numbers.

    Its sag is a sum, and the root of 1 - (1 + k) c^2 r^2 in it is good to eps of 1.
    """
    c, mu, (kz, aspheric) = row.curvature, row.index_ratio, shape
    for i in range(BLOCK):
        if ray[STATUS + i] != 0.0:
            continue
        x, y, z = ray[X + i], ray[Y + i], ray[Z + i]
        r2 = x * x + y * y
        w = math.sqrt(max(1.0 - kz * c * c * r2, EPS))
        bend, change, sizes = 0.0, 0.0, 0.0
        for j in range(aspheric.size - 1, FIRST_TERM - 1, -1):
            change = change * r2 + bend
            bend = bend * r2 + aspheric[j]
            sizes = sizes * r2 + abs(aspheric[j])
        bend = 0.5 * c / w + (change * r2 + bend)
        length = math.sqrt(1.0 + 4.0 * bend * bend * r2)
        terms = (abs(z) + r2 * (abs(c) / (1.0 + w) * (1.0 + 0.5 / (w * (1.0 + w))) + sizes)) / length
        log[REACH, i] = note_reach(arrival, i, (x, y, z), terms, place)
        normal = (-2.0 * bend * x, -2.0 * bend * y, 1.0)
        note_refraction(log, arrival, i, normal, length, mu if index_ratios is None else index_ratios[i])


@device
def note_plane(log, arrival, ray, bends, place):
    """Record a stop, or (`bends`) an ideal lens: slopes change with the height, angles as cos'^2 / cos^2."""
    for i in range(BLOCK):
        if ray[STATUS + i] != 0.0:
            continue
        cos = abs(arrival[5, i])
        log[REACH, i] = note_reach(arrival, i, (ray[X + i], ray[Y + i], 0.0), 0.0, place)
        log[INCIDENCE, i] = 1.0 / cos
        log[REFRACTION, i] = (ray[N + i] / cos) ** 2 if bends else 1.0
