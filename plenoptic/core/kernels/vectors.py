"""Points and vectors inside kernels: tuples (x, y, z), which cost nothing."""

from __future__ import annotations

import math

from plenoptic.core.numba.jit import device


@device
def add(a, b):
    """Sum a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@device
def sub(a, b):
    """Difference a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@device
def scale(a, factor):
    """The vector times a number."""
    return a[0] * factor, a[1] * factor, a[2] * factor


@device
def dot(a, b):
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@device
def cross(a, b):
    """Vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@device
def vector(array, first):
    """Three numbers of a one-dimensional array, from `first` on."""
    return array[first], array[first + 1], array[first + 2]


@device
def row_vector(rows, i, first):
    """Three numbers of row i, from column `first` on, without a view, whose reference counting costs time."""
    return rows[i, first], rows[i, first + 1], rows[i, first + 2]


@device
def fill_vector(rows, i, first, a):
    """Write a vector into row i, from column `first` on."""
    rows[i, first], rows[i, first + 1], rows[i, first + 2] = a[0], a[1], a[2]


@device
def negate(a):
    """Vector -a."""
    return -a[0], -a[1], -a[2]


@device
def absolute(a):
    """Absolute values of the components."""
    return abs(a[0]), abs(a[1]), abs(a[2])


@device
def frame_about(n):
    """Two unit vectors perpendicular to a unit normal (T. Duff et al., J. Comput. Graph. Tech. 6(1), 2017)."""
    sign = math.copysign(1.0, n[2])
    a = -1.0 / (sign + n[2])
    b = n[0] * n[1] * a
    return (1.0 + sign * n[0] * n[0] * a, sign * b, -sign * n[0]), (b, sign + n[1] * n[1] * a, -n[1])
