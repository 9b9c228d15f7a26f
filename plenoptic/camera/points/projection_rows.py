"""Rows of a projection: microlenses that image a point, its chief rays through them, and its light.

Chief rays are aimed at targets behind the lens by Newton's method through the real lens.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import ArrayAxes, array_axes
from plenoptic.camera.points.projection_light import REPLICATES, PointRays, SensorLight, light_of_points, unique_rows
from plenoptic.camera.psf.psf_results import centroids
from plenoptic.camera.psf.sensor_hits import ForwardRecord, in_lens_axes
from plenoptic.core.parallel import run_in_order
from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats
from plenoptic.optics.element_record import IDEAL
from plenoptic.optics.lens.lens_record import LensRecord, lens_record
from plenoptic.optics.lens.pupil.entrance_pupil import entrance_polygons
from plenoptic.optics.lens.trace import trace_record
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lenslets import Lenslets, lenses_in_boxes, lenses_of

_RING_RADII = np.arange(8, 0, -1) / 8
"""Radii of the rings of entry points, relative to the polygon through which light enters."""
_BOX_FACTOR = 1.25
"""Factor on the size of the box around the light in which microlenses are searched."""
_POINTS = 128
"""Points whose rows are computed together."""
_AIM_TOLERANCE = 1e-10
_TRIALS = 40
_STEP = 1e-5
"""Distance of the rays for finite differences, over the size of the entrance pupil."""


class EntranceRays(NamedTuple):
    """Entrance plane `z` of rays from points, in the lens's axes, and the records to trace them."""

    z: float
    size: float
    """Semi-diameter of the entrance pupil, in mm."""
    wavelength: float
    bare: LensRecord
    """The lens without its stops and rims."""
    lens: LensRecord
    """The lens with its stops and rims."""

    def through(self, points: Floats, entry: Floats) -> RayBundle:
        """Rays from points (n, 3) through points (n, 2) of the entrance plane."""
        start = np.column_stack([entry, np.full(len(entry), self.z)])
        return RayBundle.through(start, start - points, self.wavelength)


def entrance_rays(record: ForwardRecord) -> EntranceRays:
    """Compile the entrance of a camera at its wavelength."""
    camera, entrance = record.camera, record.entrance
    size = min(entrance.pupil[1], entrance.reach) if np.isfinite(entrance.pupil[1]) else entrance.reach
    bare = lens_record(camera.lens, camera.wavelength, reverse=False, clipping=False)
    return EntranceRays(entrance.z, size, camera.wavelength, bare, record.lens)


class Aim(NamedTuple):
    """Target surface of ray aiming: rays are traced through `lens`, without vignetting, to `intersections`."""

    lens: LensRecord
    intersections: Callable[[RayBundle], Floats]
    """Function from n rays to their intersections (n, 2)."""


class ThroughArray(NamedTuple):
    """Intersections of rays with the array, in local axes."""

    axes: ArrayAxes
    array: MicrolensArray

    def intersections(self, rays: RayBundle) -> Floats:
        """Optical centre (n, 2) through which each ray would pass undeviated.

        In plates whose vertices face the sensor, rays are displaced before they reach them.
        """
        slopes = self.axes.slopes_of(rays.direction)
        origin = self.axes.parts.local_to_lens.inverse().points(rays.origin)
        return self._shift_chief_rays(origin[:, :2] - origin[:, 2:] * slopes, slopes, False)

    def sensor_points(self, centres: Floats, rays: RayBundle) -> Floats:
        """Intersections (n, 2) with the sensor, in its own axes, of rays through local optical centres."""
        slopes = self.axes.slopes_of(rays.direction)
        return self.axes.on_sensor(self._shift_chief_rays(centres, slopes, True), slopes)

    def _shift_chief_rays(self, points: Floats, slopes: Floats, rear: bool) -> Floats:
        return self.array.model.refraction.shift_chief_rays(
            self.array, points, slopes, self.axes.camera.wavelength, rear
        )


