"""What all parts took together."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from plenoptic.core.lost_rays import Lost
from plenoptic.core.values import Floats
from plenoptic.rendering.merging.merge_plan import MergePlan
from plenoptic.rendering.merging.parts import Arrays
from plenoptic.rendering.stats import NAMED, RenderStats, StopReason

_WORST = (
    StopReason.INTERRUPTED,
    StopReason.TIME_LIMIT,
    StopReason.TARGET_MISSED,
    StopReason.TARGET_ERROR,
    StopReason.SAMPLES,
)


def light_of_rows(arrays: Arrays) -> Floats:
    """(rows,): about the sums of what paths have brought, of which there are `sample_counts`."""
    return np.asarray((arrays["image"].mean(axis=2, dtype=np.float64) * arrays["sample_counts"]).sum(axis=1))


def merge_stats(plan: MergePlan, light: Mapping[int, Sequence[Floats]]) -> RenderStats | None:
    """Of all together; None where one has none. `light` is that of the rows of each part, where some was clamped."""
    all_stats = [head.stats for head in plan.heads if head.stats is not None]
    if len(all_stats) < len(plan.parts):
        return None
    agreeing = [min(all_stats[number].zero_variance for number in numbers) for numbers in plan.stacks.values()]
    return RenderStats(
        **{name: sum(getattr(one, name) for one in all_stats) for name in ("seconds", "cpu_seconds", "paths")},
        paths_through_lens=sum(one.paths_through_lens for one in all_stats),
        lost=_sum_lost(one.lost for one in all_stats),
        nonfinite=sum(one.nonfinite for one in all_stats),
        threads=max(one.threads for one in all_stats),
        clamped=_clamped(plan, light) if plan.clamped else 0.0,
        nonfinite_paths=tuple(path for one in all_stats for path in one.nonfinite_paths)[:NAMED],
        zero_variance=sum(agreeing),
        stopped_by=min((one.stopped_by for one in all_stats), key=_WORST.index),
        processors=tuple(dict.fromkeys(kind for one in all_stats for kind in one.processors)),
    )


def _clamped(plan: MergePlan, light: Mapping[int, Sequence[Floats]]) -> float:
    """The share of all light, with about the sums of what paths brought before anything was clamped."""
    shares = [0.0 if head.stats is None else head.stats.clamped for head in plan.heads]
    kept = [math.fsum(np.concatenate(light[number])) for number in range(len(shares))]
    before = [sum_ / (1.0 - share) if share < 1.0 else 0.0 for sum_, share in zip(kept, shares, strict=True)]
    return sum(share * sum_ for share, sum_ in zip(shares, before, strict=True)) / (sum(before) or 1.0)


def _sum_lost(given: Iterable[Lost]) -> Lost:
    found: dict[tuple[str, int | None], int] = {}
    for lost in given:
        for cause, element, count in lost:
            found[cause, element] = found.get((cause, element), 0) + count
    return tuple((cause, element, count) for (cause, element), count in found.items())
