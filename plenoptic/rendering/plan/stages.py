"""Stages of a render, and decisions on them."""

from __future__ import annotations

import dataclasses
import enum
from typing import TYPE_CHECKING

from plenoptic.core.display import picture_of
from plenoptic.core.values import value
from plenoptic.rendering.settings import RenderSettings
from plenoptic.truth.channels import Truth

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.camera.ghosts.ghost_camera import GhostLens
    from plenoptic.scene.cache import PreparedScene
    from plenoptic.scene.scene import Scene


class Stage(enum.IntEnum):
    """Stages of a render, in the order in which light is traced backwards.

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
    DIFFRACTION = 5
    APERTURE_REGIONS = 6
    UNVIGNETTED_CORE = 7
    MICROLENSES = 8
    MICROLENS_TYPES = 9
    OPENINGS = 10
    WALLS = 11
    LISTED_LENSES = 12
    MICROLENS_PLATES = 13
    TILTED_SENSOR = 14
    TILTED_ARRAY = 15
    LENS = 16
    ASPHERES = 17
    PLACEMENTS = 18
    SHAPED_STOPS = 19
    LOSSES = 20
    DISPLACED_LENS = 21
    POSE = 22
    SHUTTER = 23
    INTERSECTION = 24
    INSTANCES = 25
    OPACITY = 26
    EMISSION = 27
    BACKGROUND = 28
    SCATTERING = 29
    MATERIALS = 30
    ABSORPTION = 31
    MEDIA = 32
    DIRECT_LIGHT = 33
    ONWARD_RAYS = 34
    RUSSIAN_ROULETTE = 35
    VERTEX_NORMALS = 36
    NORMAL_MAPS = 37
    TEXTURES = 38
    COLOUR = 39
    CAUSTICS_APART = 40
    CLAMPING = 41
    TRUTH = 42
    STANDARD_ERROR = 43
    RARE_LIGHT = 44
    PARTICLES = 45
    GHOSTS = 46


@value
class Decision:
    """Decision whether a stage runs, with its reason.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.rendering.Decision(pl.rendering.Stage.POSE, runs=False, reason="not posed")
    Decision(stage=<Stage.POSE: 22>, runs=False, reason='not posed')
    """

    stage: Stage
    runs: bool
    reason: str

    @property
    def name(self) -> str:
        """Name of the stage in words."""
        return self.stage.name.lower().replace("_", " ")


@value
class Subject:
    """Subject of a plan or a render: the scene (None: a white image), the camera, and the parameters of paths."""

    scene: Scene | None
    camera: PlenopticCamera
    samples: int = 64
    replicates: int = 2
    truth: Truth = Truth.DEPTH
    settings: RenderSettings = RenderSettings()
    ghosts: GhostLens | None = None
    """Lens whose ghosts are rendered through `camera`, that of `opening_camera`; None: the image of the camera."""

    @property
    def prepared(self) -> PreparedScene | None:
        """The compiled scene."""
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
        Subject of the plan; None for a plan built by hand. Plans are equal if their decisions are.

    Examples
    --------
    See `plan`.
    """

    decisions: tuple[Decision, ...]
    subject: Subject | None = dataclasses.field(default=None, compare=False, repr=False)

    def runs(self, stage: Stage) -> bool:
        """True if a stage runs."""
        return any(decision.runs for decision in self.decisions if decision.stage is stage)

    def __repr__(self) -> str:
        rows = [f"{'runs    ' if d.runs else 'left out'}  {d.name:<22} {d.reason}" for d in self.decisions]
        return "\n".join(rows)

    _repr_html_ = picture_of


def decide(stage: Stage, *table: object) -> Decision:
    """Decide on a stage from pairs of conditions and reasons against it, followed by the reason for it."""
    *pairs, runs = table
    for condition, reason in zip(pairs[::2], pairs[1::2], strict=True):
        if not condition:
            return Decision(stage, False, str(reason))
    return Decision(stage, True, str(runs))


def left_out(first: Stage, last: Stage, reason: str) -> list[Decision]:
    """Negative decisions on a range of stages."""
    return [Decision(Stage(stage), False, reason) for stage in range(first, last + 1)]
