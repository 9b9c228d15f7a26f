"""The table of an error study: rows, slopes, bias floors and the Pareto front."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from plenoptic.core.display import draw
from plenoptic.core.values import set_field, value
from plenoptic.errors import InvalidValueError
from plenoptic.rendering.schedule.budget import checked_target
from plenoptic.study.error_time.recommendation import Recommendation, cheapest_setting
from plenoptic.study.study_table import INTERRUPTED, Cell, csv_text, markdown_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_SIGNIFICANT = 3.0
"""Standard errors by which a squared bias must exceed 0 to be significant."""


class ErrorRow(NamedTuple):
    """Time and error of one variant with one number of samples. Errors are relative root mean squares.

    Examples
    --------
    >>> import plenoptic as pl
    >>> row = pl.study.ErrorRow("THIN lens", 64, cpu_seconds=0.03, wall_seconds=0.03, setup_cpu_seconds=0.001,
    ...     setup_wall_seconds=0.001, variance=9e-4, variance_error=2e-5, bias_squared=16e-4, bias_squared_error=1e-5)
    >>> round(row.error, 6), row.noise, row.bias, row.bias_is_found
    (0.05, 0.03, 0.04, True)
    """

    variant: str
    samples: int
    """Paths per pixel."""
    cpu_seconds: float
    """For the region, setting up included: median."""
    wall_seconds: float
    setup_cpu_seconds: float
    """For a call that renders one path: median."""
    setup_wall_seconds: float
    variance: float
    """Squared relative error among seeds."""
    variance_error: float
    """Standard error of `variance`; infinite for a single pixel."""
    bias_squared: float
    """Squared relative error that all seeds share, as measured, which noise can make negative."""
    bias_squared_error: float
    """Standard error of `bias_squared`; infinite for a single pixel."""
    reported_variance: float | None = None
    """From the standard errors of the renders; None with one replicate."""

    @property
    def error(self) -> float:
        """Error of one image: the root of variance plus squared bias, as measured."""
        return math.sqrt(max(self.variance + self.bias_squared, 0.0))

    @property
    def noise(self) -> float:
        """The part of the error that differs from seed to seed."""
        return math.sqrt(self.variance)

    @property
    def bias(self) -> float:
        """The part of the error that all seeds share, as measured; 0 if its square is negative."""
        return math.sqrt(max(self.bias_squared, 0.0))

    @property
    def bias_is_found(self) -> bool:
        """True if the squared bias is more than three of its standard errors above 0."""
        return self.bias_squared > _SIGNIFICANT * self.bias_squared_error

    @property
    def bias_error(self) -> float:
        """Standard error of `bias`; nan unless `bias_is_found`."""
        return 0.5 * self.bias_squared_error / self.bias if self.bias_is_found else math.nan

    @property
    def bias_limit(self) -> float:
        """Upper limit of the bias with 97.7 % confidence: two standard errors."""
        return math.sqrt(max(self.bias_squared, 0.0) + 2.0 * self.bias_squared_error)

    @property
    def true_over_reported(self) -> float | None:
        """Noise among seeds over the noise that standard errors report; None without standard errors."""
        return math.sqrt(self.variance / self.reported_variance) if self.reported_variance else None


@value
class ErrorTable:
    """Error against time, for variants of a render; made by `error_against_time`.

    Parameters
    ----------
    title : str
        Subject of the renders.
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
        True if further rows were asked for.

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
        if len({(row.variant, row.samples) for row in rows}) < len(rows):
            raise InvalidValueError("two rows have the same variant and number of samples; each may have one")
        names = list(dict.fromkeys(row.variant for row in rows))
        set_field(self, "rows", tuple(sorted(rows, key=lambda row: (names.index(row.variant), row.samples))))

    @property
    def variants(self) -> tuple[str, ...]:
        """Names of the variants."""
        return tuple(dict.fromkeys(row.variant for row in self.rows))

    def of(self, variant: str) -> tuple[ErrorRow, ...]:
        """Rows of a variant, by their number of samples."""
        rows = tuple(row for row in self.rows if row.variant == variant)
        if not rows:
            raise InvalidValueError(f"variant is {variant!r}; it must be one of {', '.join(map(repr, self.variants))}")
        return rows

    def slope(self, variant: str) -> float:
        """Slope of the logarithm of the noise against that of the number of samples: -0.5 for independent samples.

        Fitted by least squares, each row weighed by its standard error; nan with a single row.
        """
        return _fit_slope(self.of(variant))[0]

    def slope_error(self, variant: str) -> float:
        """Standard error of `slope`, from those of the variances; nan with a single row."""
        return _fit_slope(self.of(variant))[1]

    def bias_floor(self, variant: str) -> float:
        """Error that no number of samples gets below, by the `best_known_bias`; 0 if that is not significant."""
        row = self.best_known_bias(variant)
        return row.bias if row.bias_is_found else 0.0

    def best_known_bias(self, variant: str) -> ErrorRow:
        """The row whose squared bias has the smallest standard error."""
        return min(self.of(variant), key=lambda row: row.bias_squared_error)

    def pareto(self) -> tuple[ErrorRow, ...]:
        """Rows that no other beats in CPU time and error, from the fastest to the most exact."""
        front: list[ErrorRow] = []
        for row in sorted(self.rows, key=lambda row: (row.cpu_seconds, row.error)):
            if not front or row.error < front[-1].error:
                front.append(row)
        return tuple(front)

    def recommend(self, target_error: float) -> Recommendation:
        """The setting with the least CPU time for an error.

        Between and beyond the rows of a variant the variance is taken to be a power of the number of samples, and the
        time to grow linearly with it; a significant bias is part of the error. Beyond the rows that power is one
        standard error smaller than the fitted one.

        Parameters
        ----------
        target_error : float
            Relative root mean square over lit pixels, such as 0.01.

        Returns
        -------
        Recommendation

        Raises
        ------
        InvalidValueError
            If no variant reaches the error, with the reason for each.
        """
        return cheapest_setting(self, checked_target(target_error))

    def to_markdown(self) -> str:
        """All rows in Markdown, and below them a table of slope and bias of each variant."""
        front = self.pareto()
        rows = markdown_table([_cells(row, self.pixels, row in front) for row in self.rows])
        slopes = markdown_table([self._slope_cells(name) for name in self.variants])
        return "\n\n".join([rows, slopes, *[INTERRUPTED] * self.interrupted])

    def _slope_cells(self, variant: str) -> tuple[Cell, ...]:
        row = self.best_known_bias(variant)
        slope = f"{self.slope(variant):.3f} ± {self.slope_error(variant):.3f}" if len(self.of(variant)) > 1 else ""
        per_sample = max(row.cpu_seconds - row.setup_cpu_seconds, 0.0) / (self.pixels * row.samples)
        return (
            ("variant", variant),
            ("slope of the noise", slope),
            ("bias floor %", _bias_text(row)),
            ("setting up: CPU ms", f"{1e3 * row.setup_cpu_seconds:.3g}"),
            ("CPU ns per pixel and sample", f"{1e9 * per_sample:.3g}"),
        )

    def to_csv(self, path: str | os.PathLike[str] | None = None) -> str:
        """All rows as comma-separated values; also written to a file if `path` is given."""
        return csv_of([self], path)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Error against CPU time, see `plot_error_against_time`."""
        axes: Axes = draw(self, ax)
        return axes

    def __repr__(self) -> str:
        samples, errors = [row.samples for row in self.rows], [row.error for row in self.rows]
        count = len(self.variants)
        return (
            f"<ErrorTable {self.title!r}: {count} variant{'s' * (count != 1)}, {min(samples)} to {max(samples)} "
            f"samples, errors of {100 * max(errors):.3g} % to {100 * min(errors):.3g} %"
            f"{', interrupted' * self.interrupted}>"
        )

    _repr_markdown_ = to_markdown

    def __str__(self) -> str:
        return (
            f"{self.title}: {self.pixels} pixels, {self.lit_pixels} of them lit, {self.seeds} seeds, {self.threads} "
            f"thread{'s' * (self.threads != 1)}; the reference of {self.reference_samples} samples has an error of "
            f"{100 * self.reference_error:.2g} %\n\n{self.to_markdown()}"
        )


def csv_of(tables: Sequence[ErrorTable], path: str | os.PathLike[str] | None) -> str:
    """Tables as comma-separated values, each line with the facts of its table; also written if `path` is given."""
    lines: list[dict[str, Any]] = []
    for table in tables:
        facts = {name: fact for name, fact in vars(table).items() if name != "rows"}
        lines += [facts | row._asdict() for row in table.rows]
    return csv_text(lines, path)


def _fit_slope(rows: Sequence[ErrorRow]) -> tuple[float, float]:
    """Slope of log noise against log samples, and its standard error, by weighted least squares."""
    points = [row for row in rows if row.variance > 0 and 0 < row.variance_error < math.inf]
    if len(points) < 2:
        return math.nan, math.nan
    samples, variance, error = np.array([(row.samples, row.variance, row.variance_error) for row in points]).T
    line, covariance = np.polyfit(np.log(samples), 0.5 * np.log(variance), 1, w=2.0 * variance / error, cov="unscaled")
    return float(line[0]), math.sqrt(covariance[0, 0])


def _cells(row: ErrorRow, pixels: int, in_front: bool) -> tuple[Cell, ...]:
    ratio = row.true_over_reported
    rendering = max(row.cpu_seconds - row.setup_cpu_seconds, 0.0)
    return (
        ("variant", row.variant),
        ("samples", str(row.samples)),
        ("CPU s", f"{row.cpu_seconds:.3g}"),
        ("wall s", f"{row.wall_seconds:.3g}"),
        ("CPU us per pixel", f"{1e6 * row.cpu_seconds / pixels:.3g}"),
        ("without setting up", f"{1e6 * rendering / pixels:.3g}"),
        ("error %", f"{100 * row.error:.3g}"),
        ("noise %", f"{100 * row.noise:.3g}"),
        ("bias %", _bias_text(row)),
        ("true / reported", "" if ratio is None else f"{ratio:.2f}"),
        ("front", "*" if in_front else ""),
    )


def _bias_text(row: ErrorRow) -> str:
    """The bias in per cent with its standard error, or its upper limit."""
    if row.bias_is_found:
        digits = max(0, -math.floor(math.log10(100 * row.bias_error))) if row.bias_error > 0 else 3
        return f"{100 * row.bias:.{digits}f} ± {100 * row.bias_error:.{digits}f}"
    return f"< {100 * row.bias_limit:.2g}"
