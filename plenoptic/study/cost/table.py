"""Table of the costs of a render's parts."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence

from plenoptic.core.values import set_field, value
from plenoptic.rendering.plan.stages import Stage
from plenoptic.study.text_table import comma_separated, markdown_table, plain_table

_COLUMNS = ("stage", "without it", "s with", "s without", "% of CPU", "+-", "set-up s", "picture %", "stops too")
_CSV = (
    *("stage", "instead", "cpu_s_per_million_paths_with", "cpu_s_per_million_paths_without"),
    *("percent_of_cpu", "standard_error", "set_up_s", "picture_change_percent", "stops_too", "kept_because"),
)

NOT_MEASURED = "the study was interrupted before"


def _number(number: float, form: str) -> str:
    return "" if math.isnan(number) else format(number, form)


@value
class CostRow:
    """Cost of one stage.

    Parameters
    ----------
    stage : Stage
    instead : str
        Substitute for it when it is left out.
    with_it, without_it : float
        CPU seconds per million paths beyond set-up, medians over the rounds.
    percent : float
        Share of the whole that the stage takes: the median over the rounds. Negative where all is dearer without it;
        nan, as the two above may be, where renders took no longer than set-up.
    standard_error : float or None
        Of that share; None with fewer than 3 rounds.
    set_up : float
        CPU seconds of set-up that it takes, whatever the number of paths.
    picture_change : float or None
        Root mean square of how the picture differs without the stage, over its mean, in per cent and beyond noise; 0
        where noise hides it. None where the picture is black.
    also : sequence of Stage
        Stages that do not run either without this one: their costs are in it.

    Examples
    --------
    See `CostTable`.
    """

    stage: Stage
    instead: str
    with_it: float
    without_it: float
    percent: float
    standard_error: float | None
    set_up: float
    picture_change: float | None
    also: Sequence[Stage] = ()

    def __post_init__(self) -> None:
        set_field(self, "also", tuple(self.also))

    @property
    def cells(self) -> tuple[str, ...]:
        """Cells of the table."""
        return (
            _text(self.stage),
            self.instead,
            _number(self.with_it, ".3g"),
            _number(self.without_it, ".3g"),
            _number(self.percent, ".1f"),
            "" if self.standard_error is None else f"{self.standard_error:.1f}",
            f"{round(self.set_up, 3) + 0.0:.3f}",
            "" if self.picture_change is None else f"{float(f'{self.picture_change:.2g}'):g}",
            ", ".join(map(_text, self.also)),
        )


@value
class CostTable:
    """Costs of the parts of a render, dearest first; made by `cost_of`, shown by `print`.

    Parameters
    ----------
    rows : sequence of CostRow
    kept : sequence of (Stage, str)
        Stages that run and cannot be left out alone, and why.
    cpu_per_million : float
        CPU seconds per million paths of all of it beyond set-up, the median.
    set_up : float
        CPU seconds of all of its set-up.
    samples, rounds, threads : int
    pixels : (int, int)
        Rows and columns that were rendered.

    Examples
    --------
    >>> import plenoptic as pl
    >>> stage = pl.rendering.Stage.POSE
    >>> row = pl.study.CostRow(stage, "the scene in the camera's frame", 2.0, 1.96, 2.0, 0.3, 0.001, 0.0)
    >>> table = pl.study.CostTable([row], [], 2.0, 0.1, samples=16, rounds=5, pixels=(128, 128), threads=1)
    >>> table
    <CostTable: 1 stage left out one at a time, 2 CPU s per million paths with all of them>
    >>> print(table.to_markdown().splitlines()[2])
    | pose  | the scene in the camera's frame | 2      | 1.96      | 2.0      | 0.3 | 0.001    | 0         |           |
    """

    rows: Sequence[CostRow]
    kept: Sequence[tuple[Stage, str]]
    cpu_per_million: float
    set_up: float
    samples: int
    rounds: int
    pixels: tuple[int, int]
    threads: int

    def __post_init__(self) -> None:
        set_field(self, "rows", tuple(self.rows))
        set_field(self, "kept", tuple((stage, reason) for stage, reason in self.kept))

    @property
    def interrupted(self) -> bool:
        """True if Ctrl-C came before all stages were measured."""
        return any(reason == NOT_MEASURED for _, reason in self.kept)

    def row(self, stage: Stage) -> CostRow:
        """The row of a stage, or a KeyError where there is none."""
        return {row.stage: row for row in self.rows}[stage]

    @property
    def dearest(self) -> tuple[CostRow, ...]:
        """Rows in the order of their costs, the largest first."""
        return tuple(sorted(self.rows, key=lambda row: -row.percent if math.isfinite(row.percent) else math.inf))

    def to_markdown(self) -> str:
        """The table in Markdown, with the parts that cannot be left out below."""
        table = markdown_table(_COLUMNS, [row.cells for row in self.dearest])
        return "\n\n".join([table, *self._remarks()])

    def to_csv(self, path: str | os.PathLike[str] | None = None) -> str:
        """All rows and the parts that cannot be left out as comma-separated values, in a file too where `path` is
        given.
        """
        rows: list[Sequence[object]] = [_CSV]
        for row in self.rows:
            found = (row.with_it, row.without_it, row.percent, row.standard_error, row.set_up, row.picture_change)
            numbers = [None if number is None or math.isnan(number) else number for number in found]
            also = " ".join(stage.name for stage in row.also)
            rows.append((row.stage.name, row.instead, *numbers, also, ""))
        rows += [(stage.name, *[""] * 8, reason) for stage, reason in self.kept]
        return comma_separated(rows, path)

    def _repr_markdown_(self) -> str:
        return self.to_markdown()

    def __str__(self) -> str:
        return "\n".join([plain_table(_COLUMNS, [row.cells for row in self.dearest]), *self._remarks()])

    def __repr__(self) -> str:
        count = f"{len(self.rows)} stage{'s' * (len(self.rows) != 1)}"
        return (
            f"<CostTable: {count} left out one at a time, "
            f"{self.cpu_per_million:.3g} CPU s per million paths with all of them>"
        )

    def _remarks(self) -> list[str]:
        rows, columns = self.pixels
        threads = f"{self.threads} thread{'s' * (self.threads != 1)}"
        how = (
            f"{rows} x {columns} pixels, {self.samples} samples, {threads}, {self.rounds} rounds; s are CPU seconds "
            f"per million paths, {self.cpu_per_million:.3g} for all of it, beside {self.set_up:.2g} s of set-up."
        )
        if any(math.isnan(row.percent) for row in self.rows):
            how += " Empty: renders took no longer than set-up, too short to tell; take more samples or pixels."
        if any(row.percent < 0 for row in self.rows):
            how += " Negative: without it paths do more. Shares overlap and do not add up."
        kept = [f"Not left out: {_text(stage)}: {reason}." for stage, reason in self.kept]
        return [how, *kept]


def _text(stage: Stage) -> str:
    return stage.name.lower().replace("_", " ")
