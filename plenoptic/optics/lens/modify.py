"""Lenses made from others: elements moved, a stop inserted, all lengths scaled, or surfaces coated."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from plenoptic.core.values import check_kind, finite, number
from plenoptic.errors import InvalidValueError, PrescriptionError
from plenoptic.optics.coatings.coating import SurfaceCoating
from plenoptic.optics.coatings.surface_powers import check_coating
from plenoptic.optics.lens.elements import Element, check_one_space, is_glass
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.placement import Placement, rotation_about_axes
from plenoptic.optics.lens.specification import Specification
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.stops.stop_registry import Stop
from plenoptic.optics.surfaces.surface import Surface

_MAX_FACTOR = 1e6
"""Largest factor, and reciprocal of the smallest: high powers of it are finite."""


def move_elements(
    lens: LensStack,
    which: int | slice | Sequence[int],
    shift: Sequence[float],
    tilt: Sequence[float],
    pivot: float | None,
) -> LensStack:
    """`LensStack.moved`."""
    elements, places = list(lens.elements), range(len(lens.elements))
    try:
        chosen = places[which] if isinstance(which, slice) else [places[i] for i in np.atleast_1d(which)]
    except (IndexError, TypeError, ValueError):
        chosen = []
    if not chosen:
        raise PrescriptionError(f"which is {which!r}; it must select elements, from 0 to {len(elements) - 1}")
    check_one_space(elements, chosen)
    turn, along = rotation_about_axes(tilt), Placement(shift=shift).shift
    vertices = np.zeros((len(elements), 3))
    vertices[:, 2] = lens.vertices
    centre = vertices[min(chosen)] if pivot is None else np.array([0.0, 0.0, finite(pivot, "pivot")])
    for i in set(chosen):
        before = elements[i].placement or Placement()
        moved = turn @ (vertices[i] + before.shift - centre) + centre + along - vertices[i]
        elements[i] = dataclasses.replace(elements[i], placement=Placement(moved, turn @ before.rotation))
    return dataclasses.replace(lens, elements=elements)


def insert_stop(lens: LensStack, stop: Stop, z: float) -> LensStack:
    """`LensStack.inserted`."""
    z_stop, ends = finite(z, "z"), [-np.inf, *lens.vertices.tolist(), np.inf]
    gaps = [i for i, (low, high) in enumerate(pairwise(ends)) if low <= z_stop <= high]
    in_air = [i for i in gaps if not is_glass(lens, i)]
    if not in_air:
        low, high = ends[gaps[0]], ends[gaps[0] + 1]
        raise PrescriptionError(
            f"z {z_stop:g} mm lies in glass from {low:g} to {high:g} mm; place the stop in an air gap"
        )
    gap, elements = in_air[0], list(lens.elements)
    if gap > 0:
        elements[gap - 1] = dataclasses.replace(elements[gap - 1], thickness=z_stop - ends[gap])
    behind = ends[gap + 1] - z_stop if gap < len(elements) else 0.0
    elements.insert(gap, dataclasses.replace(stop, thickness=behind))
    return dataclasses.replace(lens, elements=elements, iris=lens.iris_index + (gap <= lens.iris_index))


def scale_lens(lens: LensStack, factor: float | None, focal_length: float | None) -> LensStack:
    """`LensStack.scaled`."""
    if (factor is None) == (focal_length is None):
        raise InvalidValueError("scaled needs a factor or a focal_length in mm, and not both")
    if focal_length is not None:
        scale = _factor_to(lens, number(focal_length, "focal_length"))
    else:
        assert factor is not None
        scale = number(factor, "factor")
    if not 1.0 / _MAX_FACTOR <= scale <= _MAX_FACTOR:
        raise InvalidValueError(f"factor is {scale:g}; it must be from {1.0 / _MAX_FACTOR:g} to {_MAX_FACTOR:g}")
    specification = None if lens.specification is None else _scale_specification(lens.specification, scale)
    elements = [_scale_element(element, scale) for element in lens.elements]
    return dataclasses.replace(lens, elements=elements, specification=specification)


def _factor_to(lens: LensStack, focal_length: float) -> float:
    efl = cardinal_points(lens).efl
    if not (math.isfinite(efl) and math.isfinite(focal_length) and efl * focal_length > 0):
        raise InvalidValueError(
            f"focal_length is {focal_length:g} mm, and that of the lens is {efl:g} mm; both must be finite and have "
            "the same sign"
        )
    return focal_length / efl


def _scale_element(element: Element, factor: float) -> Element:
    placement = element.placement
    if placement is not None:
        placement = Placement(factor * placement.shift, placement.rotation)
    scaled = element.rescale(factor) if isinstance(element, Surface) else element.image(factor)
    return dataclasses.replace(scaled, thickness=factor * element.thickness, placement=placement)


def _scale_specification(specification: Specification, factor: float) -> Specification:
    finite_object = math.isfinite(specification.z_object)
    scaled: dict[str, Any] = {"fields": factor * specification.fields} if finite_object else {}
    for name in ("z_object", "z_image", "image_radius", "entrance_pupil_diameter", "stop_semi_diameter"):
        length = getattr(specification, name)
        scaled[name] = None if length is None else factor * length
    return dataclasses.replace(specification, **scaled)


def coated(lens: LensStack, coating: SurfaceCoating | None) -> LensStack:
    """The lens with one coating on all surfaces between glass and air.

    Cemented surfaces and mirrors stay as they are. If any surface of a lens has a coating, its rays and images lose the
    light that all surfaces reflect, bare ones too, and that glasses of known transmittance absorb
    (`AbsorbingGlass`). Models other than EXACT have no surfaces and lose none.

    Parameters
    ----------
    lens : LensStack
    coating : SingleLayer, Coating, Reflectance or None
        ``Coating()`` is bare glass; None removes all coatings, also of cemented surfaces and mirrors: no light is lost.

    Raises
    ------
    PrescriptionError
        If `coating` is none.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2")
    >>> bare, single = (pl.optics.coated(lens, each) for each in (pl.optics.Coating(), pl.optics.SingleLayer()))
    >>> axial = pl.RayBundle([[0, 0, -400.0]], [[0, 0, 1.0]])
    >>> [each.trace(axial).weight.round(3).tolist() for each in (lens, bare, single)]
    [[1.0], [0.59], [0.962]]
    """
    check_kind(lens, "lens", LensStack, 'pl.load_lens("double-gauss-100mm-f2")')
    check_coating(coating)
    elements: list[Element] = list(lens.elements)
    for i, element in enumerate(elements):
        if isinstance(element, Surface) and (coating is None or is_glass(lens, i) != is_glass(lens, i + 1)):
            elements[i] = dataclasses.replace(element, coating=coating)
    return dataclasses.replace(lens, elements=elements)
