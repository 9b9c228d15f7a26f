"""The setting that reaches an error in the least time: interpolation between the rows of an error study."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from plenoptic.errors import InvalidValueError

if TYPE_CHECKING:
    from plenoptic.study.error_time.error_table import ErrorRow, ErrorTable

_GOOD_SAMPLES = (1, 2, 3, *(m << k for k in range(28) for m in (4, 5, 6, 7)), 1 << 30)
"""Numbers of samples to recommend: 4 to 7 times a power of 2, which scrambled points use well."""

_ROUNDING = 1e-12
"""Relative rounding error of an interpolated variance."""

_FAR = 8.0
"""Recommendations for more than this times the samples measured are called uncertain."""

_FLAT = -0.05
"""Slopes above this are no fall: independent samples have -0.5."""


class Recommendation(NamedTuple):
    """The cheapest setting for an error; made by `ErrorTable.recommend`.

    Examples
    --------
    See `ErrorTable`.
    """

    target_error: float
    variant: str
    samples: int
    """Paths per pixel; between the rows, 4 to 7 times a power of 2, which scrambled points use well."""
    cpu_seconds: float
    """Expected for the region of the study, setting up included, with its number of threads."""
    wall_seconds: float
    error: float
    """Expected, bias included."""
    bias: float
    extrapolated: bool
    """True if it needs more samples than were measured."""
    remarks: tuple[str, ...] = ()
    """How far it extrapolates, and the variants that do not reach the error."""

    def __str__(self) -> str:
        bias = f" (bias {100 * self.bias:.3g} %)" if self.bias else ""
        first = (
            f"{self.variant} with {self.samples} samples: error {100 * self.error:.3g} %{bias}, "
            f"{self.cpu_seconds:.3g} CPU-s, {self.wall_seconds:.3g} s of wall time"
        )
        return "\n".join([first, *(f"- {remark}" for remark in self.remarks)])


class _Fit(NamedTuple):
    """Rows of a variant by their number of samples, the slope of its noise, its bias floor."""

    name: str
    rows: Sequence[ErrorRow]
    slope: float
    floor: float


def cheapest_setting(table: ErrorTable, target: float) -> Recommendation:
    """The setting with the least CPU time for an error; see `ErrorTable.recommend`."""
    settings, refusals = [], []
    for name in table.variants:
        # One standard error flatter than fitted, so that extrapolation promises too little rather than too much.
        slope = table.slope(name) + table.slope_error(name)
        fit = _Fit(name, table.of(name), slope, table.bias_floor(name))
        samples = _samples_for(fit, target)
        if isinstance(samples, str):
            refusals.append(samples)
        else:
            settings.append(_expected_setting(fit, target, samples))
    if not settings:
        raise InvalidValueError(
            f"target_error is {100 * target:.3g} %, which no variant reaches; {'; '.join(refusals)}. "
            "Raise the target, or study a variant without that bias"
        )
    settings.sort(key=lambda setting: setting.cpu_seconds)
    best = settings[0]
    remarks = [f"for {table.pixels} pixels and {table.threads} thread{'s' * (table.threads != 1)}"]
    if table.reference_error > target:
        remarks.append(
            f"the reference's own error, {100 * table.reference_error:.2g} %, is above {100 * target:.3g} %; study "
            "with more reference_samples"
        )
    remarks += best.remarks
    reporting = [setting for setting in settings if table.of(setting.variant)[0].reported_variance is not None]
    if best not in reporting:
        remarks.append(f"{best.variant} reports no standard errors")
        for second in reporting[:1]:
            remarks[-1] += f"; {second.variant} does, with {second.samples} samples in {second.cpu_seconds:.3g} CPU-s"
    return best._replace(remarks=(*remarks, *refusals))


def _samples_for(fit: _Fit, target: float) -> int | str:
    """Number of samples that a variant needs, or the reason why it does not reach the error."""
    name, rows, slope, floor = fit
    allowed = target**2 - floor**2
    if allowed <= 0:
        return f"{name} cannot: its bias of {100 * floor:.3g} % is above {100 * target:.3g} %"
    measured = {row.samples for row in rows}
    for n in sorted(measured | {n for n in _GOOD_SAMPLES if n > rows[0].samples}):
        if n > rows[-1].samples and not slope < _FLAT:
            return f"{name} cannot: its error was not seen to fall with the number of samples"
        if _variance_at(fit, n) <= allowed * (1.0 + _ROUNDING):
            return n
    return f"{name} would need more than {_GOOD_SAMPLES[-1]:.0e} samples"


def _expected_setting(fit: _Fit, target: float, samples: int) -> Recommendation:
    name, rows, _, floor = fit
    first, last = rows[0], rows[-1]
    remarks = []
    if samples > last.samples:
        far = ", so that it is uncertain" if samples > _FAR * last.samples else ""
        remarks.append(f"{name} is extrapolated from {last.samples} samples to {samples}{far}")
    elif samples == first.samples:
        remarks.append(f"{name} may need fewer: {samples} samples are the fewest that were measured")
    best_bias = min(rows, key=lambda row: row.bias_squared_error)
    if not best_bias.bias_is_found and best_bias.bias_limit > 0.5 * target:
        remarks.append(f"a bias of {name} below {100 * best_bias.bias_limit:.2g} % would not have been found")
    error = math.sqrt(_variance_at(fit, samples) + floor**2)
    cpu, wall = (_seconds_at(rows, samples, clock) for clock in ("cpu", "wall"))
    return Recommendation(target, name, samples, cpu, wall, error, floor, samples > last.samples, tuple(remarks))


def _variance_at(fit: _Fit, samples: int) -> float:
    """Variance with a number of samples: straight in logarithms between rows, and by the slope beyond them."""
    last = fit.rows[-1]
    if samples > last.samples:
        return float(last.variance * (samples / last.samples) ** (2.0 * fit.slope))
    with np.errstate(divide="ignore"):  # the noise may be 0
        counts, variances = np.log([(row.samples, row.variance) for row in fit.rows]).T
    return float(np.exp(np.interp(np.log(samples), counts, variances)))


def _seconds_at(rows: Sequence[ErrorRow], samples: int, clock: str) -> float:
    """Seconds for a number of samples: straight between rows, and by the time per sample beyond the last one."""
    counts, seconds = [row.samples for row in rows], [getattr(row, f"{clock}_seconds") for row in rows]
    per_sample = max(seconds[-1] - getattr(rows[-1], f"setup_{clock}_seconds"), 0.0) / counts[-1]
    return float(np.interp(samples, counts, seconds) + per_sample * max(samples - counts[-1], 0))
