"""A compiler pass: functions that make no arrays do not count references to their arguments.

Numba counts the references to an array with each name and each slice, by an atomic instruction each time: a third of
the time of kernels that call functions for each path. The caller keeps its arrays alive, so that only functions in
which a call returns an array (a new one, a view, or that of another function), or that return one, need to count.
"""

from __future__ import annotations

from typing import Any

from numba.core import ir, types
from numba.core.compiler_machinery import AnalysisPass, register_pass


def _holds_array(kind: Any) -> bool:
    if isinstance(kind, types.BaseTuple):
        return any(_holds_array(member) for member in kind)  # type: ignore[attr-defined]
    return isinstance(kind, types.Array)


def _makes_arrays(state: Any) -> bool:
    """True if a call returns an array, an array is assigned to an element, or the function returns one."""
    if _holds_array(state.return_type):
        return True
    kinds = state.typemap
    for block in state.func_ir.blocks.values():
        for one in block.body:
            if isinstance(one, ir.Assign) and isinstance(one.value, ir.Expr) and one.value.op == "call":
                if _holds_array(kinds[one.target.name]):
                    return True
            elif isinstance(one, ir.SetItem | ir.StaticSetItem) and _holds_array(kinds[one.value.name]):
                return True
    return False


@register_pass(mutates_CFG=False, analysis_only=True)
class BorrowedArrays(AnalysisPass):
    """Compiler pass between type inference and code generation that disables reference counting."""

    _name = "borrowed_arrays"

    def __init__(self) -> None:
        AnalysisPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        """Disable reference counting if the function makes no arrays."""
        if not _makes_arrays(state):
            state.targetctx = state.targetctx.subtarget(enable_nrt=False)
        return False
