"""Atomic writing of files: temporary files, their locks, and readable errors.

A new file is written to a temporary one in the same folder, ``.<digits>-<digits>.part``, until it is complete and on
the disk. A folder that is replaced is ``.<digits>-<digits>.old`` until it is removed. The writer holds a lock on its
temporary file, which ends with the process. An unlocked temporary file is left over: it is removed when the same target
is written again, or after a day when another file of the folder is written.
"""

from __future__ import annotations

import ctypes
import errno
import hashlib
import json
import os
import re
import secrets
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from plenoptic.core.values import file_path
from plenoptic.errors import FileError, PlenopticError

try:
    import fcntl
except ImportError:  # Windows, where temporary files left over by dead processes stay
    fcntl = None  # type: ignore[assignment]

_CANNOT_SYNC = (errno.EINVAL, errno.ENOTSUP, errno.EACCES, errno.EPERM, errno.EBADF)
"""Error codes of file systems that cannot flush a folder; the file itself is on the disk then."""
_TEMPORARY = re.compile(r"\.[0-9a-f]{16}-[0-9a-f]{16}\.(part|old)")
_MAX_AGE = 86400.0
"""Seconds after which a left-over temporary file of another target is removed. Locks may not reach other machines."""
_HERE, _RENAME_EXCHANGE = -100, 2
"""Arguments of renameat2(2) of Linux: AT_FDCWD, and the flag."""
_WORK, _LOCKED_AFTER = "plenoptic-work-", 60.0
"""Beginning of the names of temporary folders, and the age in seconds at which those of living processes are locked."""
_ROOM = 1 << 16
"""Bytes that must still fit on the disk: more than the buffers of libraries that write."""


@contextmanager
def replace_file(path: str | os.PathLike[str], *, check: Callable[[], None] = lambda: None) -> Iterator[BinaryIO]:
    """Context manager of a new file that replaces the one at `path` if the block succeeds; otherwise nothing changes.

    It keeps the permissions of the old file, and links to that stay links. `check` raises an error if the target must
    not be replaced; it is called before anything is written and once more at the end.
    """
    target = real_path(path)
    check_replaceable(target)
    check()
    with translate_errors(target, "written"):
        _remove_left_over(target)
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
    """Write a whole file; after an error the old one is unchanged."""
    with replace_file(path) as file:
        file.write(content)


def write_json(path: str | os.PathLike[str], content: Any) -> None:
    """Write a JSON file; floats keep every bit, and must be finite."""
    write_file(path, (json.dumps(content, indent=1, allow_nan=False) + "\n").encode("ascii"))


@contextmanager
def replace_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Context manager of a new folder that replaces the one at `path`, if any, if the block succeeds."""
    target = file_path(path)
    check_folder(target)
    name = f"{_prefix(target)}{secrets.token_hex(8)}"
    new, old = target.with_name(f"{name}.part"), target.with_name(f"{name}.old")
    with translate_errors(target, "written"):
        _remove_left_over(target)
        new.mkdir()
        try:
            with ExitStack() as stack:
                with suppress(OSError):  # a file system without locks: left-over folders stay
                    stack.enter_context(lock_path(new))
                yield new
                sync_files(new)
                if not _exchange(new, target):
                    try:
                        if target.exists():
                            os.replace(target, old)
                        os.replace(new, target)
                    except BaseException:
                        if old.exists() and not target.exists():
                            os.replace(old, target)
                        raise
        finally:
            for folder in (new, old):
                shutil.rmtree(folder, ignore_errors=True)
        _sync_folder(target.parent)


def _exchange(new: Path, target: Path) -> bool:
    """Exchange two folders in one step; False if one is missing, or the system or the file system cannot."""
    rename = getattr(ctypes.CDLL(None), "renameat2", None) if sys.platform == "linux" else None
    if rename is None:
        return False
    return int(rename(_HERE, os.fsencode(new), _HERE, os.fsencode(target), _RENAME_EXCHANGE)) == 0


def recover_folder(target: Path) -> None:
    """Put a folder back under its name if its writer was killed where folders cannot be exchanged in one step."""
    if os.path.lexists(target) or not target.parent.is_dir():
        return
    for old in target.parent.glob(f"{_prefix(target)}*.old"):
        with suppress(OSError), ExitStack() as stack:
            if (new := old.with_suffix(".part")).exists():
                stack.enter_context(lock_path(new))  # fails while its writer lives
            os.rename(old, target)
            return


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """Context manager of a folder among the system's temporary ones; removes those of processes that were killed."""
    with tempfile.TemporaryDirectory(prefix=_WORK) as name, ExitStack() as stack:
        folder = Path(name)
        with suppress(OSError):
            stack.enter_context(lock_path(folder))
        for other in folder.parent.glob(f"{_WORK}*") if fcntl is not None else ():
            with suppress(OSError):
                if other.lstat().st_mtime < time.time() - _LOCKED_AFTER:
                    with lock_path(other):
                        shutil.rmtree(other)
        yield folder


