"""Motion of the points that pixels show, from one frame to the next: in the world, and on the sensor."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import array_axes
from plenoptic.camera.cache import prepared_camera
from plenoptic.camera.checks import sensor_region
from plenoptic.camera.points.projection import transmission_to_lens
from plenoptic.camera.points.projection_rows import (
    Aim,
    ThroughArray,
    aim_rays,
    entrance_rays,
    lenses_at,
    straight_to_sensor,
    through_iris,
)
from plenoptic.camera.psf.sensor_hits import ForwardRecord, forward_record
from plenoptic.core.parallel import thread_count
from plenoptic.core.progress.bar import CallProgress
from plenoptic.core.values import Floats, check_kind, result
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.trace import trace_record
from plenoptic.scene.geometry.geometry_records import Geometry, Hits
from plenoptic.sequences.sequence import Frame
from plenoptic.truth.channels import Truth
from plenoptic.truth.ground_truth import Arrays, compute_in_strips, truth_record
from plenoptic.truth.representative_rays import RepresentativeRays
from plenoptic.truth.truth_stages import PixelStages


@result
class MotionTruth:
    """Positions in the next frame of the points that a raw image's pixels show. Made by `motion_truth`.

    Attributes
    ----------
    position : (H, W, 3) array
        World position in the next frame of the scene point that the pixel shows, mm; nan without one.
    shift : (H, W, 2) array
        Motion of its image behind the pixel's microlens on the sensor, in pixels: to higher columns, to higher rows.
        nan without a point, or without one of the two chief rays.
    visible : (H, W) array of bool
        True if it is seen in the next frame through the same microlens: nothing hides it, and its chief ray passes all
        stops and rims, within the microlens's image, and hits the sensor.
    """

    position: Floats
    shift: Floats
    visible: NDArray[np.bool_]

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = self.visible.shape
        return rows, columns

    def __repr__(self) -> str:
        rows, columns = self.shape
        return f"MotionTruth({rows} x {columns}, {np.mean(self.visible):.1%} visible in the next frame)"


def motion_truth(
    now: Frame,
    following: Frame,
    *,
    region: tuple[slice, slice] | None = None,
    threads: int | None = None,
    progress: bool = True,
) -> MotionTruth:
    """Find the positions in another frame of the points that the pixels of one frame show.

    Parameters
    ----------
    now, following : Frame
        Of one `Sequence`, in any order; or others with the same triangles, and cameras that differ only in their pose.
    region, threads, progress
        As for `ground_truth`.

    Returns
    -------
    MotionTruth

    Raises
    ------
    InvalidValueError
        If there is no surface, or the frames have different triangles or cameras.

    Notes
    -----
    The point is that of `ground_truth`, and moves with its triangle. Its images are those of its chief rays, as in
    `project`: in both frames through the optical centre of the microlens that the pixel's ray passes; without
    microlenses, through the centre of the iris.

    Surfaces nearer to the point than 1/4096 of its distance from the lens do not hide it.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> sensor = pl.Sensor(shape=(16, 16), pixel_pitch=0.1)
    >>> camera = pl.PlenopticCamera(pl.load_lens("double-gauss-100mm-f2"), sensor, stop_to_microlenses=130.0)
    >>> slide = pl.Motion.screw((0, 1), axis=(1, 0, 0), advance=2.0)
    >>> pair = pl.Sequence(pl.shapes.white_plane(), camera, (0.0, 0.5), motions={"Mesh 0": slide})
    >>> truth = pl.sequences.motion_truth(*pair, region=np.s_[8:9, 8:9])
    >>> truth.shift.round(1)[0, 0, 0].item(), truth.visible.tolist()
    (3.1, [[True]])
    """
    for name, frame in (("now", now), ("following", following)):
        check_kind(frame, name, Frame, "sequence[0]")
    bounds, workers = sensor_region(now.camera.sensor.shape, region), thread_count(threads)
    with CallProgress("motion truth", kind="scene", show=progress):
        return _motion_truth(now, following, bounds, workers)


class _Chief(NamedTuple):
    """Chief rays of points (m, 3)."""

    position: Floats
    """(m, 2): intersection with the sensor, in its own axes, mm; nan without one."""
    entering: Floats
    """(m, 2): intersection with the plane at which rays enter the lens."""
    passes: NDArray[np.bool_]
    """(m,): True if they pass the lens and hit the sensor."""


def _motion_truth(now: Frame, following: Frame, region: tuple[int, int, int, int], workers: int) -> MotionTruth:
    from plenoptic.scene.cache import prepared_scene

    scene, following_scene = prepared_scene(now.scene), prepared_scene(following.scene)
    geometries = _geometries(now, following, scene.record.geometry, following_scene.record.geometry)
    record, tables = prepared_camera(now.camera).record, (forward_record(now.camera), forward_record(following.camera))
    finding, pixel_of = truth_record(now.camera, record, Truth.POSITION), now.camera.sensor.pixel_of
    assert finding is not None
    intersector, _ = scene.intersector, following_scene.intersector  # built before threads ask for them

    def work(pixels: Floats, rays: RepresentativeRays) -> Arrays:
        stages, n = PixelStages(record, scene.record, intersector, finding, pixels, rays), len(pixels)
        lanes, lenses = stages.hits.pixels, None if record.array is None else stages.lenses[stages.hits.pixels]
        points = _move_with_triangles(stages.world_points, stages.hits.hits, *geometries)
        entering = stages.entering(tables[0].entrance.z)
        before = _chief_rays(tables[0], stages.points, lenses, entering)
        after = _chief_rays(tables[1], _in_lens_axes(tables[1], points), lenses, before.entering)
        position, shift, visible = np.full((n, 3), np.nan), np.full((n, 2), np.nan), np.zeros(n, bool)
        position[lanes] = points
        shift[lanes] = (pixel_of(after.position) - pixel_of(before.position))[:, ::-1]
        passing = np.flatnonzero(after.passes)
        transmission = transmission_to_lens(tables[1], points[passing], after.entering[passing], following_scene)
        visible[lanes[passing]] = transmission > 0.5
        return {"position": position, "shift": shift, "visible": visible}

    return MotionTruth(**compute_in_strips(record, region, workers, work))


def _geometries(
    now: Frame, following: Frame, before: Geometry | None, after: Geometry | None
) -> tuple[Geometry, Geometry]:
    """The triangles of both frames; raise InvalidValueError unless points of one are points of the other."""
    if before is None or after is None:
        raise InvalidValueError("a frame has no mesh and no light with a surface; there is nothing that could move")
    if not np.array_equal(before.triangles, after.triangles):
        raise InvalidValueError("the frames have different triangles; give two frames of one sequence")
    if now.camera.microlenses != following.camera.microlenses or now.camera.sensor != following.camera.sensor:
        raise InvalidValueError("the frames have different cameras; give two that differ in their pose alone")
    return before, after


def _move_with_triangles(points: Floats, hits: Hits, before: Geometry, after: Geometry) -> Floats:
    """Positions (m, 3) to which points (m, 3) move with the triangles on which they lie."""
    axes, moved = _axes_on(before, hits), _axes_on(after, hits)
    coordinates = np.linalg.solve(axes[:, :, :3], (points - axes[:, :, 3])[:, :, None])
    return np.asarray((moved[:, :, :3] @ coordinates)[:, :, 0] + moved[:, :, 3])


def _axes_on(geometry: Geometry, hits: Hits) -> Floats:
    """(m, 3, 4): two edges of triangles, their unit normal, and a corner, in the world."""
    corners = geometry.vertices[geometry.triangles[hits.triangle]]
    if hits.instance is not None and geometry.instance_to_world is not None:
        placed = hits.instance >= 0
        rows = geometry.instance_to_world[hits.instance[placed], :12].reshape(-1, 3, 4)
        corners[placed] = corners[placed] @ rows[:, :, :3].transpose(0, 2, 1) + rows[:, None, :, 3]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(first, second)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return np.stack([first, second, normal, corners[:, 0]], axis=2)


def _in_lens_axes(tables: ForwardRecord, points: Floats) -> Floats:
    """World points (m, 3) in the lens's axes; nan unless they lie in front of it."""
    pose, placed = tables.camera.pose, tables.parts.lens_to_camera
    local = points if pose is None else pose.to_camera(points)
    local = local if placed is None else placed.inverse().points(local)
    return np.where(local[:, 2:] < tables.entrance.z, local, np.nan)


def _chief_rays(tables: ForwardRecord, points: Floats, lenses: NDArray[np.int64] | None, start: Floats) -> _Chief:
    """Chief rays of points (m, 3) in the lens's axes through microlenses (m, 2), or the iris, searched from `start`."""
    entrance, array = entrance_rays(tables), tables.camera.microlenses
    if array is None or lenses is None:
        aim, centre = through_iris(tables, entrance.bare)
        entering = aim_rays(entrance, aim, points, np.tile(centre, (len(points), 1)), start)
        rays = entrance.through(points, entering)
        position = straight_to_sensor(tables, trace_record(entrance.bare, rays))
    else:
        through = ThroughArray(array_axes(tables.camera), array)
        centres = through.axes.local(lenses_at(array, lenses).axis)
        entering = aim_rays(entrance, Aim(entrance.bare, through.intersections), points, centres, start)
        rays = entrance.through(points, entering)
        position = through.sensor_points(centres, trace_record(entrance.bare, rays))
    half = 0.5 * np.array(tables.camera.sensor.size[::-1])
    with np.errstate(invalid="ignore"):
        lands = (np.abs(position) <= half).all(axis=1)
    return _Chief(position, entering, (trace_record(entrance.lens, rays).status == 0) & lands)
