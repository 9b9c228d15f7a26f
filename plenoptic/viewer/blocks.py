"""Arrays as compact bytes that a browser unpacks: whole numbers in stated steps, compressed.

A plane is stored as codes of 16 bits: differences along rows, low bytes before high ones, by gzip. A value is
low + step code; where the curve is RECIPROCAL, one over it is, and where it is ASINH, asinh(value / unit) is: its steps
are a part of the value where that is large and steady near 0, so that values of any range and sign fit.
"""

from __future__ import annotations

import enum
import gzip
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import AnyFloats, Floats

NOTHING, INFINITE = 65535, 65534
"""Codes of nan and of infinity, either one."""
_MOST = 65533
_LEVEL = 6
"""Of gzip: higher ones take several times as long for a hundredth of the size."""


class Curve(enum.IntEnum):
    """Quantity in which steps are even; web/planes.js has the inverse."""

    LINEAR = 0
    RECIPROCAL = 1
    ASINH = 2


class Blocks:
    """Bytes of a page, one after the other, and where each lies."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self.size = 0

    def add(self, content: bytes) -> list[int]:
        """Append bytes: their first place and how many they are."""
        place = [self.size, len(content)]
        self._parts.append(content)
        self.size += len(content)
        return place

    def join(self) -> bytes:
        """All of them."""
        return b"".join(self._parts)

    def whole_numbers(self, numbers: NDArray[Any]) -> dict[str, Any]:
        """Whole numbers (rows, columns) of 0 to 2^32 - 1."""
        wide = numbers.size > 0 and int(numbers.max()) > NOTHING
        return {"bytes": self.add(pack(numbers.astype(np.uint32 if wide else np.uint16))), "wide": wide}

    def plane(self, values: AnyFloats, *, curve: Curve, step: float | None = None, unit: float = 1.0) -> dict[str, Any]:
        """Values (rows, columns), in 65534 steps over their range, or in given ones.

        For ASINH, `step` is the relative one, and `unit` the value at which steps become relative.
        """
        bent = _bent(np.asarray(values, dtype=np.float64), curve, unit)
        finite = np.isfinite(bent)
        low, high = (float(bent[finite].min()), float(bent[finite].max())) if finite.any() else (0.0, 0.0)
        spacing = max((high - low) / _MOST, 0.0 if step is None else step) or 1.0
        codes = np.full(bent.shape, NOTHING, dtype=np.uint16)
        codes[finite] = np.rint((bent[finite] - low) / spacing)
        codes[np.isinf(values)] = INFINITE
        return {"bytes": self.add(pack(codes)), "curve": int(curve), "low": low, "step": spacing, "unit": unit}


def pack(codes: NDArray[np.unsignedinteger[Any]]) -> bytes:
    """Codes (rows, columns) as differences along rows, byte by byte, compressed."""
    differences = codes.copy()
    differences[:, 1:] -= codes[:, :-1]  # modulo 2^16, as the sum in the browser
    each = np.ascontiguousarray(differences.astype(differences.dtype.newbyteorder("<")))
    return gzip.compress(each.view(np.uint8).reshape(-1, each.itemsize).T.tobytes(), _LEVEL, mtime=0)


def _bent(values: Floats, curve: Curve, unit: float) -> Floats:
    with np.errstate(divide="ignore", invalid="ignore"):
        if curve is Curve.RECIPROCAL:
            return np.where(np.isfinite(values), 1.0 / values, np.nan)
        return np.arcsinh(values / unit) if curve is Curve.ASINH else values
