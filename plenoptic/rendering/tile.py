"""A tile, the unit of work: a rectangle of pixels through all stages, as a pure function."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera_rays import CameraRays
from plenoptic.camera.camera_record import CameraRecord
from plenoptic.camera.sampling.aperture_regions import illuminated_pixels, pixel_centres
from plenoptic.camera.sampling.diffraction_kernel import DEFLECTION_INTERVAL
from plenoptic.camera.sampling.sampling_records import Batch, IlluminatedPixels
from plenoptic.core.kernels.bundles import fill_status_counts
from plenoptic.core.values import Floats
from plenoptic.rendering.context import RenderContext
from plenoptic.rendering.plan.stages import Stage
from plenoptic.rendering.tile_sums import PathCounts, SamplingPass, add_bundle, add_pixels, add_with_diffraction
from plenoptic.truth.ground_truth import Arrays, compute_truth
from plenoptic.truth.representative_rays import representative_rays
from plenoptic.truth.truth_stages import TruthRecord

BUNDLE = 1 << 14
"""Paths that are traced together. Half as many take 2 % longer for white images and the still life, and 8 % longer for
`objects`, whose paths end one by one. Twice as many take as long, and twice the memory.
"""
_GHOST_BUNDLE = 4 * BUNDLE
"""Paths of ghosts that are traced together: each pair of surfaces fills blocks of its own, the last one in part."""


class Tile(NamedTuple):
    """A rectangle of pixels of the sensor."""

    row: int
    column: int
    rows: int
    columns: int

    @property
    def pixels(self) -> int:
        """Number of pixels."""
        return self.rows * self.columns

    def centres(self, camera: CameraRecord) -> Floats:
        """Pixel centres (rows * columns, 2); see `pixel_centres`."""
        return pixel_centres(camera, (self.row, self.row + self.rows), (self.column, self.column + self.columns))

    def numbers(self, camera: CameraRecord) -> NDArray[np.int64]:
        """Pixel numbers (rows * columns,) on the whole sensor."""
        row, column = np.divmod(np.arange(self.pixels), self.columns)
        return (self.row + row) * camera.sensor.columns + self.column + column


class TileResult(NamedTuple):
    """Result of a batch of samples of a tile."""

    tile: Tile
    batch: Batch
    sums: Floats
    """(rows, columns, replicates + 1, channels): sums of each replicate, and sums of squares, over all batches so far.
    """
    weights: Floats | None
    """(rows, columns): approximate upper bound of a sample's weight, 0 for pixels without light. Of first batches only.
    """
    counts: NDArray[np.int64]
    """Number of paths by status."""
    truth: Arrays | None
    """(rows, columns, ...) by name; None if no truth is requested."""
    paths: int
    """Number of sampled paths."""
    nonfinite: int
    lost_paths: tuple[tuple[int, int, int], ...]
    """Row, column and sample of the first non-finite paths."""
    scene_hits: int
    """Number of paths that hit the scene."""
    light: float
    """Total light of the paths."""
    clamped: float
    """Total light removed by clamping."""


def status_codes(camera: CameraRecord) -> int:
    """Number of possible values of a ray's status."""
    return 8 * (camera.elements + 1)


