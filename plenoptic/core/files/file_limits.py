"""Safe reading: ordinary files only, in folders that the caller allows, and of a size that fits memory."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import Any

from plenoptic.core.files.atomic_file import file_exists, translate_errors
from plenoptic.core.values import Given, check_kind, file_path, set_field, value, whole
from plenoptic.errors import FileError

FILE_SIZE = 1 << 28
"""Default limit in bytes of a file together with the files that it names: 256 MiB."""
TEXT_SIZE = 1 << 22
"""Limit in bytes of a lens file or a glass catalogue: 4 MiB, some hundred times the size of the largest."""
MEMORY = 1 << 29
"""Limit in bytes of the content of a small file: 512 MiB. Reading an image takes twice its float32 values."""
EXPANSION = 256
"""Bytes of memory that each byte of a larger file may take: good photographs, as JPEG, take some 200."""
_SCANS = 1000
"""Limit of the scans of a JPEG file. Each passes over all pixels and has 33 bytes at least: 1.5 s for 4096 x 4096."""


@value
class FileLimits:
    """Limits of the resources that reading a file may take: a few bytes of an untrusted file can expand enormously.

    A limit is checked before anything is allocated, and the error says how to raise it.

    Parameters
    ----------
    folder : str or path, optional
        Folder that must hold all other files that a scene names, such as textures, after resolution of links. None:
        the folder of the scene's own file; "/": anywhere.
    file_size : int
        Bytes of a file, together with all files that it names.
    memory : int
        Bytes that images, triangles and their copies may take. The limit is 256 times the size of the files if that
        is more.

    Raises
    ------
    InvalidValueError
        If a size is no whole number above 0.

    Examples
    --------
    >>> import plenoptic as pl
    >>> limits = pl.images.FileLimits(folder="/data/models", memory=8 * 2**30)
    >>> pl.Scene.load("/data/models/hall/hall.gltf", limits=limits)  # doctest: +SKIP
    Scene(412 meshes, 2184221 triangles, 3 lights)
    """

    folder: Given[Path | None, str | PathLike[str] | None] = Given(default=None)
    file_size: int = FILE_SIZE
    memory: int = MEMORY

    def __post_init__(self) -> None:
        if self.folder is not None:
            set_field(self, "folder", file_path(self.folder))
        for name in ("file_size", "memory"):
            set_field(self, name, whole(getattr(self, name), name, at_least=1))


DEFAULT = FileLimits()
TEXT = FileLimits(file_size=TEXT_SIZE)


def check_file(path: Path, limits: FileLimits = DEFAULT, *, other_bytes: int = 0) -> int:
    """Size of an ordinary file; FileError if it is none, is missing, or is too large together with `other_bytes`."""
    check_kind(limits, "limits", FileLimits, "pl.images.FileLimits(memory=2**30)")
    if not file_exists(path):
        raise FileError(f"{str(path)!r} does not exist; check the path")
    with translate_errors(path, "read"):
        size = os.stat(path).st_size
    if size + other_bytes > limits.file_size:
        raise FileError(
            f"{str(path)!r} has {size} bytes{f' and other files {other_bytes}' if other_bytes else ''}; the limit is "
            f"{limits.file_size}: raise it by limits=pl.images.FileLimits(file_size=...)"
        )
    return size


def read_file(path: Path, limits: FileLimits = DEFAULT, *, other_bytes: int = 0) -> bytes:
    """Content of an ordinary file; errors are those of `check_file` and of the system."""
    size = check_file(path, limits, other_bytes=other_bytes)
    with translate_errors(path, "read"), open(path, "rb", opener=_open_nonblocking) as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise FileError(f"{str(path)!r} is no ordinary file any longer; try again")
        return file.read(size)


def allowed_memory(size: int, limits: FileLimits) -> int:
    """Limit in bytes of the memory for files of `size` bytes."""
    return max(limits.memory, EXPANSION * size)


def check_memory(nbytes: int, what: str, size: int, limits: FileLimits) -> None:
    """Raise an error if `nbytes` of memory exceed the limit for files of `size` bytes."""
    allowed = allowed_memory(size, limits)
    if nbytes > allowed:
        raise FileError(
            f"{what} would take {nbytes} bytes of memory, while files of {size} bytes may take {allowed}; if you trust "
            f"them, give limits=pl.images.FileLimits(memory={nbytes})"
        )


@contextmanager
def content_errors(path: Any, what: str = "cannot be read") -> Iterator[None]:
    """Context manager that turns all errors of content that may be damaged into FileError.

    The message begins with the path, as the user gave it, and `what`.
    """
    try:
        yield
    except (ImportError, Warning):
        raise
    except FileError as error:
        if str(path) in str(error):
            raise
        raise FileError(f"{str(path)!r} {what}: {error}") from error
    except Exception as error:
        reason = f"it has no {error}" if isinstance(error, KeyError) else " ".join(str(error).split())
        reason = reason or type(error).__name__
        reason = "it takes more memory than there is" if isinstance(error, MemoryError) else reason
        raise FileError(f"{str(path)!r} {what}: {reason:.400}; restore it from its origin") from error


def check_scans(content: bytes, what: str) -> None:
    """Raise an error if a JPEG file has so many scans that decoding it takes too long."""
    scans = content.count(b"\xff\xda") if content.startswith(b"\xff\xd8") else 0
    if scans > _SCANS:
        raise FileError(f"{what} is a JPEG file of {scans} scans; at most {_SCANS} are read: save it again")


class FileReader:
    """Reader of a file and the files it names, with limits on their total size and memory."""

    def __init__(self, source: Path, limits: FileLimits) -> None:
        self.limits = limits
        self._folder = source.parent
        self._root = os.path.realpath(source.parent if limits.folder is None else limits.folder)
        self._size = self._memory = 0

    def read(self, path: Path) -> bytes:
        """Content of a file."""
        content = read_file(path, self.limits, other_bytes=self._size)
        self._size += len(content)
        return content

    def resolve(self, name: str) -> Path:
        """Path of a file named relative to the first one; an error if it lies outside of the allowed folder."""
        try:
            path = os.path.realpath(self._folder / name)
            inside = os.path.commonpath([path, self._root]) == self._root
        except (OSError, ValueError) as error:  # null bytes in the name, other drives
            raise FileError(f"its file {name!r} cannot be used ({error}); rename it") from None
        if not inside:
            raise FileError(
                f"its file {name!r} lies outside of {self._root!r}; put it there, or, if you trust the file, allow it "
                "by limits=pl.images.FileLimits(folder=...)"
            )
        return Path(path)

    def check(self, nbytes: int, what: str) -> None:
        """Raise an error if a temporary allocation would exceed the limit of memory."""
        check_memory(self._memory + nbytes, what, self._size, self.limits)

    def take(self, nbytes: int, what: str) -> None:
        """Count memory that stays in use."""
        self.check(nbytes, what)
        self._memory += nbytes


def _open_nonblocking(path: str, flags: int) -> int:
    """Open without waiting, in case the file has become a pipe."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
