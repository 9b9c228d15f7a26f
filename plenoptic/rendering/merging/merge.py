"""One exposure of several: of regions beside each other, and of other random numbers for the same region.

A band of rows is merged at a time, into arrays in memory or into a store: both have the same bits, and beside the whole
there are never more than the rows of one region and the files that touch the band.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from plenoptic.core.files.atomic_file import real_path, replaced_folder
from plenoptic.core.files.zarr_files import CHUNK
from plenoptic.core.values import Floats, check_kind
from plenoptic.rendering.exposure import Exposure
from plenoptic.rendering.exposure_files import texts_of
from plenoptic.rendering.exposure_metadata import ExposureMetadata, fields_of
from plenoptic.rendering.merging.merge_plan import MergePlan, plan_merge
from plenoptic.rendering.merging.parts import Arrays, HeldPart, Part
from plenoptic.rendering.merging.regions import Region
from plenoptic.rendering.merging.stacking import stack_exposures
from plenoptic.rendering.merging.statistics import light_of_rows, merge_stats
from plenoptic.rendering.stores import check_store, create_store, empty_arrays


class _Strip(NamedTuple):
    """What is known of some rows of a region, once they are filled."""

    least: int
    """Samples of a pixel."""
    most: int
    light: dict[int, Floats]
    """Of the rows of each part, by its number."""


def merged(exposures: Iterable[Exposure]) -> Exposure:
    """See `Exposure.merged`."""
    given = list(exposures)
    for one in given:
        check_kind(one, "an item of parts", Exposure, "what `render` gives")
    return merge_parts([HeldPart(f"part {number}", one) for number, one in enumerate(given)])


def merge_parts(parts: Sequence[Part]) -> Exposure:
    """One exposure of parts, in memory."""
    plan = plan_merge(parts)
    arrays, strips = empty_arrays(plan.layout), list[_Strip]()
    for band in _bands(plan):
        strips += _filled(plan, band, {name: array[band] for name, array in arrays.items()})
    head = _head(plan, strips)
    for array in arrays.values():
        array.flags.writeable = False
    return Exposure(**fields_of({name: arrays[name] for name in head.arrays}), **head.facts)


def merge_to_store(parts: Sequence[Part], path: str | os.PathLike[str]) -> ExposureMetadata:
    """The same in a zarr store, which appears whole or not at all; in memory there is one band of its chunks."""
    plan, target = plan_merge(parts), real_path(path)
    check_store(target)
    rows, columns = plan.layout.shape
    room = empty_arrays(plan.layout._replace(shape=(min(CHUNK, rows), columns)))
    with replaced_folder(target) as folder:
        store, strips = create_store(folder, plan.layout, {}), list[_Strip]()
        for band in _bands(plan):
            arrays = {name: array[: band.stop - band.start] for name, array in room.items()}
            strips += _filled(plan, band, arrays)
            store.put((band.start, band.stop, 0, columns), arrays)
        head = _head(plan, strips)
        store.finish(head.arrays, texts_of(head))
    return head


def _bands(plan: MergePlan) -> Iterator[slice]:
    """Rows of the whole, a chunk of them at a time."""
    rows = plan.layout.shape[0]
    return (slice(first, min(first + CHUNK, rows)) for first in range(0, rows, CHUNK))


def _filled(plan: MergePlan, band: slice, arrays: Arrays) -> Iterator[_Strip]:
    """Fill arrays of a band, whose rows count from the whole's first one, with what the parts hold there."""
    corner = plan.layout.corner
    for region in plan.stacks:
        top, bottom = max(corner[0] + band.start, region[0]), min(corner[0] + band.stop, region[1])
        if top < bottom:
            rows = slice(top - corner[0] - band.start, bottom - corner[0] - band.start)
            columns = slice(region[2] - corner[1], region[3] - corner[1])
            there = {name: array[rows, columns] for name, array in arrays.items()}
            yield _filled_strip(plan, region, slice(top - region[0], bottom - region[0]), there)


def _filled_strip(plan: MergePlan, region: Region, rows: slice, arrays: Arrays) -> _Strip:
    """Fill arrays of some rows of a region."""
    shots = {}
    for number in plan.stacks[region]:
        part = plan.parts[number]
        found = part.rows(rows.start, rows.stop)
        counts = np.full(found["image"].shape[:2], part.head.samples, dtype=np.int32)
        shots[number] = {"sample_counts": counts, **found}
    light = {number: light_of_rows(shot) for number, shot in shots.items()} if plan.clamped else {}
    together = stack_exposures(list(shots.values()))
    for name, array in arrays.items():
        array[...] = together[name]
    counts = together["sample_counts"]
    return _Strip(int(counts.min()), int(counts.max()), light)


def _head(plan: MergePlan, strips: Sequence[_Strip]) -> ExposureMetadata:
    """What is known of the whole beside its pixels, once these are filled."""
    heads, most = plan.heads, max(strip.most for strip in strips)
    alike = min(strip.least for strip in strips) == most
    light: dict[int, list[Floats]] = {}
    for strip in strips:
        for number, rows in strip.light.items():
            light.setdefault(number, []).append(rows)
    camera = heads[0].camera
    everything = None if camera is None else (0, camera.sensor.shape[0], 0, camera.sensor.shape[1])
    full = all(head.region is None for head in heads) or plan.whole == everything
    replicates = [sum(heads[number].replicates or 0 for number in numbers) for numbers in plan.stacks.values()]
    seeds = sorted({seed for head in heads for seed in head.seeds})
    return ExposureMetadata(
        (*plan.layout.shape, plan.layout.channels),
        tuple(name for name in plan.layout.names if name != "sample_counts" or not alike),
        samples=most,
        replicates=None if any(head.replicates is None for head in heads) else min(replicates),
        seed=None if any(head.seed is None for head in heads) else seeds[0] if len(seeds) == 1 else tuple(seeds),
        region=None if full else plan.whole,
        camera=camera,
        stats=merge_stats(plan, light),
        settings=heads[0].settings,
        white=heads[0].white,
        object_names=next((head.object_names for head in heads if head.object_names is not None), None),
    )
