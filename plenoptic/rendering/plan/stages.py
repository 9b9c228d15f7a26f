"""The stages of a render, and decisions on them."""

from __future__ import annotations

import dataclasses
import enum
from typing import TYPE_CHECKING

from plenoptic.core.values import value
from plenoptic.rendering.settings import RenderSettings
from plenoptic.truth.channels import Truth

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.scene.cache import PreparedScene
    from plenoptic.scene.scene import Scene


class Stage(enum.IntEnum):
    """The parts of a render, in the order in which light is followed back.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.rendering.Stage.LENS.name
    'LENS'
    """

    INDEPENDENT_SAMPLES = 0
    WAVELENGTHS = 1
    PIXEL_RESPONSE = 2
    TURNED_PIXELS = 3
    BLEMISHES = 4
    MICROLENSES = 5
    MICROLENS_TYPES = 6
    OPENINGS = 7
    WALLS = 8
    LISTED_LENSES = 9
    MICROLENS_PLATES = 10
    TILTED_SENSOR = 11
    TILTED_ARRAY = 12
    LENS = 13
    ASPHERES = 14
    PLACEMENTS = 15
    SHAPED_STOPS = 16
    DISPLACED_LENS = 17
    POSE = 18
    INTERSECTION = 19
    INSTANCES = 20
    OPACITY = 21
    EMISSION = 22
    BACKGROUND = 23
    SCATTERING = 24
    MATERIALS = 25
    ABSORPTION = 26
    DIRECT_LIGHT = 27
    ONWARD_RAYS = 28
    RUSSIAN_ROULETTE = 29
    VERTEX_NORMALS = 30
    NORMAL_MAPS = 31
    TEXTURES = 32
    COLOUR = 33
    CAUSTICS_APART = 34
    CLAMPING = 35
    TRUTH = 36
    STANDARD_ERROR = 37


@value
class Decision:
    """Whether a stage runs, and because of what.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.rendering.Decision(pl.rendering.Stage.POSE, runs=False, reason="not posed")
    Decision(stage=<Stage.POSE: 18>, runs=False, reason='not posed')
    """

    stage: Stage
    runs: bool
    reason: str


@value
class Subject:
    """What is planned or rendered: a scene (None: a white image), the camera, and what the paths are."""

    scene: Scene | None
    camera: PlenopticCamera
    samples: int = 64
    replicates: int = 2
    truth: Truth = Truth.DEPTH
    settings: RenderSettings = RenderSettings()

    @property
    def prepared(self) -> PreparedScene | None:
        """The scene, compiled."""
        if self.scene is None:
            return None
        from plenoptic.scene.cache import prepared_scene

        return prepared_scene(self.scene)


@value
class Plan:
    """Decisions on all stages; printing it shows them as a table.

    Parameters
    ----------
    decisions : tuple of Decision
    subject : Subject, optional
        What it was made for; None for a plan that was made by hand. Plans are equal where their decisions are.

    Examples
    --------
    See `plan`.
    """

    decisions: tuple[Decision, ...]
    subject: Subject | None = dataclasses.field(default=None, compare=False, repr=False)

    def runs(self, stage: Stage) -> bool:
        """Whether a stage runs."""
        return any(decision.runs for decision in self.decisions if decision.stage is stage)

    def __repr__(self) -> str:
        rows = [
            f"{'runs    ' if d.runs else 'left out'}  {d.stage.name.lower().replace('_', ' '):<22} {d.reason}"
            for d in self.decisions
        ]
        return "\n".join(rows)


def decide(stage: Stage, *table: object) -> Decision:
    """Decide on a stage: what it takes and why it is left out without that, in pairs, then why it runs otherwise."""
    *pairs, runs = table
    for condition, reason in zip(pairs[::2], pairs[1::2], strict=True):
        if not condition:
            return Decision(stage, False, str(reason))
    return Decision(stage, True, str(runs))


def left_out(first: Stage, last: Stage, reason: str) -> list[Decision]:
    """Decisions against a range of stages."""
    return [Decision(Stage(stage), False, reason) for stage in range(first, last + 1)]
