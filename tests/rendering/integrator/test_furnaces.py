"""White furnaces: in a world of radiance 1, objects without absorption are invisible."""

import functools
import math
import sys
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl

sys.path.insert(0, str(Path(__file__).parent))
import pinholes  # noqa: E402
from pinholes import flat, pinhole  # noqa: E402

# What enters a body of glass near its rim can be caught between facets for long: 64 bounces lose 2e-3, 256 nothing.
radiance = functools.partial(pinholes.radiance, samples=64, seeds=8, max_bounces=300)

WHITE = {
    "lambertian": pl.Lambertian(1.0),
    "rough diffuse": pl.materials.RoughDiffuse(1.0, roughness=0.8),
    "plastic": pl.MetallicRoughness(1.0, 0.0, 0.4),
    "polished plastic": pl.MetallicRoughness(1.0, 0.0, 0.05),
    "half there": pl.MetallicRoughness(1.0, 0.0, 0.5, opacity=0.5),
    "mirror": pl.Conductor(),
    "glass": pl.Dielectric(1.5),
    "bubble in water": pl.Dielectric(1.0, exterior=1.33),
    "pane": pl.materials.ThinGlass(1.5),
}


def body(material, radius=6.0, segments=(24, 12), center=(0.0, 0.0, -40.0)):
    return flat(pl.sphere(radius, center=center, segments=segments, material=material))


# Of radiance 1.
WORLDS = {
    "constant": lambda meshes: pl.Scene(meshes, background=1.0),
    "mapped": lambda meshes: pl.Scene(meshes, background=pl.EnvironmentMap(np.ones((3, 5, 1)))),
    # A light all around: it is drawn, and met by chance, with weights that add up to 1.
    "shell": lambda meshes: pl.Scene([*meshes, pl.box(300.0, material=pl.Emissive(1.0, two_sided=True))]),
}


def assert_all_is(value, measured, case=None, least=1e-5):
    """All pixels together within standard errors, and an error of the whole that means something.

    `least` is the rounding of images to float32, and of the sums before it.
    """
    mean, error = measured
    whole = math.sqrt(np.square(error).sum()) / error.size
    assert whole < 5e-3, case
    assert abs(mean.mean() - value) < 4.5 * whole + least, (case, mean.mean(), whole)
    # Pixel by pixel, with Student's t for 8 renderings: beyond 11 once in 1e5. Pixels that hardly vary: to 0.01.
    assert np.all(np.abs(mean - value) < 11 * error + max(least, 0.01)), case


@pytest.mark.parametrize("world", WORLDS)
def test_white_bodies_vanish(world):
    # All of them in a world that is drawn and met by chance; in one that is only met, or mapped, one of each way to
    # scatter.
    for name in WHITE if world == "shell" else ("lambertian", "polished plastic", "half there", "glass", "pane"):
        assert_all_is(1.0, radiance(WORLDS[world]([body(WHITE[name])]), pinhole()), name)


def test_crowds_of_white_bodies_and_bodies_within_glass_vanish():
    # Light goes from one to the other and back.
    places = [(x, y, z) for x in (-4.2, 0.1, 4.1) for y in (-4.1, 0.2, 4.3) for z in (-44.0, -39.0)]
    materials = 2 * list(WHITE.values())
    crowd = [body(material, 1.8, (12, 6), place) for material, place in zip(materials, places, strict=True)]
    inner = [body(pl.Dielectric(index, exterior=1.5), 3.5, (20, 10)) for index in (1.33, 1.0, 1.8)]
    for k, bodies in enumerate((crowd, *([body(pl.Dielectric(1.5)), ball] for ball in inner))):
        assert_all_is(1.0, radiance(pl.Scene(bodies, background=1.0), pinhole(), samples=128), k)


def test_inside_a_medium_the_world_is_brighter_by_the_square_of_its_index():
    # A camera off the middle of a ball by 0.4 r: sines of incidence stay below 0.4, far from total reflection, by which
    # rays would be caught for ever.
    ball = flat(pl.sphere(10.0, segments=(48, 24), material=pl.Dielectric(1.5)))
    camera = pinhole(0.6).posed((2.0, 1.0, 3.3), (0.0, 5.0, -8.0))
    assert_all_is(1.5**2, radiance(pl.Scene([ball], background=1.0), camera))


def test_instances_vanish():
    # Stretched, turned, and mirrored: a mirrored body still has its inside within.
    turn = np.eye(4)
    turn[:3, :3] = [[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]]
    copies = [np.eye(4), np.eye(4)]
    copies[0][:3, 3], copies[1][:3, 3] = (-3.0, -1.0, -40.0), (3.5, 2.0, -44.0)
    for name, side in (("lambertian", -1), ("polished plastic", -1), ("glass", 1), ("glass", -1)):
        matrices = np.array([place @ turn @ np.diag([side * 1.3, 0.8, 1.1, 1.0]) for place in copies])
        group = pl.scene.Instances(body(WHITE[name], 2.5, (16, 8), (0.0, 0.0, 0.0)), matrices)
        assert_all_is(1.0, radiance(pl.Scene([group], background=1.0), pinhole()), (name, side))


def test_environment_maps_light_and_are_seen_as_they_say():
    # A Lambertian plate of albedo 1 returns 1 / pi times the integral of radiance and cosine; a mirror and the empty
    # view show the map itself. 64 x 32 texels, dark but for a few; quadrature over 1024 x 512 directions.
    texels = np.random.default_rng(2).random((32, 64, 1)) ** 8 * 20
    turn = np.array([[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]])
    world = pl.EnvironmentMap(texels, rotation=turn)
    up, azimuth = (np.arange(512) + 0.5) / 256 - 1, (np.arange(1024) + 0.5) * math.pi / 512
    s = np.sqrt(1 - up * up)[:, None]
    directions = np.stack(np.broadcast_arrays(s * np.cos(azimuth), s * np.sin(azimuth), up[:, None]), axis=-1).reshape(
        -1, 3
    )
    shone = world.radiance(directions)[:, 0]
    irradiance = (shone * np.maximum(directions[:, 2], 0)).mean() * 4 * math.pi
    plate = pl.quad((-50, -50, -40), (100, 0, 0), (0, 100, 0), material=pl.Lambertian(1.0))
    measured = radiance(pl.Scene([plate], background=world), pinhole(), samples=256)
    assert_all_is(irradiance / math.pi, measured, least=5e-3)
    # Pixels much smaller than texels, away from their borders: one texel.
    mirror = plate.with_material(pl.Conductor())
    for x, y in ((0.2, -0.07), (-0.6, 0.3), (0.03, 0.5)):
        camera = pinhole(1e-4).posed((0, 0, 0), (x, y, -1))
        rendered = radiance(pl.Scene(background=world), camera, samples=4, seeds=2)[0]
        np.testing.assert_allclose(rendered, world.radiance(np.array([[x, y, -1.0]]))[0, 0], rtol=1e-6)
        rendered = radiance(pl.Scene([mirror], background=world), camera, samples=4, seeds=2)[0]
        np.testing.assert_allclose(rendered, world.radiance(np.array([[x, y, 1.0]]))[0, 0], rtol=1e-6)
