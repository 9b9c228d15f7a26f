"""What is noted of rays at each element on request: how much it magnifies errors, and how hard it was to meet.

Rows of `told` for one element and one block; nan for rays that did not come to the element (NEWTON and STEPS) or not
through it (the others):

    INCIDENCE   1 / cos of the angle of incidence
    REFRACTION  change of the angle of refraction by that of incidence
    REACH       mm: the lengths that rounding sees on the way to the point, added up
    NEWTON      steps of Newton's method on an asphere
    STEPS       steps of the search for the first crossing
"""

from __future__ import annotations

import math

from plenoptic.core.jit import device
from plenoptic.core.kernels.ray_blocks import BLOCK, STATUS, L, M, N, X, Y, Z

INCIDENCE, REFRACTION, REACH, NEWTON, STEPS, TOLD = range(6)

CAME = 7
"""Rows of what is kept of a block before an element: point, direction, and how far along itself it has been moved."""

EPS = 2.220446049250313e-16
_FIRST_TERM = 3


@device
def begin_way(came, ray):
    """Rays as they were given: how far ahead they will be moved to the point closest to the lens origin."""
    for i in range(BLOCK):
        came[6, i] = -(ray[X + i] * ray[L + i] + ray[Y + i] * ray[M + i] + ray[Z + i] * ray[N + i])


@device
def keep_way(came, told, ray):
    """Rays before an element, in its axes."""
    for row in range(6):
        for i in range(BLOCK):
            came[row, i] = ray[row * BLOCK + i]
    for i in range(BLOCK):
        met = 0.0 if ray[STATUS + i] == 0.0 else math.nan
        told[NEWTON, i] = met
        told[STEPS, i] = met
        told[INCIDENCE, i] = math.nan
        told[REFRACTION, i] = math.nan
        told[REACH, i] = math.nan


@device
def _reach(came, i, x, y, z, terms, place):
    """From the vertex to where the ray came from, from there to the point (x, y, z), and the terms of the surface."""
    ahead = came[6, i]
    fx, fy, fz = came[0, i] - ahead * came[3, i], came[1, i] - ahead * came[4, i], came[2, i] - ahead * came[5, i]
    came[6, i] = 0.0
    way = math.hypot(math.hypot(x - fx, y - fy), z - fz)
    return math.hypot(math.hypot(fx, fy), fz) + way + terms + place


@device
def _note(told, came, i, nx, ny, nz, length, ratio):
    """Incidence and refraction at a surface of the normal (nx, ny, nz), whose length is `length`."""
    cos_i = abs(nx * came[3, i] + ny * came[4, i] + nz * came[5, i]) / length
    cos2_t = 1.0 - ratio * ratio * (1.0 - cos_i * cos_i)
    told[INCIDENCE, i] = 1.0 / cos_i
    told[REFRACTION, i] = ratio * cos_i / math.sqrt(max(cos2_t, 0.0))


@device
def note_conic(told, came, ray, c, kz, mu, mus, place):
    """At a sphere, plane or conic of curvature c; `kz` is 1 + k, `place` the distance from the lens origin that counts.

    An error e of the terms of c (x^2 + y^2 + (1 + k) z^2) - 2 z moves the surface by e over twice the normal's length.
    """
    for i in range(BLOCK):
        if ray[STATUS + i] != 0.0:
            continue
        x, y, z = ray[X + i], ray[Y + i], ray[Z + i]
        r2, nz = x * x + y * y, 1.0 - c * kz * z
        length = math.sqrt(c * c * r2 + nz * nz)
        terms = (abs(c) * (r2 + abs(kz) * z * z) + 2.0 * abs(z)) / (2.0 * length)
        told[REACH, i] = _reach(came, i, x, y, z, terms, place)
        _note(told, came, i, -c * x, -c * y, nz, length, mu if mus is None else mus[i])


@device
def note_asphere(told, came, ray, c, kz, aspheric, mu, mus, place):
    """At an asphere: its sag is a sum, and the root of 1 - (1 + k) c^2 r^2 in it is good to eps of 1."""
    for i in range(BLOCK):
        if ray[STATUS + i] != 0.0:
            continue
        x, y, z = ray[X + i], ray[Y + i], ray[Z + i]
        r2 = x * x + y * y
        w = math.sqrt(max(1.0 - kz * c * c * r2, EPS))
        bend, change, sizes = 0.0, 0.0, 0.0
        for j in range(aspheric.size - 1, _FIRST_TERM - 1, -1):
            change = change * r2 + bend
            bend = bend * r2 + aspheric[j]
            sizes = sizes * r2 + abs(aspheric[j])
        bend = 0.5 * c / w + (change * r2 + bend)
        length = math.sqrt(1.0 + 4.0 * bend * bend * r2)
        terms = (abs(z) + r2 * (abs(c) / (1.0 + w) * (1.0 + 0.5 / (w * (1.0 + w))) + sizes)) / length
        told[REACH, i] = _reach(came, i, x, y, z, terms, place)
        _note(told, came, i, -2.0 * bend * x, -2.0 * bend * y, 1.0, length, mu if mus is None else mus[i])


@device
def note_plane(told, came, ray, bends, place):
    """At a stop, or (`bends`) an ideal lens: slopes change by what the height says, angles as cos'^2 / cos^2."""
    for i in range(BLOCK):
        if ray[STATUS + i] != 0.0:
            continue
        cos = abs(came[5, i])
        told[REACH, i] = _reach(came, i, ray[X + i], ray[Y + i], 0.0, 0.0, place)
        told[INCIDENCE, i] = 1.0 / cos
        told[REFRACTION, i] = (ray[N + i] / cos) ** 2 if bends else 1.0
