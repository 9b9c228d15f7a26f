"""Rendering: tiles over threads. The one driver loop."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from plenoptic._threads import run_in_order, thread_count
from plenoptic._values import choice, positive, whole
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.regions import cells_per_pixel
from plenoptic.camera.tables import camera_tables
from plenoptic.camera.truth import GroundTruth, Truth, available_truth, empty_truth
from plenoptic.errors import InvalidValueError
from plenoptic.exposure import Exposure
from plenoptic.film import Film
from plenoptic.planning import check_arguments, plan_stages, sensor_region
from plenoptic.rays import RayStatus
from plenoptic.render_stats import RenderStats
from plenoptic.scene.accel import build_intersector
from plenoptic.scene.scene import Scene
from plenoptic.scene_stages import is_dark
from plenoptic.stages import Stage
from plenoptic.tiles import Tile, TileResult, film_channels, render_tile, status_codes
from plenoptic.transport import Caustics, Settings
from plenoptic.truth import truth_tables

PATHS_PER_TILE = 1 << 17
_SMALLEST_SIDE, _LARGEST_SIDE = 16, 256
_CELLS_PER_TILE = 1 << 18
"""Microlenses that feed the pixels of a tile, all pixels together: some 70 MB of triangles."""


def render(
    scene: Scene,
    camera: PlenopticCamera,
    *,
    samples: int,
    region: tuple[slice, slice] | None = None,
    seed: int = 0,
    replicates: int = 8,
    max_bounces: int = 8,
    caustics: Caustics = Caustics.KEPT,
    clamp: float | None = None,
    truth: Truth = Truth.DEPTH,
    threads: int | None = None,
    tile_side: int | None = None,
    progress: bool = True,
) -> Exposure:
    """Render the raw image of a scene, with its standard error and its ground truth.

    Parameters
    ----------
    scene : Scene
    camera : PlenopticCamera
    samples : int
        Paths per pixel. Powers of 2 times `replicates` use the sampling points best.
    region : (slice, slice), optional
        Rows and columns of the sensor, such as ``np.s_[256:384, 192:320]``; the same bits as in the whole image.
    seed : int
        Of the random numbers, at least 0.
    replicates : int
        Independent scramblings of the sampling points among which the samples are divided; the standard
        error comes from their spread with replicates - 1 degrees of freedom, and is None with fewer than 2.
        At equal error 8 replicates cost more time than one (docs/error_and_time.md).
    max_bounces : int
        How often a path may be scattered, reflected or refracted; 0 shows only what emits. Light that is scattered more
        often is missing.
    caustics : Caustics
        ``Caustics.LEFT_OUT``: light that mirrors, polished glass or panes throw onto rough surfaces does not count. It
        is noisy, since paths find it by chance only; the difference of the variances with and without it is its share
        of the noise.
    clamp : float, optional
        Paths that bring more radiance than this are scaled down to it. It takes away noise and light:
        `shot.stats.clamped` is the share that is missing. None: nothing is taken away.
    truth : Truth
        What of the ground truth of every pixel is found too, such as ``Truth.DEPTH | Truth.NORMAL``; what is not asked
        for is neither computed nor kept. See `GroundTruth`.
    threads : int, optional
        None: one for each processor. The image does not depend on it.
    tile_side : int, optional
        Pixels along a tile; None: chosen by the number of samples. The image does not depend on it.
    progress : bool
        Whether to show a progress bar.

    Returns
    -------
    Exposure
        C = 1 where everything in the scene is grey, otherwise 3.

    Raises
    ------
    InvalidValueError
        Where an argument is impossible; nothing has been rendered then.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2"),
    ...     microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    ...     sensor=pl.Sensor(shape=(512, 512), pixel_pitch=0.01),
    ...     stop_to_microlenses=123.3, microlenses_to_sensor=1.7)
    >>> pl.render(pl.white_plane(), camera, samples=16, region=np.s_[250:260, 250:270], progress=False).image.shape
    (10, 20, 1)
    """
    if not isinstance(scene, Scene):
        raise InvalidValueError(f"scene is a {type(scene).__name__}; it must be a Scene")
    light = (max_bounces, choice(caustics, Caustics, "caustics"), None if clamp is None else positive(clamp, "clamp"))
    return _render(scene, camera, samples, region, seed, replicates, light, truth, threads, tile_side, progress)


def render_white(
    camera: PlenopticCamera,
    *,
    samples: int,
    region: tuple[slice, slice] | None = None,
    seed: int = 0,
    replicates: int = 8,
    threads: int | None = None,
    tile_side: int | None = None,
    progress: bool = True,
) -> Exposure:
    """Render the image of a scene of radiance 1 everywhere; `shot.image / white.image` is then radiance.

    There is no scene: nothing is intersected or shaded. Parameters are those of `render`.

    Returns
    -------
    Exposure
        C = 1, without ground truth. The value of a pixel is the projected solid angle from which light reaches
        it, averaged over its area.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=5.0))
    >>> camera = pl.PlenopticCamera(lens=lens,
    ...     microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    ...     sensor=pl.Sensor(shape=(512, 512), pixel_pitch=0.01),
    ...     stop_to_microlenses=123.3, microlenses_to_sensor=1.7)
    >>> white = pl.render_white(camera, samples=64, region=np.s_[256:257, 256:257], progress=False)
    >>> f"{white.image[0, 0, 0]:.4f}"
    '0.0140'
    """
    light = (0, Caustics.KEPT, None)
    return _render(None, camera, samples, region, seed, replicates, light, Truth.NONE, threads, tile_side, progress)


def _render(
    scene: Scene | None,
    camera: PlenopticCamera,
    samples: int,
    region: tuple[slice, slice] | None,
    seed: int,
    replicates: int,
    light: tuple[int, Caustics, float | None],
    truth: Truth,
    threads: int | None,
    tile_side: int | None,
    progress: bool,
) -> Exposure:
    begin, begin_cpu = time.perf_counter(), time.process_time()
    max_bounces, caustics, clamp = light
    check_arguments(scene, camera, samples=samples, replicates=replicates, max_bounces=max_bounces)
    samples, replicates, max_bounces = int(samples), int(replicates), int(max_bounces)
    seed = whole(seed, "seed", at_least=0)
    if seed >= 1 << 64:
        raise InvalidValueError(f"seed is {seed}; it must be below 2^64")
    workers = thread_count(threads)
    first_row, end_row, first_column, end_column = sensor_region(camera.sensor.shape, region)

    scene_tables = None if scene is None else scene.tables()
    if scene_tables is not None and is_dark(scene_tables):
        warnings.warn(
            "nothing in the scene shines and its image will be black; give it lights=[...] or a background=",
            stacklevel=3,
        )
    plan = plan_stages(
        scene_tables, camera, samples=samples, replicates=replicates, max_bounces=max_bounces, truth=truth
    )
    tables = camera_tables(camera)
    intersector = None
    if plan.runs(Stage.INTERSECTION) and scene_tables is not None:
        assert scene_tables.vertices is not None and scene_tables.triangles is not None
        intersector = build_intersector(scene_tables.vertices, scene_tables.triangles, scene_tables.instances)
    settings = Settings(samples, replicates, np.uint64(seed), max_bounces, plan, caustics, clamp)
    side = (
        _tile_side(samples, cells_per_pixel(tables)) if tile_side is None else whole(tile_side, "tile_side", at_least=1)
    )
    tiles = list(_tiles(first_row, end_row, first_column, end_column, side))

    shape = (end_row - first_row, end_column - first_column)
    channels = film_channels(tables, scene_tables)
    film = Film((*shape, channels), counts=replicate_counts(samples, replicates))
    kept = available_truth(truth, meshes=intersector is not None, microlenses=camera.microlenses is not None)
    finding, truths = truth_tables(camera, tables, kept), empty_truth(kept, shape)
    counts = np.zeros(status_codes(tables), dtype=np.int64)
    paths, nonfinite, met, brought, clamped = 0, 0, 0, 0.0, 0.0

    def work(tile: Tile) -> TileResult:
        return render_tile(tables, scene_tables, intersector, tile, settings, finding)

    with _progress_bar(shape[0] * shape[1], progress) as bar:
        for result in run_in_order(work, tiles, threads=min(workers, len(tiles))):
            row, column = result.tile.row - first_row, result.tile.column - first_column
            film.add(row, column, result.sums)
            for name, array in (result.truth or {}).items():
                truths[name][row : row + result.tile.rows, column : column + result.tile.columns] = array
            counts += result.counts
            paths += result.paths
            nonfinite += result.nonfinite
            met += result.met
            brought, clamped = brought + result.light, clamped + result.clamped
            bar.update(result.tile.rows * result.tile.columns)

    if scene is not None and intersector is not None and not met and counts[0]:
        low, high = np.asarray(scene.bounds).round(3).tolist()
        warnings.warn(
            f"no path met the scene, which lies between {low} and {high} mm; move it, or the camera, which without a "
            "pose looks from the origin along -z",
            stacklevel=3,
        )
    stats = RenderStats(
        seconds=time.perf_counter() - begin,
        cpu_seconds=time.process_time() - begin_cpu,
        paths=paths,
        paths_through_lens=int(counts[0]),
        lost=_lost(counts),
        nonfinite=nonfinite,
        threads=workers,
        clamped=clamped / brought if brought > 0 else 0.0,
    )
    return Exposure(
        image=film.image(),
        standard_error=film.standard_error(),
        truth=GroundTruth(**truths) if truths else None,
        samples=samples,
        replicates=film.replicates,
        seed=seed,
        camera=camera,
        region=None if region is None else (first_row, end_row, first_column, end_column),
        stats=stats,
    )


def replicate_counts(samples: int, replicates: int) -> NDArray[np.int64]:
    """How many samples each replicate gets: as equal as can be, the first ones one more."""
    counts = np.full(replicates, samples // replicates, dtype=np.int64)
    counts[: samples % replicates] += 1
    return counts


def _tile_side(samples: int, cells: float) -> int:
    """Pixels along a tile: by its paths, but no more than the triangles of its regions have room for."""
    by_paths = min(max(int(math.sqrt(PATHS_PER_TILE / samples)), _SMALLEST_SIDE), _LARGEST_SIDE)
    return max(1, min(by_paths, int(math.sqrt(_CELLS_PER_TILE / cells))))


def _tiles(first_row: int, end_row: int, first_column: int, end_column: int, side: int) -> Iterator[Tile]:
    for row in range(first_row, end_row, side):
        for column in range(first_column, end_column, side):
            yield Tile(row, column, min(side, end_row - row), min(side, end_column - column))


def _lost(counts: NDArray[np.int64]) -> tuple[tuple[str, int | None, int], ...]:
    lost: list[tuple[str, int | None, int]] = []
    for code in np.flatnonzero(counts[1:]) + 1:
        element, cause = divmod(int(code), 8)
        lost.append((RayStatus(cause).name.lower(), element - 1 if element else None, int(counts[code])))
    return tuple(lost)


def _progress_bar(pixels: int, show: bool):  # type: ignore[no-untyped-def]
    from tqdm.auto import tqdm

    return tqdm(total=pixels, unit="px", unit_scale=True, disable=not show)
