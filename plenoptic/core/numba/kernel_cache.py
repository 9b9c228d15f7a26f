"""Compiled kernels on disk: one file for each kernel and signature, named after all that its machine code depends on.

Several processes may write a file at once, and each may be killed. A file begins with its digest; a damaged one is
compiled again. Files that were not used for 30 days are removed when something new is compiled, and so are the folders
of earlier versions.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import os
import pickle
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any

from numba.core import config, types
from numba.core.compiler import CompileResult
from numba.core.runtime.nrt import rtsys

from plenoptic.core.files.atomic_file import write_file
from plenoptic.core.numba.code_digest import UnknownValueError, bytecode_text, code_digest
from plenoptic.core.numba.deviations import deviations
from plenoptic.core.warn import warn

_COMPILER = ["absent_fields", "borrowed_arrays", "dispatchers", "library", "pipeline", "shortcuts", "typing_context"]
"""Modules of this folder that decide which machine code is made."""
_DAY = 86400.0
_UNUSED_DAYS = 30


@functools.cache
def cache_folder() -> Path | None:
    """Folder of the compiled kernels: NUMBA_CACHE_DIR, or the user's cache folder; None where there is no home."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        return Path(chosen) / "plenoptic"
    base = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")
    try:
        return (Path(base) if base else Path.home() / ".cache") / "plenoptic" / "kernels"
    except RuntimeError:  # a user without an entry, as in containers
        return None


@functools.cache
def writable_folder() -> Path | None:
    """The cache folder, made if it was missing; None, with one warning, where it cannot be written."""
    folder = cache_folder()
    try:
        if folder is None:
            raise OSError("there is no home folder")
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError as error:
        _warn_once(error)
        return None


class KernelCache:
    """Cache of compiled code for one of Numba's dispatchers; stands for `numba.core.caching.FunctionCache`."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    @property
    def cache_path(self) -> str:
        """The folder."""
        return str(cache_folder())

    def path(self, signature: tuple[types.Type, ...], target: Any) -> Path | None:
        """File of the code for a signature; None where a kernel has no digest or there is no folder."""
        folder = cache_folder()
        try:
            digest = code_digest(self._function)
        except UnknownValueError:
            return None
        processor = " ".join(target.codegen().magic_tuple())
        text = "\n".join([_compiler_text(), *sorted(deviations()), processor, digest, *map(_type_text, signature)])
        name = f"{self._function.__module__.rpartition('.')[2]}.{self._function.__name__}"
        return None if folder is None else folder / f"{name}.{hashlib.sha256(text.encode()).hexdigest()[:24]}.nbc"

    def lacks(self, signature: tuple[types.Type, ...], target: Any) -> bool:
        """True if the file of a signature is missing and can be made."""
        path = self.path(signature, target)
        return path is not None and not path.exists()

    def load_overload(self, signature: tuple[types.Type, ...], target: Any) -> Any:
        """The compiled kernel; None if there is no usable file."""
        path = self.path(signature, target)
        if path is None:
            return None
        try:
            rtsys.initialize(target)  # `refresh` would import all of Numba, which loading needs not
            digest, content = (whole := path.read_bytes())[:32], whole[32:]
            if digest != _digest(path.name, content):
                return None
            if time.time() - path.stat().st_mtime > _DAY:
                with suppress(OSError):
                    os.utime(path)  # it is used
            return CompileResult._rebuild(target, *pickle.loads(content))
        except Exception:  # no file, or one of another make: compile anew
            return None

    def save_overload(self, signature: tuple[types.Type, ...], result: Any) -> None:
        """Keep a compiled kernel; warn once if that fails, as on a full disk."""
        path = self.path(signature, result.target_context)
        if writable_folder() is None or path is None:
            return
        try:
            if not result.library.has_dynamic_globals:  # addresses of this process
                content = pickle.dumps(result._reduce(), protocol=pickle.HIGHEST_PROTOCOL)
                write_file(path, _digest(path.name, content) + content)
                _remove_unused(path.parent)
        except Exception as error:  # also of a Numba whose results look otherwise
            _warn_once(error)

    def enable(self) -> None:
        """Part of Numba's interface."""

    disable = flush = enable


_warned: list[Exception] = []


def _warn_once(error: Exception) -> None:
    _warned.append(error)
    if len(_warned) == 1:
        warn(f"compiled kernels cannot be kept ({error}): each process compiles them; set NUMBA_CACHE_DIR to a folder")


def _digest(name: str, content: bytes) -> bytes:
    """Digest of a file's name and content: a renamed file belongs to another kernel."""
    return hashlib.sha256(name.encode() + content).digest()


@functools.cache
def _compiler_text() -> str:
    """Versions and the compiler's own code."""
    numpy = version("numpy").rpartition(".")[0]
    programs = [sys.implementation.cache_tag, version("numba"), version("llvmlite"), numpy]
    modules: list[Any] = [importlib.util.find_spec(f"{__package__}.{name}") for name in _COMPILER]
    codes = [bytecode_text(one.loader.get_code(one.name)) for one in modules]
    return "\n".join([*map(str, [*programs, getattr(config, "USING_SVML", None)]), *codes])


@functools.cache
def _type_text(kind: types.Type) -> str:
    """Text of a type with the names of records' members, which Numba's own text lacks."""
    if not isinstance(kind, types.BaseTuple):
        return str(kind)
    members = [_type_text(one) for one in kind]  # type: ignore[attr-defined]
    if isinstance(kind, types.BaseNamedTuple):
        record = kind.instance_class  # type: ignore[attr-defined]
        members = [f"{name}: {text}" for name, text in zip(record._fields, members, strict=True)]
        return f"{record.__module__}.{record.__qualname__}({', '.join(members)})"
    return f"({', '.join(members)})"


@functools.cache
def _remove_unused(folder: Path) -> None:
    """Remove, once in a process, files that were not used for long."""
    for entry in folder.iterdir():
        with suppress(OSError):
            if time.time() - entry.stat().st_mtime < _UNUSED_DAYS * _DAY:
                continue
            if entry.is_dir() and len(entry.name) == 20:  # an earlier version's
                shutil.rmtree(entry, ignore_errors=True)
            elif entry.suffix == ".nbc":
                entry.unlink()
