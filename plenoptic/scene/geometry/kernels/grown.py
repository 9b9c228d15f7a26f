"""Triangles as Embree gets them: a little larger than they are, so that no ray slips through between two of them."""

from __future__ import annotations

import math

from plenoptic.core.kernels.vectors import absolute, add, dot, fill_vector, row_vector, scale, sub, vector
from plenoptic.core.numba.jit import kernel

GROWTH = 2.0**-21
"""Outward displacement of edges over the largest coordinate of a triangle, or over the scene's median distance from its
middle if that is larger: eight times the rounding of float32, and half the offset of rays that leave surfaces."""

MOST_GROWTH = 2.0**-10
"""Its limit over the radius of the inscribed circle: margins stay near the edges in barycentric coordinates too."""


@kernel
def fill_grown(points, vertices, triangles, middle, typical):
    """Fill three rows of `points` (3 nt, 3), relative to the middle, for each triangle; `typical` is the scene's median
    distance from its middle. The displacement covers the rounding of float32 in Embree.

    All edges move outwards by the same length: the corners move away from the middle of the inscribed circle.
    """
    m = vector(middle, 0)
    for k in range(triangles.shape[0]):
        a = sub(row_vector(vertices, triangles[k, 0], 0), m)
        b = sub(row_vector(vertices, triangles[k, 1], 0), m)
        c = sub(row_vector(vertices, triangles[k, 2], 0), m)
        x, y, z = sub(c, b), sub(a, c), sub(b, a)
        opposite_a, opposite_b, opposite_c = math.sqrt(dot(x, x)), math.sqrt(dot(y, y)), math.sqrt(dot(z, z))
        perimeter = opposite_a + opposite_b + opposite_c
        # Heron's formula: the radius is the root of (s - a) (s - b) (s - c) / s with s half the perimeter.
        half = 0.5 * perimeter
        squared = (half - opposite_a) * (half - opposite_b) * (half - opposite_c)
        grown = 0.0
        if squared > 0.0:
            largest = max(typical, max(absolute(a)), max(absolute(b)), max(absolute(c)))
            grown = min(GROWTH * largest * math.sqrt(half / squared), MOST_GROWTH)
        over = grown / perimeter if perimeter > 0.0 else 0.0
        off = add(add(scale(a, opposite_a * over), scale(b, opposite_b * over)), scale(c, opposite_c * over))
        fill_vector(points, 3 * k, 0, sub(scale(a, 1.0 + grown), off))
        fill_vector(points, 3 * k + 1, 0, sub(scale(b, 1.0 + grown), off))
        fill_vector(points, 3 * k + 2, 0, sub(scale(c, 1.0 + grown), off))
