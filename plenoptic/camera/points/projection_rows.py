"""The rows of a projection: which microlenses can see a point, its chief rays through them, and its light."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import array_axes
from plenoptic.camera.points.projection_rays import Aim, EntranceRays, ThroughArray, aimed, entrance_rays, through_iris
from plenoptic.camera.psf.sensor_hits import ForwardRecord, Task, landed, tasks_of
from plenoptic.core.parallel import run_in_order
from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats
from plenoptic.optics.lens.trace import traced_by
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lenslets import Lenslets, lenses_of

REPLICATES = 32
"""Independent scramblings of the rays of a point; errors come from their spread."""
_RINGS = (1.0, 0.75, 0.5, 0.25, 0.0)
"""Where rays enter, as parts of the way from the middle of what a point's light enters through to its corners."""
_ROOM = 1.25
"""Microlenses are looked for in a box around the light that is larger by this factor."""


class Light(NamedTuple):
    """Light of points that lands on the sensor, a row for each point and microlens."""

    keys: NDArray[np.int64]
    """(k, 3): number of the point and lattice indices of the microlens, in order; 0, 0 without microlenses."""
    moments: Floats
    """(k, replicates, 3): light, and light times x and y on the sensor, in mm."""


def _light_of(tables: ForwardRecord, tasks: list[Task], each: int, threads: int) -> Light:
    """Trace tasks that come to `each` rays for every point and replicate."""

    def work(task: Task) -> tuple[NDArray[np.int64], Floats]:
        rows = landed(tables, task, np.uint64(0)).rows
        lens, place = _unique_rows(np.column_stack([rows["first"], rows["second"]]))
        sums = np.empty((len(lens), 3))
        for k, amount in enumerate((rows["weight"], rows["weight"] * rows["x"], rows["weight"] * rows["y"])):
            sums[:, k] = np.bincount(place, amount, minlength=len(lens))
        return lens, sums / each

    parts = list(run_in_order(work, tasks, threads=threads))
    counts = [len(lens) for lens, _ in parts]
    number = np.repeat([task.number for task in tasks], counts).astype(np.int64)
    replicate = np.repeat([task.replicate for task in tasks], counts).astype(np.int64)
    index = np.concatenate([np.empty((0, 2), np.int64), *(lens for lens, _ in parts)])
    keys, row = _unique_rows(np.column_stack([number, index]))
    moments = np.zeros((len(keys), REPLICATES, 3))
    np.add.at(moments, (row, replicate), np.concatenate([np.empty((0, 3)), *(sums for _, sums in parts)]))
    return Light(keys, moments)


