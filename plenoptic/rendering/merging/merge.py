"""Merging of exposures: of adjacent regions, and of different random numbers for the same region.

Bands of rows are merged one at a time, into arrays in memory or into a store, with the same bits. Beside the result,
memory holds at most the rows of one region and the files that overlap the band.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from plenoptic.core.files.atomic_file import real_path, replace_folder
from plenoptic.core.files.zarr_files import CHUNK, Region
from plenoptic.core.values import Floats, check_has, check_kind
from plenoptic.rendering.exposure import Exposure
from plenoptic.rendering.exposure_files import check_store, create_store, empty_arrays, texts_of
from plenoptic.rendering.exposure_metadata import ExposureMetadata, fields_of
from plenoptic.rendering.merging.merge_plan import Arrays, MergePlan, Part, memory_part, plan_merge
from plenoptic.rendering.merging.stacking import light_of_rows, merge_stats, stack_exposures


class _Strip(NamedTuple):
    """Sample numbers and light of some rows of a region."""

    min_samples: int
    """Minimum number of samples of a pixel."""
    max_samples: int
    light: dict[int, Floats]
    """Light of the rows of each part, by its number."""


def merge_exposures(exposures: Iterable[Exposure]) -> Exposure:
    """See `Exposure.merged`."""
    check_has(exposures, "parts", "sequence of Exposure", "[first, second]", "__iter__")
    parts = list(exposures)
    for part in parts:
        check_kind(part, "an item of parts", Exposure, "an exposure of `render`")
    return merge_parts([memory_part(f"part {number}", part) for number, part in enumerate(parts)])


def merge_parts(parts: Sequence[Part]) -> Exposure:
    """Merge parts into one exposure in memory."""
    plan = plan_merge(parts)
    arrays, strips = empty_arrays(plan.layout), list[_Strip]()
    for band in _bands(plan):
        strips += _fill_band(plan, band, {name: array[band] for name, array in arrays.items()})
    metadata = _merged_metadata(plan, strips)
    for array in arrays.values():
        array.flags.writeable = False
    return Exposure(**fields_of({name: arrays[name] for name in metadata.arrays}), **metadata.facts)


def merge_to_store(parts: Sequence[Part], path: str | os.PathLike[str]) -> ExposureMetadata:
    """Merge parts into a zarr store, atomically, with one band of its chunks in memory."""
    plan, target = plan_merge(parts), real_path(path)
    check_store(target)
    rows, columns = plan.layout.shape
    buffers = empty_arrays(plan.layout._replace(shape=(min(CHUNK, rows), columns)))
    with replace_folder(target) as folder:
        store, strips = create_store(folder, plan.layout, {}), list[_Strip]()
        for band in _bands(plan):
            arrays = {name: array[: band.stop - band.start] for name, array in buffers.items()}
            strips += _fill_band(plan, band, arrays)
            store.put((band.start, band.stop, 0, columns), arrays)
        metadata = _merged_metadata(plan, strips)
        store.finish(metadata.arrays, texts_of(metadata))
    return metadata


def _bands(plan: MergePlan) -> Iterator[slice]:
    """Bands of rows of the whole, a chunk of them at a time."""
    rows = plan.layout.shape[0]
    return (slice(first, min(first + CHUNK, rows)) for first in range(0, rows, CHUNK))


def _fill_band(plan: MergePlan, band: slice, arrays: Arrays) -> Iterator[_Strip]:
    """Fill arrays of a band, whose rows count from the first row of the whole, with the rows of the parts."""
    corner = plan.layout.corner
    for region in plan.stacks:
        top, bottom = max(corner[0] + band.start, region[0]), min(corner[0] + band.stop, region[1])
        if top < bottom:
            rows = slice(top - corner[0] - band.start, bottom - corner[0] - band.start)
            columns = slice(region[2] - corner[1], region[3] - corner[1])
            cropped = {name: array[rows, columns] for name, array in arrays.items()}
            yield _fill_strip(plan, region, slice(top - region[0], bottom - region[0]), cropped)


def _fill_strip(plan: MergePlan, region: Region, rows: slice, arrays: Arrays) -> _Strip:
    """Fill arrays of some rows of a region."""
    shots = {}
    for number in plan.stacks[region]:
        part = plan.parts[number]
        arrays_of_part = part.rows(rows.start, rows.stop)
        counts = np.full(arrays_of_part["image"].shape[:2], part.metadata.samples, dtype=np.int32)
        shots[number] = {"sample_counts": counts, **arrays_of_part}
    light = {number: light_of_rows(shot) for number, shot in shots.items()} if plan.clamped else {}
    stacked = stack_exposures(list(shots.values()))
    for name, array in arrays.items():
        array[...] = stacked[name]
    counts = stacked["sample_counts"]
    return _Strip(int(counts.min()), int(counts.max()), light)


def _merged_metadata(plan: MergePlan, strips: Sequence[_Strip]) -> ExposureMetadata:
    """Metadata of the merged exposure, after its pixels are filled."""
    metadata, max_samples = plan.metadata, max(strip.max_samples for strip in strips)
    equal_counts = min(strip.min_samples for strip in strips) == max_samples
    light = [[strip.light[k] for strip in strips if k in strip.light] for k in range(len(plan.parts))]
    camera = metadata[0].camera
    sensor = None if camera is None else (0, camera.sensor.shape[0], 0, camera.sensor.shape[1])
    whole_sensor = all(one.region is None for one in metadata) or plan.whole == sensor
    replicates = [sum(metadata[number].replicates or 0 for number in numbers) for numbers in plan.stacks.values()]
    seeds = sorted({seed for one in metadata for seed in one.seeds})
    return ExposureMetadata(
        (*plan.layout.shape, plan.layout.channels),
        tuple(name for name in plan.layout.names if name != "sample_counts" or not equal_counts),
        samples=max_samples,
        replicates=None if any(one.replicates is None for one in metadata) else min(replicates),
        seed=None if any(one.seed is None for one in metadata) else seeds[0] if len(seeds) == 1 else tuple(seeds),
        region=None if whole_sensor else plan.whole,
        camera=camera,
        stats=merge_stats(plan, light),
        settings=metadata[0].settings,
        white=metadata[0].white,
        object_names=next((one.object_names for one in metadata if one.object_names is not None), None),
    )
