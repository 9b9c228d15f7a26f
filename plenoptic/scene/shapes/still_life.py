"""A still life of all kinds of surfaces."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.scene.lights.quad import QuadLight
from plenoptic.scene.materials.conductor import Conductor
from plenoptic.scene.materials.dielectric import Dielectric
from plenoptic.scene.materials.diffuse import Lambertian, RoughDiffuse
from plenoptic.scene.materials.metallic_roughness import MetallicRoughness
from plenoptic.scene.scene import Scene
from plenoptic.scene.shapes.procedural import box, checkerboard, quad, sphere, turned

_GOLD = (0.18 + 3.42j, 0.42 + 2.35j, 1.37 + 1.77j)


def still_life() -> Scene:
    """A small still life around z = -404 in the camera's frame, 16 mm wide: the scene of the first example.

    On a chequered table, from the left: a vase with a blue glaze (`MetallicRoughness`), a ball of glass (`Dielectric`)
    before it, a block of green plaster (`RoughDiffuse`) with a small ball of brushed gold (`Conductor`) on it, a matt
    red ball (`Lambertian`) in front on the right and a mirror ball (`Conductor`) behind it; a grey wall behind all.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.still_life()
    Scene(9 meshes, 78838 triangles, 1 light, background 0.25)
    """
    squares = checkerboard((44, 90), 2.0, even=Lambertian((0.75, 0.7, 0.6)), odd=Lambertian((0.2, 0.15, 0.12)))
    table = [mesh.rotated_deg((1, 0, 0), -90).translated(0, -5, -400) for mesh in squares]
    t = np.linspace(0, 1, 49)
    swell = 1.1 + 0.9 * np.sin(1.15 * math.pi * t + 0.35) ** 2
    glaze = MetallicRoughness((0.12, 0.25, 0.7), roughness=0.2)
    vase = turned(np.stack([swell, 7.5 * t], axis=1), material=glaze).translated(-4.2, -5, -412)
    plaster = RoughDiffuse((0.35, 0.6, 0.3), roughness=0.8)
    block = box(3.4, material=plaster).rotated_deg((0, 1, 0), 32).translated(0.7, -3.3, -404)
    balls = (
        sphere(1.0, center=(0.7, -0.6, -404), material=Conductor(index=_GOLD, alpha=0.15)),
        sphere(1.6, center=(4.0, -3.4, -393), material=Lambertian((0.8, 0.12, 0.1))),
        sphere(2.2, center=(4.8, -2.8, -411), material=Conductor(0.95)),
        sphere(1.3, center=(-2.6, -3.7, -396), material=Dielectric(1.5)),
    )
    objects = (*table, vase, block, *balls)
    # The table leans towards the camera, which sees its top that way.
    leaning = [mesh.translated(y=3, z=404).rotated_deg((1, 0, 0), 15).translated(y=-3, z=-404) for mesh in objects]
    wall = quad((-22, -30, -446), (44, 0, 0), (0, 70, 0), material=Lambertian((0.55, 0.6, 0.62)))
    light = QuadLight.facing((-35, 55, -350), (0, -2, -404), (48, 48), radiance=5.0)
    return Scene([*leaning, wall], [light], background=0.25)
