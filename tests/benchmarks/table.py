"""Tables as Markdown."""

from collections.abc import Sequence
from typing import NamedTuple


class Table(NamedTuple):
    """A title, columns (or one text, "a | b"), rows of cells (texts and numbers; None is empty), and remarks below."""

    title: str
    columns: Sequence[str] | str
    rows: Sequence[Sequence[object]]
    remarks: Sequence[str] = ()

    def markdown(self):
        columns = self.columns.split(" | ") if isinstance(self.columns, str) else self.columns
        cells = [[_text(cell) for cell in row] for row in (columns, *self.rows)]
        widths = [max(len(row[i]) for row in cells) for i in range(len(columns))]
        head, *body = [" | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in cells]
        rule = " | ".join("-" * width for width in widths)
        lines = [f"| {line} |" for line in (head, rule, *body)]
        return "\n".join([f"### {self.title}", "", *lines, *(f"\n{remark}" for remark in self.remarks), ""])


def _text(cell):
    if cell is None:
        return ""
    if isinstance(cell, float):
        return f"{cell:.0f}" if abs(cell) >= 100 else f"{cell:.3g}"
    return str(cell)
