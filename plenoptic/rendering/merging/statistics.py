"""Statistics of a merged exposure."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from plenoptic.core.lost_rays import Lost
from plenoptic.core.values import Floats
from plenoptic.rendering.merging.merge_plan import MergePlan
from plenoptic.rendering.merging.parts import Arrays
from plenoptic.rendering.stats import NAMED, RenderStats, StopReason

_SEVEREST_FIRST = (
    StopReason.INTERRUPTED,
    StopReason.TIME_LIMIT,
    StopReason.TARGET_MISSED,
    StopReason.TARGET_ERROR,
    StopReason.SAMPLES,
)


def light_of_rows(arrays: Arrays) -> Floats:
    """(rows,): approximate total light of the paths, from the image and `sample_counts`."""
    return np.asarray((arrays["image"].mean(axis=2, dtype=np.float64) * arrays["sample_counts"]).sum(axis=1))


def merge_stats(plan: MergePlan, light: Mapping[int, Sequence[Floats]]) -> RenderStats | None:
    """Statistics of the merged exposure; None if a part has none. `light` is that of the rows of each part, if any was
    clamped.
    """
    all_stats = [head.stats for head in plan.metadata if head.stats is not None]
    if len(all_stats) < len(plan.parts):
        return None
    zero_variance = [min(all_stats[number].zero_variance for number in numbers) for numbers in plan.stacks.values()]
    return RenderStats(
        **{name: sum(getattr(stats, name) for stats in all_stats) for name in ("seconds", "cpu_seconds", "paths")},
        paths_through_lens=sum(stats.paths_through_lens for stats in all_stats),
        lost=_sum_lost(stats.lost for stats in all_stats),
        nonfinite=sum(stats.nonfinite for stats in all_stats),
        threads=max(stats.threads for stats in all_stats),
        clamped=_clamped_fraction(plan, light) if plan.clamped else 0.0,
        nonfinite_paths=tuple(path for stats in all_stats for path in stats.nonfinite_paths)[:NAMED],
        zero_variance=sum(zero_variance),
        stopped_by=min((stats.stopped_by for stats in all_stats), key=_SEVEREST_FIRST.index),
        processors=tuple(dict.fromkeys(kind for stats in all_stats for kind in stats.processors)),
    )


def _clamped_fraction(plan: MergePlan, light: Mapping[int, Sequence[Floats]]) -> float:
    """Clamped fraction of all light, weighted by the light of the parts before clamping."""
    fractions = [0.0 if metadata.stats is None else metadata.stats.clamped for metadata in plan.metadata]
    remaining = [math.fsum(np.concatenate(light[number])) for number in range(len(fractions))]
    unclamped = [
        sum_ / (1.0 - fraction) if fraction < 1.0 else 0.0 for sum_, fraction in zip(remaining, fractions, strict=True)
    ]
    return sum(fraction * sum_ for fraction, sum_ in zip(fractions, unclamped, strict=True)) / (sum(unclamped) or 1.0)


def _sum_lost(losses: Iterable[Lost]) -> Lost:
    total: dict[tuple[str, int | None], int] = {}
    for lost in losses:
        for cause, element, count in lost:
            total[cause, element] = total.get((cause, element), 0) + count
    return tuple((cause, element, count) for (cause, element), count in total.items())
