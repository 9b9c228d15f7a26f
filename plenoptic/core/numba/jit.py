"""Decorators of kernels and of the functions that kernels call: the only configuration of Numba.

Kernels take numbers, arrays and records of these, release the GIL, divide as IEEE 754 says, and may fuse multiply and
add (`contract`): the intersection formula of `optics.lens.kernels.sphere` needs the fused form for distant origins.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import llvmlite.binding
import numba

from plenoptic.core.numba.deviations import deviations, leave_all_out
from plenoptic.core.numba.kernel_cache import KernelCache
from plenoptic.core.numba.pipeline import KernelCompiler

_OPTIONS: dict[str, Any] = {
    "nopython": True,
    "nogil": True,
    "boundscheck": None,
    "error_model": "numpy",
    "fastmath": {"contract"},
}


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function for numbers and arrays, without the GIL, kept on disk."""
    compiled = _dispatcher(function, "Kernel", {"no_cfunc_wrapper": True})
    compiled._cache = KernelCache(function)
    return compiled


def device(function: Callable[..., Any]) -> Any:
    """Compile a small function that kernels call; it is inlined into them and kept with them."""
    return _dispatcher(function, "Device", {"no_cfunc_wrapper": True, "no_cpython_wrapper": True})


def _dispatcher(function: Callable[..., Any], kind: str, without: dict[str, bool]) -> Any:
    if chosen := deviations():
        try:
            from plenoptic.core.numba import dispatchers

            options = _OPTIONS | without if "no_wrappers" in chosen else dict(_OPTIONS)
            return getattr(dispatchers, kind)(function, targetoptions=options, pipeline_class=KernelCompiler)
        except (ImportError, AttributeError, TypeError) as error:
            leave_all_out(error)
    return numba.jit(**_OPTIONS, pipeline_class=KernelCompiler)(function)


@functools.cache
def processor() -> str:
    """The kind of processor that kernels are compiled for, and its instructions for vectors: bits depend on them.

    NUMBA_CPU_NAME and NUMBA_CPU_FEATURES can name another than that which is there, and which NumPy, Embree and the
    system's mathematics still use: then both are named.
    """
    from numba.core.registry import cpu_target

    triple, name, features = cpu_target.target_context.codegen().magic_tuple()
    vectors = [one[1:] for one in features.split(",") if one.startswith(("+avx", "+fma", "+neon", "+sve"))]
    host = llvmlite.binding.get_host_cpu_name()
    target = name if name == host else f"{name} on {host}"
    return f"{target} ({triple.split('-')[0]}: {' '.join(vectors) or 'without avx and fma'})"
