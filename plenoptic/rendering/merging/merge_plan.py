"""Merge plan: parts, which are read by rows; those of equal regions are stacked, others must leave no gaps."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.files.zarr_files import Region
from plenoptic.errors import FileError, InvalidValueError
from plenoptic.rendering.crop import region_text
from plenoptic.rendering.exposure import Exposure
from plenoptic.rendering.exposure_files import Layout, metadata_of_store, rows_of_store
from plenoptic.rendering.exposure_metadata import EXPOSURE_NAMES, ExposureMetadata, metadata_of, pixels_of
from plenoptic.rendering.schedule.budget import MAX_SAMPLES
from plenoptic.truth.channels import CHANNELS

Arrays = Mapping[str, NDArray[Any]]
_NAMED = 8
"""Missing regions listed in an error."""


class FilePart:
    """An exposure that is loaded when its first rows are requested, and released after the last ones."""

    def __init__(self, name: str, metadata: ExposureMetadata, load: Callable[[], Exposure]) -> None:
        self.name, self.metadata = name, metadata
        self._load, self._arrays = load, dict[str, NDArray[Any]]()

    def rows(self, first: int, end: int) -> Arrays:
        """Views of rows, requested from top to bottom; FileError if the file has changed since `metadata` was read."""
        if not self._arrays:
            exposure = self._load()
            if metadata_of(exposure) != self.metadata:
                raise FileError(f"{self.name} has been changed while parts were merged; merge them again")
            self._arrays = pixels_of(exposure)
        rows = {name: array[first:end] for name, array in self._arrays.items()}
        if end == self.metadata.shape[0]:
            self._arrays = {}
        return rows


class StorePart:
    """A zarr store, of which only the requested rows are read."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.name, self.metadata = os.fspath(path), metadata_of_store(path)

    def rows(self, first: int, end: int) -> Arrays:
        """Read rows from the disk."""
        return pixels_of(rows_of_store(self.name, self.metadata, first, end))


Part: TypeAlias = FilePart | StorePart


def memory_part(name: str, exposure: Exposure) -> FilePart:
    """An exposure in memory."""
    return FilePart(name, metadata_of(exposure), lambda: exposure)


class MergePlan(NamedTuple):
    """Parts that can be merged."""

    parts: tuple[Part, ...]
    stacks: dict[Region, list[int]]
    """Numbers of the parts of each region; several have different random numbers."""
    whole: Region
    layout: Layout
    """Layout of the whole, with `sample_counts` unless all pixels certainly have the same."""
    clamped: bool
    """True if light was clamped: then the parts' clamped fractions are weighted by their light."""

    @property
    def metadata(self) -> list[ExposureMetadata]:
        """Metadata of all parts."""
        return [part.metadata for part in self.parts]


def plan_merge(parts: Sequence[Part]) -> MergePlan:
    """Plan the merging of parts without reading pixels; raise InvalidValueError if they do not belong together."""
    if not parts:
        raise InvalidValueError("parts is empty; give the exposures that are to become one")
    _check_alike(parts)
    stacks: dict[Region, list[int]] = {}
    for number, part in enumerate(parts):
        stacks.setdefault(part.metadata.sensor_region, []).append(number)
    for region, numbers in stacks.items():
        _check_stack(region, [parts[number].metadata for number in numbers])
    first = parts[0].metadata
    whole = bounds({region: parts[numbers[0]].name for region, numbers in stacks.items()})
    shape, corner = (whole[1] - whole[0], whole[3] - whole[2]), (whole[0], whole[2])
    names = _array_names([[parts[number].metadata for number in numbers] for numbers in stacks.values()])
    sensor = None if first.camera is None else first.camera.sensor
    layout = Layout(shape, first.shape[2], names, corner, sensor)
    clamped = any(part.metadata.stats is not None and part.metadata.stats.clamped > 0 for part in parts)
    return MergePlan(tuple(parts), stacks, whole, layout, clamped)


def _check_alike(parts: Sequence[Part]) -> None:
    """Raise InvalidValueError if the parts cannot belong to one render."""
    first = parts[0]
    for part in parts:
        if part.metadata.samples is None:
            raise InvalidValueError(f"{part.name} does not know its samples, by which parts are weighed; give samples=")
        for name, words in (("camera", "another camera"), ("settings", "other settings"), ("white", "another subject")):
            if getattr(part.metadata, name) != getattr(first.metadata, name):
                raise InvalidValueError(
                    f"{part.name} has {words} than {first.name}; parts of one exposure must be alike"
                )
        if part.metadata.shape[2] != first.metadata.shape[2]:
            raise InvalidValueError(
                f"{part.name} has {part.metadata.shape[2]} channels and {first.name} has {first.metadata.shape[2]}; "
                "render them with the same scene"
            )


