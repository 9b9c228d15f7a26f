"""Exposures in files: EXR and zarr store everything, 16-bit formats store the picture; xarray datasets.

Arrays have names, dimensions, units and coordinates from one list, by which stores and datasets are made.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic import __version__
from plenoptic.core.files import images
from plenoptic.core.files.atomic_file import check_folder, check_replaceable, real_path, replace_folder
from plenoptic.core.files.codes import COLOR_SPACE, brightest, codes
from plenoptic.core.files.extras import extra_package
from plenoptic.core.files.file_limits import FileLimits, content_errors
from plenoptic.core.files.serialization import describe, fields_from_metadata, fields_to_metadata, restore
from plenoptic.core.files.zarr_files import (
    ANY_SIZE,
    COLUMN,
    EXTRA,
    FRAME,
    ROW,
    Store,
    Variable,
    array_shapes,
    attributes_of,
    coordinate,
    read_arrays,
    zarr_module,
)
from plenoptic.core.values import Floats, file_path, positive
from plenoptic.errors import FileError
from plenoptic.optics.sensor.sensor import Sensor
from plenoptic.rendering.crop import counts_in
from plenoptic.rendering.exposure_metadata import (
    EXPOSURE_NAMES,
    FACTS,
    ExposureMetadata,
    checked_metadata,
    fields_of,
    pixels_of,
)
from plenoptic.truth.channels import CHANNELS, Truth, channels_of
from plenoptic.truth.truth_arrays import available_truth, file_comment, file_planes, stored_truth, truth_from_planes

if TYPE_CHECKING:
    import xarray

    from plenoptic.rendering.exposure import Exposure

CHANNEL_NAMES = {1: ("Y",), 3: ("R", "G", "B")}
_SAMPLES = "samples"
KIND, EXPOSURE, SEQUENCE = "plenoptic:kind", "exposure", "sequence"
"""Attribute with the kind of a store's content, and its values."""
CHANNEL, TIME = "channel", "time"
_PIXEL = (ROW, COLUMN)
_COLOURS = (*_PIXEL, CHANNEL)
_POSITION = "place in the next frame of the scene point, in the world"
_SHIFT = "shift of its image behind the same microlens in the next frame"
_MOTION = {
    "motion_position": Variable((*_PIXEL, "xyz"), (), np.float64, np.nan, _POSITION, "mm"),
    "motion_shift": Variable((*_PIXEL, "along"), (), np.float64, np.nan, _SHIFT, "px"),
    "motion_visible": Variable(_PIXEL, (), np.bool_, False, "whether it is seen in the next frame"),
}
MOTION_NAMES = tuple(_MOTION)
"""Arrays of a `MotionTruth` in the order of its fields."""
_ARRAYS = {
    "image": Variable(_COLOURS, (), np.float32, np.nan, "irradiance: radiance over the solid angle", "scene units sr"),
    "standard_error": Variable(
        _COLOURS, (), np.float32, np.nan, "one standard deviation of the image's error", "scene units sr"
    ),
    "sample_counts": Variable(_PIXEL, (), np.int32, 0, "paths of the pixel"),
    **_MOTION,
}
"""Arrays other than the truth; shapes are those of the exposure."""


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


def layout_of(exposure: Exposure, truth: Truth = Truth.NONE, *, microlenses: bool = False) -> Layout:
    """Layout of an exposure, plus the channels of `truth` that other exposures may have, also with `microlenses`."""
    rows, columns, channels = exposure.image.shape
    first_row, _, first_column, _ = exposure.region or (0, rows, 0, columns)
    sensor = None if exposure.camera is None else exposure.camera.sensor
    truth_fields = channels_of(available_truth(truth, meshes=True, microlenses=microlenses))
    names = tuple(dict.fromkeys((*pixels_of(exposure), *truth_fields)))
    return Layout((rows, columns), channels, names, (first_row, first_column), sensor)


def empty_arrays(layout: Layout) -> dict[str, NDArray[Any]]:
    """Uninitialised arrays of a layout in memory."""
    pixels = {name: variable for name, variable in _variables(layout).items() if variable.values is None}
    return {name: np.empty(variable.shape, dtype=variable.dtype) for name, variable in pixels.items()}


def _variables(layout: Layout) -> dict[str, Variable]:
    """Variables of the arrays, and their coordinates: names of components, rows, columns, and mm on the sensor."""
    labels = {CHANNEL: CHANNEL_NAMES[layout.channels], "xyz": ("X", "Y", "Z"), "along": ("columns", "rows")}
    variables, coordinates = dict[str, Variable](), dict[str, Variable]()
    for name in layout.names:
        variable = _ARRAYS[name] if name in _ARRAYS else _truth_variable(name)
        if name in CHANNELS and (numbers := CHANNELS[name].numbers):
            labels[numbers.lower()] = tuple(numbers)
        components = variable.dimensions[2:]
        variables[name] = variable._replace(shape=(*layout.shape, *(len(labels[name]) for name in components)))
        for component in components:
            meaning = "channel of the image" if component == CHANNEL else "components"
            coordinates[component] = coordinate(component, np.array(labels[component]), meaning, "")
    rows, columns = (first + np.arange(n) for first, n in zip(layout.corner, layout.shape, strict=True))
    coordinates[ROW] = coordinate(ROW, rows, "row on the sensor")
    coordinates[COLUMN] = coordinate(COLUMN, columns, "column on the sensor")
    if layout.sensor is not None:
        x, y = layout.sensor.centre_of(0, columns)[:, 0], layout.sensor.centre_of(rows, 0)[:, 1]
        for name, along, values in (("x", COLUMN, x), ("y", ROW, y)):
            meaning = f"{name} of the pixel's centre on the sensor, whose middle is 0"
            coordinates[name] = coordinate(along, values, meaning, "mm")
    return variables | coordinates


