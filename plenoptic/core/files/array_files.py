"""Named arrays in files of NumPy (NPZ) and of MATLAB; version 7.3 by h5py, which Octave reads too."""

from __future__ import annotations

import io
import math
import zipfile
import zlib
from collections.abc import Collection, Iterator, Mapping
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
_MATLAB_5 = b"MATLAB 5.0 MAT-file"
_MATRIX, _COMPRESSED = 14, 15
_CELL, _STRUCT, _CHAR, _DOUBLE = 1, 2, 4, 6
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
    if content.startswith(_MATLAB_5):
        return np.asarray(matlab_values(content, (name,), limits)[name])
    if content[_HEADER : _HEADER + 8] != b"\x89HDF\r\n\x1a\n":
        raise ValueError("it is no .mat file of version 5, 7 or 7.3")
    return read_apart(numbers_at, content, limits, name)[name].T


def matlab_values(content: bytes, names: Collection[str], limits: FileLimits) -> dict[str, Any]:
    """Values of version 5, or 7, whose elements are compressed: MATLAB, MAT-File Format, R2024a, chapter 1.

    Texts are str, cells arrays of objects, structs mappings. Not by scipy, which some damaged files crash.
    """
    if not content.startswith(_MATLAB_5):
        raise ValueError("it is no .mat file of version 5 or 7; save it with the option -v7")
    order, values = ">" if content[126:128] == b"MI" else "<", {}
    for kind, data in _matlab_elements(content[128:], order):
        if kind == _COMPRESSED:
            unpacked = zlib.decompressobj().decompress(data, allowed_memory(len(content), limits))
            kind, data = next(_matlab_elements(unpacked, order), (0, b""))
        parts = [part for _, part in islice(_matlab_elements(data, order), 3)] if kind == _MATRIX else []
        if len(parts) == 3 and (name := parts[2].decode("latin-1")) in names:
            shape = np.frombuffer(parts[1], order + "i4").tolist()
            check_memory(8 * math.prod(shape), f"its array {name}", len(content), limits)
            values[name] = _matlab_value(data, order)
    if missing := set(names) - set(values):
        raise KeyError(min(missing))
    return values


def _matlab_value(data: bytes, order: str) -> Any:
    if not data:  # stands for [] in cells
        return np.zeros((0, 0))
    parts = list(_matlab_elements(data, order))
    flags, shape = (np.frombuffer(part, order + "i4").tolist() for _, part in parts[:2])
    kind, (stored, body) = flags[0] & 0xFF, parts[3] if len(parts) > 3 else (0, b"")
    if kind == _CELL:
        cells = np.empty(len(parts) - 3, dtype=object)
        cells[:] = [_matlab_value(part, order) for _, part in parts[3:]]
        return cells.reshape(shape, order="F")
    if kind == _STRUCT:
        length = int(np.frombuffer(body, order + "i4")[0])
        text = parts[4][1]
        names = [text[k : k + length].split(b"\0")[0].decode("latin-1") for k in range(0, len(text), length)]
        return dict(zip(names, (_matlab_value(part, order) for _, part in parts[5:]), strict=math.prod(shape) == 1))
    if kind == _CHAR:
        return body.decode(("utf-16-le" if order == "<" else "utf-16-be") if stored in (4, 17) else "utf-8")
    return np.frombuffer(body, order + _NUMBERS[stored]).reshape(shape, order="F").astype(_CLASSES[kind])


def matlab_5(content: Mapping[str, Any]) -> bytes:
    """A .mat file of version 5: real arrays, texts, arrays of objects as cells, mappings as structs."""
    head = _MATLAB_5.ljust(124) + b"\x00\x01IM"
    return head + b"".join(_element(_MATRIX, _matlab_matrix(value, name)) for name, value in content.items())


def _matlab_matrix(value: Any, name: str = "") -> bytes:
    if isinstance(value, Mapping):
        kind, shape = _STRUCT, (1, 1)
        names = b"".join(key.encode("ascii").ljust(32, b"\0") for key in value)
        body = _element(5, np.array([32], "<i4").tobytes()) + _element(1, names)
        body += b"".join(_element(_MATRIX, _matlab_matrix(each)) for each in value.values())
    elif isinstance(value, str):
        kind, shape, body = _CHAR, (1, len(value)), _element(4, value.encode("utf-16-le"))
    else:
        array = np.atleast_2d(value)
        kind, shape = _CELL if array.dtype == object else _DOUBLE, array.shape
        if kind == _CELL:
            body = b"".join(_element(_MATRIX, _matlab_matrix(each)) for each in array.ravel(order="F"))
        else:
            body = _element(9, array.astype("<f8").tobytes(order="F"))
    head = _element(6, np.array([kind, 0], "<u4").tobytes()) + _element(5, np.array(shape, "<i4").tobytes())
    return head + _element(1, name.encode("ascii")) + body


def _element(kind: int, data: bytes) -> bytes:
    return np.array([kind, len(data)], "<u4").tobytes() + data + bytes(-len(data) % 8)


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
