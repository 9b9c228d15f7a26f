"""Sums of the light of a tile's paths over its pixels."""

from __future__ import annotations

import enum
from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from plenoptic.camera.camera_rays import CameraRays
from plenoptic.camera.sampling.aperture_regions import kernel_source_pixels
from plenoptic.camera.sampling.diffraction_kernel import (
    DEFLECTION_INTERVAL,
    NUMBER_OFFSET,
    PILOT_SAMPLES,
    pilot_numbers,
    remainder_batch,
    remainder_numbers,
)
from plenoptic.camera.sampling.kernels.path_numbers import path_indices
from plenoptic.camera.sampling.sampling_records import Batch, IlluminatedPixels, batch_record
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, WEIGHT
from plenoptic.core.values import Floats
from plenoptic.rendering.context import RenderContext, batch_of
from plenoptic.rendering.kernels import film_sums
from plenoptic.rendering.settings import Sampler
from plenoptic.rendering.stats import NAMED


class PassKind(enum.Enum):
    """Destination of the light of a pass."""

    PIXELS = enum.auto()
    """The pixel on which a path starts."""
    PILOT = enum.auto()
    """The pilot mean of that pixel; not the image."""
    KERNEL = enum.auto()
    """The pixels around it, by the diffraction kernel."""
    DEFLECTED = enum.auto()
    """The pixel from which a sampled deflection leads to the start."""


class SamplingPass(NamedTuple):
    """Paths of a tile that are sampled and added alike."""

    kind: PassKind
    illuminated: IlluminatedPixels
    batch: Batch
    sums: Any
    """Arrays to which the kernel of this kind adds."""
    is_own: bool = True
    """True if the paths count in the tile's statistics, False for pilots and for paths of neighbouring pixels."""
    pilot_mean: Floats | None = None
    """Of KERNEL: control variate, mean light of the source pixels; None without one."""
    image_batch: Batch | None = None
    """Of DEFLECTED: the batch of the image to which the paths contribute."""

    @property
    def paths(self) -> int:
        """Number of paths."""
        return self.illuminated.place.size * self.batch.samples


Trace = Callable[[list[SamplingPass]], bool]
"""Traces passes and adds their light to their sums; returns False if stopped."""


def add_bundle(
    context: RenderContext,
    of_pass: SamplingPass,
    bundle: Floats,
    radiance: Floats | None,
    rays: CameraRays,
    paths: tuple[int, int],
) -> int:
    """Add the light of a bundle to the sums of its pass; returns the number of non-finite contributions.

    `paths` are the bundle's first path in the pass, and their number; `radiance` is None for white images.
    """
    start, n = paths
    sums, place, batch = of_pass.sums, of_pass.illuminated.place, of_pass.batch
    if of_pass.kind is PassKind.PILOT:
        film_sums.fill_pilot_means(sums, place, bundle, start, n, batch)
        return 0
    colour = context.camera.colour
    light = film_sums.Light(bundle, radiance, rays.waves, None if colour is None else colour.weights)
    if of_pass.kind is PassKind.KERNEL:
        assert context.camera.diffraction_kernel is not None
        kernel = rays.kernel_rows, context.camera.diffraction_kernel.table.weights
        return int(film_sums.fill_kernel_sums(sums, place, light, of_pass.pilot_mean, kernel, start, n, batch))
    if of_pass.kind is PassKind.DEFLECTED:
        image_batch, every = of_pass.image_batch, DEFLECTION_INTERVAL
        return int(film_sums.fill_deflected_sums(sums, light, start, n, batch, image_batch, every))
    return int(film_sums.fill_sums(sums, light, start, n, batch))


def add_pixels(
    context: RenderContext, illuminated: IlluminatedPixels, batch: Batch, whole: Floats, trace: Trace
) -> bool:
    """Add a batch of a tile without diffraction to its sums `whole`; returns False if stopped.

    `whole` (pixels, replicates + 1, channels) holds the sums of earlier batches.
    """
    place = illuminated.place
    is_random = context.settings.sampler is Sampler.RANDOM
    sums = np.zeros((place.size, batch.streams + 1, whole.shape[2])) if is_random else whole[place]
    if not trace([SamplingPass(PassKind.PIXELS, illuminated, batch, sums)]):
        return False
    whole[place] = whole[place] + _by_replicate(sums, batch, whole.shape[1] - 1) if is_random else sums
    return True


