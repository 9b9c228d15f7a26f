"""What the paths of a tile add up to in its pixels."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from plenoptic.camera.paths import CameraPaths
from plenoptic.camera.sampling.kernels.paths import path_place
from plenoptic.camera.sampling.pixel_regions import sharing_pixels
from plenoptic.camera.sampling.record import Batch, FedPixels, batch_record
from plenoptic.camera.sampling.spread import APART, EVERY, LEVELLING, Spread, levelling_numbers, rest_numbers, rest_of
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, WEIGHT
from plenoptic.core.values import Floats
from plenoptic.rendering.context import RenderContext
from plenoptic.rendering.kernels import film_sums
from plenoptic.rendering.settings import Sampler
from plenoptic.rendering.stats import NAMED


class Part(NamedTuple):
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
        self.parts = [Part(fed, batch, self._fill)]

    def _fill(self, bundle: Floats, radiance: Floats | None, ways: CameraPaths, start: int, n: int) -> int:
        light = film_sums.Light(bundle, radiance, ways.waves, self._weights)
        return int(film_sums.fill_sums(self._sums, light, start, n, self._batch))

    def finish(self) -> None:
        """Put the sums into `whole`."""
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
        self._spread, self._batch, self._whole, self._around = spread, batch, whole, fed.around
        self._weights = None if context.camera.colour is None else context.camera.colour.weights
        pixels, rows, channels = whole.shape
        places, to = len(fed.around.numbers), spread.table.parts.shape[1]
        self._shared = np.zeros((places, rows - 1, channels, to)), np.zeros((places, channels, to))
        self._drawn = np.zeros((pixels, rows - 1, channels)), np.zeros((pixels, channels))
        own, beside = sharing_pixels(context.camera, fed, spread.table)
        drawn = fed._replace(number=rest_numbers(fed.number), around=fed.around._replace(bend=spread.rest))
        self.parts = [
            Part(own, batch, self._sharing(own)),
            Part(drawn, rest_of(batch), self._fill_drawn),
            Part(beside, batch, self._sharing(beside), counted=False),
        ]
        self._rest, self._levels = self.parts[1].batch, None
        if context.scene is None and spread.table.means is not None:
            # Before all others, since these need it.
            self._levels = np.zeros(places)
            self.parts[:0] = [self._levelling(fed) for fed in (own, beside)]

    def _sharing(self, fed: FedPixels) -> Callable[[Floats, Floats | None, CameraPaths, int, int], int]:
        parts, batch = self._spread.table.parts, self._batch

        def fill(bundle: Floats, radiance: Floats | None, ways: CameraPaths, start: int, n: int) -> int:
            light, shares = film_sums.Light(bundle, radiance, ways.waves, self._weights), (ways.spots, parts)
            return int(film_sums.fill_shared(self._shared, fed.place, light, self._levels, shares, start, n, batch))

        return fill

    def _levelling(self, fed: FedPixels) -> Part:
        """Paths of their own, which tell about how light it is: the same whichever samples are rendered."""
        batch = batch_record(self._batch.seed, 0, LEVELLING, 1, 0, 0)

        def fill(bundle: Floats, _: Floats | None, ways: CameraPaths, start: int, n: int) -> int:
            film_sums.fill_levels(self._levels, fed.place, bundle, start, n, batch)
            return 0

        return Part(fed._replace(number=levelling_numbers(fed.number)), batch, fill, counted=False)

    def _fill_drawn(self, bundle: Floats, radiance: Floats | None, ways: CameraPaths, start: int, n: int) -> int:
        light = film_sums.Light(bundle, radiance, ways.waves, self._weights)
        return int(film_sums.fill_drawn(self._drawn, light, start, n, self._rest, self._batch, EVERY))

    def finish(self) -> None:
        """Add the sums to `whole`."""
        givers, known, means = self._around.givers, np.zeros(self._drawn[1].shape), self._spread.table.means
        if self._levels is not None and means is not None:
            known += self._levels[givers] @ means.T
        film_sums.fill_gathered(
            self._whole, self._shared, known, self._drawn, givers, self._batch, self._spread.drawn, EVERY
        )


def _by_replicate(sums: Floats, batch: Batch, replicates: int) -> Floats:
    """Sums of independent samples (pixels, samples, channels) as those of replicates: sample s belongs to s % r."""
    grouped = np.zeros((sums.shape[0], replicates + 1, sums.shape[2]))
    grouped[:, -1] = sums[:, -1]
    for replicate in range(min(replicates, batch.samples)):
        grouped[:, (batch.first + replicate) % replicates] = sums[:, replicate:-1:replicates].sum(axis=1)
    return grouped


class Tally:
    """What becomes of a tile's own paths."""

    def __init__(self, context: RenderContext, statuses: int) -> None:
        self._context = context
        self.counts = np.zeros(statuses, dtype=np.int64)
        self.met, self.nonfinite, self.light, self.clamped = 0, 0, 0.0, 0.0
        self.lost_paths: list[tuple[int, int, int]] = []

    def clamp(self, part: Part, bundle: Floats, radiance: Floats | None, n: int) -> None:
        """Clamp what the paths of a bundle bring."""
        limit = self._context.settings.clamp
        if limit is not None and radiance is not None:
            kept, removed = film_sums.fill_clamped(radiance, bundle, n, limit)
            if part.counted:
                self.light, self.clamped = self.light + kept + removed, self.clamped + removed

    def drop(self, part: Part, bundle: Floats, radiance: Floats | None, start: int, n: int, dropped: int) -> None:
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
