"""Stages of a render, each left out alone."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.errors import InvalidValueError, PlenopticError
from plenoptic.optics.microlens.aperture import Walls
from plenoptic.rendering.plan.plan import plan_for
from plenoptic.rendering.plan.scene_stages import ROULETTE
from plenoptic.rendering.plan.stages import Plan, Stage, Subject
from plenoptic.rendering.settings import Caustics, Sampler
from plenoptic.scene.materials.registry import Material
from plenoptic.scene.scene import Scene
from plenoptic.study.cost import camera_ablation, scene_ablation
from plenoptic.truth.channels import Truth

_Change: TypeAlias = Callable[[Subject], Subject]


class Ablation(NamedTuple):
    """A render without one of its stages."""

    stage: Stage
    instead: str
    """What is done in place of the stage."""
    subject: Subject
    """The render without it."""
    also: tuple[Stage, ...]
    """Other stages that do not run without it."""


class Inseparable(NamedTuple):
    """A stage that runs and cannot be left out alone."""

    stage: Stage
    reason: str


def ablations(plan: Plan) -> tuple[Ablation | Inseparable, ...]:
    """Leave out each stage that a plan runs, one at a time, in the order of the stages."""
    if plan.subject is None:
        raise InvalidValueError("the plan does not know what it was made for; make it by pl.plan(scene, camera)")
    running = {decision.stage for decision in plan.decisions if decision.runs}
    return tuple(_ablation(plan.subject, stage, running) for stage in sorted(running))


def _ablation(subject: Subject, stage: Stage, running: set[Stage]) -> Ablation | Inseparable:
    instead, change = _CHANGES[stage]
    try:
        changed = change(subject)
    except PlenopticError as error:
        return Inseparable(stage, str(error))
    plan = plan_for(changed)
    if plan.runs(stage) and stage not in _REDUCED:
        (reason,) = (decision.reason for decision in plan.decisions if decision.stage is stage)
        return Inseparable(stage, f"with {instead}: {reason}")
    return Ablation(stage, instead, changed, tuple(sorted(s for s in running - {stage} if not plan.runs(s))))


def _set(path: str, value: Any) -> _Change:
    """Replace one field, such as `camera.sensor.angular_response`, by a value."""

    def replace(owner: Any, name: str, *inner: str) -> Any:
        field = replace(getattr(owner, name), *inner) if inner else value
        return dataclasses.replace(owner, **{name: field})

    return lambda subject: replace(subject, *path.split("."))


def _camera(change: Callable[[PlenopticCamera], PlenopticCamera]) -> _Change:
    return lambda subject: dataclasses.replace(subject, camera=change(subject.camera))


def _scene(change: Callable[[Any], Scene]) -> _Change:
    return lambda subject: dataclasses.replace(subject, scene=change(subject.scene))


def _materials(change: Callable[..., Material], **arguments: Any) -> _Change:
    return _scene(lambda scene: scene_ablation.with_materials(scene, partial(change, **arguments)))


def _without_pose(subject: Subject) -> Subject:
    """The world moved so that the camera needs no pose and sees the same."""
    pose, scene, shutter = subject.camera.pose, subject.scene, subject.camera.shutter
    assert pose is not None
    turn, shift = pose.rotation.T, -pose.rotation.T @ pose.position
    if scene is not None:
        scene = scene.transformed(np.vstack([np.column_stack([turn, shift]), [0, 0, 0, 1]]))
    if shutter is not None and shutter.motion is not None:
        shutter = dataclasses.replace(shutter, motion=shutter.motion.in_frame(turn, shift))
    camera = dataclasses.replace(subject.camera, pose=None, shutter=shutter)
    return dataclasses.replace(subject, scene=scene, camera=camera)


def _one_bounce(subject: Subject) -> Subject:
    if subject.settings.max_bounces <= 1:
        raise InvalidValueError("after a single bounce, rays onwards find the lights that are not drawn")
    return _set("settings.max_bounces", 1)(subject)


def _inseparable(_: Subject) -> Subject:
    raise InvalidValueError("the camera says what costs less: bounds on the pupil where microlenses are many")


_REDUCED = {Stage.LENS, Stage.ONWARD_RAYS}
"""Stages that are reduced: rays pass a lens, and with one bounce they still meet lights by chance."""

_field = scene_ablation.with_fields

_CHANGES: dict[Stage, tuple[str, _Change]] = {
    Stage.INDEPENDENT_SAMPLES: ("scrambled Sobol points", _set("settings.sampler", Sampler.SOBOL)),
    Stage.WAVELENGTHS: ("one wavelength", _set("camera.sensitivity", None)),
    Stage.PIXEL_RESPONSE: ("pixels that see all directions alike", _set("camera.sensor.angular_response", None)),
    Stage.TURNED_PIXELS: ("parts that are not turned", _camera(camera_ablation.with_upright_pixels)),
    Stage.BLEMISHES: ("a clean camera", _set("camera.blemishes", ())),
    Stage.DIFFRACTION: ("straight paths", _set("camera.diffraction", None)),
    Stage.APERTURE_REGIONS: ("bounds on the pupil", _inseparable),
    Stage.UNVIGNETTED_CORE: ("a sky, which is traced", _set("scene", Scene(background=1.0))),
    Stage.MICROLENSES: ("a bare sensor", _camera(camera_ablation.without_microlenses)),
    Stage.MICROLENS_TYPES: ("one focal length", _camera(camera_ablation.with_one_type)),
    Stage.OPENINGS: ("lenses that fill their cells", _set("camera.microlenses.aperture", None)),
    Stage.WALLS: ("no walls", _set("camera.microlenses.walls", Walls.NONE)),
    Stage.LISTED_LENSES: ("lenses as designed", _camera(camera_ablation.without_imperfections)),
    Stage.MICROLENS_PLATES: ("thin microlenses", _camera(camera_ablation.with_thin_microlenses)),
    Stage.TILTED_SENSOR: ("a sensor parallel to the array", _camera(camera_ablation.with_parallel_sensor)),
    Stage.TILTED_ARRAY: ("an array upright on the lens's axis", _camera(camera_ablation.with_upright_array)),
    Stage.LENS: ("an ideal thin lens", _camera(camera_ablation.with_thin_lens)),
    Stage.ASPHERES: ("spheres", _camera(camera_ablation.without_aspheres)),
    Stage.PLACEMENTS: ("centred elements", _camera(camera_ablation.without_placements)),
    Stage.SHAPED_STOPS: ("round stops", _camera(camera_ablation.with_round_stops)),
    Stage.LOSSES: ("parts that transmit all light", _camera(camera_ablation.without_coatings)),
    Stage.DISPLACED_LENS: ("the lens as designed", _set("camera.lens_placement", None)),
    Stage.POSE: ("the scene in the camera's frame", _without_pose),
    Stage.SHUTTER: ("an instant", _set("camera.shutter", None)),
    Stage.INTERSECTION: ("a scene without surfaces", _scene(scene_ablation.without_meshes)),
    Stage.INSTANCES: ("copies", _scene(scene_ablation.without_instances)),
    Stage.OPACITY: ("opaque surfaces", _materials(_field, opacity=1.0, cutoff=None)),
    Stage.EMISSION: ("dark surfaces and lamps", _scene(scene_ablation.without_emission)),
    Stage.BACKGROUND: ("a black world", _scene(scene_ablation.without_world)),
    Stage.SCATTERING: ("0 bounces", _set("settings.max_bounces", 0)),
    Stage.MATERIALS: ("Lambertian surfaces", _materials(scene_ablation.as_lambertian)),
    Stage.ABSORPTION: ("clear media", _scene(scene_ablation.without_media)),
    Stage.MEDIA: ("media that do not scatter", _scene(scene_ablation.without_scattering)),
    Stage.DIRECT_LIGHT: ("no lights but a constant world", _scene(scene_ablation.without_lights)),
    Stage.ONWARD_RAYS: ("one bounce", _one_bounce),
    Stage.RUSSIAN_ROULETTE: (f"at most {ROULETTE} bounces", _set("settings.max_bounces", ROULETTE)),
    Stage.VERTEX_NORMALS: ("flat triangles", _scene(scene_ablation.without_vertex_normals)),
    Stage.NORMAL_MAPS: ("the normals of meshes", _materials(_field, normal_map=None)),
    Stage.TEXTURES: ("their mean colours", _materials(scene_ablation.without_textures)),
    Stage.COLOUR: ("grey", _scene(scene_ablation.grey)),
    Stage.CAUSTICS_APART: ("all light alike", _set("settings.caustics", Caustics.INCLUDE)),
    Stage.CLAMPING: ("no limit", _set("settings.clamp", None)),
    Stage.TRUTH: ("no ground truth", _set("truth", Truth.NONE)),
    Stage.STANDARD_ERROR: ("one replicate", _set("replicates", 1)),
    Stage.RARE_LIGHT: ("no caustics", _set("settings.caustics", Caustics.EXCLUDE)),
    Stage.GHOSTS: ("no ghosts", _set("settings.ghosts", None)),
}
"""By stage: the substitute, and the change of the render."""
