"""Unfolded stacks: the elements that light passes which is reflected at two surfaces of a lens."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from plenoptic.core.values import Floats
from plenoptic.errors import PrescriptionError
from plenoptic.optics.coatings.coating import Coating, Reflectance
from plenoptic.optics.coatings.surface_powers import is_from_front, ordered_powers
from plenoptic.optics.glass.media import Medium
from plenoptic.optics.lens.elements import Element
from plenoptic.optics.lens.lens_record import FRAME, LensRecord, radiometric_lens_record
from plenoptic.optics.lens.loss_record import table_cosines
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.placement import Placement
from plenoptic.optics.surfaces.mirror import MIRROR, Mirror
from plenoptic.optics.surfaces.surface import Surface

if TYPE_CHECKING:
    from plenoptic.optics.lens.stack import LensStack

BARE = Coating()


def reflecting_lens(
    lens: LensStack, sensor: tuple[float, float] | None = None, placement: Placement | None = None
) -> LensStack:
    """The lens, traced exactly, with `BARE` surfaces in place of those without coating.

    `sensor` is z in mm and the reflectance of a plane that becomes the last element, so large that light which it
    reflects from the last element to the last element stays inside; None: no sensor. `placement` turns it.
    PrescriptionError if the lens has mirrors, or the sensor does not lie behind it.
    """
    elements: list[Element] = []
    for element in lens.elements:
        if isinstance(element, Surface):
            if isinstance(element.medium, Mirror):
                raise PrescriptionError(f"the lens {lens.name!r} has mirrors; ghosts are those of refracting surfaces")
            element = dataclasses.replace(element, coating=BARE if element.coating is None else element.coating)
        elements.append(element)
    if sensor is not None:
        z, reflectance = sensor
        gap = z - float(lens.vertices[-1])
        if not gap > 0:
            raise PrescriptionError(
                f"the sensor at z = {z:g} mm does not lie behind the last element at {lens.vertices[-1]:g} mm; give "
                "z_image, or no reflectance of the sensor"
            )
        radius = 2.0 * max(element.semi_diameter for element in elements)
        elements[-1] = dataclasses.replace(elements[-1], thickness=gap)
        coating = Reflectance(reflectance)
        elements.append(
            Surface(np.inf, medium=lens.rear_medium, semi_diameter=radius, coating=coating, placement=placement)
        )
    return dataclasses.replace(lens, elements=elements, model=LensModel.EXACT, specification=None)


def ghost_stack(lens: LensStack, pair: tuple[int, int], last: int, wavelengths: tuple[float, ...]) -> LensStack:
    """Stack of the light that is reflected at the first surface of a pair, then at the second one in front of it.

    It ends behind the element `last` of the lens, which is that of `reflecting_lens`. Elements that light passes
    backwards are described by their mirror images in planes perpendicular to the axis; both reflecting surfaces are
    mirrors, whose coatings have the reflectance of the surface at the wavelengths in nm. The iris is the first passage
    of the iris.
    """
    first, second = pair
    elements, media = lens.elements, lens.gap_media
    gap = [element.thickness for element in elements]
    stack: list[Element] = list(elements[:first])
    stack.append(_reflector(elements[first], gap[first - 1], media[first : first + 2], wavelengths, reverse=False))
    for k in range(first - 1, second, -1):
        stack.append(_mirror_image(elements[k], gap[k - 1], media[k]))
    rear = _mirror_image(elements[second], gap[second], media[second])
    stack.append(_reflector(rear, gap[second], media[second : second + 2], wavelengths, reverse=True))
    stack += elements[second + 1 : last + 1]
    order = [*range(first), *range(first, second, -1), *range(second, last + 1)]
    name = f"{lens.name}, reflected at {first} and {second}"
    return dataclasses.replace(lens, elements=stack, iris=order.index(lens.iris_index), name=name)


def pair_records(stacks: Sequence[LensStack], wavelength: float | Floats, *, reverse: bool) -> tuple[LensRecord, ...]:
    """Compiled stacks of pairs, all of one type, since kernels are compiled once: with a tilted sensor among the
    surfaces, stacks without it have placements, too, of elements that have none.
    """
    records = [radiometric_lens_record(stack, wavelength, reverse=reverse) for stack in stacks]
    if any(record.frames is not None for record in records):
        records = [
            record._replace(frames=np.zeros((len(record.rows), FRAME))) if record.frames is None else record
            for record in records
        ]
    return tuple(records)


def pairs_of(lens: LensStack) -> list[tuple[int, int]]:
    """Pairs of surfaces that reflect light first and second; the first one lies behind the second."""
    surfaces = [i for i, element in enumerate(lens.elements) if isinstance(element, Surface)]
    return [(j, i) for j in surfaces for i in surfaces if i < j]


def _reflector(
    element: Element, gap: float, media: tuple[Medium, ...], wavelengths: tuple[float, ...], *, reverse: bool
) -> Surface:
    """The surface as a mirror, with its reflectance between the media in front and behind; `reverse`: from behind."""
    assert isinstance(element, Surface)
    cosines = table_cosines()[::-1]  # tracing interpolates between the same
    n_from, n_to = (np.array([[each.index(nm)] for nm in wavelengths]) for each in media[:: -1 if reverse else 1])
    in_order = np.array([[is_from_front(media, nm) != reverse] for nm in wavelengths])
    nm = np.array(wavelengths)[:, None]
    table = ordered_powers(element.coating, n_from, n_to, cosines, nm, in_order).reflectance
    # Rounding may leave more than 1 above the critical angle.
    coating = Reflectance(np.minimum(table, 1.0), wavelengths=wavelengths, angles=np.arccos(cosines))
    return dataclasses.replace(element, thickness=gap, medium=MIRROR, coating=coating)


def _mirror_image(element: Element, gap: float, medium: Medium) -> Element:
    """Mirror image of an element in the plane through its nominal vertex, with the gap and the medium behind it."""
    placement = element.placement
    if placement is not None:
        flip = np.array([1.0, 1.0, -1.0])
        placement = Placement(flip * placement.shift, flip[:, None] * placement.rotation * flip)
    if not isinstance(element, Surface):
        return dataclasses.replace(element, thickness=gap, placement=placement)
    return dataclasses.replace(
        element,
        radius=-element.radius,
        aspheric=tuple(-a for a in element.aspheric),
        freeform=None if element.freeform is None else element.freeform.inverted,
        placement=placement,
        thickness=gap,
        medium=medium,
    )
