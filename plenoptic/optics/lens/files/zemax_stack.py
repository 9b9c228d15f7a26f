"""From the rows of a Zemax file to a lens: stops, surfaces that vanish, and semi-diameters that are missing."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from plenoptic.core.files.text_lines import naming_line
from plenoptic.errors import InvalidValueError, PrescriptionError
from plenoptic.optics.glass.media import AIR, D_LINE, Medium
from plenoptic.optics.lens.elements import Element
from plenoptic.optics.lens.files.infer_stop import basis_rays, with_inferred_stop
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.stops.circle import CircularStop
from plenoptic.optics.surfaces.registry import Departure
from plenoptic.optics.surfaces.surface import Surface

_ROUNDING = 1e-12

_UNKNOWN_SIZE = 1e-9
"""Stands for a semi-diameter, in mm, until it is known; relative to the radius of curvature where that is smaller."""

_INFINITE = 1e10
"""mm; an object so far away is infinitely far."""

_ANGLE, _OBJECT_HEIGHT, _IMAGE_HEIGHT, _REAL_IMAGE_HEIGHT = range(4)


class Row(NamedTuple):
    """A surface of the file; lengths in mm."""

    number: int
    lines: dict[str, int]
    """In which line of the file each keyword stands."""
    curvature: float = 0.0
    conic: float = 0.0
    aspheric: tuple[float, ...] = ()
    departure: Departure | None = None
    offset: float = 0.0
    """Sag at the vertex, which a departure leaves out: the surface stands so far behind its place."""
    gap: float = 0.0
    medium: Medium = AIR
    diameter: float = 0.0
    """DIAM, which is a semi-diameter; 0 where it is unknown."""
    aperture: float | None = None
    """Radius of a round aperture."""
    is_stop: bool = False

    @property
    def is_plane(self) -> bool:
        """Whether it has no curvature at all."""
        return self.curvature == 0 and not any(self.aspheric) and self.departure is None


class System(NamedTuple):
    """What the file says of the beam; lengths in mm, wavelength in nm, None where it says nothing."""

    pupil_diameter: float | None = None
    f_number: float | None = None
    field: float | None = None
    """The largest; degrees, or mm where `field_type` says that fields are heights."""
    field_type: int = _ANGLE
    wavelength: float = D_LINE


class _Piece(NamedTuple):
    element: Element
    row: Row
    size_is_known: bool


def stacked(rows: list[Row], system: System, where: str, name: str, source: str) -> LensStack:
    """The lens of the rows, of which the first is the object and the last the image."""
    flagged = [row for row in rows if row.is_stop]
    if len(flagged) > 1:
        raise _error(where, flagged[1], "STOP", f"surface {flagged[1].number} is a second STOP; a lens has one")
    if flagged and flagged[0] in (rows[0], rows[-1]):
        raise _error(
            where, flagged[0], "STOP", "the object or the image is the STOP; it must be a surface between them"
        )
    ambient = rows[0].medium
    if rows[0].gap >= _INFINITE:
        rows = [rows[0]._replace(gap=math.inf), *rows[1:]]
    # A surface whose vertex lies behind its place has a longer gap before it and a shorter one behind.
    offsets = [row.offset for row in rows] + [0.0]
    rows = [row._replace(gap=row.gap + (offsets[i + 1] - offsets[i])) for i, row in enumerate(rows)]
    pieces, distance = _pieces(rows, ambient, where)
    if any(not piece.size_is_known for piece in pieces):
        pieces = _with_sizes(pieces, system, distance, ambient, where)
    elements = [piece.element for piece in pieces]
    surfaces = [element for element in elements if isinstance(element, Surface)]
    iris = next((i for i, piece in enumerate(pieces) if piece.row.is_stop), None)
    with naming_line(where, rows[-2].lines["SURF"]):
        if iris is None and surfaces and len(surfaces) == len(elements) and ambient == AIR:
            elements, source = with_inferred_stop(surfaces), f"{source}; stop placed by rule"
        elif iris is None and surfaces:
            raise PrescriptionError("no surface is the STOP; mark one")
        lens = LensStack(elements, iris, name, source, ambient=ambient)
    return lens


def _error(where: str, row: Row, keyword: str, message: str) -> PrescriptionError:
    return PrescriptionError(f"{where}, line {row.lines.get(keyword, row.lines['SURF'])}: {message}")


def _pieces(rows: list[Row], ambient: Medium, where: str) -> tuple[list[_Piece], float]:
    """The elements, and the distance in mm from the object to the first of them."""
    kept: list[tuple[Row, bool, float]] = []  # row, whether a stop or a surface, gap
    before, distance = ambient, rows[0].gap
    for row in rows[1:-1]:
        refracts, gap = row.medium != before, row.gap
        if row.is_stop:
            kept.append((row, True, 0.0 if refracts else gap))
        if refracts or (row.aperture is not None and not row.is_plane and not row.is_stop):
            kept.append((row, False, gap))
        elif row.aperture is not None and not row.is_stop:
            kept.append((row, True, gap))
        elif not row.is_stop and kept:
            kept[-1] = (*kept[-1][:2], kept[-1][2] + gap)
        elif not row.is_stop:
            distance += gap
        before = row.medium
    last = len(kept) - 1
    return [_piece(row, stop, 0.0 if i == last else gap, where) for i, (row, stop, gap) in enumerate(kept)], distance


def _piece(row: Row, as_stop: bool, gap: float, where: str) -> _Piece:
    size = row.aperture if row.aperture is not None else row.diameter
    known = size != 0 or row.aperture is not None
    radius = 1.0 / row.curvature if row.curvature else math.inf
    if not known:
        size = _UNKNOWN_SIZE * min(1.0, abs(radius))
    try:
        if as_stop:
            return _Piece(CircularStop(size, gap), row, known)
        equator = abs(radius) / math.sqrt(1.0 + row.conic) if row.conic > -1 else 0.0
        if size <= equator * (1.0 + _ROUNDING):
            # A curvature that was written from a radius gives it back to rounding only.
            size = min(size, equator)
        surface = Surface(
            radius, gap, row.medium, semi_diameter=size, conic=row.conic, aspheric=row.aspheric, departure=row.departure
        )
        return _Piece(surface, row, known)
    except InvalidValueError as error:
        size_from = next((keyword for keyword in ("CLAP", "FLAP") if keyword in row.lines), "DIAM")
        keyword = "DISZ" if "thickness" in str(error) else size_from if "semi_diameter" in str(error) else "CURV"
        raise _error(where, row, keyword, str(error)) from None


def _with_sizes(pieces: list[_Piece], system: System, distance: float, ambient: Medium, where: str) -> list[_Piece]:
    first = next(piece.row for piece in pieces if not piece.size_is_known)
    try:
        with np.errstate(all="ignore"):  # what overflows ends as a semi-diameter that is refused
            sizes = _beam(pieces, system, distance, ambient)
    except InvalidValueError as error:
        raise _error(where, first, "DIAM", f"surface {first.number} has no semi-diameter (DIAM): {error}") from None
    made = []
    for piece, size in zip(pieces, sizes, strict=True):
        try:
            element = piece.element if piece.size_is_known else dataclasses.replace(piece.element, semi_diameter=size)
        except InvalidValueError as error:
            raise _error(where, piece.row, "DIAM", f"semi-diameter from the paraxial beam: {error}") from None
        made.append(piece._replace(element=element))
    return made


def _beam(pieces: list[_Piece], system: System, distance: float, ambient: Medium) -> list[float]:
    """Height of the marginal ray plus, at surfaces, of the chief ray of the largest field, at every element."""
    heights, leaving = basis_rays([piece.element for piece in pieces], ambient=ambient, wavelength=system.wavelength)
    stop = next((i for i, piece in enumerate(pieces) if piece.row.is_stop), None)
    if stop is None or system.field is None:
        raise PrescriptionError("it follows from the beam only with a STOP and a field (YFLN); give it")
    index, (a, b) = ambient.index(system.wavelength), heights[stop].tolist()
    if a == 0:
        raise PrescriptionError("the entrance pupil is infinitely far away; give it")
    pupil = index * b / a  # behind the first element
    focal_length = float(-1.0 / leaving[1, 0]) if leaving[1, 0] != 0 else math.inf
    # Rays as (height, reduced angle) at the first element: the marginal one up to a factor.
    marginal = np.array([1.0, 0.0]) if math.isinf(distance) else np.array([distance, index])
    radius = _pupil_radius(pieces[stop], system, focal_length, 1.0 / abs(a))
    at_pupil = float(abs(marginal[0] + marginal[1] * pupil / index))
    marginal = marginal * (radius / at_pupil if at_pupil else math.inf)
    slope = _chief_slope(system, distance, pupil, focal_length)
    chief = slope * np.array([-pupil, index])
    return [
        float(abs(pair @ marginal)) + (0.0 if isinstance(piece.element, CircularStop) else float(abs(pair @ chief)))
        for piece, pair in zip(pieces, heights, strict=True)
    ]


def _pupil_radius(stop: _Piece, system: System, focal_length: float, magnification: float) -> float:
    if stop.size_is_known:
        return stop.element.semi_diameter * magnification
    if system.pupil_diameter is not None:
        return system.pupil_diameter / 2
    if system.f_number is not None and system.f_number > 0:
        return abs(focal_length) / (2 * system.f_number)
    raise PrescriptionError("it follows from the beam only with its size (ENPD, FNUM or DIAM of the stop); give it")


def _chief_slope(system: System, distance: float, pupil: float, focal_length: float) -> float:
    """Tangent of the chief ray's angle in front of the lens."""
    assert system.field is not None
    if system.field_type == _ANGLE:
        return math.tan(math.radians(min(system.field, 89.0)))
    if system.field_type == _OBJECT_HEIGHT and math.isfinite(distance) and distance + pupil != 0:
        return system.field / (distance + pupil)
    if system.field_type in (_IMAGE_HEIGHT, _REAL_IMAGE_HEIGHT) and math.isinf(distance):
        return system.field / focal_length
    raise PrescriptionError(f"fields of type {system.field_type} do not give the chief ray here; give it")
