"""A tile: the unit of work. One rectangle of pixels through all stages, as a pure function."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.paths import CameraPaths
from plenoptic.camera.record import CameraRecord
from plenoptic.camera.sampling.pixel_regions import fed_pixels, pixel_centres
from plenoptic.camera.sampling.record import Batch, FedPixels
from plenoptic.core.kernels.bundles import fill_status_counts
from plenoptic.core.values import Floats
from plenoptic.rendering.context import RenderContext
from plenoptic.rendering.plan.stages import Stage
from plenoptic.rendering.tile_sums import PathCounts, PixelSums, SamplingPass, SharedSums
from plenoptic.truth.ground_truth import Arrays, truth_of
from plenoptic.truth.representative_rays import representative_rays
from plenoptic.truth.stages import TruthRecord

BUNDLE = 1 << 14
"""Paths that go through the stages together. Half as many take 2 % more time for white images and the still life,
8 % more for `objects`, whose paths end one by one; twice as many take as long, and twice the memory."""


class Tile(NamedTuple):
    """A rectangle of pixels of the sensor."""

    row: int
    column: int
    rows: int
    columns: int

    @property
    def pixels(self) -> int:
        """How many it has."""
        return self.rows * self.columns

    def centres(self, camera: CameraRecord) -> Floats:
        """(rows * columns, 2): see `pixel_centres`."""
        return pixel_centres(camera, (self.row, self.row + self.rows), (self.column, self.column + self.columns))

    def numbers(self, camera: CameraRecord) -> NDArray[np.int64]:
        """(rows * columns,): numbers of the pixels on the whole sensor."""
        row, column = np.divmod(np.arange(self.pixels), self.columns)
        return (self.row + row) * camera.sensor.columns + self.column + column


class TileResult(NamedTuple):
    """What a batch of a tile brings."""

    tile: Tile
    batch: Batch
    sums: Floats
    """(rows, columns, replicates + 1, channels): what the samples of each replicate bring, and the squares of what all
    bring, of all batches until now."""
    weights: Floats | None
    """(rows, columns): what a sample weighs at most, about; 0 for pixels that no light can reach. Of first batches."""
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


def status_codes(camera: CameraRecord) -> int:
    """How many numbers a ray's status can have."""
    return 8 * (camera.elements + 1)


def render_tile(
    context: RenderContext,
    tile: Tile,
    batch: Batch,
    truth: TruthRecord | None,
    before: Floats | None = None,
    stopped: Callable[[], bool] | None = None,
) -> TileResult | None:
    """A batch of samples of a tile's pixels, added to the sums of earlier batches: a pure function of its arguments.

    None where `stopped` says, between two bundles, that the result is no longer wanted.
    """
    camera, shape, certain = context.camera, (tile.rows, tile.columns), context.plan.runs(Stage.CERTAIN_LIGHT)
    fed = context.prepared.fed_pixels(tile, certain=certain)
    whole = np.zeros((tile.pixels, context.replicates + 1, context.channels))
    if before is not None:
        whole[:] = before.reshape(whole.shape)
    if camera.spread is None:
        sums: PixelSums | SharedSums = PixelSums(context, fed, batch, whole)
    else:
        sums = SharedSums(context, camera.spread, fed, batch, whole)
    tally = PathCounts(context, status_codes(camera))
    for parts in sums.passes():
        if not _added(context, parts, tally, tile, stopped):
            return None
    return TileResult(
        tile=tile,
        batch=batch,
        sums=whole.reshape(*shape, *whole.shape[1:]),
        weights=None if batch.first else _weights(camera, fed, tile),
        counts=tally.counts,
        truth=None if truth is None else _truth(context, truth, tile, tile.centres(camera), fed),
        paths=tally.paths,
        nonfinite=tally.nonfinite,
        lost_paths=tuple(tally.lost_paths),
        met=tally.met,
        light=tally.light,
        clamped=tally.clamped,
    )


def _added(
    context: RenderContext, parts: list[SamplingPass], tally: PathCounts, tile: Tile, stopped: Callable[[], bool] | None
) -> bool:
    """Follow the paths of a round and add what they bring; whether nothing stopped it."""
    integrator = None
    if context.scene is not None:
        from plenoptic.rendering.integrator.path import PathIntegrator

        integrator = PathIntegrator(context, min(BUNDLE, max(part.paths for part in parts)))
    for part in parts:
        ways = CameraPaths(context.camera, part.fed, part.batch, min(BUNDLE, part.paths))
        before = 0 if integrator is None else integrator.met
        # A tile without pixels has an empty bundle: it shows which kernels there will be.
        for start in range(0, part.paths, BUNDLE) if tile.pixels else (0,):
            if stopped is not None and stopped():
                return False
            n = min(BUNDLE, part.paths - start)
            bundle = ways.started(start, n)
            ways.fill_through_array(bundle)
            ways.fill_through_lens(bundle)
            if part.counted:
                fill_status_counts(tally.counts, bundle, n)
            radiance = None
            if integrator is not None:
                ways.fill_bent_at_iris(bundle, start, n)
                radiance = integrator.radiance(bundle, start, n, part.batch, part.fed.number, ways.waves)
            tally.clamp(part, bundle, radiance, n)
            tally.drop(part, bundle, radiance, start, n, part.fill(bundle, radiance, ways, start, n))
        if part.counted:
            tally.paths += part.paths
            tally.met += 0 if integrator is None else integrator.met - before
    return True


def _weights(camera: CameraRecord, fed: FedPixels, tile: Tile) -> Floats:
    """(rows, columns): what a sample of each pixel weighs at most, about: the area of its region over distance^2."""
    found = np.zeros(tile.pixels)
    found[fed.place] = fed.areas / camera.sensor.plane.distance**2
    return found.reshape(tile.rows, tile.columns)


def _truth(context: RenderContext, truth: TruthRecord, tile: Tile, pixels: Floats, fed: FedPixels) -> Arrays:
    if fed.around is not None:
        fed = fed_pixels(context.camera._replace(bend=None), pixels, tile.numbers(context.camera))
    rays = representative_rays(context.camera, pixels, fed)
    flat = truth_of(context.camera, context.scene, context.intersector, truth, pixels, rays)
    return {name: array.reshape(tile.rows, tile.columns, *array.shape[1:]) for name, array in flat.items()}
