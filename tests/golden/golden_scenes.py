"""Scenes of the golden cases besides those of the package: each about 20 mm wide and around z = -404."""

import math

import numpy as np

import plenoptic as pl


def texture(channels, *, low=0.0, high=1.0, seed=0, size=(5, 7), **how):
    texels = np.random.default_rng(seed).uniform(low, high, (*size, channels))
    return pl.Texture(texels, **how)


def wall(material, z=-410.0, half=15.0):
    return pl.quad((-half, -half, z), (2 * half, 0, 0), (0, 2 * half, 0), material=material)


def ball(material, x=0.0, y=0.0, z=-404.0, radius=3.0):
    return pl.sphere(radius, center=(x, y, z), segments=(24, 12), material=material)


def lamp(radiance=6.0):
    return pl.QuadLight((5.0, 25.0, -370.0), (12, 0, 0), (0, 4, -11), radiance=radiance, two_sided=True)


def textured():
    """glTF's material with all of its textures: base, metallic, roughness, normals, emission and opacity."""
    wrap = pl.materials.Wrap
    mirrored, clamped = {"wrap": wrap.MIRROR}, {"wrap": (wrap.CLAMP, wrap.REPEAT)}
    painted = pl.MetallicRoughness(
        texture(3, seed=1, **mirrored),
        texture(1, seed=2, filter=pl.materials.TextureFilter.NEAREST),
        texture(1, low=0.2, seed=3, **clamped),
        normal_map=pl.Texture(texture(3, low=0.3, high=0.7, seed=4).texels + np.float32([0, 0, 0.3])),
        emission=texture(3, high=0.4, seed=5),
        opacity=texture(1, low=0.4, seed=6),
    )
    cut = pl.MetallicRoughness((0.3, 0.6, 0.2), roughness=0.7, opacity=texture(1, seed=7), cutoff=0.5)
    bodies = [ball(painted, -1.5), wall(cut, -408.0, 6.0), wall(pl.Lambertian(texture(3, seed=8, size=(9, 9))), -414.0)]
    return pl.Scene(bodies, [lamp()], background=(0.2, 0.25, 0.3))


def glasses():
    """Clear, absorbing and rough glass, one within another medium, and a pane."""
    absorbing = pl.Dielectric(1.52, absorption=(0.05, 0.3, 0.6))
    bodies = [
        ball(absorbing, -3.0, -1.0),
        ball(pl.Dielectric(1.6, 0.25), 3.0, -1.0),
        ball(pl.Dielectric(1.5, exterior=1.33), 0.0, 3.0, radius=1.5),
        wall(pl.materials.ThinGlass(1.5, (0.9, 0.8, 0.95)), -398.0, 5.0),
        wall(pl.materials.RoughDiffuse(texture(3, seed=9), 0.6)),
    ]
    return pl.Scene(bodies, [lamp(), pl.lights.SphereLight((-8.0, 10.0, -390.0), 2.0, (4.0, 5.0, 6.0))], background=0.1)


def under_water():
    """The camera in an absorbing ball of water, what it sees outside."""
    water = pl.sphere(380.0, segments=(48, 24), material=pl.Dielectric(1.33, absorption=(4e-3, 2e-3, 1e-3)))
    return pl.Scene([water, ball(pl.Lambertian(0.7)), wall(pl.Lambertian((0.3, 0.5, 0.7)))], background=0.6)


def metals():
    """Rough metals by index and by colour, and a mirror."""
    gold = (0.18 + 3.42j, 0.42 + 2.35j, 1.37 + 1.77j)
    bodies = [ball(pl.Conductor(index=gold, alpha=0.2), -3.0), ball(pl.Conductor((0.9, 0.7, 0.5), alpha=0.4), 3.0)]
    bodies += [ball(pl.Conductor(0.95), 0.0, 4.0, radius=1.5), wall(pl.Lambertian((0.6, 0.5, 0.4)))]
    return pl.Scene(bodies, [lamp((6.0, 5.0, 4.0))], background=0.2)


def sky():
    """A world image with a bright sun in it."""
    texels = np.random.default_rng(11).uniform(0.0, 1.0, (6, 12, 3))
    texels[1, 4] = 40.0
    c, s = math.cos(0.7), math.sin(0.7)
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    bodies = [
        ball(pl.Lambertian((0.7, 0.6, 0.5))),
        wall(pl.materials.RoughDiffuse(0.5, 0.8)),
        ball(pl.Conductor(0.9), 4.0, 3.0),
    ]
    return pl.Scene(bodies, background=pl.EnvironmentMap(texels, turn))


def all_lights():
    """A lamp, a ball, a point, a spot, a wide sun and a parallel one, a glowing thing, a world."""
    lights = [
        lamp((3.0, 2.0, 1.0)),
        pl.lights.SphereLight((-9.0, 8.0, -395.0), 1.5, 8.0),
        pl.lights.PointLight((6.0, -6.0, -395.0), (90.0, 60.0, 30.0)),
        pl.lights.SpotLight((0.0, 12.0, -385.0), (0.0, -0.5, -1.0), 400.0, 0.1, 0.5),
        pl.SunLight((0.3, -1.0, -0.6), 0.7, 0.05),
        pl.SunLight((-0.5, -0.2, -1.0), (0.1, 0.2, 0.3), 0.0),
    ]
    glow = pl.quad((-7, -7, -405), (2, 0, 0), (0, 2, 0), material=pl.Emissive((0.5, 1.5, 3.0)))
    bodies = [ball(pl.Lambertian(0.6)), wall(pl.Lambertian((0.5, 0.6, 0.7))), glow]
    return pl.Scene(bodies, lights, background=pl.EnvironmentMap(np.full((2, 4, 1), 0.1)))


def repeated():
    """One mesh at many places, turned and stretched, some mirrored."""
    rng = np.random.default_rng(13)
    matrices = np.tile(np.eye(4), (40, 1, 1))
    matrices[:, :3, :3] = rng.normal(0.0, 0.6, (40, 3, 3))
    matrices[:, :3, 3] = rng.uniform((-6, -6, -409), (6, 6, -400), (40, 3))
    body = ball(pl.MetallicRoughness((0.8, 0.4, 0.2), 0.3, 0.4), z=0.0, radius=1.2)
    nearer = matrices[::4].copy()
    nearer[:, 2, 3] += 4.0
    veil = pl.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), material=pl.MetallicRoughness(0.6, opacity=texture(1, seed=10)))
    things = [pl.scene.Instances(body, matrices), pl.scene.Instances(veil, nearer), wall(pl.Lambertian(0.5), -412.0)]
    return pl.Scene(things, [lamp()], background=0.15)


def bodies():
    """Without textures: for ground truth."""
    tilted = pl.Mesh([(-9, -9, -409), (9, -9, -416), (9, 9, -420), (-9, 9, -412)], [(0, 1, 2), (0, 2, 3)])
    seen = [ball(pl.Lambertian(0.3), -2.0), ball(pl.Conductor(0.9), 2.0, 1.0, -399.0, 1.5), tilted]
    return pl.Scene(seen, [pl.lights.SphereLight((3.0, -3.0, -401.0), 1.0, 2.0)])
