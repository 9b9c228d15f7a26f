"""Estimated time, memory, error and file sizes of a render."""

from __future__ import annotations

import textwrap
from typing import NamedTuple

from plenoptic.core.values import value
from plenoptic.rendering.plan.stages import Plan


class Estimated(NamedTuple):
    """An estimate with its interval.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.rendering.Estimated(10.0, 8.0, 13.0).value
    10.0
    """

    value: float
    low: float
    high: float
    """Interval that contains the number in most cases."""


@value
class Estimate:
    """Estimated time, memory, error and file sizes of a render.

    Parameters
    ----------
    cpu_seconds, seconds : Estimated
        Processor time and wall-clock time in s, without compilation.
    peak_memory : Estimated
        Peak memory of the process, bytes.
    file_size, checkpoint_size : Estimated
        Size of the exposure as EXR file, and of a checkpoint, bytes.
    samples : Estimated
        Mean paths of a pixel.
    plan : Plan
        Stages that will run.
    relative_error : Estimated, optional
        `Exposure.relative_error`; None if it is unknown: with one replicate, of black images and of particles.

    Examples
    --------
    See `estimate`.
    """

    cpu_seconds: Estimated
    seconds: Estimated
    peak_memory: Estimated
    file_size: Estimated
    checkpoint_size: Estimated
    samples: Estimated
    plan: Plan
    relative_error: Estimated | None = None

    def __repr__(self) -> str:
        rows = [
            ("processor time", _text(self.cpu_seconds, *_time_unit(self.cpu_seconds.value))),
            ("time", _text(self.seconds, *_time_unit(self.seconds.value))),
            ("samples per pixel", _text(self.samples, 1.0, "")),
            *([] if self.relative_error is None else [("relative error", _text(self.relative_error, 0.01, "%"))]),
            ("peak memory", _text(self.peak_memory, 1e6, "MB")),
            ("EXR file", _text(self.file_size, 1e6, "MB")),
            ("checkpoint", _text(self.checkpoint_size, 1e6, "MB")),
        ]
        stages, every = [decision.name for decision in self.plan.decisions if decision.runs], len(self.plan.decisions)
        rows.append(("stages", f"{', '.join(stages)}; {every - len(stages)} others are left out"))
        return "\n".join(textwrap.fill(f"{name:<18} {text}", 110, subsequent_indent=19 * " ") for name, text in rows)


def _time_unit(seconds: float) -> tuple[float, str]:
    return (1.0, "s") if seconds < 100 else (60.0, "min") if seconds < 6000 else (3600.0, "h")


def _text(number: Estimated, unit: float, name: str) -> str:
    value, low, high = (f"{part / unit:.3g}" for part in number)
    between = f" ({low} to {high})" if low != high else ""
    return f"{value} {name}{between}".replace("  ", " ").rstrip()
