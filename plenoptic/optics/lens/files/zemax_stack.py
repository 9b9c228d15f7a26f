"""Conversion of the rows of a Zemax file to a lens: stops, removal of surfaces, and missing semi-diameters."""

from __future__ import annotations

import contextlib
import dataclasses
import enum
import itertools
import math
from typing import NamedTuple

import numpy as np

from plenoptic.core.files.text_lines import name_line_in_errors
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError, PrescriptionError
from plenoptic.optics.glass.media import AIR, Medium
from plenoptic.optics.lens.elements import Element
from plenoptic.optics.lens.files.infer_stop import basis_rays, with_inferred_stop
from plenoptic.optics.lens.files.zemax_rims import ray_heights
from plenoptic.optics.lens.files.zemax_system import Aperture, System
from plenoptic.optics.lens.gaussian.matrices import over
from plenoptic.optics.lens.placement import Placement
from plenoptic.optics.lens.specification import Specification, StopSize
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.stops.circle import CircularStop
from plenoptic.optics.stops.ring import RingStop
from plenoptic.optics.surfaces.freeform_registry import FreeformTerm
from plenoptic.optics.surfaces.mirror import medium_behind
from plenoptic.optics.surfaces.surface import Surface

_ROUNDING = 1e-12
_UNKNOWN_SIZE = 1e-9
"""Placeholder for an unknown semi-diameter in mm; relative to the radius of curvature if that is smaller."""
_BEYOND = 1.1
"""Outer radius of a ring over the semi-diameter of its surface."""
_INFINITE = 1e10
"""Distance in mm from which on an object counts as at infinity."""


class Row(NamedTuple):
    """A surface of the file; lengths in mm."""

    number: int
    lines: dict[str, int]
    """Line number in the file of each keyword."""
    curvature: float = 0.0
    conic: float = 0.0
    aspheric: tuple[float, ...] = ()
    freeform: FreeformTerm | None = None
    offset: float = 0.0
    """Vertex sag in mm that the freeform term excludes: the surface lies this far behind its nominal vertex."""
    gap: float = 0.0
    medium: Medium = AIR
    diameter: float = 0.0
    """DIAM, which is a semi-diameter in mm; 0 if unknown."""
    aperture: float | None = None
    """Radius of a round aperture."""
    obscured: float = 0.0
    """Radius of a central round obscuration."""
    is_stop: bool = False
    is_mirror: bool = False
    is_negative: bool = False
    """True if the index behind the surface is negative: light travels along -z."""
    turn: tuple[float, ...] | None = None
    """Coordinate break: decentre along x and y in mm, tilt about x, y and z in degrees, and the order flag."""
    placement: Placement | None = None

    @property
    def stop_size(self) -> float:
        """Semi-diameter in mm of a stop at this surface; 0 if unknown."""
        return min([size for size in (self.aperture, self.diameter or None) if size is not None], default=0.0)

    @property
    def is_plane(self) -> bool:
        """True if the row has no curvature at all."""
        return self.curvature == 0 and not any(self.aspheric) and self.freeform is None


class _As(enum.Enum):
    """Kind of element that a row of the file becomes."""

    SURFACE = 0
    STOP = 1
    RING = 2


class _Piece(NamedTuple):
    element: Element
    row: Row
    size_is_known: bool


def lens_of_rows(
    rows: list[Row], system: System, where: str, name: str, source: str, *, stop_size: StopSize
) -> LensStack:
    """Lens from rows; the first row is the object and the last one the image."""
    flagged = [row for row in rows if row.is_stop]
    if len(flagged) > 1:
        raise _error(where, flagged[1], "STOP", f"surface {flagged[1].number} is a second STOP; a lens has one")
    if flagged and flagged[0] in (rows[0], rows[-1]):
        raise _error(where, flagged[0], "STOP", "the object or the image is the STOP; it must lie between them")
    front_medium = rear_medium = rows[0].medium
    for row in rows[1:-1]:
        rear_medium = medium_behind(row.medium, rear_medium) if row.turn is None else rear_medium
    if rows[0].gap >= _INFINITE:
        rows = [rows[0]._replace(gap=math.inf), *rows[1:]]
    # A surface with its vertex behind the nominal one has a longer gap in front and a shorter one behind.
    offsets = [row.offset for row in rows] + [0.0]
    rows = [row._replace(gap=row.gap + (offsets[i + 1] - offsets[i])) for i, row in enumerate(rows)]
    pieces, distance, behind = _pieces(rows, front_medium, where)
    if not pieces:
        raise _error(where, rows[-2], "SURF", "there is no surface and no stop; a lens needs both")
    stop = next((piece for piece in pieces if piece.row.is_stop), None)
    aperture = system.aperture
    if stop is None or (stop_size is StopSize.DIAMETER and stop.size_is_known):
        aperture = None
    beam = None
    try:
        beam = _ParaxialBeam.of(pieces, system, distance, front_medium, rear_medium)
    except InvalidValueError as error:
        if aperture is not None or not all(piece.size_is_known for piece in pieces):
            raise _error(where, rows[1], "SURF", f"at the primary wavelength, {error}") from None
    if beam is not None:
        behind = beam.to_image if system.is_focused and beam.leaving else behind
        pieces = _with_sizes(pieces, system, aperture, beam, where)
    elements = [piece.element for piece in pieces]
    surfaces = [element for element in elements if isinstance(element, Surface)]
    iris = None if stop is None else next(i for i, piece in enumerate(pieces) if piece.row is stop.row)
    with name_line_in_errors(where, rows[-2].lines["SURF"]):
        if iris is None and surfaces and len(surfaces) == len(elements) and front_medium == AIR:
            elements, source = with_inferred_stop(surfaces), f"{source}; stop placed by rule"
        elif iris is None and surfaces:
            raise PrescriptionError("no surface is the STOP; mark one")
        lens = LensStack(elements, iris, name, source, front_medium=front_medium, rear_medium=rear_medium)
        specification = _specification(lens, stop and stop.row, system, beam, (distance, behind), rows[-1])
    return dataclasses.replace(lens, specification=specification)


