"""Arrays of pixels in zarr stores, written chunk by chunk by threads or processes, and readable by xarray.

A store is a group of version 3 of the format. Its arrays name their dimensions and its attributes name the coordinates,
so that `xarray.open_zarr` opens the whole store. Chunks are compressed without loss (Blosc with byte shuffle, then
zstd), and each has a checksum. Parts of a store are read by xarray, whole stores and frames here: a store may be
untrusted, and is checked as files are.
"""

from __future__ import annotations

import json
import math
import os
import stat
import warnings
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.files.atomic_file import recover_folder, sync_files, translate_errors
from plenoptic.core.files.extras import extra_package
from plenoptic.core.files.file_limits import DEFAULT, FileLimits, check_memory, read_file
from plenoptic.core.parallel import run_in_order, thread_count
from plenoptic.core.values import file_path, frozen_array
from plenoptic.errors import FileError, InvalidValueError, PlenopticError

CHUNK = 512
"""Rows and columns of a chunk: one number of four bytes a pixel makes 1 MiB, three colours 3 MiB."""
EXTRA = "zarr xarray"
"""Arguments of `pip install`."""
FRAME, ROW, COLUMN = "frame", "row", "column"
_LEVEL = 3
"""Compression level of zstd: higher ones hardly shrink images."""
METADATA = "zarr.json"
"""Metadata file of a store, by which a folder is recognised as one."""
_CODECS, _COMPRESSORS = {"bytes", "transpose", "crc32c"}, {"blosc", "zstd"}
"""Codecs accepted on reading: those whose chunks begin with their size, at most one of the latter."""
_MANY_CHUNKS, _SMALL_CHUNK = 4096, 1024
"""Number of chunks that may be small, and the numbers of a small one: each takes a tenth of a millisecond."""
ANY_SIZE = FileLimits(file_size=1 << 62)
"""Limits for stores of which a part is read."""
_AT_ONCE = 10
"""Chunks that zarr reads at a time."""
Region = tuple[int, int, int, int]
"""First row, end row, first column, end column."""


class Variable(NamedTuple):
    """Description of an array of a store."""

    dimensions: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: Any
    fill: float
    """Value of numbers that have not been written."""
    meaning: str
    unit: str = "1"
    more: Mapping[str, Any] = {}
    """Further attributes."""
    values: NDArray[Any] | None = None
    """Values of a coordinate, written when the store is made; None: pixels, which are written later."""

    @property
    def attributes(self) -> dict[str, Any]:
        """Attributes in the names of the CF conventions."""
        return {"long_name": self.meaning, **({"units": self.unit} if self.unit else {}), **self.more}


def coordinate(dimension: str, values: NDArray[Any], meaning: str, unit: str = "1") -> Variable:
    """Coordinate along a dimension."""
    return Variable((dimension,), values.shape, values.dtype, 0, meaning, unit, {}, values)


