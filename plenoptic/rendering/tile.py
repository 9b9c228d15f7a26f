"""A tile: the unit of work. One rectangle of pixels through all stages, as a pure function."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.record import CameraTables, fill_before_array, fill_dimmed_at_lens, fill_through_array, lanes_for
from plenoptic.camera.sampling.pixel_regions import Regions, feeding_regions, pixel_centres
from plenoptic.optics.lens.record import LensRecord
from plenoptic.optics.microlens.dust import BlemishSite
from plenoptic.rendering.context import Compiled
from plenoptic.rendering.integrator.path import Batch, Transport
from plenoptic.rendering.settings import Sampler
from plenoptic.truth.compute import Arrays, truth_of
from plenoptic.truth.stages import TruthTables

BUNDLE = 1 << 13
"""Paths that go through the stages together. From 2^11 to 2^14 the time was the same to within 3 %, and long bundles
let go of the GIL for longer."""


_GUIDES = 1024
NAMED = 16
"""Paths that were not finite whose numbers are kept."""


class Tile(NamedTuple):
    """A rectangle of pixels of the sensor."""

    row: int
    column: int
    rows: int
    columns: int


class TileResult(NamedTuple):
    """What a batch of a tile brings."""

    tile: Tile
    batch: Batch
    sums: NDArray[np.float64]
    """(rows, columns, replicates, channels): those of all batches until now."""
    weights: NDArray[np.float64]
    """(rows, columns): what a sample weighs at most, about; 0 for pixels that no light can reach."""
    counts: NDArray[np.int64]
    """Paths by status."""
    truth: Arrays | None
    """(rows, columns, ...) by name; None where nothing of it is wanted."""
    paths: int
    """Paths sampled."""
    nonfinite: int
    lost_paths: tuple[tuple[int, int, int], ...]
    """Row, column and sample of the first paths that were not finite."""
    met: int
    """Paths that met the scene."""
    light: float
    """Sum of what paths brought."""
    clamped: float
    """Sum of what clamping took away."""


def status_codes(tables: CameraTables) -> int:
    """How many numbers a ray's status can have."""
    return 8 * (tables.elements + 1)


def wave_guide(cdf: NDArray[np.float64]) -> NDArray[np.int64]:
    """Where to begin looking in a table of cumulative probabilities; see `sample_kernels.fill_waves`."""
    return np.asarray(np.searchsorted(cdf, np.arange(_GUIDES) / _GUIDES, side="right"), dtype=np.int64)


class FedPixels(NamedTuple):
    """The pixels of a tile that light can reach."""

    place: NDArray[np.int64]
    """(p,): their numbers in the tile."""
    number: NDArray[np.int64]
    """(p,): on the whole sensor."""
    centres: NDArray[np.float64]
    """(p, 2): see `pixel_centres`."""
    regions: Regions
    """What feeds them."""


