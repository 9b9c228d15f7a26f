"""Lenses as tables of comma separated values, with semicolons between the cells."""

from __future__ import annotations

import math

from plenoptic.core.files.text_lines import name_line_in_errors, parse_number
from plenoptic.errors import InvalidValueError, PrescriptionError
from plenoptic.optics.glass.bundled import glass
from plenoptic.optics.glass.media import AIR, ConstantMedium, Medium, ModelGlass
from plenoptic.optics.lens.elements import Element, check_count
from plenoptic.optics.lens.files.infer_stop import with_inferred_stop
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.stops.circle import CircularStop
from plenoptic.optics.surfaces.mirror import MIRROR, medium_behind
from plenoptic.optics.surfaces.surface import Surface

_HEADER = ["radius", "thickness", "material", "index", "v-no", "sa"]


def lens_from_csv(text: str, where: str) -> LensStack:
    """Lens from the text of a table in the file `where`; see `load_lens` for the format and the placement of a missing
    stop.
    """
    rows = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    header = [cell.strip().lower() for cell in rows[0][1].split(";")] if rows else []
    if header != _HEADER:
        first = rows[0][0] if rows else 1
        raise PrescriptionError(f"{where}, line {first}: the first line must be {';'.join(_HEADER)}, with semicolons")
    with name_line_in_errors(where, rows[-1][0]):
        check_count(len(rows) - 1)
    elements: list[Element] = []
    before: Medium = AIR
    for number, line in rows[1:]:
        with name_line_in_errors(where, number):
            elements.append(_element(line, before=before, last=number == rows[-1][0]))
        before = medium_behind(elements[-1].medium, before) if isinstance(elements[-1], Surface) else before
    surfaces = [element for element in elements if isinstance(element, Surface)]
    source = where
    with name_line_in_errors(where, rows[-1][0]):
        if surfaces and len(surfaces) == len(elements):
            elements, source = with_inferred_stop(surfaces), f"{where}; stop placed by rule"
        lens = LensStack(elements, None, where.rpartition(".")[0], source, rear_medium=before)
    return lens


def _medium(material: str, index: str, abbe: str) -> Medium:
    if material.lower() in ("", "air") and not (index or abbe):
        return AIR
    if material.lower() == "air":
        raise PrescriptionError(f"air has index {index[:40]!r} and V-number {abbe[:40]!r}; leave both empty")
    if material.lower() == "mirror" and not (index or abbe):
        return MIRROR
    if not index and not abbe:
        try:
            return glass(material)
        except InvalidValueError:
            raise PrescriptionError(
                f"material {material[:40]!r} has no index and is no bundled glass; give its index, or leave the cell "
                "empty for air"
            ) from None
    if not index:
        raise PrescriptionError(f"material {material[:40]!r} has a V-number and no index; give it, or leave both empty")
    number = parse_number(index, "index")
    return ModelGlass(number, parse_number(abbe, "v-no"), material) if abbe else ConstantMedium(number)


def _element(line: str, *, before: Medium, last: bool) -> Element:
    cells = [cell.strip() for cell in line.split(";")]
    if len(cells) != len(_HEADER):
        raise PrescriptionError(f"there are {len(cells)} cells; there must be {len(_HEADER)}, with ; between them")
    radius, thickness, material, index, abbe, semi_diameter = cells
    gap = parse_number(thickness, "thickness")
    medium = _medium(material, index, abbe)
    size, gap = parse_number(semi_diameter, "sa"), 0.0 if last else gap
    if not radius and before == medium == AIR:
        return CircularStop(size, gap)
    return Surface(parse_number(radius, "radius") if radius else math.inf, gap, medium, semi_diameter=size)
