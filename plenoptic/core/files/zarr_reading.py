"""Whole zarr stores: their attributes, a summary of their arrays, and the arrays themselves.

Parts of a store are read by xarray. A store may be untrusted: it is checked as files are.
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

from plenoptic.core.files.atomic_file import translate_errors
from plenoptic.core.files.file_limits import DEFAULT, FileLimits, check_memory, read_file
from plenoptic.core.files.zarr_files import dimensions_of, translate_zarr_errors, zarr_module
from plenoptic.core.values import file_path
from plenoptic.errors import FileError

METADATA = "zarr.json"
"""Metadata file of a store, by which a folder is recognised as one."""
_CODECS = {"bytes", "transpose", "blosc", "zstd", "gzip", "crc32c"}
"""Codecs of arrays that are read: those of the format itself."""
ANY_SIZE = FileLimits(file_size=1 << 62)
"""Limits for stores of which a part is read."""
_AT_ONCE = 10
"""Chunks that zarr reads at a time."""


def attributes_of(path: str | os.PathLike[str]) -> dict[str, Any] | None:
    """Attributes of a store of any origin; None if a folder or file is no store."""
    file = file_path(path) / METADATA
    if not file.is_file():
        return None
    try:
        content = json.loads(read_file(file))
        return dict(content["attributes"]) if content["node_type"] == "group" else None
    except (ValueError, LookupError, TypeError, RecursionError):
        return None


def summarize_store(path: str | os.PathLike[str]) -> tuple[dict[str, str], int]:
    """A line of text for each array of pixels, by name, and the size of the store on the disk in bytes."""
    folder = file_path(path)
    size, lines = _size(folder, ANY_SIZE), {}
    for name, array in _open_arrays(folder).items():
        if array.ndim > 1:  # others are coordinates
            sides = ", ".join(f"{side} {n}" for side, n in zip(dimensions_of(array), array.shape, strict=True))
            about = ", ".join(str(array.attrs[key]) for key in ("units", "long_name") if key in array.attrs)
            lines[name] = f"({sides}) {array.dtype}{about and ', ' + about.removeprefix('1, ')}"
    return lines, size


def array_shapes(path: str | os.PathLike[str], names: tuple[str, ...]) -> dict[str, tuple[int, ...]]:
    """Shapes of those of the named arrays that a store has; no pixel is read."""
    arrays = _open_arrays(file_path(path))
    return {name: tuple(arrays[name].shape) for name in names if name in arrays}


def read_arrays(
    path: str | os.PathLike[str],
    names: tuple[str, ...],
    limits: FileLimits = DEFAULT,
    *,
    frame: int | None = None,
    rows: slice = slice(None),
) -> dict[str, NDArray[Any]]:
    """Those of the named arrays that a store has: a frame of a sequence, or some rows of a single exposure.

    FileError if they cannot be read, or a frame lacks one.
    """
    folder = file_path(path)
    arrays = {name: array for name, array in _open_arrays(folder).items() if name in names}
    if frame is not None and (missing := sorted({*names} - arrays.keys())):
        raise FileError(f"{str(folder)!r} has no array {', '.join(missing)}; restore it from its origin")
    parts = [folder] if frame is None else [folder / name / "c" / str(frame) for name in arrays]
    size = sum(_size(part, limits) for part in parts)
    nbytes = 0
    with translate_zarr_errors(folder, "read"):
        for name, array in arrays.items():
            codecs = {codec["name"] for codec in array.metadata.to_dict()["codecs"]}
            if not codecs <= _CODECS or array.dtype.kind not in "biuf":
                raise FileError(
                    f"{str(folder / name)!r} is packed by {', '.join(sorted(codecs))}; that is not read here"
                )
            first = len(range(*rows.indices(array.shape[0]))) if frame is None else 1
            numbers = first * math.prod(array.shape[1:]) + math.prod(array.chunks) * _AT_ONCE
            nbytes += numbers * array.dtype.itemsize
        check_memory(2 * nbytes, repr(str(folder)), size, limits)  # an exposure copies its arrays
        if frame is not None:
            for name, array in arrays.items():
                _check_chunks(folder / name, array, frame)
        return {name: np.asarray(array[rows if frame is None else frame]) for name, array in arrays.items()}


def _check_chunks(folder: Path, array: Any, frame: int) -> None:
    """Raise an error if a chunk of a frame is missing: zarr would silently fill it with nan."""
    for index in np.ndindex(*(-(-n // chunk) for n, chunk in zip(array.shape[1:], array.chunks[1:], strict=True))):
        key = array.metadata.encode_chunk_key((frame, *index))
        if not (folder / key).is_file():
            raise FileError(f"{str(folder / key)!r} is missing; restore it, or call `dataset.write` to render it again")


def _open_arrays(folder: Path) -> dict[str, Any]:
    """Arrays of a store; an error if one cannot be opened, which zarr would skip."""
    with translate_zarr_errors(folder, "read"):
        group = zarr_module().open_group(folder, mode="r", zarr_format=3, use_consolidated=False)
        names = sorted(entry.name for entry in folder.iterdir() if (entry / METADATA).is_file())
        items = {name: group[name] for name in names}
        return {name: item for name, item in items.items() if isinstance(item, zarr_module().Array)}


def _size(folder: Path, limits: FileLimits) -> int:
    """Total bytes of all files; an error if one is no ordinary file, or they exceed the limit."""
    total = 0
    with translate_errors(folder, "read"):
        for parent, folders, files in os.walk(folder):
            for name in (*folders, *files):
                status = os.lstat(os.path.join(parent, name))
                if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):
                    raise FileError(f"{os.path.join(parent, name)!r} is no ordinary file; a store holds no links")
                total += status.st_size if stat.S_ISREG(status.st_mode) else 0
    if total > limits.file_size:
        raise FileError(
            f"{str(folder)!r} has {total} bytes; the limit is {limits.file_size}: raise it by "
            "limits=pl.images.FileLimits(file_size=...), or open it a part at a time by xarray.open_zarr"
        )
    return total
