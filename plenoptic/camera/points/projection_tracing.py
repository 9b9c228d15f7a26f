"""The rows of a projection: chief rays of points, and their light."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.array_axes import array_axes
from plenoptic.camera.points.projection_chiefs import ThroughArray, aimed, rays_from, through_iris
from plenoptic.camera.points.projection_light import REPLICATES, Light
from plenoptic.camera.points.projection_rows import candidates, footprints, lenses_of, nearest_rays, unique_rows
from plenoptic.camera.psf.sensor_hits import ForwardRecord, Task
from plenoptic.core.rays import RayBundle
from plenoptic.optics.lens.record import lens_record
from plenoptic.optics.lens.trace import traced_by
from plenoptic.optics.microlens.array import MicrolensArray

Floats = NDArray[np.float64]


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


def _pupil_size(tables: ForwardRecord) -> float:
    """Semi-diameter of what light enters through, in mm."""
    _, size, _ = tables.entrance.pupil
    return min(size, tables.entrance.reach) if np.isfinite(size) else tables.entrance.reach


def rows_through_iris(tables: ForwardRecord, seen: Floats, light: Light) -> Rows:
    """One row for each point (n, 3), in the lens's axes, of a camera without microlenses."""
    camera, z, n = tables.camera, tables.entrance.z, len(seen)
    aim, centre = through_iris(tables)
    pupil = tables.entrance.pupil[0]
    share = (z - seen[:, 2:]) / (pupil - seen[:, 2:]) if np.isfinite(pupil) else np.zeros((n, 1))
    # Towards the centre of the paraxial entrance pupil, wherever that lies.
    start = seen[:, :2] * np.where(np.abs(share) < 2.0, 1.0 - share, 0.0)
    size = _pupil_size(tables)
    entering = aimed(aim, seen, np.tile(centre, (n, 1)), start, z=z, size=size, wavelength=camera.wavelength)
    rays = rays_from(seen, entering, z, camera.wavelength)
    bare = lens_record(camera.lens, camera.wavelength, reverse=False, clipping=False)
    moments = np.zeros((n, REPLICATES, 3))
    moments[light.keys[:, 0]] = light.moments
    passes = traced_by(tables.lens, rays).status == 0
    return Rows(np.arange(n), None, _on_bare_sensor(tables, traced_by(bare, rays)), passes, moments, entering)


def _on_bare_sensor(tables: ForwardRecord, rays: RayBundle) -> Floats:
    """Where rays behind the lens meet a sensor without microlenses, in its own axes."""
    parts = tables.array.parts
    to_sensor = parts.sensor_to_local.inverse()
    origin = to_sensor.points(rays.origin - np.array([0.0, 0.0, parts.z_plane]))
    direction = to_sensor.directions(rays.direction)
    return np.asarray(origin[:, :2] - origin[:, 2:] / direction[:, 2:] * direction[:, :2])


def rows_through_microlenses(
    tables: ForwardRecord, array: MicrolensArray, seen: Floats, tasks: list[Task], light: Light
) -> Rows:
    """A row for each of the points (n, 3), in the lens's axes, and each microlens that gets its light or chief ray."""
    camera, z = tables.camera, tables.entrance.z
    axes = array_axes(camera)
    if not tasks:
        none, keys = np.empty((0, 2)), np.empty((0, 3), np.int64)
        return Rows(keys[:, 0], keys[:, 1:], none, keys[:, 0] > 0, np.empty((0, REPLICATES, 3)), none)
    bare = lens_record(camera.lens, camera.wavelength, reverse=False, clipping=False)
    aim = ThroughArray(bare, axes, array)
    prints = footprints(tasks, tables.lens, aim, z=z, wavelength=camera.wavelength)
    keys, row = unique_rows(np.concatenate([light.keys, candidates(prints, aim)]))
    moments = np.zeros((len(keys), REPLICATES, 3))
    moments[row[: len(light.keys)]] = light.moments
    number, centres = keys[:, 0], axes.local(lenses_of(array, keys[:, 1:]).axis)
    start = nearest_rays(prints, number, centres, passing=False)
    entering = aimed(aim, seen[number], centres, start, z=z, size=_pupil_size(tables), wavelength=camera.wavelength)
    rays = rays_from(seen[number], entering, z, camera.wavelength)
    passes = traced_by(tables.lens, rays).status == 0
    kept = passes | (moments[:, :, 0] > 0).any(axis=1)
    shadow = np.where(passes[:, None], entering, nearest_rays(prints, number, centres, passing=True))
    return Rows(
        point=number[kept],
        lens=keys[kept, 1:],
        position=aim.landing(centres, traced_by(bare, rays))[kept],
        passes=passes[kept],
        moments=moments[kept],
        entering=np.where(np.isfinite(shadow), shadow, entering)[kept],
    )
