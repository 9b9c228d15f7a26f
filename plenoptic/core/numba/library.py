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
