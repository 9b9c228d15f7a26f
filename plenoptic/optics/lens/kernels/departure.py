"""What departs from rotational symmetry on a surface, at one point: the kernels of all kinds behind one function."""

from __future__ import annotations

from plenoptic.core.jit import device


@device
def departure_at(x, y, numbers):
    """Added sag and its derivatives by x and y; `numbers` is a row of `LensRecord.departure`."""
    return 0.0, 0.0, 0.0
