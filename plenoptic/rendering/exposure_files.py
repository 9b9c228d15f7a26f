"""Exposures in image files: EXR stores everything, 16-bit formats store the picture."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from plenoptic import __version__
from plenoptic.core.files import images
from plenoptic.core.files.atomic_file import check_replaceable, real_path
from plenoptic.core.files.codes import brightest, codes
from plenoptic.core.files.file_limits import FileLimits
from plenoptic.core.files.serialization import describe, fields_from_metadata, fields_to_metadata, restore
from plenoptic.core.values import file_path, positive
from plenoptic.errors import FileError
from plenoptic.rendering.crop import counts_in
from plenoptic.rendering.exposure_metadata import FACTS, ExposureMetadata, checked_metadata, impossible_as_file_error
from plenoptic.truth.truth_arrays import file_comment, file_planes, stored_truth, truth_from_planes

if TYPE_CHECKING:
    from plenoptic.rendering.exposure import Exposure

CHANNEL_NAMES = {1: ("Y",), 3: ("R", "G", "B")}
_SAMPLES = "samples"


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
    if checked_ending(path) == ".zarr":
        from plenoptic.rendering.stores import check_store  # knows this module

        check_store(real_path(path))
    else:
        check_replaceable(real_path(path))


def save_exr(exposure: Exposure, path: str | os.PathLike[str]) -> None:
    """Write everything, as float32."""
    note = {} if exposure.truth is None else {"plenoptic:note": file_comment(exposure.truth)}
    images.write_channels(path, _channels(exposure), texts_of(exposure) | note)


def save_16bit(exposure: Exposure, path: str | os.PathLike[str], scale: float | None, *, linear: bool) -> None:
    """Write the picture, linear or sRGB-encoded; `scale` becomes 65535."""
    scale = positive(brightest(exposure.image) if scale is None else scale, "scale")
    encoding = images.LINEAR if linear else images.SRGB
    texts = texts_of(exposure, ("samples", "replicates", "seed", "region"))
    texts |= {"plenoptic:scale": describe(scale), images.COLOR_SPACE: encoding}
    images.write_16bit(path, codes(exposure.image, scale=scale, encoded=not linear), texts)


def fields_of_image(path: str | os.PathLike[str], limits: FileLimits) -> dict[str, Any]:
    """Fields of the exposure in an image file."""
    image, channels, metadata = images.read_picture(path, limits=limits)
    facts = fields_from_metadata(metadata, FACTS)
    planes = [channels.get(f"error.{name}") for name in CHANNEL_NAMES[image.shape[2]]]
    errors = [plane for plane in planes if plane is not None]
    if "plenoptic:scale" in metadata:
        image = image * np.float32(positive(restore(metadata["plenoptic:scale"]), "scale"))
    return {
        "image": image,
        "standard_error": np.stack(errors, axis=-1) if len(errors) == len(planes) else None,
        "truth": truth_from_planes(channels),
        "sample_counts": counts_in(channels.get(_SAMPLES), facts.get("samples")),
        **facts,
    }


def metadata_of_image(path: str | os.PathLike[str]) -> ExposureMetadata:
    """Metadata of the exposure in an image file."""
    shape, names, picture, metadata = images.read_header(path)
    arrays = ["image"]
    if all(f"error.{name}" in names for name in CHANNEL_NAMES[len(picture)]):
        arrays.append("standard_error")
    if _SAMPLES in names:
        arrays.append("sample_counts")
    with impossible_as_file_error(path):
        return checked_metadata(
            (*shape, len(picture)), (*arrays, *stored_truth(names)), fields_from_metadata(metadata, FACTS)
        )


def _channels(exposure: Exposure) -> Mapping[str, NDArray[Any]]:
    names = CHANNEL_NAMES[exposure.image.shape[2]]
    channels: dict[str, NDArray[Any]] = {name: exposure.image[:, :, i] for i, name in enumerate(names)}
    if exposure.standard_error is not None:
        channels |= {f"error.{name}": exposure.standard_error[:, :, i] for i, name in enumerate(names)}
    if exposure.sample_counts is not None:
        channels[_SAMPLES] = exposure.sample_counts.astype(np.float32)
    if exposure.truth is not None:
        channels |= file_planes(exposure.truth)
    return channels
