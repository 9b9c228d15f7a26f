"""Decisions on the stages of a scene: a table of conditions and reasons."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from plenoptic.rendering.plan.stages import Decision, Stage, decide, left_out

if TYPE_CHECKING:
    from plenoptic.scene.scene_record import SceneRecord

ROULETTE = 3
"""Number of bounces after which Russian roulette begins."""
WHITE = "a white image has no scene"


def is_dark(record: SceneRecord) -> bool:
    """True if nothing in a scene emits light, so that its image is black."""
    return not _visible(record) and record.lights.points is None and record.lights.sheets is None


def _visible(record: SceneRecord) -> bool:
    """True if rays can hit or escape to emitters."""
    return record.emission is not None or bool(_sky_parts(record))


def scene_decisions(record: SceneRecord | None, max_bounces: int, n_particles: int) -> list[Decision]:
    """Decisions on the stages from INTERSECTION to COLOUR."""
    if record is None:
        return left_out(Stage.INTERSECTION, Stage.COLOUR, WHITE)
    return [*_surfaces(record, n_particles), *_scattering(record, max_bounces), *_details(record, max_bounces)]


def _scatters(record: SceneRecord, max_bounces: int) -> bool:
    surfaces = record.geometry is not None and record.bsdf is not None
    return (surfaces or record.media is not None) and max_bounces > 0


def _sky_parts(record: SceneRecord) -> str:
    """Names of the kinds of light from infinity that rays see without a hit."""
    sky = record.lights.sky
    return _names_present({"a constant": sky.background, "a map": sky.environment, "suns": sky.suns})


def _sampled_lights(record: SceneRecord) -> str:
    """Names of the kinds of lights that are sampled directly."""
    lights = record.lights
    kinds = {
        "surfaces": None if record.emission is None else record.emission.pdf,
        "points": lights.points,
        "sheets": lights.sheets,
        "suns": lights.sky.suns,
        "the environment": lights.sky.environment,
    }
    return _names_present(kinds)


def _names_present(parts: Mapping[str, object]) -> str:
    return ", ".join(name for name, part in parts.items() if part is not None)


def _surfaces(record: SceneRecord, n_particles: int) -> list[Decision]:
    meshes, instances, world = record.geometry is not None, record.instances, _sky_parts(record)
    places = f"meshes stand at {0 if instances is None else len(instances.matrices)} places"
    clear = "some surfaces are not there for all paths"
    dark = "nothing emits" + ", and the image will be black" * (is_dark(record) and not n_particles)
    return [
        decide(Stage.INTERSECTION, meshes, "there is no mesh", "there are meshes"),
        decide(Stage.INSTANCES, instances is not None, "no mesh is repeated", places),
        decide(Stage.OPACITY, record.alpha is not None, "everything is opaque", clear),
        decide(Stage.EMISSION, record.emission is not None, dark, "something emits"),
        decide(Stage.BACKGROUND, world, "the world is black", f"the world is bright: {world}"),
    ]


def _scattering(record: SceneRecord, max_bounces: int) -> list[Decision]:
    meshes, bsdf, scatters = record.geometry is not None, record.bsdf, _scatters(record, max_bounces)
    kinds = set() if bsdf is None or bsdf.kind is None else set(bsdf.kind.tolist())
    from plenoptic.scene.materials.registry import KIND_NAMES, LAMBERTIAN

    other_kinds = "there are " + ", ".join(KIND_NAMES[kind] for kind in sorted(kinds - {LAMBERTIAN}))
    media = record.media is not None
    absorbs, samples_lights = record.absorption is not None, record.lights.cdf is not None
    onward = scatters and (_visible(record) or (samples_lights and max_bounces > 1))
    no, bounces, roulette = "nothing scatters", f"up to {max_bounces} bounces", f"after {ROULETTE} bounces"
    return [
        decide(
            Stage.SCATTERING,
            *(meshes or media, "there is no mesh"),
            *(bsdf is not None or media, "nothing reflects"),
            *(max_bounces > 0, "0 bounces"),
            "something reflects" if bsdf is not None else "a medium scatters",
        ),
        decide(Stage.MATERIALS, scatters, no, kinds, "all surfaces are Lambertian", other_kinds),
        decide(
            Stage.ABSORPTION,
            *(scatters or record.surrounding is not None, no),
            *(absorbs, "nothing absorbs"),
            "some glass absorbs" if record.surrounding is None else "the scene's medium weakens light",
        ),
        decide(Stage.MEDIA, scatters, no, media, "no medium scatters", "some medium scatters"),
        decide(
            Stage.DIRECT_LIGHT, scatters, no, samples_lights, "there are no lights", f"drawn: {_sampled_lights(record)}"
        ),
        decide(Stage.ONWARD_RAYS, scatters, no, onward, "no light could be met", bounces),
        decide(Stage.RUSSIAN_ROULETTE, onward, "no rays onwards", max_bounces > ROULETTE, "few bounces", roulette),
    ]


def _details(record: SceneRecord, max_bounces: int) -> list[Decision]:
    scatters, no = _scatters(record, max_bounces), "nothing scatters"
    normals = record.geometry is not None and record.geometry.normals is not None
    maps = record.textures is not None and record.textures.normal is not None
    textures = record.geometry is not None and record.geometry.uv is not None
    return [
        decide(Stage.VERTEX_NORMALS, scatters, no, normals, "meshes are flat", "meshes have normals"),
        decide(Stage.NORMAL_MAPS, scatters, no, maps, "no material has one", "textures turn normals"),
        decide(Stage.TEXTURES, textures, "no textures", "materials have textures"),
        decide(Stage.COLOUR, record.channels == 3, "all colours are grey", "colours differ"),
    ]
