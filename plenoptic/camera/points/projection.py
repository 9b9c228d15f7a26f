"""Projection of world points onto the sensor: into every microlens image that sees them."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.points.projection_rows import REPLICATES, Rows, lenses_with, rows_of
from plenoptic.camera.psf.histogram import centroids
from plenoptic.camera.psf.point_spread import world_points
from plenoptic.camera.psf.sensor_hits import ForwardRecord, forward_record, in_lens_axes
from plenoptic.core.parallel import thread_count
from plenoptic.core.progress.bar import CallProgress
from plenoptic.core.values import Floats, check_kind, result, whole

if TYPE_CHECKING:
    from plenoptic.scene.cache import PreparedScene
    from plenoptic.scene.scene import Scene


_CLEAR = 2.0**-12
"""What hides a point is farther from it than this part of its way to the lens: the surface that it lies on does not."""


@result
class Projection:
    """Projections of points onto the sensor, a row for each point and microlens; made by `project`.

    Attributes
    ----------
    points : (n, 3) array
        The points in the world in mm.
    point : (k,) array of int
        Which of them each row is about; rows are in the order of points and of lattice indices.
    index : (k, 2) array of int or None
        Lattice indices of the microlens; in FREE lattices (number, 0). None without microlenses, as the next one.
    type : (k,) array of int or None
        Type of the microlens: a row of the array's `focal_lengths`.
    position, pixel : (k, 2) array
        x and y on the sensor in mm, and row and column (whole numbers at the centres of pixels), of the chief ray: from
        the point through the microlens's optical centre; without microlenses, through the centre of the iris. nan where
        there is no such ray, as for a point whose image lies on the array beside that centre.
    centroid, centroid_pixel : (k, 2) array
        The same of the centroid of all light of the point that lands on the sensor through the microlens; nan where
        none does.
    centroid_error : (k, 2) array
        Standard error of `centroid` in mm; inf where it is not known.
    light : (k,) array
        Projected solid angle of that light at the point in sr, as in `point_spread`; nan for microlenses with the model
        PINHOLE.
    light_error : (k,) array
        Its standard error; inf where the chief ray shows that there is light but no other ray found it.
    passes : (k,) array of bool
        Whether the chief ray itself passes the lens: all its stops and rims.
    visible : (k,) array of bool
        Whether light of the point lands on the sensor through the microlens, be it the chief ray alone, and, where a
        scene is given, nothing hides the point.
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
        """The rows that a mask (k,) or an array of row numbers selects."""
        arrays = {name: array for name, array in vars(self).items() if name != "points" and array is not None}
        return dataclasses.replace(self, **{name: array[np.asarray(rows)] for name, array in arrays.items()})

    def __repr__(self) -> str:
        visible, points = int(np.count_nonzero(self.visible)), len(self.points)
        return f"Projection({points} point{'s' * (points != 1)}, {len(self)} rows, {visible} of them visible)"

    def _repr_html_(self) -> str:
        from plenoptic.plots.notebook.pictures import projection_html

        return projection_html(self)


