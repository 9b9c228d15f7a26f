"""A file to which records are appended, each checked by itself.

    plenoptic <kind> <version>
    <SHA-256 of the header> <length of the header, 16 digits>
    <header: JSON in one line>
    <records>

A record is a mark of 16 bytes, the lengths of its head (4 bytes) and body (8 bytes, low byte first), the digests of
both (BLAKE2b, 16 bytes each; that of the head is over the lengths and the other digest too), the head (JSON: facts,
names, types and shapes of arrays) and the body (the bytes of the arrays, in C order, low byte first). A damaged record,
or one that was being written when the program was killed, is passed over up to the next mark: it is lost, and nothing
else. Bodies are checked when they are read.

Several processes may append to one file: each holds a lock while it writes.
"""

from __future__ import annotations

import hashlib
import json
import math
import mmap
import os
import re
import struct
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.files.atomic_file import check_folder, explained, is_there, real_path, replaced
from plenoptic.core.files.digest import bytes_of, little_endian
from plenoptic.errors import FileError, InvalidValueError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

_MARK = b"\x93plenoptic rec\r\n"
_FRAME = struct.Struct("<16sIQ16s16s")
_PREAMBLE = 82
"""Bytes of digest and length of the header, with the end of the line."""
_TYPES = {
    np.dtype(name).newbyteorder("<").str
    for name in ("?", *("i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8"), *("f2", "f4", "f8", "c8", "c16"))
}


class LogKind(NamedTuple):
    """Kind of a log, for its first line and for messages."""

    name: str
    version: int
    otherwise: str
    """What to do about a file that is something else."""

    @property
    def first_line(self) -> bytes:
        """First line of its files."""
        return f"plenoptic {self.name} {self.version}\n".encode()


class Entry(NamedTuple):
    """A record of a log: its head, and where its body is."""

    facts: dict[str, Any]
    layouts: tuple[tuple[str, np.dtype[Any], tuple[int, ...]], ...]
    place: int
    """Of the body in the file."""
    length: int
    digest: bytes

    @property
    def names(self) -> list[str]:
        """Names of its arrays."""
        return [name for name, _, _ in self.layouts]


def begin_log(path: str | os.PathLike[str], kind: LogKind, header: Mapping[str, Any]) -> None:
    """A new log without records, where there is no file."""
    text = json.dumps(header).encode() + b"\n"
    target = real_path(path)
    with replaced(target, check=lambda: _refuse_any(target)) as file:
        file.write(kind.first_line + b"%s %016d\n" % (hashlib.sha256(text).hexdigest().encode(), len(text)) + text)


