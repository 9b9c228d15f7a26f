"""The table of an error study: rows, and what follows from them."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

from plenoptic.core.values import finite, set_field, value, whole
from plenoptic.errors import InvalidValueError
from plenoptic.rendering.schedule.budget import checked_target
from plenoptic.study.error_time.recommendation import Recommendation, recommended
from plenoptic.study.error_time.rows import ErrorRow
from plenoptic.study.error_time.text import csv_of, markdown_of, slopes_markdown, table_in

if TYPE_CHECKING:
    from matplotlib.axes import Axes


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

    Examples
    --------
    >>> from plenoptic.study import ErrorRow, ErrorTable
    >>> def row(n):
    ...     return ErrorRow("THIN lens", n, cpu_seconds=0.001 * n, wall_seconds=0.001 * n, setup_cpu_seconds=0.0,
    ...         setup_wall_seconds=0.0, variance=0.01 / n, variance_error=1e-3 / n, bias_squared=1e-4,
    ...         bias_squared_error=1e-6, reported_variance=0.01 / n)
    >>> table = ErrorTable("an example", [row(16), row(64)], pixels=4096, lit_pixels=4000, seeds=8, threads=1,
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

    def __post_init__(self) -> None:
        rows = tuple(self.rows)
        if not rows or not all(isinstance(row, ErrorRow) for row in rows):
            raise InvalidValueError(f"rows is {self.rows!r}; it must be one ErrorRow or more")
        places = [(row.variant, row.samples) for row in rows]
        if len(set(places)) < len(places):
            raise InvalidValueError("two rows have the same variant and number of samples; each may have one")
        names = list(dict.fromkeys(row.variant for row in rows))
        set_field(self, "rows", tuple(sorted(rows, key=lambda row: (names.index(row.variant), row.samples))))
        for name in ("pixels", "lit_pixels", "seeds", "threads", "reference_samples"):
            set_field(self, name, whole(getattr(self, name), name, at_least=1))
        error = finite(self.reference_error, "reference_error")
        if error < 0:
            raise InvalidValueError(f"reference_error is {error:g}; it must be at least 0")
        set_field(self, "reference_error", error)

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
        """The error that no number of samples gets below; 0 where none can be told from 0.

        It is that of the row which knows it best.
        """
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

        Examples
        --------
        See `ErrorTable`.
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
        fits = [
            (name, self.slope(name), self.slope_error(name), self.best_known_bias(name), len(self.of(name)))
            for name in self.variants
        ]
        return markdown_of(self.rows, self.pixels, self.pareto()) + "\n\n" + slopes_markdown(fits, self.pixels)

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
        facts, rows = table_in(path, title)
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
            f"samples, errors of {100 * max(errors):.3g} % to {100 * min(errors):.3g} %>"
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
    x = [math.log(row.samples) for row in points]
    y = [0.5 * math.log(row.variance) for row in points]
    weights = [(2.0 * row.variance / row.variance_error) ** 2 for row in points]
    middle = sum(w * a for w, a in zip(weights, x, strict=True)) / sum(weights)
    width = sum(w * (a - middle) ** 2 for w, a in zip(weights, x, strict=True))
    slope = sum(w * (a - middle) * b for w, a, b in zip(weights, x, y, strict=True)) / width
    return slope, 1.0 / math.sqrt(width)
