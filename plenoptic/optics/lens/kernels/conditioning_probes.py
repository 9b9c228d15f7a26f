"""Conditioning probes: optional records of error amplification and iteration counts at each element.

Rows of `probes` for one element and one block. NEWTON and STEPS are nan for rays that do not reach the element, the
other rows for rays that do not pass it:

    INCIDENCE       1 / cos of the angle of incidence
    REFRACTION      derivative of the angle of refraction by the angle of incidence
    ROUNDED_LENGTH  sum of all lengths in mm whose rounding errors enter the intersection
    NEWTON          iterations of Newton's method on an asphere
    STEPS           steps of the search for the first intersection
"""

from __future__ import annotations

import math

from plenoptic.core.kernels.ray_blocks import BLOCK, STATUS, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device
from plenoptic.optics.lens.lens_record import FIRST_TERM

INCIDENCE, REFRACTION, ROUNDED_LENGTH, NEWTON, STEPS, PROBE_ROWS = range(6)

INCIDENT_ROWS = 7
"""Rows of a block's incident rays at an element: point (3), direction (3), distance along the ray already moved in
mm."""

EPS = 2.220446049250313e-16


@device
def init_incident(incident, ray):
    """Store the distance in mm from the origin of each input ray to its point closest to the lens origin."""
    for i in range(BLOCK):
        incident[6, i] = -(ray[X + i] * ray[L + i] + ray[Y + i] * ray[M + i] + ray[Z + i] * ray[N + i])


@device
def store_incident(incident, probes, ray):
    """Store the rays incident on an element, in its axes, and reset its probes."""
    for row in range(6):
        for i in range(BLOCK):
            incident[row, i] = ray[row * BLOCK + i]
    for i in range(BLOCK):
        unreached = 0.0 if ray[STATUS + i] == 0.0 else math.nan
        probes[NEWTON, i] = unreached
        probes[STEPS, i] = unreached
        probes[INCIDENCE, i] = math.nan
        probes[REFRACTION, i] = math.nan
        probes[ROUNDED_LENGTH, i] = math.nan


@device
def rounded_length(incident, i, point, terms, origin_distance):
    """Sum of rounded lengths in mm: vertex to ray origin, origin to intersection, surface terms, and
    `origin_distance`."""
    ahead = incident[6, i]
    fx = incident[0, i] - ahead * incident[3, i]
    fy = incident[1, i] - ahead * incident[4, i]
    fz = incident[2, i] - ahead * incident[5, i]
    incident[6, i] = 0.0
    travel = math.hypot(math.hypot(point[0] - fx, point[1] - fy), point[2] - fz)
    return math.hypot(math.hypot(fx, fy), fz) + travel + terms + origin_distance


@device
def record_refraction(probes, incident, i, normal, length, mu):
    """Record incidence and refraction at a surface, from its normal and the length of that normal."""
    cos_i = abs(normal[0] * incident[3, i] + normal[1] * incident[4, i] + normal[2] * incident[5, i]) / length
    cos2_t = 1.0 - mu * mu * (1.0 - cos_i * cos_i)
    probes[INCIDENCE, i] = 1.0 / cos_i
    probes[REFRACTION, i] = mu * cos_i / math.sqrt(max(cos2_t, 0.0))


@device
def record_conic(probes, incident, ray, row, kz, index_ratios, origin_distance):
    """Record the conditioning at a sphere, plane or conic.

    `kz` is 1 + k; `origin_distance` in mm is the distance of the vertex from the lens origin at the end elements, else
    0. An error e in c (x^2 + y^2 + (1 + k) z^2) - 2 z displaces the surface by e over twice the length of the normal.
    """
    c, mu = row.curvature, row.index_ratio
    for i in range(BLOCK):
        if ray[STATUS + i] != 0.0:
            continue
        x, y, z = ray[X + i], ray[Y + i], ray[Z + i]
        r2, nz = x * x + y * y, 1.0 - c * kz * z
        length = math.sqrt(c * c * r2 + nz * nz)
        terms = (abs(c) * (r2 + abs(kz) * z * z) + 2.0 * abs(z)) / (2.0 * length)
        probes[ROUNDED_LENGTH, i] = rounded_length(incident, i, (x, y, z), terms, origin_distance)
        record_refraction(
            probes, incident, i, (-c * x, -c * y, nz), length, mu if index_ratios is None else index_ratios[i]
        )


@device
def record_asphere(probes, incident, ray, row, shape, index_ratios, origin_distance):
    """Record the conditioning at an asphere; `shape` is the pair of 1 + k and its aspheric numbers.

    The square root of 1 - (1 + k) c^2 r^2 in its sag has a rounding error of eps.
    """
    c, mu, (kz, aspheric) = row.curvature, row.index_ratio, shape
    for i in range(BLOCK):
        if ray[STATUS + i] != 0.0:
            continue
        x, y, z = ray[X + i], ray[Y + i], ray[Z + i]
        r2 = x * x + y * y
        w = math.sqrt(max(1.0 - kz * c * c * r2, EPS))
        sag_by_r2, second_by_r2, term_sum = 0.0, 0.0, 0.0
        for j in range(aspheric.size - 1, FIRST_TERM - 1, -1):
            second_by_r2 = second_by_r2 * r2 + sag_by_r2
            sag_by_r2 = sag_by_r2 * r2 + aspheric[j]
            term_sum = term_sum * r2 + abs(aspheric[j])
        sag_by_r2 = 0.5 * c / w + (second_by_r2 * r2 + sag_by_r2)
        length = math.sqrt(1.0 + 4.0 * sag_by_r2 * sag_by_r2 * r2)
        terms = (abs(z) + r2 * (abs(c) / (1.0 + w) * (1.0 + 0.5 / (w * (1.0 + w))) + term_sum)) / length
        probes[ROUNDED_LENGTH, i] = rounded_length(incident, i, (x, y, z), terms, origin_distance)
        normal = (-2.0 * sag_by_r2 * x, -2.0 * sag_by_r2 * y, 1.0)
        record_refraction(probes, incident, i, normal, length, mu if index_ratios is None else index_ratios[i])


@device
def record_plane(probes, incident, ray, is_ideal, origin_distance):
    """Record the conditioning at a stop, or at an ideal lens, which changes angles by cos'^2 / cos^2."""
    for i in range(BLOCK):
        if ray[STATUS + i] != 0.0:
            continue
        cos = abs(incident[5, i])
        probes[ROUNDED_LENGTH, i] = rounded_length(incident, i, (ray[X + i], ray[Y + i], 0.0), 0.0, origin_distance)
        probes[INCIDENCE, i] = 1.0 / cos
        probes[REFRACTION, i] = (ray[N + i] / cos) ** 2 if is_ideal else 1.0