def _error(where: str, row: Row, keyword: str, message: str) -> PrescriptionError:
    return PrescriptionError(f"{where}, line {row.lines.get(keyword, row.lines['SURF'])}: {message}")


def _pieces(rows: list[Row], front_medium: Medium, where: str) -> tuple[list[_Piece], float, float]:
    """Elements, and the distances in mm from the object to the first of them and from the last to the image."""
    kinds: list[tuple[Row, _As, float]] = []  # row, kind of element, gap
    before, distance = front_medium, rows[0].gap
    for row in rows[1:-1]:
        refracts, gap = row.medium != before, row.gap
        if row.obscured > 0:
            kinds.append((row._replace(is_stop=False), _As.RING, 0.0))
        if row.is_stop:
            kinds.append((row, _As.STOP, 0.0 if refracts else gap))
        if refracts or (row.aperture is not None and not row.is_plane and not row.is_stop):
            kinds.append((row, _As.SURFACE, gap))
        elif row.aperture is not None and not row.is_stop:
            kinds.append((row, _As.STOP, gap))
        elif not row.is_stop and kinds:
            kinds[-1] = (*kinds[-1][:2], kinds[-1][2] + gap)
        elif not row.is_stop:
            distance += gap
        before = medium_behind(row.medium, before)
    for (row, kind, gap), (following, *_) in itertools.pairwise(kinds):
        if kind is _As.SURFACE and gap < 0 and following.is_stop:
            message = f"the stop lies {-gap:g} mm before the vertex of surface {row.number}, which light meets first"
            raise _error(where, row, "DISZ", f"{message}; such a stop cannot be modelled: give it a surface before it")
    last = len(kinds) - 1
    pieces = [_piece(row, kind, 0.0 if i == last else gap, where) for i, (row, kind, gap) in enumerate(kinds)]
    return pieces, distance, kinds[-1][2] if kinds else 0.0


def _piece(row: Row, kind: _As, gap: float, where: str) -> _Piece:
    size = row.aperture if row.aperture is not None else row.diameter
    size = row.stop_size if kind is _As.STOP and row.is_stop else size
    has_size = size != 0 or row.aperture is not None
    radius = 1.0 / row.curvature if row.curvature else math.inf
    if not has_size:
        size = _UNKNOWN_SIZE * min(1.0, abs(radius))
    try:
        if kind is _As.RING:
            # The rim of the surface limits the light; that of the ring is larger.
            ring = RingStop(_BEYOND * max(size, row.obscured), row.obscured, gap, placement=row.placement)
            return _Piece(ring, row, has_size)
        if kind is _As.STOP:
            return _Piece(CircularStop(size, gap, placement=row.placement), row, has_size)
        equator = _equator(row)
        if equator < size <= equator * (1.0 + _ROUNDING):
            # A radius from a written curvature has a rounding error: the semi-diameter may exceed the equator by it.
            size = equator
        surface = Surface(
            radius,
            gap,
            row.medium,
            semi_diameter=size,
            conic=row.conic,
            aspheric=row.aspheric,
            freeform=row.freeform,
            placement=row.placement,
        )
        return _Piece(surface, row, has_size)
    except InvalidValueError as error:
        size_from = next((keyword for keyword in ("CLAP", "FLAP") if keyword in row.lines), "DIAM")
        keyword = "DISZ" if "thickness" in str(error) else size_from if "semi_diameter" in str(error) else "CURV"
        raise _error(where, row, keyword, str(error)) from None


