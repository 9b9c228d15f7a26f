"""Scenes and thin-lens cameras as Mitsuba 3 has them (W. Jakob et al.; scalar_rgb), and its pictures of them."""

import dataclasses
import functools
from typing import NamedTuple

import mitsuba as mi
import numpy as np
from mitsuba_scenes import projected_solid_angles, thin_camera

import plenoptic as pl

mi.set_variant("scalar_rgb")

FAR = 1e7
"""mm. Mitsuba ends camera rays there."""
APART = 1e-3
"""mm. Between the two one-sided surfaces that stand for one that emits on both sides."""
SUN_DISTANCE = 1e5
"""mm. Of the disc that stands for one at infinity."""


class Picture(NamedTuple):
    """Radiance that pixels see, (H, W, 3), and its standard error."""

    image: np.ndarray
    standard_error: np.ndarray


def ours(scene, camera, *, samples, replicates=16, max_bounces=8, seed=1):
    """What this package renders, as radiance in three channels."""
    how = {"samples": samples, "replicates": replicates, "max_bounces": max_bounces, "seed": seed}
    shot = pl.render(scene, camera, truth=pl.Truth.NONE, progress=False, **how)
    white = projected_solid_angles(camera)
    # Pixels that no path found bright have the error of one sample, which Mitsuba's pictures have not.
    # Of a margin as thin as that around a pupil, where one path of 200 is lost, some pixels have met nothing in 1024
    # samples, and their replicates agree: errors are at least what one path brings.
    error = np.maximum(shot.standard_error, shot.image / samples) * (shot.image > 0)
    return Picture(*(np.broadcast_to(a / white, (*a.shape[:2], 3)) for a in (shot.image, error)))


def theirs(scene, camera, *, samples, seeds=16, max_bounces=8):
    """What Mitsuba renders; its standard error comes from independent pictures, one for each seed."""
    described = mi.load_dict(described_scene(scene, camera, max_bounces=max_bounces))
    each = samples // seeds
    pictures = np.array([np.array(mi.render(described, spp=each, seed=seed)) for seed in range(seeds)], dtype=float)
    return Picture(pictures.mean(axis=0), pictures.std(axis=0, ddof=1) / np.sqrt(seeds))


def described_scene(scene, camera, *, max_bounces):
    """All of a scene as `mitsuba.load_dict` takes it."""
    materials = [mesh.material for mesh in scene.meshes if isinstance(mesh, pl.Mesh)]
    glass = [material for material in materials if isinstance(material, pl.Dielectric)]
    absorbs = scene.medium is not None or any(np.any(one.absorption) or one.medium is not None for one in glass)
    media = [scene.medium, *(one.medium for one in glass)]
    coloured = any(one is not None and np.ptp(np.add(one.absorption, one.scattering)) > 0 for one in media)
    parts = {
        "type": "scene",
        # Mitsuba counts the parts of a path, of which there is one more than bounces. No Russian roulette.
        # volpath draws by the density of one channel alone; volpathmis gives nan now and then for grey media.
        "integrator": {
            "type": f"volpath{'mis' * coloured}" if absorbs else "path",
            "max_depth": max_bounces + 1,
            "rr_depth": 1 << 20,
        },
        "sensor": described_camera(camera),
    }
    if scene.medium is not None:
        parts["fog"] = described_medium(scene.medium)
        parts["sensor"]["medium"] = {"type": "ref", "id": "fog"}
        # Mitsuba's rays, and their way through the medium, begin at this distance.
        parts["sensor"]["near_clip"] = 0.01
    for i, mesh in enumerate((*scene.meshes, *scene.lights)):
        for k, part in enumerate(described(mesh)):
            parts[f"part_{i}_{k}"] = part
    if scene.background is not None:
        parts["background"] = described_background(scene.background)
    return parts


def described_camera(camera):
    thin, (rows, columns) = thin_camera(camera), camera.sensor.shape
    pose = pl.Pose(np.eye(3), np.zeros(3)) if camera.pose is None else camera.pose
    rotation = np.asarray(pose.rotation)
    origin = np.asarray(pose.position) + thin.z * rotation[:, 2]
    field = np.degrees(2 * np.arctan2(columns * camera.sensor.pixel_pitch / 2, thin.image_distance))
    lens = {"aperture_radius": thin.aperture_radius, "focus_distance": thin.object_distance}
    seen = {"to_world": _standing(origin, rotation), "fov": float(field), "fov_axis": "x"}
    film = {"type": "hdrfilm", "width": columns, "height": rows, "pixel_format": "rgb", "component_format": "float32"}
    film["rfilter"] = {"type": "box"}
    clipped = {"near_clip": 1.0, "far_clip": FAR}
    return {"type": "thinlens", **seen, **lens, **clipped, "film": film, "sampler": {"type": "independent"}}


