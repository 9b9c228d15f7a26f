"""Which stages a rendering needs, which are left out, and why. `rendering` asks the plan; nothing else decides."""

from __future__ import annotations

import enum

from plenoptic._values import value, whole
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.errors import InvalidValueError
from plenoptic.optics.models import LensModel
from plenoptic.optics.stops import PolygonStop
from plenoptic.optics.surface import Surface
from plenoptic.scene.scene import Scene
from plenoptic.scene.tables import SceneTables


class Stage(enum.IntEnum):
    """The parts of a rendering, in the order in which light is followed back.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.Stage.LENS.name
    'LENS'
    """

    MICROLENSES = 0
    MICROLENS_PLATES = 1
    LENS = 2
    ASPHERES = 3
    PLACEMENTS = 4
    POLYGON_STOPS = 5
    POSE = 6
    INTERSECTION = 7
    EMISSION = 8
    BACKGROUND = 9
    SCATTERING = 10
    DIRECT_LIGHT = 11
    ONWARD_RAYS = 12
    VERTEX_NORMALS = 13
    TEXTURES = 14
    COLOUR = 15
    DEPTH = 16
    STANDARD_ERROR = 17


@value
class Decision:
    """Whether a stage runs, and because of what.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.Decision(pl.Stage.DEPTH, runs=False, reason="not asked for")
    Decision(stage=<Stage.DEPTH: 16>, runs=False, reason='not asked for')
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


def plan(
    scene: Scene | None,
    camera: PlenopticCamera,
    *,
    samples: int = 64,
    replicates: int = 8,
    max_bounces: int = 4,
    depth: bool = True,
) -> Plan:
    """What `render` would run for a scene and a camera, what it would leave out, and why.

    Parameters
    ----------
    scene : Scene or None
        None: a white image.
    camera : PlenopticCamera
    samples, replicates, max_bounces, depth
        As for `render`.

    Returns
    -------
    Plan

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2"),
    ...     sensor=pl.Sensor(shape=(16, 16), pixel_pitch=0.01), stop_to_microlenses=130.0)
    >>> print(pl.plan(None, camera))          # doctest: +ELLIPSIS
    left out  microlenses            the camera has none
    left out  microlens plates       the camera has none
    runs      lens                   11 elements, 10 of them refracting
    ...
    """
    check_arguments(scene, camera, samples=samples, replicates=replicates, max_bounces=max_bounces)
    tables = None if scene is None else scene.tables()
    return plan_stages(tables, camera, samples=samples, replicates=replicates, max_bounces=max_bounces, depth=depth)


def check_arguments(
    scene: Scene | None, camera: PlenopticCamera, *, samples: int, replicates: int, max_bounces: int
) -> None:
    """Raise where a rendering with these arguments is impossible."""
    if scene is not None and not isinstance(scene, Scene):
        raise InvalidValueError(f"scene is a {type(scene).__name__}; it must be a Scene")
    if not isinstance(camera, PlenopticCamera):
        raise InvalidValueError(f"camera is a {type(camera).__name__}; it must be a PlenopticCamera")
    whole(samples, "samples", at_least=1)
    whole(replicates, "replicates", at_least=1)
    whole(max_bounces, "max_bounces", at_least=0)


def is_dark(tables: SceneTables) -> bool:
    """Whether nothing in a scene shines: its image is black."""
    return tables.emission is None and tables.background is None


def plan_stages(
    tables: SceneTables | None,
    camera: PlenopticCamera,
    *,
    samples: int,
    replicates: int,
    max_bounces: int,
    depth: bool,
) -> Plan:
    """`plan` for a scene that is compiled already."""
    decisions = [*_camera_decisions(camera), *_scene_decisions(tables, max_bounces)]
    meshes = tables is not None and tables.triangles is not None
    decisions.append(
        Decision(Stage.DEPTH, depth and meshes, _why(depth, "not asked for", meshes, "there is no mesh", "asked for"))
    )
    independent = min(samples, replicates)
    decisions.append(
        Decision(
            Stage.STANDARD_ERROR, independent >= 2, f"{independent} independent replicate{'s' * (independent != 1)}"
        )
    )
    return Plan(tuple(decisions))


def _why(*conditions: object) -> str:
    """Reasons in pairs (holds, reason where it does not), then the reason where all hold."""
    *pairs, fine = conditions
    for holds, reason in zip(pairs[::2], pairs[1::2], strict=True):
        if not holds:
            return str(reason)
    return str(fine)


def _camera_decisions(camera: PlenopticCamera) -> list[Decision]:
    array = camera.microlenses
    plates = array is not None and array.is_plate
    lens = camera.lens
    exact = lens.model is LensModel.EXACT
    stops = [e for e in lens.elements if isinstance(e, PolygonStop)]
    surfaces = [e for e in lens.elements if isinstance(e, Surface)]
    shaped = sum(1 for e in surfaces if e.aspheric or e.conic)
    moved = sum(1 for e in lens.elements if e.placement is not None)
    ideal = f"{lens.model.name} stands for the lens"
    none = "the camera has none"
    return [
        Decision(Stage.MICROLENSES, array is not None, none if array is None else f"pitch {array.pitch:g} mm"),
        Decision(
            Stage.MICROLENS_PLATES,
            plates,
            none if array is None else f"microlenses are {array.model.name}",
        ),
        Decision(
            Stage.LENS, True, f"{len(lens.elements)} elements, {len(surfaces)} of them refracting" if exact else ideal
        ),
        Decision(
            Stage.ASPHERES,
            exact and shaped > 0,
            _why(
                exact,
                ideal,
                shaped > 0,
                "all surfaces are spheres or planes",
                f"{shaped} conic or aspheric surface{'s' * (shaped != 1)}",
            ),
        ),
        Decision(
            Stage.PLACEMENTS,
            exact and moved > 0,
            _why(
                exact, ideal, moved > 0, "all elements are centred", f"{moved} element{'s' * (moved != 1)} out of place"
            ),
        ),
        Decision(
            Stage.POLYGON_STOPS,
            bool(stops),
            f"{len(stops)} polygonal stop{'s' * (len(stops) != 1)}" if stops else "all stops are round",
        ),
        Decision(
            Stage.POSE, camera.pose is not None, "the world is the camera's frame" if camera.pose is None else "posed"
        ),
    ]


def _scene_decisions(tables: SceneTables | None, max_bounces: int) -> list[Decision]:
    if tables is None:
        white = "a white image has no scene"
        return [Decision(Stage(stage), False, white) for stage in range(Stage.INTERSECTION, Stage.COLOUR + 1)]
    meshes = tables.triangles is not None
    background = tables.background is not None
    reflects = tables.albedo is not None
    scatters = meshes and reflects and max_bounces > 0
    lights = scatters and tables.light_triangles is not None
    onward = scatters and (background or (lights and max_bounces > 1))
    return [
        Decision(Stage.INTERSECTION, meshes, "there are meshes" if meshes else "there is no mesh"),
        Decision(
            Stage.EMISSION,
            meshes and tables.emission is not None,
            _why(
                tables.emission is not None,
                "nothing emits" + ", and the image will be black" * is_dark(tables),
                "something emits",
            ),
        ),
        Decision(Stage.BACKGROUND, background, "the world is bright" if background else "the world is black"),
        Decision(
            Stage.SCATTERING,
            scatters,
            _why(
                meshes,
                "there is no mesh",
                reflects,
                "nothing reflects",
                max_bounces > 0,
                "0 bounces",
                "something reflects",
            ),
        ),
        Decision(
            Stage.DIRECT_LIGHT,
            lights,
            _why(scatters, "nothing scatters", lights, "there are no lights", "there are lights"),
        ),
        Decision(
            Stage.ONWARD_RAYS,
            onward,
            _why(scatters, "nothing scatters", onward, "no light could be met", f"up to {max_bounces} bounces"),
        ),
        Decision(
            Stage.VERTEX_NORMALS,
            scatters and tables.normals is not None,
            _why(scatters, "nothing scatters", tables.normals is not None, "meshes are flat", "meshes have normals"),
        ),
        Decision(
            Stage.TEXTURES,
            scatters and tables.texels is not None,
            _why(scatters, "nothing scatters", tables.texels is not None, "no textures", "materials have textures"),
        ),
        Decision(
            Stage.COLOUR, tables.channels == 3, "colours differ" if tables.channels == 3 else "all colours are grey"
        ),
    ]
