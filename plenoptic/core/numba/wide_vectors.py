"""A compiler pass: vectors as wide as the processor's registers.

LLVM halves vectors on processors with AVX-512, whose first models slowed down their clock for full ones. From those
with VBMI2 on (Ice Lake, Zen 4) full ones are faster. Bits are the same.
"""

from __future__ import annotations

from typing import Any

from llvmlite.ir.values import FunctionAttributes
from numba.core.compiler_machinery import register_pass
from numba.core.lowering import Lower
from numba.core.typed_passes import BaseNativeLowering

_WIDE = '"prefer-vector-width"="512"'


class _Attributes(FunctionAttributes):
    _known = FunctionAttributes._known | {_WIDE}


class _WideLower(Lower):
    def setup_function(self, fndesc: Any) -> None:
        super().setup_function(fndesc)
        if "+avx512vbmi2" in self.context.codegen().magic_tuple()[2]:
            self.function.attributes = _Attributes([*self.function.attributes, _WIDE])


@register_pass(mutates_CFG=True, analysis_only=False)
class WideLowering(BaseNativeLowering):
    """Numba's last pass, with the attribute for vectors of 512 bits."""

    _name = "wide_lowering"  # type: ignore[assignment]

    @property
    def lowering_class(self) -> type[Lower]:
        """Class that generates LLVM's code."""
        return _WideLower
