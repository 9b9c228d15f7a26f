"""Row of an error study: cost and error of a number of samples."""

from __future__ import annotations

import math

from plenoptic.core.values import finite, not_negative, number, set_field, value, whole
from plenoptic.errors import InvalidValueError

_SIGNIFICANT = 3.0
"""Standard errors from which on a bias counts as found."""


@value
class ErrorRow:
    """Cost and error of one variant with one number of samples. Errors are relative root mean squares.

    Parameters
    ----------
    variant : str
    samples : int
        Paths per pixel.
    cpu_seconds, wall_seconds : float
        For the region, setting up included: medians.
    setup_cpu_seconds, setup_wall_seconds : float
        For a call that renders one path: medians.
    variance, variance_error : float
        Squared relative error among seeds, and its standard error.
    bias_squared, bias_squared_error : float
        Squared relative error that no number of samples takes away, as measured, which noise can make negative.
    reported_variance : float, optional
        Variance by the renders' own standard errors; None with one replicate.

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
    cpu_seconds: float
    wall_seconds: float
    setup_cpu_seconds: float
    setup_wall_seconds: float
    variance: float
    variance_error: float
    bias_squared: float
    bias_squared_error: float
    reported_variance: float | None = None

    def __post_init__(self) -> None:
        set_field(self, "samples", whole(self.samples, "samples", at_least=1))
        for name in ("cpu_seconds", "wall_seconds", "setup_cpu_seconds", "setup_wall_seconds", "variance"):
            set_field(self, name, not_negative(getattr(self, name), name))
        set_field(self, "bias_squared", finite(self.bias_squared, "bias_squared"))
        for name in ("variance_error", "bias_squared_error"):
            error = number(getattr(self, name), name)
            if not error >= 0:
                raise InvalidValueError(f"{name} is {error:g}; it must be at least 0")
            set_field(self, name, error)
        if self.reported_variance is not None:
            set_field(self, "reported_variance", not_negative(self.reported_variance, "reported_variance"))

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
        """The part of the error that all seeds share, as measured; 0 where its square came out negative."""
        return math.sqrt(max(self.bias_squared, 0.0))

    @property
    def bias_is_found(self) -> bool:
        """True if the squared bias is more than three of its standard errors above 0."""
        return self.bias_squared > _SIGNIFICANT * self.bias_squared_error

    @property
    def bias_error(self) -> float:
        """Standard error of `bias`, where one is found; nan where none is."""
        return 0.5 * self.bias_squared_error / self.bias if self.bias_is_found else math.nan

    @property
    def bias_limit(self) -> float:
        """The bias is below this with 97.7 % confidence: two standard errors."""
        return math.sqrt(max(self.bias_squared, 0.0) + 2.0 * self.bias_squared_error)

    @property
    def true_over_reported(self) -> float | None:
        """Noise as seen among seeds over noise as reported by standard errors; None without these."""
        if not self.reported_variance:
            return None
        return math.sqrt(self.variance / self.reported_variance)
