"""Finding the ground truth: each channel that is wanted is filled from the stage that it reads."""

from __future__ import annotations

import contextlib
import importlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.cache import prepared_camera
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.checks import check_scene_and_camera, sensor_region
from plenoptic.camera.record import CameraRecord
from plenoptic.camera.sampling.pixel_regions import cells_per_pixel, fed_pixels, pixel_centres
from plenoptic.core.engines.choice import cluster_of
from plenoptic.core.engines.engine import Engine, ThreadEngine
from plenoptic.core.parallel import thread_count
from plenoptic.core.progress.bar import CallProgress
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.record import lens_record
from plenoptic.truth.arrays import available_truth, checked_truth, empty_truth, what_needs
from plenoptic.truth.channels import CHANNELS, GroundTruth, Needs, Truth, channels_of
from plenoptic.truth.chords import chord_record
from plenoptic.truth.lookups import listed_numbers
from plenoptic.truth.representative_rays import PixelRays, representative_rays
from plenoptic.truth.stages import SLOPE_STEP, PixelStages, TruthRecord

if TYPE_CHECKING:
    import distributed

    from plenoptic.core.engines.dask_engine import DaskCluster
    from plenoptic.scene.compile import SceneRecord
    from plenoptic.scene.geometry.accel import Intersector
    from plenoptic.scene.scene import Scene

_STRIP = 1 << 13
"""Pixels that one thread takes at a time."""

Arrays = dict[str, NDArray[Any]]


def truth_record(camera: PlenopticCamera, record: CameraRecord, wanted: Truth) -> TruthRecord | None:
    """Compile the requested channels; None where there are none."""
    if not wanted:
        return None
    parts = record.parts
    moved = parts.lens_to_camera
    axes = np.concatenate([np.eye(3), [[0.0, 0.0, record.z_plane]]])
    if record.frame is not None:
        axes = np.concatenate([record.frame[:9].reshape(3, 3).T, record.frame[None, 9:]])
    images = any(channel.source.stage == "images" for channel in channels_of(wanted).values())
    return TruthRecord(
        wanted=wanted,
        frame=None if moved is None else np.concatenate([moved.turn.ravel(), moved.shift]),
        unvignetted=lens_record(camera.lens, camera.wavelength, reverse=True, clipping=False) if images else None,
        axes=np.ascontiguousarray(axes),
        step=SLOPE_STEP * abs(parts.z_plane - float(camera.lens.vertices[-1])),
        numbers=listed_numbers(record),
        chords=chord_record(camera) if wanted & Truth.CHORD_DISPARITY else None,
    )


def truth_of(
    record: CameraRecord,
    scene: SceneRecord | None,
    intersector: Intersector | None,
    truth: TruthRecord,
    pixels: Floats,
    rays: PixelRays,
) -> Arrays:
    """Ground truth of pixels with local centres (n, 2), for which rays stand: arrays (n, ...) by the names of
    `GroundTruth`.
    """
    arrays = empty_truth(truth.wanted, (len(pixels),))
    stages = PixelStages(record, scene, intersector, truth, pixels, rays)
    for name, array in arrays.items():
        fill, stage = filling(name)
        fill(array, getattr(stages, stage))
    return arrays