def _check_stack(region: Region, metadata: Sequence[ExposureMetadata]) -> None:
    """Raise InvalidValueError if exposures of the same region have too many samples, or share random numbers."""
    if (total := sum(one.samples or 0 for one in metadata)) > MAX_SAMPLES:
        raise InvalidValueError(
            f"parts of {region_text(region)} have {total} samples together; they must have at most {MAX_SAMPLES}"
        )
    if len(metadata) == 1:
        return
    if any(one.seed is None for one in metadata):
        raise InvalidValueError(
            f"of {len(metadata)} parts of {region_text(region)} one does not know its seed, and random numbers might "
            "count twice; merge exposures that know theirs"
        )
    for seed, times in Counter(seed for one in metadata for seed in one.seeds).items():
        if times > 1:
            raise InvalidValueError(
                f"{times} parts of {region_text(region)} have the seed {seed}, and the same random numbers would count "
                "twice; render each with a seed= of its own"
            )


def _array_names(stacks: Sequence[Sequence[ExposureMetadata]]) -> tuple[str, ...]:
    """Names of the arrays that all regions have: stacks have an error, and the truth that any of their parts has."""
    truth_names = [{name for metadata in stack for name in metadata.arrays if name in CHANNELS} for stack in stacks]
    names = {"image"}
    if all(len(stack) > 1 or "standard_error" in stack[0].arrays for stack in stacks):
        names.add("standard_error")
    totals = {sum(metadata.samples or 0 for metadata in stack) for stack in stacks}
    if len(totals) > 1 or any("sample_counts" in metadata.arrays for stack in stacks for metadata in stack):
        names.add("sample_counts")
    return tuple(
        name
        for name in (*EXPOSURE_NAMES, *CHANNELS)
        if name in names or all(name in truth_of_stack for truth_of_stack in truth_names)
    )


def bounds(parts: Mapping[Region, str]) -> Region:
    """Rectangle that regions of named parts fill; raises InvalidValueError if they overlap or leave pixels out."""
    low, high = np.min([*parts], axis=0), np.max([*parts], axis=0)
    whole = int(low[0]), int(high[1]), int(low[2]), int(high[3])
    rows, columns, covered = _coverage(parts)
    if (covered > 1).any():
        i, j = np.argwhere(covered > 1)[0]
        row, column = rows[i], columns[j]
        both = [
            f"{name} ({region_text(region)})"
            for region, name in parts.items()
            if region[0] <= row < region[1] and region[2] <= column < region[3]
        ]
        raise InvalidValueError(
            f"{both[0]} and {both[1]} overlap; regions of parts must be the same or lie beside each other"
        )
    if missing := missing_regions(whole, parts):
        more = f" and {len(missing) - _NAMED} more" if len(missing) > _NAMED else ""
        listed = "; ".join(region_text(region) for region in missing[:_NAMED])
        raise InvalidValueError(f"parts of {region_text(whole)} leave {listed}{more} out; give the missing ones")
    return whole


def missing_regions(whole: Region, regions: Collection[Region]) -> list[Region]:
    """Rectangles of a whole that regions do not cover."""
    rows, columns, covered = _coverage([whole, *regions])
    missing: list[Region] = []
    for i, (row, end_row) in enumerate(pairwise(rows.tolist())):
        inside = (columns[:-1] >= whole[2]) & (columns[1:] <= whole[3]) & (whole[0] <= row < whole[1])
        edges = np.flatnonzero(np.diff(np.concatenate([[False], inside & (covered[i] == 1), [False]])))
        for first, end in edges.reshape(-1, 2):
            columns_of_gap = int(columns[first]), int(columns[end])
            above = next((region for region in missing if region[1] == row and region[2:] == columns_of_gap), None)
            if above is not None:
                missing.remove(above)
            missing.append((row if above is None else above[0], end_row, *columns_of_gap))
    return missing


def _coverage(regions: Collection[Region]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns of the region boundaries, and the number of regions that cover each cell between them."""
    cuts = np.array(list(regions))
    rows, columns = np.unique(cuts[:, :2]), np.unique(cuts[:, 2:])
    counts = np.zeros((rows.size - 1, columns.size - 1), dtype=np.int64)
    at_rows, at_columns = np.searchsorted(rows, cuts[:, :2]), np.searchsorted(columns, cuts[:, 2:])
    for (first_row, end_row), (first_column, end_column) in zip(at_rows, at_columns, strict=True):
        counts[first_row:end_row, first_column:end_column] += 1
    return rows, columns, counts
