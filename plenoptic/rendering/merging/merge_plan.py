"""What becomes of parts: which lie on each other, which beside each other, and what is known of all."""

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
    """Numbers of the parts of each region: several have other random numbers."""
    whole: Region
    layout: Layout
    """Of the whole, with `sample_counts` unless it is certain that all pixels have as many."""
    clamped: bool
    """Whether some light was clamped away: then parts are weighed by theirs."""

    @property
    def heads(self) -> list[ExposureMetadata]:
        """Of all parts."""
        return [part.head for part in self.parts]


def plan_merge(parts: Sequence[Part]) -> MergePlan:
    """An InvalidValueError where they are not parts of one exposure; no pixel is read."""
    if not parts:
        raise InvalidValueError("parts is empty; give the exposures that are to become one")
    _check_alike(parts)
    stacks: dict[Region, list[int]] = {}
    for number, part in enumerate(parts):
        stacks.setdefault(part.head.place, []).append(number)
    for region, numbers in stacks.items():
        _check_stack(region, [parts[number].head for number in numbers])
    first = parts[0].head
    whole = bounds({region: parts[numbers[0]].name for region, numbers in stacks.items()})
    shape, corner = (whole[1] - whole[0], whole[3] - whole[2]), (whole[0], whole[2])
    names = _arrays([[parts[number].head for number in numbers] for numbers in stacks.values()])
    sensor = None if first.camera is None else first.camera.sensor
    layout = Layout(shape, first.shape[2], names, corner, sensor)
    clamped = any(part.head.stats is not None and part.head.stats.clamped > 0 for part in parts)
    return MergePlan(tuple(parts), stacks, whole, layout, clamped)


def _check_alike(parts: Sequence[Part]) -> None:
    """An error where they cannot be of one render."""
    first = parts[0]
    for part in parts:
        if part.head.samples is None:
            raise InvalidValueError(f"{part.name} does not know its samples, by which parts are weighed; give samples=")
        for name, words in (("camera", "another camera"), ("settings", "other settings"), ("white", "another subject")):
            if getattr(part.head, name) != getattr(first.head, name):
                raise InvalidValueError(
                    f"{part.name} has {words} than {first.name}; parts of one exposure must be alike"
                )
        if part.head.shape[2] != first.head.shape[2]:
            raise InvalidValueError(
                f"{part.name} has {part.head.shape[2]} channels and {first.name} has {first.head.shape[2]}; "
                "render them with the same scene"
            )


def _check_stack(region: Region, heads: Sequence[ExposureMetadata]) -> None:
    """An error where exposures of the same region are too many, or share random numbers."""
    if (most := sum(head.samples or 0 for head in heads)) > MAX_SAMPLES:
        raise InvalidValueError(
            f"parts of {region_text(region)} have {most} samples together; they must have at most {MAX_SAMPLES}"
        )
    if len(heads) == 1:
        return
    if any(head.seed is None for head in heads):
        raise InvalidValueError(
            f"of {len(heads)} parts of {region_text(region)} one does not know its seed, and random numbers might "
            "count twice; merge exposures that know theirs"
        )
    for seed, times in Counter(seed for head in heads for seed in head.seeds).items():
        if times > 1:
            raise InvalidValueError(
                f"{times} parts of {region_text(region)} have the seed {seed}, and the same random numbers would count "
                "twice; render each with a seed= of its own"
            )


def _arrays(stacks: Sequence[Sequence[ExposureMetadata]]) -> tuple[str, ...]:
    """Those that all regions have: several exposures have an error, and the truth that any of them has."""
    known = [{name for head in heads for name in head.arrays if name in CHANNELS} for heads in stacks]
    names = {"image"}
    if all(len(heads) > 1 or "standard_error" in heads[0].arrays for heads in stacks):
        names.add("standard_error")
    totals = {sum(head.samples or 0 for head in heads) for heads in stacks}
    if len(totals) > 1 or any("sample_counts" in head.arrays for heads in stacks for head in heads):
        names.add("sample_counts")
    return tuple(name for name in (*EXPOSURE_NAMES, *CHANNELS) if name in names or all(name in one for one in known))
