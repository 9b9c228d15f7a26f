"""Finding the ground truth: what the main rays of pixels meet, and where its image lies."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.checks import check_scene_and_camera, sensor_region
from plenoptic.camera.record import CameraTables, camera_tables
from plenoptic.camera.sampling.pixel_regions import cells_per_pixel, pixel_centres
from plenoptic.core.parallel import run_in_order, thread_count
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.record import LensRecord, lens_record
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.microlens.listed import lattice_types
from plenoptic.scene.cache import prepared_scene
from plenoptic.scene.compile import SceneRecord
from plenoptic.scene.geometry.accel import Intersector
from plenoptic.scene.geometry.record import Hits
from plenoptic.scene.materials.alpha_mask import no_hits, pass_through
from plenoptic.scene.scene import Scene
from plenoptic.truth.ground_truth import OF_IMAGES, GroundTruth, Truth, available_truth, checked_truth, empty_truth
from plenoptic.truth.representative_ray import MainRays, main_rays

__all__ = ["ground_truth"]

_PIXELS = 512
"""Pixels that go through the stages together."""
_STRIP = 1 << 13
"""Pixels that one thread takes at a time."""
_TURN = 1e-5
"""How much the slopes of neighbouring rays differ, and how far apart they are over the distance of the lens: errors are
of the order of its square, 1e-10, and of the rounding of coordinates over it."""

Arrays = dict[str, NDArray[Any]]


class TruthTables(NamedTuple):
    """What finding the truth needs beside camera and scene."""

    wanted: Truth
    frame: NDArray[np.float64] | None
    """(12,) from the lens's axes to the camera's; None where they are the same."""
    bare: LensRecord | None
    """The lens in reverse without stops and rims; None where images of points are not wanted."""
    axes: NDArray[np.float64]
    """(4, 3): x, y, normal and centre of the array's front principal plane, in the lens's axes."""
    step: float
    """How far aside neighbouring rays start, in mm."""
    numbers: NDArray[np.int64] | None
    """FREE lattices: numbers of the listed lenses, row by row."""


def truth_tables(camera: PlenopticCamera, tables: CameraTables, wanted: Truth) -> TruthTables | None:
    """Compile what is wanted; None where it is nothing."""
    if not wanted:
        return None
    parts = tables.parts
    moved = parts.lens_to_camera
    axes = np.concatenate([np.eye(3), [[0.0, 0.0, tables.z_plane]]])
    if tables.frame is not None:
        axes = np.concatenate([tables.frame[:9].reshape(3, 3).T, tables.frame[None, 9:]])
    array = camera.microlenses
    free = array is not None and array.lattice is Lattice.FREE and wanted & Truth.MICROLENS
    return TruthTables(
        wanted=wanted,
        frame=None if moved is None else np.concatenate([moved.turn.ravel(), moved.shift]),
        bare=lens_record(camera.lens, camera.wavelength, reverse=True, clipping=False) if wanted & OF_IMAGES else None,
        axes=np.ascontiguousarray(axes),
        step=_TURN * abs(parts.z_plane - float(camera.lens.vertices[-1])),
        numbers=_free_numbers(tables) if free else None,
    )


def _free_numbers(tables: CameraTables) -> NDArray[np.int64]:
    """Numbers of the lenses of a FREE array that are listed: those up to some distance along x and y, in order."""
    assert tables.array is not None and tables.array.centres is not None
    assert tables.cells is not None and tables.cells.listed is not None
    farther = np.abs(np.asarray(tables.array.centres)).max(axis=1)
    return np.sort(np.argsort(farther, kind="stable")[: len(tables.cells.listed.lenses)])


def truth_of(
    tables: CameraTables,
    scene: SceneRecord | None,
    intersector: Intersector | None,
    truth: TruthTables,
    pixels: NDArray[np.float64],
) -> Arrays:
    """Ground truth of pixels with local centres (n, 2), as arrays (n, ...) by the names of `GroundTruth`."""
    found = empty_truth(truth.wanted, (len(pixels),))
    for start in range(0, len(pixels), _PIXELS):
        part = slice(start, start + _PIXELS)
        into = {name: array[part] for name, array in found.items()}
        main = main_rays(tables, pixels[part])
        if truth.wanted & Truth.MICROLENS:
            _fill_microlenses(into, tables, truth, main.cells)
        if scene is not None and intersector is not None and truth.wanted & ~Truth.MICROLENS:
            _fill_hits(into, tables, scene, intersector, truth, main, pixels[part])
    return found


def _fill_microlenses(
    into: Mapping[str, NDArray[Any]], tables: CameraTables, truth: TruthTables, cells: NDArray[np.float64]
) -> None:
    array, compiled = tables.array, tables.cells
    assert array is not None and compiled is not None
    lit = np.isfinite(cells[:, 0])
    if truth.numbers is None:
        index = np.rint((cells[lit, :2] - compiled.origin) @ compiled.inverse).astype(np.int64)
        types = lattice_types(array, index)
    else:
        number = truth.numbers[cells[lit, 2].astype(np.int64)]
        index = np.stack([number, np.zeros_like(number)], axis=1)
        types = np.zeros(len(number), np.int64) if array.types is None else np.asarray(array.types)[number]
    into["microlens"][lit] = index
    into["microlens_type"][lit] = types


def _fill_hits(
    into: Mapping[str, NDArray[Any]],
    tables: CameraTables,
    scene: SceneRecord,
    intersector: Intersector,
    truth: TruthTables,
    main: MainRays,
    pixels: NDArray[np.float64],
) -> None:
    from plenoptic.camera.sampling.kernels import paths
    from plenoptic.scene.geometry.kernels import interaction
    from plenoptic.truth.kernels import representative_ray

    geometry = scene.geometry
    assert scene.triangle_mesh is not None and geometry is not None
    n = len(pixels)
    rays, lane_of, points = np.empty((n, 6)), np.empty(n, dtype=np.int64), np.empty((n, 3))
    sent = paths.fill_world_rays(rays, lane_of, main.blocks, n, tables.rotation, tables.position)
    rays, lane_of = rays[:sent], lane_of[:sent]
    hits, reached = no_hits(scene, sent), np.empty(sent)
    intersector.fill_closest(hits, rays, coherent=True)
    if scene.alpha is not None:
        pass_through(scene, intersector, rays, hits)
    interaction.fill_distances(reached, hits, rays, geometry)
    if hits.travelled is not None:
        reached += hits.travelled
    representative_ray.fill_points(
        into.get("depth"),
        into.get("distance"),
        into.get("position"),
        points,
        main.blocks,
        lane_of,
        reached,
        truth.frame,
        tables.rotation,
        tables.position,
    )
    met = np.isfinite(reached)
    lanes, triangle = lane_of[met], hits.triangle[met]
    if "normal" in into:
        met_hits = Hits(triangle, None if hits.instance is None else hits.instance[met], None)
        interaction.fill_normals(into["normal"], lanes, met_hits, rays[met], geometry)
    if "object" in into:
        into["object"][lanes] = scene.triangle_mesh[triangle]
    if "material" in into:
        into["material"][lanes] = geometry.triangle_material[triangle]
    if truth.bare is not None:
        _fill_images(into, tables, truth, truth.bare, main, points, lanes, pixels)


def _fill_images(
    into: Mapping[str, NDArray[Any]],
    tables: CameraTables,
    truth: TruthTables,
    bare: LensRecord,
    main: MainRays,
    points: NDArray[np.float64],
    lanes: NDArray[np.int64],
    pixels: NDArray[np.float64],
) -> None:
    from plenoptic.core.kernels.ray_blocks import BLOCK, RAY
    from plenoptic.optics.lens.kernels.trace import fill_traced
    from plenoptic.truth.kernels import virtual_depth as virtual_depth_kernels

    assert tables.array is not None
    blocks = np.empty(-(-len(lanes) * virtual_depth_kernels.NEIGHBOURS // BLOCK) * RAY)
    virtual_depth_kernels.fill_neighbours(blocks, main.before, lanes, truth.axes, truth.step, _TURN)
    fill_traced(blocks, bare, None)
    distance = np.full(len(pixels), np.nan)
    virtual_depth_kernels.fill_image_distances(distance, blocks, main.blocks, points, lanes, truth.step, _TURN)
    behind = np.full(len(pixels), tables.distance) if tables.lean is None else tables.distance + pixels @ tables.lean
    virtual = distance / behind
    if "virtual_depth" in into:
        into["virtual_depth"][:] = virtual
    if "disparity" in into:
        with np.errstate(divide="ignore"):
            into["disparity"][:] = min(tables.array.pitches) / tables.pitch / virtual


def ground_truth(
    scene: Scene | None,
    camera: PlenopticCamera,
    *,
    truth: Truth = Truth.ALL,
    region: tuple[slice, slice] | None = None,
    threads: int | None = None,
) -> GroundTruth:
    """Find what the pixels of a raw image show, without rendering it; the same bits as those of `render`.

    Parameters
    ----------
    scene : Scene or None
        None, or a scene without meshes and lights: only the microlenses of pixels are found.
    camera : PlenopticCamera
    truth : Truth, optional
        What is wanted. What there cannot be, such as the virtual depth of a camera without microlenses, is left out.
    region : (slice, slice), optional
        Rows and columns of the sensor, such as ``np.s_[256:384, 192:320]``; the same bits as in the whole image.
    threads : int, optional
        None: one for each processor. The result does not depend on it.

    Returns
    -------
    GroundTruth

    Raises
    ------
    InvalidValueError
        Where an argument is impossible, or nothing of what is wanted can be had.

    Notes
    -----
    The triangle is found in float32; everything else is computed in float64 from the float64 vertices. The camera is
    traced at its `wavelength`, also where it has a sensitivity.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> camera = pl.PlenopticCamera(
    ...     lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=5.0)),
    ...     microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    ...     sensor=pl.Sensor(shape=(512, 512), pixel_pitch=0.01),
    ...     stop_to_microlenses=123.3, microlenses_to_sensor=1.7)
    >>> truth = pl.ground_truth(pl.white_plane(), camera, region=np.s_[256:257, 256:257])
    >>> truth.depth.round(9).tolist(), truth.microlens.tolist()
    ([[404.0]], [[[0, 0]]])
    >>> f"{truth.virtual_depth[0, 0]:.2f}, {truth.disparity[0, 0]:.3f} pixels"
    '6.66, 3.258 pixels'
    """
    check_scene_and_camera(scene, camera)
    first_row, end_row, first_column, end_column = sensor_region(camera.sensor.shape, region)
    workers = thread_count(threads)
    prepared = None if scene is None else prepared_scene(scene)
    meshes = prepared is not None and prepared.record.geometry is not None
    wanted = available_truth(checked_truth(truth), meshes=meshes, microlenses=camera.microlenses is not None)
    tables = camera_tables(camera)
    cells_per_pixel(tables)
    finding = truth_tables(camera, tables, wanted)
    if finding is None:
        raise InvalidValueError(
            f"nothing of {truth!r} can be found: the scene has {'' if meshes else 'no '}meshes and the camera "
            f"{'' if camera.microlenses is not None else 'no '}microlenses; MICROLENS, VIRTUAL_DEPTH and DISPARITY "
            "need microlenses, all but MICROLENS need meshes"
        )
    surfaces = intersector = None
    if prepared is not None and wanted & ~Truth.MICROLENS:
        surfaces, intersector = prepared.record, prepared.intersector
    rows = max(1, _STRIP // (end_column - first_column))

    def work(row: int) -> Arrays:
        pixels = pixel_centres(tables, (row, min(row + rows, end_row)), (first_column, end_column))
        return truth_of(tables, surfaces, intersector, finding, pixels)

    strips = list(run_in_order(work, range(first_row, end_row, rows), threads=workers))
    shape = (end_row - first_row, end_column - first_column)
    return GroundTruth(
        **{
            name: np.concatenate([strip[name] for strip in strips]).reshape(*shape, *part.shape[1:])
            for name, part in strips[0].items()
        }
    )
