"""Fastest setting for an error: interpolation between the rows of an error study."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from plenoptic.core.values import value
from plenoptic.errors import InvalidValueError
from plenoptic.study.error_time.rows import ErrorRow

_MOST_SAMPLES = 1 << 30
"""Paths per pixel beyond which nothing is promised."""

_FAR = 8.0
"""Recommendations for more than this times the samples measured are called uncertain."""

_FLAT = -0.05
"""Slopes above this are no fall: independent samples have -0.5."""

Fit = tuple[Sequence[ErrorRow], float, float]
"""Rows of a variant by their number of samples, the slope of its noise, its bias floor."""


@value
class Recommendation:
    """The cheapest setting for an error; made by `ErrorTable.recommend`.

    Attributes
    ----------
    target_error : float
        The requested error.
    variant : str
    samples : int
        Paths per pixel; between the rows, 4 to 7 times a power of 2, which scrambled points use well.
    cpu_seconds, wall_seconds : float
        Expected for the region of the study, setting up included, with its number of threads.
    error, bias : float
        Expected; the bias is part of the error.
    extrapolated : bool
        Whether it needs more samples than were measured.
    remarks : tuple of str
        Remarks: how far it extrapolates, and which variants cannot get there.

    Examples
    --------
    See `ErrorTable`.
    """

    target_error: float
    variant: str
    samples: int
    cpu_seconds: float
    wall_seconds: float
    error: float
    bias: float
    extrapolated: bool
    remarks: tuple[str, ...] = ()

    def __str__(self) -> str:
        bias = f" (bias {100 * self.bias:.3g} %)" if self.bias else ""
        first = (
            f"{self.variant} with {self.samples} samples: error {100 * self.error:.3g} %{bias}, "
            f"{self.cpu_seconds:.3g} CPU-s, {self.wall_seconds:.3g} s of wall time"
        )
        return "\n".join([first, *(f"- {remark}" for remark in self.remarks)])


def recommended(fits: Mapping[str, Fit], target: float) -> Recommendation:
    """Cheapest variant that reaches an error; see `ErrorTable.recommend`."""
    needed = {name: _samples_for(name, fit, target) for name, fit in fits.items()}
    refusals = [why for why in needed.values() if isinstance(why, str)]
    reached = [_expected(name, fits[name], target, n) for name, n in needed.items() if isinstance(n, int)]
    if not reached:
        raise InvalidValueError(
            f"target_error is {100 * target:.3g} %, which no variant reaches; {'; '.join(refusals)}. "
            "Raise the target, or study a variant without that bias"
        )
    best = min(reached, key=lambda found: found.cpu_seconds)
    telling = [found for found in reached if fits[found.variant][0][0].reported_variance is not None]
    remarks = list(best.remarks)
    if best not in telling:
        remarks.append(f"{best.variant} reports no standard errors")
        if telling:  # what it would cost to know the error of each image too
            second = min(telling, key=lambda found: found.cpu_seconds)
            remarks[-1] += f"; {second.variant} does, with {second.samples} samples in {second.cpu_seconds:.3g} CPU-s"
    return dataclasses.replace(best, remarks=(*remarks, *refusals))


def _samples_for(name: str, fit: Fit, target: float) -> int | str:
    """Number of samples that a variant needs, or the reason why it cannot reach the error."""
    rows, slope, floor = fit
    allowed = target**2 - floor**2
    if allowed <= 0:
        return f"{name} cannot: its bias of {100 * floor:.3g} % is above {100 * target:.3g} %"
    if rows[0].variance <= allowed:
        return rows[0].samples
    for less, more in pairwise(rows):
        if more.variance <= allowed:
            # Straight in logarithms; the row before is above what is allowed.
            part = math.log(less.variance / allowed) / math.log(less.variance / max(more.variance, 1e-300))
            return min(_rounded_up(less.samples * (more.samples / less.samples) ** part), more.samples)
    last = rows[-1]
    if not slope < _FLAT:
        return f"{name} cannot: its error was not seen to fall with the number of samples"
    needed = last.samples * math.exp(min(0.5 * math.log(allowed / last.variance) / slope, 100.0))
    if needed > _MOST_SAMPLES:
        return f"{name} would need more than {_MOST_SAMPLES:.0e} samples"
    return _rounded_up(needed)


def _expected(name: str, fit: Fit, target: float, samples: int) -> Recommendation:
    rows, slope, floor = fit
    last = rows[-1]
    remarks = []
    if samples > last.samples:
        far = ", so that it is uncertain" if samples > _FAR * last.samples else ""
        remarks.append(f"{name} is extrapolated from {last.samples} samples to {samples}{far}")
    elif samples == rows[0].samples:
        remarks.append(f"{name} may need fewer: {samples} samples are the fewest that were measured")
    error = math.sqrt(_variance_at(rows, slope, samples) + floor**2)
    known = min(rows, key=lambda row: row.bias_squared_error)
    if not known.bias_is_found and known.bias_limit > 0.5 * target:
        remarks.append(f"a bias of {name} below {100 * known.bias_limit:.2g} % would not have been found")
    cpu, wall = (_seconds_at(rows, samples, clock) for clock in ("cpu", "wall"))
    return Recommendation(target, name, samples, cpu, wall, error, floor, samples > last.samples, tuple(remarks))


def _variance_at(rows: Sequence[ErrorRow], slope: float, samples: int) -> float:
    """The variance for a number of samples: straight in logarithms between rows, and by the slope beyond them."""
    last = rows[-1]
    if samples > last.samples:
        return float(last.variance * (samples / last.samples) ** (2.0 * slope))
    with np.errstate(divide="ignore"):  # there may be no noise at all
        counts, variances = np.log([(row.samples, row.variance) for row in rows]).T
    return float(np.exp(np.interp(np.log(samples), counts, variances)))


def _seconds_at(rows: Sequence[ErrorRow], samples: int, clock: str) -> float:
    """Seconds for a number of samples: linear between rows, and proportional to the samples beyond the last one."""
    counts, seconds = [row.samples for row in rows], [getattr(row, f"{clock}_seconds") for row in rows]
    each = max(seconds[-1] - getattr(rows[-1], f"setup_{clock}_seconds"), 0.0) / counts[-1]
    return float(np.interp(samples, counts, seconds) + each * max(samples - counts[-1], 0))


def _rounded_up(samples: float) -> int:
    """The next number that is 4, 5, 6 or 7 times a power of 2, or below 4 whole."""
    needed = math.ceil(samples * (1.0 - 1e-12))
    step: int = max(1 << max(needed.bit_length() - 3, 0), 1)
    return -(-needed // step) * step