class Store:
    """A store that is written region by region; other processes open the same one by `Store(path)`.

    Regions consist of whole chunks: they begin and end at multiples of 512 rows and columns or at the end of the store.
    So each chunk has one writer, and no writer waits for another. Memory holds about two chunks for each thread, while
    they are compressed.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = file_path(path)
        self._group, arrays = _open_group(self.path, mode="r+")
        self._arrays = {name: array for name, array in arrays.items() if {ROW, COLUMN} <= {*dimensions_of(array)}}
        if not self._arrays:
            raise FileError(f"{str(self.path)!r} holds no pixels; make a new store")

    @classmethod
    def create(
        cls,
        path: str | os.PathLike[str],
        variables: Mapping[str, Variable],
        attributes: Mapping[str, Any],
        *,
        frames: int | None = None,
    ) -> Store:
        """Make a new store, in which only coordinates are written, in a new or empty folder.

        With `frames`, the present length of a sequence, pixels have a leading dimension `frame`, one frame a chunk.
        """
        target = file_path(path)
        pixels = {name for name, variable in variables.items() if variable.values is None}
        dimensions = {dimension for variable in variables.values() for dimension in variable.dimensions}
        others = [name for name in variables if name not in pixels | dimensions]
        with translate_zarr_errors(target, "written"):
            noted = dict(attributes) if not others else {**attributes, "coordinates": " ".join(others)}
            group = zarr_module().create_group(target, zarr_format=3, attributes=noted)
            for name, variable in variables.items():
                _make(group, name, variable, frames if name in pixels else None)
            _consolidate(group)
        return cls(target)

    def array(self, name: str) -> Any:
        """An array of pixels of zarr; FileError if there is none of this name."""
        if name not in self._arrays:
            raise FileError(f"{str(self.path)!r} has no array {name}; restore it from its origin, or remove it")
        return self._arrays[name]

    def extend(self, frames: int, coordinates: Mapping[str, ArrayLike] | None = None) -> None:
        """Extend a sequence to `frames` frames in all; one worker does it, and others see it.

        `coordinates` (frames,) are the new coordinates of all frames, by name.
        """
        length = next(iter(self._arrays.values())).shape[0]
        if frames < length:
            raise InvalidValueError(f"{str(self.path)!r} has {length} frames already; it cannot be given {frames}")
        with translate_zarr_errors(self.path, "written"):
            for array in self._arrays.values():
                array.resize((frames, *array.shape[1:]))
            for name, values in (coordinates or {}).items():
                self._group[name].resize((frames,))
                self._group[name][...] = np.asarray(values)
            _consolidate(self._group)

    def flush(self, frame: int) -> None:
        """Flush the chunks of a frame to the disk."""
        with translate_errors(self.path, "written"):
            for name in self._arrays:
                if (folder := self.path / name / "c" / str(frame)).is_dir():
                    sync_files(folder)

    def finish(self, names: Collection[str], attributes: Mapping[str, Any]) -> None:
        """Set further attributes, and delete arrays of pixels that are not in `names`; nobody else may write then."""
        with translate_zarr_errors(self.path, "written"):
            for name in self._arrays.keys() - {*names}:
                del self._group[name], self._arrays[name]
            self._group.attrs.update(attributes)
            _consolidate(self._group)

    def has(self, region: Region, names: Iterable[str], *, frame: int) -> bool:
        """True if all chunks of a region of a frame exist, of all these arrays."""
        return all(
            name in self._arrays and (self.path / name / _key(self._arrays[name], block, frame)).is_file()
            for name in names
            for block in _blocks(region)
        )

    def put(self, region: Region, arrays: Mapping[str, ArrayLike], *, frame: int | None = None) -> None:
        """Write the pixels of a region, of all arrays or of some, into chunks that nobody else writes.

        The region counts from the store's first row and column, `frame` from 0. InvalidValueError if an array has
        another shape or type than that of the store.
        """
        for name, values in arrays.items():
            array = self.array(name)
            components = array.shape[dimensions_of(array).index(COLUMN) + 1 :]
            shape = (region[1] - region[0], region[3] - region[2], *components)
            if np.shape(values) != shape:
                has = f"{name} has shape {np.shape(values)}"
                raise InvalidValueError(f"{has}; in the region {region} it must have {shape}")
        leading = () if frame is None else (frame,)

        def write(chunk: tuple[str, Region]) -> None:
            name, (row, end_row, column, end_column) = chunk
            array, values = self.array(name), np.asarray(arrays[name])
            part = values[row - region[0] : end_row - region[0], column - region[2] : end_column - region[2]]
            checked = frozen_array(part, name=name, shape=part.shape, dtype=array.dtype)
            array[(*leading, slice(row, end_row), slice(column, end_column))] = checked

        chunks = [(name, block) for name in arrays for block in _blocks(region)]
        with translate_zarr_errors(self.path, "written"):
            list(run_in_order(write, chunks, threads=min(thread_count(None), len(chunks))))


def _make(group: Any, name: str, variable: Variable, frames: int | None) -> None:
    """Make an array, and write its values if it is a coordinate."""
    leading = () if frames is None else (FRAME,)
    shape = variable.shape if frames is None else (frames, *variable.shape)
    dimensions = (*leading, *variable.dimensions)
    chunk_sizes = {FRAME: 1, ROW: CHUNK, COLUMN: CHUNK} if variable.values is None else {}
    text = np.dtype(variable.dtype).kind == "U"
    codecs = zarr_module("zarr.codecs")
    packed = [codecs.BloscCodec(cname="zstd", clevel=_LEVEL, shuffle="shuffle"), codecs.Crc32cCodec()]
    array = group.create_array(
        name,
        shape=shape,
        chunks=tuple(max(1, min(chunk_sizes.get(side, n), n)) for side, n in zip(dimensions, shape, strict=True)),
        dtype=str if text else variable.dtype,
        fill_value="" if text else variable.fill,
        dimension_names=dimensions,
        attributes=variable.attributes,
        compressors="auto" if text else packed,
        config={"write_empty_chunks": True},  # so that a chunk exists if and only if it has been written
    )
    if variable.values is not None:
        array[...] = variable.values


def _consolidate(group: Any) -> None:
    """Copy the metadata of the arrays into the group, where xarray looks first."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it is an extension of the format, which other programs ignore
        zarr_module().consolidate_metadata(group.store)