def project(
    camera: PlenopticCamera,
    points: ArrayLike,
    *,
    scene: Scene | None = None,
    rays: int = 1 << 12,
    threads: int | None = None,
    progress: bool = True,
) -> Projection:
    """Find where points of the world appear on the sensor, in every microlens image that sees them.

    Parameters
    ----------
    camera : PlenopticCamera
    points : (3,) or (n, 3) array
        World positions in mm, in front of the lens.
    scene : Scene, optional
        Scene that can hide the points; None: nothing does. A surface nearer to a point than 1/4096 of its way to the
        lens, such as the surface that it lies on, does not hide it.
    rays : int, optional
        Rays of each point for `light` and `centroid`, rounded up to a multiple of 8. They do not change `position`.
    threads : int, optional
        None: one for each processor, at most NUMBA_NUM_THREADS. The result does not depend on it.
    progress : bool, optional
        Whether to show, from the second second on, how far it is or that something is compiled.

    Returns
    -------
    Projection
        A row for each microlens that gets light of the point, or that the chief ray reaches through all stops and rims;
        of the latter, those are left out that would show the point farther beside the sensor than a tenth of its size.

    Raises
    ------
    InvalidValueError
        Where a point is not finite or does not lie in front of the lens, or an argument is something else.

    Notes
    -----
    Chief rays are found by Newton's method, traced through the real lens: they pass their microlens's optical centre to
    within 1e-9 mm. In plates (SPHERICAL, FLAT_HIGH_INDEX) it is the ray through the vertex of the curved side, which
    leaves them parallel to itself. Deviations of single microlenses (`imperfections`) and places of parts count.

    Light is traced as in `point_spread`, with rays that are the same in every call. Light of less than a single ray,
    a part of 1 / rays of the light that the lens takes up, may go unnoticed at microlenses that the chief
    ray does not reach. With a scene, shadow rays run from the point towards the lens along the chief ray where it
    passes, otherwise along a ray that passes the lens and meets the array near the microlens.

    Everything is traced at the camera's `wavelength`. Dust, scratches and the response of pixels do not count.
    Light that passes beside the openings of an array with clear gaps counts to the cell that it passes.

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
    check_kind(camera, "camera", PlenopticCamera, "pl.PlenopticCamera(...)")
    positions, _ = world_points(points)
    each = -(-whole(rays, "rays", at_least=1) // REPLICATES)
    workers = thread_count(threads)
    with CallProgress("projecting", kind="camera", show=progress):
        tables = forward_record(camera)
        rows = rows_of(tables, in_lens_axes(tables, positions), each, workers)
        projection = _projection_of(tables, positions, rows)
        return projection if scene is None else _unhidden(tables, projection, rows.entering, scene)


def _projection_of(tables: ForwardRecord, given: Floats, rows: Rows) -> Projection:
    sensor, array = tables.camera.sensor, tables.camera.microlenses
    lenses = None if array is None or rows.lens is None else lenses_with(array, rows.lens)
    light = rows.moments[:, :, 0].mean(axis=1)
    light_error = rows.moments[:, :, 0].std(axis=1, ddof=1) / np.sqrt(REPLICATES)
    centroid, centroid_error = centroids(rows.moments)
    centroid[light == 0] = np.nan
    # All light in one replicate: the error is not known, and not small.
    centroid_error[~np.isfinite(centroid_error)] = np.inf
    with np.errstate(invalid="ignore"):
        lands = rows.passes & (np.abs(rows.position) <= 0.5 * np.array(sensor.size[::-1])).all(axis=1)
    if lenses is not None:
        lands &= lenses.transmission > 0
    if array is not None and not array.model.focuses:
        light, light_error = np.full((2, len(light)), np.nan)
        centroid = np.where(lands[:, None], rows.position, np.nan)
        centroid_error = np.where(lands[:, None], 0.0, np.inf)
    else:
        light_error[lands & (light == 0)] = np.inf
    return Projection(
        points=given,
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
        visible=lands | (light > 0),
    )


def _unhidden(tables: ForwardRecord, found: Projection, entering: Floats, scene: Scene) -> Projection:
    """Rows whose points are hidden from the place (k, 2) where their rays enter the lens are no longer visible."""
    from plenoptic.scene.cache import prepared_scene
    from plenoptic.scene.scene import Scene

    check_kind(scene, "scene", Scene, "pl.Scene(...)")
    rows, visible = np.flatnonzero(found.visible), found.visible.copy()
    points = found.points[found.point[rows]]
    visible[rows] = ~are_hidden(tables, points, entering[rows], prepared_scene(scene))
    return dataclasses.replace(found, visible=visible)


def are_hidden(tables: ForwardRecord, points: Floats, entering: Floats, prepared: PreparedScene) -> NDArray[np.bool_]:
    """(n,): whether something lies between world points (n, 3) and places (n, 2) of the plane where rays enter."""
    from plenoptic.scene.materials.alpha_mask import attenuate_shadows

    record, intersector = prepared.record, prepared.intersector
    if intersector is None:
        return np.zeros(len(points), dtype=bool)
    placed, pose = tables.array.parts.lens_to_camera, tables.camera.pose
    through = np.column_stack([entering, np.full(len(points), tables.entrance.z)])
    through = through if placed is None else placed.points(through)
    through = through if pose is None else pose.to_world(through)
    segments = through - points
    rays = np.ascontiguousarray(np.column_stack([points + _CLEAR * segments, (1.0 - _CLEAR) * segments]))
    blocked = np.zeros(len(points), dtype=np.uint8)
    left = np.ones((len(points), 1))
    if record.alpha is None:
        intersector.fill_blocked(blocked, rays)
    else:
        attenuate_shadows(record, intersector, rays, blocked, left)
    return np.asarray((blocked != 0) | (left[:, 0] <= 0.5))
