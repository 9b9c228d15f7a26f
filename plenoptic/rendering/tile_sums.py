"""What the paths of a tile add up to in its pixels."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from plenoptic.camera.paths import CameraPaths
from plenoptic.camera.sampling.kernels.paths import path_place
from plenoptic.camera.sampling.pixel_regions import sharing_pixels
from plenoptic.camera.sampling.record import Batch, FedPixels, batch_record
from plenoptic.camera.sampling.spread import APART, EVERY, LEVELLING, Spread, levelling_numbers, rest_numbers, rest_of
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, WEIGHT
from plenoptic.core.values import Floats
from plenoptic.rendering.context import RenderContext, batch_of
from plenoptic.rendering.kernels import film_sums
from plenoptic.rendering.settings import Sampler
from plenoptic.rendering.stats import NAMED


class SamplingPass(NamedTuple):
    """Paths of a tile that start alike."""

    fed: FedPixels
    batch: Batch
    fill: Callable[[Floats, Floats | None, CameraPaths, int, int], int]
    """Adds what a bundle brings, from a path on so many; returns how many contributions are left out, not finite."""
    counted: bool = True
    """Whether these are the tile's own: others are those of tiles beside it."""

    @property
    def paths(self) -> int:
        """How many there are."""
        return self.fed.place.size * self.batch.samples


class PixelSums:
    """The sums where light stays in its pixel, with those of earlier batches in `whole`, which they are added to."""

    def __init__(self, context: RenderContext, fed: FedPixels, batch: Batch, whole: Floats) -> None:
        self._fed, self._batch, self._whole = fed, batch, whole
        self._weights = None if context.camera.colour is None else context.camera.colour.weights
        self._grouped = context.settings.sampler is Sampler.RANDOM
        self._sums = whole[fed.place]
        if self._grouped:
            self._sums = np.zeros((fed.place.size, batch.streams + 1, whole.shape[2]))

    def _fill(self, bundle: Floats, radiance: Floats | None, ways: CameraPaths, start: int, n: int) -> int:
        light = film_sums.Light(bundle, radiance, ways.waves, self._weights)
        return int(film_sums.fill_sums(self._sums, light, start, n, self._batch))

    def passes(self) -> Iterator[list[SamplingPass]]:
        """Parts, to be gone through one by one; afterwards the sums are in `whole`."""
        yield [SamplingPass(self._fed, self._batch, self._fill)]
        place, sums = self._fed.place, self._sums
        if self._grouped:
            sums = self._whole[place] + _by_replicate(sums, self._batch, self._whole.shape[1] - 1)
        self._whole[place] = sums


