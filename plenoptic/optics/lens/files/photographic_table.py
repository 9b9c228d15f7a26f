"""Reader of descriptive tables of photographic lenses (.txt): sections in brackets, columns between tabs.

The format is that of the Optical Bench of Photons to Photos; lengths are in mm.

- [lens data]: number, radius, thickness, n_d, clear diameter, V_d, the name of a glass, its maker. The radius is AS for
  the stop, FS for a field stop, CG or Infinity for a plane. A thickness may be the name of a variable distance.
- [variable distances]: a name and its values, one for each configuration: distances of zooming and focusing, d0 of the
  object, Bf behind the lens, Aperture Diameter of the stop; Angle of View (full, degrees) and Image Height (full).
  At a focus distance between two columns, the lenses stand on the straight way between them, with the image in focus.
- [aspherical data]: number, radius, conic constant, then the coefficients of r^4, r^6, ...; of r^2, r^4, ... if
  [constants] have AsphericalA2, and of r^3, r^4, r^6, ... if they have AsphericalOddCount 1.
- A glass is that of its name if a catalogue has it with the n_d of the table within 0.0005, otherwise the model glass
  of n_d and V_d. Other sections are ignored.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from plenoptic.core.files.text_lines import name_line_in_errors, parse_number
from plenoptic.core.values import whole
from plenoptic.core.warn import warn
from plenoptic.errors import FileWarning, InvalidValueError, PrescriptionError
from plenoptic.optics.glass.catalogue import GlassCatalogue
from plenoptic.optics.glass.media import AIR, D_LINE, Medium
from plenoptic.optics.lens.elements import check_count
from plenoptic.optics.lens.files.glass_names import GlassNames, model_medium
from plenoptic.optics.lens.files.zemax_stack import Row, lens_of_rows
from plenoptic.optics.lens.files.zemax_system import Aperture, System
from plenoptic.optics.lens.specification import StopSize
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.surfaces.odd_powers import OddPowerSag

_F_LINE, _C_LINE = 486.1327, 656.2725
_SAME_GLASS = 5e-4
"""Difference of n_d between a table and a catalogue up to which a name is trusted."""
_SAME_RADIUS = 1e-3
"""Relative difference up to which the radius in [aspherical data] agrees with that in [lens data]."""
_BISECTIONS = 60
"""Halvings of the way between two columns: to rounding errors."""
_PLANES = ("AS", "FS", "CG", "INFINITY")
_UNDEFINED = ("", "UNDEFINED")


class _Cells(NamedTuple):
    """A line of the table."""

    line: int
    cells: list[str]

    def cell(self, i: int) -> str:
        return self.cells[i] if i < len(self.cells) else ""

    def number(self, i: int, name: str) -> float:
        return math.inf if self.cell(i).upper().lstrip("+-") == "INFINITY" else parse_number(self.cell(i), name)


def lens_from_table(
    text: str,
    where: str,
    *,
    glasses: Mapping[str, Medium] | GlassCatalogue | None = None,
    stop_size: StopSize = StopSize.SYSTEM_APERTURE,
    configuration: int | None = None,
    focus: float | None = None,
) -> LensStack:
    """Lens from the text of a descriptive table; `where` names the file in messages, `glasses` are looked up first.

    The size of the stop is that of the table; the system aperture (F-Number) counts if it has none.
    """
    sections = _sections(text)
    lens_data = sections.get("lens data", [])
    if not lens_data:
        raise PrescriptionError(
            f"{where}: there is no section [lens data]; the tables that can be read are those of the Optical Bench, "
            "with columns between tabs"
        )
    columns = _columns(sections.get("variable distances", []), configuration, focus, where)
    catalogues = GlassNames.of(glasses)
    tables = [_rows(sections, variables, catalogues, where) for variables in columns]
    rows, variables = tables[0], columns[0]
    if focus is not None:
        rows = _at_focus(tables[0], tables[1], focus, where)
    title = next((cells.cell(1) for cells in sections.get("descriptive data", []) if cells.cell(0) == "title"), "")
    system = _system(variables, rows, lens_data[0].line)
    return lens_of_rows(rows, system, where, title or where.rpartition(".")[0], where, stop_size=stop_size)


def _rows(
    sections: Mapping[str, list[_Cells]], variables: Mapping[str, float], glasses: GlassNames, where: str
) -> list[Row]:
    """Rows of the lens with the values of the variables, from the object to the image."""
    lens_data, names = sections["lens data"], dict[str, int]()
    rows = [Row(0, {"SURF": lens_data[0].line}, gap=_distance(variables, "d0", math.inf))]
    for cells in lens_data:
        with name_line_in_errors(where, cells.line):
            check_count(len(rows))
            names[cells.cell(0)] = len(rows)
            rows.append(_row(cells, len(rows), variables, glasses))
    constants = {cells.cell(0): cells.cell(1) for cells in sections.get("constants", [])}
    for cells in sections.get("aspherical data", []):
        with name_line_in_errors(where, cells.line):
            if cells.cell(0) not in names:
                raise PrescriptionError(f"[aspherical data] names surface {cells.cell(0)[:20]!r}, which does not exist")
            i = names[cells.cell(0)]
            rows[i] = _aspheric(rows[i], cells, constants)
    return [*rows, Row(len(rows), {"SURF": lens_data[-1].line})]


def _sections(text: str) -> dict[str, list[_Cells]]:
    """Lines of each section that are not empty; lines that begin with # are comments."""
    sections: dict[str, list[_Cells]] = {}
    lines: list[_Cells] = []
    for number, line in enumerate(text.splitlines(), start=1):
        if line.startswith("["):
            lines = sections.setdefault(line.strip().strip("[]").lower(), [])
        elif line.strip() and not line.startswith("#"):
            lines.append(_Cells(number, [cell.strip() for cell in line.split("\t")]))
    return sections


