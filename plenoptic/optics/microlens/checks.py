"""What microlens arrays cannot be."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from plenoptic.core.values import positive
from plenoptic.errors import InvalidValueError
from plenoptic.optics.microlens.imperfections import largest_offset, least_factor
from plenoptic.optics.microlens.lattice import Lattice

if TYPE_CHECKING:
    from plenoptic.optics.microlens.array import MicrolensArray

_HIGH_INDEX = 10.0
"""The least index of plates without height."""


def check_plate(array: MicrolensArray) -> None:
    """Refuse plates that cannot be made: spheres smaller than their openings, glass too thin or of too low an index."""
    shortest, reach = min(array.focal_lengths), array.opening.reach
    if shortest < 0:
        raise InvalidValueError(
            f"focal length {shortest:g} mm: a plano-convex microlens collects light; use one above 0"
        )
    shortest *= 1.0 if array.imperfections is None else least_factor(array.imperfections)
    reach += 0.0 if array.imperfections is None else largest_offset(array.imperfections)
    radius = shortest * (array.index - 1.0)
    if radius < reach:
        raise InvalidValueError(
            f"radius of curvature {radius:g} mm is below the corner of the opening at {reach:g} mm, "
            "imperfections included; increase the focal length or the index, or reduce the pitch or the spread"
        )
    if array.model.is_flat:
        if array.index < _HIGH_INDEX:
            raise InvalidValueError(
                f"index of the microlenses is {array.index:g}; FLAT_HIGH_INDEX stands for a nearly flat lens and "
                f"needs at least {_HIGH_INDEX:g}: give index=100.0, or choose SPHERICAL"
            )
        return
    sag = reach**2 / (radius + math.sqrt(radius**2 - reach**2))
    if sag > array.thickness:
        raise InvalidValueError(
            f"thickness {array.thickness:g} mm is below the sag {sag:g} mm at the opening's corner; increase it"
        )


def checked_pitch(pitch: float | tuple[float, float], lattice: Lattice) -> float | tuple[float, float]:
    """The pitch as one number, or two for RECTANGULAR."""
    if lattice is not Lattice.RECTANGULAR:
        if isinstance(pitch, tuple | list):
            raise InvalidValueError(f"pitch is {pitch}; only Lattice.RECTANGULAR has two: give one number in mm")
        return positive(pitch, "pitch", "mm")
    try:
        x, y = pitch  # type: ignore[misc]
    except (TypeError, ValueError):
        raise InvalidValueError(f"pitch is {pitch!r}; Lattice.RECTANGULAR needs two in mm, along x and y") from None
    return positive(x, "pitch along x", "mm"), positive(y, "pitch along y", "mm")
