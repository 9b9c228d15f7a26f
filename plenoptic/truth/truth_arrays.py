"""Arrays of ground truth: available channels, empty arrays, and their planes in image files."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import check_kind
from plenoptic.truth.channels import CHANNELS, GroundTruth, Needs, Truth, channels_of

_PRECISION = "computed in float64, rounded to float32 in this file; whole numbers are exact up to 2^24"


def valid_truth(truth: Truth) -> Truth:
    """Return known flags of `truth`; InvalidValueError for another type."""
    check_kind(truth, "truth", Truth, "pl.Truth.DEPTH | pl.Truth.NORMAL")
    by_name = Truth.OBJECT_SHARE | Truth.CHORD_DISPARITY | Truth.OPTICAL_DISTANCE | Truth.TRANSMITTANCE
    return truth & (Truth.ALL | by_name)


def available_truth(truth: Truth, *, meshes: bool, microlenses: bool) -> Truth:
    """Flags of `truth` that are available with or without meshes and microlenses."""
    contents = (Needs.MESHES if meshes else Needs.NOTHING) | (Needs.MICROLENSES if microlenses else Needs.NOTHING)
    available = Truth.NONE
    for channel in channels_of(truth).values():
        if not channel.needs & ~contents:
            available |= channel.flag
    return available


def flags_needing(needs: Needs) -> str:
    """Names of the flags whose channels have some needs, such as VIRTUAL_DEPTH, DISPARITY; for messages."""
    flags = dict.fromkeys(channel.flag for channel in CHANNELS.values() if channel.needs & needs)
    return ", ".join(str(flag.name) for flag in flags)


def empty_truth(truth: Truth, shape: tuple[int, ...]) -> dict[str, NDArray[Any]]:
    """Arrays of the requested channels for pixels of a shape, filled with their void values."""
    return {
        name: np.full((*shape, *channel.shape), channel.void, dtype=channel.dtype)
        for name, channel in channels_of(truth).items()
    }


def mark_unknown(arrays: Mapping[str, NDArray[Any]], where: NDArray[np.bool_]) -> None:
    """Mark pixels as not computed: nan in float arrays, the void value in integer arrays."""
    for name, array in arrays.items():
        array[where] = np.nan if array.dtype.kind == "f" else CHANNELS[name].void


def file_planes(truth: GroundTruth) -> dict[str, NDArray[Any]]:
    """Planes (H, W) of a ground truth by their names in image files."""
    planes: dict[str, NDArray[Any]] = {}
    for name, array in truth.arrays().items():
        numbers = array.reshape(*array.shape[:2], -1)
        planes |= {plane: numbers[:, :, k] for k, plane in enumerate(CHANNELS[name].in_files)}
    return planes


def file_comment(truth: GroundTruth) -> str:
    """Comment for image files: meaning, unit and void value of each plane."""
    comments = []
    for name in truth.arrays():
        channel = CHANNELS[name]
        unit = f", {channel.unit}" if channel.unit else ""
        comments.append(f"{', '.join(channel.in_files)}: {channel.meaning}{unit}; nothing there: {channel.void:g}")
    return "; ".join([*comments, _PRECISION])


def stored_truth(planes: Collection[str]) -> list[str]:
    """Names of the truth arrays whose planes are all in a file."""
    return [name for name, channel in CHANNELS.items() if all(plane in planes for plane in channel.in_files)]


def truth_from_planes(planes: Mapping[str, NDArray[Any]]) -> GroundTruth | None:
    """Ground truth from the planes of a file; None if there is none."""
    arrays = {}
    for name in stored_truth(planes):
        channel = CHANNELS[name]
        numbers = [planes[plane] for plane in channel.in_files]
        array = np.stack(numbers, axis=-1).reshape(*numbers[0].shape, *channel.shape)
        arrays[name] = array.astype(channel.dtype)
    return GroundTruth(**arrays) if arrays else None
