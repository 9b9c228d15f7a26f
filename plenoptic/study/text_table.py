"""Tables as text: padded columns, Markdown, comma-separated values."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable, Sequence

from plenoptic.core.files.atomic_file import write_file


def _aligned(columns: Sequence[str], rows: Iterable[Sequence[str]], between: str) -> list[str]:
    """Lines of a table, its head first, padded to equal widths."""
    cells = [tuple(columns), *map(tuple, rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(columns))]
    return [between.join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in cells]


def plain_table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table for terminals, padded to equal widths."""
    return "\n".join(line.rstrip() for line in _aligned(columns, rows, "  "))


def markdown_table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown, padded to equal widths."""
    cells = [[" ".join(cell.replace("|", "\\|").split()) for cell in row] for row in rows]
    head, *body = _aligned(columns, cells, " | ")
    rule = " | ".join("-" * len(cell) for cell in head.split(" | "))
    return "\n".join(f"| {line} |" for line in (head, rule, *body))


def comma_separated(rows: Iterable[Sequence[object]], path: str | os.PathLike[str] | None) -> str:
    """Rows as comma-separated values, None as nothing; written too where there is a path."""
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows(rows)
    text = stream.getvalue()
    if path is not None:
        write_file(path, text.encode())
    return text
