"""A lens as the numbers that kernels read."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.errors import PrescriptionError
from plenoptic.optics.lens.elements import Element
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.placement import Placement
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.stops.shapes import MaskStop, StarStop
from plenoptic.optics.stops.stops import CircularStop, PolygonStop, Stop
from plenoptic.optics.surfaces.sag_bounds import asphere_bounds
from plenoptic.optics.surfaces.surface import Surface

SURFACE, CIRCLE, POLYGON, CONIC, ASPHERE, IDEAL, ARCS, STAR, MASK = range(9)
"""Kinds of rows: sphere or plane, round stop, stop of straight blades, conic, even asphere, thick lens without
aberrations, stop of curved blades, star, mask."""

SHAPED = (POLYGON, ARCS, STAR, MASK)
"""Kinds of stops that are more than the circle around them."""

ROW = np.dtype(
    [
        ("kind", np.int64),
        ("z", np.float64),
        ("curvature", np.float64),
        ("index_ratio", np.float64),
        ("semi_diameter2", np.float64),
        ("max_depth", np.float64),
        ("surface_index", np.int64),
    ]
)
"""One element of a lens.

z               vertex in mm
curvature       1 / radius in 1/mm, 0 for planes and stops; IDEAL: 1 / focal length
index_ratio     index before over index behind, in the direction of travel; of several wavelengths that of the first one
semi_diameter2  mm^2
max_depth       largest c (1 + k) z of a point of the surface: 1 is the equator, inf no limit; IDEAL: from the principal
                plane where light arrives to the one where it leaves, in mm
surface_index   index of the element in the lens
"""

FRAME = 13
"""Numbers of a placement: the rotation row by row, the shift, and 1 if there is one."""

MOVED = FRAME - 1
"""Where a placement has that last number."""

MASK_HEAD = 4
"""Numbers of a mask before its cells: where they begin in `masks`, rows, columns, and cells per mm."""

STEEPEST, SHARPEST, TALLEST, FIRST_TERM = range(4)
"""Where aspheric numbers have the largest slope, second derivative and sag inside the semi-diameter, and where the
coefficients begin."""

EQUATOR_TOLERANCE = 1e-12
"""A rim that is the equator itself belongs to the surface."""


class LensRecord(NamedTuple):
    """A lens for one direction of travel, one entry an element, in the order in which light arrives."""

    rows: NDArray[np.void]
    """(n,) of the dtype ROW."""
    edges: NDArray[np.float64]
    """(k, 4): a, b, p and q of the edges of all stops, a x + b y + q (x^2 + y^2) <= p; see `PolygonStop.edges` and
    `StarStop.edges`. Straight ones: outward normal x, y, distance from the axis, and 0."""
    first_edge: NDArray[np.int64]
    """(n + 1,): the edges of element i are first_edge[i] to first_edge[i + 1]."""
    conic: NDArray[np.float64] | None
    """(n,) conic constants; None where all surfaces are spheres and planes."""
    aspheric: NDArray[np.float64] | None
    """(n, FIRST_TERM + terms): the largest slope, the largest second derivative by r and the largest sag of an asphere,
    in size, and its coefficients of r^2, r^4, ...; None without aspheres."""
    frames: NDArray[np.float64] | None
    """(n, FRAME) placements; None where all elements are centred."""
    masks: NDArray[np.float64] | None
    """MASK_HEAD numbers for each element, then the cells of all masks, row by row; None without masks."""
    index_ratios: NDArray[np.float64] | None
    """(n, wavelengths) ratios of indices; IDEAL: the power over that at the first wavelength. None: one wavelength."""
    direction: float
    """+1 towards the sensor, -1 towards the scene."""

    def first(self, count: int) -> LensRecord:
        """The elements where light arrives first."""
        by_element = ("rows", "conic", "aspheric", "frames", "index_ratios")
        cut = {name: column[:count] for name in by_element if (column := getattr(self, name)) is not None}
        return self._replace(first_edge=self.first_edge[: count + 1], **cut)


class _Row(NamedTuple):
    """One element's entries."""

    kind: int
    z: float
    surface_index: int
    semi_diameter2: float
    curvature: float = 0.0
    index_ratio: float = 1.0
    max_depth: float = math.inf
    edges: tuple[tuple[float, ...], ...] = ()
    conic: float = 0.0
    aspheric: tuple[float, ...] = ()
    frame: tuple[float, ...] = (0.0,) * FRAME
    mask: MaskStop | None = None


