"""Outcome of a render: the exposure, the reason for which it ended, and warnings."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.lost_rays import lost_rays
from plenoptic.core.relative_error import brightness, image_error
from plenoptic.core.warn import warn
from plenoptic.errors import BudgetWarning
from plenoptic.optics.lens.analysis.conditioning import Conditioning
from plenoptic.rendering.exposure import MOST_NAMES, Exposure
from plenoptic.rendering.plan.rare_light import RareLight, rare_light
from plenoptic.rendering.plan.stages import Subject
from plenoptic.rendering.schedule.progress import Progress
from plenoptic.rendering.stats import RenderStats, StopReason
from plenoptic.truth.channels import GroundTruth
from plenoptic.truth.truth_arrays import mark_unknown

Image = NDArray[Any]
_UNMET_PATHS = 8
"""Paths to a rare light whose contribution may be missing."""
_MISSED_RATIO = 1.25
"""Ratio of the final error to its target that causes a warning."""
_OVERRUN, _OVERRUN_SECONDS = 0.1, 0.5
"""Overrun of a time limit, relative and in seconds, that causes no warning."""
_MOST_OF_PARTICLES = 0.6
"""Fraction of a time limit beyond which particles are the cause of a late render."""


def warn_if_late(progress: Progress | None, limit: float | None, seconds: float, particle_seconds: float) -> None:
    """Warn of a time limit in s that was missed by far, or too short for all tiles; None for particles alone."""
    if limit is None:
        return
    remedy = "set-up, compilation on first use, and finishing take long; give more time"
    pixels = "without the light of surfaces" if particle_seconds else "black"
    if particle_seconds > _MOST_OF_PARTICLES * limit:
        remedy = f"its particles took {particle_seconds:.3g} s; give more time or fewer particles"
    begun_fraction = 1.0 if progress is None else float((progress.done > 0).mean())
    if not begun_fraction:
        warn(f"nothing has been rendered within {limit:g} s, and the image is {pixels}: {remedy}", BudgetWarning)
    elif begun_fraction < 1:
        warn(
            f"only {math.floor(100 * begun_fraction)} % of the tiles were begun within {limit:g} s; the other pixels "
            f"are {pixels}, with infinite errors",
            BudgetWarning,
        )
    elif seconds > limit + max(_OVERRUN * limit, _OVERRUN_SECONDS):
        warn(f"rendering took {seconds:.3g} s instead of {limit:g} s: {remedy}", BudgetWarning)


def _unmet_light(
    progress: Progress, image: Image, counts: NDArray[np.int32] | None, rare: RareLight | None, clamp: float | None
) -> float:
    """Fraction of all light that 8 paths to a rare light would have brought: none of them may be in the image.

    Zero of 3 expected paths have a probability of 5 %; their caustics cover a part of the image, where they count more.
    """
    if rare is None or progress.one_sample is None:
        return 0.0
    paths = image[..., 0].size * progress.budget.max_samples if counts is None else int(counts.sum())
    radiance = min(rare.radiance, math.inf if clamp is None else clamp)
    contributions = progress.one_sample[progress.region.crop] * (radiance / progress.region.radiance)
    unmet = _UNMET_PATHS * float(contributions.sum(dtype=np.float64)) / max(paths, 1)
    total = unmet + float(brightness(image).sum())
    return unmet / total if total > 0 else 0.0


def _reason(progress: Progress, image: Image, errors: Image | None, *, interrupted: bool) -> StopReason:
    """Reason for which the render ended, with a warning if it missed the target error."""
    target = progress.budget.target_error
    if interrupted:  # even if all was done at that moment, so that loops of renders notice it
        return StopReason.INTERRUPTED
    if progress.pending():
        return StopReason.TIME_LIMIT
    if progress.capped or target is None:
        return StopReason.SAMPLES
    assert errors is not None
    reached, rare, _ = image_error(image, errors)
    if not (rare or _MISSED_RATIO * target < reached):  # nan if no pixel can be lit
        return StopReason.TARGET_ERROR
    target_text = f"{100 * target:.2g} %"
    if rare:
        warn(
            f"light is so rare that few pixels have sampled it: the error is {100 * reached:.2g} % or more, and may "
            f"exceed {target_text}; give samples, a larger lamp or caustics=pl.rendering.Caustics.EXCLUDE",
            BudgetWarning,
        )
    elif reached < math.inf:  # otherwise the image is black, which has its own warning
        warn(
            f"the error reached is {100 * reached:.2g} % instead of {target_text}: light comes by rare paths, or "
            "too few pixels are lit to decide for each other; give samples",
            BudgetWarning,
        )
    return StopReason.TARGET_MISSED


def exposure_of(
    progress: Progress,
    subject: Subject,
    region: tuple[int, int, int, int] | None,
    seed: int,
    workers: int,
    conditioning: Conditioning | None,
    *,
    interrupted: bool,
) -> Exposure:
    """Exposure of the requested region, None for the whole sensor. Takes ownership of the film's arrays."""
    film, counts, crop = progress.film, progress.sample_counts(), progress.region.crop
    if counts is not None:
        mark_unknown(progress.truth, counts == 0)
    zero_variance = _zero_variance_pixels(progress, counts)
    error = film.standard_error(progress.one_sample, deflected=progress.region.deflected, out=film.between)
    film.between = film.within = None
    image, errors = _crop(film.mean, crop), None if error is None else _crop(error, crop)
    truth = {name: _crop(array, crop) for name, array in progress.truth.items()}
    counts = None if counts is None else counts[crop]
    max_samples = progress.budget.max_samples if counts is None else int(counts.max())
    names = subject.scene.object_names if subject.scene is not None and "object" in progress.truth else None
    rare = rare_light(subject.scene, subject.settings)
    unmet_light = _unmet_light(progress, image, counts, rare, subject.settings.clamp)
    reason = _reason(progress, image, errors, interrupted=interrupted)
    if rare is not None and errors is not None and image_error(image, errors).misses(unmet_light) and not interrupted:
        reason = StopReason.TARGET_MISSED if reason is StopReason.TARGET_ERROR else reason
        warn(
            f"{rare.light} reaches matt surfaces by way of {rare.mesh}, where one ray in {rare.rays:.2g} meets it by "
            f"chance: up to {100 * unmet_light:.2g} % of the light may be missing; give a larger lamp, far more "
            "samples or caustics=pl.rendering.Caustics.EXCLUDE",
            BudgetWarning,
        )
    progress.update_time()
    stats = RenderStats(
        seconds=progress.seconds,
        cpu_seconds=progress.cpu_seconds,
        paths=progress.paths,
        paths_through_lens=int(progress.counts[0]),
        lost=lost_rays(progress.counts),
        nonfinite=progress.nonfinite,
        threads=workers,
        clamped=progress.clamped / progress.light if progress.light > 0 else 0.0,
        nonfinite_paths=tuple(progress.nonfinite_paths),
        zero_variance=int(np.count_nonzero(zero_variance[crop])),
        unmet_light=unmet_light,
        stopped_by=reason,
        conditioning=conditioning,
        processors=film.processors,
    )
    return Exposure(
        image=image,
        standard_error=errors,
        truth=GroundTruth(**truth) if truth else None,
        samples=max_samples,
        replicates=min(progress.budget.replicates, max(max_samples, 1)),
        seed=seed,
        camera=subject.camera,
        region=region,
        stats=stats,
        sample_counts=None if counts is None or counts.min() == max_samples else counts,
        settings=subject.settings,
        white=subject.scene is None,
        object_names=names if names is None or len(names) <= MOST_NAMES else None,
    )


def _crop(array: Image, crop: tuple[slice, slice]) -> Image:
    """Crop of an array; read-only, so that the exposure need not copy the array if the crop is all of it."""
    cropped = array[crop]
    cropped = array if cropped.shape == array.shape else cropped.copy()
    cropped.flags.writeable = False
    return cropped


def _zero_variance_pixels(progress: Progress, counts: NDArray[np.int32] | None) -> NDArray[np.bool_]:
    """(rows, columns): lit pixels whose samples or replicates are all equal."""
    agreeing = progress.film.agreeing()
    if agreeing is None or progress.one_sample is None:
        return np.zeros(progress.film.mean.shape[:2], dtype=bool)
    return agreeing & (progress.one_sample > 0) & (True if counts is None else counts > 0)
