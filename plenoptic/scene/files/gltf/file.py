"""Description of a glTF file, and its bytes and arrays."""

from __future__ import annotations

import base64
import dataclasses
import json
import os
from collections.abc import Mapping
from typing import Any, TypeVar
from urllib.parse import unquote, unquote_to_bytes

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.files.file_limits import FileReader
from plenoptic.errors import FileError

KNOWN = (
    "EXT_mesh_gpu_instancing",
    "EXT_texture_webp",
    "KHR_lights_punctual",
    "KHR_materials",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
)
"""Extensions, or how their names begin, that a file may require: they are read, or change colours at most."""

INDICES = {5121: "<u1", 5123: "<u2", 5125: "<u4"}
"""Types of whole numbers that count rows."""

_COMPONENTS = {5120: "<i1", 5122: "<i2", 5126: "<f4", **INDICES}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_LARGEST_STRIDE = 252

T = TypeVar("T")


@dataclasses.dataclass(frozen=True)
class GltfFile:
    """Description of a glTF file, and the data that it refers to; a `FileError` where it violates the standard."""

    header: Mapping[str, Any]
    """The JSON part."""
    buffers: tuple[memoryview, ...]
    """Contents of `header["buffers"]`."""
    reader: FileReader
    """Finds files that are named, and counts memory."""

    def entry(self, kind: str, number: Any) -> Mapping[str, Any]:
        """One entry of a list such as "meshes"."""
        return entry_of(self.header.get(kind, ()), number, kind)

    def view(self, number: Any) -> memoryview:
        """The bytes of a buffer view."""
        described, place = self.entry("bufferViews", number), f"bufferViews {number}"
        self.entry("buffers", described.get("buffer"))
        start, length = whole(described, "byteOffset", place, default=0), whole(described, "byteLength", place, least=1)
        content: memoryview = self.buffers[described["buffer"]]
        if start + length > len(content):
            raise FileError(f"its {place} ends beyond its buffer; export it again")
        return memoryview(content[start : start + length])

    def array(self, number: Any) -> NDArray[Any]:
        """The numbers of an accessor, (count, components); normalised integers as float64 within -1 and 1."""
        accessor, place = self.entry("accessors", number), f"accessors {number}"
        kind = np.dtype(_one_of(_COMPONENTS, accessor, "componentType", place))
        width, count = _one_of(_WIDTHS, accessor, "type", place), whole(accessor, "count", place, least=1)
        if "bufferView" in accessor:
            array = self._strided_view(accessor, place, count, kind, width)
        else:
            self.reader.check(8 * count * width, f"its {place}")
            array = np.zeros((count, width), kind)
        if "sparse" in accessor:
            array = self._replace_sparse(accessor["sparse"], f"{place} (sparse)", array)
        if not accessor.get("normalized", False):
            return array
        if kind.kind == "f" or kind.itemsize > 2:
            raise FileError(f"its {place} is normalised {kind.name}; only whole numbers of 8 and 16 bits can be")
        return np.maximum(array / np.float64(np.iinfo(kind).max), -1.0)

    def _replace_sparse(self, sparse: Mapping[str, Any], place: str, array: NDArray[Any]) -> NDArray[Any]:
        """A copy with some rows replaced."""
        count, indices = whole(sparse, "count", place, least=1, most=len(array)), sparse["indices"]
        kind = np.dtype(_one_of(INDICES, indices, "componentType", place))
        rows = self._strided_view(indices, place, count, kind, 1)[:, 0].astype(np.int64)
        if rows[-1] >= len(array) or (np.diff(rows) <= 0).any():
            raise FileError(f"its {place} has indices that do not grow, or reach {len(array)}; export it again")
        array = array.copy()
        array[rows] = self._strided_view(sparse["values"], place, count, array.dtype, array.shape[1])
        return array

    def _strided_view(
        self, described: Mapping[str, Any], place: str, count: int, kind: np.dtype[Any], width: int
    ) -> NDArray[Any]:
        content, size = self.view(described.get("bufferView")), kind.itemsize * width
        view, start = self.entry("bufferViews", described["bufferView"]), whole(described, "byteOffset", place, 0)
        stride = whole(view, "byteStride", place, size, least=size, most=_LARGEST_STRIDE)
        if start + stride * (count - 1) + size > len(content):
            raise FileError(f"its {place} ends beyond its bufferViews {described['bufferView']}; export it again")
        return np.ndarray((count, width), kind, content, offset=start, strides=(stride, kind.itemsize))


