"""Metadata of an exposure, available before its pixels are read."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import seed_number
from plenoptic.errors import InvalidValueError
from plenoptic.rendering.crop import checked_region, region_text
from plenoptic.rendering.settings import RenderSettings
from plenoptic.rendering.stats import RenderStats, StopReason
from plenoptic.truth.channels import CHANNELS, GroundTruth, truth_names

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.rendering.exposure import Exposure

EXPOSURE_NAMES = ("image", "standard_error", "sample_counts")
"""Names of the arrays of an exposure other than the truth."""


class ExposureMetadata(NamedTuple):
    """All of an exposure except its pixels; fields have the names of `Exposure`."""

    shape: tuple[int, int, int]
    """Rows, columns and channels of the image."""
    arrays: tuple[str, ...]
    """Names of the existing arrays: of `EXPOSURE_NAMES`, and fields of `GroundTruth`."""
    samples: int | None = None
    replicates: int | None = None
    seed: int | tuple[int, ...] | None = None
    region: tuple[int, int, int, int] | None = None
    camera: PlenopticCamera | None = None
    stats: RenderStats | None = None
    settings: RenderSettings | None = None
    white: bool | None = None
    object_names: tuple[str, ...] | None = None

    @property
    def sensor_region(self) -> tuple[int, int, int, int]:
        """The region on the sensor, also if it is the whole sensor."""
        return self.region or (0, self.shape[0], 0, self.shape[1])

    @property
    def seeds(self) -> tuple[int, ...]:
        """All seeds; empty if unknown."""
        return self.seed if isinstance(self.seed, tuple) else () if self.seed is None else (self.seed,)

    @property
    def facts(self) -> dict[str, Any]:
        """Metadata stored as texts, by the names of fields."""
        return {name: getattr(self, name) for name in FACTS}

    def __repr__(self) -> str:
        return f"Exposure({self.summary()})"

    def summary(self, samples: str = "", quality: str = "") -> str:
        """One line of facts, with texts on the samples and the errors of pixels if these are known."""
        if not samples and self.samples is not None:
            up_to = "up to " if "sample_counts" in self.arrays else ""
            samples = f"{up_to}{self.samples} sample{'s' * (self.samples > 1)} per pixel"
        flags = [CHANNELS[name].flag for name in self.arrays if name in CHANNELS]
        parts = (
            " x ".join(map(str, self.shape)),
            "interrupted" if self.stats is not None and self.stats.stopped_by is StopReason.INTERRUPTED else "",
            samples,
            quality,
            f"with {truth_names(np.bitwise_or.reduce(flags))}" if flags else "",
            "" if self.region is None else region_text(self.region),
            "" if self.stats is None else f"{self.stats.seconds:.3g} s",
        )
        return ", ".join(filter(None, parts))


FACTS: tuple[str, ...] = ExposureMetadata._fields[2:]
"""Fields stored as texts in files."""


def metadata_of(exposure: Exposure) -> ExposureMetadata:
    """Metadata of an exposure in memory."""
    facts = {name: getattr(exposure, name) for name in FACTS}
    return ExposureMetadata(exposure.image.shape, tuple(pixels_of(exposure)), **facts)  # type: ignore[arg-type]


def checked_metadata(shape: tuple[int, ...], arrays: Iterable[str], facts: Mapping[str, Any]) -> ExposureMetadata:
    """Metadata of an image of this shape; raises InvalidValueError, as `Exposure` does, for impossible facts."""
    from plenoptic.rendering.exposure import Exposure  # knows this module

    if len(shape) != 3 or 0 in shape:
        raise InvalidValueError(f"image has shape {shape}; it must be (H, W, 1) or (H, W, 3), not empty")
    region = facts.get("region")
    checked = None if region is None else checked_region(region, shape[:2])
    other_facts = {name: fact for name, fact in facts.items() if name != "region"}
    one_pixel = Exposure(np.zeros((1, 1, shape[2])), **other_facts)
    return metadata_of(one_pixel)._replace(shape=shape, arrays=tuple(arrays), region=checked)  # type: ignore[arg-type]


def checked_seed(seed: int | Sequence[int]) -> int | tuple[int, ...]:
    """Return a seed, or several different ones in order; raise InvalidValueError otherwise."""
    if isinstance(seed, tuple | list):
        seeds = sorted({seed_number(number) for number in seed})
        if len(seeds) < 2 or len(seeds) < len(seed):
            raise InvalidValueError(f"seed is {seed!r}; it must be a number, or two different ones or more")
        return tuple(seeds)
    return seed_number(cast(int, seed))


def pixels_of(exposure: Exposure) -> dict[str, NDArray[Any]]:
    """Arrays of an exposure by their names, truth last."""
    arrays = {name: array for name in EXPOSURE_NAMES if (array := getattr(exposure, name)) is not None}
    return arrays | dict({} if exposure.truth is None else exposure.truth.arrays())


def fields_of(arrays: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """Fields of an exposure with these arrays: the inverse of `pixels_of`."""
    truth = {name: array for name, array in arrays.items() if name in CHANNELS}
    exposure_arrays = {name: array for name, array in arrays.items() if name in EXPOSURE_NAMES}
    return {**exposure_arrays, "truth": GroundTruth(**truth) if truth else None}
