"""Cubic convolution and splines: interpolation weights."""

from plenoptic.core.numba.jit import device
from plenoptic.lightfield.matching.image_stack import SPLINE_POLE as Z

_COVARIANCE = tuple(3.0 * Z**n * (n + (1.0 + Z * Z) / (1.0 - Z * Z)) for n in range(4))
"""Covariance of B-spline coefficients that are n apart, of values with independent noise of variance 1."""


@device
def cubic_weights(t):
    """Weights of cubic convolution at a fraction t (R. G. Keys, 1981), and their derivatives."""
    u = 1.0 - t
    return (
        (
            -0.5 * t * u * u,
            1.0 - 2.5 * t * t + 1.5 * t * t * t,
            0.5 * t + 2.0 * t * t - 1.5 * t * t * t,
            -0.5 * t * t * u,
        ),
        (-0.5 * u * u + t * u, -5.0 * t + 4.5 * t * t, 0.5 + 4.0 * t - 4.5 * t * t, -t * u + 0.5 * t * t),
    )


@device
def spline_weights(t):
    """Weights of four coefficients of a cubic B-spline at a fraction t from the second, and their derivatives.

    Interpolation by splines blurs waves least: those of five pixels by 1 % halfway, where cubic convolution takes 5 %.
    """
    u = 1.0 - t
    return (
        (u * u * u / 6.0, 2.0 / 3.0 - t * t + 0.5 * t * t * t, 2.0 / 3.0 - u * u + 0.5 * u * u * u, t * t * t / 6.0),
        (-0.5 * u * u, -2.0 * t + 1.5 * t * t, 2.0 * u - 1.5 * u * u, 0.5 * t * t),
    )


@device
def spline_noise(a, b):
    """Covariance of two sums of coefficients with weights `a` and `b`, where values have independent noise."""
    total = 0.0
    for i in range(4):
        for k in range(4):
            total += a[i] * b[k] * _COVARIANCE[abs(i - k)]
    return total
