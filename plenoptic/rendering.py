"""Rendering: tiles over threads, stage after stage. The one driver loop."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic._threads import run_in_order, thread_count
from plenoptic._values import whole
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.tables import CameraTables, camera_tables, fill_through_array
from plenoptic.errors import InvalidValueError
from plenoptic.exposure import Exposure, RenderStats
from plenoptic.film import Film
from plenoptic.planning import Plan, Stage, plan_stages
from plenoptic.rays import RayStatus
from plenoptic.scene.accel import Intersector, build_intersector
from plenoptic.scene.scene import Scene
from plenoptic.scene.tables import SceneTables

BUNDLE = 1 << 12
"""Paths that go through the stages together: half a megabyte of rays, which stays in a second-level cache."""

PATHS_PER_TILE = 1 << 17
_SMALLEST_SIDE, _LARGEST_SIDE = 16, 256


class Settings(NamedTuple):
    """What a tile needs to know beside camera and scene."""

    samples: int
    replicates: int
    seed: int
    max_bounces: int
    plan: Plan


class Tile(NamedTuple):
    """A rectangle of pixels of the sensor."""

    row: int
    column: int
    rows: int
    columns: int


class TileResult(NamedTuple):
    """What a tile brings: sums (rows, columns, replicates, channels), counts by status, depth and failures."""

    tile: Tile
    sums: NDArray[np.float64]
    counts: NDArray[np.int64]
    depth: NDArray[np.float64] | None
    paths: int
    nonfinite: int


def render(
    scene: Scene,
    camera: PlenopticCamera,
    *,
    samples: int,
    region: tuple[slice, slice] | None = None,
    seed: int = 0,
    replicates: int = 8,
    max_bounces: int = 4,
    depth: bool = True,
    threads: int | None = None,
    tile_side: int | None = None,
    progress: bool = True,
) -> Exposure:
    """Render the raw image of a scene, with its standard error and its depth.

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
        How often a path may be scattered; 0 shows only what emits.
    depth : bool
        Whether to find the depth of every pixel too.
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
    return _render(scene, camera, samples, region, seed, replicates, max_bounces, depth, threads, tile_side, progress)


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
        C = 1, without depth. The value of a pixel is the projected solid angle from which light reaches
        it, averaged over its area.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2"),
    ...     microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    ...     sensor=pl.Sensor(shape=(512, 512), pixel_pitch=0.01),
    ...     stop_to_microlenses=123.3, microlenses_to_sensor=1.7)
    >>> white = pl.render_white(camera, samples=64, region=np.s_[256:257, 256:257], progress=False)
    >>> f"{white.image[0, 0, 0]:.4f}"
    '0.0140'
    """
    return _render(None, camera, samples, region, seed, replicates, 0, False, threads, tile_side, progress)


def _render(
    scene: Scene | None,
    camera: PlenopticCamera,
    samples: int,
    region: tuple[slice, slice] | None,
    seed: int,
    replicates: int,
    max_bounces: int,
    depth: bool,
    threads: int | None,
    tile_side: int | None,
    progress: bool,
) -> Exposure:
    begin, begin_cpu = time.perf_counter(), time.process_time()
    if not isinstance(camera, PlenopticCamera):
        raise InvalidValueError(f"camera is a {type(camera).__name__}; it must be a PlenopticCamera")
    whole(samples, "samples", at_least=1)
    whole(replicates, "replicates", at_least=1)
    whole(seed, "seed", at_least=0)
    whole(max_bounces, "max_bounces", at_least=0)
    workers = thread_count(threads)
    first_row, end_row, first_column, end_column = sensor_region(camera.sensor.shape, region)

    scene_tables = None if scene is None else scene.tables()
    plan = plan_stages(
        scene_tables, camera, samples=samples, replicates=replicates, max_bounces=max_bounces, depth=depth
    )
    tables = camera_tables(camera)
    intersector = None
    if plan.runs(Stage.INTERSECTION) and scene_tables is not None:
        assert scene_tables.vertices is not None and scene_tables.triangles is not None
        intersector = build_intersector(scene_tables.vertices, scene_tables.triangles)
    settings = Settings(samples, replicates, seed, max_bounces, plan)
    side = _tile_side(samples) if tile_side is None else whole(tile_side, "tile_side", at_least=1)
    tiles = list(_tiles(first_row, end_row, first_column, end_column, side))

    shape = (end_row - first_row, end_column - first_column)
    channels = 1 if scene_tables is None else scene_tables.channels
    film = Film((*shape, channels), counts=replicate_counts(samples, replicates))
    depths = np.full(shape, np.inf) if plan.runs(Stage.DEPTH) else None
    counts = np.zeros(_status_codes(tables), dtype=np.int64)
    paths = nonfinite = 0

    def work(tile: Tile) -> TileResult:
        return render_tile(tables, scene_tables, intersector, tile, settings)

    with _progress_bar(shape[0] * shape[1], progress) as bar:
        for result in run_in_order(work, tiles, threads=min(workers, len(tiles))):
            row, column = result.tile.row - first_row, result.tile.column - first_column
            film.add(row, column, result.sums)
            if depths is not None and result.depth is not None:
                depths[row : row + result.tile.rows, column : column + result.tile.columns] = result.depth
            counts += result.counts
            paths += result.paths
            nonfinite += result.nonfinite
            bar.update(result.tile.rows * result.tile.columns)

    stats = RenderStats(
        seconds=time.perf_counter() - begin,
        cpu_seconds=time.process_time() - begin_cpu,
        paths=paths,
        paths_through_lens=int(counts[0]),
        lost=_lost(counts),
        nonfinite=nonfinite,
        threads=workers,
    )
    return Exposure(
        image=film.image(),
        standard_error=film.standard_error(),
        depth=depths,
        samples=samples,
        replicates=film.replicates,
        seed=seed,
        camera=camera,
        region=None if region is None else (first_row, end_row, first_column, end_column),
        stats=stats,
    )


def sensor_region(shape: tuple[int, int], region: tuple[slice, slice] | None) -> tuple[int, int, int, int]:
    """First and end row, first and end column of a region given as slices."""
    if region is None:
        return 0, shape[0], 0, shape[1]
    if not (isinstance(region, tuple) and len(region) == 2 and all(isinstance(part, slice) for part in region)):
        raise InvalidValueError(f"region is {region!r}; it must be two slices, such as np.s_[0:64, 0:64]")
    bounds: list[int] = []
    for part, length, name in zip(region, shape, ("rows", "columns"), strict=True):
        first, end, step = part.indices(length)
        if step != 1 or end <= first:
            raise InvalidValueError(
                f"region has {name} {part}; of the sensor's {length} {name} it must take at least one, with step 1"
            )
        bounds += [first, end]
    return bounds[0], bounds[1], bounds[2], bounds[3]


def replicate_counts(samples: int, replicates: int) -> NDArray[np.int64]:
    """How many samples each replicate gets: as equal as can be, the first ones one more."""
    counts = np.full(replicates, samples // replicates, dtype=np.int64)
    counts[: samples % replicates] += 1
    return counts


def _tile_side(samples: int) -> int:
    return min(max(int(math.sqrt(PATHS_PER_TILE / samples)), _SMALLEST_SIDE), _LARGEST_SIDE)


def _tiles(first_row: int, end_row: int, first_column: int, end_column: int, side: int) -> Iterator[Tile]:
    for row in range(first_row, end_row, side):
        for column in range(first_column, end_column, side):
            yield Tile(row, column, min(side, end_row - row), min(side, end_column - column))


def _status_codes(tables: CameraTables) -> int:
    return 8 * (tables.elements + 1)


def _lost(counts: NDArray[np.int64]) -> tuple[tuple[str, int | None, int], ...]:
    lost: list[tuple[str, int | None, int]] = []
    for code in np.flatnonzero(counts[1:]) + 1:
        element, cause = divmod(int(code), 8)
        lost.append((RayStatus(cause).name.lower(), element - 1 if element else None, int(counts[code])))
    return tuple(lost)


def _progress_bar(pixels: int, show: bool):  # type: ignore[no-untyped-def]
    from tqdm.auto import tqdm

    return tqdm(total=pixels, unit="px", unit_scale=True, disable=not show)


def render_tile(
    tables: CameraTables,
    scene: SceneTables | None,
    intersector: Intersector | None,
    tile: Tile,
    settings: Settings,
) -> TileResult:
    """All samples of a tile's pixels: a pure function of its arguments."""
    from plenoptic.camera import _sample
    from plenoptic.optics._trace import BLOCK, RAY, fill_traced

    samples, replicates = settings.samples, min(settings.replicates, settings.samples)
    channels = 1 if scene is None else scene.channels
    pixels = _pixel_centres(tables, tile)
    triangles, first = fill_regions(tables, pixels, 0.5 * math.sqrt(2) * tables.pitch)
    lit = np.flatnonzero(np.diff(first))
    number = (tile.row + lit // tile.columns) * tables.columns + tile.column + lit % tile.columns
    lit_first = np.append(first[lit], first[-1])
    lit_pixels = np.ascontiguousarray(pixels[lit])
    sums = np.zeros((lit.size, replicates, channels))
    counts = np.zeros(_status_codes(tables), dtype=np.int64)
    paths, nonfinite = lit.size * samples, 0
    blocks = np.empty(-(-min(BUNDLE, paths) // BLOCK) * RAY)
    scene_stage = None if scene is None else _SceneStage(tables, scene, intersector, settings, min(BUNDLE, paths))
    for start in range(0, paths, BUNDLE):
        n = min(BUNDLE, paths - start)
        bundle = blocks[: -(-n // BLOCK) * RAY]
        _sample.fill_camera_samples(
            bundle, start, n, samples, replicates, settings.seed, lit_pixels, number, tables.pitch, triangles, lit_first
        )
        fill_through_array(bundle, tables)
        fill_traced(bundle, *tables.lens)
        _sample.fill_status_counts(counts, bundle, n)
        radiance = None if scene_stage is None else scene_stage.radiance(bundle, start, n, number)
        nonfinite += _sample.fill_sums(sums, bundle, radiance, start, n, samples, replicates)
    whole_sums = np.zeros((tile.rows * tile.columns, replicates, channels))
    whole_sums[lit] = sums
    depth = None
    if settings.plan.runs(Stage.DEPTH) and scene is not None and intersector is not None:
        depth = _depths(tables, scene, intersector, pixels).reshape(tile.rows, tile.columns)
    shape = (tile.rows, tile.columns, replicates, channels)
    return TileResult(tile, whole_sums.reshape(shape), counts, depth, paths, nonfinite)


def _pixel_centres(tables: CameraTables, tile: Tile) -> NDArray[np.float64]:
    """(n, 2): centres of the tile's pixels on the sensor in mm, row by row."""
    x = -(np.arange(tile.column, tile.column + tile.columns) + 0.5 - tables.columns / 2) * tables.pitch
    y = (np.arange(tile.row, tile.row + tile.rows) + 0.5 - tables.rows / 2) * tables.pitch
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def fill_regions(
    tables: CameraTables, pixels: NDArray[np.float64], margin: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Triangles that cover what feeds each pixel, and where each pixel's triangles begin.

    `margin` is the distance from a pixel's centre to the points of it that matter, in mm.
    """
    from plenoptic.camera import _regions

    first = np.zeros(len(pixels) + 1, dtype=np.int64)
    cells, bounds = tables.cells, tables.bounds
    room = 16 * len(pixels)
    while True:
        triangles = np.empty((room, _regions.TRIANGLE))
        if cells is None:
            needed = _regions.fill_pupil_regions(triangles, first, pixels, bounds.corners, bounds.reach, bounds.step)
        else:
            needed = _regions.fill_cell_regions(
                triangles,
                first,
                pixels,
                margin,
                cells.basis,
                cells.inverse,
                cells.corners,
                tables.ratio,
                cells.bend,
                cells.slack,
                bounds.normals,
                bounds.support,
                bounds.reach,
                bounds.step,
            )
        if needed <= room:
            return triangles[:needed], first
        room = needed


class _SceneStage:
    """What a tile's bundles need to follow their paths through the scene; its arrays are used again and again."""

    def __init__(
        self,
        tables: CameraTables,
        scene: SceneTables,
        intersector: Intersector | None,
        settings: Settings,
        most: int,
    ) -> None:
        self._camera, self._scene, self._intersector, self._settings = tables, scene, intersector, settings
        plan, channels = settings.plan, scene.channels
        self._radiance = np.empty((most, channels))
        self._rays = np.empty((most, 6))
        self._lanes = np.empty(most, dtype=np.int64)
        self._hits = np.full(most, -1, dtype=np.int32)
        if plan.runs(Stage.SCATTERING):
            self._keys, self._indices = np.empty(most, dtype=np.uint64), np.empty(most, dtype=np.uint32)
            lights = plan.runs(Stage.DIRECT_LIGHT)
            self._shadow_rays = np.empty((most if lights else 0, 6))
            self._shadow_path = np.empty(most if lights else 0, dtype=np.int64)
            self._shadow_radiance = np.empty((most if lights else 0, channels))
            self._blocked = np.empty(most if lights else 0, dtype=np.uint8)

    def radiance(
        self, blocks: NDArray[np.float64], start: int, n: int, number: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """What the paths of a bundle see, (n, channels); 0 for those that did not leave the lens."""
        from plenoptic.camera import _sample
        from plenoptic.scene import _shade

        scene, settings, plan = self._scene, self._settings, self._settings.plan
        radiance = self._radiance[:n]
        radiance[:] = 0.0
        found = _sample.fill_world_rays(
            self._rays, self._lanes, blocks, n, self._camera.rotation, self._camera.position
        )
        rays, path_of = self._rays[:found], self._lanes[:found]
        throughput = None
        if plan.runs(Stage.SCATTERING):
            _sample.fill_path_keys(
                self._keys[:n],
                self._indices[:n],
                start,
                settings.samples,
                min(settings.replicates, settings.samples),
                settings.seed,
                number,
            )
        for bounce in range(settings.max_bounces + 1):
            hits = self._hits[: len(path_of)]
            if self._intersector is not None:
                self._intersector.fill_closest(hits, rays, coherent=bounce == 0)
            emission = scene.emission if bounce == 0 or not plan.runs(Stage.DIRECT_LIGHT) else None
            _shade.fill_emitted(
                radiance,
                throughput,
                path_of,
                hits,
                rays,
                scene.vertices,
                scene.triangles,
                scene.triangle_material,
                emission,
                scene.two_sided,
                scene.background,
            )
            if bounce == settings.max_bounces or not plan.runs(Stage.SCATTERING):
                break
            more = bounce + 1 < settings.max_bounces or plan.runs(Stage.BACKGROUND)
            rays, path_of, throughput = self._scatter(
                radiance, hits, rays, path_of, throughput, bounce, more and plan.runs(Stage.ONWARD_RAYS)
            )
            if not len(path_of):
                break
        return radiance

    def _scatter(
        self,
        radiance: NDArray[np.float64],
        hits: NDArray[np.int32],
        rays: NDArray[np.float64],
        path_of: NDArray[np.int64],
        throughput: NDArray[np.float64] | None,
        bounce: int,
        onward: bool,
    ) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
        """Add direct light and return the rays onwards, their paths and throughputs."""
        from plenoptic.scene import _shade

        scene = self._scene
        room = len(path_of) if onward else 0
        next_rays = np.empty((room, 6))
        next_path = np.empty(room, dtype=np.int64)
        next_throughput = np.empty((room, scene.channels))
        shadows, onwards = _shade.fill_scattered(
            next_rays if onward else None,
            next_path,
            next_throughput,
            self._shadow_rays,
            self._shadow_path,
            self._shadow_radiance,
            hits,
            rays,
            path_of,
            throughput,
            self._keys,
            self._indices,
            bounce,
            scene.vertices,
            scene.triangles,
            scene.triangle_material,
            scene.normals,
            scene.uv,
            scene.albedo,
            scene.material_texture,
            scene.texels,
            scene.texture_shape,
            scene.emission,
            scene.two_sided,
            scene.light_triangles,
            scene.light_cdf,
            scene.light_area_pdf,
        )
        if shadows and self._intersector is not None:
            self._intersector.fill_blocked(self._blocked[:shadows], self._shadow_rays[:shadows])
            _shade.fill_direct(radiance, self._blocked, self._shadow_path[:shadows], self._shadow_radiance)
        return next_rays[:onwards], next_path[:onwards], next_throughput[:onwards]


def _depths(
    tables: CameraTables, scene: SceneTables, intersector: Intersector, pixels: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Depth of each pixel (n,) in mm; see `camera._truth` for the ray that stands for a pixel."""
    from plenoptic.camera import _sample, _truth
    from plenoptic.optics._trace import BLOCK, RAY, fill_traced
    from plenoptic.scene import _shade

    depths = np.full(len(pixels), np.inf)
    step = BUNDLE // _truth.PROBES
    probes = np.empty(BUNDLE // BLOCK * RAY)
    aims = np.empty((BUNDLE, 4))
    for start in range(0, len(pixels), step):
        part = pixels[start : start + step]
        triangles, first = fill_regions(tables, part, 0.0)
        probe = probes[: -(-len(part) * _truth.PROBES // BLOCK) * RAY]
        _truth.fill_probes(probe, aims, part, triangles, first)
        fill_through_array(probe, tables)
        fill_traced(probe, *tables.lens)
        main = np.empty(-(-len(part) // BLOCK) * RAY)
        _truth.fill_main_aims(main, probe, aims, part, triangles, first)
        fill_through_array(main, tables)
        fill_traced(main, *tables.lens)
        rays, lanes = np.empty((len(part), 6)), np.empty(len(part), dtype=np.int64)
        found = _sample.fill_world_rays(rays, lanes, main, len(part), tables.rotation, tables.position)
        hits, distances = np.empty(found, dtype=np.int32), np.empty(found)
        intersector.fill_closest(hits, rays[:found], coherent=True)
        _shade.fill_distances(distances, hits, rays[:found], scene.vertices, scene.triangles)
        _truth.fill_depths(depths[start : start + step], main, lanes[:found], distances)
    return depths
