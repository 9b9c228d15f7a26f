"""Exposures as named arrays with dimensions, units and coordinates: as xarray datasets, and in zarr stores."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.files.atomic_file import check_folder, real_path, replaced_folder
from plenoptic.core.files.extras import extra_package
from plenoptic.core.files.reading import FileLimits
from plenoptic.core.files.serialization import restored_fields
from plenoptic.core.files.zarr_files import COLUMN, EXTRA, ROW, Store, Variable, zarr_module
from plenoptic.core.files.zarr_reading import attributes_of, read_arrays
from plenoptic.errors import FileError
from plenoptic.optics.sensor.sensor import Sensor
from plenoptic.rendering.exposure_files import CHANNEL_NAMES, KEPT_AS_TEXT, texts_of
from plenoptic.truth.channels import CHANNELS, GroundTruth

if TYPE_CHECKING:
    import xarray

    from plenoptic.rendering.exposure import Exposure

KIND, EXPOSURE, SEQUENCE = "plenoptic:kind", "exposure", "sequence"
"""The attribute that says what a store holds, and what it says."""
CHANNEL = "channel"
_PIXEL = (ROW, COLUMN)
_OWN = {
    "image": Variable(
        (*_PIXEL, CHANNEL), (), np.float32, np.nan, "irradiance: radiance over the solid angle", "scene units sr"
    ),
    "standard_error": Variable(
        (*_PIXEL, CHANNEL), (), np.float32, np.nan, "one standard deviation of the image's error", "scene units sr"
    ),
    "sample_counts": Variable(_PIXEL, (), np.int32, 0, "paths of the pixel"),
}
"""The arrays of an exposure beside the truth; shapes are those of the exposure."""


class Layout(NamedTuple):
    """Which arrays there are, and where on the sensor."""

    shape: tuple[int, int]
    """Rows and columns."""
    channels: int
    """Of the image, 1 or 3."""
    names: tuple[str, ...]
    """Of the arrays: image, standard_error, sample_counts, and fields of `GroundTruth`."""
    corner: tuple[int, int] = (0, 0)
    """The first row and column on the sensor."""
    sensor: Sensor | None = None
    """For the places of pixels in mm; None where it is not known."""


def create_store(
    path: str | os.PathLike[str], layout: Layout, texts: Mapping[str, str], *, frames: int | None = None
) -> Store:
    """A store for an exposure of this layout, or with `frames` for a sequence, whose pixels are put in later."""
    kind = {KIND: EXPOSURE if frames is None else SEQUENCE}
    return Store.create(path, _variables(layout), {**kind, **texts}, frames=frames)


def save_store(exposure: Exposure, path: str | os.PathLike[str]) -> None:
    """Write an exposure to a store, whole or not at all."""
    target = real_path(path)
    check_store(target)
    with replaced_folder(target) as folder:
        rows, columns, _ = exposure.image.shape
        store = create_store(folder, _layout(exposure), texts_of(exposure))
        store.put((0, rows, 0, columns), _arrays(exposure))


def fields_of_store(path: str | os.PathLike[str], limits: FileLimits) -> dict[str, Any]:
    """The fields of the exposure that a store holds."""
    attributes = attributes_of(path)
    if attributes is None or attributes.get(KIND) != EXPOSURE:
        if not os.path.exists(path):
            raise FileError(f"{os.fspath(path)!r} does not exist; check the path")
        found = "a sequence" if attributes is not None and attributes.get(KIND) == SEQUENCE else "no exposure"
        raise FileError(f"{os.fspath(path)!r} holds {found}; open it with xarray.open_zarr")
    arrays = read_arrays(path, (*_OWN, *CHANNELS), limits)
    if "image" not in arrays:
        raise FileError(f"{os.fspath(path)!r} has no array image; restore it from its origin")
    truth = {name: arrays.pop(name) for name in CHANNELS if name in arrays}
    return {**arrays, "truth": GroundTruth(**truth) if truth else None, **restored_fields(attributes, KEPT_AS_TEXT)}


def dataset_of(exposure: Exposure) -> xarray.Dataset:
    """An exposure as xarray takes it; its arrays are not copied."""
    arrays, variables = _arrays(exposure), _variables(_layout(exposure))
    made = {
        name: (one.dimensions, arrays[name] if one.values is None else one.values, one.attributes)
        for name, one in variables.items()
    }
    module = extra_package("xarray", "to_xarray", EXTRA)
    coordinates = {name: made.pop(name) for name, one in variables.items() if one.values is not None}
    return module.Dataset(made, coords=coordinates, attrs={KIND: EXPOSURE, **texts_of(exposure)})


def _arrays(exposure: Exposure) -> dict[str, NDArray[Any]]:
    own = {name: found for name in _OWN if (found := getattr(exposure, name)) is not None}
    return own | dict({} if exposure.truth is None else exposure.truth.arrays())


def _layout(exposure: Exposure) -> Layout:
    rows, columns, channels = exposure.image.shape
    first_row, _, first_column, _ = exposure.region or (0, rows, 0, columns)
    sensor = None if exposure.camera is None else exposure.camera.sensor
    return Layout((rows, columns), channels, tuple(_arrays(exposure)), (first_row, first_column), sensor)


def _variables(layout: Layout) -> dict[str, Variable]:
    """What the arrays are, and their coordinates."""
    made: dict[str, Variable] = {}
    labels = {CHANNEL: CHANNEL_NAMES[layout.channels]}
    for name in layout.names:
        found = _OWN[name] if name in _OWN else _of_truth(name)
        if name in CHANNELS and (numbers := CHANNELS[name].numbers):
            labels[numbers.lower()] = tuple(numbers)
        shape = (*layout.shape, *(len(labels[dimension]) for dimension in found.dimensions[2:]))
        made[name] = found._replace(shape=shape)
    meanings = {CHANNEL: "channel of the image"}
    used = {dimension for one in made.values() for dimension in one.dimensions}
    for dimension, names in labels.items():
        if dimension in used:
            values = np.array(names)
            meaning = meanings.get(dimension, "components")
            made[dimension] = Variable((dimension,), values.shape, values.dtype, 0, meaning, "", {}, values)
    return made | _places(layout)


def _of_truth(name: str) -> Variable:
    channel = CHANNELS[name]
    dimensions = (*_PIXEL, channel.numbers.lower()) if channel.numbers else _PIXEL
    # Whole numbers have no nan: readers are told which number is none. JSON in turn has no nan.
    nothing = channel.void if isinstance(channel.void, int) else f"{channel.void:g}"
    unseen = channel.void if isinstance(channel.void, int) else np.nan
    more = {"nothing_there": nothing}
    return Variable(dimensions, (), channel.dtype, unseen, channel.meaning, channel.unit or "1", more)


def _places(layout: Layout) -> dict[str, Variable]:
    """Rows and columns on the sensor, and where these are in mm."""
    rows, columns = (first + np.arange(n) for first, n in zip(layout.corner, layout.shape, strict=True))

    def along(dimension: str, values: NDArray[Any], meaning: str, unit: str = "1") -> Variable:
        return Variable((dimension,), values.shape, values.dtype, 0, meaning, unit, {}, values)

    made = {ROW: along(ROW, rows, "row on the sensor"), COLUMN: along(COLUMN, columns, "column on the sensor")}
    if layout.sensor is not None:
        x, y = layout.sensor.centre_of(0, columns)[:, 0], layout.sensor.centre_of(rows, 0)[:, 1]
        made["x"] = along(COLUMN, x, "x of the pixel's centre on the sensor, whose middle is 0", "mm")
        made["y"] = along(ROW, y, "y of the pixel's centre on the sensor, whose middle is 0", "mm")
    return made


def check_store(target: Path) -> None:
    """An error where no exposure could be put at `target`."""
    if target.exists() and not _replaceable(target):
        raise FileError(f"{str(target)!r} is there and holds no exposure; choose a new name, or remove it first")
    check_folder(target)
    zarr_module()


def _replaceable(target: Path) -> bool:
    """Whether it is an empty folder or a store with one exposure."""
    if not target.is_dir():
        return False
    return not any(target.iterdir()) or (attributes_of(target) or {}).get(KIND) == EXPOSURE