def add_with_diffraction(
    context: RenderContext, illuminated: IlluminatedPixels, batch: Batch, whole: Floats, trace: Trace
) -> bool:
    """Add a batch of a tile with diffraction to its sums `whole`, see `add_pixels`.

    Small deflections are distributed by a kernel from the tile's pixels and their neighbours, large ones are sampled.
    """
    kernel, sources = context.camera.diffraction_kernel, illuminated.sources
    assert kernel is not None and sources is not None
    of_tile, of_neighbours = kernel_source_pixels(context.camera, illuminated, kernel.table)
    deflected = illuminated._replace(
        number=remainder_numbers(illuminated.number), sources=sources._replace(deflection=kernel.remainder)
    )
    pilot_mean = None
    if context.scene is None and kernel.table.means is not None:
        pilot_mean = np.zeros(len(sources.numbers))  # the control variate of all other passes
        if not trace([_pilot_pass(pixels, batch, pilot_mean) for pixels in (of_tile, of_neighbours)]):
            return False
    pixels, rows, channels = whole.shape
    targets = kernel.table.weights.shape[1]
    for part in _parts(context, batch):
        n = len(sources.numbers)
        spread = np.zeros((n, rows - 1, channels, targets)), np.zeros((n, channels, targets))
        sampled = np.zeros((pixels, rows - 1, channels)), np.zeros((pixels, channels))
        passes = [
            SamplingPass(PassKind.KERNEL, of_tile, part, spread, pilot_mean=pilot_mean),
            SamplingPass(PassKind.DEFLECTED, deflected, remainder_batch(part), sampled, image_batch=part),
            SamplingPass(PassKind.KERNEL, of_neighbours, part, spread, is_own=False, pilot_mean=pilot_mean),
        ]
        if not trace(passes):
            return False
        control_variate = np.zeros((pixels, channels))
        if pilot_mean is not None and kernel.table.means is not None:
            control_variate += pilot_mean[sources.kernel_sources] @ kernel.table.means.T
        gathered = whole, spread, control_variate, sampled, sources.kernel_sources, part
        film_sums.fill_pixel_totals(*gathered, kernel.remainder_share, DEFLECTION_INTERVAL)
    return True


def _pilot_pass(illuminated: IlluminatedPixels, batch: Batch, pilot_mean: Floats) -> SamplingPass:
    """Pilot paths, independent of the rendered samples, that estimate the control variate."""
    pilots = illuminated._replace(number=pilot_numbers(illuminated.number))
    return SamplingPass(
        PassKind.PILOT, pilots, batch_record(batch.seed, 0, PILOT_SAMPLES, 1, 0, 0), pilot_mean, is_own=False
    )


def _parts(context: RenderContext, batch: Batch) -> list[Batch]:
    """The batch, cut at the batch boundaries of any schedule, so that sums are rounded alike."""
    begin, end, step = batch.first, batch.first + batch.samples, context.together
    cuts = [begin, *range((begin // step + 1) * step, end, step), end]
    return [batch_of(context, first, last - first) for first, last in pairwise(cuts)]


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

    def clamp(self, of_pass: SamplingPass, bundle: Floats, radiance: Floats | None, n: int) -> None:
        """Clamp the radiance of the paths of a bundle."""
        limit = self._context.settings.clamp
        if limit is not None and radiance is not None:
            remaining, removed = film_sums.clamp_radiance(radiance, bundle, n, limit)
            if of_pass.is_own:
                self.light, self.clamped = self.light + remaining + removed, self.clamped + removed

    def drop(
        self, of_pass: SamplingPass, bundle: Floats, radiance: Floats | None, start: int, n: int, dropped: int
    ) -> None:
        """Count non-finite contributions, and record row, column and sample of the first ones of a bundle."""
        if not dropped or not of_pass.is_own:
            return
        self.nonfinite += dropped
        batch = of_pass.batch
        light = bundle.reshape(-1, RAY // BLOCK, BLOCK)[:, WEIGHT // BLOCK].ravel()[:n, None]
        with np.errstate(all="ignore"):
            light = light if radiance is None else light * radiance
        columns = self._context.camera.sensor.columns
        for k in np.flatnonzero(~np.isfinite(light).all(axis=1))[: NAMED - len(self.lost_paths)]:
            pixel, stream, index = path_indices(start + int(k), batch.samples, batch.streams)
            sample = batch.first_stream + stream + (batch.first_index + index) * self._context.replicates
            number = int(of_pass.illuminated.number[pixel])
            if number < NUMBER_OFFSET:  # sampled deflections cannot be replayed
                self.lost_paths.append((*divmod(number, columns), int(sample)))
