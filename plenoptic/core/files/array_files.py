"""Named arrays in files of NumPy (NPZ) and of MATLAB; version 7.3 by h5py, which Octave reads too."""

from __future__ import annotations

import io
import math
import re
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.files.atomic_file import write_file
from plenoptic.core.files.extras import extra_package
from plenoptic.core.files.file_limits import FileLimits, allowed_memory, check_memory, content_errors, read_file

_HEADER = 512
"""Bytes before HDF5's own."""
_FILTERS = {1, 2, 3, 32000}
"""Filters of HDF5 that are read: deflate, shuffle, checksum, LZF. Others would be loaded as plug-ins."""
_DEFLATED = 1032
"""Largest ratio by which deflate packs; HDF5 unpacks a chunk whatever its size."""
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
    with open_hdf5(content) as opened:
        return hdf5_array(opened, name, len(content), limits).T


@contextmanager
def open_hdf5(content: bytes) -> Iterator[Any]:
    """Context manager of an HDF5 file in memory; ValueError if texts in it would keep the library busy for ever."""
    for found in re.finditer(rb"GCOL\x01\0\0\0", content):  # global heaps, HDF5 file format, III.E
        end = found.start() + int.from_bytes(content[found.end() : found.end() + 8], "little")
        position = found.end() + 8
        while position + 16 <= min(end, len(content)):
            size = int.from_bytes(content[position + 8 : position + 16], "little")
            if not any(content[position : position + 2]):
                if size < 16:
                    raise ValueError("a heap of texts has free space of no size")
                break
            position += 16 + size + -size % 8
    with hdf5().File(io.BytesIO(content), "r") as opened:
        yield opened


def hdf5_item(group: Any, name: str) -> Any:
    """The group or dataset at a path in a group of an HDF5 file; ValueError without it, or for a link to it."""
    module, item = hdf5(), group
    for part in name.split("/"):
        link = item.get(part, getlink=True) if isinstance(item, module.Group) else None
        if not isinstance(link, module.HardLink):
            raise ValueError(f"it has no {name}" if link is None else f"its {name} is a link")
        item = item[part]
    return item


def hdf5_array(group: Any, name: str, size: int, limits: FileLimits) -> NDArray[Any]:
    """The numbers at a path in a group of an HDF5 file of `size` bytes, weighed before they are read.

    ValueError if they do not lie in the file itself: links, external storage and virtual datasets reach other files.
    """
    module, item = hdf5(), hdf5_item(group, name)
    if not isinstance(item, module.Dataset) or item.dtype.kind not in "biuf":
        raise ValueError(f"{name} is no array of numbers")
    creation = item.id.get_create_plist()
    if creation.get_external_count() or creation.get_layout() == module.h5d.VIRTUAL:
        raise ValueError(f"{name} is stored in other files")
    if unknown := {creation.get_filter(k)[0] for k in range(creation.get_nfilters())} - _FILTERS:
        raise ValueError(f"{name} is packed by the filter {min(unknown)}, which is not read here")
    numbers = max(math.prod(item.shape or ()), math.prod(item.chunks or ()))
    check_memory(numbers * item.dtype.itemsize, f"its array {name}", size, limits)
    for k in range(item.id.get_num_chunks() if item.chunks else 0):
        chunk = item.id.get_chunk_info(k)
        if _DEFLATED * chunk.size > allowed_memory(size, limits):
            packed = item.id.read_direct_chunk(chunk.chunk_offset)[1]
            chunk_bytes = math.prod(item.chunks) * item.dtype.itemsize
            if len(zlib.decompressobj().decompress(packed, chunk_bytes + 1)) > chunk_bytes:
                raise ValueError(f"a chunk of {name} holds more than it says")
    return np.asarray(item[()])


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


def hdf5() -> ModuleType:
    """The package h5py, or an error that says how to install it."""
    return extra_package("h5py", "this file", "h5py")
