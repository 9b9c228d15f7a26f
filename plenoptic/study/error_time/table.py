"""The table of an error study: rows, what follows from them, and both as text."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
import os
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from plenoptic.core.files.file_limits import read_file
from plenoptic.core.values import file_path, not_negative, set_field, value, whole
from plenoptic.errors import FileError, InvalidValueError
from plenoptic.rendering.schedule.budget import checked_target
from plenoptic.study.error_time.recommendation import Recommendation, recommended
from plenoptic.study.error_time.rows import ErrorRow
from plenoptic.study.interruption import with_note
from plenoptic.study.text_table import comma_separated, markdown_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_COUNTS = ("pixels", "lit_pixels", "seeds", "threads", "reference_samples")

_FACTS: dict[str, Callable[[str], Any]] = {
    **{"title": str, **dict.fromkeys(_COUNTS, int)},
    **{"reference_error": float, "interrupted": "True".__eq__},
}
"""What a table knows beside its rows; repeated in every line of a file."""

_ROW = tuple(field.name for field in dataclasses.fields(ErrorRow))  # type: ignore[arg-type]

_COLUMNS = (
    *("variant", "samples", "CPU s", "wall s", "CPU us per pixel", "without setting up"),
    *("error %", "noise %", "bias %", "true / reported", "front"),
)
_SLOPES = ("variant", "slope of the noise", "bias floor %", "setting up: CPU ms", "CPU ns per pixel and sample")


@value
class ErrorTable:
    """Error against time, for variants of a render; made by `error_against_time`.

    Parameters
    ----------
    title : str
        What was rendered.
    rows : sequence of ErrorRow
    pixels, lit_pixels : int
        Of the region; errors are means over the lit ones.
    seeds : int
        Renders of each row.
    threads : int
    reference_samples : int
        Paths per pixel of the reference.
    reference_error : float
        The relative error of the reference itself, which is subtracted.
    interrupted : bool
        Whether further rows were asked for.

    Examples
    --------
    >>> import plenoptic as pl
    >>> def row(n):
    ...     return pl.study.ErrorRow("THIN lens", n, cpu_seconds=0.001 * n, wall_seconds=0.001 * n,
    ...         setup_cpu_seconds=0.0, setup_wall_seconds=0.0, variance=0.01 / n, variance_error=1e-3 / n,
    ...         bias_squared=1e-4, bias_squared_error=1e-6, reported_variance=0.01 / n)
    >>> table = pl.study.ErrorTable("an example", [row(16), row(64)], pixels=4096, lit_pixels=4000, seeds=8, threads=1,
    ...     reference_samples=4096, reference_error=0.001)
    >>> table
    <ErrorTable 'an example': 1 variant, 16 to 64 samples, errors of 2.69 % to 1.6 %>
    >>> round(table.slope("THIN lens"), 3), round(table.bias_floor("THIN lens"), 6)
    (-0.5, 0.01)
    >>> print(table.recommend(0.02))
    THIN lens with 40 samples: error 1.87 % (bias 1 %), 0.04 CPU-s, 0.04 s of wall time
    - for 4096 pixels and 1 thread
    """

    title: str
    rows: Sequence[ErrorRow]
    pixels: int
    lit_pixels: int
    seeds: int
    threads: int
    reference_samples: int
    reference_error: float
    interrupted: bool = False

    def __post_init__(self) -> None:
        rows = tuple(self.rows)
        if not rows or not all(isinstance(row, ErrorRow) for row in rows):
            raise InvalidValueError(f"rows is {self.rows!r}; it must be one ErrorRow or more")
        places = [(row.variant, row.samples) for row in rows]
        if len(set(places)) < len(places):
            raise InvalidValueError("two rows have the same variant and number of samples; each may have one")
        names = list(dict.fromkeys(row.variant for row in rows))
        set_field(self, "rows", tuple(sorted(rows, key=lambda row: (names.index(row.variant), row.samples))))
        for name in _COUNTS:
            set_field(self, name, whole(getattr(self, name), name, at_least=1))
        set_field(self, "reference_error", not_negative(self.reference_error, "reference_error"))

    @property
    def variants(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(dict.fromkeys(row.variant for row in self.rows))

    def of(self, variant: str) -> tuple[ErrorRow, ...]:
        """The rows of a variant, by their number of samples."""
        found = tuple(row for row in self.rows if row.variant == variant)
        if not found:
            raise InvalidValueError(f"variant is {variant!r}; it must be one of {', '.join(map(repr, self.variants))}")
        return found

    def slope(self, variant: str) -> float:
        """Slope of the logarithm of the noise against that of the number of samples: -0.5 for independent samples.

        Fitted by least squares, each row weighed by its standard error; nan with a single row.
        """
        return _fitted(self.of(variant))[0]

    def slope_error(self, variant: str) -> float:
        """Standard error of `slope`, from those of the variances; nan with a single row."""
        return _fitted(self.of(variant))[1]

    def bias_floor(self, variant: str) -> float:
        """The error that no number of samples gets below, by the row that knows it best; 0 where none is found."""
        row = self.best_known_bias(variant)
        return row.bias if row.bias_is_found else 0.0

    def best_known_bias(self, variant: str) -> ErrorRow:
        """The row whose squared bias has the smallest standard error."""
        return min(self.of(variant), key=lambda row: row.bias_squared_error)

    def pareto(self) -> tuple[ErrorRow, ...]:
        """The rows of which no other is both as fast and as good, from the fastest to the best; by CPU time."""
        front: list[ErrorRow] = []
        for row in sorted(self.rows, key=lambda row: (row.cpu_seconds, row.error)):
            if not front or row.error < front[-1].error:
                front.append(row)
        return tuple(front)

    def recommend(self, target_error: float) -> Recommendation:
        """The cheapest setting for an error, by CPU time.

        Between and beyond the rows of a variant the variance is taken to be a power of the number of samples, and the
        time to grow evenly with it; a bias counts where it is found. Beyond the rows that power is one standard error
        smaller than the fitted one.

        Parameters
        ----------
        target_error : float
            Relative root mean square over lit pixels, such as 0.01.

        Returns
        -------
        Recommendation
            `print` says it in words.

        Raises
        ------
        InvalidValueError
            If no variant gets there, saying why for each.
        """
        target = checked_target(target_error)
        # One standard error flatter than fitted: extrapolation is to promise too little rather than too much.
        fits = {
            name: (self.of(name), self.slope(name) + self.slope_error(name), self.bias_floor(name))
            for name in self.variants
        }
        found = recommended(fits, target)
        facts = [f"for {self.pixels} pixels and {self.threads} thread{'s' * (self.threads != 1)}"]
        if self.reference_error > target:
            facts.append(
                f"the reference's own error, {100 * self.reference_error:.2g} %, is above {100 * target:.3g} %; study "
                "with more reference_samples"
            )
        return dataclasses.replace(found, remarks=(*facts, *found.remarks))

    def to_markdown(self) -> str:
        """All rows in Markdown, and one table with slope and bias of each variant below it."""
        front = self.pareto()
        rows = markdown_table(_COLUMNS, [_cells(row, self.pixels, row in front) for row in self.rows])
        slopes = markdown_table(_SLOPES, [self._slope_cells(name) for name in self.variants])
        return with_note(f"{rows}\n\n{slopes}", interrupted=self.interrupted)

    def _slope_cells(self, variant: str) -> tuple[str, ...]:
        known = self.best_known_bias(variant)
        each = max(known.cpu_seconds - known.setup_cpu_seconds, 0.0) / (self.pixels * known.samples)
        several = len(self.of(variant)) > 1
        return (
            variant,
            f"{self.slope(variant):.3f} ± {self.slope_error(variant):.3f}" if several else "",
            _bias_text(known),
            f"{1e3 * known.setup_cpu_seconds:.3g}",
            f"{1e9 * each:.3g}",
        )

    def to_csv(self, path: str | os.PathLike[str] | None = None) -> str:
        """All rows as comma-separated values, in a file too where `path` is given; `from_csv` reads it."""
        return csv_of([self], path)

    @classmethod
    def from_csv(cls, path: str | os.PathLike[str], *, title: str | None = None) -> ErrorTable:
        """Read a table that `to_csv` wrote.

        Parameters
        ----------
        path : path-like
        title : str, optional
            Which of several tables in the file; None: the only one.

        Returns
        -------
        ErrorTable

        Raises
        ------
        FileError
            If it is missing or holds no such table.
        """
        facts, rows = _table_in(path, title)
        return cls(rows=[ErrorRow(**row) for row in rows], **facts)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Error against CPU time, see `plot_error_against_time`."""
        from plenoptic.plots.error_time import plot_error_against_time

        return plot_error_against_time(self, ax)

    def __repr__(self) -> str:
        samples, errors = [row.samples for row in self.rows], [row.error for row in self.rows]
        count = len(self.variants)
        return (
            f"<ErrorTable {self.title!r}: {count} variant{'s' * (count != 1)}, {min(samples)} to {max(samples)} "
            f"samples, errors of {100 * max(errors):.3g} % to {100 * min(errors):.3g} %"
            f"{', interrupted' * self.interrupted}>"
        )

    def _repr_markdown_(self) -> str:
        return self.to_markdown()

    def __str__(self) -> str:
        return (
            f"{self.title}: {self.pixels} pixels, {self.lit_pixels} of them lit, {self.seeds} seeds, {self.threads} "
            f"thread{'s' * (self.threads != 1)}; the reference of {self.reference_samples} samples has an error of "
            f"{100 * self.reference_error:.2g} %\n\n{self.to_markdown()}"
        )


