"""Counts of lost rays by cause and by element of the lens."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.kernels.ray_blocks import CAUSES
from plenoptic.core.rays import RayStatus
from plenoptic.core.values import whole
from plenoptic.errors import InvalidValueError

Lost = tuple[tuple[str, int | None, int], ...]
"""Causes, indices of elements (None if no element is to blame) and numbers of rays."""


def cause_and_element(code: int) -> tuple[str, int | None]:
    """Cause and element index of the status code of a lost ray, see `ray_blocks`."""
    element, cause = divmod(code, CAUSES)
    return RayStatus(cause).name.lower(), element - 1 if element else None


def lost_rays(counts: NDArray[np.int64]) -> Lost:
    """Lost rays from the numbers of rays for each status code, of which the first is that of rays not lost."""
    return tuple((*cause_and_element(code), int(counts[code])) for code in range(1, len(counts)) if counts[code])


def check_lost(lost: Lost) -> Lost:
    """The same as plain values, or an error."""
    if not isinstance(lost, tuple | list) or not all(isinstance(row, tuple | list) and len(row) == 3 for row in lost):
        raise InvalidValueError(f"lost is {lost!r}; it must be a tuple of (cause, element or None, number)")
    return tuple(
        (
            str(cause),
            None if element is None else whole(element, "lost: element", at_least=0),
            whole(n, "lost: count", at_least=0),
        )
        for cause, element, n in lost
    )


def by_cause(lost: Lost) -> dict[str, int]:
    """Number of rays for each cause, over all elements."""
    causes: dict[str, int] = {}
    for cause, _, count in lost:
        causes[cause] = causes.get(cause, 0) + count
    return causes


def in_words(causes: dict[str, int]) -> str:
    """Text such as "200 clipped, 3 total reflection"."""
    return ", ".join(f"{count} {cause.replace('_', ' ')}" for cause, count in causes.items())
