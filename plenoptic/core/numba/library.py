"""The machine code of a function and of all that it calls, with fewer passes of LLVM."""

from __future__ import annotations

from typing import Any

from numba.core.codegen import JITCodeLibrary


class LightLibrary(JITCodeLibrary):
    """Numba's library without passes for functions that are only declared, and for wrappers.

    A wrapper unpacks the records of a call from Python, once for a whole bundle of rays.
    """

    def _optimize_functions(self, module: Any) -> None:
        module.data_layout = self._codegen._data_layout
        for function in module.functions:
            if function.is_declaration:
                continue
            if module.name == "wrapper":
                function.add_function_attribute("noinline")
                function.add_function_attribute("optnone")
            else:
                passes, builder = self._codegen._function_pass_manager()
                passes.run(function, builder)


class CalleeLibrary(LightLibrary):
    """Library of a function that kernels call: they optimise it, inlined, and it needs no machine code."""

    def _optimize_final_module(self) -> None:
        """Left to the kernels."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Nobody calls it by address."""
        return 0

    @property
    def codegen(self) -> Any:
        """Numba sets the environment of machine code by its code generator."""
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Without machine code there is none."""
