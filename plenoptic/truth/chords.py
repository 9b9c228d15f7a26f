"""The disparity that microlens images show: between chief rays of a point through neighbouring microlenses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import array_axes
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.points.projection_rays import CLOSE, Aim, EntranceRays, ThroughArray, aimed, entrance_rays, solved
from plenoptic.camera.points.projection_rows import lenses_with
from plenoptic.camera.psf.sensor_hits import forward_record
from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats
from plenoptic.optics.lens.trace import traced_by
from plenoptic.optics.microlens.lattice import Lattice, neighbour_steps

_TRIALS = 20
_STEP = 1e-5
"""Distance of the rays that give derivatives, over the size of the entrance pupil."""
_TOGETHER = 1 << 12
"""Pixels whose chief rays are aimed together."""


class ChordRecord(NamedTuple):
    """Quantities for aiming chief rays."""

    entrance: EntranceRays
    through: ThroughArray
    steps: NDArray[np.int64]
    """(k, 2): from a microlens to its neighbours, in lattice indices."""
    pitch: float
    """Of the microlenses, the smaller one, over that of the pixels."""


def chord_record(camera: PlenopticCamera) -> ChordRecord | None:
    """Compile a camera; None where microlenses lie on no lattice, and have no neighbours."""
    array = camera.microlenses
    if array is None or array.lattice is Lattice.FREE:
        return None
    through = ThroughArray(array_axes(camera), array)
    pitch = min(array.pitches) / camera.sensor.pixel_pitch
    return ChordRecord(entrance_rays(forward_record(camera)), through, neighbour_steps(array.lattice), pitch)


def chord_disparities(record: ChordRecord, points: Floats, lenses: NDArray[np.int64], entering: Floats) -> Floats:
    """(n,) disparities of points (n, 3) in the lens's axes, from microlenses (n, 2) to their neighbours.

    The least-squares slope over all neighbours, by how much images of the point move less than the microlenses;
    `entering` (n, 2) is where a ray of each point enters. nan where a chief ray is not found.
    """
    blocks = [
        _slopes(record, points[part], lenses[part], entering[part])
        for part in (slice(start, start + _TOGETHER) for start in range(0, len(points), _TOGETHER))
    ]
    return np.concatenate([np.empty(0), *blocks])


def _slopes(record: ChordRecord, points: Floats, lenses: NDArray[np.int64], entering: Floats) -> Floats:
    entrance, through, steps, pitch = record
    each = len(steps) + 1
    index = np.concatenate([lenses, *(lenses + step for step in steps)])
    centres = through.axes.local(lenses_with(through.array, index).axis)
    first = aimed(entrance, Aim(entrance.bare, through.places), points, centres[: len(points)], entering)
    rays = _chief_rays(record, np.tile(points, (each, 1)), centres, first)
    landed = through.sensor_points(centres, rays).reshape(each, -1, 2)
    straight = through.axes.on_sensor(centres, np.zeros_like(centres)).reshape(each, -1, 2)
    moved, distances = landed[1:] - landed[0], straight[1:] - straight[0]
    return np.asarray(pitch * _inner(distances - moved, distances) / _inner(distances, distances))


def _inner(one: Floats, other: Floats) -> Floats:
    """(m,): sums of products of (k, m, 2) over neighbours and axes, in an order that m does not change."""
    total = np.zeros(one.shape[1])
    for row in one * other:
        total += row[:, 0] + row[:, 1]
    return total


def _chief_rays(record: ChordRecord, points: Floats, centres: Floats, first: Floats) -> RayBundle:
    """Rays of points (k m, 3) behind the lens that pass centres (k m, 2); nan where none does.

    The first m of them enter at `first` (m, 2). Newton's method with the derivatives of those: chief rays through
    neighbours are so near each other that each step leaves a hundredth.
    """
    entrance, through, _, _ = record
    each, h = len(points) // len(first), _STEP * entrance.size

    def arriving(rows: NDArray[np.int64], places: Floats) -> tuple[RayBundle, Floats]:
        behind = traced_by(entrance.bare, entrance.through(points[rows], places))
        return behind, through.places(behind)

    rows = np.arange(len(points))
    at_centre, right, up = (arriving(rows[: len(first)], first + step)[1] for step in ([0.0, 0.0], [h, 0.0], [0.0, h]))
    slope = np.tile(np.stack([right - at_centre, up - at_centre], axis=-1) / h, (each, 1, 1))
    places, arrival = np.tile(first, (each, 1)), np.tile(at_centre, (each, 1))
    limit = CLOSE + 64 * np.finfo(float).eps * (np.abs(centres).max(axis=1, initial=0.0) + entrance.size)
    for _ in range(_TRIALS):
        miss = centres[rows] - arrival
        far = ~(np.hypot(*miss.T) <= limit[rows])
        rows = rows[far]
        if not len(rows):
            break
        places[rows] += solved(slope[rows], miss[far])
        arrival = arriving(rows, places[rows])[1]
    places[rows] = np.nan
    return arriving(np.arange(len(points)), places)[0]