def check_room(file: BinaryIO) -> None:
    """Raise an error if the disk is full: libraries that write by name may silently lose the end of a file."""
    size = file.seek(0, os.SEEK_END)
    file.write(bytes(_ROOM))
    file.flush()
    file.truncate(size)


def utf8_path(path: str | os.PathLike[str]) -> Path:
    """A path, or an error if it is not UTF-8, which libraries and terminals require."""
    checked = file_path(path)
    try:
        str(checked).encode("utf-8")
    except UnicodeEncodeError:
        raise FileError(f"{str(checked)!a} is not UTF-8; rename the file or folder") from None
    return checked


def real_path(path: str | os.PathLike[str]) -> Path:
    """Path of the file itself: links to it stay links."""
    checked = file_path(path)
    with translate_errors(checked, "used"):
        return Path(os.path.realpath(checked))


def file_exists(target: Path) -> bool:
    """True if there is a file; an error if the path is something else."""
    with translate_errors(target, "read"):
        try:
            mode = os.stat(target).st_mode
        except FileNotFoundError:
            return False
    if not stat.S_ISREG(mode):
        raise FileError(
            f"{str(target)!r} is {'a folder' if stat.S_ISDIR(mode) else 'no file'}; give the path of a file"
        )
    return True


def is_empty_folder(folder: Path) -> bool:
    """True if a folder is empty but for temporary files, of a process that writes its first file or was killed."""
    return all(_TEMPORARY.fullmatch(name) for name in os.listdir(folder))


def check_replaceable(target: Path) -> None:
    """Raise an error if no file can be put at `target`."""
    if file_exists(target) and not os.access(target, os.W_OK):
        raise FileError(f"{str(target)!r} is write-protected; choose another name, or change its rights")
    check_folder(target)


def check_folder(target: Path) -> None:
    """Raise an error if no file can be put in the folder of `target`."""
    if not target.parent.is_dir():
        raise FileError(f"the folder {str(target.parent)!r} does not exist; make it first")
    if not os.access(target.parent, os.W_OK | os.X_OK):
        raise FileError(f"the folder {str(target.parent)!r} is not writable; choose another one")


@contextmanager
def translate_errors(target: Path, what: str) -> Iterator[None]:
    """Context manager that turns errors of the system into FileError."""
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


def _prefix(target: Path) -> str:
    """Prefix of the names of temporary files for this target, of constant length."""
    return f".{hashlib.sha256(os.fsencode(target.name)).hexdigest()[:16]}-"


@contextmanager
def _temporary(target: Path) -> Iterator[tuple[Path, BinaryIO]]:
    """A new file beside the target, locked, and removed in the end unless it has been renamed."""
    while True:
        path = target.with_name(f"{_prefix(target)}{secrets.token_hex(8)}.part")
        try:
            with open(path, "xb") as file:
                if fcntl is not None:
                    with suppress(OSError):  # a file system without locks: left-over files stay
                        fcntl.flock(file, fcntl.LOCK_EX)
                with suppress(OSError):  # there may be no file before
                    path.chmod(stat.S_IMODE(target.stat().st_mode))
                # Before it was locked, another process may have removed it as left over.
                if path.exists():
                    yield path, file
                    return
        finally:
            with suppress(OSError):
                path.unlink()


def _remove_left_over(target: Path) -> None:
    """Remove temporary files of processes that have ended while they wrote them."""
    if fcntl is None:
        return
    ours, oldest = _prefix(target), time.time() - _MAX_AGE
    with suppress(PermissionError):  # a folder that may be written but not read
        for name in filter(_TEMPORARY.fullmatch, os.listdir(target.parent)):
            path = target.with_name(name)
            with suppress(OSError), lock_path(path):
                if name.endswith("old"):  # a folder that has been replaced, or was to be when its process ended
                    is_needed = not (name.startswith(ours) and target.exists())
                else:
                    is_needed = not name.startswith(ours) and path.stat().st_mtime >= oldest
                if not is_needed:
                    shutil.rmtree(path) if path.is_dir() else path.unlink()


@contextmanager
def lock_path(path: Path) -> Iterator[None]:
    """Context manager that locks a file or folder, if there are locks; OSError while another process holds the lock."""
    flags = os.O_RDONLY if path.is_dir() else os.O_RDWR
    descriptor = None if fcntl is None else os.open(path, flags)
    try:
        if descriptor is not None:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    finally:
        if descriptor is not None:
            os.close(descriptor)


def sync_files(folder: Path) -> None:
    """Flush all files of a folder to the disk: libraries that write them may not."""
    for path in folder.rglob("*"):
        if path.is_file():
            with open(path, "r+b") as file:
                os.fsync(file.fileno())


@contextmanager
def claim_folder(folder: Path) -> Iterator[None]:
    """Context manager of a folder to which one program writes at a time; FileError if another one does."""
    with ExitStack() as stack:
        try:
            stack.enter_context(lock_path(folder))
        except BlockingIOError:
            raise FileError(f"another program is writing to {str(folder)!r}; wait until it ends") from None
        except OSError:
            pass
        yield


def _sync_folder(folder: Path) -> None:
    """Flush the entry of a new name to the disk as well."""
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
