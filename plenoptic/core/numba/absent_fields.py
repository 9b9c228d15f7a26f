"""A compiler pass: absent members of records become the constant None, so that Numba prunes their branches.

Numba drops the branch of `if x is not None` at compile time where x is an argument, and not where it is `record.x`.
This pass runs before that pruning, and replaces each plain chain of names that leads from an argument through
NamedTuples to a member that is None by the constant. A member of an absent record is absent. For members that are
present, `x is not None` becomes True, so that the other branch is dropped too.
"""

from __future__ import annotations

import operator
from typing import Any

from numba.core import ir, types
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.ir_utils import get_definition, guard


def _type_of(state: Any, variable: Any) -> Any:
    """The type of an argument, or of a member of one; None if neither is known before types are inferred."""
    definition = guard(get_definition, state.func_ir, variable)
    if isinstance(definition, ir.Arg):
        return state.args[definition.index] if definition.index < len(state.args) else None
    if isinstance(definition, ir.Const) and definition.value is None:
        return types.none
    if isinstance(definition, ir.Expr) and definition.op == "getattr":
        record: Any = _type_of(state, definition.value)
        if isinstance(record, types.NoneType):
            return record
        fields = record.fields if isinstance(record, types.BaseNamedTuple) else ()  # type: ignore[attr-defined]
        if definition.attr in fields:
            return record.types[fields.index(definition.attr)]
    return None


def _is_present(state: Any, comparison: Any) -> bool:
    """True for a comparison with None whose other operand cannot be None."""
    if comparison.fn not in (operator.is_, operator.is_not):
        return False
    other = guard(get_definition, state.func_ir, comparison.rhs)
    if not isinstance(other, ir.Const) or other.value is not None:
        return False
    kind = _type_of(state, comparison.lhs)
    return kind is not None and not isinstance(kind, types.NoneType | types.Optional | types.Omitted)


@register_pass(mutates_CFG=False, analysis_only=False)
class AbsentFields(FunctionPass):
    """Compiler pass that replaces absent members by None."""

    _name = "absent_fields"

    def __init__(self) -> None:
        FunctionPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        """Replace absent members, and return True if there were any."""
        changed = False
        for block in state.func_ir.blocks.values():
            for statement in block.body:
                if not isinstance(statement, ir.Assign) or not isinstance(statement.value, ir.Expr):
                    continue
                if statement.value.op == "getattr" and isinstance(_type_of(state, statement.target), types.NoneType):
                    statement.value = ir.Const(None, statement.loc)
                elif statement.value.op == "binop" and _is_present(state, statement.value):
                    statement.value = ir.Const(statement.value.fn is operator.is_not, statement.loc)
                else:
                    continue
                state.func_ir._definitions[statement.target.name] = [statement.value]
                changed = True
        return changed