def render_tile(
    context: RenderContext,
    tile: Tile,
    batch: Batch,
    truth: TruthRecord | None,
    before: Floats | None = None,
    stopped: Callable[[], bool] | None = None,
) -> TileResult | None:
    """Render a batch of samples of a tile and add it to the sums of earlier batches: a pure function of its arguments.

    Returns None if `stopped` returns True between two bundles: the result is no longer needed.
    """
    camera, shape, with_core = context.camera, (tile.rows, tile.columns), context.plan.runs(Stage.UNVIGNETTED_CORE)
    illuminated = context.prepared.illuminated_pixels(tile, with_core=with_core)
    whole = np.zeros((tile.pixels, context.replicates + 1, context.channels))
    if before is not None:
        whole[:] = before.reshape(whole.shape)
    statistics = PathCounts(context, status_codes(camera))
    trace = functools.partial(_trace_passes, context, statistics, tile, stopped)
    add = add_pixels if camera.diffraction_kernel is None else add_with_diffraction
    if not add(context, illuminated, batch, whole, trace):
        return None
    return TileResult(
        tile=tile,
        batch=batch,
        sums=whole.reshape(*shape, *whole.shape[1:]),
        weights=None if batch.first else _weights(camera, illuminated, tile),
        counts=statistics.counts,
        truth=None if truth is None else _truth(context, truth, tile, tile.centres(camera), illuminated),
        paths=statistics.paths,
        nonfinite=statistics.nonfinite,
        lost_paths=tuple(statistics.lost_paths),
        scene_hits=statistics.scene_hits,
        light=statistics.light,
        clamped=statistics.clamped,
    )


def _trace_passes(
    context: RenderContext,
    statistics: PathCounts,
    tile: Tile,
    stopped: Callable[[], bool] | None,
    passes: list[SamplingPass],
) -> bool:
    """Trace the paths of passes from the sensor into the scene and add their light; return False if stopped."""
    integrator, most = None, BUNDLE if context.camera.ghosts is None else _GHOST_BUNDLE
    if context.scene is not None:
        from plenoptic.rendering.integrator.path import PathIntegrator

        integrator = PathIntegrator(context, min(most, max(of_pass.paths for of_pass in passes)))
    for of_pass in passes:
        illuminated, batch = of_pass.illuminated, of_pass.batch
        rays = CameraRays(context.camera, illuminated, batch, min(most, of_pass.paths))
        hits_before = 0 if integrator is None else integrator.scene_hits
        # A tile without pixels has one empty bundle, which compiles the kernels.
        for start in range(0, of_pass.paths, most) if tile.pixels else (0,):
            if stopped is not None and stopped():
                return False
            n = min(most, of_pass.paths - start)
            bundle = rays.sample(start, n)
            rays.fill_through_array(bundle)
            rays.fill_through_lens(bundle)
            if of_pass.is_own:
                fill_status_counts(statistics.counts, bundle, n)
            radiance = None
            if integrator is not None:
                rays.fill_iris_deflections(bundle, start, n)
                radiance = integrator.radiance(bundle, start, n, batch, illuminated.number, rays.waves)
            statistics.clamp(of_pass, bundle, radiance, n)
            nonfinite = add_bundle(context, of_pass, bundle, radiance, rays, (start, n))
            statistics.drop(of_pass, bundle, radiance, start, n, nonfinite)
        if of_pass.is_own:
            statistics.paths += of_pass.paths
            statistics.scene_hits += 0 if integrator is None else integrator.scene_hits - hits_before
    return True


def _weights(camera: CameraRecord, illuminated: IlluminatedPixels, tile: Tile) -> Floats:
    """Approximate maximum weight (rows, columns) of a pixel's samples: area of its region over distance^2."""
    weights = np.zeros(tile.pixels)
    weights[illuminated.place] = illuminated.areas / camera.sensor.plane.distance**2
    if camera.diffraction_kernel is not None:
        weights *= DEFLECTION_INTERVAL * camera.diffraction_kernel.remainder_share
    return weights.reshape(tile.rows, tile.columns)


def _truth(
    context: RenderContext, truth: TruthRecord, tile: Tile, pixels: Floats, illuminated: IlluminatedPixels
) -> Arrays:
    if illuminated.sources is not None:
        illuminated = illuminated_pixels(context.camera._replace(deflection=None), pixels, tile.numbers(context.camera))
    rays = representative_rays(context.camera, pixels, illuminated)
    flat = compute_truth(context.camera, context.scene, context.intersector, truth, pixels, rays)
    return {name: array.reshape(tile.rows, tile.columns, *array.shape[1:]) for name, array in flat.items()}
