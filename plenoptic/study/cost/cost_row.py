"""One row of the study of costs: CPU time with and without a stage of the render."""

from __future__ import annotations

import math
from typing import NamedTuple

from plenoptic.rendering.plan.stages import Stage
from plenoptic.study.study_table import Cell


class CostRow(NamedTuple):
    """Cost of one stage of a render.

    Examples
    --------
    See `StudyTable`.
    """

    stage: Stage
    instead: str
    """Done in place of the stage."""
    with_it: float
    """CPU seconds per million paths beyond set-up, median over the rounds; nan if a render took no longer than that."""
    without_it: float
    """The same without the stage."""
    percent: float
    """Share of the whole, median over the rounds; negative if the render is slower without the stage."""
    standard_error: float | None
    """Of `percent`; None with fewer than 3 rounds."""
    set_up: float
    """CPU seconds of set-up that the stage takes, whatever the number of paths."""
    picture_change: float | None
    """Root mean square change of the image without the stage, over its mean, in per cent; 0 where noise hides it.

    None if the image is black.
    """
    also: tuple[Stage, ...] = ()
    """Stages that stop together with this one: their costs are part of it."""

    @property
    def cells(self) -> tuple[Cell, ...]:
        """Texts with the heads of their columns."""
        return (
            ("stage", stage_text(self.stage)),
            ("without it", self.instead),
            ("s with", _number(self.with_it, ".3g")),
            ("s without", _number(self.without_it, ".3g")),
            ("% of CPU", _number(self.percent, ".1f")),
            ("+-", "" if self.standard_error is None else f"{self.standard_error:.1f}"),
            ("set-up s", f"{round(self.set_up, 3) + 0.0:.3f}"),
            ("picture %", "" if self.picture_change is None else f"{float(f'{self.picture_change:.2g}'):g}"),
            ("stops too", ", ".join(map(stage_text, self.also))),
        )


def stage_text(stage: Stage) -> str:
    """The name of a stage in words."""
    return stage.name.lower().replace("_", " ")


def _number(number: float, form: str) -> str:
    return "" if math.isnan(number) else format(number, form)
