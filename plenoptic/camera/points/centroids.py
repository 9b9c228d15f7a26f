"""Centroids of micro images of a uniform white scene from geometry, as sums over light."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import ArrayAxes
from plenoptic.core.kernels.ray_blocks import BLOCK
from plenoptic.core.parallel import run_in_order, thread_count
from plenoptic.core.values import Floats
from plenoptic.optics.lens.lens_record import LensRecord, lens_record
from plenoptic.optics.lens.pupil.exit_pupil import PupilBounds, pupil_bounds
from plenoptic.optics.microlens.aperture import has_clear_gaps
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice, polygon_area, polygon_moments
from plenoptic.optics.microlens.lenslets import Lenslets
from plenoptic.optics.microlens.microlens_record import outlines

FIELDS = 33
"""Fields along x and along y for which centroids are computed; others are interpolated."""
LINES, PLACES = 32, 24
"""Lines across the outline of the pupil, and points on each at which transmission is tested."""
_HALVINGS = 8
_ROUNDING = 1e-12
_RAYS = 1 << 16
"""Rays that are traced together."""


Integrands: TypeAlias = Callable[[NDArray[np.int64], Floats], Iterable[Floats]]
"""Functions of a microlens (m,) and a point on the sensor (m, 2), in mm: arrays (m,)."""


class _CellMoments(NamedTuple):
    """Moments of the openings of n lenses, or of their cells."""

    area: Floats
    centre: Floats
    """(n, 2): centroids, on the array."""
    points: Floats
    """(4, 2): see `moment_points`; for the median of the variances."""


def lit_centroids(axes: ArrayAxes, array: MicrolensArray, lenses: Lenslets, slopes: Floats) -> Floats:
    """Centroids (n, 2) on the sensor of the light of a white scene through each cell; nan if it is dark.

    `slopes` (n, 2) are the slopes of the chief rays, or nan.
    """
    centroids, is_transmitting = np.full(lenses.axis.shape, np.nan), lenses.transmission > 0
    if not array.model.focuses:
        points = axes.local(lenses.axis[is_transmitting])
        centroids[is_transmitting] = _centroids_of_type(axes, array, points, 0.0, np.zeros((1, 2)))
        return centroids
    opening, cell = _opening_and_cell_moments(array, lenses)
    has_gaps, factor = has_clear_gaps(array.aperture), array.power_factor(axes.camera.wavelength)
    slopes = np.where(np.isfinite(slopes), slopes, 0.0)
    for type_ in np.unique(lenses.type[is_transmitting]):
        focal_length = array.focal_lengths[int(type_)]
        rows = is_transmitting & (lenses.type == type_) & (has_gaps | (opening.area > 0))
        centre, ratio = axes.local(opening.centre[rows]), (lenses.power[rows] * focal_length)[:, None]
        lit = _centroids_of_type(axes, array, centre, factor / focal_length, opening.points)
        if has_gaps or (np.abs(ratio - 1.0) > _ROUNDING).any():
            # The intersection with the sensor is linear in the power.
            unrefracted = _centroids_of_type(axes, array, centre, 0.0, opening.points)
            lit = lit + (1.0 - ratio) * (unrefracted - lit)
        # All light of a decentred opening is deviated by the same angle.
        refracted = slopes[rows] + (factor * lenses.power[rows])[:, None] * (axes.local(lenses.axis[rows]) - centre)
        lit = lit + (axes.on_sensor(centre, refracted) - axes.on_sensor(centre, slopes[rows]))
        if has_gaps:
            whole = _centroids_of_type(axes, array, axes.local(cell.centre[rows]), 0.0, cell.points)
            lit = whole + (opening.area[rows] / cell.area[rows])[:, None] * (lit - unrefracted)
        centroids[rows] = lit
    return centroids


def _opening_and_cell_moments(array: MicrolensArray, lenses: Lenslets) -> tuple[_CellMoments, _CellMoments]:
    """Moments of the openings of the lenses, and of their cells."""
    all_alike = array.imperfections is None and array.lattice is not Lattice.FREE
    if all_alike:
        polygons = [array.opening.corners[None], array.cell_corners[None]]
    else:
        free = array.lattice is Lattice.FREE
        all_lenses = array.lenses((-np.inf, -np.inf), (np.inf, np.inf)) if free else lenses
        lens_rows = lenses.index[:, 0] if free else np.arange(len(lenses))
        shapes = outlines(array, all_lenses.design, all_lenses.centre - all_lenses.design, turn=np.eye(2), margin=0.0)
        corner = np.arange(shapes.wide.shape[1])
        polygons = [
            np.take_along_axis(corners[lens_rows], np.minimum(corner, counts[lens_rows, None] - 1)[..., None], axis=1)
            for corners, counts in ((shapes.openings, shapes.counts), (shapes.wide, shapes.wide_counts))
        ]
    moments = []
    for corners, circle_radius in zip(polygons, (array.opening.radius, math.inf), strict=True):
        area, centre, variance = polygon_moments(corners)
        if math.isfinite(circle_radius):
            # The circumscribed polygon of a circle is larger.
            area_ratio = math.pi * circle_radius**2 / polygon_area(array.opening.corners)
            area, variance = area_ratio * area, area_ratio * variance
        has_area = area > 0
        positions = lenses.design + (0.0 if all_alike else np.where(has_area[:, None], centre, 0.0))
        points = moment_points(np.median(variance[has_area], axis=0) if has_area.any() else np.zeros(2))
        moments.append(_CellMoments(np.broadcast_to(area, (len(lenses),)), positions, points))
    return moments[0], moments[1]


def _centroids_of_type(axes: ArrayAxes, array: MicrolensArray, points: Floats, power: float, offsets: Floats) -> Floats:
    if len(points) <= FIELDS * FIELDS:
        return centroids_at(axes, array, points, power, offsets)
    low, high = points.min(axis=0), points.max(axis=0)
    size = np.maximum(high - low, 1e-9)
    knots = [np.linspace(low[k], low[k] + size[k], FIELDS) for k in range(2)]
    grid = np.stack(np.meshgrid(*knots, indexing="ij"), axis=-1)
    lit = centroids_at(axes, array, grid.reshape(-1, 2), power, offsets).reshape(grid.shape)
    return _interpolate_cubic(lit, (points - low) / size * (FIELDS - 1))


def _interpolate_cubic(values: Floats, position: Floats) -> Floats:
    """Cubic convolution (R. Keys, IEEE Trans. ASSP 29(6), 1981) of a grid (a, b, c) at (n, 2), in steps of the grid.

    It reproduces quadratic functions. Linear if the cubic would need points outside the grid or nan.
    """
    first = np.clip(np.floor(position).astype(np.int64), 0, np.array(values.shape[:2]) - 2)
    t = position - first
    cells = np.pad(values, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
    cubic, linear = np.zeros((2, len(position), values.shape[2]))
    for i in range(-1, 3):
        for j in range(-1, 3):
            neighbour = cells[first[:, 0] + i + 1, first[:, 1] + j + 1]
            cubic += (_cubic_kernel(t[:, 0] - i) * _cubic_kernel(t[:, 1] - j))[:, None] * neighbour
            if i in (0, 1) and j in (0, 1):
                linear += (np.abs(1 - i - t[:, 0]) * np.abs(1 - j - t[:, 1]))[:, None] * neighbour
    return np.where(np.isfinite(cubic), cubic, linear)


def _cubic_kernel(t: Floats) -> Floats:
    t = np.abs(t)
    return np.where(t < 1, (1.5 * t - 2.5) * t * t + 1, ((-0.5 * t + 2.5) * t - 4) * t + 2)


class _Openings(NamedTuple):
    """Points of the openings of microlenses, k per microlens, with boxes around the pupil seen from them."""

    axes: ArrayAxes
    lens: LensRecord
    """In reverse."""
    centre: Floats
    """(n k, 2): the microlens's centre, local."""
    offset: Floats
    """(n k, 2): the point, from that centre."""
    start: Floats
    """(n k, 3): the point in the lens's axes."""
    turn: Floats
    """(n k, 2): cosine and sine of the azimuth of the microlens in the lens's axes."""
    low: Floats
    high: Floats
    """(n k, 2): a box around the pupil on the plane `z`, in axes rotated with the microlens."""
    z: float

    def through(self, rows: NDArray[np.int64], x: Floats, y: Floats) -> Floats:
        """Points (m, 3) in the lens's axes, on the plane of the boxes of points `rows` (m,)."""
        cos, sin = self.turn[rows].T
        return np.stack([cos * x - sin * y, sin * x + cos * y, np.full(len(x), self.z)], axis=1)

    def light(self, rows: NDArray[np.int64], x: Floats, y: Floats) -> Floats:
        """Transmission of the lens for rays through these points: 0 or 1, or that of grey masks."""
        from plenoptic.camera.points.kernels.pupil_rays import fill_pupil_rays
        from plenoptic.optics.lens.kernels.trace import fill_through_lens

        blocks = np.empty((-(-len(rows) // BLOCK), 8, BLOCK))
        fill_pupil_rays(blocks.reshape(-1), self.start, self.turn, self.z, rows, x, y)
        fill_through_lens(blocks.reshape(-1), self.lens, None)
        return blocks[:, 6].reshape(-1)[: len(rows)]

    def light_on_grid(self, x: Floats, y: Floats) -> Floats:
        """Transmission (n k, p, q) for rays through the grids x (n k, q) times y (n k, p), one for each point."""
        shape = (*y.shape, x.shape[1])
        rows = np.repeat(np.arange(len(x)), shape[1] * shape[2])
        along, across = (np.broadcast_to(part, shape).ravel() for part in (x[:, None], y[:, :, None]))
        return self.light(rows, along, across).reshape(shape)


def centroids_at(axes: ArrayAxes, array: MicrolensArray, points: Floats, power: float, offsets: Floats) -> Floats:
    """Centroids (n, 2) on the sensor for microlenses of a power in 1/mm with their centres at local points (n, 2).

    `offsets` (k, 2) are points of their openings, on the array, from these centres.
    """
    moments = light_integrals(axes, array, points, power, offsets, lambda _, hit: (np.ones(len(hit)), *hit.T))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(moments[:, 1:] / moments[:, :1])


def light_integrals(
    axes: ArrayAxes,
    array: MicrolensArray,
    points: Floats,
    power: float,
    offsets: Floats,
    integrands: Integrands,
    *,
    nodes: int = 3,
) -> Floats:
    """Integrals (n, k) of functions on the sensor over the light of microlenses, by nodes on lines across the pupil.

    For the other arguments, see `centroids_at`.
    """
    bounds = _bounds(axes, array, points)
    offsets = offsets @ axes.parts.array_turn.T
    chunk = max(1, _RAYS // (len(offsets) * LINES * PLACES))
    lens = lens_record(axes.camera.lens, axes.camera.wavelength, reverse=True)

    def integrals_from(k: int) -> Floats:
        openings = _narrow_boxes(_sample_openings(axes, lens, points[k : k + chunk], offsets, bounds))
        return _integrate_light(openings, len(offsets), power, lambda i, hit: integrands(i + k, hit), nodes)

    return np.concatenate(list(run_in_order(integrals_from, range(0, len(points), chunk), threads=thread_count(None))))


def _bounds(axes: ArrayAxes, array: MicrolensArray, points: Floats) -> PupilBounds:
    """Outlines of the pupil; for a tilted array, seen from the plane through its centre."""
    camera, z_plane = axes.camera, axes.parts.z_plane
    x, y, z = axes.in_lens(points).T
    radius = np.hypot(x, y)
    steepest = (radius.max() + max(e.semi_diameter for e in camera.lens.elements)) / (
        z_plane - float(camera.lens.vertices[-1])
    )
    return pupil_bounds(
        camera.lens,
        z_plane=z_plane,
        largest_radius=float(radius.max()),
        cell_radius=array.cell_radius + steepest * float(np.abs(z - z_plane).max()),
        wavelength=camera.wavelength,
    )


def _sample_openings(
    axes: ArrayAxes, lens: LensRecord, points: Floats, offsets: Floats, bounds: PupilBounds
) -> _Openings:
    points_per_lens = len(offsets)
    x, y, _ = axes.in_lens(points).T
    row = np.minimum((np.hypot(x, y) / bounds.step).astype(np.int64), len(bounds.corners) - 1)
    azimuth = np.arctan2(y, x)
    centre, offset = np.repeat(points, points_per_lens, axis=0), np.tile(offsets, (len(points), 1))
    return _Openings(
        axes=axes,
        lens=lens,
        centre=centre,
        offset=offset,
        start=axes.in_lens(centre + offset),
        turn=np.repeat(np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1), points_per_lens, axis=0),
        low=np.repeat(bounds.corners[row].min(axis=1), points_per_lens, axis=0),
        high=np.repeat(bounds.corners[row].max(axis=1), points_per_lens, axis=0),
        z=bounds.z,
    )


def _narrow_boxes(openings: _Openings) -> _Openings:
    """Narrow the boxes to the lit points of a grid of rays, plus one step of the grid; unchanged if none is lit.

    Boxes for all points of a cell, and of an interval of the field, are large compared with a small pupil.
    """
    across, fractions = openings.high - openings.low, np.linspace(0.0, 1.0, PLACES)
    x, y = (openings.low[:, None] + across[:, None] * fractions[:, None]).transpose(2, 0, 1)
    lit = openings.light_on_grid(x, y) > 0
    is_lit = np.stack([lit.any(axis=1), lit.any(axis=2)], axis=2)  # (n, PLACES, 2): along x, and along y
    first, last = fractions[is_lit.argmax(axis=1)], fractions[PLACES - 1 - is_lit[:, ::-1].argmax(axis=1)]
    any_lit = np.asarray(lit.any(axis=(1, 2)))[:, None]
    low = np.where(any_lit, openings.low + across * (first - 1 / (PLACES - 1)), openings.low)
    high = np.where(any_lit, openings.low + across * (last + 1 / (PLACES - 1)), openings.high)
    return openings._replace(low=low, high=high)


def moment_points(variance: Floats) -> Floats:
    """Four points (4, 2) on the axes with mean 0, the variance (2,), and zero third moments."""
    x, y = math.sqrt(2.0) * np.sqrt(variance)
    return np.array([[x, 0.0], [-x, 0.0], [0.0, y], [0.0, -y]])


def _integrate_light(
    openings: _Openings, points_per_lens: int, power: float, integrands: Integrands, nodes: int
) -> Floats:
    """Integrals (n, k) of functions over the light of microlenses.

    The light of a ray is its etendue at the sensor, as in `render`. An ideal microlens conserves du dv of the slopes
    u, v, not the projected solid angle du dv cos^4. An area dA of the plane across the lens at the distance r has the
    projected solid angle dA cos(lens) cos(array) / r^2.
    """
    rows, first, last, y, step, passed = _lit_intervals(openings)
    axes, start = openings.axes, openings.start[rows]
    grey = bool((passed != 1.0).any())
    lens = rows // points_per_lens
    n_lenses, parts = len(openings.centre) // points_per_lens, []
    for node, weight in zip(*np.polynomial.legendre.leggauss(nodes), strict=True):
        x = 0.5 * (first + last) + 0.5 * node * (last - first)
        ray = start - openings.through(rows, x, y)
        r2 = np.sum(ray**2, axis=1)
        before = axes.slopes_of(ray)
        after = before - power * openings.offset[rows]
        solid_angle_factor = ray[:, 2] / r2**1.5 * (1.0 + np.sum(before**2, axis=1)) ** 1.5
        light = 0.5 * weight * (last - first) * step * solid_angle_factor / (1.0 + np.sum(after**2, axis=1)) ** 2
        if grey:
            # The cells of a mask may be smaller than the intervals.
            light *= openings.light(rows, x, y)
        landing = axes.on_sensor(openings.centre[rows] + openings.offset[rows], after)
        terms = [np.bincount(lens, light * values, minlength=n_lenses) for values in integrands(lens, landing)]
        parts.append(np.stack(terms, axis=1))
    return np.asarray(sum(parts))


def _lit_intervals(openings: _Openings) -> tuple[NDArray[np.int64], Floats, Floats, Floats, Floats, Floats]:
    """Intervals of constant transmission on lines across the pupil, seen from each point of each opening.

    For each interval: index of the point, its two ends along the line, the line's position, the distance between lines,
    and the transmission.
    """
    n = len(openings.start)
    step = (openings.high - openings.low) / np.array([PLACES - 1, LINES])
    # One more point at each end, in the dark: every line then begins and ends in the dark.
    x = openings.low[:, :1] + step[:, :1] * np.arange(-1, PLACES + 1)
    y = openings.low[:, 1:] + step[:, 1:] * (np.arange(LINES) + 0.5)
    transmission = np.zeros((n, LINES, PLACES + 2))
    transmission[:, :, 1:-1] = openings.light_on_grid(x[:, 1:-1], y)
    rows, line, position = np.nonzero(transmission[:, :, 1:] != transmission[:, :, :-1])
    before, after = x[rows, position], x[rows, position + 1]
    level, next_level = transmission[rows, line, position], transmission[rows, line, position + 1]
    for _ in range(_HALVINGS):
        middle = 0.5 * (before + after)
        light = openings.light(rows, middle, y[rows, line])
        # A change of grey must not be mistaken for the end of the light.
        is_past = np.where(next_level == 0, light == 0, light != level)
        before, after = np.where(is_past, before, middle), np.where(is_past, middle, after)
    edge = 0.5 * (before + after)
    # All lines end in the dark: an interval that begins at one edge ends at the next one.
    begins = np.flatnonzero(next_level > 0)
    rows, line = rows[begins], line[begins]
    return rows, edge[begins], edge[begins + 1], y[rows, line], step[rows, 1], next_level[begins]
