"""The compiler of kernels: Numba's pipeline with the pass `absent_fields`, and the deviations in force."""

from __future__ import annotations

import gc
from typing import Any

from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.untyped_passes import IRProcessing

from plenoptic.core.numba.absent_fields import AbsentFields
from plenoptic.core.numba.deviations import deviations, leave_all_out
from plenoptic.core.progress.compiling import compiling


class KernelCompiler(CompilerBase):
    """Numba's compiler, in which members of records that are None are constants."""

    def compile_extra(self, function: Any) -> Any:
        """Compile a function; garbage is collected afterwards, since there is little."""
        collecting = gc.isenabled() and "lean_pipeline" in deviations()
        if collecting:
            gc.disable()
        try:
            with compiling.track(function.__name__):
                return super().compile_extra(function)
        finally:
            if collecting:
                gc.enable()

    def define_pipelines(self) -> list[Any]:
        """The passes, in their order."""
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(AbsentFields, IRProcessing)
        if chosen := deviations():
            try:
                from plenoptic.core.numba.shortcuts import apply

                apply(chosen, self.state, passes)
            except (ImportError, AttributeError, TypeError) as error:
                leave_all_out(error)
                return self.define_pipelines()
        passes.finalize()
        return [passes]
