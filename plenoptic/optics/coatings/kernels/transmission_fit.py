"""Kernel: light that a lens transmits, by the polynomial of a `TransmissionFit`."""

from __future__ import annotations

import numpy as np

from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device, kernel


@kernel
def fill_fitted_transmission(blocks, fit, waves):
    """Multiply the weights of rays behind the lens, in its axes, by its transmittance; rays are not traced.

    `waves` are rows of the fit's factors, or None for a fit with a single one. Loops over rays are vectorised.
    """
    work = np.empty((7, BLOCK))
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        for i in range(BLOCK):
            u, v = ray[L + i] / ray[N + i], ray[M + i] / ray[N + i]
            to_q, to_p = fit.z_q - ray[Z + i], fit.z_p - ray[Z + i]
            qx, qy = fit.per_q * (ray[X + i] + to_q * u), fit.per_q * (ray[Y + i] + to_q * v)
            px, py = fit.per_p * (ray[X + i] + to_p * u), fit.per_p * (ray[Y + i] + to_p * v)
            work[0, i] = qx * qx + qy * qy
            work[1, i] = px * qx + py * qy
            work[2, i] = px * px + py * py
            work[6, i] = fit.factors[0 if waves is None else waves[b * BLOCK + i], 0]
        first = 0
        for part in range(fit.degrees.size):
            first = _fill_polynomial(work, fit.coefficients, first, fit.degrees[part])
            for i in range(BLOCK):
                work[6, i] += fit.factors[0 if waves is None else waves[b * BLOCK + i], part + 1] * work[5, i]
        for i in range(BLOCK):
            ray[WEIGHT + i] = ray[WEIGHT + i] * work[6, i] if ray[WEIGHT + i] > 0.0 else 0.0


@device
def _fill_polynomial(work, coefficients, term, degree):
    """Fill row 5 with the polynomial in the variables of rows 0 to 2 whose coefficients begin at `term`.

    Horner's scheme in three variables, with sums in rows 3 to 5; four steps in the first variable are one loop. Returns
    the term behind the last one.
    """
    work[5] = 0.0
    for k in range(degree, -1, -1):
        work[4] = 0.0
        for j in range(degree - k, -1, -1):
            before = (degree - k - j) // 4
            if before > 0:
                work[3] = 0.0
            for _ in range(before):
                a, b, c, d = coefficients[term], coefficients[term + 1], coefficients[term + 2], coefficients[term + 3]
                term += 4
                for i in range(BLOCK):
                    x = work[0, i]
                    work[3, i] = (((work[3, i] * x + a) * x + b) * x + c) * x + d
            a, b, c, d = coefficients[term], coefficients[term + 1], coefficients[term + 2], coefficients[term + 3]
            term += 4
            if before > 0:
                for i in range(BLOCK):
                    x = work[0, i]
                    work[4, i] = work[4, i] * work[1, i] + ((((work[3, i] * x + a) * x + b) * x + c) * x + d)
            else:
                for i in range(BLOCK):
                    x = work[0, i]
                    work[4, i] = work[4, i] * work[1, i] + (((a * x + b) * x + c) * x + d)
        for i in range(BLOCK):
            work[5, i] = work[5, i] * work[2, i] + work[4, i]
    return term