@functools.singledispatch
def described(part):
    """The Mitsuba objects that stand for a mesh or a light."""
    raise TypeError(f"no Mitsuba object is known for a {type(part).__name__}")


@described.register
def _(mesh: pl.Mesh):
    material = mesh.material
    if not isinstance(material, pl.Emissive):
        return [_mesh(mesh, described_material(material))]
    front = _mesh(mesh, _black(), _area_light(material.radiance))
    if not material.two_sided:
        return [front]
    normals = np.cross(*(mesh.vertices[mesh.faces[:, k]] - mesh.vertices[mesh.faces[:, 0]] for k in (1, 2)))
    assert np.linalg.matrix_rank(normals, tol=1e-6) == 1, "only flat surfaces emit on both sides here"
    shift = -APART * normals[0] / np.linalg.norm(normals[0])
    back = pl.Mesh(mesh.vertices + shift, mesh.faces[:, ::-1], material)
    return [front, _mesh(back, _black(), _area_light(material.radiance))]


@described.register
def _(copies: pl.scene.Instances):
    return [part for matrix in copies.matrices for part in described(copies.mesh.transformed(matrix))]


@described.register
def _(light: pl.QuadLight):
    return described(light.mesh())


@described.register
def _(light: pl.lights.SphereLight):
    shape = {"type": "sphere", "center": light.center.tolist(), "radius": light.radius}
    return [{**shape, "material": _black(), "emitter": _area_light(light.radiance)}]


@described.register
def _(light: pl.lights.PointLight):
    return [{"type": "point", "position": light.position.tolist(), "intensity": colour(light.intensity)}]


@described.register
def _(light: pl.lights.SpotLight):
    cone = {"beam_width": np.degrees(light.inner_angle), "cutoff_angle": np.degrees(light.outer_angle)}
    place = _looking(light.position, light.direction)
    return [{"type": "spot", "to_world": place, "intensity": colour(light.intensity), **cone}]


@described.register
def _(light: pl.SunLight):
    if not light.angular_radius:
        return [{"type": "directional", "direction": light.direction.tolist(), "irradiance": colour(light.irradiance)}]
    place = _looking(-SUN_DISTANCE * light.direction, light.direction)
    size = mi.ScalarTransform4f().scale(3 * [float(SUN_DISTANCE * np.tan(light.angular_radius))])
    emitter = _area_light(light.radiance)
    return [{"type": "disk", "to_world": place @ size, "material": _black(), "emitter": emitter}]


def _looking(origin, direction):
    pose = pl.Pose.look_at(position=(0, 0, 0), target=direction, up=np.eye(3)[np.argmin(np.abs(direction))])
    return _standing(origin, np.asarray(pose.rotation))


def _standing(origin, rotation):
    """Mitsuba's cameras and spots look along their z, with x to the left. Its own look_at loses digits to float32."""
    matrix = np.eye(4)
    matrix[:3] = np.column_stack([-rotation[:, 0], rotation[:, 1], -rotation[:, 2], origin])
    return mi.ScalarTransform4f(matrix)


def _mesh(mesh, material, emitter=None):
    properties = mi.Properties()
    properties["mesh_bsdf"] = mi.load_dict(material)
    if emitter is not None:
        properties["mesh_emitter"] = mi.load_dict(emitter)
    if isinstance(mesh.material, pl.Dielectric) and mesh.material.medium is not None:
        properties["interior"] = mi.load_dict(described_medium(mesh.material.medium))
    elif isinstance(mesh.material, pl.Dielectric) and np.any(mesh.material.absorption):
        properties["interior"] = mi.load_dict(described_medium(pl.materials.Medium(mesh.material.absorption)))
    given = {"has_vertex_normals": mesh.normals is not None, "has_vertex_texcoords": mesh.uv is not None}
    made = mi.Mesh(mesh.name or "mesh", len(mesh.vertices), len(mesh.faces), props=properties, **given)
    arrays = mi.traverse(made)
    arrays["faces"] = np.ravel(mesh.faces).astype(np.uint32)
    for name, array in (("positions", mesh.vertices), ("normals", mesh.normals), ("texcoords", mesh.uv)):
        if array is not None:
            arrays[f"vertex_{name}"] = np.ravel(array).astype(np.float32)
    arrays.update()
    return made