def lens_record(
    lens: LensStack,
    wavelength: float | NDArray[np.float64],
    *,
    reverse: bool,
    round_stops: bool = False,
    first: int | None = None,
    last: int | None = None,
    clipping: bool = True,
) -> LensRecord:
    """The record for one wavelength (nm), or an array of several, and one direction of travel.

    With `round_stops`, all stops become the circles around them: what bounds on pupils are made of. `first` and
    `last` choose a part of the lens, both included, always traced exactly. Without `clipping`, neither semi-diameters
    nor stops stop a ray.
    """
    if not isinstance(wavelength, np.ndarray):
        return _record_at(lens, float(wavelength), reverse, round_stops, first, last, clipping)
    found = _record_at(lens, float(wavelength[0]), reverse, round_stops, first, last, clipping)
    kind, at = found.rows["kind"], found.rows["surface_index"]
    if IDEAL in kind:
        ratios = np.ones((len(kind), len(wavelength)))
        power = 1.0 / np.array([cardinal_points(lens, float(each)).efl for each in wavelength])
        ratios[kind == IDEAL] = power / power[0]
        return found._replace(index_ratios=ratios)
    index = np.array([lens.indices(float(each)) for each in wavelength]).T
    ahead, behind = index[at], index[at + 1]
    return found._replace(index_ratios=np.ascontiguousarray(behind / ahead if reverse else ahead / behind))


def _record_at(
    lens: LensStack,
    wavelength: float,
    reverse: bool,
    round_stops: bool,
    first: int | None,
    last: int | None,
    clipping: bool,
) -> LensRecord:
    """The record for one wavelength."""
    if first is None and last is None and lens.model is not LensModel.EXACT:
        rows = _ideal_rows(lens, wavelength, reverse=reverse)
    else:
        begin = 0 if first is None else first
        end = len(lens.elements) - 1 if last is None else last
        rows = _exact_rows(lens, wavelength, begin, end, reverse=reverse)
    if round_stops or not clipping:
        rows = [row._replace(kind=CIRCLE, edges=(), mask=None) if row.kind in SHAPED else row for row in rows]
    if not clipping:
        rows = [row._replace(semi_diameter2=math.inf) for row in rows]
    return _columns(rows, -1.0 if reverse else 1.0)


def _columns(rows: list[_Row], direction: float) -> LensRecord:
    edges = [edge for row in rows for edge in row.edges]
    terms = max(len(row.aspheric) for row in rows)
    aspheric = None
    if terms:
        aspheric = np.zeros((len(rows), terms))
        for i, row in enumerate(rows):
            aspheric[i, : len(row.aspheric)] = row.aspheric
    moved = any(row.frame[MOVED] for row in rows)
    return LensRecord(
        rows=np.array([tuple(getattr(row, name) for name in ROW.names or ()) for row in rows], dtype=ROW),
        edges=np.array(edges, dtype=np.float64).reshape(-1, 4),
        first_edge=np.cumsum([0, *(len(row.edges) for row in rows)], dtype=np.int64),
        conic=np.array([row.conic for row in rows]) if any(row.kind in (CONIC, ASPHERE) for row in rows) else None,
        aspheric=aspheric,
        frames=np.array([row.frame for row in rows]) if moved else None,
        masks=_masks([row.mask for row in rows]),
        index_ratios=None,
        direction=direction,
    )


def _masks(masks: list[MaskStop | None]) -> NDArray[np.float64] | None:
    if all(mask is None for mask in masks):
        return None
    heads, cells, begin = np.zeros((len(masks), MASK_HEAD)), [], MASK_HEAD * len(masks)
    for head, mask in zip(heads, masks, strict=True):
        if mask is not None:
            image = np.asarray(mask.transmission)
            head[:] = begin, *image.shape, 1.0 / mask.cell_size
            cells.append(image.ravel())
            begin += image.size
    return np.concatenate([heads.ravel(), *cells])


def _exact_rows(lens: LensStack, wavelength: float, first: int, last: int, *, reverse: bool) -> list[_Row]:
    index = np.asarray(lens.indices(wavelength), dtype=np.float64)
    vertices = lens.vertices
    rows = []
    for i in range(first, last + 1):
        element, z = lens.elements[i], float(vertices[i])
        if isinstance(element, Surface):
            ratio = index[i + 1] / index[i] if reverse else index[i] / index[i + 1]
            rows.append(_surface_row(element, z, i, float(ratio)))
        else:
            rows.append(_stop_row(element, z, i))
        if element.placement is not None:
            rows[-1] = rows[-1]._replace(frame=_frame(element.placement))
    return rows[::-1] if reverse else rows


