"""Exposures as named arrays with dimensions, units and coordinates: xarray datasets, and zarr stores."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.files.atomic_file import check_folder, real_path, replace_folder
from plenoptic.core.files.extras import extra_package
from plenoptic.core.files.file_limits import FileLimits
from plenoptic.core.files.serialization import fields_from_metadata
from plenoptic.core.files.zarr_files import COLUMN, EXTRA, FRAME, ROW, Store, Variable, zarr_module
from plenoptic.core.files.zarr_reading import ANY_SIZE, array_shapes, attributes_of, read_arrays
from plenoptic.core.values import Floats
from plenoptic.errors import FileError
from plenoptic.optics.sensor.sensor import Sensor
from plenoptic.rendering.exposure_files import CHANNEL_NAMES, texts_of
from plenoptic.rendering.exposure_metadata import (
    EXPOSURE_NAMES,
    FACTS,
    ExposureMetadata,
    checked_metadata,
    fields_of,
    impossible_as_file_error,
    pixels_of,
)
from plenoptic.truth.channels import CHANNELS, Truth
from plenoptic.truth.truth_arrays import available_truth, empty_truth

if TYPE_CHECKING:
    import xarray

    from plenoptic.rendering.exposure import Exposure

KIND, EXPOSURE, SEQUENCE = "plenoptic:kind", "exposure", "sequence"
"""Attribute with the kind of a store's content, and its values."""
CHANNEL, TIME = "channel", "time"
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
"""Arrays of an exposure other than the truth; shapes are those of the exposure."""
_MOTION = {
    "motion_position": Variable(
        (*_PIXEL, "xyz"), (), np.float64, np.nan, "place in the next frame of the scene point, in the world", "mm"
    ),
    "motion_shift": Variable(
        (*_PIXEL, "along"),
        (),
        np.float64,
        np.nan,
        "shift of its image behind the same microlens in the next frame",
        "px",
    ),
    "motion_visible": Variable(_PIXEL, (), np.bool_, False, "whether it is seen in the next frame"),
}
_LABELS = {"xyz": ("X", "Y", "Z"), "along": ("columns", "rows")}
MOTION_NAMES = tuple(_MOTION)
"""Arrays of a `MotionTruth` in the order of its fields."""


class Layout(NamedTuple):
    """Names of the arrays of a store, and their position on the sensor."""

    shape: tuple[int, int]
    """Rows and columns."""
    channels: int
    """Channels of the image, 1 or 3."""
    names: tuple[str, ...]
    """Names of the arrays: image, standard_error, sample_counts, fields of `GroundTruth`, and those of motions."""
    corner: tuple[int, int] = (0, 0)
    """First row and column on the sensor."""
    sensor: Sensor | None = None
    """Sensor, for the positions of pixels in mm; None if unknown."""


def empty_arrays(layout: Layout) -> dict[str, NDArray[Any]]:
    """Uninitialised arrays of a layout in memory."""
    pixels = {name: variable for name, variable in _variables(layout).items() if variable.values is None}
    return {name: np.empty(variable.shape, dtype=variable.dtype) for name, variable in pixels.items()}


def create_store(
    path: str | os.PathLike[str], layout: Layout, texts: Mapping[str, str], *, times: Floats | None = None
) -> Store:
    """Create a store for an exposure of this layout, or with `times` (s) for a sequence; pixels are added later."""
    kind, variables = {KIND: EXPOSURE if times is None else SEQUENCE}, _variables(layout)
    if times is not None:
        variables[TIME] = Variable((FRAME,), times.shape, times.dtype, 0, "time of the frame", "s", {}, times)
    return Store.create(path, variables, {**kind, **texts}, frames=None if times is None else len(times))


def save_store(exposure: Exposure, path: str | os.PathLike[str]) -> None:
    """Write an exposure to a store, atomically."""
    target = real_path(path)
    check_store(target)
    with replace_folder(target) as folder:
        rows, columns, _ = exposure.image.shape
        store = create_store(folder, layout_of(exposure), texts_of(exposure))
        store.put((0, rows, 0, columns), pixels_of(exposure))


def fields_of_store(path: str | os.PathLike[str], limits: FileLimits) -> dict[str, Any]:
    """Fields of the exposure in a store."""
    texts = _attributes(path)
    return {**fields_of(_read(path, limits)), **fields_from_metadata(texts, FACTS)}


def metadata_of_store(path: str | os.PathLike[str]) -> ExposureMetadata:
    """Metadata of the exposure in a store."""
    texts = _attributes(path)
    shapes = array_shapes(path, (*EXPOSURE_NAMES, *CHANNELS))
    with impossible_as_file_error(path):
        return checked_metadata(shapes.get("image", ()), shapes, fields_from_metadata(texts, FACTS))


def rows_of_store(path: str | os.PathLike[str], metadata: ExposureMetadata, first: int, end: int) -> Exposure:
    """Some rows of the exposure in a store of this metadata, of any size, without region."""
    from plenoptic.rendering.exposure import Exposure  # knows this module

    with impossible_as_file_error(path):
        return Exposure(**fields_of(_read(path, ANY_SIZE, slice(first, end))), samples=metadata.samples)