def described_material(material):
    if isinstance(material, pl.Lambertian):
        return _on_both_sides({"type": "diffuse", "reflectance": colour(material.albedo)})
    if isinstance(material, pl.Conductor):
        return _on_both_sides(_described_conductor(material))
    if isinstance(material, pl.MetallicRoughness):
        return _described_layers(material)
    if isinstance(material, pl.Dielectric):
        rough = {"type": "roughdielectric", "distribution": "ggx", "alpha": material.alpha}
        kind = rough if material.alpha else {"type": "dielectric"}
        return {**kind, "int_ior": material.index, "ext_ior": material.exterior}
    if isinstance(material, pl.materials.ThinGlass):
        passing = {"specular_transmittance": colour(material.transmittance)}
        return {"type": "thindielectric", "int_ior": material.index, "ext_ior": 1.0, **passing}
    raise TypeError(f"no Mitsuba material is known for {material!r}")


def _described_layers(material):
    """Mitsuba knows this material only where it is a metal that reflects all, whatever the angle."""
    assert material.base == material.metallic == 1, "other layers have no counterpart"
    metal = _described_conductor(pl.Conductor(alpha=material.roughness**2))
    found = _on_both_sides(metal)
    if material.normal_map is not None:
        # As glTF wants it, the normals of the back are those of the front, reversed; Mitsuba reverses only their z.
        front, back = (
            {"type": "normalmap", "normalmap": colour(normals), "bsdf": metal}
            for normals in (material.normal_map, _turned(material.normal_map))
        )
        found = {"type": "twosided", "front": front, "back": back}
    if material.opacity != 1.0:
        found = {"type": "mask", "opacity": colour(material.opacity), "bsdf": found}
    return found


def _turned(normal_map):
    """The same bumps with the normals turned by half a turn about the surface's."""
    return dataclasses.replace(normal_map, texels=np.asarray(normal_map.texels) * [-1, -1, 1] + [1, 1, 0])


def _described_conductor(material):
    rough = {"type": "roughconductor", "distribution": "ggx", "alpha": material.alpha}
    kind = rough if material.alpha else {"type": "conductor"}
    kind["specular_reflectance"] = colour(material.reflectance)
    if material.index is None:
        return {**kind, "material": "none"}
    index = np.broadcast_to(material.index, 3)
    return {**kind, "eta": colour(index.real), "k": colour(index.imag)}


def described_medium(medium):
    extinction = np.broadcast_to(medium.absorption, 3) + np.broadcast_to(medium.scattering, 3)
    albedo = np.broadcast_to(medium.scattering, 3) / np.where(extinction > 0, extinction, 1.0)
    phase = {"type": "hg", "g": medium.phase.g}
    coefficients = {"sigma_t": colour(tuple(extinction)), "albedo": colour(tuple(albedo))}
    return {"type": "homogeneous", **coefficients, "phase": phase}


def described_background(background):
    """Of a smooth map, as Mitsuba has it: first and last row at the poles, left border ahead, bilinear."""
    if not isinstance(background, pl.EnvironmentMap):
        return {"type": "constant", "radiance": colour(background.radiance)}
    texels = np.roll(np.asarray(background.texels), -(background.texels.shape[1] // 2), axis=1)
    poles = [np.broadcast_to(row.mean(axis=0), (1, *row.shape)) for row in (texels[0], texels[-1])]
    nodes = np.concatenate([poles[0], 0.5 * (texels[:-1] + texels[1:]), poles[1]])
    turn = np.eye(4)
    if background.rotation is not None:
        turn[:3, :3] = background.rotation
    bitmap = mi.Bitmap(np.array(np.broadcast_to(nodes, (*nodes.shape[:2], 3)), dtype=np.float32))
    return {"type": "envmap", "bitmap": bitmap, "to_world": mi.ScalarTransform4f(turn)}


def _on_both_sides(material):
    return {"type": "twosided", "material": material}


def _black():
    return _on_both_sides({"type": "diffuse", "reflectance": colour(0.0)})


def _area_light(radiance):
    return {"type": "area", "radiance": colour(radiance)}


def colour(given):
    """A colour, or a bilinear texture that repeats; the first row of Mitsuba's is at v = 0."""
    if isinstance(given, pl.Texture):
        bitmap = mi.Bitmap(np.array(given.texels[::-1]))
        return {"type": "bitmap", "bitmap": bitmap, "raw": True, "filter_type": "bilinear"}
    return {"type": "rgb", "value": np.broadcast_to(given, 3).tolist()}
