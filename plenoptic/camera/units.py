"""A guess at the unit of a length that cannot be one in mm."""

from __future__ import annotations


def metres_guess(given: float, limit: float) -> str:
    """The end of a message about a length that must be beyond `limit` mm: that it would be, in metres; mostly nothing.

    A fiftieth of the limit is far from the numbers of somebody who gives mm.
    """
    if 0 < given / limit < 0.02 and 1e3 * given / limit > 1:
        return f"; {given:g} looks like metres: give {1e3 * given:g}, and all other lengths in mm too"
    return ""