def _truth_variable(name: str) -> Variable:
    channel = CHANNELS[name]
    dimensions = (*_PIXEL, channel.numbers.lower()) if channel.numbers else _PIXEL
    # Integers have no nan: an attribute names the number that means nothing. JSON in turn has no nan.
    is_integer = isinstance(channel.void, int)
    attributes = {"nothing_there": channel.void if is_integer else f"{channel.void:g}"}
    fill_value = channel.void if is_integer else np.nan
    return Variable(dimensions, (), channel.dtype, fill_value, channel.meaning, channel.unit or "1", attributes)


def texts_of(exposure: Exposure | ExposureMetadata, names: tuple[str, ...] = FACTS) -> dict[str, str]:
    """Metadata texts of an exposure for files."""
    return {"Software": f"plenoptic {__version__}", **fields_to_metadata(exposure, names)}


def checked_ending(path: str | os.PathLike[str]) -> str:
    """Lower-case suffix of a file that `Exposure.save` can write; raise FileError otherwise."""
    suffix = file_path(path).suffix.lower()
    if suffix not in (".exr", ".zarr", ".tif", ".tiff", ".png"):
        raise FileError(f"{os.fspath(path)!r} ends in {suffix!r}; it must end in .exr, .zarr, .tif, .tiff or .png")
    return suffix


def check_target(path: str | os.PathLike[str]) -> None:
    """Raise an error if `Exposure.save` could not write to a path, before a long render."""
    (check_store if checked_ending(path) == ".zarr" else check_replaceable)(real_path(path))


def save_exr(exposure: Exposure, path: str | os.PathLike[str]) -> None:
    """Write everything, as float32."""
    channels: dict[str, NDArray[Any]] = {}
    for prefix, array in (("", exposure.image), ("error.", exposure.standard_error)):
        if array is not None:
            channels |= {f"{prefix}{name}": array[:, :, i] for i, name in enumerate(CHANNEL_NAMES[array.shape[2]])}
    if exposure.sample_counts is not None:
        channels[_SAMPLES] = exposure.sample_counts
    texts = texts_of(exposure)
    if exposure.truth is not None:
        channels |= file_planes(exposure.truth)
        texts["plenoptic:note"] = file_comment(exposure.truth)
    images.write_channels(path, channels, texts)


def save_16bit(exposure: Exposure, path: str | os.PathLike[str], scale: float | None, *, linear: bool) -> None:
    """Write the picture, linear or sRGB-encoded; `scale` becomes 65535."""
    scale = positive(brightest(exposure.image) if scale is None else scale, "scale")
    encoding = images.LINEAR if linear else images.SRGB
    texts = texts_of(exposure, ("samples", "replicates", "seed", "region"))
    texts |= {"plenoptic:scale": describe(scale), COLOR_SPACE: encoding}
    images.write_16bit(path, codes(exposure.image, scale=scale, encoded=not linear), texts)


def fields_of_image(path: str | os.PathLike[str], limits: FileLimits) -> dict[str, Any]:
    """Fields of the exposure in an image file."""
    image, channels, metadata = images.read_picture(path, limits=limits)
    facts = fields_from_metadata(metadata, FACTS)
    errors = [f"error.{name}" for name in CHANNEL_NAMES[image.shape[2]]]
    if "plenoptic:scale" in metadata:
        image = image * np.float32(positive(restore(metadata["plenoptic:scale"]), "scale"))
    return {
        "image": image,
        "standard_error": np.stack([channels[name] for name in errors], -1) if {*errors} <= {*channels} else None,
        "truth": truth_from_planes(channels),
        "sample_counts": counts_in(channels.get(_SAMPLES), facts.get("samples")),
        **facts,
    }


def metadata_of_image(path: str | os.PathLike[str]) -> ExposureMetadata:
    """Metadata of the exposure in an image file."""
    shape, names, picture, metadata, _ = images.read_header(path)
    planes = {"standard_error": [f"error.{name}" for name in CHANNEL_NAMES[len(picture)]], "sample_counts": [_SAMPLES]}
    arrays = ["image", *(array for array, needed in planes.items() if {*needed} <= {*names}), *stored_truth(names)]
    with content_errors(os.fspath(path), "holds no possible exposure"):
        return checked_metadata((*shape, len(picture)), arrays, fields_from_metadata(metadata, FACTS))


def create_store(
    path: str | os.PathLike[str], layout: Layout, texts: Mapping[str, str], *, times: Floats | None = None
) -> Store:
    """Create a store for an exposure of this layout, or with `times` (s) for a sequence; pixels are added later."""
    kind, variables = {KIND: EXPOSURE if times is None else SEQUENCE}, _variables(layout)
    if times is not None:
        variables[TIME] = coordinate(FRAME, times, "time of the frame", "s")
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
    with content_errors(os.fspath(path), "holds no possible exposure"):
        return checked_metadata(shapes.get("image", ()), shapes, fields_from_metadata(texts, FACTS))


def rows_of_store(path: str | os.PathLike[str], metadata: ExposureMetadata, first: int, end: int) -> Exposure:
    """Some rows of the exposure in a store of this metadata, of any size, without region."""
    from plenoptic.rendering.exposure import Exposure  # knows this module

    with content_errors(os.fspath(path), "holds no possible exposure"):
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


def check_store(target: Path) -> None:
    """Raise an error if no exposure could be written at `target`: it is no empty folder and no store with one."""
    is_empty = target.is_dir() and not any(target.iterdir())
    if target.exists() and not is_empty and (attributes_of(target) or {}).get(KIND) != EXPOSURE:
        raise FileError(f"{str(target)!r} is there and holds no exposure; choose a new name, or remove it first")
    check_folder(target)
    zarr_module()


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