def _equator(row: Row) -> float:
    """Largest distance of a conic from the axis; inf for planes, paraboloids and hyperboloids."""
    return 1.0 / (abs(row.curvature) * math.sqrt(1.0 + row.conic)) if row.curvature and row.conic > -1 else math.inf


class _ParaxialBeam(NamedTuple):
    """Paraxial beam: rays as (height, reduced angle) at the first element, lengths in mm."""

    heights: Floats
    """(n, 2): heights of the basis rays at the elements."""
    leaving: float
    """Reduced angle behind the lens of the marginal ray."""
    stop: int | None
    front_medium: Medium
    rear_medium: Medium
    front_index: float
    rear_index: float
    distance: float
    power: float
    """1/mm."""
    pupil: float
    """Distance from the first element to the entrance pupil; inf or nan if there is none."""
    marginal: Floats
    """Marginal ray up to a factor."""

    @classmethod
    def of(
        cls, pieces: list[_Piece], system: System, distance: float, front_medium: Medium, rear_medium: Medium
    ) -> _ParaxialBeam:
        """Beam through the elements, regardless of their sizes."""
        wavelength = system.wavelengths[0]
        with np.errstate(all="ignore"):  # an overflow gives a semi-diameter that is refused
            elements = [piece.element for piece in pieces]
            heights, leaving = basis_rays(elements, front_medium=front_medium, wavelength=wavelength)
            stop = next((i for i, piece in enumerate(pieces) if piece.row.is_stop), None)
            index, rear_index = float(front_medium.index(wavelength)), float(rear_medium.index(wavelength))
            a, b = heights[stop].tolist() if stop is not None else (0.0, 0.0)
            marginal = np.array([1.0, 0.0]) if math.isinf(distance) else np.array([distance, index])
            pupil = index * b / a if a != 0 else math.inf
            media, power = (front_medium, rear_medium, index, rear_index), -float(leaving[1, 0])
            return cls(heights, float(leaving[1] @ marginal), stop, *media, distance, power, pupil, marginal)

    @property
    def front_focal_length(self) -> float:
        """Focal length in the front medium in mm; inf for an afocal lens."""
        return over(self.front_index, self.power)

    @property
    def at_pupil(self) -> float:
        """Height of the marginal ray in the entrance pupil."""
        if not math.isfinite(self.pupil):
            raise PrescriptionError("the entrance pupil is at infinity")
        return float(abs(self.marginal[0] + self.marginal[1] * self.pupil / self.front_index))

    @property
    def to_image(self) -> float:
        """Distance from the last element to the paraxial image; `leaving` is not 0."""
        return -self.rear_index * float(self.heights[-1] @ self.marginal) / self.leaving

    def factor(self, aperture: Aperture) -> float:
        """Factor that scales the marginal ray to a system aperture."""
        keyword, size, is_other = aperture.keyword, aperture.size, aperture.is_other
        if not size > 0:
            raise PrescriptionError("it must be above 0")
        if keyword == "OBNA":
            if math.isinf(self.distance):
                raise PrescriptionError("the object is at infinity and has no numerical aperture")
            sine = math.sin(math.radians(min(size, 90.0))) if is_other else size / self.front_index
            if sine >= 1:
                raise PrescriptionError("it must be below that of a half space")
            return sine / math.sqrt(1.0 - sine * sine)
        if keyword == "FNUM" and is_other:
            target, has = 0.5 / size, abs(self.leaving)
        else:
            target, has = 0.5 * self.pupil_diameter(aperture), self.at_pupil
        if not (0 < has < math.inf and 0 < target < math.inf):
            raise PrescriptionError("it does not determine the marginal ray of this lens")
        return target / has

    def pupil_diameter(self, aperture: Aperture) -> float:
        """Diameter of the entrance pupil for a system aperture."""
        if aperture.keyword == "ENPD":
            return aperture.size
        if aperture.keyword == "FNUM" and not aperture.is_other:
            return over(1.0 / aperture.size, abs(self.power))
        return 2.0 * self.factor(aperture) * self.at_pupil


