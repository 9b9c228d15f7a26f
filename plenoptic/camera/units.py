"""Hint for lengths that were probably given in metres."""

from __future__ import annotations


def metres_hint(length: float, limit: float) -> str:
    """End of an error message about a length that must exceed `limit` mm: a hint if it would in metres; else empty.

    A length below a fiftieth of the limit is hardly meant in mm.
    """
    if length * limit > 0 and abs(limit) < 1e3 * abs(length) < 20.0 * abs(limit):
        return f"; {length:g} looks like metres: give {1e3 * length:g}, and all other lengths in mm too"
    return ""