class RecordLog:
    """A log that is open: `header` and `entries` are those of the file when it was opened.

    A FileError where there is no log of this kind, or its header is damaged.
    """

    def __init__(self, path: str | os.PathLike[str], kind: LogKind) -> None:
        self._path = real_path(path)
        self._lock = threading.Lock()  # reading and writing move the place in the file
        is_there(self._path)  # to open a pipe would wait for its other end
        with explained(self._path, "read"):
            self._file = open(self._path, "r+b", buffering=0)  # noqa: SIM115
        try:
            with self._locked():
                self.header, first = _read_header(self._file, self._path, kind)
                self.entries, self.damaged = _scanned(self._file.fileno(), first)
        except BaseException:
            self._file.close()
            raise

    def append(self, facts: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Entry:
        """Put a record at the end. Where that fails nothing is added, and it is a FileError.

        Facts are numbers, texts and lists of them; of arrays of booleans and numbers every bit is kept.
        """
        kept = {name: _storable(name, array) for name, array in arrays.items()}
        layouts = tuple((name, array.dtype, array.shape) for name, array in kept.items())
        described = {"facts": facts, "arrays": [(name, dtype.str, shape) for name, dtype, shape in layouts]}
        head = json.dumps(described, default=np.generic.item).encode()
        length = sum(array.nbytes for array in kept.values())
        body = hashlib.blake2b(digest_size=16)
        for array in kept.values():
            body.update(bytes_of(array))
        digest = body.digest()
        frame = _FRAME.pack(_MARK, len(head), length, _head_digest(head, length, digest), digest)
        with explained(self._path, "written"), self._lock, self._locked():
            if not os.path.samestat(os.stat(self._path), os.fstat(self._file.fileno())):
                raise FileError(f"{str(self._path)!r} has been replaced just now; what is new is not in it")
            start = self._file.seek(0, os.SEEK_END)
            try:
                for part in (frame, head, *map(bytes_of, kept.values())):
                    _write_all(self._file, part)
            except BaseException:
                with suppress(OSError):
                    self._file.truncate(start)
                raise
        return Entry(dict(facts), layouts, start + len(frame) + len(head), length, digest)

    def read(self, entry: Entry) -> dict[str, NDArray[Any]] | None:
        """The arrays of a record, which may be written to, by name; None where they have changed since."""
        found, sha = {}, hashlib.blake2b(digest_size=16)
        with explained(self._path, "read"), self._lock:
            self._file.seek(entry.place)
            for name, dtype, shape in entry.layouts:
                array = np.empty(shape, dtype=dtype)
                view = memoryview(bytes_of(array))
                while view:  # a single call reads 2 GB at most
                    got = self._file.readinto(view)
                    if not got:
                        return None
                    view = view[got:]
                sha.update(bytes_of(array))
                found[name] = array.astype(dtype.newbyteorder("="), copy=False)
        return found if sha.digest() == entry.digest else None

    def flush(self) -> None:
        """Flush all records to the disk."""
        with explained(self._path, "written"):
            os.fsync(self._file.fileno())

    def close(self) -> None:
        """Let go of the file."""
        self._file.close()

    @contextmanager
    def _locked(self) -> Iterator[None]:
        """No other process appends meanwhile, where the file system has locks."""
        if fcntl is not None:
            with suppress(OSError):
                fcntl.flock(self._file, fcntl.LOCK_EX)
        try:
            yield
        finally:
            if fcntl is not None:
                with suppress(OSError):
                    fcntl.flock(self._file, fcntl.LOCK_UN)


def _write_all(file: Any, part: Any) -> None:
    view = memoryview(part)
    while view:
        view = view[file.write(view) :]


def _head_digest(head: bytes, length: int, digest: bytes) -> bytes:
    return hashlib.blake2b(struct.pack("<IQ", len(head), length) + digest + head, digest_size=16).digest()


def _read_header(file: Any, path: Path, kind: LogKind) -> tuple[dict[str, Any], int]:
    """The header, checked against its digest, and where it ends."""
    size, line = os.fstat(file.fileno()).st_size, kind.first_line
    start = file.read(len(line) + _PREAMBLE)
    if not start.startswith(line):
        raise _foreign(start, path, kind)
    found = re.fullmatch(rb"([0-9a-f]{64}) ([0-9]{16})\n", start[len(line) :])
    if found is None:
        raise _damaged(path, kind, "its first lines have changed, or it is cut off")
    if int(found[2]) > size - len(start):
        raise _damaged(path, kind, f"it is cut off after {size} bytes")
    text = file.read(int(found[2]))
    if hashlib.sha256(text).hexdigest().encode() != found[1]:
        raise _damaged(path, kind, "its header has changed since it was written")
    try:
        header = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise _damaged(path, kind, "its header cannot be understood") from error
    if not isinstance(header, dict):
        raise _damaged(path, kind, "its header cannot be understood")
    return header, len(start) + len(text)


def _scanned(descriptor: int, first: int) -> tuple[list[Entry], int]:
    """The records from a place on, and how many bytes belong to none."""
    size, entries, damaged = os.fstat(descriptor).st_size, list[Entry](), 0
    if size == first:
        return entries, damaged
    with mmap.mmap(descriptor, 0, access=mmap.ACCESS_READ) as content:
        place = first
        while place < size:
            entry = _entry_at(content, place, size)
            if entry is not None and _is_whole(content, entry):
                entries.append(entry)
                place = entry.place + entry.length
                continue
            following = content.find(_MARK, place + 1)
            following = size if following < 0 else following
            damaged, place = damaged + following - place, following
    return entries, damaged


def _entry_at(content: mmap.mmap, place: int, size: int) -> Entry | None:
    """The record at a place; None where there is no whole one."""
    if size - place < _FRAME.size:
        return None
    mark, head_length, length, head_digest, digest = _FRAME.unpack(content[place : place + _FRAME.size])
    begin = place + _FRAME.size
    if mark != _MARK or head_length + length > size - begin:
        return None
    head = content[begin : begin + head_length]
    if _head_digest(head, length, digest) != head_digest:
        return None
    try:
        described = json.loads(head)
        layouts = tuple(map(_layout, described["arrays"]))
        facts = dict(described["facts"])
    except (ValueError, TypeError, KeyError, RecursionError):
        return None
    if sum(math.prod(shape) * dtype.itemsize for _, dtype, shape in layouts) != length:
        return None
    return Entry(facts, layouts, begin + head_length, length, digest)


def _is_whole(content: mmap.mmap, entry: Entry) -> bool:
    """True if a record has a body of its own: one that was cut off may reach into those written after it."""
    end = entry.place + entry.length
    if content[end : end + len(_MARK)] == _MARK:
        return True
    return content.find(_MARK, entry.place, end + len(_MARK) - 1) < 0


def _layout(described: Any) -> tuple[str, np.dtype[Any], tuple[int, ...]]:
    name, dtype, shape = described
    if dtype not in _TYPES or not all(type(n) is int and 0 <= n < 1 << 62 for n in shape):
        raise ValueError("no array")
    return str(name), np.dtype(dtype), tuple(shape)


def _storable(name: str, array: NDArray[Any]) -> NDArray[Any]:
    plain = little_endian(np.asarray(array))
    if plain.dtype.str not in _TYPES:
        raise InvalidValueError(f"{name} is an array of {plain.dtype}; a record keeps booleans and numbers only")
    return plain


def _foreign(start: bytes, path: Path, kind: LogKind) -> FileError:
    version = re.match(rb"plenoptic %s ([0-9]{1,9})\n" % kind.name.encode(), start)
    if version is not None:
        other = f"version {int(version[1])} of the format, not {kind.version}, of another plenoptic"
        return FileError(f"{str(path)!r} has {other}; {kind.otherwise}")
    return FileError(f"{str(path)!r} is {f'not a {kind.name}' if start else 'an empty file'}; {kind.otherwise}")


def _damaged(path: Path, kind: LogKind, how: str) -> FileError:
    return FileError(f"{str(path)!r} is a damaged {kind.name}, {how}; remove it to begin anew")


def _refuse_any(target: Path) -> None:
    """An error where a file has come into the way."""
    if is_there(target):
        raise FileError(f"{str(target)!r} has been made by another program just now; try again")


def log_is_there(path: str | os.PathLike[str]) -> bool:
    """True if there is a file; an error where none could be made."""
    target = real_path(path)
    if is_there(target):
        return True
    check_folder(target)
    return False
