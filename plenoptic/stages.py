"""The stages of a rendering, and decisions on them."""

from __future__ import annotations

import enum

from plenoptic._values import value


class Stage(enum.IntEnum):
    """The parts of a rendering, in the order in which light is followed back.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.Stage.LENS.name
    'LENS'
    """

    WAVELENGTHS = 0
    PIXEL_RESPONSE = 1
    BLEMISHES = 2
    MICROLENSES = 3
    MICROLENS_TYPES = 4
    OPENINGS = 5
    LISTED_LENSES = 6
    MICROLENS_PLATES = 7
    TILTED_SENSOR = 8
    TILTED_ARRAY = 9
    LENS = 10
    ASPHERES = 11
    PLACEMENTS = 12
    SHAPED_STOPS = 13
    POSE = 14
    INTERSECTION = 15
    INSTANCES = 16
    OPACITY = 17
    EMISSION = 18
    BACKGROUND = 19
    SCATTERING = 20
    MATERIALS = 21
    ABSORPTION = 22
    DIRECT_LIGHT = 23
    ONWARD_RAYS = 24
    RUSSIAN_ROULETTE = 25
    VERTEX_NORMALS = 26
    TEXTURES = 27
    COLOUR = 28
    TRUTH = 29
    STANDARD_ERROR = 30


@value
class Decision:
    """Whether a stage runs, and because of what.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.Decision(pl.Stage.POSE, runs=False, reason="not posed")
    Decision(stage=<Stage.POSE: 14>, runs=False, reason='not posed')
    """

    stage: Stage
    runs: bool
    reason: str


@value
class Plan:
    """Decisions on all stages; printing it shows them as a table.

    Examples
    --------
    See `plan`.
    """

    decisions: tuple[Decision, ...]

    def runs(self, stage: Stage) -> bool:
        """Whether a stage runs."""
        return any(decision.runs for decision in self.decisions if decision.stage is stage)

    def __repr__(self) -> str:
        rows = [
            f"{'runs    ' if d.runs else 'left out'}  {d.stage.name.lower().replace('_', ' '):<22} {d.reason}"
            for d in self.decisions
        ]
        return "\n".join(rows)


def first_reason(*conditions: object) -> str:
    """Reasons in pairs (holds, reason where it does not), then the reason where all hold."""
    *pairs, fine = conditions
    for holds, reason in zip(pairs[::2], pairs[1::2], strict=True):
        if not holds:
            return str(reason)
    return str(fine)