def _unique_rows(keys: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The different rows (k, c) of whole numbers (n, c) in order, and which of them each row is (n,)."""
    if not len(keys):
        return keys, np.empty(0, np.int64)
    order = np.lexsort(keys.T[::-1])
    ordered = keys[order]
    new = np.append(True, (ordered[1:] != ordered[:-1]).any(axis=1))
    row = np.empty(len(keys), np.int64)
    row[order] = np.cumsum(new) - 1
    return ordered[new], row


class Rows(NamedTuple):
    """One for each point and microlens that sees it."""

    point: NDArray[np.int64]
    """(k,)"""
    lens: NDArray[np.int64] | None
    """(k, 2) lattice indices; None without microlenses."""
    position: Floats
    """(k, 2): where the chief ray meets the sensor, in its own axes; nan where there is none."""
    passes: NDArray[np.bool_]
    """(k,): whether the lens lets the chief ray pass."""
    moments: Floats
    """(k, replicates, 3): light, and light times x and y."""
    entering: Floats
    """(k, 2): where a ray enters, on the plane of the entrance, that stands for the light."""


def rows_of(tables: ForwardRecord, seen: Floats, each: int, threads: int) -> Rows:
    """The rows of points (n, 3) in the lens's axes, with the light of `each` rays for every point and replicate."""
    tasks, array = tasks_of(tables, seen, REPLICATES, each), tables.camera.microlenses
    if array is None:
        return _rows_through_iris(tables, seen, _light_of(tables, tasks, each, threads))
    light = _light_of(tables, tasks if array.model.focuses else [], each, threads)
    return _rows_through_microlenses(tables, array, seen, tasks, light)


def _rows_through_iris(tables: ForwardRecord, seen: Floats, light: Light) -> Rows:
    """One row for each point of a camera without microlenses."""
    entrance, n = entrance_rays(tables), len(seen)
    aim, centre = through_iris(tables, entrance.bare)
    z, pupil = entrance.z, tables.entrance.pupil[0]
    fraction = (z - seen[:, 2:]) / (pupil - seen[:, 2:]) if np.isfinite(pupil) else np.zeros((n, 1))
    # Towards the centre of the paraxial entrance pupil, wherever that lies.
    start = seen[:, :2] * np.where(np.abs(fraction) < 2.0, 1.0 - fraction, 0.0)
    entering = aimed(entrance, aim, seen, np.tile(centre, (n, 1)), start)
    rays = entrance.through(seen, entering)
    moments = np.zeros((n, REPLICATES, 3))
    moments[light.keys[:, 0]] = light.moments
    position = straight_to_sensor(tables, traced_by(entrance.bare, rays))
    return Rows(np.arange(n), None, position, traced_by(entrance.lens, rays).status == 0, moments, entering)


def straight_to_sensor(tables: ForwardRecord, behind: RayBundle) -> Floats:
    """(n, 2): where rays behind the lens of a camera without microlenses meet the sensor, in its own axes."""
    parts = tables.array.parts
    to_sensor = parts.sensor_to_local.inverse()
    origin = to_sensor.points(behind.origin - np.array([0.0, 0.0, parts.z_plane]))
    direction = to_sensor.directions(behind.direction)
    return np.asarray(origin[:, :2] - origin[:, 2:] / direction[:, 2:] * direction[:, :2])


def _rows_through_microlenses(
    tables: ForwardRecord, array: MicrolensArray, seen: Floats, tasks: list[Task], light: Light
) -> Rows:
    """A row for each point and each microlens that gets its light or chief ray."""
    if not tasks:
        none, keys = np.empty((0, 2)), np.empty((0, 3), np.int64)
        return Rows(keys[:, 0], keys[:, 1:], none, keys[:, 0] > 0, np.empty((0, REPLICATES, 3)), none)
    entrance, axes = entrance_rays(tables), array_axes(tables.camera)
    through = ThroughArray(axes, array)
    prints = _footprints(tasks, entrance, through)
    keys, row = _unique_rows(np.concatenate([light.keys, _candidates(prints, through)]))
    moments = np.zeros((len(keys), REPLICATES, 3))
    moments[row[: len(light.keys)]] = light.moments
    number, centres = keys[:, 0], axes.local(lenses_with(array, keys[:, 1:]).axis)
    aim = Aim(entrance.bare, through.places)
    entering = aimed(entrance, aim, seen[number], centres, _nearest_rays(prints, number, centres, passing=False))
    passes = traced_by(entrance.lens, entrance.through(seen[number], entering)).status == 0
    lit, inside = (moments[:, :, 0] > 0).any(axis=1), _nearest_rays(prints, number, centres, passing=True)
    # Strong lenses have several rays from a point to a microlens: where there is light, one that passes is wanted.
    again = np.flatnonzero(lit & ~passes & np.isfinite(inside).all(axis=1))
    if len(again):
        other = aimed(entrance, aim, seen[number[again]], centres[again], inside[again])
        passed = traced_by(entrance.lens, entrance.through(seen[number[again]], other)).status == 0
        entering[again[passed]], passes[again[passed]] = other[passed], True
    rays, lit_rows = entrance.through(seen[number], entering), passes | lit
    shadow = np.where(passes[:, None], entering, inside)
    return Rows(
        point=number[lit_rows],
        lens=keys[lit_rows, 1:],
        position=through.sensor_points(centres, traced_by(entrance.bare, rays))[lit_rows],
        passes=passes[lit_rows],
        moments=moments[lit_rows],
        entering=np.where(np.isfinite(shadow), shadow, entering)[lit_rows],
    )


class Footprints(NamedTuple):
    """Rays of points that are in sight, all with as many."""

    number: NDArray[np.int64]
    """(m,): which of the points they come from."""
    entering: Floats
    """(m, f, 2): where they enter, on the plane of the entrance."""
    arriving: Floats
    """(m, f, 2): where they meet the array, local; nan where they do not."""
    on_sensor: Floats
    """(m, f, 2): where they would meet the sensor, in its own axes, if a microlens were centred on them."""
    passing: NDArray[np.bool_]
    """(m, f): whether the lens lets them pass."""


def _footprints(tasks: list[Task], entrance: EntranceRays, through: ThroughArray) -> Footprints:
    """Trace the rings of rays of every point that has tasks."""
    firsts = {task.number: task for task in tasks[::-1]}
    number = np.array(sorted(firsts), dtype=np.int64)
    entering = np.stack([_rings(firsts[k].polygon) for k in number])
    points = np.repeat([firsts[k].point for k in number], entering.shape[1], axis=0)
    rays = entrance.through(points, entering.reshape(-1, 2))
    traced = traced_by(entrance.bare, rays)
    arriving = through.places(traced)
    on_sensor = through.sensor_points(arriving, traced).reshape(entering.shape)
    passing = (traced_by(entrance.lens, rays).status == 0).reshape(entering.shape[:2])
    return Footprints(number, entering, arriving.reshape(entering.shape), on_sensor, passing)


def _rings(polygon: Floats) -> Floats:
    """Points (f, 2) of a polygon (2, k), divided into a fan: corners of triangles, and others towards the middle."""
    fan = np.linspace(0, polygon.shape[1] - 3, 16).round().astype(int)
    outline = polygon.T[np.stack([fan + 1, fan + 2], axis=1)].reshape(-1, 2)
    middle = (2.0 * outline.mean(axis=0) + polygon[:, 0]) / 3.0
    return np.concatenate([middle + share * (outline - middle) for share in _RINGS])


def _candidates(prints: Footprints, through: ThroughArray) -> NDArray[np.int64]:
    """(k, 3): numbers of points and lattice indices of the microlenses in boxes around their light.

    Those whose chief rays would land farther beside the sensor than a tenth of its size, or two pitches, are left out.
    """
    axes, array = through
    height, width = axes.camera.sensor.size
    limit = np.array([width, height])
    limit = 0.5 * limit + np.maximum(0.1 * limit, 2.0 * max(array.pitches))
    pairs = [np.empty((0, 3), dtype=np.int64)]
    for number, arriving, on_sensor in zip(prints.number, prints.arriving, prints.on_sensor, strict=True):
        arrives = np.isfinite(arriving).all(axis=1)
        if not arrives.any():
            continue
        on_array = axes.on_array(arriving[arrives])
        low, high = on_array.min(axis=0), on_array.max(axis=0)
        room = 0.5 * (_ROOM - 1.0) * (high - low) + array.cell_radius
        lenses = array.lenses(low - room, high + room)
        near = np.abs(_linear(on_array, on_sensor[arrives], lenses.axis)) <= limit
        index = lenses.index[near.all(axis=1)]
        pairs.append(np.column_stack([np.full(len(index), number), index]))
    return np.concatenate(pairs)


def _linear(places: Floats, values: Floats, wanted: Floats) -> Floats:
    """Values (n, 2) at `wanted` (n, 2) of the linear function that is nearest to those at places (m, 2)."""
    middle = places.mean(axis=0)
    series, *_ = np.linalg.lstsq(np.column_stack([places - middle, np.ones(len(places))]), values, rcond=None)
    return np.asarray((wanted - middle) @ series[:2] + series[2])


def lenses_with(array: MicrolensArray, index: NDArray[np.int64]) -> Lenslets:
    """The microlenses with lattice indices (n, 2), which may be the same."""
    once, row = _unique_rows(index)
    listed = lenses_of(array, once)
    return Lenslets(*(getattr(listed, field.name)[row] for field in dataclasses.fields(listed)))


def _nearest_rays(prints: Footprints, number: NDArray[np.int64], places: Floats, *, passing: bool) -> Floats:
    """Entrance points of the rays of points `number` (n,) that meet the array nearest to `places` (n, 2); nan without
    one.
    """
    nearest = np.full(places.shape, np.nan)
    for k, point in enumerate(prints.number):
        low, high = np.searchsorted(number, [point, point + 1])
        usable = np.isfinite(prints.arriving[k]).all(axis=1)
        if passing:
            usable &= prints.passing[k]
        if low == high or not usable.any():
            continue
        arriving, entering = prints.arriving[k][usable], prints.entering[k][usable]
        off = places[low:high, None] - arriving
        nearest[low:high] = entering[np.einsum("nfi,nfi->nf", off, off).argmin(axis=1)]
    return nearest
