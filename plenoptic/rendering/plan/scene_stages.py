"""Which stages a scene needs, and why."""

from __future__ import annotations

from plenoptic.rendering.plan.stages import Decision, Stage, first_reason
from plenoptic.scene.compile import SceneRecord
from plenoptic.scene.materials.record import KIND_NAMES, LAMBERTIAN

ROULETTE = 3
"""Paths that were scattered this often go on with a probability of what their surface gives back."""


def is_dark(record: SceneRecord) -> bool:
    """Whether nothing in a scene shines: its image is black."""
    return not _visible(record) and record.lights.points is None


def _visible(record: SceneRecord) -> bool:
    """Whether rays can meet what shines."""
    parts = (record.emission, *_world_parts(record).values())
    return any(part is not None for part in parts)


def scene_decisions(record: SceneRecord | None, max_bounces: int) -> list[Decision]:
    """Decisions on the stages from INTERSECTION to COLOUR."""
    if record is None:
        white = "a white image has no scene"
        return [Decision(Stage(stage), False, white) for stage in range(Stage.INTERSECTION, Stage.COLOUR + 1)]
    meshes = record.geometry is not None
    scatters = meshes and record.bsdf is not None and max_bounces > 0
    return [
        *_geometry(record, meshes),
        *_emission(record, meshes),
        *_scattering(record, meshes, scatters, max_bounces),
        *_details(record, scatters),
    ]


def _geometry(record: SceneRecord, meshes: bool) -> list[Decision]:
    instances = record.instances
    return [
        Decision(Stage.INTERSECTION, meshes, "there are meshes" if meshes else "there is no mesh"),
        Decision(
            Stage.INSTANCES,
            instances is not None,
            "no mesh is repeated" if instances is None else f"meshes stand at {len(instances.matrices)} places",
        ),
        Decision(
            Stage.OPACITY,
            record.alpha is not None,
            "everything is opaque" if record.alpha is None else "some surfaces are not there for all paths",
        ),
    ]


def _drawn(record: SceneRecord) -> str:
    """The kinds of lights that are drawn directly."""
    lights = record.lights
    kinds = {
        "surfaces": None if record.emission is None else record.emission.pdf,
        "points": lights.points,
        "suns": lights.sky.suns,
        "the environment": lights.sky.environment,
    }
    return ", ".join(name for name, part in kinds.items() if part is not None)


def _world(record: SceneRecord) -> str:
    """What rays see that meet nothing."""
    return "the world is bright: " + ", ".join(name for name, part in _world_parts(record).items() if part is not None)


def _world_parts(record: SceneRecord) -> dict[str, object]:
    """What makes the world bright, by name."""
    sky = record.lights.sky
    return {"a constant": sky.background, "a map": sky.environment, "suns": sky.suns}


def _other_kinds(record: SceneRecord) -> str:
    """The kinds of materials that are not Lambertian."""
    kinds = set() if record.bsdf is None or record.bsdf.kind is None else set(record.bsdf.kind.tolist())
    return "there are " + ", ".join(KIND_NAMES[kind] for kind in sorted(kinds - {LAMBERTIAN}))


def _emission(record: SceneRecord, meshes: bool) -> list[Decision]:
    emits = record.emission is not None
    background = any(part is not None for part in _world_parts(record).values())
    dark = ", and the image will be black" * is_dark(record)
    return [
        Decision(Stage.EMISSION, meshes and emits, "something emits" if emits else "nothing emits" + dark),
        Decision(Stage.BACKGROUND, background, _world(record) if background else "the world is black"),
    ]


def _scattering(record: SceneRecord, meshes: bool, scatters: bool, max_bounces: int) -> list[Decision]:
    lights = scatters and record.lights.cdf is not None
    onward = scatters and (_visible(record) or (lights and max_bounces > 1))
    plain = record.bsdf is None or record.bsdf.kind is None
    no = "nothing scatters"
    return [
        Decision(
            Stage.SCATTERING,
            scatters,
            first_reason(
                meshes,
                "there is no mesh",
                record.bsdf is not None,
                "nothing reflects",
                max_bounces > 0,
                "0 bounces",
                "something reflects",
            ),
        ),
        Decision(
            Stage.MATERIALS,
            scatters and not plain,
            first_reason(scatters, no, not plain, "all surfaces are Lambertian", _other_kinds(record)),
        ),
        Decision(
            Stage.ABSORPTION,
            scatters and record.absorption is not None,
            first_reason(scatters, no, record.absorption is not None, "nothing absorbs", "some glass absorbs"),
        ),
        Decision(
            Stage.DIRECT_LIGHT,
            lights,
            first_reason(scatters, no, lights, "there are no lights", f"drawn: {_drawn(record)}"),
        ),
        Decision(
            Stage.ONWARD_RAYS,
            onward,
            first_reason(scatters, no, onward, "no light could be met", f"up to {max_bounces} bounces"),
        ),
        Decision(
            Stage.RUSSIAN_ROULETTE,
            onward and max_bounces > ROULETTE,
            first_reason(onward, "no rays onwards", max_bounces > ROULETTE, "few bounces", f"after {ROULETTE} bounces"),
        ),
    ]


def _details(record: SceneRecord, scatters: bool) -> list[Decision]:
    no = "nothing scatters"
    normals = record.geometry is not None and record.geometry.normals is not None
    maps = record.textures is not None and record.textures.normal is not None
    textures = record.geometry is not None and record.geometry.uv is not None
    return [
        Decision(
            Stage.VERTEX_NORMALS,
            scatters and normals,
            first_reason(scatters, no, normals, "meshes are flat", "meshes have normals"),
        ),
        Decision(
            Stage.NORMAL_MAPS,
            scatters and maps,
            first_reason(scatters, no, maps, "no material has one", "textures turn normals"),
        ),
        Decision(Stage.TEXTURES, textures, "materials have textures" if textures else "no textures"),
        Decision(
            Stage.COLOUR, record.channels == 3, "colours differ" if record.channels == 3 else "all colours are grey"
        ),
    ]
