"""Lens record: the arrays of a lens that kernels read."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.errors import PrescriptionError
from plenoptic.optics.element_record import ASPHERE, CONIC, FREEFORM, IDEAL, ElementRow
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.loss_record import LossRecord, loss_record
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.placement import Placement
from plenoptic.optics.stops.stop_registry import Stop
from plenoptic.optics.surfaces.mirror import Mirror
from plenoptic.optics.surfaces.surface import Surface

if TYPE_CHECKING:
    from plenoptic.optics.lens.stack import LensStack

ROW = np.dtype(
    [
        ("kind", np.int64),
        ("z", np.float64),  # vertex in mm
        ("curvature", np.float64),  # 1 / radius in 1/mm, 0 for planes and stops; IDEAL: 1 / focal length behind it
        ("index_ratio", np.float64),  # before over behind, in the direction of travel; at the first of wavelengths
        ("semi_diameter2", np.float64),  # mm^2
        # Largest c (1 + k) z of a point of the surface: 1 is the equator, inf no limit; IDEAL: distance in mm from the
        # first to the second principal plane in the direction of travel.
        ("max_depth", np.float64),
        ("surface_index", np.int64),  # index of the element in the lens
    ]
)
"""One element of a lens."""

FRAME = 13
"""Numbers of a placement: rotation matrix by rows, shift in mm, and 1 (0 for no placement)."""

MOVED = FRAME - 1
"""Column of that last number."""

MASK_HEAD = 4
"""Header of a mask: index of its first cell in `masks`, rows, columns, and cells per mm."""

STEEPEST, SHARPEST, TALLEST, FIRST_TERM = range(4)
"""Columns of aspheric and freeform numbers: bounds on slope, second derivative and sag inside the semi-diameter, and
the first coefficient."""

ROUNDING, FREEFORM_KIND, FIRST_NUMBER = range(3, 6)
"""Columns of freeform numbers: rounding bound, kind, and the first number of the term."""


class LensRecord(NamedTuple):
    """A lens for one direction of travel: one entry for each element, in the order of travel."""

    rows: NDArray[np.void]
    """(n,) of the dtype ROW."""
    edges: Floats
    """(k, 4): a, b, p and q of the edges of all stops, a x + b y + q (x^2 + y^2) <= p; see `PolygonStop.edges` and
    `StarStop.edges`. For a straight edge: outward normal x, y, distance from the axis, and 0."""
    first_edge: NDArray[np.int64]
    """(n + 1,): the edges of element i are first_edge[i] to first_edge[i + 1]."""
    conic: Floats | None
    """(n,) conic constants; None if all surfaces are spheres and planes."""
    aspheric: Floats | None
    """(n, FIRST_TERM + terms): the largest absolute slope, second derivative by r and sag of an asphere, then its
    coefficients of r^2, r^4, ...; None without aspheres."""
    freeform: Floats | None
    """(n, numbers) of surfaces without rotational symmetry: as `aspheric`, then the rounding error of the freeform sag
    in mm, the kind of the freeform term, and its numbers; None without freeform terms."""
    frames: Floats | None
    """(n, FRAME) placements; None if all elements are centred."""
    mirrors: Floats | None
    """(n, FRAME): transform of rays between the spaces before and behind a mirror, in the axes of the mirror, and 1;
    None without mirrors."""
    masks: Floats | None
    """MASK_HEAD numbers for each element, then the cells of all masks, row by row; None without masks."""
    index_ratios: Floats | None
    """(n, wavelengths) ratios of indices; IDEAL: the power over that at the first wavelength, whose ratio of
    indices all have. None: one wavelength."""
    direction: float
    """+1 towards the sensor, -1 towards the scene."""
    losses: LossRecord | None = None
    """Light that surfaces and glass take; None: weights change at stops alone."""

    @property
    def completed(self) -> LensRecord:
        """Record with default `frames`, `masks` and, for lenses with conics, `aspheric` in place of None. Rarely used
        kernels then compile for two or three types only; results have the same bits.
        """
        n = len(self.rows)
        completed = self._replace(
            frames=np.zeros((n, FRAME)) if self.frames is None else self.frames,
            masks=np.zeros(0) if self.masks is None else self.masks,
        )
        if self.conic is not None and self.aspheric is None:
            return completed._replace(aspheric=np.zeros((n, FIRST_TERM)))
        return completed

    def part(self, begin: int, end: int) -> LensRecord:
        """Record of elements begin ... end - 1, without losses."""
        by_element = ("rows", "conic", "aspheric", "freeform", "frames", "mirrors", "index_ratios")
        cut = {name: column[begin:end] for name in by_element if (column := getattr(self, name)) is not None}
        masks = self.masks
        if masks is not None:
            masks = masks[MASK_HEAD * begin :].copy()
            masks[: MASK_HEAD * (end - begin) : MASK_HEAD] -= MASK_HEAD * begin
        return self._replace(first_edge=self.first_edge[begin : end + 1], masks=masks, losses=None, **cut)


def lens_record(
    lens: LensStack,
    wavelength: float | Floats,
    *,
    reverse: bool,
    round_stops: bool = False,
    first: int | None = None,
    last: int | None = None,
    clipping: bool = True,
) -> LensRecord:
    """Lens record for one wavelength in nm, or an array of several, and one direction of travel.

    With `round_stops`, all stops become the circles around them, as pupil bounds require. `first` and `last`, both
    included, select a part of the lens, always traced exactly. Without `clipping`, no rim or stop clips a ray.
    """
    wavelengths = np.array(wavelength, dtype=np.float64, ndmin=1).tolist()
    if first is None and last is None and lens.model is not LensModel.EXACT:
        rows = _ideal_rows(lens, wavelengths[0], reverse=reverse)
    else:
        begin, end = 0 if first is None else first, len(lens.elements) - 1 if last is None else last
        rows = _exact_rows(lens, wavelengths[0], begin, end, reverse=reverse)
    if round_stops or not clipping:
        rows = [row.circular for row in rows]
    if not clipping:
        rows = [row._replace(semi_diameter2=math.inf) for row in rows]
    record = _columns(rows[::-1], -1.0) if reverse else _columns(rows, 1.0)
    if not isinstance(wavelength, np.ndarray):
        return record
    kind, at = record.rows["kind"], record.rows["surface_index"]
    if IDEAL in kind:
        ratios = np.ones((len(kind), len(wavelengths)))
        power = 1.0 / np.array([cardinal_points(lens, each).efl for each in wavelengths])
        ratios[kind == IDEAL] = power / power[0]
        return record._replace(index_ratios=ratios)
    index = np.array([lens.indices(each) for each in wavelengths]).T
    ahead, behind = index[at], index[at + 1]
    return record._replace(index_ratios=np.ascontiguousarray(behind / ahead if reverse else ahead / behind))


def radiometric_lens_record(lens: LensStack, wavelength: float | Floats, *, reverse: bool) -> LensRecord:
    """Lens record for light: with the losses of a lens with coatings, which searches for rays do not need."""
    record = lens_record(lens, wavelength, reverse=reverse)
    return record._replace(losses=loss_record(lens, wavelength, reverse=reverse))


def _columns(rows: list[ElementRow], direction: float) -> LensRecord:
    edges = [edge for row in rows for edge in row.edges]
    still = (0.0,) * FRAME
    shaped = any(row.kind in (CONIC, ASPHERE, FREEFORM) for row in rows)
    return LensRecord(
        rows=np.array([tuple(getattr(row, name) for name in ROW.names or ()) for row in rows], dtype=ROW),
        edges=np.array(edges, dtype=np.float64).reshape(-1, 4),
        first_edge=np.cumsum([0, *(len(row.edges) for row in rows)], dtype=np.int64),
        conic=np.array([row.conic for row in rows]) if shaped else None,
        aspheric=_pad([row.aspheric for row in rows]),
        freeform=_pad([row.freeform for row in rows]),
        frames=np.array([row.frame or still for row in rows]) if any(row.frame for row in rows) else None,
        mirrors=np.array([row.mirror or still for row in rows]) if any(row.mirror for row in rows) else None,
        masks=_masks(rows),
        index_ratios=None,
        direction=direction,
    )


def _pad(numbers: list[tuple[float, ...]]) -> Floats | None:
    """One row for each element, padded with 0; None if no element has numbers."""
    width = max(map(len, numbers))
    return np.array([(*row, *[0.0] * (width - len(row))) for row in numbers]) if width else None


def _masks(rows: list[ElementRow]) -> Floats | None:
    if all(row.cells is None for row in rows):
        return None
    heads, cells, begin = np.zeros((len(rows), MASK_HEAD)), [], MASK_HEAD * len(rows)
    for head, row in zip(heads, rows, strict=True):
        if row.cells is not None:
            head[:] = begin, *row.cells.shape, row.cells_per_mm
            cells.append(row.cells.ravel())
            begin += row.cells.size
    return np.concatenate([heads.ravel(), *cells])


def _exact_rows(lens: LensStack, wavelength: float, first: int, last: int, *, reverse: bool) -> list[ElementRow]:
    index, vertices, rows = lens.indices(wavelength), lens.vertices, []
    for i, element in enumerate(lens.elements[first : last + 1], start=first):
        row = element.row()._replace(z=float(vertices[i]), surface_index=i)
        if element.placement is not None:
            turn, shift = element.placement.rotation.ravel().tolist(), element.placement.shift.tolist()
            row = row._replace(frame=(*turn, *shift, 1.0))
        if isinstance(element, Surface):
            row = row._replace(index_ratio=float(index[i + 1] / index[i] if reverse else index[i] / index[i + 1]))
            if isinstance(element.medium, Mirror):
                row = row._replace(mirror=_between_spaces(element.placement, element.medium))
        rows.append(row)
    return rows


def _between_spaces(placement: Placement | None, mirror: Mirror) -> tuple[float, ...]:
    """Frame numbers of the transform from the space before a mirror to the unfolded space behind it.

    A point p in the mirror's axes lies at t + R p from its nominal vertex. The fold U images it to U (t + R p), which
    is t + R q for q = R' U R p + R' (U t - t). This reflection is its own inverse.
    """
    where = Placement() if placement is None else placement
    turn, shift = where.rotation, where.shift
    linear, offset = turn.T @ mirror.unfolding @ turn, turn.T @ (mirror.unfolding @ shift - shift)
    return (*linear.ravel().tolist(), *offset.tolist(), 1.0)


def _ideal_rows(lens: LensStack, wavelength: float, *, reverse: bool) -> list[ElementRow]:
    """Rows that replace the lens in the models NONE, THIN and PARAXIAL, from scene to sensor."""
    if lens.model is LensModel.NONE:
        stops = [i for i, element in enumerate(lens.elements) if not isinstance(element, Surface)]
        return [lens.elements[i].row()._replace(z=float(lens.vertices[i]), surface_index=i) for i in stops]
    points = cardinal_points(lens, wavelength)
    if not math.isfinite(points.efl):
        raise PrescriptionError(
            f"the lens {lens.name!r} has no focal length at {wavelength:g} nm, hence no principal planes; "
            "use LensModel.EXACT"
        )
    rear, iris = points.rear_principal, lens.iris_index
    front = rear if lens.model is LensModel.THIN else points.front_principal
    arrives, leaves = (rear, front) if reverse else (front, rear)
    behind_it, ahead = (points.front_efl, points.efl) if reverse else (points.efl, points.front_efl)
    ideal = ElementRow(
        IDEAL,
        curvature=1.0 / behind_it,
        index_ratio=ahead / behind_it,
        max_depth=leaves - arrives,
        z=arrives,
        surface_index=iris,
    )
    stop_seen, z_stop, behind = ideal_stop_image(lens, wavelength)
    stop = stop_seen.row()._replace(z=z_stop, surface_index=iris)
    return [ideal, stop] if behind else [stop, ideal]


def ideal_stop_image(lens: LensStack, wavelength: float) -> tuple[Stop, float, bool]:
    """Image of the iris in an ideal model of a lens, its z in mm, and True if it lies behind the lens."""
    points = cardinal_points(lens, wavelength)
    scale = points.entrance_pupil_semi_diameter / lens.stop.semi_diameter
    if lens.model is LensModel.THIN:
        return lens.stop.image(scale), points.rear_principal, True
    if math.isfinite(points.exit_pupil):
        return lens.stop.image(points.pupil_magnification), points.exit_pupil, True
    return lens.stop.image(scale), points.entrance_pupil, False
