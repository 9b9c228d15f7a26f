"""A tile: the unit of work. One rectangle of pixels through all stages, as a pure function."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.regions import feeding_regions, pixel_centres
from plenoptic.camera.tables import CameraTables, fill_through_array
from plenoptic.camera.truth import main_rays
from plenoptic.planning import Stage
from plenoptic.scene.accel import Intersector
from plenoptic.scene.tables import SceneTables
from plenoptic.transport import Settings, Transport

BUNDLE = 1 << 13
"""Paths that go through the stages together. From 2^11 to 2^14 the time was the same to within 3 %, and long bundles
let go of the GIL for longer."""


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


def status_codes(tables: CameraTables) -> int:
    """How many numbers a ray's status can have."""
    return 8 * (tables.elements + 1)


def render_tile(
    tables: CameraTables,
    scene: SceneTables | None,
    intersector: Intersector | None,
    tile: Tile,
    settings: Settings,
) -> TileResult:
    """All samples of a tile's pixels: a pure function of its arguments."""
    from plenoptic import _sobol
    from plenoptic.camera import _sample
    from plenoptic.optics._blocks import BLOCK, RAY
    from plenoptic.optics._trace import fill_traced

    samples, replicates = settings.samples, min(settings.replicates, settings.samples)
    channels = 1 if scene is None else scene.channels
    pixels = pixel_centres(tables, (tile.row, tile.row + tile.rows), (tile.column, tile.column + tile.columns))
    triangles, first = feeding_regions(tables, pixels, 0.5 * math.sqrt(2) * tables.pitch)
    lit = np.flatnonzero(np.diff(first))
    number = (tile.row + lit // tile.columns) * tables.columns + tile.column + lit % tile.columns
    lit_first = np.append(first[lit], first[-1])
    lit_pixels = np.ascontiguousarray(pixels[lit])
    sums = np.zeros((lit.size, replicates, channels))
    counts = np.zeros(status_codes(tables), dtype=np.int64)
    paths, nonfinite = lit.size * samples, 0
    net = np.empty((_sobol.DIMENSIONS, -(-samples // replicates)), dtype=np.uint32)
    _sobol.fill_net(net)
    blocks = np.empty(-(-min(BUNDLE, paths) // BLOCK) * RAY)
    scene_stage = None if scene is None else Transport(tables, scene, intersector, settings, min(BUNDLE, paths))
    for start in range(0, paths, BUNDLE):
        n = min(BUNDLE, paths - start)
        bundle = blocks[: -(-n // BLOCK) * RAY]
        _sample.fill_camera_samples(
            bundle,
            start,
            n,
            samples,
            replicates,
            settings.seed,
            net,
            lit_pixels,
            number,
            tables.pitch,
            triangles,
            lit_first,
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


def _depths(
    tables: CameraTables, scene: SceneTables, intersector: Intersector, pixels: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Depth of each pixel (n,) in mm: -z in the camera's frame where its main ray meets the scene, or inf."""
    from plenoptic.camera import _sample, _truth
    from plenoptic.scene import _shade

    depths = np.full(len(pixels), np.inf)
    step = BUNDLE // _truth.PROBES
    rays, lanes = np.empty((step, 6)), np.empty(step, dtype=np.int64)
    hits, distances = np.empty(step, dtype=np.int32), np.empty(step)
    for start in range(0, len(pixels), step):
        part = pixels[start : start + step]
        main = main_rays(tables, part)
        n = _sample.fill_world_rays(rays, lanes, main, len(part), tables.rotation, tables.position)
        intersector.fill_closest(hits[:n], rays[:n], coherent=True)
        _shade.fill_distances(distances, hits[:n], rays[:n], scene.vertices, scene.triangles)
        _truth.fill_depths(depths[start : start + step], main, lanes[:n], distances)
    return depths
