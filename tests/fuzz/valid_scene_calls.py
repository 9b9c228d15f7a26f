"""Calls with which scenes are made, with valid arguments."""

import functools

import numpy as np

import plenoptic as pl
from plenoptic import bsdf, lights, materials


@functools.cache
def scene():
    return pl.Scene([pl.box(50.0).translated(z=-400.0)], [pl.lights.PointLight((0, 100, 0), 1e4)], background=0.1)


def scene_calls():
    """Name, function and valid arguments of each call."""
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0]])
    mesh, eye, texels = pl.box(2.0), np.eye(4), np.full((2, 2, 3), 0.5)
    return {
        "box": (pl.box, {"size": (1.0, 2.0, 3.0), "center": (0.0, 0.0, 0.0)}),
        "sphere": (
            pl.sphere,
            {"radius": 2.0, "center": (0.0, 0.0, 0.0), "segments": (8, 4), "material": pl.Lambertian()},
        ),
        "quad": (pl.quad, {"corner": (0.0, 0, 0), "edge_u": (1.0, 0, 0), "edge_v": (0, 1.0, 0)}),
        "turned": (pl.shapes.turned, {"profile": [[1.0, 0.0], [0.0, 2.0]], "segments": 8}),
        "checkerboard": (pl.checkerboard, {"size": (4.0, 4.0), "square": 1.0, "offset": (0.1, 0.2)}),
        "Mesh": (
            pl.Mesh,
            {
                "vertices": square,
                "faces": [[0, 1, 2]],
                "normals": square * 0 + [0, 0, 1.0],
                "uv": square[:, :2],
                "name": "m",
            },
        ),
        "transformed": (mesh.transformed, {"matrix": eye}),
        "translated": (mesh.translated, {"x": 1.0, "y": 2.0, "z": 3.0}),
        "rotated": (mesh.rotated, {"axis": (0.0, 0.0, 1.0), "angle": 0.5}),
        "rotated_deg": (mesh.rotated_deg, {"axis": (0.0, 0.0, 1.0), "angle_deg": 5.0}),
        "scaled": (mesh.scaled, {"factor": 2.0}),
        "Instances": (pl.scene.Instances, {"mesh": mesh, "matrices": np.tile(eye, (2, 1, 1))}),
        "View": (
            pl.scene.View,
            {
                "name": "v",
                "position": (0.0, 0, 0),
                "look_at": (0.0, 0, -1),
                "up": (0.0, 1, 0),
                "vertical_field_of_view": 0.5,
                "aspect_ratio": 1.5,
            },
        ),
        "Scene": (
            pl.Scene,
            {"meshes": [mesh], "lights": [lights.PointLight((0, 0, 9))], "background": (0.1, 0.2, 0.3)},
        ),
        "Scene.transformed": (pl.Scene([mesh], [lights.PointLight((0, 0, 9))]).transformed, {"matrix": eye}),
        "with_lights": (scene().with_lights, {"lights": [lights.PointLight((0, 0, 9))]}),
        "merged": (scene().merged, {"other": scene()}),
        "Lambertian": (pl.Lambertian, {"albedo": (0.1, 0.2, 0.3)}),
        "RoughDiffuse": (materials.RoughDiffuse, {"albedo": 0.5, "roughness": 0.4}),
        "Conductor": (pl.Conductor, {"reflectance": 0.9, "alpha": 0.2}),
        "Conductor.index": (pl.Conductor, {"alpha": 0.2, "index": (1.0 + 2j, 0.5 + 2j, 0.2 + 3j)}),
        "Dielectric": (pl.Dielectric, {"index": 1.5, "alpha": 0.1, "absorption": 0.01, "exterior": 1.0}),
        "ThinGlass": (materials.ThinGlass, {"index": 1.5, "transmittance": 0.9}),
        "Emissive": (pl.Emissive, {"radiance": 2.0, "two_sided": False}),
        "MetallicRoughness": (
            pl.MetallicRoughness,
            {"base": 0.5, "metallic": 0.2, "roughness": 0.4, "emission": 0.1, "opacity": 0.9, "cutoff": 0.5},
        ),
        "Texture": (pl.Texture, {"texels": texels}),
        "bsdf.evaluate": (
            bsdf.evaluate,
            {"material": pl.Lambertian(), "to_viewer": (0.0, 0, 1.0), "to_light": [[0.0, 0.6, 0.8]]},
        ),
        "bsdf.draw": (
            bsdf.draw,
            {"material": pl.Lambertian(), "to_viewer": (0.0, 0, 1.0), "points": [[0.1, 0.2, 0.3]]},
        ),
        "PointLight": (lights.PointLight, {"position": (0.0, 0, 0), "intensity": 100.0}),
        "SphereLight": (lights.SphereLight, {"center": (0.0, 100.0, 0), "radius": 5.0, "radiance": 1.0}),
        "SpotLight": (
            lights.SpotLight,
            {
                "position": (0.0, 0, 0),
                "direction": (0.0, 0, -1.0),
                "intensity": 9.0,
                "inner_angle": 0.2,
                "outer_angle": 0.5,
            },
        ),
        "SpotLight.facing": (
            lights.SpotLight.facing,
            {"position": (0.0, 0, 0), "target": (0.0, 0, -1.0), "intensity": 9.0},
        ),
        "QuadLight": (
            pl.QuadLight,
            {"center": (0.0, 100.0, 0), "edge_u": (9.0, 0, 0), "edge_v": (0, 0, 9.0), "radiance": 2.0},
        ),
        "QuadLight.facing": (
            pl.QuadLight.facing,
            {"center": (0.0, 100.0, 0), "target": (0.0, 0, -400.0), "size": (9.0, 9.0)},
        ),
        "SunLight": (pl.SunLight, {"direction": (0.0, 1.0, 1.0), "irradiance": 2.0, "angular_radius": 0.005}),
        "from_angles": (pl.SunLight.from_angles, {"azimuth": 0.1, "elevation": 0.5, "irradiance": 2.0}),
        "EnvironmentMap": (pl.EnvironmentMap, {"texels": texels, "rotation": np.eye(3)}),
        "radiance": (pl.EnvironmentMap(texels).radiance, {"directions": [[0.0, 0.0, 1.0]]}),
    }
