"""Ray transfer matrices for Gaussian optics.

They act on (height, index times angle) of a paraxial ray, from one element to another, so all have determinant 1.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from plenoptic.core.values import Floats, check_has, number
from plenoptic.errors import InvalidValueError
from plenoptic.optics.surfaces.surface import Surface

if TYPE_CHECKING:
    from plenoptic.optics.lens.stack import LensStack

_EPS = float(np.finfo(np.float64).eps)


def without_rounding(total: float, *terms: float, steps: int = 4) -> float:
    """`total`, or exactly 0 if it is within the rounding error of its terms."""
    return 0.0 if abs(total) <= 2 * steps * _EPS * sum(map(abs, terms)) else total


def over(numerator: float, denominator: float) -> float:
    """Quotient; inf if the denominator is 0."""
    return numerator / denominator if denominator != 0 else math.inf


def position(z: float, name: str) -> float:
    """Check that a position on the axis is a number; it may be infinite, but not nan."""
    z_mm = number(z, name)
    if math.isnan(z_mm):
        raise InvalidValueError(f"{name} is nan; it must be a position in mm, math.inf for infinity")
    return z_mm


def bending(lens: LensStack, indices: Floats, i: int) -> tuple[float, float]:
    """Step of the index, and curvature in 1/mm, for paraxial rays at element i; 0 for a stop.

    `indices` is the result of `LensStack.indices`. At a mirror the index changes its sign.
    """
    element, before, behind = lens.elements[i], float(indices[i]), float(indices[i + 1])
    if not isinstance(element, Surface):
        return behind - before, 0.0
    return element.signed_index(behind) - before, element.vertex_curvature


def end_surfaces(lens: LensStack) -> tuple[int, int]:
    """Indices of the first and the last surface of a lens."""
    check_has(lens, "lens", "LensStack", "camera.lens", "elements", "gap_media")
    surfaces = [i for i, element in enumerate(lens.elements) if isinstance(element, Surface)]
    return surfaces[0], surfaces[-1]


def transfer_matrix(lens: LensStack, wavelength: float, first: int, last: int) -> Floats:
    """Ray transfer matrix (2, 2) from before element `first` to behind element `last`: B in mm, C in 1/mm.

    Entries within rounding error of 0 are exactly 0.

    See E. Hecht, Optics, 5th ed., section 6.2.1 (with height first here).
    """
    n = lens.indices(wavelength)
    matrix, magnitude = np.eye(2), np.eye(2)
    for i in range(first, last + 1):
        gap = lens.elements[i].thickness if i < last else 0.0
        step_of_index, curvature = bending(lens, n, i)
        refraction = np.array([[1.0, 0.0], [-step_of_index * curvature, 1.0]])
        transfer = np.array([[1.0, gap / n[i + 1]], [0.0, 1.0]])
        step = transfer @ refraction
        matrix, magnitude = step @ matrix, np.abs(transfer) @ np.abs(refraction) @ magnitude
    steps = 4 * (last - first + 1)
    cleaned = [
        without_rounding(entry, size, steps=steps)
        for entry, size in zip(matrix.ravel().tolist(), magnitude.ravel().tolist(), strict=True)
    ]
    return np.array(cleaned).reshape(2, 2)
