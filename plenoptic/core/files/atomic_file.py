"""Atomic writing of files, in place of those before: temporary files, their locks, errors in words.

Until the new file is complete and on the disk it is a temporary one in the same folder, ``.<digits>-<digits>.part``; a
folder that is replaced is ``.<digits>-<digits>.old`` until it is gone. Whoever writes one holds a lock on it, which
ends with its process, however that ends; a file without a lock has been left behind, and goes when the same file
is written again, or after a day when any other one in the folder is.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import re
import secrets
import shutil
import stat
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from plenoptic.core.values import file_path
from plenoptic.errors import FileError, PlenopticError

try:
    import fcntl
except ImportError:  # Windows, where what has been left behind stays
    fcntl = None  # type: ignore[assignment]

_CANNOT_SYNC = (errno.EINVAL, errno.ENOTSUP, errno.EACCES, errno.EPERM, errno.EBADF)
"""What file systems say that cannot flush a folder; the file itself is on the disk then."""
_TEMPORARY = re.compile(r"\.[0-9a-f]{16}-[0-9a-f]{16}\.(part|old)")
_FORGOTTEN = 86400.0
"""Seconds after which a temporary file of another target goes too. Locks may not reach other machines."""
_ROOM = 1 << 16
"""Bytes that must still fit: more than the buffers of libraries that write."""


@contextmanager
def replaced(path: str | os.PathLike[str], *, check: Callable[[], None] = lambda: None) -> Iterator[BinaryIO]:
    """A new file that takes the place of the one at `path` if the block ends well; else nothing changes.

    It has the rights of the one before, and links to that stay links. `check` raises an error where the new file must
    not replace the present one; it is called before anything is written and once more at the end.
    """
    target = real_path(path)
    check_replaceable(target)
    check()
    with explained(target, "written"):
        _remove_left_behind(target)
        with _temporary(target) as (temporary, file):
            yield file
            file.flush()
            os.fsync(file.fileno())
            check()
            if fcntl is None:
                file.close()
            os.replace(temporary, target)
        _sync_folder(target.parent)


def write_file(path: str | os.PathLike[str], content: bytes) -> None:
    """Write a file as a whole, or an error and all stays as it was."""
    with replaced(path) as file:
        file.write(content)


def write_json(path: str | os.PathLike[str], content: Any) -> None:
    """A JSON file; floats keep every bit, and must be finite."""
    write_file(path, (json.dumps(content, indent=1, allow_nan=False) + "\n").encode("ascii"))


@contextmanager
def replaced_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A new folder that takes the place of the one at `path`, if there is one, if the block ends well."""
    target = file_path(path)
    check_folder(target)
    new, old = (target.with_name(f"{_beginning(target)}{secrets.token_hex(8)}.{kind}") for kind in ("part", "old"))
    with explained(target, "written"):
        _remove_left_behind(target)
        new.mkdir()
        try:
            with ExitStack() as held:
                with suppress(OSError):  # there are file systems without locks: what is left behind stays
                    held.enter_context(locked_folder(new))
                yield new
                sync_files(new)
                if target.exists():
                    os.replace(target, old)
                os.replace(new, target)
        finally:
            for folder in (new, old):
                shutil.rmtree(folder, ignore_errors=True)
        _sync_folder(target.parent)


def check_room(file: BinaryIO) -> None:
    """An error where the disk is full: libraries that write by name may lose the end of a file and say nothing."""
    size = file.seek(0, os.SEEK_END)
    file.write(bytes(_ROOM))
    file.flush()
    file.truncate(size)


def utf8_path(path: str | os.PathLike[str]) -> Path:
    """A path, or an error where it is not UTF-8, which libraries and terminals ask for."""
    given = file_path(path)
    try:
        str(given).encode("utf-8")
    except UnicodeEncodeError:
        raise FileError(f"{str(given)!a} is not UTF-8; rename the file or folder") from None
    return given


def real_path(path: str | os.PathLike[str]) -> Path:
    """Path of the file itself: links to it stay links."""
    given = file_path(path)
    with explained(given, "used"):
        return Path(os.path.realpath(given))


def is_there(target: Path) -> bool:
    """True if there is a file; an error for anything else."""
    with explained(target, "read"):
        try:
            mode = os.stat(target).st_mode
        except FileNotFoundError:
            return False
    if not stat.S_ISREG(mode):
        raise FileError(
            f"{str(target)!r} is {'a folder' if stat.S_ISDIR(mode) else 'no file'}; give the path of a file"
        )
    return True