class SharedSums:
    """The sums where light bends: of shares of the light that is headed to pixels and those beside them, and of what
    bends farther.
    """

    def __init__(self, context: RenderContext, spread: Spread, fed: FedPixels, batch: Batch, whole: Floats) -> None:
        assert fed.around is not None
        self._context, self._spread, self._batch, self._whole, self._around = context, spread, batch, whole, fed.around
        self._weights = None if context.camera.colour is None else context.camera.colour.weights
        self._own, self._beside = sharing_pixels(context.camera, fed, spread.table)
        self._drawn = fed._replace(number=rest_numbers(fed.number), around=fed.around._replace(bend=spread.rest))
        white = context.scene is None and spread.table.means is not None
        self._levels = np.zeros(len(fed.around.numbers)) if white else None

    def passes(self) -> Iterator[list[SamplingPass]]:
        """Parts, to be gone through one by one, those of a round together; afterwards the sums are in `whole`."""
        if self._levels is not None:
            # Before all others, since these need it.
            yield [self._levelling(fed) for fed in (self._own, self._beside)]
        for batch in self._pieces():
            pixels, rows, channels = self._whole.shape
            places, to = len(self._around.numbers), self._spread.table.parts.shape[1]
            shared = np.zeros((places, rows - 1, channels, to)), np.zeros((places, channels, to))
            drawn = np.zeros((pixels, rows - 1, channels)), np.zeros((pixels, channels))
            yield [
                self._sharing(shared, self._own, batch),
                self._drawing(drawn, batch),
                self._sharing(shared, self._beside, batch)._replace(counted=False),
            ]
            self._gather(shared, drawn, batch)

    def _pieces(self) -> Iterator[Batch]:
        """The batch, cut where any others are, so that sums are rounded alike."""
        begin, end, step = self._batch.first, self._batch.first + self._batch.samples, self._context.together
        cuts = [begin, *range((begin // step + 1) * step, end, step), end]
        return (batch_of(self._context, first, last - first) for first, last in pairwise(cuts))

    def _levelling(self, fed: FedPixels) -> SamplingPass:
        """Paths of their own, which tell about how light it is: the same whichever samples are rendered."""
        batch = batch_record(self._batch.seed, 0, LEVELLING, 1, 0, 0)

        def fill(bundle: Floats, _: Floats | None, ways: CameraPaths, start: int, n: int) -> int:
            film_sums.fill_pilot_means(self._levels, fed.place, bundle, start, n, batch)
            return 0

        return SamplingPass(fed._replace(number=levelling_numbers(fed.number)), batch, fill, counted=False)

    def _sharing(self, sums: tuple[Floats, Floats], fed: FedPixels, batch: Batch) -> SamplingPass:
        """Paths to pixels, whose light is shared."""
        parts = self._spread.table.parts

        def fill(bundle: Floats, radiance: Floats | None, ways: CameraPaths, start: int, n: int) -> int:
            light, shares = film_sums.Light(bundle, radiance, ways.waves, self._weights), (ways.spots, parts)
            return int(film_sums.fill_kernel_sums(sums, fed.place, light, self._levels, shares, start, n, batch))

        return SamplingPass(fed, batch, fill)

    def _drawing(self, sums: tuple[Floats, Floats], batch: Batch) -> SamplingPass:
        """Paths whose bends are drawn."""
        rest = rest_of(batch)

        def fill(bundle: Floats, radiance: Floats | None, ways: CameraPaths, start: int, n: int) -> int:
            light = film_sums.Light(bundle, radiance, ways.waves, self._weights)
            return int(film_sums.fill_drawn(sums, light, start, n, rest, batch, EVERY))

        return SamplingPass(self._drawn, rest, fill)

    def _gather(self, shared: tuple[Floats, Floats], drawn: tuple[Floats, Floats], batch: Batch) -> None:
        """Add what pixels get to `whole`."""
        givers, known, means = self._around.givers, np.zeros(drawn[1].shape), self._spread.table.means
        if self._levels is not None and means is not None:
            known += self._levels[givers] @ means.T
        film_sums.fill_pixel_totals(self._whole, shared, known, drawn, givers, batch, self._spread.drawn, EVERY)


def _by_replicate(sums: Floats, batch: Batch, replicates: int) -> Floats:
    """Sums of independent samples (pixels, samples, channels) as those of replicates: sample s belongs to s % r."""
    grouped = np.zeros((sums.shape[0], replicates + 1, sums.shape[2]))
    grouped[:, -1] = sums[:, -1]
    for replicate in range(min(replicates, batch.samples)):
        grouped[:, (batch.first + replicate) % replicates] = sums[:, replicate:-1:replicates].sum(axis=1)
    return grouped


class PathCounts:
    """What becomes of a tile's own paths."""

    def __init__(self, context: RenderContext, statuses: int) -> None:
        self._context = context
        self.counts = np.zeros(statuses, dtype=np.int64)
        self.paths, self.met, self.nonfinite, self.light, self.clamped = 0, 0, 0, 0.0, 0.0
        self.lost_paths: list[tuple[int, int, int]] = []

    def clamp(self, part: SamplingPass, bundle: Floats, radiance: Floats | None, n: int) -> None:
        """Clamp what the paths of a bundle bring."""
        limit = self._context.settings.clamp
        if limit is not None and radiance is not None:
            kept, removed = film_sums.clamp_radiance(radiance, bundle, n, limit)
            if part.counted:
                self.light, self.clamped = self.light + kept + removed, self.clamped + removed

    def drop(
        self, part: SamplingPass, bundle: Floats, radiance: Floats | None, start: int, n: int, dropped: int
    ) -> None:
        """Count contributions that are not finite, and name the first of a bundle by row, column and sample."""
        if not dropped or not part.counted:
            return
        self.nonfinite += dropped
        batch, light = part.batch, bundle.reshape(-1, RAY // BLOCK, BLOCK)[:, WEIGHT // BLOCK].ravel()[:n, None]
        with np.errstate(all="ignore"):
            light = light if radiance is None else light * radiance
        columns = self._context.camera.sensor.columns
        for k in np.flatnonzero(~np.isfinite(light).all(axis=1))[: NAMED - len(self.lost_paths)]:
            pixel, stream, index = path_place(start + int(k), batch.samples, batch.streams)
            sample = batch.first_stream + stream + (batch.first_index + index) * self._context.replicates
            number = int(part.fed.number[pixel])
            if number < APART:  # drawn bends are not replayed
                self.lost_paths.append((*divmod(number, columns), int(sample)))
