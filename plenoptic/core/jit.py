"""The only Numba configuration of the package.

Kernels see numbers, arrays and records of these, release the GIL, divide as IEEE 754 says, and may fuse multiply and
add (`contract`): the intersection formula of `optics.lens.kernels.sphere` needs the fused form for distant origins.
Compiled code is kept outside site-packages in a folder named after a hash of all that kernels are compiled from
(`core`, the folders `kernels`, and the files `record.py` and `registry.py`), because Numba by itself does not notice
that a callee in another file has changed. Within it Numba keeps variants for different processors apart.
"""

from __future__ import annotations

import functools
import hashlib
import os
import pickle
import secrets
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from numba.core import caching, codegen
from numba.core.registry import cpu_target

from plenoptic.core.ahead import Kernel
from plenoptic.core.compiler import Device, KernelCompiler


@functools.cache
def sources_hash() -> str:
    """Of all that kernels are compiled from."""
    digest = hashlib.sha256()
    root = Path(__file__).parents[1]
    patterns = ("**/kernels/*.py", "**/record.py", "**/registry.py", "core/*.py", "optics/surfaces/*.py")
    for path in sorted(path for pattern in patterns for path in root.glob(pattern)):
        digest.update(str(path.relative_to(root)).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:20]


@functools.cache
def processor() -> str:
    """The kind of processor that kernels are compiled for, and its instructions for vectors: bits depend on them.

    NUMBA_CPU_NAME and NUMBA_CPU_FEATURES can name another than that which is there, and which NumPy, Embree and the
    system's mathematics still use: then both are named.
    """
    triple, name, features = cpu_target.target_context.codegen().magic_tuple()
    vectors = [one[1:] for one in features.split(",") if one.startswith(("+avx", "+fma", "+neon", "+sve"))]
    there = codegen.ll.get_host_cpu_name()  # type: ignore[attr-defined]
    named = name if name == there else f"{name} on {there}"
    return f"{named} ({triple.split('-')[0]}: {' '.join(vectors) or 'without avx and fma'})"


@functools.cache
def cache_folder() -> Path | None:
    """Where compiled kernels are kept: NUMBA_CACHE_DIR, or the user's cache folder; None if not writable."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        folder = Path(chosen) / "plenoptic"
    else:
        base = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA") or str(Path.home() / ".cache")
        folder = Path(base) / "plenoptic" / "kernels"
    folder /= sources_hash()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError:
        return None


class _Locator(caching._CacheLocator):
    """Tells Numba where the compiled code of a kernel lies and what it was made from."""

    def __init__(self, function: Any, folder: Path, source: bytes) -> None:
        self._line = function.__code__.co_firstlineno
        self._folder = folder
        self._source = hashlib.sha256(source).hexdigest()[:12]

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        return "in the names of folder and file"

    def get_disambiguator(self) -> str:
        # The file's contents keep namesakes of `optics` and `scene`, and kernels of the tests, apart.
        return f"{self._line}-{self._source}"

    @classmethod
    def from_function(cls, function: Any, source: str) -> _Locator | None:
        folder = cache_folder()
        try:
            return None if folder is None else cls(function, folder, Path(source).read_bytes())
        except OSError:  # typed in by hand: there is no file
            return None


class _Implementation(caching.CompileResultCacheImpl):
    _locator_classes: list[Any] = [_Locator]


class _Files(caching.IndexDataCacheFile):
    """Data files that say what they are: their digest, then for which function and variant the code is, then the code.

    A variant is named by its signature, its bytecode, and the processor's name and instructions.
    """

    def save(self, key: Any, data: Any) -> None:
        super().save(key, (self._index_name, key, data))

    def load(self, key: Any) -> Any:
        *whose, data = super().load(key) or (None,)
        return data if whose == [self._index_name, key] else None

    def _save_data(self, name: str, data: Any) -> None:
        content = self._dump(data)
        with self._open_for_write(self._data_path(name)) as file:
            file.write(hashlib.sha256(content).digest() + content)

    def _load_data(self, name: str) -> Any:
        digest, content = (whole := Path(self._data_path(name)).read_bytes())[:32], whole[32:]
        return pickle.loads(content) if hashlib.sha256(content).digest() == digest else None


class _KernelCache(caching.FunctionCache):
    _impl_class = _Implementation

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        name = self._impl.filename_base
        file = self._cache_file = _Files(self._cache_path, name, self._impl.locator.get_source_stamp())
        # Numba numbers its files; two processes that compile two variants at once would both write number 1.
        file._data_name_pattern = f"{name}.{secrets.token_hex(6)}.{{number:d}}.nbc"

    def has(self, signature: Any, context: Any) -> bool:
        """Whether there is a variant, which may turn out to be damaged."""
        try:
            return self._index_key(signature, context.codegen()) in self._cache_file._load_index()
        except Exception:  # a damaged index
            return False

    def load_overload(self, signature: Any, context: Any) -> Any:
        try:
            return super().load_overload(signature, context)
        except Exception:  # damaged bytes unpickle to any error there is: compile anew
            return None

    def save_overload(self, signature: Any, data: Any) -> None:
        try:
            super().save_overload(signature, data)
        except OSError:  # a full or read-only disk: go on without a cache
            pass
        except Exception:  # a damaged index: begin a new one
            with suppress(OSError):
                self._cache_file.flush()
                super().save_overload(signature, data)


_OPTIONS = {"nopython": True, "nogil": True, "boundscheck": None, "error_model": "numpy", "fastmath": {"contract"}}
_OPTIONS |= {"no_cfunc_wrapper": True}


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function for numbers and arrays, without the GIL, cached on disk."""
    compiled = Kernel(function, targetoptions=dict(_OPTIONS), pipeline_class=KernelCompiler)
    with suppress(RuntimeError):  # nowhere to write: compile in memory
        compiled._cache = _KernelCache(function)
    return compiled


def device(function: Callable[..., Any]) -> Any:
    """Compile a small function that kernels call; it is inlined into them and cached with them."""
    options = {**_OPTIONS, "no_cpython_wrapper": True}
    return Device(function, targetoptions=options, pipeline_class=KernelCompiler)
