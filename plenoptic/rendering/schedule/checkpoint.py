"""Checkpoints: the file in which a render keeps what it has so far, whole at any moment and never another's.

    plenoptic checkpoint 1
    <SHA-256 of the header> <length of the header, 16 digits>
    <header: JSON in one line; identity, facts, names, types and shapes of the arrays, the SHA-256 of their bytes>
    <bytes of the arrays, one after the other, in C order, low byte first>

Where two processes save to the same path at once, the file is always a whole one, and the last one wins if both render
the same. If they do not, the one that comes first stays, and the other process gets an error.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.files.atomic_file import check_folder, explained, is_there, real_path, replaced
from plenoptic.core.files.digest import bytes_of, little_endian
from plenoptic.core.values import file_path, positive
from plenoptic.core.warn import warn
from plenoptic.errors import FileError, FileWarning, InvalidValueError
from plenoptic.rendering.schedule.identity import differences, identity
from plenoptic.rendering.schedule.progress import Progress

if TYPE_CHECKING:
    from plenoptic.scene.compile import SceneRecord

_PREAMBLE = re.compile(rb"plenoptic checkpoint 1\n([0-9a-f]{64}) ([0-9]{16})\n")
_PREAMBLE_BYTES = 105
_ANY_VERSION = re.compile(rb"plenoptic checkpoint ([0-9]{1,9})\n")
_TYPES = {
    np.dtype(name).newbyteorder("<").str
    for name in ("?", *("i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8"), *("f2", "f4", "f8", "c8", "c16"))
}
_ELSEWHERE = "give checkpoint= another path, or remove the file"


class _Layout(NamedTuple):
    """An array of a file."""

    name: str
    dtype: np.dtype[Any]
    shape: tuple[int, ...]

    @property
    def nbytes(self) -> int:
        return math.prod(self.shape) * self.dtype.itemsize


class _Header(NamedTuple):
    identity: dict[str, str]
    facts: dict[str, Any]
    arrays: list[_Layout]
    sha256: str
    """Of the bytes of all arrays."""


class Checkpoint:
    """Keeps the state of a render in a file, every so often."""

    def __init__(self, path: str | os.PathLike[str], interval: float) -> None:
        self._path = file_path(path)
        self._interval = positive(interval, "checkpoint_interval", "s")
        self._identity: dict[str, str] = {}
        self._saved = time.perf_counter()
        self._kept = -1
        """Samples of all tiles in the file."""

    def resume(
        self, progress: Progress, scene: SceneRecord | None, camera: PlenopticCamera, facts: Mapping[str, object]
    ) -> None:
        """Put into `progress` what the file holds, if there is one of a render with the same facts."""
        self._identity = identity(scene, camera, **facts)
        found = load_checkpoint(self._path, self._identity)
        if found is not None:
            progress.restore(*found)
            self._kept = int(progress.done.sum())
            *others, here = progress.film.processors
            if others:
                warn(
                    f"{str(self._path)!r} was begun on another kind of processor, {' and '.join(others)}; this is "
                    f"{here}: the image is as good, but its bits are those of neither; stats.processors names both"
                )
        else:
            self._write(progress)  # a file that cannot be written is better known now

    def save_if_due(self, progress: Progress) -> None:
        """Write the file if it is time. Where that fails, the render goes on, with a warning."""
        if time.perf_counter() - self._saved >= self._interval:
            self.save(progress)

    def save(self, progress: Progress) -> None:
        """Write the file unless it is up to date; a failure is a warning, since what is rendered is still there."""
        if self._kept == progress.done.sum():
            return
        try:
            self._write(progress)
        except FileError as error:
            self._saved = time.perf_counter()
            warn(f"the checkpoint has not been written: {error}", FileWarning)

    def _write(self, progress: Progress) -> None:
        progress.note_time()
        save_checkpoint(self._path, self._identity, progress.arrays(), progress.facts())
        self._kept, self._saved = int(progress.done.sum()), time.perf_counter()


def save_checkpoint(
    path: str | os.PathLike[str],
    identity: Mapping[str, str],
    arrays: Mapping[str, NDArray[Any]],
    facts: Mapping[str, Any],
) -> None:
    """Save the state of a render, in place of the state that the file had: one of the same identity, or none.

    Arrays hold booleans or numbers, of which every bit is kept, and must not change meanwhile; facts are numbers, texts
    and lists of them. Of the old file only the header is looked at, twice: before writing and when the new one is
    complete. Where something else is there, or writing fails, the file stays as it was and nothing is left beside it.
    """
    target = real_path(path)
    kept = {name: _storable(name, array) for name, array in arrays.items()}
    start = _start_of_file(identity, kept, facts)
    with replaced(target, check=lambda: _refuse_others(target, identity)) as file:
        file.write(start)
        for array in kept.values():
            file.write(bytes_of(array))


def load_checkpoint(
    path: str | os.PathLike[str], identity: Mapping[str, str]
) -> tuple[dict[str, NDArray[Any]], dict[str, Any]] | None:
    """Arrays, which may be written to, and facts of a render of this identity; None where there is no file but can be.

    A FileError for a file that is no checkpoint, damaged, cut off, of another version of the format or of another
    render, and where there is no folder to save it in.
    """
    target = real_path(path)
    if not is_there(target):
        check_folder(target)
        return None
    with explained(target, "read"), open(target, "rb") as file:
        header = _read_header(file, target)
        _check_identity(header, identity, target)
        found, sha = {}, hashlib.sha256()
        for layout in header.arrays:
            array = np.empty(layout.shape, dtype=layout.dtype)
            if file.readinto(bytes_of(array)) != layout.nbytes:
                raise _damaged(target, "it was cut off just now")
            sha.update(bytes_of(array))
            found[layout.name] = array.astype(layout.dtype.newbyteorder("="), copy=False)
    if sha.hexdigest() != header.sha256:
        raise _damaged(target, "its data have changed since they were written")
    return found, header.facts


def _storable(name: str, array: NDArray[Any]) -> NDArray[Any]:
    plain = little_endian(np.asarray(array))
    if plain.dtype.str not in _TYPES:
        raise InvalidValueError(f"{name} is an array of {plain.dtype}; a checkpoint keeps booleans and numbers only")
    return plain


def _start_of_file(identity: Mapping[str, str], arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]) -> bytes:
    sha = hashlib.sha256()
    for array in arrays.values():
        sha.update(bytes_of(array))
    layouts = [{"name": name, "dtype": array.dtype.str, "shape": array.shape} for name, array in arrays.items()]
    described = {"identity": dict(identity), "facts": dict(facts), "arrays": layouts, "sha256": sha.hexdigest()}
    header = json.dumps(described, default=np.generic.item).encode() + b"\n"
    return b"plenoptic checkpoint 1\n%s %016d\n%s" % (hashlib.sha256(header).hexdigest().encode(), len(header), header)


def _read_header(file: BinaryIO, target: Path) -> _Header:
    """The header, checked against its digest and the size of the file: no number in it asks for more than there is."""
    size = os.fstat(file.fileno()).st_size
    start = file.read(_PREAMBLE_BYTES)
    found = _PREAMBLE.fullmatch(start)
    if found is None:
        raise _foreign(start, target)
    if int(found[2]) > size - len(start):
        raise _damaged(target, f"it is cut off after {size} bytes")
    text = file.read(int(found[2]))
    if hashlib.sha256(text).hexdigest().encode() != found[1]:
        raise _damaged(target, "its header has changed since it was written")
    try:
        header = _parsed(json.loads(text))
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise _damaged(target, "its header cannot be understood") from error
    whole = len(start) + len(text) + sum(layout.nbytes for layout in header.arrays)
    if size != whole:
        raise _damaged(target, f"it has {size} bytes and should have {whole}")
    return header


def _parsed(tree: Any) -> _Header:
    layouts = []
    for described in tree["arrays"]:
        shape, dtype = described["shape"], described["dtype"]
        if dtype not in _TYPES or not all(type(n) is int and 0 <= n < 1 << 62 for n in shape):
            raise ValueError("no array")
        layouts.append(_Layout(str(described["name"]), np.dtype(dtype), tuple(shape)))
    return _Header(dict(tree["identity"]), dict(tree["facts"]), layouts, str(tree["sha256"]))


def _foreign(start: bytes, target: Path) -> FileError:
    version = _ANY_VERSION.match(start)
    if version is None:
        return FileError(f"{str(target)!r} is {'not a checkpoint' if start else 'an empty file'}; {_ELSEWHERE}")
    if version[1] == b"1":
        return _damaged(target, "its first lines have changed, or it is cut off")
    other = f"version {int(version[1])} of the format, not 1, of another plenoptic"
    return FileError(f"{str(target)!r} has {other}; {_ELSEWHERE}")


def _damaged(target: Path, how: str) -> FileError:
    return FileError(f"{str(target)!r} is a damaged checkpoint, {how}; remove it to begin anew")


def _check_identity(header: _Header, identity: Mapping[str, str], target: Path) -> None:
    if header.identity != dict(identity):
        found = list(differences(header.identity, identity))
        # The side of tiles mostly follows from something else.
        what = [one for one in found if not one.startswith("tile_side")] or found
        raise FileError(f"{str(target)!r} belongs to another render, with {', '.join(what)}; {_ELSEWHERE}")


def _refuse_others(target: Path, identity: Mapping[str, str]) -> None:
    """An error where something else than a checkpoint of this identity is in the way."""
    if is_there(target):
        with explained(target, "read"), open(target, "rb") as file:
            _check_identity(_read_header(file, target), identity, target)
