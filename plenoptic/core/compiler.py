"""How Numba compiles functions of the package: less work for the same bits.

What a call of Numba's own functions returns is looked up once for the types of its arguments, passes that find nothing
are left out, and no garbage is collected meanwhile. A number that is written in a call makes no variant of what is
called. What unpacks a kernel's records is not optimised. Functions that only kernels call get no wrappers for Python.
They do get machine code, which nobody calls: making it changes the code that is linked into kernels, to what is faster.
"""

from __future__ import annotations

import gc
from typing import Any, ClassVar

from numba.core import codegen, types
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import AnnotateTypes, NativeLowering, NopythonRewrites
from numba.core.untyped_passes import InlineClosureLikes, IRProcessing, WithLifting

from plenoptic.core.absent_fields import AbsentFields
from plenoptic.core.borrowed_arrays import BorrowedArrays
from plenoptic.core.waiting.compiling import compiling
from plenoptic.core.wide_vectors import WideLowering

_UNUSED = (WithLifting, InlineClosureLikes, NopythonRewrites)
"""Passes for what kernels do not contain: `with`, closures, and expressions of whole arrays."""


class _Remembering:
    """A typing context that remembers what calls of Numba's own functions return; a quarter of the time went there."""

    _known: ClassVar[dict[Any, Any]] = {}

    def __init__(self, context: Any) -> None:
        self._context = context

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def resolve_function_type(self, function: Any, args: Any, kws: Any) -> Any:
        if isinstance(function, types.Dispatcher):
            # A number that is written in the call has a type of its own, and would have code of its own.
            args = tuple(types.unliteral(one) if isinstance(one, types.IntegerLiteral) else one for one in args)
        if kws or (isinstance(function, types.Type) and not isinstance(function, types.Function)):
            return self._context.resolve_function_type(function, args, kws)
        key = function, tuple(args)
        known = self._known.get(key)
        if known is None:
            known = self._context.resolve_function_type(function, args, kws)
            if known is not None and known.return_type.is_precise():
                self._known[key] = known
        return known


class _Library(codegen.JITCodeLibrary):
    """The code of a function and of all that it calls."""

    def _optimize_functions(self, module: Any) -> None:
        """As Numba does, but without passes for functions that are only declared, and for what unpacks arguments."""
        module.data_layout = self._codegen._data_layout
        for function in module.functions:
            if function.is_declaration:
                continue
            if module.name == "wrapper":  # what unpacks the records of a call from Python, once for a whole bundle
                function.add_function_attribute("noinline")
                function.add_function_attribute("optnone")
            else:
                passes, builder = self._codegen._function_pass_manager()
                passes.run(function, builder)


class KernelCompiler(CompilerBase):
    """Numba's compiler without idle passes, with wide vectors, and with members that are None as constants."""

    def compile_extra(self, function: Any) -> Any:
        """Compile without collecting garbage: there is little, and a tenth of the time went into looking for it."""
        collecting = gc.isenabled()
        gc.disable()
        try:
            with compiling.noted(function.__name__):
                return super().compile_extra(function)
        finally:
            if collecting:
                gc.enable()

    def define_pipelines(self) -> list[Any]:
        """The passes, in their order."""
        state = self.state
        state.typingctx = _Remembering(state.typingctx)
        state.library = _Library(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.passes = [one for one in passes.passes if one[0] not in _UNUSED]
        passes.add_pass_after(AbsentFields, IRProcessing)
        passes.add_pass_after(BorrowedArrays, AnnotateTypes)
        passes.passes = [(WideLowering if one is NativeLowering else one, text) for one, text in passes.passes]
        passes.finalize()
        return [passes]


class Device(CPUDispatcher):
    """A function that kernels call. Called from Python it runs as Python: no wrapper leads to its machine code."""

    def __call__(self, *arguments: Any) -> Any:
        """Run it as Python."""
        return self.py_func(*arguments)