def _attributes(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Attributes of a store that contains an exposure; raise FileError for other content."""
    attributes = attributes_of(path)
    if attributes is None or attributes.get(KIND) != EXPOSURE:
        if not os.path.exists(path):
            raise FileError(f"{os.fspath(path)!r} does not exist; check the path")
        content = "a sequence" if attributes is not None and attributes.get(KIND) == SEQUENCE else "no exposure"
        raise FileError(f"{os.fspath(path)!r} holds {content}; open it with xarray.open_zarr")
    return attributes


def _read(path: str | os.PathLike[str], limits: FileLimits, rows: slice = slice(None)) -> dict[str, NDArray[Any]]:
    arrays = read_arrays(path, (*EXPOSURE_NAMES, *CHANNELS), limits, rows=rows)
    if "image" not in arrays:
        raise FileError(f"{os.fspath(path)!r} has no array image; restore it from its origin")
    return arrays


def dataset_of(exposure: Exposure) -> xarray.Dataset:
    """An exposure as xarray dataset; its arrays are not copied."""
    arrays, variables = pixels_of(exposure), _variables(layout_of(exposure))
    data = {
        name: (variable.dimensions, arrays[name] if variable.values is None else variable.values, variable.attributes)
        for name, variable in variables.items()
    }
    module = extra_package("xarray", "to_xarray", EXTRA)
    coordinates = {name: data.pop(name) for name, variable in variables.items() if variable.values is not None}
    return module.Dataset(data, coords=coordinates, attrs={KIND: EXPOSURE, **texts_of(exposure)})


def layout_of(exposure: Exposure, truth: Truth = Truth.NONE, *, microlenses: bool = False) -> Layout:
    """Layout of an exposure, plus the channels of `truth` that other exposures may have, also with `microlenses`."""
    rows, columns, channels = exposure.image.shape
    first_row, _, first_column, _ = exposure.region or (0, rows, 0, columns)
    sensor = None if exposure.camera is None else exposure.camera.sensor
    truth_fields = tuple(empty_truth(available_truth(truth, meshes=True, microlenses=microlenses), (0, 0)))
    names = tuple(dict.fromkeys((*pixels_of(exposure), *truth_fields)))
    return Layout((rows, columns), channels, names, (first_row, first_column), sensor)


def _variables(layout: Layout) -> dict[str, Variable]:
    """Variables of the arrays, and their coordinates."""
    variables: dict[str, Variable] = {}
    templates, labels = _OWN | _MOTION, {CHANNEL: CHANNEL_NAMES[layout.channels], **_LABELS}
    for name in layout.names:
        variable = templates[name] if name in templates else _truth_variable(name)
        if name in CHANNELS and (numbers := CHANNELS[name].numbers):
            labels[numbers.lower()] = tuple(numbers)
        shape = (*layout.shape, *(len(labels[dimension]) for dimension in variable.dimensions[2:]))
        variables[name] = variable._replace(shape=shape)
    meanings = {CHANNEL: "channel of the image"}
    used = {dimension for template in variables.values() for dimension in template.dimensions}
    for dimension, names in labels.items():
        if dimension in used:
            values = np.array(names)
            meaning = meanings.get(dimension, "components")
            variables[dimension] = Variable((dimension,), values.shape, values.dtype, 0, meaning, "", {}, values)
    return variables | _coordinates(layout)


def _truth_variable(name: str) -> Variable:
    channel = CHANNELS[name]
    dimensions = (*_PIXEL, channel.numbers.lower()) if channel.numbers else _PIXEL
    # Integers have no nan: an attribute names the number that means nothing. JSON in turn has no nan.
    void = channel.void if isinstance(channel.void, int) else f"{channel.void:g}"
    fill_value = channel.void if isinstance(channel.void, int) else np.nan
    attributes = {"nothing_there": void}
    return Variable(dimensions, (), channel.dtype, fill_value, channel.meaning, channel.unit or "1", attributes)


def _coordinates(layout: Layout) -> dict[str, Variable]:
    """Coordinates: rows and columns on the sensor, and their positions in mm."""
    rows, columns = (first + np.arange(n) for first, n in zip(layout.corner, layout.shape, strict=True))

    def along(dimension: str, values: NDArray[Any], meaning: str, unit: str = "1") -> Variable:
        return Variable((dimension,), values.shape, values.dtype, 0, meaning, unit, {}, values)

    coordinates = {ROW: along(ROW, rows, "row on the sensor"), COLUMN: along(COLUMN, columns, "column on the sensor")}
    if layout.sensor is not None:
        x, y = layout.sensor.centre_of(0, columns)[:, 0], layout.sensor.centre_of(rows, 0)[:, 1]
        coordinates["x"] = along(COLUMN, x, "x of the pixel's centre on the sensor, whose middle is 0", "mm")
        coordinates["y"] = along(ROW, y, "y of the pixel's centre on the sensor, whose middle is 0", "mm")
    return coordinates


def check_store(target: Path) -> None:
    """Raise an error if no exposure could be written at `target`."""
    if target.exists() and not _replaceable(target):
        raise FileError(f"{str(target)!r} is there and holds no exposure; choose a new name, or remove it first")
    check_folder(target)
    zarr_module()


def _replaceable(target: Path) -> bool:
    """True for an empty folder or a store with one exposure."""
    if not target.is_dir():
        return False
    return not any(target.iterdir()) or (attributes_of(target) or {}).get(KIND) == EXPOSURE
