"""A glTF file: what it says, and the bytes and arrays that it holds."""

from __future__ import annotations

import base64
import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import unquote, unquote_to_bytes

import numpy as np
from numpy.typing import NDArray

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

_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


@dataclasses.dataclass(frozen=True)
class GltfFile:
    """The description of a glTF file, and what it refers to; a `FileError` where it refers to what is not there."""

    header: Mapping[str, Any]
    """The JSON part."""
    buffers: tuple[bytes, ...]
    """What `header["buffers"]` stands for."""
    folder: Path
    """Where files lie that are named by a relative path."""

    def described(self, kind: str, number: Any) -> Mapping[str, Any]:
        """One entry of a list such as "meshes"."""
        listed = self.header.get(kind, ())
        if isinstance(number, bool) or not isinstance(number, int) or not 0 <= number < len(listed):
            raise FileError(f"it refers to number {number!r} of its {len(listed)} {kind}; export it again")
        entry: Mapping[str, Any] = listed[number]
        return entry

    def view(self, number: Any) -> memoryview:
        """The bytes of a buffer view."""
        described = self.described("bufferViews", number)
        start, length = described.get("byteOffset", 0), described["byteLength"]
        whole = self.buffers[described["buffer"]]
        if not 0 <= start <= start + length <= len(whole):
            raise FileError(f"its bufferViews {number} ends beyond its buffer; export it again")
        return memoryview(whole)[start : start + length]

    def array(self, number: Any) -> NDArray[Any]:
        """The numbers of an accessor, (count, components); normalised integers as float64 within -1 and 1.

        A ValueError, TypeError or KeyError is what damage may lead to.
        """
        accessor = self.described("accessors", number)
        kind, width = np.dtype(_COMPONENTS[accessor["componentType"]]), _WIDTHS[accessor["type"]]
        if "bufferView" in accessor:
            array = self._strided(accessor, accessor["count"], kind, width)
        else:
            array = np.zeros((accessor["count"], width), kind)
        if "sparse" in accessor:
            sparse = accessor["sparse"]
            places = sparse["indices"]
            rows = self._strided(places, sparse["count"], np.dtype(_COMPONENTS[places["componentType"]]), 1)
            array = array.copy()
            array[rows[:, 0]] = self._strided(sparse["values"], sparse["count"], kind, width)
        if accessor.get("normalized", False):
            return np.maximum(array / np.float64(np.iinfo(kind).max), -1.0)
        return array

    def _strided(self, place: Mapping[str, Any], count: int, kind: np.dtype[Any], width: int) -> NDArray[Any]:
        view = self.view(place["bufferView"])
        stride = self.described("bufferViews", place["bufferView"]).get("byteStride", kind.itemsize * width)
        return np.ndarray(
            (count, width), kind, view, offset=place.get("byteOffset", 0), strides=(stride, kind.itemsize)
        )


def read_gltf(content: bytes, kind: str, folder: Path) -> GltfFile:
    """Take a file apart, of the kind "glb" (binary) or "gltf" (text), that lies in a folder.

    A `FileError` for another kind of file, one that is cut off, or one that requires an extension that is not read.
    """
    text, binary = _chunks(content) if kind == "glb" else (content, b"")
    header = json.loads(text)
    if not isinstance(header, dict):
        raise FileError("it is no glTF file, whatever its name says; export it again")
    version = str(header["asset"]["version"])
    if not version.startswith("2."):
        raise FileError(f"it is of version {version!r}; only glTF 2 is read, so export it again")
    needed = [name for name in header.get("extensionsRequired", ()) if not name.startswith(KNOWN)]
    if needed:
        raise FileError(f"it needs the extensions {', '.join(needed)}, which are not read; export without them")
    buffers = [
        resource(buffer["uri"], folder) if "uri" in buffer else b"" if number else binary
        for number, buffer in enumerate(header.get("buffers", ()))
    ]
    return GltfFile(header, tuple(buffers), folder)


def _chunks(content: bytes) -> tuple[bytes, bytes]:
    """The JSON part of a binary file, and the buffer that comes with it."""
    if content[:4] != b"glTF":
        raise FileError("it is no binary glTF file, whatever its name says; export it again")
    length, end = int.from_bytes(content[8:12], "little"), 20 + int.from_bytes(content[12:16], "little")
    if max(length, end) > len(content):
        raise FileError(f"it is cut off after {len(content)} of {max(length, end)} bytes; export it again")
    text, rest = content[20:end], content[end:length]
    size = int.from_bytes(rest[:4], "little")
    return text, rest[8 : 8 + size] if rest[4:8] == b"BIN\0" else b""


def resource(uri: str, folder: Path) -> bytes:
    """What a URI stands for: the data in it, or the content of a file in a folder."""
    if uri.startswith("data:"):
        head, _, data = uri.partition(",")
        return base64.b64decode(data) if head.endswith(";base64") else unquote_to_bytes(data)
    path = folder / unquote(uri)
    try:
        return path.read_bytes()
    except OSError as error:
        raise FileError(f"its file {unquote(uri)!r} cannot be read ({error.strerror}); put it beside it") from None