def _columns(lines: list[_Cells], configuration: int | None, focus: float | None, where: str) -> list[dict[str, float]]:
    """Values of the variables in a configuration, or in the two columns next to a focus distance."""
    # The columns of distances: others may hold notes behind the values.
    widths = [len(cells.cells) - 1 for cells in lines if cells.cell(0) in ("Focal Length", "Magnification")]
    count = max(widths or [len(cells.cells) - 1 for cells in lines], default=1)
    chosen = 1 if configuration is None else whole(configuration, "configuration", at_least=1)
    if chosen > count:
        raise InvalidValueError(f"configuration is {chosen}; {where} has {count} ([variable distances])")
    if focus is not None:
        columns = [_column(lines, i, where) for i in range(1, count + 1)]
        distances = [_distance(values, "d0", math.inf) for values in columns]
        return [columns[i] for i in _columns_next_to(distances, chosen, focus, where)]
    if configuration is None and count > 1:
        warn(
            f"{where}: left out are all but the first of {count} configurations; choose by configuration=", FileWarning
        )
    return [_column(lines, chosen, where)]


def _columns_next_to(distances: Sequence[float], chosen: int, focus: float, where: str) -> tuple[int, int]:
    """Columns of a zoom position whose distances of the object (mm) enclose the focus distance, the nearer first.

    With several columns at infinity, the positions of a zoom, those of near objects follow in the same order.
    """
    n_zoom = max(1, sum(map(math.isinf, distances)))
    if len(distances) % n_zoom or (n_zoom > 1 and not all(map(math.isinf, distances[:n_zoom]))):
        raise InvalidValueError(
            f"{where} does not state the same focus distances (d0) for each of {n_zoom} zoom positions, those of "
            "infinity first; choose a column by configuration="
        )
    positions = range((chosen - 1) % n_zoom, len(distances), n_zoom)
    nearer = [i for i in positions if distances[i] <= focus]
    farther = [i for i in positions if distances[i] >= focus]
    if not nearer or not farther:
        stated = [distances[i] for i in positions]
        raise InvalidValueError(f"focus is {focus:g} mm; {where} states {min(stated):g} to {max(stated):g} mm (d0)")
    return max(nearer, key=distances.__getitem__), min(farther, key=distances.__getitem__)


def _at_focus(near: list[Row], far: list[Row], focus: float, where: str) -> list[Row]:
    """Rows of the position at which an object at the focus distance has its paraxial image where the columns have it.

    All gaps and the stop's diameter change linearly from column to column, and so does the distance of the image from
    the image surface.
    """
    if far[0].gap == focus:
        return far
    defocus_near, defocus_far = _defocus(near), _defocus(far)

    def rows_at(part: float) -> list[Row]:
        moved = [
            a._replace(gap=a.gap + part * (b.gap - a.gap), diameter=a.diameter + part * (b.diameter - a.diameter))
            for a, b in zip(near[1:], far[1:], strict=True)
        ]
        return [near[0]._replace(gap=focus), *moved]

    def excess(part: float) -> float:
        return _defocus(rows_at(part)) - (defocus_near + part * (defocus_far - defocus_near))

    low, high, sign = 0.0, 1.0, math.copysign(1.0, excess(1.0))
    if not excess(0.0) * sign <= 0:
        raise InvalidValueError(
            f"focus is {focus:g} mm, and no position between the columns of {where} for {near[0].gap:g} and "
            f"{far[0].gap:g} mm (d0) has its image there; choose one of them by configuration="
        )
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if excess(middle) * sign > 0 else (middle, high)
    return rows_at(0.5 * (low + high))


