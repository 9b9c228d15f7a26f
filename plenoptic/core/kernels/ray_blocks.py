"""Memory layout of a bundle of rays.

A bundle is an array of blocks of `BLOCK` rays; in a block, the eight fields of a ray (position, direction, weight,
status) are eight consecutive rows. All rays of a block pass one element before the next one: the inner loops have a
fixed length, no branch and no calls, so that the compiler vectorises them, and a ray's result does not depend on its
neighbours.

A status is 0 for a ray that is not lost and otherwise `cause + CAUSES * (element + 1)`; the first cause stays. The
numbers of a lost ray are computed on, without meaning.
"""

from __future__ import annotations

BLOCK = 256
"""Rays in a block. Its 8 rows of 256 float64 are 16 KiB: half a first-level cache."""

X, Y, Z, L, M, N, WEIGHT, STATUS = (row * BLOCK for row in range(8))
RAY = 8 * BLOCK
"""Length of a block in float64."""

CAUSES = 8
MISSED, CLIPPED, TOTAL_REFLECTION, NOT_FINITE, OUTSIDE_MICROLENS, NOT_CONVERGED = 1.0, 2.0, 3.0, 4.0, 5.0, 6.0
BENT_IN = 7.0
