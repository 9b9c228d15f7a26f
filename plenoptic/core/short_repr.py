"""Short texts of the fields of values."""

from __future__ import annotations

from typing import Any

import numpy as np

_DIGITS, _ARRAY_DIGITS = 12, 8
"""Digits of a number, and of those of an array: a computed one, such as 0.1 + 0.2, prints as it was meant."""
_MAX_SHOWN = 9
"""Largest size of an array that is printed in full: that of a rotation matrix."""


def short_repr(item: Any, digits: int = _DIGITS) -> str:
    """Text of a field: numbers in lists and tuples without rounding errors and without -0.0, large arrays by shape."""
    if isinstance(item, np.ndarray):
        if 1 <= item.size <= _MAX_SHOWN and item.ndim <= 2:
            return short_repr(item.tolist(), _ARRAY_DIGITS)
        return f"<{' x '.join(map(str, item.shape))} {item.dtype}>"
    if isinstance(item, float):
        return repr(float(f"{item:.{digits}g}") + 0.0)  # -0.0 becomes 0.0
    if type(item) in (list, tuple):
        text = ", ".join(short_repr(each, digits) for each in item)
        return f"[{text}]" if type(item) is list else f"({text}{',' * (len(item) == 1)})"
    return repr(item)
