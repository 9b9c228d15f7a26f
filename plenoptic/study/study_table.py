"""The table of a study: in Markdown and comma-separated values; complete, or interrupted."""

from __future__ import annotations

import csv
import enum
import io
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Generic, Protocol, TypeVar

from plenoptic.core.files.atomic_file import write_file
from plenoptic.core.values import set_field, value

INTERRUPTED = "Interrupted: further rows were asked for."


Cell = tuple[str, str]
"""Head of the column, and text."""


class StudyRow(Protocol):
    """A row of a table: a NamedTuple of its numbers."""

    @property
    def cells(self) -> Sequence[Cell]:
        """Texts with the heads of their columns."""

    def _asdict(self) -> dict[str, Any]: ...


Item = TypeVar("Item")
Measured = TypeVar("Measured")
Row = TypeVar("Row", bound=StudyRow)


@value
class StudyTable(Generic[Row]):
    """Rows of a study, and notes below them; `print` shows it.

    Parameters
    ----------
    rows : sequence
        `CostRow` or `StabilityRow`, one or more.
    notes : sequence of str, optional
    interrupted : bool, optional
        True if further rows were asked for.

    Examples
    --------
    >>> import plenoptic as pl
    >>> stage = pl.rendering.Stage.POSE
    >>> row = pl.study.CostRow(stage, "the scene in the camera's frame", 2.0, 1.96, 2.0, 0.3, 0.001, 0.0)
    >>> table = pl.study.StudyTable([row], ["16 samples"])
    >>> table
    <StudyTable: 1 row>
    >>> print(table.to_markdown().splitlines()[2])
    | pose  | the scene in the camera's frame | 2      | 1.96      | 2.0      | 0.3 | 0.001    | 0         |           |
    """

    rows: Sequence[Row]
    notes: Sequence[str] = ()
    interrupted: bool = False

    def __post_init__(self) -> None:
        set_field(self, "rows", tuple(self.rows))
        set_field(self, "notes", tuple(self.notes))

    def to_markdown(self) -> str:
        """The table in Markdown, with the notes below."""
        table = markdown_table([row.cells for row in self.rows])
        return "\n\n".join([table, *self.notes, *[INTERRUPTED] * self.interrupted])

    def to_csv(self, path: str | os.PathLike[str] | None = None) -> str:
        """All numbers as comma-separated values; also written to a file if `path` is given."""
        return csv_text([row._asdict() for row in self.rows], path)

    __str__ = _repr_markdown_ = to_markdown

    def __repr__(self) -> str:
        return f"<StudyTable: {len(self.rows)} row{'s' * (len(self.rows) != 1)}{', interrupted' * self.interrupted}>"


def run_until_interrupt(measure: Callable[[Item], Measured], items: Iterable[Item]) -> list[Measured]:
    """Measure each item; after Ctrl-C return the first ones, or raise KeyboardInterrupt if there is none."""
    measured: list[Measured] = []
    try:
        for item in items:
            measured.append(measure(item))
    except KeyboardInterrupt:
        if not measured:
            raise
    return measured


def markdown_table(rows: Sequence[Sequence[Cell]]) -> str:
    """A table in Markdown, padded to equal widths."""
    head = [name for name, _ in rows[0]]
    lines = [head, *([" ".join(text.replace("|", "\\|").split()) for _, text in row] for row in rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    lines.insert(1, ["-" * width for width in widths])
    padded = ([text.ljust(width) for text, width in zip(line, widths, strict=True)] for line in lines)
    return "\n".join(f"| {' | '.join(line)} |" for line in padded)


def csv_text(rows: Sequence[Mapping[str, Any]], path: str | os.PathLike[str] | None) -> str:
    """Rows as comma-separated values, None and nan as nothing; also written to a file if `path` is given."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerows([tuple(rows[0]), *([_plain(number) for number in row.values()] for row in rows)])
    text = stream.getvalue()
    if path is not None:
        write_file(path, text.encode())
    return text


def _plain(number: Any) -> Any:
    """Enums by their names, sequences with spaces between, nan as nothing."""
    if isinstance(number, enum.Enum):
        return number.name
    if isinstance(number, tuple):
        return " ".join(str(_plain(part)) for part in number)
    return None if isinstance(number, float) and math.isnan(number) else number
