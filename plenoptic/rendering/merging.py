"""One exposure of several: of regions beside each other, and of other random numbers for the same region."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.lost_rays import Lost
from plenoptic.core.values import Floats, check_kind
from plenoptic.errors import InvalidValueError
from plenoptic.rendering.exposure import Exposure
from plenoptic.rendering.frame import region_text
from plenoptic.rendering.schedule.budget import MAX_SAMPLES
from plenoptic.rendering.stats import RenderStats, StopReason
from plenoptic.rendering.tile import NAMED
from plenoptic.truth.channels import GroundTruth

Region = tuple[int, int, int, int]
_NAMED = 8
"""Missing regions that are named."""
_WORST = (
    StopReason.INTERRUPTED,
    StopReason.TIME_LIMIT,
    StopReason.TARGET_MISSED,
    StopReason.TARGET_ERROR,
    StopReason.SAMPLES,
)


class _Part(NamedTuple):
    """A region, of one exposure or of several with other random numbers."""

    region: Region
    image: NDArray[np.float32]
    error: NDArray[np.float32] | None
    counts: NDArray[np.int32]
    """(rows, columns)"""
    shots: list[Exposure]


def merged(parts: Iterable[Exposure], *, names: Sequence[str] | None = None) -> Exposure:
    """See `Exposure.merged`; errors call parts by their names, if they have any."""
    shots = list(parts)
    for shot in shots:
        check_kind(shot, "an item of parts", Exposure, "what `render` gives")
    if not shots:
        raise InvalidValueError("parts is empty; give the exposures that are to become one")
    _check_alike(shots, [f"part {i}" for i in range(len(shots))] if names is None else names)
    regions: dict[Region, list[Exposure]] = {}
    for shot in shots:
        regions.setdefault(region_in(shot), []).append(shot)
    found = [_stacked(region, alike) for region, alike in regions.items()]
    whole = _bounds(list(regions))
    return _joined(whole, found, shots)


def region_in(shot: Exposure) -> Region:
    """Where an exposure lies on its sensor."""
    return shot.region or (0, shot.image.shape[0], 0, shot.image.shape[1])


def _check_alike(shots: Sequence[Exposure], names: Sequence[str]) -> None:
    """An error where they cannot be of one render."""
    first = shots[0]
    for called, shot in zip(names, shots, strict=True):
        if shot.samples is None:
            raise InvalidValueError(f"{called} does not know its samples, by which parts are weighed; give samples=")
        for name, words in (("camera", "another camera"), ("settings", "other settings"), ("white", "another subject")):
            if getattr(shot, name) != getattr(first, name):
                raise InvalidValueError(f"{called} has {words} than {names[0]}; parts of one exposure must be alike")
        if shot.image.shape[2] != first.image.shape[2]:
            raise InvalidValueError(
                f"{called} has {shot.image.shape[2]} channels and {names[0]} has {first.image.shape[2]}; "
                "render them with the same scene"
            )


def _counts(shot: Exposure) -> NDArray[np.int32]:
    if shot.sample_counts is not None:
        return shot.sample_counts
    return np.full(shot.image.shape[:2], shot.samples, dtype=np.int32)


def _stacked(region: Region, shots: list[Exposure]) -> _Part:
    """Exposures of the same region, weighed by their samples."""
    if (most := sum(shot.samples or 0 for shot in shots)) > MAX_SAMPLES:
        raise InvalidValueError(
            f"parts of {region_text(region)} have {most} samples together; they must have at most {MAX_SAMPLES}"
        )
    if len(shots) == 1:
        return _Part(region, shots[0].image, shots[0].standard_error, _counts(shots[0]), shots)
    seeds = [shot.seed for shot in shots]
    for seed in seeds:
        if seed is None:
            raise InvalidValueError(
                f"of {len(seeds)} parts of {region_text(region)} one does not know its seed, and random numbers might "
                "count twice; merge all of them at once, as they were rendered"
            )
        if seeds.count(seed) > 1:
            raise InvalidValueError(
                f"{seeds.count(seed)} parts of {region_text(region)} have the seed {seed}, and the same random numbers "
                "would count twice; render each with a seed= of its own"
            )
    weights = [_counts(shot).astype(np.float64)[..., None] for shot in shots]
    total = np.sum(weights, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = sum(weight * shot.image for weight, shot in zip(weights, shots, strict=True)) / total
        mean = np.where(total > 0, mean, 0.0)
        error = _stacked_error(shots, weights, total, mean)
        counts = total[..., 0].astype(np.int32)
        kept = None if error is None else np.where(total > 0, error, np.inf).astype(np.float32)
    return _Part(region, mean.astype(np.float32), kept, counts, shots)


def _stacked_error(shots: list[Exposure], weights: list[Floats], total: Floats, mean: Floats) -> Floats | None:
    """Standard error of a weighed mean: from the errors of its parts, or where one has none, from their differences."""
    if all(shot.standard_error is not None for shot in shots):
        squared = np.zeros_like(mean)
        for weight, shot in zip(weights, shots, strict=True):
            assert shot.standard_error is not None
            squared += np.where(weight > 0, np.square(weight * shot.standard_error), 0.0)
        return np.asarray(np.sqrt(squared) / total)
    squares = sum(weight * np.square(shot.image - mean) for weight, shot in zip(weights, shots, strict=True))
    freedom = sum((weight > 0).astype(np.float64) for weight in weights) - 1
    return np.asarray(np.where(freedom > 0, np.sqrt(squares / (freedom * total)), np.inf))


def _bounds(regions: list[Region]) -> Region:
    """The rectangle that regions fill; an error where they overlap or leave something out."""
    low, high = np.min(regions, axis=0), np.max(regions, axis=0)
    whole = int(low[0]), int(high[1]), int(low[2]), int(high[3])
    rows, columns, covered = _covered(regions)
    if (covered > 1).any():
        i, j = np.argwhere(covered > 1)[0]
        row, column = rows[i], columns[j]
        both = [region_text(r) for r in regions if r[0] <= row < r[1] and r[2] <= column < r[3]]
        raise InvalidValueError(
            f"parts overlap, with {both[0]} and {both[1]}; regions must be the same or lie beside each other"
        )
    if missing := left_out(whole, regions):
        more = f" and {len(missing) - _NAMED} more" if len(missing) > _NAMED else ""
        named = "; ".join(region_text(region) for region in missing[:_NAMED])
        raise InvalidValueError(f"parts of {region_text(whole)} leave {named}{more} out; give the missing ones")
    return whole


def _covered(regions: Collection[Region]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns at which regions are cut, and how many regions cover each cell between two of both."""
    cuts = np.array(list(regions))
    rows, columns = np.unique(cuts[:, :2]), np.unique(cuts[:, 2:])
    covered = np.zeros((rows.size - 1, columns.size - 1), dtype=np.int64)
    at_rows, at_columns = np.searchsorted(rows, cuts[:, :2]), np.searchsorted(columns, cuts[:, 2:])
    for (first_row, end_row), (first_column, end_column) in zip(at_rows, at_columns, strict=True):
        covered[first_row:end_row, first_column:end_column] += 1
    return rows, columns, covered


