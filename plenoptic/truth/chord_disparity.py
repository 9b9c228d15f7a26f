"""Chord disparity: between chief rays of a point through neighbouring microlenses, as micro images show it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import array_axes
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.points.projection_rows import (
    Aim,
    EntranceRays,
    ThroughArray,
    aim_rays,
    aim_tolerance,
    entrance_rays,
    lenses_at,
    solve_2x2,
    trace_to_target,
)
from plenoptic.camera.psf.sensor_hits import forward_record
from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats
from plenoptic.optics.lens.trace import trace_record
from plenoptic.optics.microlens.lattice import Lattice, neighbour_steps

_TRIALS = 20
_CHUNK = 1 << 12
"""Pixels whose chief rays are aimed together."""


class ChordRecord(NamedTuple):
    """Records for aiming chief rays."""

    entrance: EntranceRays
    through: ThroughArray
    steps: NDArray[np.int64]
    """(k, 2): steps from a microlens to its neighbours, in lattice indices."""
    pitch: float
    """Smaller pitch of the microlenses over that of the pixels."""


def chord_record(camera: PlenopticCamera) -> ChordRecord | None:
    """Compile a camera; None without a regular lattice, in which microlenses have no defined neighbours."""
    array = camera.microlenses
    if array is None or array.lattice is Lattice.FREE:
        return None
    through = ThroughArray(array_axes(camera), array)
    pitch = min(array.pitches) / camera.sensor.pixel_pitch
    return ChordRecord(entrance_rays(forward_record(camera)), through, neighbour_steps(array.lattice), pitch)


def chord_disparities(record: ChordRecord, points: Floats, lenses: NDArray[np.int64], entering: Floats) -> Floats:
    """Disparities (n,) of points (n, 3) in the lens's axes, from microlenses (n, 2) to their neighbours.

    Least-squares slope over all neighbours of the displacement of the microlens less that of the image. `entering`
    (n, 2) is the entry point of a ray of each point. nan if a chief ray is not found.
    """
    chunks = [
        _slopes(record, points[part], lenses[part], entering[part])
        for part in (slice(start, start + _CHUNK) for start in range(0, len(points), _CHUNK))
    ]
    return np.concatenate([np.empty(0), *chunks])


def _slopes(record: ChordRecord, points: Floats, lenses: NDArray[np.int64], entering: Floats) -> Floats:
    entrance, through, steps, pitch = record
    n_lenses = len(steps) + 1
    index = np.concatenate([lenses, *(lenses + step for step in steps)])
    centres = through.axes.local(lenses_at(through.array, index).axis)
    aim = Aim(entrance.bare, through.intersections)
    first_entry = aim_rays(entrance, aim, points, centres[: len(points)], entering)
    rays = _chief_rays(record, np.tile(points, (n_lenses, 1)), centres, first_entry)
    image = through.sensor_points(centres, rays).reshape(n_lenses, -1, 2)
    centre_image = through.axes.on_sensor(centres, np.zeros_like(centres)).reshape(n_lenses, -1, 2)
    image_step, centre_step = image[1:] - image[0], centre_image[1:] - centre_image[0]
    return np.asarray(pitch * _dot(centre_step - image_step, centre_step) / _dot(centre_step, centre_step))


def _dot(a: Floats, b: Floats) -> Floats:
    """Dot products (m,) of (k, m, 2) over neighbours and axes, summed in an order independent of m."""
    total = np.zeros(a.shape[1])
    for row in a * b:
        total += row[:, 0] + row[:, 1]
    return total


def _chief_rays(record: ChordRecord, points: Floats, centres: Floats, first_entry: Floats) -> RayBundle:
    """Chief rays behind the lens of points (k m, 3) through centres (k m, 2); nan if there is none.

    The first m of them enter at `first_entry` (m, 2). Newton's method with the Jacobians of these: chief rays through
    neighbours are so close to each other that each step reduces the residual a hundredfold.
    """
    entrance, through, _, _ = record
    n_lenses, rows = len(points) // len(first_entry), np.arange(len(points))

    def trace(rows: NDArray[np.int64]) -> RayBundle:
        return trace_record(entrance.bare, entrance.through(points[rows], entry[rows]))

    aim = Aim(entrance.bare, through.intersections)
    position, jacobian = trace_to_target(entrance, aim, points[: len(first_entry)], first_entry)
    jacobian, hits = np.tile(jacobian, (n_lenses, 1, 1)), np.tile(position, (n_lenses, 1))
    entry, limit = np.tile(first_entry, (n_lenses, 1)), aim_tolerance(entrance, centres)
    for _ in range(_TRIALS):
        residual = centres[rows] - hits
        not_converged = ~(np.hypot(*residual.T) <= limit[rows])
        rows = rows[not_converged]
        if not len(rows):
            break
        entry[rows] += solve_2x2(jacobian[rows], residual[not_converged])
        hits = through.intersections(trace(rows))
    entry[rows] = np.nan
    return trace(np.arange(len(points)))
