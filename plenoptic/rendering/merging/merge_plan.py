"""Merge plan: parts of equal regions that are stacked, adjacent regions, and metadata of the whole."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from plenoptic.errors import InvalidValueError
from plenoptic.rendering.crop import region_text
from plenoptic.rendering.exposure_metadata import EXPOSURE_NAMES, ExposureMetadata
from plenoptic.rendering.merging.parts import Part
from plenoptic.rendering.merging.regions import Region, bounds
from plenoptic.rendering.schedule.budget import MAX_SAMPLES
from plenoptic.rendering.stores import Layout
from plenoptic.truth.channels import CHANNELS


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
