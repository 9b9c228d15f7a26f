"""Elements in a row: what can be one, and a stop put between them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from plenoptic.core.values import Floats, whole
from plenoptic.errors import PrescriptionError
from plenoptic.optics.glass.media import AIR, Medium
from plenoptic.optics.stops.registry import STOPS, Stop
from plenoptic.optics.surfaces.surface import Surface

Element: TypeAlias = Surface | Stop
"""What a lens is made of."""


def is_stop(element: Element) -> bool:
    """Whether an element is a stop, not a surface."""
    return not isinstance(element, Surface)


def is_centred(element: Element) -> bool:
    """Whether an element looks the same from all sides, about the lens's axis."""
    return element.placement is None and not (isinstance(element, Surface) and element.departure is not None)


def checked_elements(elements: Sequence[Element], ambient: Medium) -> tuple[Element, ...]:
    """The elements of a lens, or an error where they cannot be one."""
    if isinstance(ambient, Sequence | type) or not callable(getattr(ambient, "index", None)):
        raise PrescriptionError(f"ambient is {ambient!r}; it must be a medium, such as pl.optics.AIR")
    try:
        stack = tuple(elements)
    except TypeError:
        raise PrescriptionError(f"elements is {elements!r}; it must be a sequence of surfaces and stops") from None
    for i, element in enumerate(stack):
        if not isinstance(element, Element):
            *others, last = (kind.__name__ for kind in (Surface, *STOPS.values()))
            raise PrescriptionError(
                f"element {i} is {element!r}; a lens is made of {', '.join(others)} and {last}: remove it or describe "
                "it as one of these"
            )
    surfaces = [i for i, element in enumerate(stack) if isinstance(element, Surface)]
    if not surfaces:
        raise PrescriptionError(
            f"the lens has {len(stack)} elements and no surface; add at least one Surface, or take pl.no_lens(...)"
        )
    if len(surfaces) == len(stack):
        raise PrescriptionError(
            f"the lens has {len(stack)} surfaces and no stop; add one, such as a CircularStop, where the iris stands"
        )
    last = stack[surfaces[-1]]
    if isinstance(last, Surface) and last.medium != ambient:
        around = "air: its medium must be pl.optics.AIR" if ambient == AIR else f"{ambient!r}: give it that medium"
        raise PrescriptionError(
            f"element {surfaces[-1]}, the last surface, is followed by {last.medium!r}; the sensor is in {around}"
        )
    if not np.isfinite(sum(element.thickness for element in stack[:-1])):
        raise PrescriptionError("the gaps add up to no finite length; reduce their thickness")
    # The gap behind the last element belongs to the camera.
    return (*stack[:-1], dataclasses.replace(stack[-1], thickness=0.0))


def checked_iris(elements: Sequence[Element], iris: int | None) -> int:
    """The index of the iris, the first stop where none is given, or an error where it is none."""
    stops = [i for i, element in enumerate(elements) if is_stop(element)]
    found = stops[0] if iris is None else whole(iris, "iris", at_least=0)
    if found not in stops:
        raise PrescriptionError(f"iris is element {found}, which is not a stop; the stops are elements {stops}")
    return found


def checked_indices(media: Sequence[Medium], wavelength: float) -> Floats:
    """Refractive indices of the media before and behind elements, or an error where they are none."""
    found = np.array([float(medium.index(wavelength)) for medium in media])
    for i in np.flatnonzero(~((found >= 1.0) & (found < np.inf))):
        raise PrescriptionError(
            f"the medium behind element {i - 1} has the refractive index {found[i]:g} at {wavelength:g} nm; "
            "it must be finite and at least 1: use another medium"
        )
    return found


def checked_stop(stop: Stop) -> None:
    """An error where something is no stop."""
    if not isinstance(stop, Stop):
        raise PrescriptionError(f"stop is {stop!r}; it must be a stop, such as a CircularStop")


def counted(elements: Sequence[Element], length: float) -> str:
    """What a lens is made of, in words."""
    stops = sum(map(is_stop, elements))
    surfaces = len(elements) - stops
    counts = f"{surfaces} surface{'s' * (surfaces != 1)}, {stops} stop{'s' * (stops != 1)}"
    moved = sum(element.placement is not None for element in elements)
    return f"{counts}, {length:g} mm long" + (f", {moved} element{'s' * (moved != 1)} out of place" if moved else "")


def with_inserted(
    elements: Sequence[Element], vertices: Floats, gap_media: Sequence[Medium], stop: Stop, z: float
) -> tuple[list[Element], int]:
    """The elements with a stop at z (mm, in the lens frame), and its index; see `LensStack.inserted`."""
    bounds = [-np.inf, *vertices.tolist(), np.inf]
    gaps = [i for i, (low, high) in enumerate(pairwise(bounds)) if low <= z <= high]
    in_air = [i for i in gaps if gap_media[i] == gap_media[0]]
    if not in_air:
        low, high = bounds[gaps[0]], bounds[gaps[0] + 1]
        raise PrescriptionError(
            f"z {z:g} mm lies in glass, which reaches from {low:g} to {high:g} mm; place the stop in an air gap"
        )
    gap, stack = in_air[0], list(elements)
    if gap > 0:
        stack[gap - 1] = dataclasses.replace(stack[gap - 1], thickness=z - float(vertices[gap - 1]))
    behind = float(vertices[gap]) - z if gap < len(stack) else 0.0
    stack.insert(gap, dataclasses.replace(stop, thickness=behind))
    return stack, gap
