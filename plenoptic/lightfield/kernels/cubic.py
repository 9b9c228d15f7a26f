"""Cubic convolution: interpolation weights, and interpolation along a row."""

from plenoptic.core.numba.jit import device


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
def lagrange_weights(t):
    """Weights of the cubic through four pixels at a fraction t from the second, and their derivatives.

    Its error is of fourth order and hardly shifts smooth waves; that of cubic convolution is of third order, and does.
    """
    r, s, u = t + 1.0, t - 1.0, t - 2.0
    return (
        (-t * s * u / 6.0, r * s * u / 2.0, -r * t * u / 2.0, r * t * s / 6.0),
        (t - t * t / 2.0 - 1.0 / 3.0, 1.5 * t * t - 2.0 * t - 0.5, 1.0 + t - 1.5 * t * t, t * t / 2.0 - 1.0 / 6.0),
    )


@device
def interpolate_row(values, row, column, weights):
    """Weighted sum of the four pixels from column - 1 to column + 2 of a row."""
    return (
        weights[0] * values[row, column - 1]
        + weights[1] * values[row, column]
        + weights[2] * values[row, column + 1]
        + weights[3] * values[row, column + 2]
    )
