"""Centroids of microlens images under a uniform white scene, from geometry: sums over the light of each microlens."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import ArrayAxes
from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats
from plenoptic.optics.lens.pupil.exit_pupil import PupilBounds, pupil_bounds
from plenoptic.optics.microlens.aperture import has_clear_gaps
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice, polygon_area, polygon_moments
from plenoptic.optics.microlens.lenslets import Lenslets
from plenoptic.optics.microlens.microlens_record import outlines

FIELDS = 33
"""Fields along x and along y for which centroids are computed; others lie between them."""
LINES, PLACES = 32, 24
"""Lines across the outline of the pupil, and places on each at which it is tried whether light passes."""
_HALVINGS = 8
_ROUNDING = 1e-12
_RAYS = 1 << 18
"""Rays that are traced together."""


class _Parts(NamedTuple):
    """The openings of n lenses, or their cells."""

    area: Floats
    middle: Floats
    """(n, 2) their centroids, on the array."""
    points: Floats
    """(4, 2) see `moment_points`; for the median of their variances."""


def lit_centroids(axes: ArrayAxes, array: MicrolensArray, lenses: Lenslets, slopes: Floats) -> Floats:
    """Centroids (n, 2) on the sensor of the light of a white scene through each cell; nan where it is dark.

    `slopes` (n, 2) are those of the chief rays, or nan.
    """
    centroids, clear = np.full(lenses.axis.shape, np.nan), lenses.transmission > 0
    if not array.model.focuses:
        centroids[clear] = _centroids_of_kind(axes, array, axes.local(lenses.axis[clear]), 0.0, np.zeros((1, 2)))
        return centroids
    opening, cell = _parts(array, lenses)
    has_gaps, factor = has_clear_gaps(array.aperture), array.power_factor(axes.camera.wavelength)
    slopes = np.where(np.isfinite(slopes), slopes, 0.0)
    for kind in np.unique(lenses.type[clear]):
        focal_length = array.focal_lengths[int(kind)]
        of = clear & (lenses.type == kind) & (has_gaps | (opening.area > 0))
        middle, ratio = axes.local(opening.middle[of]), (lenses.power[of] * focal_length)[:, None]
        lit = _centroids_of_kind(axes, array, middle, factor / focal_length, opening.points)
        if has_gaps or (np.abs(ratio - 1.0) > _ROUNDING).any():
            # Where light lands is linear in the power.
            straight = _centroids_of_kind(axes, array, middle, 0.0, opening.points)
            lit = lit + (1.0 - ratio) * (straight - lit)
        # All light of an opening beside the optical axis is deviated alike.
        bent = slopes[of] + (factor * lenses.power[of])[:, None] * (axes.local(lenses.axis[of]) - middle)
        lit = lit + (axes.on_sensor(middle, bent) - axes.on_sensor(middle, slopes[of]))
        if has_gaps:
            whole = _centroids_of_kind(axes, array, axes.local(cell.middle[of]), 0.0, cell.points)
            lit = whole + (opening.area[of] / cell.area[of])[:, None] * (lit - straight)
        centroids[of] = lit
    return centroids


def _parts(array: MicrolensArray, lenses: Lenslets) -> tuple[_Parts, _Parts]:
    """The openings of the lenses, and their cells."""
    same = array.imperfections is None and array.lattice is not Lattice.FREE
    if same:
        polygons = [array.opening.corners[None], array.cell_corners[None]]
    else:
        free = array.lattice is Lattice.FREE
        listed = array.lenses((-np.inf, -np.inf), (np.inf, np.inf)) if free else lenses
        these = lenses.index[:, 0] if free else np.arange(len(lenses))
        shapes = outlines(array, listed.design, listed.centre - listed.design, turn=np.eye(2), margin=0.0)
        corner = np.arange(shapes.wide.shape[1])
        polygons = [
            np.take_along_axis(corners[these], np.minimum(corner, counts[these, None] - 1)[..., None], axis=1)
            for corners, counts in ((shapes.openings, shapes.counts), (shapes.wide, shapes.wide_counts))
        ]
    parts = []
    for corners, outline in zip(polygons, (array.opening.radius, math.inf), strict=True):
        area, middle, variance = polygon_moments(corners)
        if math.isfinite(outline):
            # The polygon around a circle is larger.
            fraction = math.pi * outline**2 / polygon_area(array.opening.corners)
            area, variance = fraction * area, fraction * variance
        lit = area > 0
        places = lenses.design + (0.0 if same else np.where(lit[:, None], middle, 0.0))
        points = moment_points(np.median(variance[lit], axis=0) if lit.any() else np.zeros(2))
        parts.append(_Parts(np.broadcast_to(area, (len(lenses),)), places, points))
    return parts[0], parts[1]


def _centroids_of_kind(axes: ArrayAxes, array: MicrolensArray, points: Floats, power: float, offsets: Floats) -> Floats:
    if len(points) <= FIELDS * FIELDS:
        return centroids_at(axes, array, points, power, offsets)
    low, high = points.min(axis=0), points.max(axis=0)
    size = np.maximum(high - low, 1e-9)
    knots = [np.linspace(low[k], low[k] + size[k], FIELDS) for k in range(2)]
    grid = np.stack(np.meshgrid(*knots, indexing="ij"), axis=-1)
    lit = centroids_at(axes, array, grid.reshape(-1, 2), power, offsets).reshape(grid.shape)
    return _interpolate(lit, (points - low) / size * (FIELDS - 1))


def _interpolate(values: Floats, place: Floats) -> Floats:
    """Cubic convolution (R. Keys, IEEE Trans. ASSP 29(6), 1981) of a grid (a, b, c) at places (n, 2), in steps of it.

    It reproduces quadratic functions. Linear where the cubic would need values outside the grid or nan.
    """
    first = np.clip(np.floor(place).astype(np.int64), 0, np.array(values.shape[:2]) - 2)
    t = place - first
    wide = np.pad(values, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
    cubic, linear = np.zeros((2, len(place), values.shape[2]))
    for i in range(-1, 3):
        for j in range(-1, 3):
            neighbour = wide[first[:, 0] + i + 1, first[:, 1] + j + 1]
            cubic += (_keys(t[:, 0] - i) * _keys(t[:, 1] - j))[:, None] * neighbour
            if i in (0, 1) and j in (0, 1):
                linear += (np.abs(1 - i - t[:, 0]) * np.abs(1 - j - t[:, 1]))[:, None] * neighbour
    return np.where(np.isfinite(cubic), cubic, linear)


def _keys(t: Floats) -> Floats:
    t = np.abs(t)
    return np.where(t < 1, (1.5 * t - 2.5) * t * t + 1, ((-0.5 * t + 2.5) * t - 4) * t + 2)


class _Openings(NamedTuple):
    """Points of the openings of some microlenses, k a microlens, and the rows of `PupilBounds` that hold for them."""

    axes: ArrayAxes
    centre: Floats
    """(n k, 2) the microlens's centre, local."""
    offset: Floats
    """(n k, 2) the point, from there."""
    start: Floats
    """(n k, 3) the point in the lens's axes."""
    turn: Floats
    """(n k,) azimuth of the microlens there."""
    low: Floats
    high: Floats
    """(n k, 2) a box around the pupil on the plane `z`, in axes turned with the microlens."""
    z: float

    def through(self, of: NDArray[np.int64], x: Floats, y: Floats) -> Floats:
        """Points (m, 3), in the lens's axes, of the plane of the boxes of the points `of` (m,)."""
        cos, sin = np.cos(self.turn[of]), np.sin(self.turn[of])
        return np.stack([cos * x - sin * y, sin * x + cos * y, np.full(len(x), self.z)], axis=1)

    def light(self, of: NDArray[np.int64], x: Floats, y: Floats) -> Floats:
        """Transmission at points of the openings: 0 or 1, or that of grey masks."""
        camera = self.axes.camera
        rays = RayBundle(self.start[of], self.through(of, x, y) - self.start[of], camera.wavelength)
        return camera.lens.trace_reverse(rays).weight


