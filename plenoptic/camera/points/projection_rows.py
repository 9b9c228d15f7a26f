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
from plenoptic.camera.psf.sensor_hits import ForwardRecord, RayTask, ray_tasks, trace_task
from plenoptic.core.parallel import run_in_order
from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats
from plenoptic.optics.element_record import IDEAL
from plenoptic.optics.lens.lens_record import LensRecord, lens_record
from plenoptic.optics.lens.trace import trace_record
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lenslets import Lenslets, lenses_of

REPLICATES = 32
"""Independent scramblings of the rays of a point, for the standard error."""
_RING_RADII = (1.0, 0.75, 0.5, 0.25, 0.0)
"""Radii of the rings of entry points, relative to the corners of the polygon through which light enters."""
_BOX_FACTOR = 1.25
"""Factor on the size of the box around the light in which microlenses are searched."""
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
        return RayBundle(start, start - points, self.wavelength)


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


class SensorLight(NamedTuple):
    """Light of points that reaches the sensor, a row for each point and microlens."""

    keys: NDArray[np.int64]
    """(k, 3): index of the point and lattice indices of the microlens, sorted; 0, 0 without microlenses."""
    moments: Floats
    """(k, replicates, 3): light, and light times x and y on the sensor, in mm."""


def _light_of(record: ForwardRecord, tasks: list[RayTask], rays_per_replicate: int, threads: int) -> SensorLight:
    """Trace tasks with a total of `rays_per_replicate` rays for every point and replicate."""

    def trace_sums(task: RayTask) -> tuple[NDArray[np.int64], Floats]:
        rows = trace_task(record, task, np.uint64(0)).rows
        lens, row_of_lens = _unique_rows(np.column_stack([rows["first"], rows["second"]]))
        sums = np.empty((len(lens), 3))
        for k, amount in enumerate((rows["weight"], rows["weight"] * rows["x"], rows["weight"] * rows["y"])):
            sums[:, k] = np.bincount(row_of_lens, amount, minlength=len(lens))
        return lens, sums / rays_per_replicate

    parts = list(run_in_order(trace_sums, tasks, threads=threads))
    counts = [len(lens) for lens, _ in parts]
    number = np.repeat([task.number for task in tasks], counts).astype(np.int64)
    replicate = np.repeat([task.replicate for task in tasks], counts).astype(np.int64)
    index = np.concatenate([np.empty((0, 2), np.int64), *(lens for lens, _ in parts)])
    keys, row = _unique_rows(np.column_stack([number, index]))
    moments = np.zeros((len(keys), REPLICATES, 3))
    np.add.at(moments, (row, replicate), np.concatenate([np.empty((0, 3)), *(sums for _, sums in parts)]))
    return SensorLight(keys, moments)


