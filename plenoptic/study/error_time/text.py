"""Error studies as comma-separated values and as Markdown."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
import os
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, Any

from plenoptic.core.values import file_path
from plenoptic.errors import FileError
from plenoptic.study.error_time.rows import ErrorRow
from plenoptic.study.text_table import comma_separated, markdown_table

if TYPE_CHECKING:
    from plenoptic.study.error_time.table import ErrorTable

_FACTS: dict[str, type] = {
    "title": str,
    "pixels": int,
    "lit_pixels": int,
    "seeds": int,
    "threads": int,
    "reference_samples": int,
    "reference_error": float,
}
"""What a table knows beside its rows; repeated in every line of a file."""

_ROW = tuple(field.name for field in dataclasses.fields(ErrorRow))  # type: ignore[arg-type]

_COLUMNS = (
    "variant",
    "samples",
    "CPU s",
    "wall s",
    "CPU us per pixel",
    "without setting up",
    "error %",
    "noise %",
    "bias %",
    "true / reported",
    "front",
)
_SLOPES = ("variant", "slope of the noise", "bias floor %", "setting up: CPU ms", "CPU ns per pixel and sample")


def markdown_of(rows: Sequence[ErrorRow], pixels: int, front: Collection[ErrorRow]) -> str:
    """One line for each row; those of the Pareto front are marked."""
    return markdown_table(_COLUMNS, [_cells(row, pixels, row in front) for row in rows])


def _cells(row: ErrorRow, pixels: int, in_front: bool) -> tuple[str, ...]:
    ratio = row.true_over_reported
    return (
        row.variant,
        str(row.samples),
        f"{row.cpu_seconds:.3g}",
        f"{row.wall_seconds:.3g}",
        f"{1e6 * row.cpu_seconds / pixels:.3g}",
        f"{1e6 * max(row.cpu_seconds - row.setup_cpu_seconds, 0.0) / pixels:.3g}",
        f"{100 * row.error:.3g}",
        f"{100 * row.noise:.3g}",
        bias_text(row),
        "" if ratio is None else f"{ratio:.2f}",
        "*" if in_front else "",
    )


def bias_text(row: ErrorRow) -> str:
    """The bias in per cent with its standard error, or what it is below."""
    if row.bias_is_found:
        digits = max(0, -math.floor(math.log10(100 * row.bias_error))) if row.bias_error > 0 else 3
        return f"{100 * row.bias:.{digits}f} ± {100 * row.bias_error:.{digits}f}"
    return f"< {100 * row.bias_limit:.2g}"


def slopes_markdown(fits: Sequence[tuple[str, float, float, ErrorRow, int]], pixels: int) -> str:
    """One line for each variant: name, slope and its standard error, row of the best known bias, number of rows."""
    lines = []
    for name, slope, error, known, count in fits:
        each = max(known.cpu_seconds - known.setup_cpu_seconds, 0.0) / (pixels * known.samples)
        lines.append(
            (
                name,
                f"{slope:.3f} ± {error:.3f}" if count > 1 else "",
                bias_text(known),
                f"{1e3 * known.setup_cpu_seconds:.3g}",
                f"{1e9 * each:.3g}",
            )
        )
    return markdown_table(_SLOPES, lines)


def csv_of(tables: Sequence[ErrorTable], path: str | os.PathLike[str] | None) -> str:
    """Tables as one text of comma-separated values, which is also written where there is a path."""
    rows: list[Sequence[object]] = [[*_FACTS, *_ROW]]
    for table in tables:
        facts = [getattr(table, name) for name in _FACTS]
        rows += [[*facts, *(getattr(row, name) for name in _ROW)] for row in table.rows]
    return comma_separated(rows, path)


def table_in(path: str | os.PathLike[str], title: str | None) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Facts and rows of one table of a file of comma-separated values."""
    name = os.fspath(file_path(path))
    try:
        lines = list(csv.DictReader(io.StringIO(file_path(path).read_text(encoding="utf-8"))))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise FileError(f"{name!r} cannot be read: {error}") from error
    titles = list(dict.fromkeys(line.get("title") for line in lines))
    if title is None and len(titles) == 1:
        title = titles[0]
    if title is None or title not in titles:
        raise FileError(f"{name!r} has the tables {titles}, and title is {title!r}; it must be one of them")
    chosen = [line for line in lines if line["title"] == title]
    try:
        facts = {key: kind(chosen[0][key]) for key, kind in _FACTS.items()}
        return facts, [_row_in(line) for line in chosen]
    except (KeyError, TypeError, ValueError) as error:
        raise FileError(f"{name!r} is no table of an error study: {error!r}") from error


def _row_in(line: dict[str, str]) -> dict[str, Any]:
    row: dict[str, Any] = {"variant": line["variant"], "samples": int(line["samples"])}
    for name in _ROW[2:]:
        row[name] = float(line[name]) if line[name] or name != "reported_variance" else None
    return row
