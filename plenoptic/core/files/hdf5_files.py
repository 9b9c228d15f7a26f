"""Numbers in HDF5 files, read in a process of its own: damaged files crash the library, or keep it busy for ever."""

from __future__ import annotations

import io
import math
import os
import subprocess
import sys
import zlib
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.files.extras import extra_package
from plenoptic.core.files.file_limits import FileLimits, allowed_memory, check_memory

_FILTERS = {1, 2, 3, 32000}
"""Filters of HDF5 that are read: deflate, shuffle, checksum, LZF. Others would be loaded as plug-ins."""
_DEFLATED = 1032
"""Largest ratio by which deflate packs; HDF5 unpacks a chunk whatever its size."""
_PATIENCE, _BYTES_PER_SECOND = 10.0, 1e7
"""Seconds that reading may take, and the bytes for which it may take one more."""
_CHILD = "from plenoptic.core.files.hdf5_files import serve; serve()"
Read = Callable[..., Mapping[str, Any]]


def hdf5() -> ModuleType:
    """The package h5py, or an error that says how to install it."""
    return extra_package("h5py", "this file", "h5py")


def read_apart(read: Read, content: bytes, limits: FileLimits, *names: str) -> dict[str, NDArray[Any]]:
    """Arrays that `read(content, limits, *names)`, a function of this module, finds, by a process of its own.

    ValueError with its message if it fails or crashes, or does not end.
    """
    hdf5()
    command = [sys.executable, "-P", "-c", _CHILD, read.__name__, str(limits.memory), *names]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    patience = _PATIENCE + len(content) / _BYTES_PER_SECOND
    try:
        done = subprocess.run(
            command, input=content, env=environment, capture_output=True, timeout=patience, check=False
        )
    except subprocess.TimeoutExpired:
        raise ValueError("it keeps the library busy for ever") from None
    if done.returncode:
        message = done.stderr.decode("utf-8", "replace").strip().splitlines()
        raise ValueError(message[-1] if message and done.returncode > 0 else "it crashes the library")
    with np.load(io.BytesIO(done.stdout), allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files}


def serve() -> None:
    """The process of `read_apart`: content on standard input, arrays or a message on the others."""
    name, memory, *names = sys.argv[1:]
    try:
        found = globals()[name](sys.stdin.buffer.read(), FileLimits(memory=int(memory)), *names)
        file = io.BytesIO()
        np.savez(file, **found)
    except Exception as error:
        sys.exit(" ".join(str(error).split()) or type(error).__name__)
    sys.stdout.buffer.write(file.getvalue())


def numbers_at(content: bytes, limits: FileLimits, name: str) -> dict[str, Any]:
    """The numbers at a path of a file."""
    with hdf5().File(io.BytesIO(content), "r") as opened:
        return {name: _array(opened, name, len(content), limits)}


def vox_arrays(content: bytes, limits: FileLimits) -> dict[str, Any]:
    """Image, white, dark, mode and numbers of the camera, by their paths, of a .vox file of plenoptomos."""
    with hdf5().File(io.BytesIO(content), "r") as opened:
        if opened.attrs.get("description") not in ("VoxelDataFormat", b"VoxelDataFormat"):
            raise ValueError("its description is not VoxelDataFormat")
        names = ["data/image", *(name for name in ("data/white", "data/dark") if name in opened)]
        camera = _item(opened, "instrument/camera")
        camera.visititems(lambda name, item: names.append(f"instrument/camera/{name}") if _is_number(item) else None)
        found = {name: _array(opened, name, len(content), limits) for name in names}
        mode = opened["data/image"].attrs["mode"]
        return {**found, "mode": np.str_(mode.decode() if isinstance(mode, bytes) else mode)}


def _is_number(item: Any) -> bool:
    return hasattr(item, "dtype") and item.dtype.kind in "iuf"


def _item(group: Any, name: str) -> Any:
    """The group or dataset at a path in a group; ValueError without it, or for a link to it."""
    module, item = hdf5(), group
    for part in name.split("/"):
        link = item.get(part, getlink=True) if isinstance(item, module.Group) else None
        if not isinstance(link, module.HardLink):
            raise ValueError(f"it has no {name}" if link is None else f"its {name} is a link")
        item = item[part]
    return item


def _array(group: Any, name: str, size: int, limits: FileLimits) -> NDArray[Any]:
    """The numbers at a path in a file of `size` bytes, weighed before they are read.

    ValueError if they do not lie in the file itself: links, external storage and virtual datasets reach other files.
    """
    module, item = hdf5(), _item(group, name)
    if not isinstance(item, module.Dataset) or item.dtype.kind not in "biuf":
        raise ValueError(f"{name} is no array of numbers")
    creation = item.id.get_create_plist()
    if creation.get_external_count() or creation.get_layout() == module.h5d.VIRTUAL:
        raise ValueError(f"{name} is stored in other files")
    if unknown := {creation.get_filter(k)[0] for k in range(creation.get_nfilters())} - _FILTERS:
        raise ValueError(f"{name} is packed by the filter {min(unknown)}, which is not read here")
    chunk_bytes = math.prod(item.chunks or ()) * item.dtype.itemsize
    check_memory(max(item.nbytes, chunk_bytes), f"its array {name}", size, limits)
    for k in range(item.id.get_num_chunks() if item.chunks else 0):
        chunk = item.id.get_chunk_info(k)
        if _DEFLATED * chunk.size > allowed_memory(size, limits):
            packed = item.id.read_direct_chunk(chunk.chunk_offset)[1]
            if len(zlib.decompressobj().decompress(packed, chunk_bytes + 1)) > chunk_bytes:
                raise ValueError(f"a chunk of {name} holds more than it says")
    return np.asarray(item[()])
