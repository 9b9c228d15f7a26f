"""Elements of a lens: kinds, validation of a sequence, and cross sections."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from plenoptic.core.values import Floats
from plenoptic.errors import PrescriptionError
from plenoptic.optics.glass.media import AIR, Medium, check_medium
from plenoptic.optics.lens.placement import to_lens_axes
from plenoptic.optics.stops.stop_registry import STOPS, Stop, circle_around, stop_kind
from plenoptic.optics.surfaces.mirror import Mirror, medium_behind
from plenoptic.optics.surfaces.surface import Surface

if TYPE_CHECKING:
    from plenoptic.optics.lens.stack import LensStack

Element: TypeAlias = Surface | Stop
"""Element of a lens: a surface or a stop."""


def shares_axis(element: Element) -> bool:
    """True if an element shares the axis of the lens: no placement, no freeform term. A stop may have any shape."""
    return element.placement is None and not (isinstance(element, Surface) and element.freeform is not None)


def with_round_stops(elements: Sequence[Element]) -> list[Element]:
    """Elements with masks, rings and the like replaced by the circles around them: rays in one plane do not sample
    their openings.
    """
    return [e if isinstance(e, Surface) or stop_kind(e).fills_outline else circle_around(e) for e in elements]


def is_glass(lens: LensStack, gap: int) -> bool:
    """True if a gap of a lens holds neither air nor the medium in front of it or behind it."""
    return lens.gap_media[gap] not in (lens.front_medium, lens.rear_medium, AIR)


_ROUNDING = 1e-12
"""Relative rounding error of a sum of thicknesses."""

MOST_ELEMENTS = 10_000
"""Largest number of elements of a lens."""


def check_count(elements: int) -> None:
    """Refuse a file or list with more than MOST_ELEMENTS elements, before any is constructed."""
    if elements > MOST_ELEMENTS:
        raise PrescriptionError(f"there are {elements} surfaces and stops; a lens has at most {MOST_ELEMENTS}")


def checked_elements(elements: Sequence[Element], front: Medium, rear: Medium) -> tuple[Element, ...]:
    """Check a sequence of elements and return it as a tuple, with the last thickness set to 0."""
    check_medium(front, "front_medium")
    check_medium(rear, "rear_medium")
    try:
        stack = tuple(elements)
    except TypeError:
        raise PrescriptionError(f"elements is {elements!r}; it must be a sequence of surfaces and stops") from None
    check_count(len(stack))
    for i, element in enumerate(stack):
        if not isinstance(element, Element):
            *kinds, last = (kind.__name__ for kind in (Surface, *(kind.stop for kind in STOPS.values())))
            raise PrescriptionError(
                f"element {i} is {element!r}; a lens is made of {', '.join(kinds)} and {last}: remove it or describe "
                "it as one of these"
            )
    surfaces = [i for i, element in enumerate(stack) if isinstance(element, Surface)]
    if not surfaces:
        raise PrescriptionError(
            f"the lens has {len(stack)} elements and no surface; add at least one Surface, or take pl.no_lens(...)"
        )
    if len(surfaces) == len(stack):
        raise PrescriptionError(
            f"the lens has {len(stack)} surfaces and no stop; add one, such as a CircularStop, for the iris"
        )
    _check_order(stack)
    behind = front
    for element in stack:
        behind = medium_behind(element.medium, behind) if isinstance(element, Surface) else behind
    if behind != rear:
        surroundings = "air: its medium must be pl.optics.AIR" if rear == AIR else f"{rear!r}: give it that medium"
        raise PrescriptionError(
            f"element {surfaces[-1]}, the last surface, is followed by {behind!r}; the sensor is in {surroundings}, or "
            "name its medium as rear_medium"
        )
    # The gap behind the last element belongs to the camera.
    return (*stack[:-1], dataclasses.replace(stack[-1], thickness=0.0))


def check_stop(stop: Stop) -> Stop:
    """Return a stop, or raise an error if it is none."""
    if not isinstance(stop, Stop):
        raise PrescriptionError(f"stop is {stop!r}; it must be a stop, such as a CircularStop")
    return stop


def _check_order(stack: Sequence[Element]) -> None:
    """Refuse a stop whose negative thickness places the next surface in front of the preceding one."""
    z, z_surface = 0.0, -np.inf
    for i, element in enumerate(stack):
        if isinstance(element, Surface):
            if z < z_surface - _ROUNDING * abs(z_surface):
                raise PrescriptionError(
                    f"element {i} lies {z_surface - z:g} mm in front of the surface before it; make the negative "
                    "thickness of the stop before it smaller"
                )
            z_surface = z
        z += element.thickness


def check_one_space(elements: Sequence[Element], group: Collection[int]) -> None:
    """Refuse a rigid group with elements on both sides of a mirror: the lens frame mirrors the space behind it."""
    for i in range(min(group), max(group)):
        element = elements[i]
        if isinstance(element, Surface) and isinstance(element.medium, Mirror):
            raise PrescriptionError(
                f"elements {min(group)} and {max(group)} lie on both sides of the mirror {i}, and the lens frame "
                "mirrors the space behind it; move the elements up to and with the mirror, then those behind it"
            )


def profile_of(element: Element, z: float, points: int) -> Floats:
    """Points (n, 2), z and y in mm in the lens frame, on the cross section of an element in the plane x = 0 of its
    axes.
    """
    if isinstance(element, Surface) and element.depth is not None:
        # An ellipse is sampled by its angle, so the part beyond the equator has points too.
        pole = abs(element.radius) / (1.0 + element.conic)
        angle = np.linspace(-1.0, 1.0, points) * np.arccos(1.0 - element.depth / pole)
        y, sag = element.equator * np.sin(angle), np.copysign(pole, element.radius) * (1.0 - np.cos(angle))
    else:
        y = np.linspace(-element.semi_diameter, element.semi_diameter, points)
        sag = element.sag(0.0, y) if isinstance(element, Surface) else np.zeros_like(y)
    _, y, sag = to_lens_axes(element.placement, np.column_stack([np.zeros_like(y), y, sag])).T
    return np.stack([sag + z, y], axis=1)


def description(elements: Sequence[Element], length: float) -> str:
    """Numbers of surfaces, stops, coatings and elements out of place, and the length in mm, as text."""
    surfaces = [element for element in elements if isinstance(element, Surface)]
    stops, moved = len(elements) - len(surfaces), sum(element.placement is not None for element in elements)
    coatings = sum(surface.coating is not None for surface in surfaces)
    text = f"{_count(len(surfaces), 'surface')}, {_count(stops, 'stop')}, {length:g} mm long"
    text += f", {_count(coatings, 'coating')}" if coatings else ""
    return text + (f", {_count(moved, 'element')} out of place" if moved else "")


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' * (number != 1)}"