def _surface_row(surface: Surface, z: float, surface_index: int, ratio: float) -> _Row:
    max_depth, semi_diameter2 = 1.0 + EQUATOR_TOLERANCE, surface.semi_diameter * surface.semi_diameter
    if surface.depth is not None:
        # Only the depth ends a surface that goes beyond its equator.
        max_depth = abs(surface.curvature) * (1.0 + surface.conic) * surface.depth + EQUATOR_TOLERANCE
        semi_diameter2 = math.inf
    row = _Row(SURFACE, z, surface_index, semi_diameter2, surface.curvature, ratio, max_depth, conic=surface.conic)
    if surface.aspheric:
        return row._replace(kind=ASPHERE, aspheric=(*asphere_bounds(surface), *surface.aspheric))
    return row if surface.conic == 0 or surface.curvature == 0 else row._replace(kind=CONIC)


def _stop_row(stop: Stop, z: float, surface_index: int) -> _Row:
    semi_diameter2 = stop.semi_diameter * stop.semi_diameter
    if isinstance(stop, CircularStop):
        return _Row(CIRCLE, z, surface_index, semi_diameter2)
    if isinstance(stop, MaskStop):
        return _Row(MASK, z, surface_index, semi_diameter2, mask=stop)
    straight = isinstance(stop, PolygonStop) and math.isinf(stop.blade_radius)
    kind = STAR if isinstance(stop, StarStop) else POLYGON if straight else ARCS
    return _Row(kind, z, surface_index, semi_diameter2, edges=tuple(map(tuple, stop.edges.tolist())))


def _frame(placement: Placement) -> tuple[float, ...]:
    return (*np.ravel(placement.rotation).tolist(), *np.asarray(placement.shift).tolist(), 1.0)


def _ideal_rows(lens: LensStack, wavelength: float, *, reverse: bool) -> list[_Row]:
    """What stands for the lens in the models NONE, THIN and PARAXIAL, from scene to sensor unless `reverse`."""
    if lens.model is LensModel.NONE:
        stops = [i for i, element in enumerate(lens.elements) if not isinstance(element, Surface)]
        rows = [_stop_row(_as_stop(lens.elements[i]), float(lens.vertices[i]), i) for i in stops]
        return rows[::-1] if reverse else rows
    points = cardinal_points(lens, wavelength)
    if not math.isfinite(points.efl):
        raise PrescriptionError(
            f"the lens {lens.name!r} has no focal length at {wavelength:g} nm and so no principal planes; "
            "use LensModel.EXACT"
        )
    rear, iris = points.rear_principal, lens.iris_index
    front = rear if lens.model is LensModel.THIN else points.front_principal
    met, left = (rear, front) if reverse else (front, rear)
    ideal = _Row(IDEAL, met, iris, math.inf, 1.0 / points.efl, max_depth=left - met)
    if lens.model is LensModel.THIN:
        z_stop, scale, behind = rear, points.entrance_pupil_semi_diameter / lens.stop.semi_diameter, True
    elif math.isfinite(points.exit_pupil):
        z_stop, scale, behind = points.exit_pupil, points.pupil_magnification, True
    else:
        z_stop, scale = points.entrance_pupil, points.entrance_pupil_semi_diameter / lens.stop.semi_diameter
        behind = False
    stop = _stop_row(_scaled(lens.stop, scale), z_stop, iris)
    return [ideal, stop] if behind != reverse else [stop, ideal]


def _as_stop(element: Element) -> Stop:
    assert not isinstance(element, Surface)
    return element


def _scaled(stop: Stop, scale: float) -> Stop:
    """The stop as its paraxial image shows it: larger or smaller, and turned by half a turn where it is inverted."""
    size, turn = abs(scale), math.pi if scale < 0 else 0.0
    semi_diameter = size * stop.semi_diameter
    if isinstance(stop, CircularStop):
        return CircularStop(semi_diameter)
    if isinstance(stop, PolygonStop):
        return PolygonStop(stop.blades, semi_diameter, stop.rotation + turn, blade_radius=size * stop.blade_radius)
    if isinstance(stop, StarStop):
        return StarStop(stop.points, semi_diameter, size * stop.inner_semi_diameter, stop.rotation + turn)
    cells = np.asarray(stop.transmission)
    return MaskStop(cells[::-1, ::-1] if scale < 0 else cells, semi_diameter)
