"""Computation of ground truth: each requested channel is filled from the stage that it reads."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import array_axes
from plenoptic.camera.cache import prepared_camera
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.camera_record import CameraRecord
from plenoptic.camera.checks import check_scene_and_camera, sensor_region
from plenoptic.camera.sampling.aperture_regions import cells_per_pixel, illuminated_pixels, pixel_centres
from plenoptic.core.engines.choice import cluster_of
from plenoptic.core.engines.engine import Engine, ThreadEngine
from plenoptic.core.parallel import thread_count
from plenoptic.core.progress.bar import CallProgress
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.lens_record import lens_record
from plenoptic.truth.channels import CHANNELS, GroundTruth, Needs, Truth, channels_of
from plenoptic.truth.chord_disparity import chord_record
from plenoptic.truth.representative_rays import RepresentativeRays, representative_rays
from plenoptic.truth.truth_arrays import available_truth, empty_truth, flags_needing, valid_truth
from plenoptic.truth.truth_stages import SLOPE_STEP, PixelStages, TruthRecord, lens_numbers

if TYPE_CHECKING:
    import distributed

    from plenoptic.core.engines.dask_engine import DaskCluster
    from plenoptic.scene.geometry.accel import Intersector
    from plenoptic.scene.scene import Scene
    from plenoptic.scene.scene_record import SceneRecord

_STRIP = 1 << 13
"""Pixels of a strip, the unit of work of one thread."""
Arrays = dict[str, NDArray[Any]]
_PIXEL_CHANNELS = Truth.MICROLENS | Truth.OBJECT_SHARE | Truth.CHORD_DISPARITY
"""Channels that are defined for pixels only."""


def truth_record(camera: PlenopticCamera, record: CameraRecord, requested: Truth) -> TruthRecord | None:
    """Compile the parameters of the requested channels; None if there are none."""
    if not requested:
        return None
    parts = record.parts
    lens_pose = parts.lens_to_camera
    axes = np.concatenate([np.eye(3), [[0.0, 0.0, record.parts.z_plane]]])
    if record.frame is not None:
        axes = np.concatenate([record.frame[:9].reshape(3, 3).T, record.frame[None, 9:]])
    images = requested & (Truth.VIRTUAL_DEPTH | Truth.DISPARITY)
    return TruthRecord(
        requested=requested,
        frame=None if lens_pose is None else np.concatenate([lens_pose.turn.ravel(), lens_pose.shift]),
        unvignetted=lens_record(camera.lens, camera.wavelength, reverse=True, clipping=False) if images else None,
        axes=np.ascontiguousarray(axes),
        step=SLOPE_STEP * abs(parts.z_plane - float(camera.lens.vertices[-1])),
        front_index=float(camera.lens.indices(camera.wavelength)[0]),
        numbers=lens_numbers(record),
        chords=chord_record(camera) if requested & Truth.CHORD_DISPARITY else None,
    )


def compute_truth(
    record: CameraRecord,
    scene: SceneRecord | None,
    intersector: Intersector | None,
    truth: TruthRecord,
    pixels: Floats,
    rays: RepresentativeRays,
) -> Arrays:
    """Compute the ground truth of pixels with local centres (n, 2) from their representative rays.

    Returns arrays (n, ...) by the names of `GroundTruth`.
    """
    arrays = empty_truth(truth.requested, (len(pixels),))
    stages = PixelStages(record, scene, intersector, truth, pixels, rays)
    for name, array in arrays.items():
        getattr(stages, f"fill_{name}")(array)
    return arrays


def ground_truth(
    scene: Scene | None,
    camera: PlenopticCamera,
    *,
    truth: Truth = Truth.ALL,
    region: tuple[slice, slice] | None = None,
    threads: int | None = None,
    client: distributed.Client | None = None,
    progress: bool = True,
) -> GroundTruth:
    """Compute the ground truth of a raw image without rendering it; bit-identical to that of `render`.

    Parameters
    ----------
    scene : Scene or None
        None, or a scene without meshes and lights: only the microlenses of pixels are computed.
    camera : PlenopticCamera
    truth : Truth, optional
        Requested channels. Unavailable ones, such as the virtual depth of a camera without microlenses, are left out.
    region : (slice, slice), optional
        Rows and columns of the sensor, such as ``np.s_[256:384, 192:320]``; bit-identical to the whole image.
    threads, client, progress : optional
        As for `render`. The result does not depend on them.

    Returns
    -------
    GroundTruth

    Raises
    ------
    InvalidValueError
        If an argument is impossible, or no requested channel is available.

    Notes
    -----
    The triangle is intersected in float32; everything else is computed in float64 from the float64 vertices. The camera
    is traced at its `wavelength`, even with a sensitivity.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> camera = pl.camera.example_camera()
    >>> truth = pl.ground_truth(pl.shapes.white_plane(), camera, region=np.s_[256:257, 256:257])
    >>> truth.depth.round(9).tolist(), truth.microlens.tolist()
    ([[404.0]], [[[0, 0]]])
    >>> f"{truth.virtual_depth[0, 0]:.2f}, {truth.disparity[0, 0]:.3f} pixels"
    '6.66, 3.258 pixels'
    """
    check_scene_and_camera(scene, camera)
    bounds = sensor_region(camera.sensor.shape, region)
    workers, requested_truth, cluster = thread_count(threads), valid_truth(truth), cluster_of(client, threads)
    with CallProgress("ground truth", kind="scene", show=progress):
        return _ground_truth(scene, camera, requested_truth, bounds, workers, cluster)


def _ground_truth(
    scene: Scene | None,
    camera: PlenopticCamera,
    truth: Truth,
    region: tuple[int, int, int, int],
    workers: int,
    cluster: DaskCluster | None,
) -> GroundTruth:
    meshes = _has_meshes(scene)
    requested = available_truth(truth, meshes=meshes, microlenses=camera.microlenses is not None)
    if not requested:
        raise InvalidValueError(
            f"nothing of {truth!r} can be found: the scene has {'' if meshes else 'no '}meshes and the camera "
            f"{'' if camera.microlenses is not None else 'no '}microlenses; {flags_needing(Needs.MICROLENSES)} need "
            f"microlenses, {flags_needing(Needs.MESHES)} need meshes"
        )
    job = scene, camera, requested
    engine: Engine[Strip, Arrays]
    with contextlib.ExitStack() as stack:
        if cluster is None:
            compute = strip_worker(job)
            engine = ThreadEngine(lambda strip, _: compute(strip), workers)
        else:
            engine = stack.enter_context(cluster.engine(compiled_strip_worker, job))
        return GroundTruth(**_assemble_region(engine, region))


def compute_in_strips(
    record: CameraRecord,
    region: tuple[int, int, int, int],
    threads: int,
    compute_strip: Callable[[Floats, RepresentativeRays], Arrays],
) -> Arrays:
    """Compute arrays (rows, columns, ...) of a region in strips, from local pixel centres and representative rays."""
    return _assemble_region(
        ThreadEngine(lambda strip, _: _compute_strip(record, strip, compute_strip), threads), region
    )


def _assemble_region(engine: Engine[Strip, Arrays], region: tuple[int, int, int, int]) -> Arrays:
    """Compute the strips of a region and concatenate their arrays (rows, columns, ...)."""
    first_row, end_row, first_column, end_column = region
    rows = max(1, _STRIP // (end_column - first_column))
    strips = [Strip(row, min(row + rows, end_row), first_column, end_column) for row in range(first_row, end_row, rows)]
    strip_results = {
        outcome.job: outcome.result
        for outcome in engine.results(strips, n_jobs=len(strips), is_cancelled=lambda: False)
    }
    shape = (end_row - first_row, end_column - first_column)
    parts = [strip_results[strip] for strip in strips]
    arrays = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    return {name: array.reshape(*shape, *array.shape[1:]) for name, array in arrays.items()}


def _compute_strip(
    record: CameraRecord, strip: Strip, compute_strip: Callable[[Floats, RepresentativeRays], Arrays]
) -> Arrays:
    pixels = pixel_centres(record, (strip.row, strip.end_row), (strip.column, strip.end_column))
    illuminated = illuminated_pixels(record._replace(deflection=None), pixels, np.arange(len(pixels)))
    return compute_strip(pixels, representative_rays(record, pixels, illuminated))


class Strip(NamedTuple):
    """Strip of a region: first and end row, first and end column."""

    row: int
    end_row: int
    column: int
    end_column: int

    @property
    def size(self) -> int:
        """Number of pixels."""
        return (self.end_row - self.row) * (self.end_column - self.column)

    @property
    def nbytes(self) -> int:
        """Upper bound on the size of its ground truth in bytes."""
        return 8 * 2 * len(CHANNELS) * self.size


def strip_worker(job: tuple[Scene | None, PlenopticCamera, Truth]) -> Callable[[Strip], Arrays]:
    """Function that computes the ground truth of strips, for a scene, a camera and channels."""
    scene, camera, requested = job
    record, surfaces, intersector = prepared_camera(camera).record, None, None
    cells_per_pixel(record)
    truth_parameters = truth_record(camera, record, requested)
    assert truth_parameters is not None
    needs_meshes = any(channel.needs & Needs.MESHES for channel in channels_of(requested).values())
    if (needs_meshes or requested & Truth.STATE) and _has_meshes(scene):
        from plenoptic.scene.cache import prepared_scene

        assert scene is not None
        prepared = prepared_scene(scene)
        surfaces, intersector = prepared.record, prepared.intersector

    def compute_strip(pixels: Floats, rays: RepresentativeRays) -> Arrays:
        return compute_truth(record, surfaces, intersector, truth_parameters, pixels, rays)

    return lambda strip: _compute_strip(record, strip, compute_strip)


def compiled_strip_worker(job: tuple[Scene | None, PlenopticCamera, Truth], threads: int) -> Callable[[Strip], Arrays]:
    """`strip_worker` for another process, compiled in parallel with so many processes."""
    from plenoptic.core.numba.parallel_compilation import compile_in_parallel

    compute, empty = strip_worker(job), Strip(0, 0, 0, 0)
    with compile_in_parallel(lambda: compute(empty), threads=threads):
        compute(empty)
    return compute


def _has_meshes(scene: Scene | None) -> bool:
    if scene is None:
        return False
    from plenoptic.scene.cache import prepared_scene

    return prepared_scene(scene).record.geometry is not None


def truth_along(
    scene: Scene, camera: PlenopticCamera, on_sensor: Floats, on_array: Floats, *, truth: Truth
) -> GroundTruth:
    """Compute the ground truth along rays from the sensor that pass the array undeviated.

    Points are (rows, columns, 2): x and y on the sensor and on the array, each in its own axes, mm; nan for no ray.
    """
    from plenoptic.scene.cache import prepared_scene

    check_scene_and_camera(scene, camera)
    prepared, record = prepared_scene(scene), prepared_camera(camera).record
    meshes = prepared.record.geometry is not None
    requested = available_truth(valid_truth(truth), meshes=meshes, microlenses=True) & ~_PIXEL_CHANNELS
    truth_parameters = truth_record(camera, record, requested)
    if truth_parameters is None:
        raise InvalidValueError(
            f"nothing of {truth!r} can be found along rays of a view: they have no microlens, and the scene has "
            f"{'' if meshes else 'no '}meshes"
        )
    shape = on_sensor.shape[:2]
    rays = _straight_rays(camera, record, on_sensor.reshape(-1, 2), on_array.reshape(-1, 2))
    intersector = prepared.intersector if meshes else None
    arrays = compute_truth(record, prepared.record, intersector, truth_parameters, rays.starts, rays)
    return GroundTruth(**{name: array.reshape(*shape, *array.shape[1:]) for name, array in arrays.items()})


def _straight_rays(
    camera: PlenopticCamera, record: CameraRecord, on_sensor: Floats, on_array: Floats
) -> RepresentativeRays:
    """Trace undeviated rays from sensor points through array points, as representative rays."""
    from plenoptic.core.kernels.ray_blocks import BLOCK
    from plenoptic.optics.lens.kernels.trace import fill_through_lens

    axes, n = array_axes(camera), len(on_sensor)
    is_valid = np.isfinite(on_sensor).all(axis=1) & np.isfinite(on_array).all(axis=1)
    starts = axes.parts.sensor_to_local.points(np.column_stack([on_sensor, np.zeros(n)]))
    aims = axes.local(on_array)
    directions = np.column_stack([aims - starts[:, :2], -starts[:, 2]])
    fields = np.zeros((-(-n // BLOCK) * BLOCK, 8))
    fields[:n, :3] = axes.in_lens(aims)
    turned = axes.parts.local_to_lens.directions(directions)
    fields[:n, 3:6] = turned / np.linalg.norm(turned, axis=1, keepdims=True)
    fields[:n, 6] = 1.0
    fields[:n][~is_valid] = fields[n:] = 0.0
    fields[:, 7] = 1.0
    fields[:n, 7] = ~is_valid
    before = np.ascontiguousarray(fields.reshape(-1, BLOCK, 8).swapaxes(1, 2)).reshape(-1)
    blocks = before.copy()
    fill_through_lens(blocks, record.lens, None)
    cells = np.full((n, 3), np.nan)
    return RepresentativeRays(np.ascontiguousarray(starts[:, :2]), before, blocks, aims, cells, np.zeros(n, dtype=bool))
