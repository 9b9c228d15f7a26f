"""Lenses as tables of comma separated values, with semicolons between the cells."""

from __future__ import annotations

import math
import re

from plenoptic.errors import InvalidValueError, PrescriptionError
from plenoptic.optics.glass.catalogue import glass
from plenoptic.optics.glass.media import AIR, ConstantMedium, Medium, ModelGlass
from plenoptic.optics.lens.elements import Element
from plenoptic.optics.lens.files.infer_stop import with_inferred_stop
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.stops.circle import CircularStop
from plenoptic.optics.surfaces.surface import Surface

_HEADER = ["radius", "thickness", "material", "index", "v-no", "sa"]


def lens_from_csv(text: str, where: str) -> LensStack:
    """The lens of a table; the format and the rule for tables without a stop stand in `load_lens`.

    Parameters
    ----------
    text : str
        What stands in the file.
    where : str
        Name of the file, for messages and for the name of the lens.

    Raises
    ------
    PrescriptionError
        Naming the file and the line.

    Examples
    --------
    >>> from plenoptic.optics.lens.files.lens_csv import lens_from_csv
    >>> table = '''radius;thickness;material;index;v-no;sa
    ... 50;5;BK7;1.5168;64.2;12
    ... -50;46;air;;;12'''
    >>> lens_from_csv(table, "mine.csv").source
    'mine.csv; stop placed by rule'
    """
    rows = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    header = [cell.strip().lower() for cell in rows[0][1].split(";")] if rows else []
    if header != _HEADER:
        first = rows[0][0] if rows else 1
        raise PrescriptionError(f"{where}, line {first}: the first line must be {';'.join(_HEADER)}")
    elements: list[Element] = []
    before: Medium = AIR
    for number, line in rows[1:]:
        try:
            element = _element(line, before=before, last=number == rows[-1][0])
        except InvalidValueError as error:
            raise PrescriptionError(f"{where}, line {number}: {error}") from None
        before = element.medium if isinstance(element, Surface) else before
        elements.append(element)
    name = where.rpartition(".")[0]
    surfaces = [element for element in elements if isinstance(element, Surface)]
    try:
        if surfaces and len(surfaces) == len(elements):
            return LensStack(with_inferred_stop(surfaces), None, name, f"{where}; stop placed by rule")
        return LensStack(elements, None, name, where)
    except InvalidValueError as error:
        raise PrescriptionError(f"{where}, line {rows[-1][0]}: {error}") from None


def _number(text: str, name: str) -> float:
    # Stricter than float(): no nan, no underscores, no decimal comma.
    if not re.fullmatch(r"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?", text):
        raise PrescriptionError(f"{name} is {text[:40]!r}; it must be a number with a decimal point")
    return float(text)


def _medium(material: str, index: str, abbe: str) -> Medium:
    if material.lower() == "air":
        if index or abbe:
            raise PrescriptionError(f"air has index {index[:40]!r} and V-number {abbe[:40]!r}; leave both empty")
        return AIR
    if not index and not abbe:
        try:
            return glass(material)
        except InvalidValueError:
            raise PrescriptionError(
                f"material {material[:40]!r} has no index and is no bundled glass; give its index, or write air"
            ) from None
    if not index:
        raise PrescriptionError(f"material {material[:40]!r} has a V-number and no index; give it, or leave both empty")
    number = _number(index, "index")
    return ModelGlass(number, _number(abbe, "v-no"), material) if abbe else ConstantMedium(number)


def _element(line: str, *, before: Medium, last: bool) -> Element:
    cells = [cell.strip() for cell in line.split(";")]
    if len(cells) != len(_HEADER):
        raise PrescriptionError(f"there are {len(cells)} cells; there must be {len(_HEADER)}, with ; between them")
    radius, thickness, material, index, abbe, semi_diameter = cells
    gap = _number(thickness, "thickness")
    medium = _medium(material, index, abbe)
    if last and medium != AIR:
        raise PrescriptionError(f"the last material is {material[:40]!r}; the sensor is in air: it must be air")
    size, gap = _number(semi_diameter, "sa"), 0.0 if last else gap
    if not radius and before == medium == AIR:
        return CircularStop(size, gap)
    return Surface(_number(radius, "radius") if radius else math.inf, gap, medium, semi_diameter=size)