def through_iris(record: ForwardRecord, bare: LensRecord) -> tuple[Aim, Floats]:
    """Aim at the plane of the iris, or at its substitute in an ideal lens; and the centre (2,) of the iris."""
    stops = (bare.rows["surface_index"] == record.camera.lens.iris_index) & (bare.rows["kind"] != IDEAL)
    last = int(np.flatnonzero(stops)[0])
    centre = np.zeros(2) if bare.frames is None else bare.frames[last, 9:11] * bare.frames[last, 12]
    return Aim(bare.part(0, last + 1), lambda rays: rays.origin[:, :2]), centre


def aim_rays(entrance: EntranceRays, aim: Aim, points: Floats, targets: Floats, start: Floats) -> Floats:
    """Entry points (n, 2) of the rays from points (n, 3) to `targets` (n, 2); nan if there is none.

    Newton's method from `start` (n, 2), with steps reduced until the residual decreases.
    """
    size, limit = entrance.size, aim_tolerance(entrance, targets)

    def evaluate(entry: Floats, rows: NDArray[np.int64]) -> tuple[Floats, Floats]:
        """Residuals (n, 2) and Jacobians (n, 2, 2)."""
        position, jacobian = trace_to_target(entrance, aim, points[rows], entry)
        return targets[rows] - position, jacobian

    entry_points, step_fraction = start.copy(), np.ones(len(points))
    with np.errstate(all="ignore"):
        residual, jacobian = evaluate(entry_points, np.arange(len(points)))
        for _ in range(_TRIALS):
            distance = np.hypot(*residual.T)
            active = np.flatnonzero(np.isfinite(distance) & (distance > limit) & (step_fraction > 1e-6))
            if not len(active):
                break
            step = solve_2x2(jacobian[active], residual[active])
            length = np.hypot(*step.T)
            step *= (step_fraction[active] * np.minimum(1.0, 4.0 * size / length))[:, None]
            trial = entry_points[active] + step
            trial_residual, trial_jacobian = evaluate(trial, active)
            improved = np.hypot(*trial_residual.T) < distance[active]
            rows = active[improved]
            entry_points[rows], residual[rows] = trial[improved], trial_residual[improved]
            jacobian[rows] = trial_jacobian[improved]
            step_fraction[active] = np.where(improved, 1.0, 0.25 * step_fraction[active])
        entry_points[~(np.hypot(*residual.T) <= limit)] = np.nan
    return entry_points


def aim_tolerance(entrance: EntranceRays, targets: Floats) -> Floats:
    """Largest distance (n,) in mm of aimed rays from their targets (n, 2), above the rounding of coordinates."""
    rounding = 64 * np.finfo(float).eps * (np.abs(targets).max(axis=1, initial=0.0) + entrance.size)
    return np.asarray(_AIM_TOLERANCE + rounding)


def trace_to_target(entrance: EntranceRays, aim: Aim, points: Floats, entry: Floats) -> tuple[Floats, Floats]:
    """Intersections (n, 2) with the target surface of rays that enter at `entry`, and their Jacobians (n, 2, 2)."""
    h = _STEP * entrance.size
    right, up = np.array([[h, 0.0], [0.0, h]])
    entries = np.concatenate([entry, entry + right, entry + up])
    rays = entrance.through(np.tile(points, (3, 1)), entries)
    position, position_right, position_up = aim.intersections(trace_record(aim.lens, rays)).reshape(3, -1, 2)
    return position, np.stack([position_right - position, position_up - position], axis=-1) / h


def solve_2x2(matrix: Floats, right: Floats) -> Floats:
    """Solve linear systems (n, 2, 2) for (n, 2); not finite if they are singular."""
    a, b, c, d = matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 0], matrix[:, 1, 1]
    numerators = np.stack([d * right[:, 0] - b * right[:, 1], a * right[:, 1] - c * right[:, 0]], axis=1)
    return np.asarray(numerators / (a * d - b * c)[:, None])