def left_out(whole: Region, regions: Collection[Region]) -> list[Region]:
    """Rectangles of a whole that regions do not cover."""
    rows, columns, covered = _covered([whole, *regions])
    found: list[Region] = []
    for i, (row, end_row) in enumerate(pairwise(rows.tolist())):
        inside = (columns[:-1] >= whole[2]) & (columns[1:] <= whole[3]) & (whole[0] <= row < whole[1])
        edges = np.flatnonzero(np.diff(np.concatenate([[False], inside & (covered[i] == 1), [False]])))
        for first, end in edges.reshape(-1, 2):
            place = int(columns[first]), int(columns[end])
            above = next((region for region in found if region[1] == row and region[2:] == place), None)
            if above is not None:
                found.remove(above)
            found.append((row if above is None else above[0], end_row, *place))
    return found


def _joined(whole: Region, parts: list[_Part], shots: list[Exposure]) -> Exposure:
    """Regions, put where they belong."""
    shape = whole[1] - whole[0], whole[3] - whole[2]
    first = shots[0]
    image = np.empty((*shape, first.image.shape[2]), dtype=np.float32)
    error = None if any(part.error is None for part in parts) else np.empty_like(image)
    counts, truth = np.empty(shape, dtype=np.int32), _empty_truth(parts, shape)
    for part in parts:
        r = part.region
        at = slice(r[0] - whole[0], r[1] - whole[0]), slice(r[2] - whole[2], r[3] - whole[2])
        image[at], counts[at] = part.image, part.counts
        if error is not None:
            assert part.error is not None
            error[at] = part.error
        known = _truth(part)
        for name, array in truth.items():
            array[at] = known[name]
    most, sensor = int(counts.max()), None if first.camera is None else first.camera.sensor.shape
    for array in (image, counts, *([] if error is None else [error]), *truth.values()):
        array.flags.writeable = False
    full = all(shot.region is None for shot in shots) or (sensor is not None and whole == (0, sensor[0], 0, sensor[1]))
    replicates = [sum(shot.replicates or 0 for shot in part.shots) for part in parts]
    seeds = {shot.seed for shot in shots}
    return Exposure(
        image,
        standard_error=error,
        truth=GroundTruth(**truth) if truth else None,
        samples=most,
        replicates=None if any(shot.replicates is None for shot in shots) else min(replicates),
        seed=seeds.pop() if len(seeds) == 1 else None,
        camera=first.camera,
        region=None if full else whole,
        stats=_stats(parts, shots),
        sample_counts=None if counts.min() == most else counts,
        settings=first.settings,
        white=first.white,
        object_names=next((shot.object_names for shot in shots if shot.object_names is not None), None),
    )


