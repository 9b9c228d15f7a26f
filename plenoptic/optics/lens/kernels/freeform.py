"""Sag of an even asphere with a freeform term at one point, and its conditioning."""

from __future__ import annotations

import math

from plenoptic.core.kernels.ray_blocks import BLOCK, STATUS, X, Y, Z
from plenoptic.core.numba.jit import device
from plenoptic.optics.lens.kernels.conditioning_probes import ROUNDED_LENGTH, record_refraction, rounded_length
from plenoptic.optics.lens.kernels.first_crossing import EPS, height
from plenoptic.optics.lens.kernels.freeform_term import freeform_term_at
from plenoptic.optics.lens.lens_record import FIRST_TERM, ROUNDING


@device
def freeform_at(x, y, conic, aspheric, freeform):
    """Sag and its derivatives by x and y; `conic` is the curvature and 1 + k."""
    sag, by_r2 = height(x * x + y * y, conic, aspheric)
    added, dx, dy = freeform_term_at(x, y, freeform)
    return sag + added, 2.0 * by_r2 * x + dx, 2.0 * by_r2 * y + dy


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
