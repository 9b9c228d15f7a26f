"""One row of an error study: time and error of a variant with a number of samples."""

from __future__ import annotations

import math
from typing import NamedTuple

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
