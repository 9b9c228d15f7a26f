"""Decorators of kernels and of the functions that kernels call; Numba is imported when a kernel is first called."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from plenoptic.core.parallel import thread_count


class _Compiled:
    """A function that Numba compiles, with the attributes of its dispatcher, which is made when it is needed."""

    def __init__(self, function: Callable[..., Any]) -> None:
        wrapper: Any = self
        functools.update_wrapper(wrapper, function)
        self.py_func = function

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        if name == "dispatcher":
            thread_count(None)  # Numba's own error for a number of threads below 1 names no variable
            from plenoptic.core.numba.dispatchers import make_dispatcher  # it imports Numba

            # Of two threads, the second takes the result of the first.
            return self.__dict__.setdefault(name, make_dispatcher(self.py_func, is_kernel=isinstance(self, Kernel)))
        return getattr(self.dispatcher, name)


class Kernel(_Compiled):
    """A function of numbers, arrays and records of these; see `kernel`."""

    def __call__(self, *arguments: Any) -> Any:
        """Run the machine code for these types of arguments; compile it, or read it from disk, the first time."""
        return self.dispatcher(*arguments)

    def specialize(self) -> Specialized:
        """The kernel for calls whose arguments have the same types each time."""
        return Specialized(self)


class Specialized:
    """A kernel for the types of arguments of its first call, which later calls do not look up again.

    Numba looks at each array of a record in each call: 3 to 5 us for the records of a scene, three quarters of the cost
    of a call. Arguments of other types are not noticed, and give wrong results; the tests notice them.
    """

    def __init__(self, kernel: Kernel) -> None:
        self._kernel = kernel
        self._entry: Callable[..., Any] | None = None

    def __call__(self, *arguments: Any) -> Any:
        """Run the machine code for the types of arguments of the first call."""
        if self._entry is None:
            dispatcher = self._kernel.dispatcher
            find = getattr(dispatcher, "entry", None)  # Numba's own dispatcher has none
            self._entry = dispatcher if find is None else find(arguments)
        return self._entry(*arguments)


class Device(_Compiled):
    """A function that kernels call; see `device`."""

    def __call__(self, *arguments: Any) -> Any:
        """Run it as Python: no wrapper leads to its machine code."""
        return self.py_func(*arguments)


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function for numbers and arrays, without the GIL, kept on disk."""
    return Kernel(function)


def device(function: Callable[..., Any]) -> Any:
    """Compile a small function that kernels call; it is inlined into them and kept with them."""
    return Device(function)


@functools.cache
def processor() -> str:
    """The kind of processor that kernels are compiled for, and its instructions for vectors: bits depend on them.

    NUMBA_CPU_NAME and NUMBA_CPU_FEATURES can name another processor than the real one. NumPy, Embree and the system's
    mathematics still use the real one: then both are named.
    """
    import llvmlite.binding
    from numba.core.registry import cpu_target

    triple, name, features = cpu_target.target_context.codegen().magic_tuple()
    vectors = [one[1:] for one in features.split(",") if one.startswith(("+avx", "+fma", "+neon", "+sve"))]
    host = llvmlite.binding.get_host_cpu_name()
    target = name if name == host else f"{name} on {host}"
    return f"{target} ({triple.split('-')[0]}: {' '.join(vectors) or 'without avx and fma'})"