def entry_of(listed: Any, number: Any, kind: str) -> Mapping[str, Any]:
    """One entry of a list, by its number."""
    if not isinstance(listed, list | tuple) or type(number) is not int or not 0 <= number < len(listed):
        count = len(listed) if isinstance(listed, list | tuple) else 0
        raise FileError(f"it refers to number {number!r} of its {count} {kind}; export it again")
    entry: Mapping[str, Any] = listed[number]
    if not isinstance(entry, Mapping):
        raise FileError(f"its {kind} {number} is {entry!r}, which describes nothing; export it again")
    return entry


def whole(
    described: Mapping[str, Any],
    name: str,
    place: str,
    default: int | None = None,
    *,
    least: int = 0,
    most: int = 2**63,
) -> int:
    """A whole number of a description, within limits."""
    number = described.get(name, default)
    if type(number) is not int or not least <= number <= most:
        limits = f"at least {least}" if most == 2**63 else f"from {least} to {most}"
        raise FileError(f"its {place} has the {name} {number!r}; it must be {limits}: export it again")
    return number


def _one_of(known: Mapping[Any, T], described: Mapping[str, Any], name: str, place: str) -> T:
    key = described.get(name)
    if not isinstance(key, int | str) or key not in known:
        raise FileError(f"its {place} has the {name} {key!r}; it must be one of {', '.join(map(str, known))}")
    return known[key]


def read_gltf(content: bytes, kind: str, reader: FileReader) -> GltfFile:
    """Take a file apart, of the kind "glb" (binary) or "gltf" (text).

    A `FileError` for another kind of file, one that is cut off, or one that requires an extension that is not read.
    """
    text, binary = _chunks(memoryview(content)) if kind == "glb" else (content, memoryview(b""))
    header = json.loads(text, parse_constant=_no_number)
    if not isinstance(header, dict):
        raise FileError("it is no glTF file, whatever its name says; export it again")
    version = str(header["asset"]["version"])
    if not version.startswith("2."):
        raise FileError(f"it is of version {version!r}; only glTF 2 is read, so export it again")
    needed = [name for name in header.get("extensionsRequired", ()) if not name.startswith(KNOWN)]
    if needed:
        raise FileError(f"it needs the extensions {', '.join(needed)}, which are not read; export without them")
    buffers = []
    for number, buffer in enumerate(header.get("buffers", ())):
        data = memoryview(resource(buffer["uri"], reader)) if "uri" in buffer else b"" if number else binary
        length = whole(buffer, "byteLength", f"buffers {number}")
        if length > len(data):
            raise FileError(f"its buffers {number} is cut off after {len(data)} of {length} bytes; export it again")
        buffers.append(memoryview(data)[:length])
    return GltfFile(header, tuple(buffers), reader)


def _no_number(text: str) -> None:
    raise FileError(f"it has the number {text}, which JSON does not know; export it again")


def _chunks(content: memoryview) -> tuple[bytes, memoryview]:
    """The JSON part of a binary file, and the buffer that comes with it."""
    if bytes(content[:4]) != b"glTF":
        raise FileError("it is no binary glTF file, whatever its name says; export it again")
    length, end = int.from_bytes(content[8:12], "little"), 20 + int.from_bytes(content[12:16], "little")
    if max(length, end) > len(content):
        raise FileError(f"it is cut off after {len(content)} of {max(length, end)} bytes; export it again")
    text, remainder = content[20:end], content[end:length]
    size = int.from_bytes(remainder[:4], "little")
    return bytes(text), remainder[8 : 8 + size] if bytes(remainder[4:8]) == b"BIN\0" else memoryview(b"")


def resource(uri: str, reader: FileReader) -> bytes:
    """Data of a URI: those in it, or the content of a file beside the first one."""
    if uri.startswith("data:"):
        head, _, data = uri.partition(",")
        return base64.b64decode(data) if head.endswith(";base64") else unquote_to_bytes(data)
    name = unquote(uri)
    place = reader.resolve(name)
    if not os.path.lexists(place):
        raise FileError(f"its file {name!r} is missing; put it beside it")
    return reader.read(place)
