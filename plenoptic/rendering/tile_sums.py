"""Sums of the light of a tile's paths over its pixels."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from plenoptic.camera.camera_rays import CameraRays
from plenoptic.camera.sampling.aperture_regions import kernel_source_pixels
from plenoptic.camera.sampling.diffraction_kernel import (
    DEFLECTION_INTERVAL,
    NUMBER_OFFSET,
    PILOT_SAMPLES,
    DiffractionKernel,
    pilot_numbers,
    remainder_batch,
    remainder_numbers,
)
from plenoptic.camera.sampling.kernels.camera_samples import path_indices
from plenoptic.camera.sampling.sampling_records import Batch, IlluminatedPixels, batch_record
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, WEIGHT
from plenoptic.core.values import Floats
from plenoptic.rendering.context import RenderContext, batch_of
from plenoptic.rendering.kernels import film_sums
from plenoptic.rendering.settings import Sampler
from plenoptic.rendering.stats import NAMED


class SamplingPass(NamedTuple):
    """Paths of a tile that are sampled and added alike."""

    fed: IlluminatedPixels
    batch: Batch
    fill: Callable[[Floats, Floats | None, CameraRays, int, int], int]
    """Adds a bundle (bundle, radiance, camera rays, first path, number); returns the count of non-finite contributions.
    """
    counted: bool = True
    """True if the paths belong to the tile, and not to neighbouring tiles."""

    @property
    def paths(self) -> int:
        """Number of paths."""
        return self.fed.place.size * self.batch.samples


class PixelSums:
    """Sums of a tile without diffraction, starting from those of earlier batches in `whole`, which it updates."""

    def __init__(self, context: RenderContext, fed: IlluminatedPixels, batch: Batch, whole: Floats) -> None:
        self._fed, self._batch, self._whole = fed, batch, whole
        self._weights = None if context.camera.colour is None else context.camera.colour.weights
        self._independent = context.settings.sampler is Sampler.RANDOM
        self._sums = whole[fed.place]
        if self._independent:
            self._sums = np.zeros((fed.place.size, batch.streams + 1, whole.shape[2]))

    def _fill(self, bundle: Floats, radiance: Floats | None, camera_rays: CameraRays, start: int, n: int) -> int:
        light = film_sums.Light(bundle, radiance, camera_rays.waves, self._weights)
        return int(film_sums.fill_sums(self._sums, light, start, n, self._batch))

    def passes(self) -> Iterator[list[SamplingPass]]:
        """The passes to be traced. When the generator is resumed after the last one, it writes the sums to `whole`."""
        yield [SamplingPass(self._fed, self._batch, self._fill)]
        place, sums = self._fed.place, self._sums
        if self._independent:
            sums = self._whole[place] + _by_replicate(sums, self._batch, self._whole.shape[1] - 1)
        self._whole[place] = sums


class SharedSums:
    """Sums of a tile with diffraction: light spread by kernels over nearby pixels, and sampled large deflections."""

    def __init__(
        self, context: RenderContext, spread: DiffractionKernel, fed: IlluminatedPixels, batch: Batch, whole: Floats
    ) -> None:
        assert fed.sources is not None
        self._context, self._spread, self._batch, self._whole, self._around = context, spread, batch, whole, fed.sources
        self._weights = None if context.camera.colour is None else context.camera.colour.weights
        self._tile_pixels, self._neighbour_pixels = kernel_source_pixels(context.camera, fed, spread.table)
        self._drawn = fed._replace(
            number=remainder_numbers(fed.number), sources=fed.sources._replace(deflection=spread.remainder)
        )
        white = context.scene is None and spread.table.means is not None
        self._pilot_mean = np.zeros(len(fed.sources.numbers)) if white else None

    def passes(self) -> Iterator[list[SamplingPass]]:
        """Lists of passes to be traced together. The generator adds each list's sums to `whole` when it is resumed."""
        if self._pilot_mean is not None:
            # The pilot means are the control variate of all other passes.
            yield [self._pilot_pass(fed) for fed in (self._tile_pixels, self._neighbour_pixels)]
        for batch in self._pieces():
            pixels, rows, channels = self._whole.shape
            places, to = len(self._around.numbers), self._spread.table.weights.shape[1]
            shared = np.zeros((places, rows - 1, channels, to)), np.zeros((places, channels, to))
            drawn = np.zeros((pixels, rows - 1, channels)), np.zeros((pixels, channels))
            yield [
                self._kernel_pass(shared, self._tile_pixels, batch),
                self._deflection_pass(drawn, batch),
                self._kernel_pass(shared, self._neighbour_pixels, batch)._replace(counted=False),
            ]
            self._gather(shared, drawn, batch)

    def _pieces(self) -> Iterator[Batch]:
        """The batch, cut at the batch boundaries of any schedule, so that sums are rounded alike."""
        begin, end, step = self._batch.first, self._batch.first + self._batch.samples, self._context.together
        cuts = [begin, *range((begin // step + 1) * step, end, step), end]
        return (batch_of(self._context, first, last - first) for first, last in pairwise(cuts))

    def _pilot_pass(self, fed: IlluminatedPixels) -> SamplingPass:
        """Pilot paths, independent of the rendered samples, that estimate the control variate."""
        batch = batch_record(self._batch.seed, 0, PILOT_SAMPLES, 1, 0, 0)

        def fill(bundle: Floats, _: Floats | None, camera_rays: CameraRays, start: int, n: int) -> int:
            film_sums.fill_pilot_means(self._pilot_mean, fed.place, bundle, start, n, batch)
            return 0

        return SamplingPass(fed._replace(number=pilot_numbers(fed.number)), batch, fill, counted=False)

    def _kernel_pass(self, sums: tuple[Floats, Floats], fed: IlluminatedPixels, batch: Batch) -> SamplingPass:
        """Paths whose light is distributed over pixels by the kernel."""
        kernel_rows = self._spread.table.weights

        def fill(bundle: Floats, radiance: Floats | None, camera_rays: CameraRays, start: int, n: int) -> int:
            light, weights = (
                film_sums.Light(bundle, radiance, camera_rays.waves, self._weights),
                camera_rays.kernel_rows,
            )
            added = sums, fed.place, light, self._pilot_mean, (weights, kernel_rows)
            return int(film_sums.fill_kernel_sums(*added, start, n, batch))

        return SamplingPass(fed, batch, fill)

    def _deflection_pass(self, sums: tuple[Floats, Floats], batch: Batch) -> SamplingPass:
        """Paths with sampled deflections."""
        deflections = remainder_batch(batch)

        def fill(bundle: Floats, radiance: Floats | None, camera_rays: CameraRays, start: int, n: int) -> int:
            light = film_sums.Light(bundle, radiance, camera_rays.waves, self._weights)
            return int(film_sums.fill_deflected_sums(sums, light, start, n, deflections, batch, DEFLECTION_INTERVAL))

        return SamplingPass(self._drawn, deflections, fill)

    def _gather(self, shared: tuple[Floats, Floats], drawn: tuple[Floats, Floats], batch: Batch) -> None:
        """Add the totals of the pixels to `whole`."""
        sources, control_variate, means = (
            self._around.kernel_sources,
            np.zeros(drawn[1].shape),
            self._spread.table.means,
        )
        if self._pilot_mean is not None and means is not None:
            control_variate += self._pilot_mean[sources] @ means.T
        weight = self._spread.remainder_share
        film_sums.fill_pixel_totals(
            self._whole, shared, control_variate, drawn, sources, batch, weight, DEFLECTION_INTERVAL
        )


def _by_replicate(sums: Floats, batch: Batch, replicates: int) -> Floats:
    """Sum independent samples (pixels, samples, channels) by replicate: sample s belongs to s % r."""
    grouped = np.zeros((sums.shape[0], replicates + 1, sums.shape[2]))
    grouped[:, -1] = sums[:, -1]
    for replicate in range(min(replicates, batch.samples)):
        grouped[:, (batch.first + replicate) % replicates] = sums[:, replicate:-1:replicates].sum(axis=1)
    return grouped


class PathCounts:
    """Statistics of a tile's own paths."""

    def __init__(self, context: RenderContext, statuses: int) -> None:
        self._context = context
        self.counts = np.zeros(statuses, dtype=np.int64)
        self.paths, self.scene_hits, self.nonfinite, self.light, self.clamped = 0, 0, 0, 0.0, 0.0
        self.lost_paths: list[tuple[int, int, int]] = []

    def clamp(self, pass_: SamplingPass, bundle: Floats, radiance: Floats | None, n: int) -> None:
        """Clamp the radiance of the paths of a bundle."""
        limit = self._context.settings.clamp
        if limit is not None and radiance is not None:
            remaining, removed = film_sums.clamp_radiance(radiance, bundle, n, limit)
            if pass_.counted:
                self.light, self.clamped = self.light + remaining + removed, self.clamped + removed

    def drop(
        self, pass_: SamplingPass, bundle: Floats, radiance: Floats | None, start: int, n: int, dropped: int
    ) -> None:
        """Count non-finite contributions, and record row, column and sample of the first ones of a bundle."""
        if not dropped or not pass_.counted:
            return
        self.nonfinite += dropped
        batch = pass_.batch
        light = bundle.reshape(-1, RAY // BLOCK, BLOCK)[:, WEIGHT // BLOCK].ravel()[:n, None]
        with np.errstate(all="ignore"):
            light = light if radiance is None else light * radiance
        columns = self._context.camera.sensor.columns
        for k in np.flatnonzero(~np.isfinite(light).all(axis=1))[: NAMED - len(self.lost_paths)]:
            pixel, stream, index = path_indices(start + int(k), batch.samples, batch.streams)
            sample = batch.first_stream + stream + (batch.first_index + index) * self._context.replicates
            number = int(pass_.fed.number[pixel])
            if number < NUMBER_OFFSET:  # sampled deflections cannot be replayed
                self.lost_paths.append((*divmod(number, columns), int(sample)))
