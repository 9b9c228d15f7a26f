"""Warnings with the location of the user's line."""

from __future__ import annotations

import sys
import warnings

from plenoptic.errors import PlenopticWarning


def warn(message: str, category: type[PlenopticWarning] = PlenopticWarning) -> None:
    """Warn at the line that called the package, however deep inside the package the caller is."""
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and str(frame.f_globals.get("__name__")).partition(".")[0] == "plenoptic":
        level, frame = level + 1, frame.f_back
    warnings.warn(message, category, stacklevel=level)
