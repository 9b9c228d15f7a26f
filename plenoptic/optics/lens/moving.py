"""Elements of a lens moved as one rigid group."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from plenoptic.core.values import Floats
from plenoptic.errors import PrescriptionError
from plenoptic.optics.lens.elements import Element
from plenoptic.optics.lens.placement import Placement, rotation_about_axes

Kind = TypeVar("Kind", bound=Element)


def moved_group(
    elements: Sequence[Element],
    vertices: Floats,
    which: int | slice | Sequence[int],
    *,
    shift: Sequence[float],
    tilt: Sequence[float],
    pivot: float | None,
) -> list[Element]:
    """The elements of a lens, some of them moved; see `LensStack.moved`."""
    n = len(elements)
    try:
        chosen = range(n)[which] if isinstance(which, slice) else [range(n)[i] for i in np.atleast_1d(which)]
    except (IndexError, TypeError, ValueError):
        chosen = []
    group = sorted(set(chosen))
    if not group:
        raise PrescriptionError(f"which is {which!r}; it must name elements, from 0 to {n - 1}")
    turn, along = rotation_about_axes(tilt), np.asarray(Placement(shift=shift).shift)
    centre = np.array([0.0, 0.0, vertices[group[0]] if pivot is None else pivot])
    moved = list(elements)
    for i in group:
        moved[i] = _moved(moved[i], np.array([0.0, 0.0, vertices[i]]), turn, along, centre)
    return moved


def _moved(element: Kind, vertex: Floats, turn: Floats, along: Floats, centre: Floats) -> Kind:
    placed = element.placement or Placement()
    shift = turn @ (vertex + np.asarray(placed.shift) - centre) + centre + along - vertex
    return dataclasses.replace(element, placement=Placement(shift=shift, rotation=turn @ np.asarray(placed.rotation)))
