"""Projection of world points onto the sensor, through every microlens that images them."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.camera.points.projection_light import REPLICATES
from plenoptic.camera.points.projection_rows import Rows, lenses_at, trace_rows
from plenoptic.camera.psf.point_spread import world_points
from plenoptic.camera.psf.sensor_hits import ForwardRecord, forward_record
from plenoptic.core.display import picture_of
from plenoptic.core.parallel import thread_count
from plenoptic.core.progress.bar import CallProgress
from plenoptic.core.values import MAX_POINTS, Floats, check_has, check_kind, result, whole

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.scene.cache import PreparedScene
    from plenoptic.scene.scene import Scene


_MIN_OCCLUDER_DISTANCE = 2.0**-12
"""Least distance of an occluder from a point, over the distance to the lens: the point's own surface is closer."""


@result
class Projection:
    """Images of world points on the sensor, a row for each point and microlens. See `project`, which makes it.

    Attributes
    ----------
    points : (n, 3) array
        The points in the world in mm.
    point : (k,) array of int
        Point of each row; rows are in the order of points and of lattice indices.
    index : (k, 2) array of int or None
        Lattice indices of the microlens; in FREE lattices (number, 0). None without microlenses.
    type : (k,) array of int or None
        Type of the microlens: a row of the array's `focal_lengths`; None without microlenses.
    position, pixel : (k, 2) array
        Intersection of the chief ray with the sensor: x and y in mm, and row and column (whole numbers at the centres
        of pixels). The chief ray passes the microlens's optical centre; without microlenses, the centre of the iris.
        nan if there is none, as for a point whose image lies on the array off that centre.
    centroid, centroid_pixel : (k, 2) array
        Centroid of all light of the point that reaches the sensor through the microlens, in mm, and row and column; nan
        if none does.
    centroid_error : (k, 2) array
        Standard error of `centroid` in mm; inf if it is not known.
    light : (k,) array
        Projected solid angle of that light at the point in sr, as in `point_spread`; nan for microlenses with the model
        PINHOLE.
    light_error : (k,) array
        Its standard error; inf if the chief ray passes but no other ray does.
    passes : (k,) array of bool
        True if the chief ray passes all stops and rims of the lens.
    visible : (k,) array of bool
        True if light of the point reaches the sensor through the microlens, even the chief ray alone, and the point is
        not occluded by the scene.
    """

    points: Floats
    point: NDArray[np.int64]
    index: NDArray[np.int64] | None
    type: NDArray[np.int64] | None
    position: Floats
    pixel: Floats
    centroid: Floats
    centroid_pixel: Floats
    centroid_error: Floats
    light: Floats
    light_error: Floats
    passes: NDArray[np.bool_]
    visible: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.point)

    def selected(self, rows: ArrayLike) -> Projection:
        """Projection with the rows selected by a mask (k,) or an array of row numbers."""
        world = {name: array for name, array in vars(self).items() if name != "points" and array is not None}
        return dataclasses.replace(self, **{name: array[np.asarray(rows)] for name, array in world.items()})

    def __repr__(self) -> str:
        n_visible, points = int(np.count_nonzero(self.visible)), len(self.points)
        return f"Projection({points} point{'s' * (points != 1)}, {len(self)} rows, {n_visible} of them visible)"

    _repr_html_ = picture_of


