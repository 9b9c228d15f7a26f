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
    EXACT_PUPILS = 5
    CERTAIN_LIGHT = 6
    MICROLENSES = 7
    MICROLENS_TYPES = 8
    OPENINGS = 9
    WALLS = 10
    LISTED_LENSES = 11
    MICROLENS_PLATES = 12
    TILTED_SENSOR = 13
    TILTED_ARRAY = 14
    LENS = 15
    ASPHERES = 16
    PLACEMENTS = 17
    SHAPED_STOPS = 18
    DISPLACED_LENS = 19
    POSE = 20
    SHUTTER = 21
    INTERSECTION = 22
    INSTANCES = 23
    OPACITY = 24
    EMISSION = 25
    BACKGROUND = 26
    SCATTERING = 27
    MATERIALS = 28
    ABSORPTION = 29
    DIRECT_LIGHT = 30
    ONWARD_RAYS = 31
    RUSSIAN_ROULETTE = 32
    VERTEX_NORMALS = 33
    NORMAL_MAPS = 34
    TEXTURES = 35
    COLOUR = 36
    CAUSTICS_APART = 37
    CLAMPING = 38
    TRUTH = 39
    STANDARD_ERROR = 40


@value
class Decision:
    """Whether a stage runs, and because of what.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.rendering.Decision(pl.rendering.Stage.POSE, runs=False, reason="not posed")
    Decision(stage=<Stage.POSE: 20>, runs=False, reason='not posed')
    """

    stage: Stage
    runs: bool
    reason: str

    @property
    def name(self) -> str:
        """The stage in words."""
        return self.stage.name.lower().replace("_", " ")


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
        rows = [f"{'runs    ' if d.runs else 'left out'}  {d.name:<22} {d.reason}" for d in self.decisions]
        return "\n".join(rows)

    def _repr_html_(self) -> str:
        """What is rendered, from three sides, and two tables: of the stages that run, and of those that do not."""
        from plenoptic.plots.notebook.html import table_html
        from plenoptic.plots.notebook.pictures import plan_picture

        parts = [plan_picture(self)]
        for runs, caption in ((True, "runs"), (False, "left out")):
            rows = [(d.name, d.reason) for d in self.decisions if d.runs is runs]
            parts.append(table_html(("stage", "because"), rows, caption=f"{caption}: {len(rows)}"))
        return "".join(parts)


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
