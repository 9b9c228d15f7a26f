"""Named arrays in files of NumPy (NPZ), and of MATLAB 7.3 by h5py, which Octave reads too."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.files.atomic_file import write_file
from plenoptic.core.files.extras import extra_package
from plenoptic.core.files.file_limits import FileLimits, allowed_memory, read_file
from plenoptic.errors import FileError

_HEADER = 512
"""Bytes before HDF5's own."""


def write_npz(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write arrays to an NPZ file, as a whole or not at all."""
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    write_file(path, file.getvalue())


def read_npz(path: Path, limits: FileLimits) -> Mapping[str, NDArray[Any]]:
    """The arrays of an NPZ file, which may claim to be of any size; FileError if it cannot be read."""
    content = read_file(path, limits)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            memory = sum(entry.file_size for entry in archive.infolist())
        if memory > allowed_memory(len(content), limits):
            raise ValueError(f"it would take {memory} bytes; give limits=pl.images.FileLimits(memory={memory})")
        with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except (ValueError, OSError, EOFError, MemoryError, KeyError, zipfile.BadZipFile, RuntimeError) as error:
        raise FileError(f"{str(path)!r} cannot be read: {error}; restore it from its origin") from None


def matlab_7_3(content: Mapping[str, Any]) -> bytes:
    """A .mat file of version 7.3: HDF5 behind a header, axes in reverse order, classes as attributes."""
    file = io.BytesIO()
    with hdf5().File(file, "w", userblock_size=_HEADER, libver=("earliest", "v108")) as opened:
        for name, value in content.items():
            _put(opened, name, value)
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, written by plenoptic HDF5 schema 1.00 ."
    block = head.ljust(116) + bytes(8) + (0x0200).to_bytes(2, "little") + b"IM"
    return block.ljust(_HEADER, b"\0") + file.getvalue()[_HEADER:]


def _put(group: Any, name: str, value: Any) -> None:
    if isinstance(value, Mapping):
        struct = group.create_group(name)
        struct.attrs["MATLAB_class"] = np.bytes_("struct")
        for key, part in value.items():
            _put(struct, key, part)
    elif isinstance(value, str):
        dataset = group.create_dataset(name, data=np.frombuffer(value.encode("utf-16-le"), np.uint16)[:, None])
        dataset.attrs["MATLAB_class"] = np.bytes_("char")
        dataset.attrs["MATLAB_int_decode"] = np.int32(2)
    else:
        array = np.atleast_2d(np.asarray(value))
        compressed = {"compression": "gzip"} if array.size > 1000 else {}
        dataset = group.create_dataset(name, data=np.ascontiguousarray(array.T), **compressed)
        kind = "double" if array.dtype == np.float64 else "single" if array.dtype == np.float32 else array.dtype.name
        dataset.attrs["MATLAB_class"] = np.bytes_(kind)


def matlab_array(content: bytes, name: str) -> NDArray[Any]:
    """An array of a .mat file; KeyError if it has none of that name, ValueError if it is no such file."""
    if content[_HEADER : _HEADER + 8] != b"\x89HDF\r\n\x1a\n":
        raise ValueError("it is no .mat file of version 7.3, which save(..., '-v7.3') makes")
    try:
        with hdf5().File(io.BytesIO(content), "r") as opened:
            return np.asarray(opened[name][()]).T
    except (OSError, TypeError, AttributeError, RuntimeError) as error:
        raise ValueError(str(error)) from None


def hdf5() -> ModuleType:
    """The package h5py, or an error that says how to install it."""
    return extra_package("h5py", "this file", "h5py")