def holds_nothing(folder: Path) -> bool:
    """True if a folder is empty, or has temporary files only: of a process that writes its first one, or was killed."""
    return all(_TEMPORARY.fullmatch(name) for name in os.listdir(folder))


def check_replaceable(target: Path) -> None:
    """An error where no file could be put at `target`."""
    if is_there(target) and not os.access(target, os.W_OK):
        raise FileError(f"{str(target)!r} is write-protected; choose another name, or change its rights")
    check_folder(target)


def check_folder(target: Path) -> None:
    """An error where no file could be put in the folder of `target`."""
    if not target.parent.is_dir():
        raise FileError(f"the folder {str(target.parent)!r} does not exist; make it first")
    if not os.access(target.parent, os.W_OK | os.X_OK):
        raise FileError(f"the folder {str(target.parent)!r} is not writable; choose another one")


@contextmanager
def explained(target: Path, what: str) -> Iterator[None]:
    """Errors of the system in this package's words."""
    try:
        yield
    except PlenopticError:
        raise
    except FileNotFoundError as error:
        check_folder(target)
        raise FileError(f"{str(target)!r} has been removed just now; try again") from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise FileError(
            f"{str(target)!r} cannot be {what} ({reason}); check its name, its rights and the free space"
        ) from error


def _beginning(target: Path) -> str:
    """Prefix of the names of temporary files for this target; short, whatever its own name."""
    return f".{hashlib.sha256(os.fsencode(target.name)).hexdigest()[:16]}-"


@contextmanager
def _temporary(target: Path) -> Iterator[tuple[Path, BinaryIO]]:
    """A new file beside the target, locked, and removed in the end unless it has been renamed."""
    while True:
        path = target.with_name(f"{_beginning(target)}{secrets.token_hex(8)}.part")
        try:
            with open(path, "xb") as file:
                if fcntl is not None:
                    with suppress(OSError):  # there are file systems without locks: what is left behind stays
                        fcntl.flock(file, fcntl.LOCK_EX)
                with suppress(OSError):  # there may be no file before
                    path.chmod(stat.S_IMODE(target.stat().st_mode))
                # Before it was locked, another process may have taken it for left behind.
                if path.exists():
                    yield path, file
                    return
        finally:
            with suppress(OSError):
                path.unlink()


def _remove_left_behind(target: Path) -> None:
    """Remove temporary files of processes that have ended while they wrote them."""
    if fcntl is None:
        return
    ours, forgotten = _beginning(target), time.time() - _FORGOTTEN
    with suppress(PermissionError):  # a folder that may be written but not read
        for found in filter(_TEMPORARY.fullmatch, os.listdir(target.parent)):
            path = target.with_name(found)
            with suppress(OSError), locked_folder(path) if path.is_dir() else _locked_file(path):
                if found.endswith("old"):  # a folder that has been replaced, or was to be when its process ended
                    wanted = not (found.startswith(ours) and target.exists())
                else:
                    wanted = not found.startswith(ours) and path.stat().st_mtime >= forgotten
                if not wanted:
                    shutil.rmtree(path) if path.is_dir() else path.unlink()


@contextmanager
def _locked_file(path: Path) -> Iterator[None]:
    """Hold the lock on a file; an OSError while the process that writes it lives."""
    with open(path, "r+b") as file:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield


@contextmanager
def locked_folder(path: Path) -> Iterator[None]:
    """The same for a folder, which is opened otherwise; nothing where there are no locks."""
    descriptor = None if fcntl is None else os.open(path, os.O_RDONLY)
    try:
        if descriptor is not None:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    finally:
        if descriptor is not None:
            os.close(descriptor)


def sync_files(folder: Path) -> None:
    """Put all files of a folder on the disk: libraries that write them may not."""
    for path in folder.rglob("*"):
        if path.is_file():
            with open(path, "r+b") as file:
                os.fsync(file.fileno())


@contextmanager
def held_folder(folder: Path) -> Iterator[None]:
    """Hold a folder to which one program writes at a time; an error where another one holds it."""
    with ExitStack() as held:
        try:
            held.enter_context(locked_folder(folder))
        except BlockingIOError:
            raise FileError(f"another program is writing to {str(folder)!r}; wait until it ends") from None
        except OSError:
            pass
        yield


def _sync_folder(folder: Path) -> None:
    """Put the new name on the disk as well."""
    if os.name == "nt":  # folders cannot be opened there
        return
    try:
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
    except OSError as error:
        if error.errno not in _CANNOT_SYNC:
            raise
