"""Cubic convolution: interpolation weights."""

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
