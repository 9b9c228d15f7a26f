"""Stacking of exposures of the same pixels with different random numbers: mean, standard error, and statistics.

Pixels are independent, so that the bits do not depend on the stacked rows. Pooling over blocks of 8 x 8 is contained in
the errors of the parts.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.rendering.merging.merge_plan import Arrays, MergePlan
from plenoptic.rendering.stats import NAMED, RenderStats, StopReason

_SEVEREST_FIRST = (
    StopReason.INTERRUPTED,
    StopReason.TIME_LIMIT,
    StopReason.TARGET_MISSED,
    StopReason.TARGET_ERROR,
    StopReason.SAMPLES,
)


def stack_exposures(shots: Sequence[Arrays]) -> dict[str, NDArray[Any]]:
    """Mean of exposures weighted by their `sample_counts`; each truth channel is that of the first with it."""
    arrays = {name: array for shot in reversed(shots) for name, array in shot.items()}
    if len(shots) == 1:
        return arrays
    weights = [shot["sample_counts"].astype(np.float64)[..., None] for shot in shots]
    total = np.sum(weights, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = sum(weight * shot["image"] for weight, shot in zip(weights, shots, strict=True)) / total
        mean = np.where(total > 0, mean, 0.0)
        error = np.where(total > 0, _error(shots, weights, total, mean), np.inf)
    counts = total[..., 0].astype(np.int32)
    stacked = {"image": mean.astype(np.float32), "standard_error": error.astype(np.float32), "sample_counts": counts}
    return arrays | stacked


def _error(shots: Sequence[Arrays], weights: list[Floats], total: Floats, mean: Floats) -> Floats:
    """Standard error of a weighted mean: from the errors of its parts, or from their differences if one has none."""
    if all("standard_error" in shot for shot in shots):
        squared = np.zeros_like(mean)
        for weight, shot in zip(weights, shots, strict=True):
            squared += np.where(weight > 0, np.square(weight * shot["standard_error"]), 0.0)
        return np.asarray(np.sqrt(squared) / total)
    squares = sum(weight * np.square(shot["image"] - mean) for weight, shot in zip(weights, shots, strict=True))
    freedom = sum((weight > 0).astype(np.float64) for weight in weights) - 1
    return np.asarray(np.where(freedom > 0, np.sqrt(squares / (freedom * total)), np.inf))


def light_of_rows(arrays: Arrays) -> Floats:
    """(rows,): approximate total light of the paths, from the image and `sample_counts`."""
    return np.asarray((arrays["image"].mean(axis=2, dtype=np.float64) * arrays["sample_counts"]).sum(axis=1))


def merge_stats(plan: MergePlan, light: Sequence[Sequence[Floats]]) -> RenderStats | None:
    """Statistics of the merged exposure, None if a part has none; `light` of the rows of each part, if clamped."""
    all_stats = [head.stats for head in plan.metadata if head.stats is not None]
    if len(all_stats) < len(plan.parts):
        return None
    zero_variance = [min(all_stats[number].zero_variance for number in numbers) for numbers in plan.stacks.values()]
    lost: Counter[tuple[str, int | None]] = Counter()
    for stats in all_stats:
        for cause, element, count in stats.lost:
            lost[cause, element] += count
    # The numbers of paths of all parts add up.
    met_paths = math.fsum(1.0 / stats.unmet_light - 1.0 if stats.unmet_light > 0 else math.inf for stats in all_stats)
    summed = ("seconds", "cpu_seconds", "paths", "paths_through_lens", "nonfinite")
    return RenderStats(
        **{name: sum(getattr(stats, name) for stats in all_stats) for name in summed},
        lost=tuple((cause, element, count) for (cause, element), count in lost.items()),
        threads=max(stats.threads for stats in all_stats),
        clamped=_clamped_fraction(plan, light) if plan.clamped else 0.0,
        nonfinite_paths=tuple(path for stats in all_stats for path in stats.nonfinite_paths)[:NAMED],
        zero_variance=sum(zero_variance),
        unmet_light=1.0 / (1.0 + met_paths),
        stopped_by=min((stats.stopped_by for stats in all_stats), key=_SEVEREST_FIRST.index),
        processors=tuple(dict.fromkeys(kind for stats in all_stats for kind in stats.processors)),
    )


def _clamped_fraction(plan: MergePlan, light: Sequence[Sequence[Floats]]) -> float:
    """Clamped fraction of all light, weighted by the light of the parts before clamping."""
    fractions = [0.0 if metadata.stats is None else metadata.stats.clamped for metadata in plan.metadata]
    remaining = [math.fsum(np.concatenate(rows)) for rows in light]
    unclamped = [
        sum_ / (1.0 - fraction) if fraction < 1.0 else 0.0 for sum_, fraction in zip(remaining, fractions, strict=True)
    ]
    return sum(fraction * sum_ for fraction, sum_ in zip(fractions, unclamped, strict=True)) / (sum(unclamped) or 1.0)
