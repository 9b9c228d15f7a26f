"""Calls with which scenes are made, with valid arguments."""

import functools

import numpy as np

import plenoptic as pl
from plenoptic import bsdf, lights, materials


@functools.cache
def scene():
    return pl.Scene([pl.box(50.0).translated(z=-400.0)], [pl.lights.PointLight((0, 100, 0), 1e4)], background=0.1)


def call(function, /, **given):
    return function, given


def scene_calls():
    """Name, function and valid arguments of each call."""
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0]])
    mesh, eye, texels = pl.box(2.0), np.eye(4), np.full((2, 2, 3), 0.5)
    return {
        "box": call(pl.box, size=(1.0, 2.0, 3.0), center=(0.0, 0.0, 0.0)),
        "sphere": call(pl.sphere, radius=2.0, center=(0.0, 0.0, 0.0), segments=(8, 4), material=pl.Lambertian()),
        "quad": call(pl.quad, corner=(0.0, 0, 0), edge_u=(1.0, 0, 0), edge_v=(0, 1.0, 0)),
        "turned": call(pl.shapes.turned, profile=[[1.0, 0.0], [0.0, 2.0]], segments=8),
        "checkerboard": call(pl.checkerboard, size=(4.0, 4.0), square=1.0, offset=(0.1, 0.2)),
        "Mesh": call(
            pl.Mesh, vertices=square, faces=[[0, 1, 2]], normals=square * 0 + [0, 0, 1.0], uv=square[:, :2], name="m"
        ),
        "transformed": call(mesh.transformed, matrix=eye),
        "translated": call(mesh.translated, x=1.0, y=2.0, z=3.0),
        "rotated": call(mesh.rotated, axis=(0.0, 0.0, 1.0), angle=0.5),
        "rotated_deg": call(mesh.rotated_deg, axis=(0.0, 0.0, 1.0), angle_deg=5.0),
        "scaled": call(mesh.scaled, factor=2.0),
        "Instances": call(pl.scene.Instances, mesh=mesh, matrices=np.tile(eye, (2, 1, 1))),
        "View": call(
            pl.scene.View,
            name="v",
            position=(0.0, 0, 0),
            look_at=(0.0, 0, -1),
            up=(0.0, 1, 0),
            vertical_field_of_view=0.5,
            aspect_ratio=1.5,
        ),
        "Scene": call(pl.Scene, meshes=[mesh], lights=[lights.PointLight((0, 0, 9))], background=(0.1, 0.2, 0.3)),
        "Scene.transformed": call(pl.Scene([mesh], [lights.PointLight((0, 0, 9))]).transformed, matrix=eye),
        "with_lights": call(scene().with_lights, lights=[lights.PointLight((0, 0, 9))]),
        "merged": call(scene().merged, other=scene()),
        "Lambertian": call(pl.Lambertian, albedo=(0.1, 0.2, 0.3)),
        "RoughDiffuse": call(materials.RoughDiffuse, albedo=0.5, roughness=0.4),
        "Conductor": call(pl.Conductor, reflectance=0.9, alpha=0.2),
        "Conductor.index": call(pl.Conductor, alpha=0.2, index=(1.0 + 2j, 0.5 + 2j, 0.2 + 3j)),
        "Dielectric": call(pl.Dielectric, index=1.5, alpha=0.1, absorption=0.01, exterior=1.0),
        "ThinGlass": call(materials.ThinGlass, index=1.5, transmittance=0.9),
        "Emissive": call(pl.Emissive, radiance=2.0, two_sided=False),
        "MetallicRoughness": call(
            pl.MetallicRoughness, base=0.5, metallic=0.2, roughness=0.4, emission=0.1, opacity=0.9, cutoff=0.5
        ),
        "Texture": call(pl.Texture, texels=texels),
        "bsdf.evaluate": call(
            bsdf.evaluate, material=pl.Lambertian(), to_viewer=(0.0, 0, 1.0), to_light=[[0.0, 0.6, 0.8]]
        ),
        "bsdf.draw": call(bsdf.draw, material=pl.Lambertian(), to_viewer=(0.0, 0, 1.0), points=[[0.1, 0.2, 0.3]]),
        "PointLight": call(lights.PointLight, position=(0.0, 0, 0), intensity=100.0),
        "SphereLight": call(lights.SphereLight, center=(0.0, 100.0, 0), radius=5.0, radiance=1.0),
        "SpotLight": call(
            lights.SpotLight,
            position=(0.0, 0, 0),
            direction=(0.0, 0, -1.0),
            intensity=9.0,
            inner_angle=0.2,
            outer_angle=0.5,
        ),
        "SpotLight.facing": call(lights.SpotLight.facing, position=(0.0, 0, 0), target=(0.0, 0, -1.0), intensity=9.0),
        "QuadLight": call(pl.QuadLight, center=(0.0, 100.0, 0), edge_u=(9.0, 0, 0), edge_v=(0, 0, 9.0), radiance=2.0),
        "QuadLight.facing": call(pl.QuadLight.facing, center=(0.0, 100.0, 0), target=(0.0, 0, -400.0), size=(9.0, 9.0)),
        "SunLight": call(pl.SunLight, direction=(0.0, 1.0, 1.0), irradiance=2.0, angular_radius=0.005),
        "from_angles": call(pl.SunLight.from_angles, azimuth=0.1, elevation=0.5, irradiance=2.0),
        "EnvironmentMap": call(pl.EnvironmentMap, texels=texels, rotation=np.eye(3)),
        "radiance": call(pl.EnvironmentMap(texels).radiance, directions=[[0.0, 0.0, 1.0]]),
    }
