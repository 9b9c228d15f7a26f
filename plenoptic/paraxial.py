"""Gaussian optics of a lens: focal length, cardinal points, pupils, conjugates, marginal and chief ray."""

from plenoptic.optics.lens.gaussian.marginal_and_chief import (
    ParaxialRay,
    chief_ray,
    lagrange_invariant,
    marginal_ray,
    paraxial_ray,
)
from plenoptic.optics.lens.gaussian.paraxial import (
    CardinalPoints,
    cardinal_points,
    conjugates,
    image_position,
    magnification,
    numerical_apertures,
    object_position,
    system_matrix,
    working_f_number,
)

__all__ = [
    "CardinalPoints",
    "ParaxialRay",
    "cardinal_points",
    "chief_ray",
    "conjugates",
    "image_position",
    "lagrange_invariant",
    "magnification",
    "marginal_ray",
    "numerical_apertures",
    "object_position",
    "paraxial_ray",
    "system_matrix",
    "working_f_number",
]