def _with_sizes(
    pieces: list[_Piece], system: System, aperture: Aperture | None, beam: _ParaxialBeam, where: str
) -> list[_Piece]:
    """Fill missing semi-diameters from the beam, and that of the stop from the system aperture, if there is one."""
    scale = 0.0
    if beam.stop is not None and aperture is not None:
        try:
            scale = beam.factor(aperture)
        except PrescriptionError as error:
            raise PrescriptionError(
                f"{where}, line {aperture.line}: {aperture.keyword} {aperture.size:g} does not determine the stop: "
                f"{error}; give stop_size=pl.optics.StopSize.DIAMETER"
            ) from None
        pieces = _with_stop(pieces, beam.stop, scale * float(abs(beam.heights[beam.stop] @ beam.marginal)), where)
    unknown = [piece for piece in pieces if not piece.size_is_known]
    if not unknown:
        return pieces
    try:
        if beam.stop is None or not len(system.fields):
            raise PrescriptionError("it follows from the beam only with a STOP and a field (YFLN); give it")
        if aperture is None:
            if not pieces[beam.stop].size_is_known:
                raise PrescriptionError(
                    "it follows from the beam only with its size (ENPD, FNUM, OBNA or DIAM); give it"
                )
            at_stop = float(abs(beam.heights[beam.stop] @ beam.marginal))
            scale = pieces[beam.stop].element.semi_diameter / at_stop if at_stop else math.inf
        if not math.isfinite(beam.pupil):
            raise PrescriptionError("the entrance pupil is at infinity; give it")
        slopes = system.chief_slopes(beam.distance, beam.pupil, beam.front_focal_length)
    except InvalidValueError as error:
        if all(isinstance(piece.element, RingStop) for piece in unknown):
            # Discs on planes without refraction stop no light outside.
            largest = max(piece.element.semi_diameter for piece in pieces)
            return [piece if piece.size_is_known else _resize(piece, largest, where) for piece in pieces]
        row = unknown[0].row
        raise _error(where, row, "DIAM", f"surface {row.number} has no semi-diameter (DIAM): {error}") from None
    chief = float(np.hypot(*slopes.T).max()) * np.array([-beam.pupil, beam.front_index])
    with np.errstate(all="ignore"):
        sizes = np.abs(beam.heights @ beam.marginal) * scale + np.abs(beam.heights @ chief)
    paraxial = [_with_size(piece, float(size), where) for piece, size in zip(pieces, sizes, strict=True)]
    try:
        elements = [piece.element for piece in paraxial]
        lens = LensStack(elements, beam.stop, front_medium=beam.front_medium, rear_medium=beam.rear_medium)
    except InvalidValueError:
        return paraxial
    real = ray_heights(lens, slopes, beam.pupil, scale * beam.at_pupil, beam.distance, system.wavelengths[0])
    return [_with_size(piece, float(max(pair)), where) for piece, *pair in zip(pieces, sizes, real, strict=True)]


def _with_size(piece: _Piece, size: float, where: str) -> _Piece:
    return piece if piece.size_is_known else _resize(piece, min(size, _equator(piece.row)), where)


def _with_stop(pieces: list[_Piece], stop: int, size: float, where: str) -> list[_Piece]:
    """Set the semi-diameter of the stop, limited by its aperture; the surface of the stop becomes at least as large."""
    resized, aperture = list(pieces), pieces[stop].row.aperture
    resized[stop] = _resize(pieces[stop], size if aperture is None else min(size, aperture), where)
    for i, piece in enumerate(pieces):
        is_here = i != stop and piece.row.number == pieces[stop].row.number
        if is_here and piece.size_is_known and piece.row.aperture is None:
            resized[i] = _resize(piece, max(size, piece.element.semi_diameter), where)
    return resized


def _resize(piece: _Piece, size: float, where: str) -> _Piece:
    if isinstance(piece.element, RingStop):
        size = _BEYOND * max(size, piece.element.inner_semi_diameter)
    try:
        return piece._replace(element=dataclasses.replace(piece.element, semi_diameter=size), size_is_known=True)
    except InvalidValueError as error:
        raise _error(where, piece.row, "DIAM", f"semi-diameter from the paraxial beam: {error}") from None


def _specification(
    lens: LensStack, stop: Row | None, system: System, beam: _ParaxialBeam | None, gaps: tuple[float, float], image: Row
) -> Specification:
    """Specification of the lens by the file, without data that cannot be derived."""
    aperture, diameter, fields = system.aperture, None, np.zeros((0, 2))
    if beam is not None:
        with contextlib.suppress(PrescriptionError), np.errstate(all="ignore"):
            points = system.object_points(beam.distance, beam.pupil, beam.front_focal_length)
            fields = points if np.isfinite(points).all() else fields
        if aperture is not None and aperture.size > 0:
            with contextlib.suppress(PrescriptionError):
                asked_diameter = beam.pupil_diameter(aperture)
                diameter = asked_diameter if 0 < asked_diameter < math.inf else None
    z = lens.vertices
    return Specification(
        fields,
        system.wavelengths,
        z_object=float(z[0]) - gaps[0],
        z_image=float(z[-1]) + gaps[1],
        image_radius=1.0 / image.curvature if image.curvature else math.inf,
        entrance_pupil_diameter=diameter,
        stop_semi_diameter=None if stop is None else stop.stop_size or None,
    )
