"""Motion of the points that pixels show, from one frame to the next: in the world, and on the sensor."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import array_axes
from plenoptic.camera.cache import prepared_camera
from plenoptic.camera.checks import sensor_region
from plenoptic.camera.points.projection import are_occluded
from plenoptic.camera.points.projection_rays import Aim, ThroughArray, aim_rays, entrance_rays, through_iris
from plenoptic.camera.points.projection_rows import lenses_at, straight_to_sensor
from plenoptic.camera.psf.sensor_hits import ForwardRecord, forward_record
from plenoptic.core.parallel import thread_count
from plenoptic.core.progress.bar import CallProgress
from plenoptic.core.values import Floats, check_kind, result
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.trace import traced_by
from plenoptic.sequences.sequence import Frame
from plenoptic.truth.channels import Truth
from plenoptic.truth.ground_truth import Arrays, compute_in_strips, truth_record
from plenoptic.truth.representative_rays import RepresentativeRays
from plenoptic.truth.truth_stages import PixelStages

if TYPE_CHECKING:
    from plenoptic.scene.geometry.geometry_records import Geometry, Hits


@result
class MotionTruth:
    """Positions in the next frame of the points that a raw image's pixels show. Made by `motion_truth`.

    Attributes
    ----------
    position : (H, W, 3) array
        The place in the world, in the next frame, of the scene point that the pixel shows, mm; nan where its ray meets
        nothing.
    shift : (H, W, 2) array
        By how many pixels its image behind the pixel's microlens moves on the sensor: to higher columns, to higher
        rows. nan where nothing is met, or one of the two chief rays does not exist.
    visible : (H, W) array of bool
        Whether it is seen in the next frame through the same microlens: nothing hides it, its chief ray passes all
        stops and rims, as it does within the microlens's image, and lands on the sensor.
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
        Of one `Sequence`, in any order; or others with the same triangles, before cameras that differ in their pose.
    region, threads, progress
        As for `ground_truth`.

    Returns
    -------
    MotionTruth

    Raises
    ------
    InvalidValueError
        Where there is nothing to meet, or the frames have other triangles or other cameras.

    Notes
    -----
    The point is that of `ground_truth`. It keeps its place on its triangle, which the other frame has elsewhere. Its
    images are those of its chief rays, as `project` finds them: through the optical centre of the microlens that
    the pixel's ray passes, in both frames; without microlenses, through the centre of the iris.

    Surfaces nearer to the point than 1/4096 of its way to the lens do not hide it.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2"),
    ...     sensor=pl.Sensor(shape=(16, 16), pixel_pitch=0.1), stop_to_microlenses=130.0)
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
    """(m, 2): where they meet the sensor, in its own axes, mm; nan where there is none."""
    entering: Floats
    """(m, 2): where they cross the plane where rays enter the lens."""
    passes: NDArray[np.bool_]
    """(m,): whether the lens lets them pass, and they land on the sensor."""


def _motion_truth(now: Frame, following: Frame, region: tuple[int, int, int, int], workers: int) -> MotionTruth:
    from plenoptic.scene.cache import prepared_scene

    scene, then = prepared_scene(now.scene), prepared_scene(following.scene)
    places = _places(now, following, scene.record.geometry, then.record.geometry)
    record, tables = prepared_camera(now.camera).record, (forward_record(now.camera), forward_record(following.camera))
    finding, pixel_of = truth_record(now.camera, record, Truth.POSITION), now.camera.sensor.pixel_of
    assert finding is not None
    intersector, _ = scene.intersector, then.intersector  # built before threads ask for them

    def work(pixels: Floats, rays: RepresentativeRays) -> Arrays:
        stages, n = PixelStages(record, scene.record, intersector, finding, pixels, rays), len(pixels)
        lanes, lenses = stages.hits.pixels, None if record.array is None else stages.lenses[stages.hits.pixels]
        before_points = stages.points.points[lanes]
        after_points = _carry(stages.world_points()[lanes], stages.hits.hits, *places)
        before = _chief_rays(tables[0], before_points, lenses, stages.entering(tables[0].entrance.z))
        after = _chief_rays(tables[1], _seen(tables[1], after_points), lenses, before.entering)
        found = {"position": np.full((n, 3), np.nan), "shift": np.full((n, 2), np.nan), "visible": np.zeros(n, bool)}
        found["position"][lanes] = after_points
        found["shift"][lanes] = (pixel_of(after.position) - pixel_of(before.position))[:, ::-1]
        passing = np.flatnonzero(after.passes)
        found["visible"][lanes[passing]] = ~are_occluded(
            tables[1], after_points[passing], after.entering[passing], then
        )
        return found

    return MotionTruth(**compute_in_strips(record, region, workers, work))


def _places(now: Frame, following: Frame, here: Geometry | None, then: Geometry | None) -> tuple[Geometry, Geometry]:
    """The triangles of both frames, or an error where points of one are none of the other."""
    if here is None or then is None:
        raise InvalidValueError("a frame has no mesh and no light with a surface; there is nothing that could move")
    if not np.array_equal(here.triangles, then.triangles):
        raise InvalidValueError("the frames have different triangles; give two frames of one sequence")
    one, other = now.camera, following.camera
    if one.microlenses != other.microlenses or one.sensor != other.sensor:
        raise InvalidValueError("the frames have different cameras; give two that differ in their pose alone")
    return here, then


def _carry(points: Floats, hits: Hits, here: Geometry, then: Geometry) -> Floats:
    """Points (m, 3) that keep their places on their triangles, where these are then."""
    before, after = _axes_on(here, hits), _axes_on(then, hits)
    along = np.linalg.solve(before[:, :, :3], (points - before[:, :, 3])[:, :, None])
    return np.asarray((after[:, :, :3] @ along)[:, :, 0] + after[:, :, 3])


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


def _seen(tables: ForwardRecord, points: Floats) -> Floats:
    """World points in the lens's axes; nan where they do not lie in front of it."""
    pose, placed = tables.camera.pose, tables.array.parts.lens_to_camera
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
        position = straight_to_sensor(tables, traced_by(entrance.bare, rays))
    else:
        through = ThroughArray(array_axes(tables.camera), array)
        centres = through.axes.local(lenses_at(array, lenses).axis)
        entering = aim_rays(entrance, Aim(entrance.bare, through.intersections), points, centres, start)
        rays = entrance.through(points, entering)
        position = through.sensor_points(centres, traced_by(entrance.bare, rays))
    half = 0.5 * np.array(tables.camera.sensor.size[::-1])
    with np.errstate(invalid="ignore"):
        lands = (np.abs(position) <= half).all(axis=1)
    return _Chief(position, entering, (traced_by(entrance.lens, rays).status == 0) & lands)
