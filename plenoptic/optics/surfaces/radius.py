"""Signed radii of curvature."""

from __future__ import annotations

import math

from plenoptic.core.values import number
from plenoptic.errors import InvalidValueError, PrescriptionError


def signed_radius(value: float, name: str) -> float:
    """`value` as a radius of curvature in mm, inf for a plane; PrescriptionError for 0, nan, or no number."""
    try:
        radius = number(value, name)
    except InvalidValueError:
        raise PrescriptionError(f"{name} is {value!r}; it must be a number, math.inf for a plane") from None
    if math.isinf(radius):
        return math.inf
    # The reciprocal of a subnormal radius overflows.
    if math.isnan(radius) or radius == 0 or math.isinf(1.0 / radius):
        raise PrescriptionError(f"{name} is {radius:g} mm; it must not be 0 or nan: for a plane use math.inf")
    return radius
