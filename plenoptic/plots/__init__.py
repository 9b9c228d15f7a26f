"""Figures: arrays in, figure out. Matplotlib is imported on first use."""

from __future__ import annotations

from typing import Any

from plenoptic.errors import PlenopticError


class _MissingMatplotlibError(PlenopticError, ImportError):
    pass


def _pyplot() -> Any:
    """`matplotlib.pyplot`, or an error that says how to get it."""
    try:
        import matplotlib.pyplot as plt
    except ImportError as error:
        raise _MissingMatplotlibError(
            f'figures need matplotlib, which cannot be imported ({error}); pip install "plenoptic[plot]"'
        ) from error
    return plt
