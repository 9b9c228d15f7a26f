"""What the simulator can be trusted with: studies that print a table. ``python -m plenoptic.study`` runs them."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from plenoptic.study.cost.measurement import cost_of as cost_of
    from plenoptic.study.cost.table import CostRow as CostRow
    from plenoptic.study.cost.table import CostTable as CostTable
    from plenoptic.study.error_time.recommendation import Recommendation as Recommendation
    from plenoptic.study.error_time.rows import ErrorRow as ErrorRow
    from plenoptic.study.error_time.study import error_against_time as error_against_time
    from plenoptic.study.error_time.table import ErrorTable as ErrorTable
    from plenoptic.study.error_time.variants import Variant as Variant
    from plenoptic.study.error_time.variants import default_variants as default_variants
    from plenoptic.study.rounding.table import stability as stability

__all__ = [
    "CostRow",
    "CostTable",
    "ErrorRow",
    "ErrorTable",
    "Recommendation",
    "Variant",
    "cost_of",
    "default_variants",
    "error_against_time",
    "stability",
]

_HOMES = {
    "CostRow": "cost.table",
    "CostTable": "cost.table",
    "cost_of": "cost.measurement",
    "ErrorRow": "error_time.rows",
    "ErrorTable": "error_time.table",
    "Recommendation": "error_time.recommendation",
    "Variant": "error_time.variants",
    "default_variants": "error_time.variants",
    "error_against_time": "error_time.study",
    "stability": "rounding.table",
}
"""Where names live that are loaded on first use."""

if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        if name not in _HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        found = getattr(importlib.import_module(f"plenoptic.study.{_HOMES[name]}"), name)
        globals()[name] = found
        return found

    def __dir__() -> list[str]:
        return sorted({*globals(), *_HOMES})
