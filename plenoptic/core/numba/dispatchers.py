"""Dispatchers: the objects that the decorators make of functions."""

from __future__ import annotations

import weakref
from typing import Any

from numba.core.registry import CPUDispatcher

from plenoptic.core.numba.deviations import deviations, leave_all_out, plainly
from plenoptic.core.numba.parallel_compilation import Task, claim, listed_tasks
from plenoptic.core.parallel import Cancelled, check_cancelled
from plenoptic.core.progress.deferring import defer_interrupts

_all: weakref.WeakSet[Any] = weakref.WeakSet()


_probed: list[bool] = []


def _probe_once() -> None:
    if not _probed:
        _probed.append(True)  # the probe compiles a kernel, too
        from plenoptic.core.kernels.probe import probe_numba  # it is a kernel itself

        probe_numba()


class Device(CPUDispatcher):
    """A function that kernels call. Called from Python it runs as Python: no wrapper leads to its machine code."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        _all.add(self)

    def __call__(self, *arguments: Any) -> Any:
        """Run it as Python."""
        return self.py_func(*arguments)


class Kernel(CPUDispatcher):
    """A kernel, which helper processes may compile."""

    _cache: Any

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
        check_cancelled()
        _probe_once()
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
        for function in _all:
            function._compiler._failed_cache.clear()
        with plainly():
            try:
                entry = super().compile(signature)
            except Exception:
                raise error from None
        leave_all_out(error)
        return entry