def _truth(part: _Part) -> dict[str, NDArray[Any]]:
    """What is known of a region: random numbers do not change it."""
    found: dict[str, NDArray[Any]] = {}
    for shot in part.shots:
        found = {**({} if shot.truth is None else shot.truth.arrays()), **found}
    return found


def _empty_truth(parts: list[_Part], shape: tuple[int, int]) -> dict[str, NDArray[Any]]:
    """Arrays for what is known of all regions."""
    known = [_truth(part) for part in parts]
    names = [name for name in known[0] if all(name in one for one in known)]
    return {name: np.empty((*shape, *known[0][name].shape[2:]), dtype=known[0][name].dtype) for name in names}


def _stats(parts: list[_Part], shots: list[Exposure]) -> RenderStats | None:
    """Of all together; None where one has none."""
    all_stats = [shot.stats for shot in shots if shot.stats is not None]
    if len(all_stats) < len(shots):
        return None
    light = [_light(shot) for shot in shots]
    agreeing = [min(shot.stats.zero_variance for shot in part.shots if shot.stats is not None) for part in parts]
    return RenderStats(
        **{name: sum(getattr(one, name) for one in all_stats) for name in ("seconds", "cpu_seconds", "paths")},
        paths_through_lens=sum(one.paths_through_lens for one in all_stats),
        lost=_sum_lost(one.lost for one in all_stats),
        nonfinite=sum(one.nonfinite for one in all_stats),
        threads=max(one.threads for one in all_stats),
        clamped=sum(one.clamped * part for one, part in zip(all_stats, light, strict=True)) / (sum(light) or 1.0),
        nonfinite_paths=tuple(path for one in all_stats for path in one.nonfinite_paths)[:NAMED],
        zero_variance=sum(agreeing),
        stopped_by=min((one.stopped_by for one in all_stats), key=_WORST.index),
        processors=tuple(dict.fromkeys(kind for one in all_stats for kind in one.processors)),
    )


def _light(shot: Exposure) -> float:
    """About the sum of what the paths of an exposure brought, before anything was clamped."""
    kept = float(np.sum(shot.image.mean(axis=2, dtype=np.float64) * _counts(shot)))
    clamped = 0.0 if shot.stats is None else shot.stats.clamped
    return kept / (1.0 - clamped) if clamped < 1.0 else 0.0


def _sum_lost(given: Iterable[Lost]) -> Lost:
    found: dict[tuple[str, int | None], int] = {}
    for lost in given:
        for cause, element, count in lost:
            found[cause, element] = found.get((cause, element), 0) + count
    return tuple((cause, element, count) for (cause, element), count in found.items())
