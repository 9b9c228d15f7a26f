"""Statistics of a render: time, paths and losses."""

from __future__ import annotations

import enum
from typing import TYPE_CHECKING

import numpy as np

from plenoptic.core.lost_rays import Lost, by_cause, check_lost, in_words
from plenoptic.core.values import choice, finite, frozen_array, not_negative, plain_array, set_field, value, whole
from plenoptic.errors import InvalidValueError

if TYPE_CHECKING:
    from plenoptic.optics.lens.analysis.conditioning import Conditioning


NAMED = 16
"""Non-finite paths that are listed."""


class StopReason(enum.IntEnum):
    """Reason for the end of a render: samples, time limit, target error, or an interruption.

    TARGET_MISSED: the pixels' neighbours had reached the target error, but the error of the image is more than 1.25
    times the target, or unknown because light is rare (`Exposure.rare_light`).

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.rendering.RenderStats(stopped_by=pl.rendering.StopReason.TIME_LIMIT).stopped_by.name
    'TIME_LIMIT'
    """

    SAMPLES = 0
    TIME_LIMIT = 1
    TARGET_ERROR = 2
    INTERRUPTED = 3
    TARGET_MISSED = 4


_END_TEXTS = {
    StopReason.TIME_LIMIT: "stopped by the time limit",
    StopReason.TARGET_ERROR: "stopped at the target error",
    StopReason.INTERRUPTED: "interrupted",
    StopReason.TARGET_MISSED: "stopped above the target error",
}


@value
class RenderStats:
    """Time, paths and losses of a render.

    Parameters
    ----------
    seconds : float
        Wall-clock time, s.
    cpu_seconds : float
        Processor time of all threads together, s.
    paths : int
        Sampled paths, including those of sampled deflections by diffraction at microlenses.
    paths_through_lens : int
        Paths that left the lens towards the scene; of a white image, only those outside the unvignetted core.
    lost : tuple of (str, int or None, int)
        Cause, index of the lens element (None if no element is involved) and number of paths. Causes are
        "outside_microlens", "missed", "clipped", "total_reflection", "not_finite" and, with diffraction, "bent_in":
        light from more than 8 pixels outside the sensor, which is not traced.
    nonfinite : int
        Non-finite contributions, which are left out of the image.
    nonfinite_paths : tuple of (int, int, int)
        Row and column on the sensor, and sample, of the first such paths, for `replay`.
    zero_variance : int
        Lit pixels whose samples (with 8 replicates and more: replicates) are all equal. Their standard error is the
        change of the mean by a single other sample.
    threads : int
        Number of threads.
    clamped : float
        Fraction of all light removed by `clamp`, in [0, 1]: the bias of the mean image.
    stopped_by : StopReason
        Reason for the end of the render.
    conditioning : Conditioning, optional
        Amplification of rounding errors by the lens surfaces, and Newton iterations, of some paths; only if requested.
    processors : tuple of str
        Kinds of processors that rendered the image: several if a checkpoint was resumed on another one. The bits of the
        image depend on them.
    unmet_light : float
        Fraction of all light, in [0, 1], that caustics of small lamps may have without being met by a path: that of 8
        paths. The plan's stage RARE_LIGHT names lamp and mesh; 0 where it does not run.

    Examples
    --------
    >>> import plenoptic as pl
    >>> stats = pl.rendering.RenderStats(
    ...     seconds=2.0, cpu_seconds=3.9, paths=1000, paths_through_lens=800,
    ...     lost=(("clipped", 0, 150), ("clipped", 5, 50)), threads=2,
    ... )
    >>> stats.fraction_through_lens, stats.lost_by_cause
    (0.8, {'clipped': 200})
    """

    seconds: float = 0.0
    cpu_seconds: float = 0.0
    paths: int = 0
    paths_through_lens: int = 0
    lost: Lost = ()
    nonfinite: int = 0
    threads: int = 1
    clamped: float = 0.0
    nonfinite_paths: tuple[tuple[int, int, int], ...] = ()
    zero_variance: int = 0
    stopped_by: StopReason = StopReason.SAMPLES
    conditioning: Conditioning | None = None
    processors: tuple[str, ...] = ()
    unmet_light: float = 0.0

    def __post_init__(self) -> None:
        for name in ("seconds", "cpu_seconds"):
            set_field(self, name, not_negative(getattr(self, name), name, "s"))
        set_field(self, "stopped_by", choice(self.stopped_by, StopReason, "stopped_by"))
        paths = plain_array(self.nonfinite_paths, "nonfinite_paths")
        paths = paths if paths.size else np.empty((0, 3))
        paths = frozen_array(paths, name="nonfinite_paths", shape=("n", 3), dtype=np.int64)
        set_field(self, "nonfinite_paths", tuple((row, column, sample) for row, column, sample in paths.tolist()))
        minima = {"paths": 0, "paths_through_lens": 0, "nonfinite": 0, "zero_variance": 0, "threads": 1}
        for name, minimum in minima.items():
            set_field(self, name, whole(getattr(self, name), name, at_least=minimum))
        if isinstance(self.processors, str) or not all(isinstance(kind, str) for kind in self.processors):
            raise InvalidValueError(f"processors is {self.processors!r}; it must be a tuple of texts")
        set_field(self, "processors", tuple(self.processors))
        for name in ("clamped", "unmet_light"):
            fraction = finite(getattr(self, name), name)
            if not 0 <= fraction <= 1:
                raise InvalidValueError(f"{name} is {fraction:g}; it must be within 0 and 1")
            set_field(self, name, fraction)
        if self.paths_through_lens > self.paths:
            raise InvalidValueError(
                f"paths_through_lens is {self.paths_through_lens}; it must be at most paths, {self.paths}"
            )
        set_field(self, "lost", check_lost(self.lost))

    @property
    def fraction_through_lens(self) -> float:
        """Fraction of the sampled paths that left the lens towards the scene; nan without paths."""
        return self.paths_through_lens / self.paths if self.paths else float("nan")

    @property
    def lost_by_cause(self) -> dict[str, int]:
        """Number of lost paths for each cause, over all elements."""
        return by_cause(self.lost)

    def __repr__(self) -> str:
        lost = in_words(self.lost_by_cause)
        facts = [f"{self.seconds:.3g} s", f"{self.threads} threads" if self.threads > 1 else "1 thread"]
        facts.append(f"{self.paths} paths")
        if self.paths:
            facts.append(f"{100 * self.fraction_through_lens:.3g} % through the lens")
        if lost:
            facts.append(f"lost: {lost}")
        if self.stopped_by is not StopReason.SAMPLES:
            facts.append(_END_TEXTS[self.stopped_by])
        if self.nonfinite:
            facts.append(f"{self.nonfinite} not finite")
        if self.clamped:
            facts.append(f"{100 * self.clamped:.2g} % of the light clamped away")
        return f"RenderStats({', '.join(facts)})"
