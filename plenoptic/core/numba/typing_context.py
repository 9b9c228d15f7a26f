"""Types of calls: looked up once for Numba's own functions, and without a variant for each integer."""

from __future__ import annotations

from typing import Any, ClassVar

from numba.core import types


class KernelTyping:
    """Numba's typing context of a compilation.

    `lean_pipeline`: the signature of a call of one of Numba's own functions is kept for the types of its arguments.
    `one_integer`: an integer that is written in a call of a kernel's function has the type of any integer, so that
    `cut(polygon, 0, n)` and `cut(polygon, first, n)` are one function.
    """

    _signatures: ClassVar[dict[Any, Any]] = {}

    def __init__(self, context: Any, chosen: frozenset[str]) -> None:
        self._context = context
        self._kept, self._one_integer = "lean_pipeline" in chosen, "one_integer" in chosen

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def resolve_function_type(self, function: Any, arguments: Any, keywords: Any) -> Any:
        """Signature of a call."""
        if self._one_integer and isinstance(function, types.Dispatcher):
            arguments = [types.unliteral(one) if isinstance(one, types.IntegerLiteral) else one for one in arguments]
        is_builtin = isinstance(function, types.Function) or not isinstance(function, types.Type)
        if keywords or not (is_builtin and self._kept):
            return self._context.resolve_function_type(function, tuple(arguments), keywords)
        key = function, tuple(arguments)
        signature = self._signatures.get(key)
        if signature is None:
            signature = self._context.resolve_function_type(function, tuple(arguments), keywords)
            if signature is not None and signature.return_type.is_precise():
                self._signatures[key] = signature
        return signature
