"""Figures of values. The plotting package imports all others, so it is imported by name on first use."""

from __future__ import annotations

import importlib
from typing import Any

_DISPLAYS = "plenoptic.plots.notebook.displays"
"""Module with the tables PICTURES and DRAWINGS, by names of classes."""


def picture_of(value: object) -> str:
    """HTML of a value, for notebooks."""
    text: str = importlib.import_module(_DISPLAYS).PICTURES[type(value).__name__](value)
    return text


def draw(value: object, *arguments: Any, **options: Any) -> Any:
    """Draw a value; axes or a figure."""
    return importlib.import_module(_DISPLAYS).DRAWINGS[type(value).__name__](value, *arguments, **options)