class Rows(NamedTuple):
    """Rows of a projection, one for each point and microlens that images it."""

    point: NDArray[np.int64]
    """(k,)"""
    lens: NDArray[np.int64] | None
    """(k, 2): lattice indices; None without microlenses."""
    position: Floats
    """(k, 2): intersection of the chief ray with the sensor, in its own axes; nan if there is none."""
    passes: NDArray[np.bool_]
    """(k,): True if the chief ray is not vignetted."""
    light: Floats
    light_error: Floats
    """(k,): light and its standard error."""
    centroid: Floats
    centroid_error: Floats
    """(k, 2): centroid of the light on the sensor and its standard error, in mm; not finite without light."""
    entering: Floats
    """(k, 2): entry point of the ray that represents the light."""


def trace_rows(record: ForwardRecord, world: Floats, rays_per_replicate: int, threads: int) -> Rows:
    """Compute the rows of points (n, 3) in the world."""
    points, array = in_lens_axes(record, world), record.camera.microlenses
    polygons, bits = entrance_polygons(record.entrance, points), (world + 0.0).view(np.uint64)  # 0 and -0 are one
    starts = range(0, max(len(points), 1), _POINTS)
    # A few points with many rays are traced by all threads.
    workers = threads if len(starts) == 1 else 1

    def trace(start: int) -> Rows:
        number = np.arange(start, min(start + _POINTS, len(points)))
        lit = number[np.isfinite(polygons[number, 0, 0])]
        rays = PointRays(lit, bits[lit], points[lit], polygons[lit])
        focuses = array is None or array.model.focuses
        light = light_of_points(record, rays, rays_per_replicate if focuses else 0, workers)
        if array is None:
            return _rows_through_iris(record, number, points[number], rays, light)
        return _rows_through_microlenses(record, array, rays, light)

    parts = run_in_order(trace, starts, threads=threads)
    columns = [None if part[0] is None else np.concatenate(part) for part in zip(*parts, strict=True)]
    return Rows(*columns)  # type: ignore[arg-type]


