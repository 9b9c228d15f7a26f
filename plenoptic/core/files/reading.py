"""Files that are opened for reading: ordinary ones only, in folders that the caller allows, and small enough for
memory.
"""

from __future__ import annotations

import os
import stat
from os import PathLike
from pathlib import Path

from plenoptic.core.files.atomic_file import explained, is_there
from plenoptic.core.values import Given, file_path, set_field, value, whole
from plenoptic.errors import FileError

FILE_SIZE = 1 << 28
"""Bytes that a file may have together with those it names, if the caller does not say otherwise: 256 MiB."""
TEXT_SIZE = 1 << 22
"""Bytes of a lens file or a catalogue of glasses: 4 MiB, some hundred times what the largest have."""
MEMORY = 1 << 29
"""Bytes that may come of a small file: 512 MiB. An image takes twice its float32 values while it is read."""
EXPANSION = 256
"""Bytes that may come of one byte of a larger file: those of good photographs, as JPEG, are some 200."""
_SCANS = 1000
"""Scans of a JPEG file, each a passage over all pixels, of 33 bytes at least: 1.5 s for 4096 x 4096."""


@value
class FileLimits:
    """Limits of the resources that a file may request: a few bytes of a foreign file can stand for much.

    Where a limit is exceeded, nothing has been allocated yet, and the error says how to raise it.

    Parameters
    ----------
    folder : str or path, optional
        Other files that a scene names, as textures, lie in this folder or below it, wherever links lead. None: in the
        folder of the scene's own file; "/": anywhere.
    file_size : int
        Bytes of a file, together with all that it names.
    memory : int
        Bytes that images, triangles and their copies may take. 256 times the size of the files where that is more.

    Raises
    ------
    InvalidValueError
        A size that is no whole number above 0.

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


def check_file(path: Path, limits: FileLimits = DEFAULT, *, others: int = 0) -> int:
    """The size of an ordinary file; an error where it is none, is missing, or is too large together with `others`."""
    if not is_there(path):
        raise FileError(f"{str(path)!r} does not exist; check the path")
    with explained(path, "read"):
        size = os.stat(path).st_size
    if size + others > limits.file_size:
        raise FileError(
            f"{str(path)!r} has {size} bytes{f' beside {others} of other files' if others else ''}; the limit is "
            f"{limits.file_size}: raise it by limits=pl.images.FileLimits(file_size=...)"
        )
    return size


def read_file(path: Path, limits: FileLimits = DEFAULT, *, others: int = 0) -> bytes:
    """Content of an ordinary file; errors are those of `check_file`, and those of the system."""
    size = check_file(path, limits, others=others)
    with explained(path, "read"), open(path, "rb", opener=_without_waiting) as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise FileError(f"{str(path)!r} has been replaced just now by what is no file; try again")
        return file.read(size)


def allowed_memory(size: int, limits: FileLimits) -> int:
    """Bytes that may come of files of `size` bytes."""
    return max(limits.memory, EXPANSION * size)


def check_memory(wanted: int, what: str, size: int, limits: FileLimits) -> None:
    """An error where files of `size` bytes ask for more than they may."""
    allowed = allowed_memory(size, limits)
    if wanted > allowed:
        raise FileError(
            f"{what} would take {wanted} bytes of memory, while files of {size} bytes may take {allowed}; if you trust "
            f"them, give limits=pl.images.FileLimits(memory={wanted})"
        )


def check_scans(content: bytes, what: str) -> None:
    """An error where a JPEG file takes longer than any that is meant to be seen."""
    scans = content.count(b"\xff\xda") if content.startswith(b"\xff\xd8") else 0
    if scans > _SCANS:
        raise FileError(f"{what} is a JPEG file of {scans} scans; at most {_SCANS} are read: save it again")


class FileReader:
    """Reader of a file and those that it names, which counts their requests together."""

    def __init__(self, source: Path, limits: FileLimits) -> None:
        self.limits = limits
        self._folder = source.parent
        self._root = os.path.realpath(source.parent if limits.folder is None else limits.folder)
        self._size = self._memory = 0

    def read(self, path: Path) -> bytes:
        """The content of a file."""
        content = read_file(path, self.limits, others=self._size)
        self._size += len(content)
        return content

    def named(self, name: str) -> Path:
        """Path of a file that is named relative to the first one; an error where that is not allowed."""
        try:
            found = os.path.realpath(self._folder / name)
            inside = os.path.commonpath([found, self._root]) == self._root
        except (OSError, ValueError) as error:  # zeros in the name, other drives
            raise FileError(f"its file {name!r} cannot be used ({error}); rename it") from None
        if not inside:
            raise FileError(
                f"its file {name!r} lies outside of {self._root!r}; put it there, or, if you trust the file, allow it "
                "by limits=pl.images.FileLimits(folder=...)"
            )
        return Path(found)

    def check(self, wanted: int, what: str) -> None:
        """An error where this would take too much memory for a moment."""
        check_memory(self._memory + wanted, what, self._size, self.limits)

    def take(self, wanted: int, what: str) -> None:
        """Count memory that stays in use."""
        self.check(wanted, what)
        self._memory += wanted


def _without_waiting(path: str, flags: int) -> int:
    """A descriptor at once, should the file have become a pipe."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
