"""A tile: the unit of work. One rectangle of pixels through all stages, as a pure function."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.regions import feeding_regions, pixel_centres
from plenoptic.camera.tables import CameraTables, fill_before_array, fill_dimmed_at_lens, fill_through_array, lanes_for
from plenoptic.optics.blemishes import BlemishSite
from plenoptic.scene.accel import Intersector
from plenoptic.scene.tables import SceneTables
from plenoptic.transport import Settings, Transport
from plenoptic.truth import Arrays, TruthTables, truth_of

BUNDLE = 1 << 13
"""Paths that go through the stages together. From 2^11 to 2^14 the time was the same to within 3 %, and long bundles
let go of the GIL for longer."""


_GUIDES = 1024


class Tile(NamedTuple):
    """A rectangle of pixels of the sensor."""

    row: int
    column: int
    rows: int
    columns: int


class TileResult(NamedTuple):
    """What a tile brings: sums (rows, columns, replicates, channels), counts by status, ground truth and failures."""

    tile: Tile
    sums: NDArray[np.float64]
    counts: NDArray[np.int64]
    truth: Arrays | None
    """(rows, columns, ...) by name; None where nothing of it is wanted."""
    paths: int
    nonfinite: int
    met: int
    """Paths that met the scene."""
    light: float
    """Sum of what paths brought."""
    clamped: float
    """Sum of what clamping took away."""


def status_codes(tables: CameraTables) -> int:
    """How many numbers a ray's status can have."""
    return 8 * (tables.elements + 1)


def film_channels(tables: CameraTables, scene: SceneTables | None) -> int:
    """Channels of the image: the sensor's, or those of the scene where the camera sees one wavelength."""
    if tables.colour is not None:
        return int(tables.colour.weights.shape[1])
    return 1 if scene is None else scene.channels


def _guide(cdf: NDArray[np.float64]) -> NDArray[np.int64]:
    """Where to begin looking in a table of cumulative probabilities; see `_sample.fill_waves`."""
    return np.asarray(np.searchsorted(cdf, np.arange(_GUIDES) / _GUIDES, side="right"), dtype=np.int64)


def render_tile(
    tables: CameraTables,
    scene: SceneTables | None,
    intersector: Intersector | None,
    tile: Tile,
    settings: Settings,
    truth: TruthTables | None,
) -> TileResult:
    """All samples of a tile's pixels: a pure function of its arguments."""
    from plenoptic import _sobol
    from plenoptic.camera import _sample
    from plenoptic.optics._blocks import BLOCK, RAY
    from plenoptic.optics._trace import fill_traced

    samples, replicates = settings.samples, min(settings.replicates, settings.samples)
    channels = film_channels(tables, scene)
    pixels = pixel_centres(tables, (tile.row, tile.row + tile.rows), (tile.column, tile.column + tile.columns))
    triangles, first, details = feeding_regions(tables, pixels, 0.5 * math.sqrt(2) * tables.pitch)
    lit = np.flatnonzero(np.diff(first))
    number = (tile.row + lit // tile.columns) * tables.columns + tile.column + lit % tile.columns
    lit_first = np.append(first[lit], first[-1])
    lit_pixels = np.ascontiguousarray(pixels[lit])
    sums = np.zeros((lit.size, replicates, channels))
    counts = np.zeros(status_codes(tables), dtype=np.int64)
    paths, nonfinite, light, clamped = lit.size * samples, 0, 0.0, 0.0
    net = np.empty((_sobol.DIMENSIONS, -(-samples // replicates)), dtype=np.uint32)
    _sobol.fill_net(net)
    blocks = np.empty(-(-min(BUNDLE, paths) // BLOCK) * RAY)
    lanes, colour = lanes_for(tables, blocks.size // 8), tables.colour
    waves = guide = None
    if colour is not None:
        waves, guide = np.empty(blocks.size // 8, dtype=np.int64), _guide(colour.cdf)
    scene_stage = None if scene is None else Transport(tables, scene, intersector, settings, min(BUNDLE, paths))
    for start in range(0, paths, BUNDLE):
        n = min(BUNDLE, paths - start)
        bundle = blocks[: -(-n // BLOCK) * RAY]
        _sample.fill_camera_samples(
            bundle,
            lanes,
            start,
            n,
            samples,
            replicates,
            settings.seed,
            net,
            lit_pixels,
            number,
            tables.pixel_edges,
            tables.pixel_skew,
            triangles,
            details,
            lit_first,
        )
        fill_before_array(bundle, tables)
        fill_through_array(bundle, lanes, tables)
        if tables.blemishes:
            fill_dimmed_at_lens(bundle, tables, BlemishSite.LENS_REAR)
        if colour is None or tables.dispersed is None:
            fill_traced(bundle, *tables.lens)
        else:
            from plenoptic.optics._trace import fill_traced_waves

            _sample.fill_waves(waves, start, n, samples, replicates, settings.seed, number, colour.cdf, guide)
            fill_traced_waves(bundle, waves, *tables.dispersed)
        if tables.blemishes:
            fill_dimmed_at_lens(bundle, tables, BlemishSite.LENS_FRONT)
        _sample.fill_status_counts(counts, bundle, n)
        radiance = None if scene_stage is None else scene_stage.radiance(bundle, start, n, number, waves)
        if settings.clamp is not None and radiance is not None:
            kept, removed = _sample.fill_clamped(radiance, bundle, n, settings.clamp)
            light, clamped = light + kept + removed, clamped + removed
        nonfinite += _sample.fill_sums(
            sums, bundle, radiance, waves, None if colour is None else colour.weights, start, n, samples, replicates
        )
    whole_sums = np.zeros((tile.rows * tile.columns, replicates, channels))
    whole_sums[lit] = sums if tables.fill_factor == 1 else tables.fill_factor * sums
    found = None
    if truth is not None:
        flat = truth_of(tables, scene, intersector, truth, pixels)
        found = {name: array.reshape(tile.rows, tile.columns, *array.shape[1:]) for name, array in flat.items()}
    met = 0 if scene_stage is None else scene_stage.met
    shape = (tile.rows, tile.columns, replicates, channels)
    return TileResult(tile, whole_sums.reshape(shape), counts, found, paths, nonfinite, met, light, clamped)