def _statistics(moments: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Light, its error, centroids and their errors from moments (k, replicates, 3)."""
    light = np.ascontiguousarray(moments[:, :, 0])
    return light.mean(axis=1), light.std(axis=1, ddof=1) / np.sqrt(REPLICATES), *centroids(moments)


def _rows_through_iris(
    record: ForwardRecord, number: NDArray[np.int64], points: Floats, rays: PointRays, light: SensorLight
) -> Rows:
    """Rows of a camera without microlenses, one for each point."""
    entrance, n = entrance_rays(record), len(points)
    aim, centre = through_iris(record, entrance.bare)
    z, pupil = entrance.z, record.entrance.pupil[0]
    radius = (z - points[:, 2:]) / (pupil - points[:, 2:]) if np.isfinite(pupil) else np.zeros((n, 1))
    # Towards the centre of the paraxial entrance pupil.
    start = points[:, :2] * np.where(np.abs(radius) < 2.0, 1.0 - radius, 0.0)
    entering = aim_rays(entrance, aim, points, np.tile(centre, (n, 1)), start)
    chief = entrance.through(points, entering)
    moments = np.zeros((n, REPLICATES, 3))
    moments[rays.number[light.keys[:, 0]] - number[:1]] = light.moments
    position = straight_to_sensor(record, trace_record(entrance.bare, chief))
    passes = trace_record(entrance.lens, chief).status == 0
    return Rows(number, None, position, passes, *_statistics(moments), entering)


def straight_to_sensor(record: ForwardRecord, behind: RayBundle) -> Floats:
    """Intersections (n, 2) of rays behind the lens with the sensor, in its own axes, without microlenses."""
    parts = record.parts
    to_sensor = parts.sensor_to_local.inverse()
    origin = to_sensor.points(behind.origin - np.array([0.0, 0.0, parts.z_plane]))
    direction = to_sensor.directions(behind.direction)
    return np.asarray(origin[:, :2] - origin[:, 2:] / direction[:, 2:] * direction[:, :2])


def _rows_through_microlenses(
    record: ForwardRecord, array: MicrolensArray, rays: PointRays, light: SensorLight
) -> Rows:
    """Rows of a camera with microlenses: for each microlens that receives a point's light or chief ray."""
    entrance, axes = entrance_rays(record), array_axes(record.camera)
    through = ThroughArray(axes, array)
    bundles = _trace_bundles(rays, entrance, through)
    keys, row = unique_rows(np.concatenate([light.keys, _candidate_keys(bundles, through)]))
    moments = np.zeros((len(keys), REPLICATES, 3))
    moments[row[: len(light.keys)]] = light.moments
    number, centres = np.ascontiguousarray(keys[:, 0]), axes.local(lenses_at(array, keys[:, 1:]).axis)
    points, aim = rays.point[number], Aim(entrance.bare, through.intersections)
    nearest_entry, passing_entry = _nearest_rays(bundles, number, centres)
    entering, passes = np.full(centres.shape, np.nan), np.zeros(len(keys), bool)

    def aim_from(start: Floats) -> None:
        """Aim the rays again that do not pass."""
        rows = np.flatnonzero(~passes & np.isfinite(start[:, 0]))
        entry = aim_rays(entrance, aim, points[rows], centres[rows], start[rows])
        passes[rows] = trace_record(entrance.lens, entrance.through(points[rows], entry)).status == 0
        better = passes[rows] | np.isnan(entering[rows, 0])
        entering[rows[better]] = entry[better]

    aim_from(nearest_entry)
    # Strong lenses have several rays from a point to a microlens: use one that passes.
    aim_from(np.where(passing_entry[:, :1] != nearest_entry[:, :1], passing_entry, np.nan))
    lit = np.asarray((moments[:, :, 0] > 0).any(axis=1))
    rows = np.flatnonzero(passes | lit)
    chief = trace_record(entrance.bare, entrance.through(points[rows], entering[rows]))
    position = through.sensor_points(centres[rows], chief)
    with np.errstate(invalid="ignore"):
        reported = np.flatnonzero(lit[rows] | (np.abs(position) <= sensor_limit(through)).all(axis=1))
    rows, position = rows[reported], position[reported]
    shadow = np.where(passes[rows, None], entering[rows], passing_entry[rows])
    return Rows(
        rays.number[number[rows]],
        keys[rows, 1:],
        position,
        passes[rows],
        *_statistics(moments[rows]),
        entering=np.where(np.isfinite(shadow), shadow, entering[rows]),
    )


class PointBundles(NamedTuple):
    """f rays of each of n points."""

    entering: Floats
    """(n, f, 2): entry points on the entrance plane."""
    arriving: Floats
    """(n, f, 2): intersections with the array, local; nan if there is none."""
    on_sensor: Floats
    """(n, f, 2): intersections with the sensor, in its own axes, for a microlens centred on the ray."""
    passing: NDArray[np.bool_]
    """(n, f): True if the ray is not vignetted."""


def _trace_bundles(rays: PointRays, entrance: EntranceRays, through: ThroughArray) -> PointBundles:
    """Trace rings of rays from every point."""
    entering = _ring_points(rays.polygon)
    bundle = entrance.through(np.repeat(rays.point, entering.shape[1], axis=0), entering.reshape(-1, 2))
    traced = trace_record(entrance.bare, bundle)
    arriving = through.intersections(traced)
    on_sensor = through.sensor_points(arriving, traced).reshape(entering.shape)
    passing = (trace_record(entrance.lens, bundle).status == 0).reshape(entering.shape[:2])
    arriving[~np.isfinite(arriving).all(axis=1)] = np.nan
    return PointBundles(entering, arriving.reshape(entering.shape), on_sensor, passing)


def _ring_points(polygons: Floats) -> Floats:
    """Points (n, f, 2) on rings in polygons (n, k, 2): corners, points between them, and these scaled towards the
    centre; and the centre.
    """
    outline = np.concatenate([polygons, 0.5 * (polygons + np.roll(polygons, -1, axis=1))], axis=1)
    centre = polygons.mean(axis=1, keepdims=True)
    return np.concatenate([*(centre + radius * (outline - centre) for radius in _RING_RADII), centre], axis=1)


def _candidate_keys(bundles: PointBundles, through: ThroughArray) -> NDArray[np.int64]:
    """Keys (k, 3) of the microlenses in a box around each point's light: row of the point and lattice indices.

    Microlenses are left out whose chief rays end far outside the `sensor_limit` by a linear fit to the point's rays.
    """
    axes, array = through
    limit = _BOX_FACTOR * sensor_limit(through)
    rows = np.flatnonzero(np.isfinite(bundles.arriving[..., 0]).any(axis=1))
    on_array = axes.on_array(bundles.arriving[rows])
    low, high = np.nanmin(on_array, axis=1), np.nanmax(on_array, axis=1)
    margin = 0.5 * (_BOX_FACTOR - 1.0) * (high - low) + array.cell_radius
    centre, mean, series = _fit_linear(on_array, bundles.on_sensor[rows])
    with np.errstate(divide="ignore", invalid="ignore"):
        (a, b), (c, d) = series.transpose(1, 2, 0)
        inverse = (np.array([[d, -b], [-c, a]]) / (a * d - b * c)).transpose(2, 0, 1)
        middle = centre - np.einsum("ni,nij->nj", mean, inverse)
        reach = limit @ np.abs(inverse)
    # Boxes of nearly parallel light are not limited by the sensor.
    box, index = lenses_in_boxes(array, np.fmax(low - margin, middle - reach), np.fmin(high + margin, middle + reach))
    offset = lenses_at(array, index).axis - centre[box]
    predicted = np.einsum("ki,kij->kj", offset, series[box]) + mean[box]
    is_near = (np.abs(predicted) <= limit).all(axis=1)
    return np.asarray(np.column_stack([rows[box], index])[is_near])


def _fit_linear(positions: Floats, values: Floats) -> tuple[Floats, Floats, Floats]:
    """Least-squares linear fits to values (n, f, 2) at positions (n, f, 2); those that are nan do not count.

    Returns centres (n, 2), means (n, 2) and series (n, 2, 2): the value at x is mean + (x - centre) @ series.
    """
    is_known = np.isfinite(positions[..., :1] + values[..., :1])
    centre, mean = (np.mean(part, axis=1, where=is_known) for part in (positions, values))
    offset, change = (
        np.where(is_known, part - middle[:, None], 0.0) for part, middle in ((positions, centre), (values, mean))
    )
    transposed = offset.transpose(0, 2, 1)
    return centre, mean, np.linalg.pinv(transposed @ offset, hermitian=True) @ (transposed @ change)


def sensor_limit(through: ThroughArray) -> Floats:
    """Largest coordinates (2,) of chief rays on the sensor: a tenth of its size, or two pitches, outside."""
    half = 0.5 * np.array(through.axes.camera.sensor.size[::-1])
    return np.asarray(half + np.maximum(0.2 * half, 2.0 * max(through.array.pitches)))


def lenses_at(array: MicrolensArray, index: NDArray[np.int64]) -> Lenslets:
    """Microlenses with lattice indices (n, 2), which may repeat."""
    unique, row = unique_rows(index)
    lenses = lenses_of(array, unique)
    return Lenslets(*(getattr(lenses, field.name)[row] for field in dataclasses.fields(lenses)))


def _nearest_rays(bundles: PointBundles, number: NDArray[np.int64], positions: Floats) -> tuple[Floats, Floats]:
    """Entry points of the rays of points `number` (n,) that hit the array nearest to `positions` (n, 2).

    Of all rays, and of those that pass the lens; nan without one.
    """
    from plenoptic.camera.points.kernels.point_light import fill_nearest

    nearest = np.empty((len(number), 2), np.int64)
    fill_nearest(nearest, number, positions, bundles.arriving, bundles.passing)
    entries = bundles.entering[number[:, None], nearest]
    entries[nearest < 0] = np.nan
    return entries[:, 0], entries[:, 1]
