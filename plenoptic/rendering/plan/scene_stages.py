"""Which stages a scene needs, and why."""

from __future__ import annotations

from plenoptic.rendering.plan.stages import Decision, Stage, first_reason
from plenoptic.scene.compile import SceneTables
from plenoptic.scene.materials.registry import KIND_NAMES, LAMBERTIAN

ROULETTE = 3
"""Paths that were scattered this often go on with a probability of what their surface gives back."""


def is_dark(tables: SceneTables) -> bool:
    """Whether nothing in a scene shines: its image is black."""
    return not _visible(tables) and tables.lights.points is None


def _visible(tables: SceneTables) -> bool:
    """Whether rays can meet what shines."""
    parts = (tables.emission, tables.background, tables.environment, tables.lights.suns)
    return any(part is not None for part in parts)


def scene_decisions(tables: SceneTables | None, max_bounces: int) -> list[Decision]:
    """Decisions on the stages from INTERSECTION to COLOUR."""
    if tables is None:
        white = "a white image has no scene"
        return [Decision(Stage(stage), False, white) for stage in range(Stage.INTERSECTION, Stage.COLOUR + 1)]
    meshes = tables.triangles is not None
    scatters = meshes and tables.albedo is not None and max_bounces > 0
    return [
        *_geometry(tables, meshes),
        *_emission(tables, meshes),
        *_scattering(tables, meshes, scatters, max_bounces),
        *_details(tables, scatters),
    ]


def _geometry(tables: SceneTables, meshes: bool) -> list[Decision]:
    instances = tables.instances
    return [
        Decision(Stage.INTERSECTION, meshes, "there are meshes" if meshes else "there is no mesh"),
        Decision(
            Stage.INSTANCES,
            instances is not None,
            "no mesh is repeated" if instances is None else f"meshes stand at {len(instances.matrices)} places",
        ),
        Decision(
            Stage.OPACITY,
            tables.opacity is not None,
            "everything is opaque" if tables.opacity is None else "some surfaces are not there for all paths",
        ),
    ]


def _drawn(tables: SceneTables) -> str:
    """The kinds of lights that are drawn directly."""
    lights = tables.lights
    kinds = {
        "surfaces": lights.material_density,
        "points": lights.points,
        "suns": lights.suns,
        "the environment": tables.environment,
    }
    return ", ".join(name for name, part in kinds.items() if part is not None)


def _world(tables: SceneTables) -> str:
    """What rays see that meet nothing."""
    kinds = {"a constant": tables.background, "a map": tables.environment, "suns": tables.lights.suns}
    return "the world is bright: " + ", ".join(name for name, part in kinds.items() if part is not None)


def _other_kinds(tables: SceneTables) -> str:
    """The kinds of materials that are not Lambertian."""
    kinds = set() if tables.bsdf.kinds is None else set(tables.bsdf.kinds.tolist())
    return "there are " + ", ".join(KIND_NAMES[kind] for kind in sorted(kinds - {LAMBERTIAN}))


def _emission(tables: SceneTables, meshes: bool) -> list[Decision]:
    emits = tables.emission is not None
    background = any(part is not None for part in (tables.background, tables.environment, tables.lights.suns))
    dark = ", and the image will be black" * is_dark(tables)
    return [
        Decision(Stage.EMISSION, meshes and emits, "something emits" if emits else "nothing emits" + dark),
        Decision(Stage.BACKGROUND, background, _world(tables) if background else "the world is black"),
    ]


def _scattering(tables: SceneTables, meshes: bool, scatters: bool, max_bounces: int) -> list[Decision]:
    lights = scatters and tables.lights.cdf is not None
    onward = scatters and (_visible(tables) or (lights and max_bounces > 1))
    plain = tables.bsdf.kinds is None
    no = "nothing scatters"
    return [
        Decision(
            Stage.SCATTERING,
            scatters,
            first_reason(
                meshes,
                "there is no mesh",
                tables.albedo is not None,
                "nothing reflects",
                max_bounces > 0,
                "0 bounces",
                "something reflects",
            ),
        ),
        Decision(
            Stage.MATERIALS,
            scatters and not plain,
            first_reason(scatters, no, not plain, "all surfaces are Lambertian", _other_kinds(tables)),
        ),
        Decision(
            Stage.ABSORPTION,
            scatters and tables.absorption is not None,
            first_reason(scatters, no, tables.absorption is not None, "nothing absorbs", "some glass absorbs"),
        ),
        Decision(
            Stage.DIRECT_LIGHT,
            lights,
            first_reason(scatters, no, lights, "there are no lights", f"drawn: {_drawn(tables)}"),
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


def _details(tables: SceneTables, scatters: bool) -> list[Decision]:
    no = "nothing scatters"
    textures = tables.texels is not None
    return [
        Decision(
            Stage.VERTEX_NORMALS,
            scatters and tables.normals is not None,
            first_reason(scatters, no, tables.normals is not None, "meshes are flat", "meshes have normals"),
        ),
        Decision(
            Stage.NORMAL_MAPS,
            scatters and tables.normal_texture is not None,
            first_reason(
                scatters, no, tables.normal_texture is not None, "no material has one", "textures turn normals"
            ),
        ),
        Decision(Stage.TEXTURES, textures, "materials have textures" if textures else "no textures"),
        Decision(
            Stage.COLOUR, tables.channels == 3, "colours differ" if tables.channels == 3 else "all colours are grey"
        ),
    ]
