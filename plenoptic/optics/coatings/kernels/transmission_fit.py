"""Kernel: light that a lens transmits, by the polynomial of a `TransmissionFit`."""

from __future__ import annotations

import numpy as np

from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device, kernel


@kernel
def fill_fitted_transmission(blocks, fit, waves):
    """Multiply the weights of rays behind the lens, in its axes, by its transmittance; rays are not traced.

    Horner's scheme in three variables, whose sums are rows 3 to 5 of a workspace; loops over rays are vectorised.
    `waves` are rows of the fit's factors, or None for a fit without.
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
        if waves is None:
            _fill_polynomial(work, fit.coefficients[0], fit.degree)
            work[6] = work[5]
        else:
            for i in range(BLOCK):
                work[6, i] = fit.factors[waves[b * BLOCK + i], 0]
            for part in range(fit.coefficients.shape[0]):
                _fill_polynomial(work, fit.coefficients[part], fit.degree)
                for i in range(BLOCK):
                    work[6, i] += fit.factors[waves[b * BLOCK + i], part + 1] * work[5, i]
        for i in range(BLOCK):
            ray[WEIGHT + i] = ray[WEIGHT + i] * work[6, i] if ray[WEIGHT + i] > 0.0 else 0.0


@device
def _fill_polynomial(work, coefficients, degree):
    """Fill row 5 with the polynomial in the variables of rows 0 to 2."""
    term = 0
    work[5] = 0.0
    for k in range(degree, -1, -1):
        work[4] = 0.0
        for j in range(degree - k, -1, -1):
            work[3] = coefficients[term]
            term += 1
            for _ in range(degree - k - j):
                coefficient = coefficients[term]
                term += 1
                for i in range(BLOCK):
                    work[3, i] = work[3, i] * work[0, i] + coefficient
            for i in range(BLOCK):
                work[4, i] = work[4, i] * work[1, i] + work[3, i]
        for i in range(BLOCK):
            work[5, i] = work[5, i] * work[2, i] + work[4, i]