def project(
    camera: PlenopticCamera,
    points: ArrayLike,
    *,
    scene: Scene | None = None,
    rays: int = 1 << 12,
    threads: int | None = None,
    progress: bool = True,
) -> Projection:
    """Project world points onto the sensor, through every microlens that images them.

    Parameters
    ----------
    camera : PlenopticCamera
    points : (3,) or (n, 3) array
        World positions in mm, in front of the lens.
    scene : Scene, optional
        Scene with occluders; None: no occlusion. Surfaces closer to a point than 1/4096 of its distance to the lens,
        such as the point's own surface, do not occlude it.
    rays : int, optional
        Rays per point for `light` and `centroid`, at most 2^24, rounded up to a multiple of 32. `position` does not
        depend on them.
    threads, progress : optional
        As for `render`. The result does not depend on them.

    Returns
    -------
    Projection
        A row for each microlens that receives light of the point, or an unvignetted chief ray. Chief rays farther
        outside the sensor than a tenth of its size are left out.

    Raises
    ------
    InvalidValueError
        If a point is not finite or not in front of the lens, or an argument has a wrong type.

    Notes
    -----
    Chief rays are traced through the real lens by Newton's method and pass their microlens's optical centre to within
    1e-9 mm. In plates (SPHERICAL, FLAT_HIGH_INDEX) the chief ray passes the vertex of the curved side and leaves the
    plate parallel to itself. Deviations of single microlenses (`imperfections`) and placements of parts are included.

    Light is traced as in `point_spread`, aimed at an outline of the pupil that points near each other share. Its random
    numbers follow from the coordinates of the point: rows of a point do not depend, beyond rounding, on the other
    points of the call. Light below that of a single ray, a fraction 1 / rays of the light through the lens, may be
    missed at microlenses that the chief ray does not reach. With a scene, shadow rays run from the point towards the
    lens along the chief ray if it passes, otherwise along a ray that passes the lens and hits the array near the
    microlens.

    Everything is traced at the camera's `wavelength`. Dust, scratches and the response of pixels are ignored. Light
    through clear gaps between openings belongs to the cell that it passes.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> camera = pl.camera.example_camera()
    >>> seen = pl.project(camera, (0.0, 0.0, -404.0))
    >>> seen
    Projection(1 point, 37 rows, 37 of them visible)
    >>> middle = seen.selected((seen.index == 0).all(axis=1))
    >>> middle.pixel.round(6).tolist(), bool(np.abs(middle.centroid_pixel - middle.pixel).max() < 1e-3)
    ([[255.5, 255.5]], True)
    """
    check_has(camera, "camera", "PlenopticCamera", "pl.PlenopticCamera(...)", "lens", "sensor")
    world, _ = world_points(points)
    rays_per_replicate = -(-whole(rays, "rays", at_least=1, at_most=MAX_POINTS) // REPLICATES)
    workers = thread_count(threads)
    with CallProgress("projecting", kind="camera", show=progress):
        record = forward_record(camera)
        rows = trace_rows(record, world, rays_per_replicate, workers)
        projection = _to_projection(record, world, rows)
        return projection if scene is None else _keep_visible(record, projection, rows.entering, scene)


def _to_projection(record: ForwardRecord, world: Floats, rows: Rows) -> Projection:
    sensor, array = record.camera.sensor, record.camera.microlenses
    lenses = None if array is None or rows.lens is None else lenses_at(array, rows.lens)
    light, light_error, centroid, centroid_error = rows.light, rows.light_error, rows.centroid, rows.centroid_error
    centroid[light == 0] = np.nan
    # With all light in one replicate the error is unknown, and not small.
    centroid_error[~np.isfinite(centroid_error)] = np.inf
    with np.errstate(invalid="ignore"):
        is_imaged = rows.passes & (np.abs(rows.position) <= 0.5 * np.array(sensor.size[::-1])).all(axis=1)
    if lenses is not None:
        is_imaged &= lenses.transmission > 0
    if array is not None and not array.model.focuses:
        light, light_error = np.full((2, len(light)), np.nan)
        centroid = np.where(is_imaged[:, None], rows.position, np.nan)
        centroid_error = np.where(is_imaged[:, None], 0.0, np.inf)
    else:
        light_error[is_imaged & (light == 0)] = np.inf
    return Projection(
        points=world,
        point=rows.point,
        index=rows.lens,
        type=None if lenses is None else lenses.type,
        position=rows.position,
        pixel=sensor.pixel_of(rows.position),
        centroid=centroid,
        centroid_pixel=sensor.pixel_of(centroid),
        centroid_error=centroid_error,
        light=light,
        light_error=light_error,
        passes=rows.passes,
        visible=is_imaged | (light > 0),
    )


def _keep_visible(record: ForwardRecord, projection: Projection, entering: Floats, scene: Scene) -> Projection:
    """Set `visible` to False for points occluded on the way to the entry points (k, 2) of their rays into the lens."""
    from plenoptic.scene.cache import prepared_scene
    from plenoptic.scene.scene import Scene

    check_kind(scene, "scene", Scene, "pl.Scene(...)")
    rows, visible = np.flatnonzero(projection.visible), projection.visible.copy()
    points = projection.points[projection.point[rows]]
    visible[rows] = transmission_to_lens(record, points, entering[rows], prepared_scene(scene)) > 0.5
    return dataclasses.replace(projection, visible=visible)


def entrance_in_world(record: ForwardRecord, entering: Floats) -> Floats:
    """World points (n, 3) of points (n, 2) of the entrance plane."""
    lens_pose, pose = record.parts.lens_to_camera, record.camera.pose
    points = np.column_stack([entering, np.full(len(entering), record.entrance.z)])
    points = points if lens_pose is None else lens_pose.points(points)
    return np.asarray(points if pose is None else pose.to_world(points))


def transmission_to_lens(record: ForwardRecord, points: Floats, entering: Floats, prepared: PreparedScene) -> Floats:
    """Fractions (n,) of light that surfaces of a scene pass from world points (n, 3) to points (n, 2) of the entrance
    plane: 0 behind an opaque one.
    """
    from plenoptic.scene.materials.alpha_mask import attenuate_shadows

    scene_record, intersector = prepared.record, prepared.intersector
    transmission = np.ones((len(points), 1))
    if intersector is None:
        return transmission[:, 0]
    segment = entrance_in_world(record, entering) - points
    start = points + _MIN_OCCLUDER_DISTANCE * segment
    rays = np.ascontiguousarray(np.column_stack([start, (1.0 - _MIN_OCCLUDER_DISTANCE) * segment]))
    blocked = np.zeros(len(points), dtype=np.uint8)
    if scene_record.alpha is None:
        intersector.fill_occlusion(blocked, rays)
    else:
        attenuate_shadows(scene_record, intersector, rays, blocked, transmission)
    transmission[blocked != 0] = 0.0
    return transmission[:, 0]
