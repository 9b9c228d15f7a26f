"""Bundled cases of the study of costs: the reference camera with its scenes, and one with every part that there is."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.design.example import example_camera
from plenoptic.camera.shutter import Shutter
from plenoptic.core.motions.motion import Motion
from plenoptic.rendering.plan.plan import plan
from plenoptic.rendering.plan.stages import Plan
from plenoptic.rendering.settings import Caustics, Sampler
from plenoptic.scene.geometry.instance import Instances
from plenoptic.scene.lights.environment import EnvironmentMap
from plenoptic.scene.lights.point import PointLight
from plenoptic.scene.lights.sun import SunLight
from plenoptic.scene.materials.dielectric import Dielectric, ThinGlass
from plenoptic.scene.materials.emissive import Emissive
from plenoptic.scene.materials.metallic_roughness import MetallicRoughness
from plenoptic.scene.materials.registry import Material
from plenoptic.scene.scene import Scene
from plenoptic.scene.shapes.procedural import box, check_scene, objects_scene, quad, sphere
from plenoptic.scene.shapes.still_life import still_life
from plenoptic.scene.textures.texture import Texture
from plenoptic.study.cameras import furnished_camera
from plenoptic.truth.channels import Truth


def _furnished_scene(camera: PlenopticCamera) -> Scene:
    """A still life with every part that a scene can have, in front of a posed camera."""
    rng = np.random.default_rng(0)
    base = still_life()
    transforms = np.tile(np.eye(4), (6, 1, 1))
    transforms[:, :3, 3] = [(x, y, -400.0) for x in (-1.0, 0.0, 1.0) for y in (1.0, 2.0)]
    sky = EnvironmentMap(rng.uniform(0.1, 0.6, (4, 8, 3)))
    pane = ThinGlass(transmittance=(0.8, 0.9, 0.9))
    meshes = [
        *base.meshes,
        quad((-3, -3, -390), (6, 0, 0), (0, 6, 0), material=_curtain(rng)),
        quad((-7, -3, -390), (3, 0, 0), (0, 6, 0), material=pane),
        sphere(1.0, center=(2.0, 2.5, -398.0), material=Dielectric(1.5, absorption=(0.2, 0.1, 0.1))),
        box(0.6, center=(-2.0, 2.5, -398.0), material=Emissive(2.0)),
        Instances(box(0.4), transforms),
    ]
    lights = [*base.lights, PointLight((30, 40, -360), 2e3), SunLight((0.2, -1.0, -1.0), 0.5)]
    assert camera.pose is not None
    to_world = np.column_stack([camera.pose.rotation, camera.pose.position])
    return Scene(meshes, lights, sky).transformed(np.vstack([to_world, [0, 0, 0, 1]]))


def _curtain(rng: np.random.Generator) -> Material:
    """A woven material: colour, normals and opacity are textures."""
    normals = np.full((8, 8, 3), (0.5, 0.5, 1.0)) + rng.uniform(-0.1, 0.0, (8, 8, 3))
    return MetallicRoughness(
        Texture(rng.uniform(0.3, 0.9, (8, 8, 3))),
        normal_map=Texture(normals),
        opacity=Texture(rng.uniform(0.0, 0.5, (8, 8, 1))),
    )


def _furnished_plan() -> Plan:
    shake = Motion.screw((-1.0, 1.0), axis=(1.0, 2.0, 3.0), angle_deg=0.1, advance=0.5)
    camera = dataclasses.replace(furnished_camera(), shutter=Shutter(0.02, row_time=1e-5, motion=shake))
    settings: dict[str, Any] = {"caustics": Caustics.EXCLUDE, "clamp": 100.0, "sampler": Sampler.RANDOM}
    return plan(_furnished_scene(camera), camera, truth=Truth.ALL, **settings)


COST_CASES: dict[str, Callable[[], Plan]] = {
    "white": lambda: plan(None, example_camera()),
    "check": lambda: plan(check_scene(), example_camera()),
    "objects": lambda: plan(objects_scene(), example_camera()),
    "still_life": lambda: plan(still_life(), example_camera()),
    "furnished": _furnished_plan,
}
"""Makers of the plans of the bundled cases; "furnished" has every part that cameras and scenes can have."""
