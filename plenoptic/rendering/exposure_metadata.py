"""What is known of an exposure before its pixels are read."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import seed_number
from plenoptic.errors import FileError, InvalidValueError
from plenoptic.rendering.crop import checked_region, region_text
from plenoptic.rendering.settings import RenderSettings
from plenoptic.rendering.stats import RenderStats, StopReason
from plenoptic.truth.channels import CHANNELS, GroundTruth, truth_names

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.rendering.exposure import Exposure

EXPOSURE_NAMES = ("image", "standard_error", "sample_counts")
"""The arrays of an exposure beside the truth."""


class ExposureMetadata(NamedTuple):
    """All of an exposure but its pixels; fields are called as those of `Exposure`."""

    shape: tuple[int, int, int]
    """Of the image: rows, columns and channels."""
    arrays: tuple[str, ...]
    """Those that are there: of `EXPOSURE_NAMES`, and fields of `GroundTruth`."""
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
    def place(self) -> tuple[int, int, int, int]:
        """The region on the sensor, that of the whole sensor too."""
        return self.region or (0, self.shape[0], 0, self.shape[1])

    @property
    def seeds(self) -> tuple[int, ...]:
        """All of them; none where they are not known."""
        return self.seed if isinstance(self.seed, tuple) else () if self.seed is None else (self.seed,)

    @property
    def facts(self) -> dict[str, Any]:
        """What is kept beside the arrays, by the names of fields."""
        return {name: getattr(self, name) for name in FACTS}

    def __repr__(self) -> str:
        facts = [" x ".join(map(str, self.shape))]
        if self.stats is not None and self.stats.stopped_by is StopReason.INTERRUPTED:
            facts.append("interrupted")
        if self.samples is not None:
            up_to = "up to " if "sample_counts" in self.arrays else ""
            facts.append(f"{up_to}{self.samples} sample{'s' * (self.samples > 1)} per pixel")
        if flags := [CHANNELS[name].flag for name in self.arrays if name in CHANNELS]:
            facts.append(f"with {truth_names(np.bitwise_or.reduce(flags))}")
        if self.region is not None:
            facts.append(region_text(self.region))
        if self.stats is not None:
            facts.append(f"{self.stats.seconds:.3g} s")
        return f"Exposure({', '.join(facts)})"


FACTS = ExposureMetadata._fields[2:]
"""What files keep as texts."""


def metadata_of(exposure: Exposure) -> ExposureMetadata:
    """That of an exposure in memory."""
    facts = {name: getattr(exposure, name) for name in FACTS}
    return ExposureMetadata(exposure.image.shape, tuple(pixels_of(exposure)), **facts)  # type: ignore[arg-type]


def checked_metadata(shape: tuple[int, ...], arrays: Iterable[str], facts: Mapping[str, Any]) -> ExposureMetadata:
    """That of an image of this shape; an InvalidValueError, as of `Exposure`, for facts that cannot be."""
    from plenoptic.rendering.exposure import Exposure  # knows this module

    if len(shape) != 3 or 0 in shape:
        raise InvalidValueError(f"image has shape {shape}; it must be (H, W, 1) or (H, W, 3), not empty")
    region = facts.get("region")
    placed = None if region is None else checked_region(region, shape[:2])
    others = {name: fact for name, fact in facts.items() if name != "region"}
    one_pixel = Exposure(np.zeros((1, 1, shape[2])), **others)
    return metadata_of(one_pixel)._replace(shape=shape, arrays=tuple(arrays), region=placed)  # type: ignore[arg-type]


def checked_seed(given: int | Sequence[int]) -> int | tuple[int, ...]:
    """A seed, or several different ones in their order, or an error."""
    if isinstance(given, tuple | list):
        seeds = sorted({seed_number(one) for one in given})
        if len(seeds) < 2 or len(seeds) < len(given):
            raise InvalidValueError(f"seed is {given!r}; it must be a number, or two different ones or more")
        return tuple(seeds)
    return seed_number(cast(int, given))


@contextmanager
def possible(path: Any) -> Iterator[None]:
    """An InvalidValueError becomes a FileError that says which file holds no exposure."""
    try:
        yield
    except InvalidValueError as error:
        raise FileError(f"{str(path)!r} holds no possible exposure: {error}") from error


def pixels_of(exposure: Exposure) -> dict[str, NDArray[Any]]:
    """The arrays of an exposure by their names, truth last."""
    own = {name: found for name in EXPOSURE_NAMES if (found := getattr(exposure, name)) is not None}
    return own | dict({} if exposure.truth is None else exposure.truth.arrays())


def fields_of(arrays: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """The way back: the fields of an exposure that has these arrays."""
    truth = {name: array for name, array in arrays.items() if name in CHANNELS}
    own = {name: array for name, array in arrays.items() if name in EXPOSURE_NAMES}
    return {**own, "truth": GroundTruth(**truth) if truth else None}
