"""File to which checked records are appended.

    plenoptic <kind> <version>
    <SHA-256 of the header> <length of the header, 16 digits>
    <header: JSON in one line>
    <records>

A record is a mark of 16 bytes, the lengths of its head (4 bytes) and body (8 bytes, low byte first), the digests of
both (BLAKE2b, 16 bytes each; that of the head is over the lengths and the other digest too), the head (JSON: facts,
names, types and shapes of arrays) and the body (the bytes of the arrays, in C order, low byte first). A record that is
damaged, or was being written when the program was killed, is skipped up to the next mark, and nothing else is lost.
Bodies are checked when they are read.

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

from plenoptic.core.files.atomic_file import check_folder, file_exists, real_path, replace_file, translate_errors
from plenoptic.core.files.digest import bytes_of, little_endian
from plenoptic.errors import FileError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

_MARK = b"\x93plenoptic rec\r\n"
_FRAME = struct.Struct("<16sIQ16s16s")
_PREAMBLE = 82
"""Bytes of the second line: digest and length of the header."""
_TYPES = {
    np.dtype(name).newbyteorder("<").str
    for name in ("?", *("i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8"), *("f2", "f4", "f8", "c8", "c16"))
}


class LogKind(NamedTuple):
    """Kind of a log, for its first line and for messages."""

    name: str
    version: int
    otherwise: str
    """Remedy in messages about files of another kind."""

    @property
    def first_line(self) -> bytes:
        """First line of its files."""
        return f"plenoptic {self.name} {self.version}\n".encode()


class Entry(NamedTuple):
    """A record of a log: its head, and the position of its body."""

    facts: dict[str, Any]
    layouts: tuple[tuple[str, np.dtype[Any], tuple[int, ...]], ...]
    position: int
    """Position of the body in the file."""
    length: int
    digest: bytes

    @property
    def names(self) -> list[str]:
        """Names of its arrays."""
        return [name for name, _, _ in self.layouts]


def begin_log(path: str | os.PathLike[str], kind: LogKind, header: Mapping[str, Any]) -> None:
    """Write a new log without records; an error if there is a file."""
    text = json.dumps(header).encode() + b"\n"
    target = real_path(path)

    def check_absent() -> None:
        if file_exists(target):
            raise FileError(f"{str(target)!r} has been made by another program just now; try again")

    with replace_file(target, check=check_absent) as file:
        file.write(kind.first_line + b"%s %016d\n" % (hashlib.sha256(text).hexdigest().encode(), len(text)) + text)


class RecordLog:
    """An open log: `header` and `entries` are those of the file when it was opened.

    FileError if there is no log of this kind, or its header is damaged.
    """

    def __init__(self, path: str | os.PathLike[str], kind: LogKind) -> None:
        self._path = real_path(path)
        self._lock = threading.Lock()  # reading and writing move the position in the file
        file_exists(self._path)  # to open a pipe would wait for its other end
        with translate_errors(self._path, "read"):
            self._file = open(self._path, "r+b", buffering=0)  # noqa: SIM115
        try:
            with self._lock_file():
                self.header, first = _read_header(self._file, self._path, kind)
                self.entries, self.damaged = _scan(self._file.fileno(), first)
        except BaseException:
            self._file.close()
            raise

    def append(self, facts: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Entry:
        """Append a record. FileError if that fails; the file is then as before.

        Facts are numbers, texts and lists of them. Arrays of booleans and numbers keep every bit.
        """
        storable = {name: little_endian(np.asarray(array)) for name, array in arrays.items()}
        layouts = tuple((name, array.dtype, array.shape) for name, array in storable.items())
        description = {"facts": facts, "arrays": [(name, dtype.str, shape) for name, dtype, shape in layouts]}
        head = json.dumps(description, default=np.generic.item).encode()
        length = sum(array.nbytes for array in storable.values())
        body = hashlib.blake2b(digest_size=16)
        for array in storable.values():
            body.update(bytes_of(array))
        digest = body.digest()
        frame = _FRAME.pack(_MARK, len(head), length, _head_digest(head, length, digest), digest)
        with translate_errors(self._path, "written"), self._lock, self._lock_file():
            if not os.path.samestat(os.stat(self._path), os.fstat(self._file.fileno())):
                raise FileError(f"{str(self._path)!r} has been replaced just now; the new record is not in it")
            start = self._file.seek(0, os.SEEK_END)
            try:
                for part in (frame, head, *map(bytes_of, storable.values())):
                    _write_all(self._file, part)
            except BaseException:
                with suppress(OSError):
                    self._file.truncate(start)
                raise
        return Entry(dict(facts), layouts, start + len(frame) + len(head), length, digest)

    def read(self, entry: Entry) -> dict[str, NDArray[Any]] | None:
        """Arrays of a record by name, writable; None if the body is damaged."""
        arrays, body = {}, hashlib.blake2b(digest_size=16)
        with translate_errors(self._path, "read"), self._lock:
            self._file.seek(entry.position)
            for name, dtype, shape in entry.layouts:
                array = np.empty(shape, dtype=dtype)
                view = memoryview(bytes_of(array))
                while view:  # a single call reads 2 GB at most
                    n_read = self._file.readinto(view)
                    if not n_read:
                        return None
                    view = view[n_read:]
                body.update(bytes_of(array))
                arrays[name] = array.astype(dtype.newbyteorder("="), copy=False)
        return arrays if body.digest() == entry.digest else None

    def flush(self) -> None:
        """Flush to the disk."""
        with translate_errors(self._path, "written"):
            os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    @contextmanager
    def _lock_file(self) -> Iterator[None]:
        """Context manager in which no other process appends, if the file system has locks."""
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
    """The header, checked against its digest, and its end in the file."""
    size, line = os.fstat(file.fileno()).st_size, kind.first_line

    def damage(reason: str) -> FileError:
        return FileError(f"{str(path)!r} is a damaged {kind.name}, {reason}; remove it to begin anew")

    start = file.read(len(line) + _PREAMBLE)
    if not start.startswith(line):
        raise _foreign_error(start, path, kind)
    match = re.fullmatch(rb"([0-9a-f]{64}) ([0-9]{16})\n", start[len(line) :])
    if match is None:
        raise damage("its first lines have changed, or it is cut off")
    if int(match[2]) > size - len(start):
        raise damage(f"it is cut off after {size} bytes")
    text = file.read(int(match[2]))
    if hashlib.sha256(text).hexdigest().encode() != match[1]:
        raise damage("its header has changed since it was written")
    try:
        header = json.loads(text)
    except (ValueError, RecursionError):
        header = None
    if not isinstance(header, dict):
        raise damage("its header cannot be understood")
    return header, len(start) + len(text)


def _scan(descriptor: int, first: int) -> tuple[list[Entry], int]:
    """The records from a position on, and the number of bytes that belong to none."""
    size, entries, damaged = os.fstat(descriptor).st_size, list[Entry](), 0
    if size == first:
        return entries, damaged
    with mmap.mmap(descriptor, 0, access=mmap.ACCESS_READ) as content:
        position = first
        while position < size:
            entry = _entry_at(content, position, size)
            if entry is not None and _is_whole(content, entry):
                entries.append(entry)
                position = entry.position + entry.length
                continue
            following = content.find(_MARK, position + 1)
            following = size if following < 0 else following
            damaged, position = damaged + following - position, following
    return entries, damaged


def _entry_at(content: mmap.mmap, position: int, size: int) -> Entry | None:
    """The record at a position; None if there is no whole one."""
    if size - position < _FRAME.size:
        return None
    mark, head_length, length, head_digest, digest = _FRAME.unpack(content[position : position + _FRAME.size])
    begin = position + _FRAME.size
    if mark != _MARK or head_length + length > size - begin:
        return None
    head = content[begin : begin + head_length]
    if _head_digest(head, length, digest) != head_digest:
        return None
    try:
        description = json.loads(head)
        layouts = tuple(map(_layout, description["arrays"]))
        facts = dict(description["facts"])
    except (ValueError, TypeError, KeyError, RecursionError):
        return None
    if sum(math.prod(shape) * dtype.itemsize for _, dtype, shape in layouts) != length:
        return None
    return Entry(facts, layouts, begin + head_length, length, digest)


def _is_whole(content: mmap.mmap, entry: Entry) -> bool:
    """True if the body is whole: a truncated one may extend into records written after it."""
    end = entry.position + entry.length
    if content[end : end + len(_MARK)] == _MARK:
        return True
    return content.find(_MARK, entry.position, end + len(_MARK) - 1) < 0


def _layout(description: Any) -> tuple[str, np.dtype[Any], tuple[int, ...]]:
    name, dtype, shape = description
    if dtype not in _TYPES or not all(type(n) is int and 0 <= n < 1 << 62 for n in shape):
        raise ValueError("no array")
    return str(name), np.dtype(dtype), tuple(shape)


def _foreign_error(start: bytes, path: Path, kind: LogKind) -> FileError:
    version = re.match(rb"plenoptic %s ([0-9]{1,9})\n" % kind.name.encode(), start)
    if version is not None:
        other = f"version {int(version[1])} of the format, not {kind.version}, of another plenoptic"
        return FileError(f"{str(path)!r} has {other}; {kind.otherwise}")
    return FileError(f"{str(path)!r} is {f'not a {kind.name}' if start else 'an empty file'}; {kind.otherwise}")


def log_exists(path: str | os.PathLike[str]) -> bool:
    """True if there is a file; an error if there is none and none could be made."""
    target = real_path(path)
    if file_exists(target):
        return True
    check_folder(target)
    return False
