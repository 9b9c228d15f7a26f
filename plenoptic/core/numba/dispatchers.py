"""Numba's dispatchers of kernels and of the functions that kernels call: the only configuration of Numba.

Kernels take numbers, arrays and records of these, release the GIL, divide as IEEE 754 says, and may fuse multiply and
add (`contract`): the intersection formula of `optics.lens.kernels.spherical_refraction` needs the fused form for far
origins.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Any

import numba
from numba import _dispatcher
from numba.core.registry import CPUDispatcher

from plenoptic.core.kernels.probe import probe_numba
from plenoptic.core.numba.deviations import deviations, leave_all_out, plainly
from plenoptic.core.numba.kernel_cache import KernelCache
from plenoptic.core.numba.parallel_compilation import Task, claim, listed_tasks
from plenoptic.core.numba.pipeline import KernelCompiler
from plenoptic.core.parallel import Cancelled, check_cancellation
from plenoptic.core.progress.deferring import defer_interrupts

_OPTIONS: dict[str, Any] = {
    "nopython": True,
    "nogil": True,
    "boundscheck": None,
    "error_model": "numpy",
    "fastmath": {"contract"},
}

_device_dispatchers: weakref.WeakSet[Any] = weakref.WeakSet()
_probed: list[bool] = []


def make_dispatcher(function: Callable[..., Any], *, is_kernel: bool) -> Any:
    """Dispatcher of a kernel, whose code is kept on disk, or of a function that kernels call."""
    dispatcher: Any = None
    # Loops that call a function are vectorised only if it is inlined.
    options = _OPTIONS | ({} if is_kernel else {"forceinline": True})
    if chosen := deviations():
        without = {"no_cfunc_wrapper": True} | ({} if is_kernel else {"no_cpython_wrapper": True})
        lean = options | (without if "no_wrappers" in chosen else {})
        try:
            make: Any = KernelDispatcher if is_kernel else CPUDispatcher
            dispatcher = make(function, targetoptions=lean, pipeline_class=KernelCompiler)
        except (AttributeError, TypeError) as error:
            leave_all_out(error)
    if dispatcher is None:
        dispatcher = numba.jit(**options, pipeline_class=KernelCompiler)(function)
    if is_kernel:
        dispatcher._cache = KernelCache(function)
    else:
        _device_dispatchers.add(dispatcher)
    return dispatcher


class KernelDispatcher(CPUDispatcher):
    """Dispatcher of a kernel, which helper processes may compile."""

    _cache: Any
    _entries: dict[bytes, Any]

    def entry(self, arguments: tuple[Any, ...]) -> Any:
        """Machine code for the types of some arguments; the dispatcher in a run that lists the kernels to compile."""
        fingerprint = getattr(_dispatcher, "compute_fingerprint", None)  # an internal of Numba
        if listed_tasks() is not None or fingerprint is None:
            return self
        types = fingerprint(arguments)
        entries = self.__dict__.setdefault("_entries", {})
        if types not in entries:
            entries[types] = self.compile(tuple(map(self.typeof_pyval, arguments)))
        return entries[types]

    def _compile_for_args(self, *arguments: Any, **keywords: Any) -> Any:
        """Compile for a call; in a run that lists the kernels to compile, note this one and do nothing."""
        tasks = listed_tasks()
        if tasks is not None:
            task: Task = self, tuple(self.typeof_pyval(argument) for argument in arguments)
            if self._cache.lacks(task[1], self.targetctx):
                tasks.append(task)
                return lambda *_: 0
        return super()._compile_for_args(*arguments, **keywords)  # type: ignore[misc]

    def compile(self, signature: Any) -> Any:
        """Compile for types of arguments, or load the compiled code; Cancelled if nobody waits for it any longer."""
        check_cancellation()
        if not _probed:
            _probed.append(True)  # the probe compiles a kernel, too
            probe_numba()
        claim((self, signature))
        with defer_interrupts():
            try:
                return super().compile(signature)
            except (Cancelled, Warning):
                raise
            except Exception as error:
                return self._compile_plainly(signature, error)

    def _compile_plainly(self, signature: Any, error: Exception) -> Any:
        """Compile by Numba's own pipeline; the error of before where that fails, too."""
        if not deviations():
            raise error
        for device in _device_dispatchers:
            device._compiler._failed_cache.clear()
        with plainly():
            try:
                entry = super().compile(signature)
            except Exception:
                raise error from None
        leave_all_out(error)
        return entry
