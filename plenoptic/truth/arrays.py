"""Arrays of ground truth: which there can be, empty ones, and the planes that hold them in image files."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import check_kind
from plenoptic.truth.channels import CHANNELS, GroundTruth, Needs, Truth, channels_of

_PRECISION = "computed in float64, rounded to float32 in this file; whole numbers are exact up to 2^24"


def checked_truth(truth: Truth) -> Truth:
    """`truth`, or an error where it is something else."""
    check_kind(truth, "truth", Truth, "pl.Truth.DEPTH | pl.Truth.NORMAL")
    return truth & (Truth.ALL | Truth.OBJECT_SHARE | Truth.CHORD_DISPARITY)


def available_truth(truth: Truth, *, meshes: bool, microlenses: bool) -> Truth:
    """Channels of `truth` that exist in a scene with or without meshes, for a camera with or without microlenses."""
    available = (Needs.MESHES if meshes else Needs.NOTHING) | (Needs.MICROLENSES if microlenses else Needs.NOTHING)
    channels = Truth.NONE
    for channel in channels_of(truth).values():
        if not channel.source.needs & ~available:
            channels |= channel.flag
    return channels


def what_needs(needs: Needs) -> str:
    """For a message: the flags of the channels that need this, VIRTUAL_DEPTH, DISPARITY."""
    flags = dict.fromkeys(channel.flag for channel in CHANNELS.values() if channel.source.needs & needs)
    return ", ".join(str(flag.name) for flag in flags)


def empty_truth(truth: Truth, shape: tuple[int, ...]) -> dict[str, NDArray[Any]]:
    """Arrays of the requested channels for pixels of a shape, filled with the values of missing hits."""
    return {
        name: np.full((*shape, *channel.shape), channel.void, dtype=channel.dtype)
        for name, channel in channels_of(truth).items()
    }


def forget_truth(found: Mapping[str, NDArray[Any]], where: NDArray[np.bool_]) -> None:
    """Put the values of unknown pixels into those that have not been evaluated: nan, and invalid numbers."""
    for name, array in found.items():
        array[where] = np.nan if array.dtype.kind == "f" else CHANNELS[name].void


def file_planes(truth: GroundTruth) -> dict[str, NDArray[Any]]:
    """Planes (H, W) by their names in image files."""
    planes: dict[str, NDArray[Any]] = {}
    for name, array in truth.arrays().items():
        numbers = array.reshape(*array.shape[:2], -1)
        planes |= {plane: numbers[:, :, k] for k, plane in enumerate(CHANNELS[name].in_files)}
    return planes


def file_note(truth: GroundTruth) -> str:
    """Description of the planes for files."""
    said = []
    for name in truth.arrays():
        channel = CHANNELS[name]
        unit = f", {channel.unit}" if channel.unit else ""
        said.append(f"{', '.join(channel.in_files)}: {channel.meaning}{unit}; nothing there: {channel.void:g}")
    return "; ".join([*said, _PRECISION])


def truth_named(planes: Collection[str]) -> list[str]:
    """The arrays of ground truth whose planes are among those of a file."""
    return [name for name, channel in CHANNELS.items() if all(plane in planes for plane in channel.in_files)]


def truth_in(planes: Mapping[str, NDArray[Any]]) -> GroundTruth | None:
    """The ground truth among the planes of a file; None where there is none."""
    by_name = {}
    for name in truth_named(planes):
        channel = CHANNELS[name]
        numbers = [planes[plane] for plane in channel.in_files]
        array = np.stack(numbers, axis=-1).reshape(*numbers[0].shape, *channel.shape)
        by_name[name] = array.astype(channel.dtype)
    return GroundTruth(**by_name) if by_name else None