def fed_pixels(tables: CameraTables, tile: Tile, pixels: NDArray[np.float64]) -> FedPixels:
    """What feeds the pixels of a tile, whose centres (n, 2) are given."""
    triangles, first, details = feeding_regions(tables, pixels, 0.5 * math.sqrt(2) * tables.pitch)
    lit = np.flatnonzero(np.diff(first))
    number = (tile.row + lit // tile.columns) * tables.columns + tile.column + lit % tile.columns
    regions = Regions(triangles, np.append(first[lit], first[-1]), details)
    return FedPixels(lit, number, np.ascontiguousarray(pixels[lit]), regions)


def fill_aimed(
    bundle: NDArray[np.float64],
    lanes: NDArray[np.float64] | None,
    start: int,
    n: int,
    batch: Batch,
    seed: np.uint64,
    net: NDArray[np.uint32],
    fed: FedPixels,
    tables: CameraTables,
) -> None:
    """Start paths start ... start + n - 1: points on their pixels, aimed at what feeds these."""
    from plenoptic.camera.sampling.kernels import paths as sample_kernels

    sample_kernels.fill_camera_samples(
        bundle,
        lanes,
        start,
        n,
        batch.samples,
        batch.streams,
        batch.first_stream,
        seed,
        net,
        fed.centres,
        fed.number,
        tables.pixel_edges,
        tables.pixel_skew,
        fed.regions.triangles,
        fed.regions.details,
        fed.regions.first,
    )


def fill_drawn_waves(
    waves: NDArray[np.int64],
    start: int,
    n: int,
    batch: Batch,
    seed: np.uint64,
    number: NDArray[np.int64],
    cdf: NDArray[np.float64],
    guide: NDArray[np.int64],
) -> None:
    """Draw the wavelengths of those paths; `guide` is `wave_guide(cdf)`."""
    from plenoptic.camera.sampling.kernels import paths as sample_kernels

    sample_kernels.fill_waves(
        waves,
        start,
        n,
        batch.samples,
        batch.streams,
        batch.first_stream,
        batch.first_index,
        seed,
        number,
        cdf,
        guide,
    )


def fill_through_lens(bundle: NDArray[np.float64], lens: LensRecord, waves: NDArray[np.int64] | None) -> None:
    """Trace a bundle through the lens, each ray at its wavelength where `waves` has their numbers."""
    from plenoptic.optics.lens.kernels.trace import fill_traced

    fill_traced(bundle, lens, waves)


def render_tile(
    view: Compiled,
    tile: Tile,
    batch: Batch,
    truth: TruthTables | None,
    before: NDArray[np.float64] | None = None,
    stopped: Callable[[], bool] | None = None,
) -> TileResult | None:
    """A batch of samples of a tile's pixels, added to the sums of earlier batches: a pure function of its arguments.

    None where `stopped` says, between two bundles, that the result is no longer wanted.
    """
    from plenoptic.camera.sampling.kernels import paths as sample_kernels
    from plenoptic.core.kernels import sobol
    from plenoptic.core.kernels.ray_blocks import BLOCK, RAY

    tables, settings, channels = view.camera, view.settings, view.channels
    samples, streams, clamp = batch.samples, batch.streams, settings.how.clamp
    pixels = pixel_centres(tables, (tile.row, tile.row + tile.rows), (tile.column, tile.column + tile.columns))
    fed = fed_pixels(tables, tile, pixels)
    lit, number, triangles, lit_first = fed.place, fed.number, fed.regions.triangles, fed.regions.first
    whole_sums = np.zeros((tile.rows * tile.columns, settings.replicates, channels))
    if before is not None:
        whole_sums[:] = before.reshape(whole_sums.shape)
    grouped = settings.how.sampler is Sampler.RANDOM
    sums = np.zeros((lit.size, streams, channels)) if grouped else whole_sums[lit]
    counts = np.zeros(status_codes(tables), dtype=np.int64)
    paths, nonfinite, light, clamped = lit.size * samples, 0, 0.0, 0.0
    broken: list[tuple[int, int, int]] = []
    net = np.empty((sobol.DIMENSIONS, -(-samples // streams)), dtype=np.uint32)
    sobol.fill_net(net, batch.first_index)
    blocks = np.empty(-(-min(BUNDLE, paths) // BLOCK) * RAY)
    lanes, colour = lanes_for(tables, blocks.size // 8), tables.colour
    waves = guide = None
    if colour is not None:
        waves, guide = np.empty(blocks.size // 8, dtype=np.int64), wave_guide(colour.cdf)
    weights = None if colour is None else colour.weights
    scene_stage = None if view.scene is None else Transport(view, min(BUNDLE, paths))
    for start in range(0, paths, BUNDLE):
        if stopped is not None and stopped():
            return None
        n = min(BUNDLE, paths - start)
        bundle = blocks[: -(-n // BLOCK) * RAY]
        fill_aimed(bundle, lanes, start, n, batch, settings.seed, net, fed, tables)
        fill_before_array(bundle, tables)
        fill_through_array(bundle, lanes, tables)
        if tables.blemishes:
            fill_dimmed_at_lens(bundle, tables, BlemishSite.LENS_REAR)
        if colour is None or tables.dispersed is None:
            fill_through_lens(bundle, tables.lens, None)
        else:
            assert waves is not None and guide is not None
            fill_drawn_waves(waves, start, n, batch, settings.seed, number, colour.cdf, guide)
            fill_through_lens(bundle, tables.dispersed, waves)
        if tables.blemishes:
            fill_dimmed_at_lens(bundle, tables, BlemishSite.LENS_FRONT)
        sample_kernels.fill_status_counts(counts, bundle, n)
        radiance = None if scene_stage is None else scene_stage.radiance(bundle, start, n, batch, number, waves)
        if clamp is not None and radiance is not None:
            kept, removed = sample_kernels.fill_clamped(radiance, bundle, n, clamp)
            light, clamped = light + kept + removed, clamped + removed
        dropped = sample_kernels.fill_sums(sums, bundle, radiance, waves, weights, start, n, samples, streams)
        if dropped:
            nonfinite += dropped
            broken += _broken(bundle, radiance, start, n, batch, settings.replicates, number, tables.columns)
    if grouped:
        sums = whole_sums[lit] + _by_replicate(sums, batch, settings.replicates)
    whole_sums[lit] = sums
    reach = np.zeros(tile.rows * tile.columns)
    reach[lit] = triangles[lit_first[1:] - 1, 6] / tables.distance**2
    found = None
    if truth is not None:
        flat = truth_of(tables, view.scene, view.intersector, truth, pixels)
        found = {name: array.reshape(tile.rows, tile.columns, *array.shape[1:]) for name, array in flat.items()}
    met = 0 if scene_stage is None else scene_stage.met
    shape = (tile.rows, tile.columns)
    return TileResult(
        tile,
        batch,
        whole_sums.reshape(*shape, settings.replicates, channels),
        reach.reshape(shape),
        counts,
        found,
        paths,
        nonfinite,
        tuple(broken[:NAMED]),
        met,
        light,
        clamped,
    )


def _by_replicate(sums: NDArray[np.float64], batch: Batch, replicates: int) -> NDArray[np.float64]:
    """Sums of independent samples (pixels, samples, channels) as those of replicates: sample s belongs to s % r."""
    grouped = np.zeros((sums.shape[0], replicates, sums.shape[2]))
    for replicate in range(min(replicates, batch.samples)):
        grouped[:, (batch.first + replicate) % replicates] = sums[:, replicate::replicates].sum(axis=1)
    return grouped


def _broken(
    bundle: NDArray[np.float64],
    radiance: NDArray[np.float64] | None,
    start: int,
    n: int,
    batch: Batch,
    replicates: int,
    number: NDArray[np.int64],
    columns: int,
) -> list[tuple[int, int, int]]:
    """Row, column and sample of the first paths of a bundle that are not finite."""
    from plenoptic.camera.sampling.kernels import paths as sample_kernels
    from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, WEIGHT

    light = bundle.reshape(-1, RAY // BLOCK, BLOCK)[:, WEIGHT // BLOCK].ravel()[:n, None]
    with np.errstate(all="ignore"):
        light = light if radiance is None else light * radiance
    named = []
    for k in np.flatnonzero(~np.isfinite(light).all(axis=1))[:NAMED]:
        pixel, stream, index = sample_kernels.path_place(start + int(k), batch.samples, batch.streams)
        replicate_and_index = (batch.first_stream + stream, batch.first_index + index)
        sample = replicate_and_index[0] + replicate_and_index[1] * replicates
        named.append((*divmod(int(number[pixel]), columns), int(sample)))
    return named
