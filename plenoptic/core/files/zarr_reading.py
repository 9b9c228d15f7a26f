"""Reading of zarr stores: their attributes, descriptions of their arrays, and the arrays themselves.

A part at a time they are read by xarray. A store may come from anywhere: its content is checked as files are.
"""

from __future__ import annotations

import json
import math
import os
import stat
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.files.atomic_file import explained
from plenoptic.core.files.reading import DEFAULT, FileLimits, check_memory, read_file
from plenoptic.core.files.zarr_files import dimensions_of, understood, zarr_module
from plenoptic.core.values import file_path
from plenoptic.errors import FileError

METADATA = "zarr.json"
"""The file by which a folder is known as a store, and which holds its attributes."""
_CODECS = {"bytes", "transpose", "blosc", "zstd", "gzip", "crc32c"}
"""What arrays that are read may be packed with: what the format itself describes."""
ANY_SIZE = FileLimits(file_size=1 << 62)
"""For stores of which a part is read."""
_AT_ONCE = 10
"""Chunks that zarr reads at a time."""


def attributes_of(path: str | os.PathLike[str]) -> dict[str, Any] | None:
    """The attributes of a store, of any origin; None where a folder or file is none."""
    file = file_path(path) / METADATA
    if not file.is_file():
        return None
    try:
        content = json.loads(read_file(file))
        return dict(content["attributes"]) if content["node_type"] == "group" else None
    except (ValueError, LookupError, TypeError, RecursionError):
        return None


def described(path: str | os.PathLike[str]) -> tuple[dict[str, str], int]:
    """One-line description of each array of pixels, by name, and the bytes of the whole on the disk."""
    folder = file_path(path)
    size, lines = _size(folder, ANY_SIZE), {}
    for name, array in _opened(folder).items():
        if array.ndim > 1:  # others are coordinates
            sides = ", ".join(f"{side} {n}" for side, n in zip(dimensions_of(array), array.shape, strict=True))
            about = ", ".join(str(array.attrs[key]) for key in ("units", "long_name") if key in array.attrs)
            lines[name] = f"({sides}) {array.dtype}{about and ', ' + about.removeprefix('1, ')}"
    return lines, size


def array_shapes(path: str | os.PathLike[str], names: tuple[str, ...]) -> dict[str, tuple[int, ...]]:
    """The shapes of those of the named arrays that a store has; no pixel is read."""
    found = _opened(file_path(path))
    return {name: tuple(found[name].shape) for name in names if name in found}


def read_arrays(
    path: str | os.PathLike[str],
    names: tuple[str, ...],
    limits: FileLimits = DEFAULT,
    *,
    frame: int | None = None,
    rows: slice = slice(None),
) -> dict[str, NDArray[Any]]:
    """Read the named arrays that a store has: whole, of a frame, or some rows where it is not a sequence.

    A FileError where they cannot be read, or a frame lacks one.
    """
    folder = file_path(path)
    found = {name: array for name, array in _opened(folder).items() if name in names}
    if frame is not None and (lost := sorted({*names} - found.keys())):
        raise FileError(f"{str(folder)!r} has no array {', '.join(lost)}; restore it from its origin")
    parts = [folder] if frame is None else [folder / name / "c" / str(frame) for name in found]
    size = sum(_size(part, limits) for part in parts)
    wanted = 0
    with understood(folder, "read"):
        for name, array in found.items():
            used = {codec["name"] for codec in array.metadata.to_dict()["codecs"]}
            if not used <= _CODECS or array.dtype.kind not in "biuf":
                raise FileError(f"{str(folder / name)!r} is packed by {', '.join(sorted(used))}; that is not read here")
            first = len(range(*rows.indices(array.shape[0]))) if frame is None else 1
            numbers = first * math.prod(array.shape[1:]) + math.prod(array.chunks) * _AT_ONCE
            wanted += numbers * array.dtype.itemsize
        check_memory(2 * wanted, repr(str(folder)), size, limits)  # an exposure copies what it is given
        if frame is not None:
            for name, array in found.items():
                _check_chunks(folder / name, array, frame)
        return {name: np.asarray(array[rows if frame is None else frame]) for name, array in found.items()}


def _check_chunks(folder: Path, array: Any, frame: int) -> None:
    """An error where a chunk of a frame is not there: zarr would fill it with nan and say nothing."""
    for place in np.ndindex(*(-(-n // chunk) for n, chunk in zip(array.shape[1:], array.chunks[1:], strict=True))):
        key = array.metadata.encode_chunk_key((frame, *place))
        if not (folder / key).is_file():
            raise FileError(f"{str(folder / key)!r} is missing; restore it, or call `dataset.write` to render it again")


def _opened(folder: Path) -> dict[str, Any]:
    """The arrays of a store that is read; an error where one is none, which zarr passes over."""
    with understood(folder, "read"):
        group = zarr_module().open_group(folder, mode="r", zarr_format=3, use_consolidated=False)
        named = sorted(entry.name for entry in folder.iterdir() if (entry / METADATA).is_file())
        found = {name: group[name] for name in named}
        return {name: item for name, item in found.items() if isinstance(item, zarr_module().Array)}


def _size(folder: Path, limits: FileLimits) -> int:
    """Bytes of all files; an error where one is no ordinary file, or they are too large together."""
    total = 0
    with explained(folder, "read"):
        for place, folders, files in os.walk(folder):
            for name in (*folders, *files):
                found = os.lstat(os.path.join(place, name))
                if not (stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode)):
                    raise FileError(f"{os.path.join(place, name)!r} is no ordinary file; a store holds no links")
                total += found.st_size if stat.S_ISREG(found.st_mode) else 0
    if total > limits.file_size:
        raise FileError(
            f"{str(folder)!r} has {total} bytes; the limit is {limits.file_size}: raise it by "
            "limits=pl.images.FileLimits(file_size=...), or open it a part at a time by xarray.open_zarr"
        )
    return total