def centroids_at(
    axes: ArrayAxes,
    array: MicrolensArray,
    points: Floats,
    power: float,
    offsets: Floats,
    *,
    lines: int = LINES,
    places: int = PLACES,
) -> Floats:
    """Centroids (n, 2) on the sensor for microlenses of a power in 1/mm with their centres at local points (n, 2).

    `offsets` (k, 2) are points of their openings, on the array, from there.
    """
    bounds = _bounds(axes, array, points)
    offsets = offsets @ axes.parts.array_turn.T
    each = max(1, _RAYS // (len(offsets) * lines * places))
    parts = []
    for k in range(0, len(points), each):
        openings = _narrow(_openings(axes, points[k : k + each], offsets, bounds))
        sums = _sums(openings, len(offsets), power, lines, places)
        with np.errstate(invalid="ignore", divide="ignore"):
            parts.append(sums[:, 1:] / sums[:, :1])
    return np.concatenate(parts)


def _bounds(axes: ArrayAxes, array: MicrolensArray, points: Floats) -> PupilBounds:
    """Outlines of the pupil; those of a tilted array are as seen from where its rays cross the plane of its middle."""
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


def _openings(axes: ArrayAxes, points: Floats, offsets: Floats, bounds: PupilBounds) -> _Openings:
    many = len(offsets)
    x, y, _ = axes.in_lens(points).T
    row = np.minimum((np.hypot(x, y) / bounds.step).astype(np.int64), len(bounds.corners) - 1)
    centre, offset = np.repeat(points, many, axis=0), np.tile(offsets, (len(points), 1))
    return _Openings(
        axes=axes,
        centre=centre,
        offset=offset,
        start=axes.in_lens(centre + offset),
        turn=np.repeat(np.arctan2(y, x), many),
        low=np.repeat(bounds.corners[row].min(axis=1), many, axis=0),
        high=np.repeat(bounds.corners[row].max(axis=1), many, axis=0),
        z=bounds.z,
    )


def _narrow(openings: _Openings) -> _Openings:
    """Narrow the boxes to the lit part of a grid of rays and a step of the grid around it; unchanged where no ray is
    lit.

    Boxes that hold for all points of a cell, and of an interval of the field, are large beside a small pupil.
    """
    n, across = len(openings.start), openings.high - openings.low
    fractions = np.linspace(0.0, 1.0, PLACES)
    places = np.stack(np.meshgrid(fractions, fractions), axis=-1).reshape(-1, 2)
    of = np.repeat(np.arange(n), len(places))
    tried = openings.low[of] + across[of] * np.tile(places, (n, 1))
    lit = openings.light(of, tried[:, 0], tried[:, 1]).reshape(n, -1) > 0
    first = np.where(lit[:, :, None], places, np.inf).min(axis=1) - 1 / (PLACES - 1)
    last = np.where(lit[:, :, None], places, -np.inf).max(axis=1) + 1 / (PLACES - 1)
    is_lit = np.asarray(lit.any(axis=1))[:, None]
    low = np.where(is_lit, openings.low + across * np.where(is_lit, first, 0.0), openings.low)
    high = np.where(is_lit, openings.low + across * np.where(is_lit, last, 1.0), openings.high)
    return openings._replace(low=low, high=high)


def moment_points(variance: Floats) -> Floats:
    """Four points (4, 2) on the axes that have mean 0, the variance (2,) along them, and no third moments."""
    x, y = math.sqrt(2.0) * np.sqrt(variance)
    return np.array([[x, 0.0], [-x, 0.0], [0.0, y], [0.0, -y]])


def _sums(openings: _Openings, many: int, power: float, lines: int, places: int) -> Floats:
    """(n, 3): light, and light times x and y on the sensor, of some microlenses.

    The light of a ray is its etendue at the sensor, as in `render`. With slopes u, v an ideal microlens keeps du dv and
    not the projected solid angle, du dv cos^4; from an area dA of the plane across the lens at the distance r,
    dA cos(lens) cos(array) / r^2 of it arrive.
    """
    of, first, last, y, step, passing = _lit_intervals(openings, lines, places)
    axes, start = openings.axes, openings.start[of]
    grey = bool((passing != 1.0).any())
    lens = of // many
    sums = np.zeros((len(openings.centre) // many, 3))
    for node, weight in zip(*np.polynomial.legendre.leggauss(3), strict=True):
        x = 0.5 * (first + last) + 0.5 * node * (last - first)
        ray = start - openings.through(of, x, y)
        r2 = np.sum(ray**2, axis=1)
        before = axes.slopes_of(ray)
        after = before - power * openings.offset[of]
        arriving = ray[:, 2] / r2**1.5 * (1.0 + np.sum(before**2, axis=1)) ** 1.5
        light = 0.5 * weight * (last - first) * step * arriving / (1.0 + np.sum(after**2, axis=1)) ** 2
        if grey:
            # The cells of a mask may be smaller than the intervals.
            light *= openings.light(of, x, y)
        landed = axes.on_sensor(openings.centre[of] + openings.offset[of], after)
        for k, amount in enumerate((light, light * landed[:, 0], light * landed[:, 1])):
            sums[:, k] += np.bincount(lens, amount, minlength=len(sums))
    return sums


def _lit_intervals(
    openings: _Openings, lines: int, places: int
) -> tuple[NDArray[np.int64], Floats, Floats, Floats, Floats, Floats]:
    """Intervals of lines in the plane of the outlines that light passes, seen from each point of each opening.

    For every interval, in which as much light passes everywhere as far as the places tried show: number of the point,
    its two ends along the line, the line's place across, the distance between lines, and the transmission.
    """
    n = len(openings.start)
    step = (openings.high - openings.low) / np.array([places - 1, lines])
    # One place more at each end, where it is dark: every line then begins and ends in the dark.
    x = openings.low[:, :1] + step[:, :1] * np.arange(-1, places + 1)
    y = openings.low[:, 1:] + step[:, 1:] * (np.arange(lines) + 0.5)
    shape = (n, lines, places)
    of = np.broadcast_to(np.arange(n)[:, None, None], shape).ravel()
    along, across = (np.broadcast_to(g, shape).ravel() for g in (x[:, None, 1:-1], y[:, :, None]))
    passing = np.zeros((n, lines, places + 2))
    passing[:, :, 1:-1] = openings.light(of, along, across).reshape(shape)
    of, line, place = np.nonzero(passing[:, :, 1:] != passing[:, :, :-1])
    before, after, level, next_level = (
        x[of, place],
        x[of, place + 1],
        passing[of, line, place],
        passing[of, line, place + 1],
    )
    for _ in range(_HALVINGS):
        middle = 0.5 * (before + after)
        light = openings.light(of, middle, y[of, line])
        # Where light ends, no change of grey before the end may pass for it.
        past = np.where(next_level == 0, light == 0, light != level)
        before, after = np.where(past, before, middle), np.where(past, middle, after)
    edge = 0.5 * (before + after)
    # All lines end in the dark: light that begins, or changes, at one edge ends, or changes, at the next one.
    begins = np.flatnonzero(next_level > 0)
    of, line = of[begins], line[begins]
    return of, edge[begins], edge[begins + 1], y[of, line], step[of, 1], next_level[begins]
