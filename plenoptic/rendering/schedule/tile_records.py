"""Validation of the records of a checkpoint from which a render resumes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.files.record_log import Entry
from plenoptic.rendering.schedule.budget import MAX_SAMPLES
from plenoptic.rendering.schedule.progress import Progress
from plenoptic.rendering.tile import Tile

TRUTH = "truth."
"""Prefix of the names of ground-truth arrays."""
_MAX_COUNT = 1 << 48
"""Limit of the counts of a batch: sums of many fit into 64 bits."""


def _is_count(fact: Any) -> bool:
    return type(fact) is int and 0 <= fact < _MAX_COUNT


def _is_number(fact: Any) -> bool:
    return _is_count(fact) or (type(fact) is float and 0 <= fact < math.inf)


def _are_counts(fact: Any, n: int) -> bool:
    return type(fact) in (list, tuple) and len(fact) == n and all(map(_is_count, fact))


_FACTS: dict[str, Callable[[Any], bool]] = {
    "tile": lambda fact: _are_counts(fact, len(Tile._fields)),
    "first": _is_count,
    "samples": lambda fact: _is_count(fact) and 0 < fact <= MAX_SAMPLES,
    **dict.fromkeys(("paths", "nonfinite", "met"), _is_count),
    **dict.fromkeys(("light", "clamped", "seconds", "cpu_seconds"), _is_number),
    "lost_paths": lambda fact: type(fact) in (list, tuple) and all(_are_counts(path, 3) for path in fact),
    "processor": lambda fact: type(fact) is str,
}


def has_facts(entry: Entry) -> bool:
    """True if a record has all valid facts about a batch of a tile."""
    facts = entry.facts
    if not all(name in facts and check(facts[name]) for name, check in _FACTS.items()):
        return False
    return bool(facts["clamped"] <= facts["light"] and facts["nonfinite"] <= facts["paths"])


def has_arrays(entry: Entry, progress: Progress) -> bool:
    """True if the arrays of a record have the layout of its tile in a render."""
    rows, columns = Tile(*entry.facts["tile"])[2:]
    replicates, channels = progress.budget.replicates, progress.film.mean.shape[2]
    expected: dict[str, tuple[Any, tuple[int, ...]]] = {
        "sums": (np.float64, (rows, columns, replicates + 1, channels)),
        "counts": (np.int64, progress.counts.shape),
    }
    if not entry.facts["first"]:
        expected["weights"] = np.float64, (rows, columns)
        for name, array in progress.truth.items():
            expected[f"{TRUTH}{name}"] = array.dtype, (rows, columns, *array.shape[2:])
    layouts = {name: (dtype, shape) for name, dtype, shape in entry.layouts}
    return layouts.keys() == expected.keys() and all(
        shape == expected[name][1] and np.can_cast(dtype, expected[name][0], "same_kind")
        for name, (dtype, shape) in layouts.items()
    )


def are_sums(arrays: Mapping[str, NDArray[Any]], paths: int) -> bool:
    """True if the values of a record are possible for this number of paths."""
    counts = arrays["counts"]
    return bool(np.isfinite(arrays["sums"]).all() and (counts >= 0).all() and (counts <= paths).all())
