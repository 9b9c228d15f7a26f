"""Deviations from Numba's pipeline: less work for the compiler and faster code, with the same bits."""

from __future__ import annotations

from typing import Any

from numba.core.typed_passes import AnnotateTypes, NopythonRewrites
from numba.core.untyped_passes import InlineClosureLikes, WithLifting

from plenoptic.core.numba.borrowed_arrays import BorrowedArrays
from plenoptic.core.numba.library import CalleeLibrary, LightLibrary
from plenoptic.core.numba.typing_context import KernelTyping

_UNUSED = (WithLifting, InlineClosureLikes, NopythonRewrites)
"""Passes for features that kernels do not use: `with`, closures, and expressions of whole arrays."""


def apply(chosen: frozenset[str], state: Any, passes: Any) -> None:
    """Change the state and the passes of one compilation."""
    if chosen & {"lean_pipeline", "one_integer"}:
        state.typingctx = KernelTyping(state.typingctx, chosen)
    if "lean_pipeline" in chosen:
        library = CalleeLibrary if state.flags.no_cpython_wrapper else LightLibrary
        state.library = library(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        passes.passes = [one for one in passes.passes if one[0] not in _UNUSED]
    if "borrowed_arrays" in chosen:
        passes.add_pass_after(BorrowedArrays, AnnotateTypes)
