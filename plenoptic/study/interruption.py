"""Interrupted studies, which keep their rows."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

Item = TypeVar("Item")
Row = TypeVar("Row")

INTERRUPTED = "Interrupted: further rows were asked for."
"""Said below the rows that are there."""


def until_interrupted(measure: Callable[[Item], Row], items: Iterable[Item]) -> list[Row]:
    """Measure each item, or the first ones until Ctrl-C, which is raised where there is no result yet."""
    rows: list[Row] = []
    try:
        for item in items:
            rows.append(measure(item))
    except KeyboardInterrupt:
        if not rows:
            raise
    return rows


def with_note(table: str, *, interrupted: bool) -> str:
    """A table as text, with a note below it."""
    return f"{table}\n\n{INTERRUPTED}" if interrupted else table
