"""Named arrays in files of NumPy (NPZ) and of MATLAB; version 7.3 by h5py, which Octave reads too."""

from __future__ import annotations

import io
import math
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.files.atomic_file import write_file
from plenoptic.core.files.file_limits import FileLimits, allowed_memory, check_memory, content_errors, read_file
from plenoptic.core.files.hdf5_files import hdf5, numbers_at, read_apart

_HEADER = 512
"""Bytes before HDF5's own."""
_MATRIX, _COMPRESSED = 14, 15
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
"""Types of stored numbers in a .mat file of version 5, and of the array that they become."""


def write_npz(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write arrays to an NPZ file, as a whole or not at all."""
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    write_file(path, file.getvalue())


def read_npz(path: Path, limits: FileLimits) -> Mapping[str, NDArray[Any]]:
    """The arrays of an NPZ file, which may claim to be of any size; FileError if it cannot be read."""
    content = read_file(path, limits)
    with content_errors(path):
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            memory = sum(entry.file_size for entry in archive.infolist())
        check_memory(memory, repr(str(path)), len(content), limits)
        with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}


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


def matlab_array(content: bytes, name: str, limits: FileLimits) -> NDArray[Any]:
    """A numeric array of a .mat file; errors of many kinds if it has none of that name, or cannot be read."""
    is_older = content.startswith(b"MATLAB 5.0 MAT-file")
    if not is_older and content[_HEADER : _HEADER + 8] != b"\x89HDF\r\n\x1a\n":
        raise ValueError("it is no .mat file of version 5, 7 or 7.3")
    if is_older:
        return _matlab_5_array(content, name, limits)
    return read_apart(numbers_at, content, limits, name)[name].T


def _matlab_5_array(content: bytes, name: str, limits: FileLimits) -> NDArray[Any]:
    """An array of version 5, or 7, whose elements are compressed: MATLAB, MAT-File Format, R2024a, chapter 1.

    Not by scipy, which some damaged files crash.
    """
    order = ">" if content[126:128] == b"MI" else "<"
    for kind, data in _matlab_elements(content[128:], order):
        if kind == _COMPRESSED:
            unpacked = zlib.decompressobj().decompress(data, allowed_memory(len(content), limits))
            kind, data = next(_matlab_elements(unpacked, order), (0, b""))
        parts = list(islice(_matlab_elements(data, order), 4)) if kind == _MATRIX else []
        if len(parts) == 4 and parts[2][1] == name.encode("ascii"):
            flags, shape = (np.frombuffer(part, order + "i4").tolist() for _, part in parts[:2])
            check_memory(8 * math.prod(shape), f"its array {name}", len(content), limits)
            numbers = np.frombuffer(parts[3][1], order + _NUMBERS[parts[3][0]])
            return numbers.reshape(shape, order="F").astype(_CLASSES[flags[0] & 0xFF])
    raise KeyError(name)


def _matlab_elements(content: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Kinds and bytes of the data elements of a .mat file of version 5; short ones have both sizes in one number."""
    position = 0
    while position + 8 <= len(content):
        kind, size = np.frombuffer(content, order + "u4", 2, position).tolist()
        start, padding = position + 8, 0 if kind == _COMPRESSED else -size % 8
        if kind >> 16:
            kind, size, start, padding = kind & 0xFFFF, kind >> 16, position + 4, 4 - (kind >> 16)
        yield kind, content[start : start + size]
        position = start + size + padding