def _fitted(rows: Sequence[ErrorRow]) -> tuple[float, float]:
    """Slope of log noise against log samples, and its standard error, by weighted least squares."""
    points = [row for row in rows if row.variance > 0 and 0 < row.variance_error < math.inf]
    if len(points) < 2:
        return math.nan, math.nan
    samples, variance, error = np.array([(row.samples, row.variance, row.variance_error) for row in points]).T
    line, covariance = np.polyfit(np.log(samples), 0.5 * np.log(variance), 1, w=2.0 * variance / error, cov="unscaled")
    return float(line[0]), math.sqrt(covariance[0, 0])


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
        _bias_text(row),
        "" if ratio is None else f"{ratio:.2f}",
        "*" if in_front else "",
    )


def _bias_text(row: ErrorRow) -> str:
    """The bias in per cent with its standard error, or what it is below."""
    if row.bias_is_found:
        digits = max(0, -math.floor(math.log10(100 * row.bias_error))) if row.bias_error > 0 else 3
        return f"{100 * row.bias:.{digits}f} ± {100 * row.bias_error:.{digits}f}"
    return f"< {100 * row.bias_limit:.2g}"


def csv_of(tables: Sequence[ErrorTable], path: str | os.PathLike[str] | None) -> str:
    """Tables as one text of comma-separated values, which is also written where there is a path."""
    rows: list[Sequence[object]] = [[*_FACTS, *_ROW]]
    for table in tables:
        facts = [getattr(table, name) for name in _FACTS]
        rows += [[*facts, *(getattr(row, name) for name in _ROW)] for row in table.rows]
    return comma_separated(rows, path)


def _table_in(path: str | os.PathLike[str], title: str | None) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Facts and rows of one table of a file of comma-separated values."""
    place = file_path(path)
    name = str(place)
    try:
        lines = list(csv.DictReader(io.StringIO(read_file(place).decode())))
    except (UnicodeDecodeError, csv.Error) as error:
        raise FileError(f"{name!r} cannot be read: {error}") from error
    titles = list(dict.fromkeys(line.get("title") for line in lines))
    if title is None and len(titles) == 1:
        title = titles[0]
    if title is None or title not in titles:
        raise FileError(f"{name!r} has the tables {titles}, and title is {title!r}; it must be one of them")
    chosen = [line for line in lines if line["title"] == title]
    try:
        return {key: kind(chosen[0].get(key, "")) for key, kind in _FACTS.items()}, [_row_in(line) for line in chosen]
    except (KeyError, TypeError, ValueError) as error:
        raise FileError(f"{name!r} is no table of an error study: {error!r}") from error


def _row_in(line: dict[str, str]) -> dict[str, Any]:
    row: dict[str, Any] = {"variant": line["variant"], "samples": int(line["samples"])}
    for name in _ROW[2:]:
        row[name] = float(line[name]) if line[name] or name != "reported_variance" else None
    return row