def dimensions_of(array: Any) -> tuple[str, ...]:
    """Names of an array's dimensions; empty if it has none."""
    return tuple(array.metadata.dimension_names or ())


def _blocks(region: Region) -> Iterator[Region]:
    """The chunks of a region."""
    first_row, end_row, first_column, end_column = region
    for row in range(first_row, end_row, CHUNK):
        for column in range(first_column, end_column, CHUNK):
            yield row, min(row + CHUNK, end_row), column, min(column + CHUNK, end_column)


def _key(array: Any, block: Region, frame: int) -> str:
    """File name of a chunk."""
    index = {FRAME: frame, ROW: block[0] // CHUNK, COLUMN: block[2] // CHUNK}
    return str(array.metadata.encode_chunk_key(tuple(index.get(side, 0) for side in dimensions_of(array))))


@contextmanager
def translate_zarr_errors(folder: Path, what: str) -> Iterator[None]:
    """Context manager that turns errors of the system and of zarr into FileError."""
    with translate_errors(folder, what):
        try:
            yield
        except FileNotFoundError as error:
            if not folder.is_dir():
                raise
            raise FileError(
                f"{str(folder)!r} is no whole zarr store; restore it from its origin, or remove it"
            ) from error
        except (PlenopticError, OSError):
            raise
        except Exception as error:  # zarr and its codecs raise errors of many kinds
            reason = " ".join(str(error).split()) or type(error).__name__
            raise FileError(
                f"{str(folder)!r} cannot be {what} as a zarr store: {reason}; if it is damaged, restore it"
            ) from error


def zarr_module(name: str = "zarr") -> Any:
    """Module of the package zarr, or an error that says how to install it."""
    return extra_package(name, "a store that ends in .zarr", EXTRA)


def attributes_of(path: str | os.PathLike[str]) -> dict[str, Any] | None:
    """Attributes of a store of any origin; None if a folder or file is no store."""
    file = file_path(path) / METADATA
    recover_folder(file.parent)
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
    for name, array in _open_group(folder)[1].items():
        if array.ndim > 1:  # others are coordinates
            sides = ", ".join(f"{side} {n}" for side, n in zip(dimensions_of(array), array.shape, strict=True))
            about = ", ".join(str(array.attrs[key]) for key in ("units", "long_name") if key in array.attrs)
            lines[name] = f"({sides}) {array.dtype}{about and ', ' + about.removeprefix('1, ')}"
    return lines, size


def array_shapes(path: str | os.PathLike[str], names: tuple[str, ...]) -> dict[str, tuple[int, ...]]:
    """Shapes of the named arrays that exist in a store; no pixel is read."""
    _, arrays = _open_group(file_path(path))
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
    arrays = {name: array for name, array in _open_group(folder)[1].items() if name in names}
    if frame is not None and (missing := sorted({*names} - arrays.keys())):
        raise FileError(f"{str(folder)!r} has no array {', '.join(missing)}; restore it from its origin")
    parts = [folder] if frame is None else [folder / name / "c" / str(frame) for name in arrays]
    size, nbytes = sum(_size(part, limits) for part in parts), 0
    with translate_zarr_errors(folder, "read"):
        for name, array in arrays.items():
            codecs = [codec["name"] for codec in array.metadata.to_dict()["codecs"]]
            packed = [codec for codec in codecs if codec not in _CODECS]
            if len(packed) > 1 or not {*packed} <= _COMPRESSORS or array.dtype.kind not in "biuf":
                raise FileError(f"{str(folder / name)!r} is packed by {', '.join(codecs)}; that is not read here")
            first = len(range(*rows.indices(array.shape[0]))) if frame is None else 1
            numbers = first * math.prod(array.shape[1:]) + math.prod(array.chunks) * _AT_ONCE
            nbytes += numbers * array.dtype.itemsize
        check_memory(2 * nbytes, repr(str(folder)), size, limits)  # an exposure copies its arrays
        for name, array in arrays.items():
            _check_chunks(folder / name, array, frame, rows)
        return {name: np.asarray(array[rows if frame is None else frame]) for name, array in arrays.items()}


def _check_chunks(folder: Path, array: Any, frame: int | None, rows: slice) -> None:
    """Raise an error if chunks are too many, or one that is read claims to be larger than the array says.

    Also if a chunk of a frame is missing: zarr would silently fill it with nan.
    """
    first, end, _ = rows.indices(array.shape[0])
    along = range(first // array.chunks[0], -(-end // array.chunks[0])) if frame is None else (frame,)
    across = [range(-(-n // chunk)) for n, chunk in zip(array.shape[1:], array.chunks[1:], strict=True)]
    count = math.prod(map(len, (along, *across)))
    if count > max(_MANY_CHUNKS, math.prod(array.shape) // _SMALL_CHUNK):
        raise FileError(f"{str(folder)!r} has {count} chunks, which are too small; save it in larger ones")
    largest = math.prod(array.chunks) * array.dtype.itemsize
    for index in product(along, *across):
        path = folder / array.metadata.encode_chunk_key(index)
        if path.is_file():
            with open(path, "rb") as file:
                size = _unpacked_size(file.read(18))
            if size > largest:
                raise FileError(f"{str(path)!r} holds {size} bytes where {largest} belong; restore it from its origin")
        elif frame is not None:
            raise FileError(f"{str(path)!r} is missing; restore it, or call `dataset.write` to render it again")


def _unpacked_size(head: bytes) -> int:
    """Size of a chunk by its first bytes: zstd's frame header (RFC 8878), else Blosc's; 0 if too short."""
    if not head.startswith(b"\x28\xb5\x2f\xfd"):
        return int.from_bytes(head[4:8], "little")
    flags = head[4]
    begin = 6 - (flags >> 5 & 1) + (0, 1, 2, 4)[flags & 3]
    length = (flags >> 5 & 1, 2, 4, 8)[flags >> 6]
    return int.from_bytes(head[begin : begin + length], "little") + 256 * (length == 2) if length else 1 << 62


def _open_group(folder: Path, *, mode: str = "r") -> tuple[Any, dict[str, Any]]:
    """Group of a store, and its arrays by name; an error if one cannot be opened, which zarr would skip."""
    recover_folder(folder)
    with translate_zarr_errors(folder, "read"):
        group = zarr_module().open_group(folder, mode=mode, zarr_format=3, use_consolidated=False)
        names = sorted(entry.name for entry in folder.iterdir() if (entry / METADATA).is_file())
        items = {name: group[name] for name in names}
        return group, {name: item for name, item in items.items() if isinstance(item, zarr_module().Array)}


def _size(folder: Path, limits: FileLimits) -> int:
    """Total bytes of all files; an error if one is no ordinary file, or they exceed the limit."""
    total = 0
    with translate_errors(folder, "read"):
        for path in folder.rglob("*"):
            status = path.lstat()
            if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):
                raise FileError(f"{str(path)!r} is no ordinary file; a store holds no links")
            total += status.st_size if stat.S_ISREG(status.st_mode) else 0
    if total > limits.file_size:
        raise FileError(
            f"{str(folder)!r} has {total} bytes; the limit is {limits.file_size}: raise it by "
            "limits=pl.images.FileLimits(file_size=...), or open it a part at a time by xarray.open_zarr"
        )
    return total