def _defocus(rows: list[Row]) -> float:
    """Distance in mm from the image surface to the paraxial image at the d line."""
    distance = rows[0].gap
    y, angle, n = (1.0, 0.0, 1.0) if math.isinf(distance) else (distance, 1.0, 1.0)  # the angle times the index
    for row in rows[1:-1]:
        behind = float(row.medium.index(D_LINE))
        curvature = row.curvature + (2.0 * row.aspheric[0] if row.aspheric else 0.0)
        angle -= (behind - n) * curvature * y
        y, n = y + row.gap * angle / behind, behind
    return -n * y / angle if angle else math.inf


def _column(lines: list[_Cells], chosen: int, where: str) -> dict[str, float]:
    """Values of the variables in a column, from 1, without undefined ones."""
    values = {}
    for cells in lines:
        # A single value holds in all configurations.
        i = chosen if len(cells.cells) > 2 else 1
        if cells.cell(i).upper() not in _UNDEFINED:
            with name_line_in_errors(where, cells.line):
                values[cells.cell(0)] = cells.number(i, cells.cell(0))
    return values


def _distance(variables: Mapping[str, float], name: str, default: float) -> float:
    value = variables.get(name, default)
    return default if value <= 0 and name == "d0" else value


def _row(cells: _Cells, number: int, variables: Mapping[str, float], glasses: GlassNames) -> Row:
    radius = 0.0 if cells.cell(1).upper() in _PLANES else cells.number(1, "the radius")
    thickness = cells.cell(2)
    if thickness in variables:
        gap = variables[thickness]
    elif thickness[:1].isalpha():
        raise PrescriptionError(
            f"the thickness {thickness[:20]!r} has no value in [variable distances] for this configuration; choose "
            "another by configuration="
        )
    else:
        gap = cells.number(2, "the thickness")
    is_stop = cells.cell(1).upper() == "AS"
    diameter = cells.number(4, "the clear diameter") if cells.cell(4).upper() not in _UNDEFINED else 0.0
    if is_stop:
        diameter = variables.get("Aperture Diameter", diameter)
    return Row(
        number,
        {"SURF": cells.line},
        curvature=1.0 / radius if radius else 0.0,
        gap=gap,
        medium=_medium(cells, glasses),
        diameter=0.5 * diameter if math.isfinite(diameter) else 0.0,
        is_stop=is_stop,
    )


def _medium(cells: _Cells, glasses: GlassNames) -> Medium:
    if not cells.cell(3):
        return AIR
    nd = cells.number(3, "n_d")
    if cells.cell(6):
        try:
            catalogue_glass = glasses._replace(makers=cells.cells[7:8]).medium(cells.cell(6))
            if abs(catalogue_glass.index(D_LINE) - nd) <= _SAME_GLASS:
                return catalogue_glass
        except InvalidValueError:
            pass
    return model_medium(nd, cells.number(5, "V_d") if cells.cell(5) else 0.0)


def _aspheric(row: Row, cells: _Cells, constants: Mapping[str, str]) -> Row:
    """Row with the conic constant and the coefficients of a line of [aspherical data]."""
    radius = cells.number(1, "the radius")
    if abs(radius * row.curvature - 1.0) > _SAME_RADIUS and not (math.isinf(radius) and row.curvature == 0):
        other = 1.0 / row.curvature if row.curvature else math.inf
        raise PrescriptionError(f"the radius is {radius:g} in [aspherical data], {other:g} in [lens data]; correct one")
    conic = cells.number(2, "the conic constant") if cells.cell(2) else 0.0
    numbers = [cells.number(i, "a coefficient") if cells.cell(i) else 0.0 for i in range(3, len(cells.cells))]
    odd = list[float]()
    if constants.get("AsphericalOddCount", "0") != "0":
        n_odd = int(parse_number(constants["AsphericalOddCount"] or "1", "AsphericalOddCount"))
        odd, numbers = numbers[: 2 * n_odd : 2], numbers[1 : 2 * n_odd : 2] + numbers[2 * n_odd :]
        if any(odd) and "AsphericalA2" in constants:
            raise PrescriptionError(
                "[constants] have AsphericalA2 and AsphericalOddCount, and the order of the powers of r is not known"
            )
    aspheric = numbers if "AsphericalA2" in constants else [0.0, *numbers]
    return row._replace(conic=conic, aspheric=tuple(aspheric), freeform=OddPowerSag(odd) if any(odd) else None)


def _system(variables: Mapping[str, float], rows: list[Row], line: int) -> System:
    """Fields and wavelengths, and the f-number if the stop has no size."""
    angle, height = variables.get("Angle of View", 0.0), variables.get("Image Height", 0.0)
    is_angle = angle > 0 or not height
    fields = np.array([[0.0, 0.0], [0.0, 0.5 * (angle if is_angle else height)]])
    aperture = None
    if "F-Number" in variables and not any(row.is_stop and row.diameter for row in rows):
        aperture = Aperture(line, "FNUM", variables["F-Number"], False)
    return System(aperture, fields, 0 if is_angle else 2, (D_LINE, _F_LINE, _C_LINE), ())