def filling(name: str) -> tuple[Callable[[NDArray[Any], Any], None], str]:
    """The function that fills a channel, and the stage that it reads; kernels are loaded here."""
    source = CHANNELS[name].source
    module = importlib.import_module(f"plenoptic.truth.{source.filled_in}")
    return getattr(module, f"fill_{name}"), source.stage


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
    """Find the ground truth of a raw image's pixels, without rendering it; the same bits as those of `render`.

    Parameters
    ----------
    scene : Scene or None
        None, or a scene without meshes and lights: only the microlenses of pixels are found.
    camera : PlenopticCamera
    truth : Truth, optional
        Requested channels. Impossible ones, such as the virtual depth of a camera without microlenses, are left out.
    region : (slice, slice), optional
        Rows and columns of the sensor, such as ``np.s_[256:384, 192:320]``; the same bits as in the whole image.
    threads : int, optional
        None: one for each processor, at most NUMBA_NUM_THREADS. The result does not depend on it.
    client : distributed.Client, optional
        Of a dask cluster whose workers are to find it, as for `render`.
    progress : bool, optional
        Whether to show, from the second second on, how far it is or that something is compiled.

    Returns
    -------
    GroundTruth

    Raises
    ------
    InvalidValueError
        Where an argument is impossible, or none of the requested channels exists.

    Notes
    -----
    The triangle is found in float32; everything else is computed in float64 from the float64 vertices. The camera is
    traced at its `wavelength`, also where it has a sensitivity.

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
    workers, asked, cluster = thread_count(threads), checked_truth(truth), cluster_of(client, threads)
    with CallProgress("ground truth", kind="scene", show=progress):
        return _ground_truth(scene, camera, asked, bounds, workers, cluster)


def _ground_truth(
    scene: Scene | None,
    camera: PlenopticCamera,
    truth: Truth,
    region: tuple[int, int, int, int],
    workers: int,
    cluster: DaskCluster | None,
) -> GroundTruth:
    meshes = _has_meshes(scene)
    channels = available_truth(truth, meshes=meshes, microlenses=camera.microlenses is not None)
    if not channels:
        raise InvalidValueError(
            f"nothing of {truth!r} can be found: the scene has {'' if meshes else 'no '}meshes and the camera "
            f"{'' if camera.microlenses is not None else 'no '}microlenses; {what_needs(Needs.MICROLENSES)} need "
            f"microlenses, {what_needs(Needs.MESHES)} need meshes"
        )
    job = scene, camera, channels
    engine: Engine[Strip, Arrays]
    with contextlib.ExitStack() as stack:
        if cluster is None:
            find = strip_finder(job)
            engine = ThreadEngine(lambda strip, _: find(strip), workers)
        else:
            engine = stack.enter_context(cluster.engine(compiled_strip_finder, job))
        return GroundTruth(**_put_together(engine, region))


def in_strips(
    record: CameraRecord, region: tuple[int, int, int, int], threads: int, work: Callable[[Floats, PixelRays], Arrays]
) -> Arrays:
    """Arrays (rows, columns, ...) of a region, made in strips from local centres of pixels and the rays for them."""
    return _put_together(ThreadEngine(lambda strip, _: _of_strip(record, strip, work), threads), region)


def _put_together(engine: Engine[Strip, Arrays], region: tuple[int, int, int, int]) -> Arrays:
    """Arrays (rows, columns, ...) of a region from those of its strips."""
    first_row, end_row, first_column, end_column = region
    rows = max(1, _STRIP // (end_column - first_column))
    strips = [Strip(row, min(row + rows, end_row), first_column, end_column) for row in range(first_row, end_row, rows)]
    by_strip = {one.order: one.result for one in engine.results(strips, left=len(strips), given_up=lambda: False)}
    shape = (end_row - first_row, end_column - first_column)
    parts = [by_strip[strip] for strip in strips]
    arrays = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    return {name: array.reshape(*shape, *array.shape[1:]) for name, array in arrays.items()}


def _of_strip(record: CameraRecord, strip: Strip, work: Callable[[Floats, PixelRays], Arrays]) -> Arrays:
    pixels = pixel_centres(record, (strip.row, strip.end_row), (strip.column, strip.end_column))
    fed = fed_pixels(record._replace(bend=None), pixels, np.arange(len(pixels)))
    return work(pixels, representative_rays(record, pixels, fed))


class Strip(NamedTuple):
    """Rows of a part of the sensor, from the first one to the end."""

    row: int
    end_row: int
    column: int
    end_column: int

    @property
    def size(self) -> int:
        """Pixels."""
        return (self.end_row - self.row) * (self.end_column - self.column)

    @property
    def nbytes(self) -> int:
        """Bytes of the ground truth, with all channels that are possible."""
        return 8 * 2 * len(CHANNELS) * self.size


def strip_finder(job: tuple[Scene | None, PlenopticCamera, Truth]) -> Callable[[Strip], Arrays]:
    """Function that finds the ground truth of strips, of a scene before a camera."""
    scene, camera, channels = job
    record, surfaces, intersector = prepared_camera(camera).record, None, None
    cells_per_pixel(record)
    finding = truth_record(camera, record, channels)
    assert finding is not None
    sources = [channel.source for channel in channels_of(channels).values()]
    if _has_meshes(scene) and any((source.needs | source.uses) & Needs.MESHES for source in sources):
        from plenoptic.scene.cache import prepared_scene

        assert scene is not None
        prepared = prepared_scene(scene)
        surfaces, intersector = prepared.record, prepared.intersector

    def work(pixels: Floats, rays: PixelRays) -> Arrays:
        return truth_of(record, surfaces, intersector, finding, pixels, rays)

    return lambda strip: _of_strip(record, strip, work)


def compiled_strip_finder(job: tuple[Scene | None, PlenopticCamera, Truth], threads: int) -> Callable[[Strip], Arrays]:
    """The same in another process, compiled with so many processes."""
    from plenoptic.core.numba.parallel_compilation import compile_in_parallel

    find, empty = strip_finder(job), Strip(0, 0, 0, 0)
    with compile_in_parallel(lambda: find(empty), threads=threads):
        find(empty)
    return find


def _has_meshes(scene: Scene | None) -> bool:
    if scene is None:
        return False
    from plenoptic.scene.cache import prepared_scene

    return prepared_scene(scene).record.geometry is not None