def _unique_rows(keys: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Unique rows (k, c) of integers (n, c), sorted, and the index of each row among them (n,)."""
    if not len(keys):
        return keys, np.empty(0, np.int64)
    order = np.lexsort(keys.T[::-1])
    ordered = keys[order]
    new = np.append(True, (ordered[1:] != ordered[:-1]).any(axis=1))
    row = np.empty(len(keys), np.int64)
    row[order] = np.cumsum(new) - 1
    return ordered[new], row


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
    moments: Floats
    """(k, replicates, 3): light, and light times x and y."""
    entering: Floats
    """(k, 2): entry point of the ray that represents the light."""


def trace_rows(record: ForwardRecord, points: Floats, rays_per_replicate: int, threads: int) -> Rows:
    """Compute the rows of points (n, 3) in the lens's axes."""
    tasks, array = ray_tasks(record, points, REPLICATES, rays_per_replicate), record.camera.microlenses
    if array is None:
        return _rows_through_iris(record, points, _light_of(record, tasks, rays_per_replicate, threads))
    light = _light_of(record, tasks if array.model.focuses else [], rays_per_replicate, threads)
    return _rows_through_microlenses(record, array, points, tasks, light)


def _rows_through_iris(record: ForwardRecord, points: Floats, light: SensorLight) -> Rows:
    """Rows of a camera without microlenses, one for each point."""
    entrance, n = entrance_rays(record), len(points)
    aim, centre = through_iris(record, entrance.bare)
    z, pupil = entrance.z, record.entrance.pupil[0]
    radius = (z - points[:, 2:]) / (pupil - points[:, 2:]) if np.isfinite(pupil) else np.zeros((n, 1))
    # Towards the centre of the paraxial entrance pupil.
    start = points[:, :2] * np.where(np.abs(radius) < 2.0, 1.0 - radius, 0.0)
    entering = aim_rays(entrance, aim, points, np.tile(centre, (n, 1)), start)
    rays = entrance.through(points, entering)
    moments = np.zeros((n, REPLICATES, 3))
    moments[light.keys[:, 0]] = light.moments
    position = straight_to_sensor(record, trace_record(entrance.bare, rays))
    return Rows(np.arange(n), None, position, trace_record(entrance.lens, rays).status == 0, moments, entering)


def straight_to_sensor(record: ForwardRecord, behind: RayBundle) -> Floats:
    """Intersections (n, 2) of rays behind the lens with the sensor, in its own axes, without microlenses."""
    parts = record.parts
    to_sensor = parts.sensor_to_local.inverse()
    origin = to_sensor.points(behind.origin - np.array([0.0, 0.0, parts.z_plane]))
    direction = to_sensor.directions(behind.direction)
    return np.asarray(origin[:, :2] - origin[:, 2:] / direction[:, 2:] * direction[:, :2])


def _rows_through_microlenses(
    record: ForwardRecord, array: MicrolensArray, points: Floats, tasks: list[RayTask], light: SensorLight
) -> Rows:
    """Rows of a camera with microlenses: for each microlens that receives a point's light or chief ray."""
    if not tasks:
        empty, keys = np.empty((0, 2)), np.empty((0, 3), np.int64)
        return Rows(keys[:, 0], keys[:, 1:], empty, keys[:, 0] > 0, np.empty((0, REPLICATES, 3)), empty)
    entrance, axes = entrance_rays(record), array_axes(record.camera)
    through = ThroughArray(axes, array)
    bundles = _trace_bundles(tasks, entrance, through)
    keys, row = _unique_rows(np.concatenate([light.keys, _candidate_keys(bundles, through)]))
    moments = np.zeros((len(keys), REPLICATES, 3))
    moments[row[: len(light.keys)]] = light.moments
    number, centres = keys[:, 0], axes.local(lenses_at(array, keys[:, 1:]).axis)
    aim = Aim(entrance.bare, through.intersections)
    entering = aim_rays(entrance, aim, points[number], centres, _nearest_rays(bundles, number, centres, passing=False))
    passes = trace_record(entrance.lens, entrance.through(points[number], entering)).status == 0
    lit, passing_entry = (moments[:, :, 0] > 0).any(axis=1), _nearest_rays(bundles, number, centres, passing=True)
    # Strong lenses have several rays from a point to a microlens: if there is light, use one that passes.
    retry = np.flatnonzero(lit & ~passes & np.isfinite(passing_entry).all(axis=1))
    if len(retry):
        other_entry = aim_rays(entrance, aim, points[number[retry]], centres[retry], passing_entry[retry])
        is_unvignetted = trace_record(entrance.lens, entrance.through(points[number[retry]], other_entry)).status == 0
        entering[retry[is_unvignetted]], passes[retry[is_unvignetted]] = other_entry[is_unvignetted], True
    rays, selected = entrance.through(points[number], entering), passes | lit
    shadow = np.where(passes[:, None], entering, passing_entry)
    return Rows(
        point=number[selected],
        lens=keys[selected, 1:],
        position=through.sensor_points(centres, trace_record(entrance.bare, rays))[selected],
        passes=passes[selected],
        moments=moments[selected],
        entering=np.where(np.isfinite(shadow), shadow, entering)[selected],
    )


class PointBundles(NamedTuple):
    """Rays of visible points, the same number for each."""

    number: NDArray[np.int64]
    """(m,): index of the point."""
    entering: Floats
    """(m, f, 2): entry points on the entrance plane."""
    arriving: Floats
    """(m, f, 2): intersections with the array, local; nan if there is none."""
    on_sensor: Floats
    """(m, f, 2): intersections with the sensor, in its own axes, for a microlens centred on the ray."""
    passing: NDArray[np.bool_]
    """(m, f): True if the ray is not vignetted."""


def _trace_bundles(tasks: list[RayTask], entrance: EntranceRays, through: ThroughArray) -> PointBundles:
    """Trace rings of rays from every visible point."""
    firsts = {task.number: task for task in tasks[::-1]}
    number = np.array(sorted(firsts), dtype=np.int64)
    entering = np.stack([_ring_points(firsts[k].polygon) for k in number])
    points = np.repeat([firsts[k].point for k in number], entering.shape[1], axis=0)
    rays = entrance.through(points, entering.reshape(-1, 2))
    traced = trace_record(entrance.bare, rays)
    arriving = through.intersections(traced)
    on_sensor = through.sensor_points(arriving, traced).reshape(entering.shape)
    passing = (trace_record(entrance.lens, rays).status == 0).reshape(entering.shape[:2])
    return PointBundles(number, entering, arriving.reshape(entering.shape), on_sensor, passing)


def _ring_points(polygon: Floats) -> Floats:
    """Points (f, 2) on rings in a polygon (2, k): points of its outline, and these scaled towards its centre."""
    fan = np.linspace(0, polygon.shape[1] - 3, 16).round().astype(int)
    outline = polygon.T[np.stack([fan + 1, fan + 2], axis=1)].reshape(-1, 2)
    centre = (2.0 * outline.mean(axis=0) + polygon[:, 0]) / 3.0
    return np.concatenate([centre + radius * (outline - centre) for radius in _RING_RADII])


def _candidate_keys(bundles: PointBundles, through: ThroughArray) -> NDArray[np.int64]:
    """Keys (k, 3) of the microlenses in a box around each point's light: index of the point and lattice indices.

    Microlenses whose chief rays are farther outside the sensor than a tenth of its size, or two pitches, are left out.
    """
    axes, array = through
    height, width = axes.camera.sensor.size
    limit = np.array([width, height])
    limit = 0.5 * limit + np.maximum(0.1 * limit, 2.0 * max(array.pitches))
    keys = [np.empty((0, 3), dtype=np.int64)]
    for number, arriving, on_sensor in zip(bundles.number, bundles.arriving, bundles.on_sensor, strict=True):
        hits = np.isfinite(arriving).all(axis=1)
        if not hits.any():
            continue
        on_array = axes.on_array(arriving[hits])
        low, high = on_array.min(axis=0), on_array.max(axis=0)
        margin = 0.5 * (_BOX_FACTOR - 1.0) * (high - low) + array.cell_radius
        lenses = array.lenses(low - margin, high + margin)
        near = np.abs(_fit_linear(on_array, on_sensor[hits], lenses.axis)) <= limit
        index = lenses.index[near.all(axis=1)]
        keys.append(np.column_stack([np.full(len(index), number), index]))
    return np.concatenate(keys)


def _fit_linear(positions: Floats, values: Floats, targets: Floats) -> Floats:
    """Values (n, 2) at `targets` (n, 2) of the least-squares linear fit to values (m, 2) at positions (m, 2)."""
    centre = positions.mean(axis=0)
    series, *_ = np.linalg.lstsq(np.column_stack([positions - centre, np.ones(len(positions))]), values, rcond=None)
    return np.asarray((targets - centre) @ series[:2] + series[2])


def lenses_at(array: MicrolensArray, index: NDArray[np.int64]) -> Lenslets:
    """Microlenses with lattice indices (n, 2), which may repeat."""
    unique, row = _unique_rows(index)
    lenses = lenses_of(array, unique)
    return Lenslets(*(getattr(lenses, field.name)[row] for field in dataclasses.fields(lenses)))


def _nearest_rays(bundles: PointBundles, number: NDArray[np.int64], positions: Floats, *, passing: bool) -> Floats:
    """Entry points of the rays of points `number` (n,) that hit the array nearest to `positions` (n, 2), or nan."""
    nearest_entry = np.full(positions.shape, np.nan)
    for k, point in enumerate(bundles.number):
        low, high = np.searchsorted(number, [point, point + 1])
        valid = np.isfinite(bundles.arriving[k]).all(axis=1)
        if passing:
            valid &= bundles.passing[k]
        if low == high or not valid.any():
            continue
        arriving, entering = bundles.arriving[k][valid], bundles.entering[k][valid]
        offset = positions[low:high, None] - arriving
        nearest_entry[low:high] = entering[np.einsum("nfi,nfi->nf", offset, offset).argmin(axis=1)]
    return nearest_entry
