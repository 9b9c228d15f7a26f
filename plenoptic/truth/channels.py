"""How image files name the arrays of a ground truth."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.truth.ground_truth import KINDS, GroundTruth

_NAMES = {
    "depth": ("depth.Z",),
    "distance": ("truth.distance",),
    "position": ("truth.position.X", "truth.position.Y", "truth.position.Z"),
    "normal": ("truth.normal.X", "truth.normal.Y", "truth.normal.Z"),
    "object": ("truth.object",),
    "material": ("truth.material",),
    "microlens": ("truth.microlens.I", "truth.microlens.J"),
    "microlens_type": ("truth.microlens.type",),
    "virtual_depth": ("truth.virtual_depth",),
    "disparity": ("truth.disparity",),
}

_MEANING = {
    "depth": "depth.Z is -z in the camera's frame, mm, inf where nothing is met",
    "distance": "truth.distance is that from the camera's origin, mm, inf where nothing is met",
    "position": "truth.position is the point in the world, mm, nan where nothing is met",
    "normal": "truth.normal is the triangle's unit normal in the world, nan where nothing is met",
    "object": "truth.object is the mesh's number, -1 where nothing is met",
    "material": "truth.material is the material's number, -1 where nothing is met",
    "microlens": "truth.microlens.I and J are lattice indices, -2^31 where there is no light",
    "microlens_type": "truth.microlens.type is a row of the focal lengths, -1 where there is no light",
    "virtual_depth": "truth.virtual_depth is the image's distance behind the array over the sensor's",
    "disparity": "truth.disparity is that between neighbouring microlenses, pixels",
}

_PRECISION = "computed in float64, rounded to float32 in this file; whole numbers are exact up to 2^24"


def truth_channels(truth: GroundTruth) -> dict[str, NDArray[Any]]:
    """Channels (H, W) by name."""
    channels: dict[str, NDArray[Any]] = {}
    for kind, array in truth.arrays().items():
        planes = array.reshape(*array.shape[:2], -1)
        channels |= {name: planes[:, :, k] for k, name in enumerate(_NAMES[kind])}
    return channels


def truth_note(truth: GroundTruth) -> str:
    """What the channels are."""
    return "; ".join([*(_MEANING[kind] for kind in truth.arrays()), _PRECISION])


def truth_in(channels: Mapping[str, NDArray[Any]]) -> GroundTruth | None:
    """The ground truth among the channels of a file; None where there is none."""
    found = {}
    for kind, names in _NAMES.items():
        planes = [channels[name] for name in names if name in channels]
        if len(planes) == len(names):
            shape = (*planes[0].shape, *KINDS[kind].shape)
            found[kind] = np.stack(planes, axis=-1).reshape(shape).astype(KINDS[kind].dtype)
    return GroundTruth(**found) if found else None
