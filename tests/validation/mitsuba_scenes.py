"""Small scenes around the origin of the world, and the thin-lens camera that looks at them."""

import dataclasses
from typing import NamedTuple

import numpy as np

import plenoptic as pl

VIEWED_FROM = 404 * np.array([0.1, 0.42, 0.9]) / np.linalg.norm([0.1, 0.42, 0.9])
"""mm, in the world."""


def camera(semi_diameter=2.0, pixel_pitch=0.15, position=VIEWED_FROM, pixels=48):
    """The double Gauss as a thin lens that looks down at the origin, 404 mm away; 22 mm there fill the picture."""
    lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter))
    design = pl.PlenopticCamera(lens.with_model(pl.LensModel.THIN), pl.Sensor((pixels, pixels), pixel_pitch), 130.0)
    return design.focused_at(z=-404.0).posed(position=position, look_at=(0, 0, 0), up=(0, 1, 0))


class ThinCamera(NamedTuple):
    """The lens model THIN with a round stop, as other renderers describe it: one plane at z, all in mm."""

    z: float
    aperture_radius: float
    image_distance: float
    object_distance: float


def thin_camera(camera):
    """Where the plane of the lens stands, and what is in focus: 1 / object distance + 1 / image distance = 1 / f."""
    assert camera.microlenses is None and camera.lens.model is pl.LensModel.THIN
    points = pl.paraxial.cardinal_points(camera.lens, camera.wavelength)
    image_distance = camera.z_sensor - points.rear_principal
    return ThinCamera(
        points.rear_principal,
        points.entrance_pupil_semi_diameter,
        image_distance,
        1.0 / (1.0 / points.efl - 1.0 / image_distance),
    )


def projected_solid_angles(camera):
    """(H, W, 1), sr: what the aperture is to the centres of pixels, and so the white image.

    The closed form for a disc and a parallel element off its axis: J. R. Howell, A Catalog of Radiation Heat Transfer
    Configuration Factors, B-13.
    """
    thin, (rows, columns), pitch = thin_camera(camera), camera.sensor.shape, camera.sensor.pixel_pitch
    row, column = np.indices((rows, columns))
    off_axis = pitch * np.hypot(row + 0.5 - rows / 2, column + 0.5 - columns / 2)
    h, r = off_axis / thin.image_distance, thin.aperture_radius / thin.image_distance
    z = 1 + h**2 + r**2
    return (np.pi / 2 * (1 - (z - 2 * r**2) / np.sqrt(z**2 - 4 * h**2 * r**2)))[..., None]


def wall(albedo=0.6, z=-8.0):
    return pl.quad((-20, -20, z), (40, 0, 0), (0, 40, 0), material=pl.Lambertian(albedo))


def floor(albedo=0.5, y=-8.0):
    return pl.quad((-20, y, 18), (40, 0, 0), (0, 0, -28), material=pl.Lambertian(albedo))


def tilted_box(size, center, material, *, turn=(30.0, 25.0)):
    block = pl.box(size, material=material).rotated_deg((0, 1, 0), turn[0]).rotated_deg((1, 0, 0), turn[1])
    return block.translated(*center)


def lamp(radiance=5.0):
    return pl.QuadLight.facing((-14, 24, 22), (0, 0, 0), (18, 18), radiance=radiance)


def lambertian_bodies():
    red = tilted_box((7, 8, 6), (-5, -3, 0), pl.Lambertian((0.8, 0.3, 0.2)))
    ball = pl.sphere(4.0, center=(5, -4, 1), material=pl.Lambertian((0.2, 0.4, 0.9)))
    board = [mesh.translated(z=-8) for mesh in pl.checkerboard((40, 40), 3.0)]
    return pl.Scene([red, ball, *board, floor()], [lamp()])


def open_box():
    """Walls on five sides around a block, under a bright sky: light between walls, eight times reflected."""
    walls = [
        pl.quad((-9, -9, -9), (18, 0, 0), (0, 18, 0), material=pl.Lambertian(0.9)),
        pl.quad((-9, -9, 9), (0, 0, -18), (0, 18, 0), material=pl.Lambertian((0.9, 0.2, 0.1))),
        pl.quad((9, -9, -9), (0, 0, 18), (0, 18, 0), material=pl.Lambertian((0.1, 0.8, 0.2))),
        pl.quad((-9, -9, 9), (18, 0, 0), (0, 0, -18), material=pl.Lambertian(0.8)),
    ]
    return pl.Scene([*walls, tilted_box(6, (1, -3, 0), pl.Lambertian(0.8))], background=(1.0, 0.9, 0.7))


def mirrors():
    """A mirror, and rough metals of constant reflectance.

    Where small mirrors hide each other, Mitsuba takes light and view as independent of each other. At the angles to the
    normals seen here, up to 60 degrees, and alpha up to 0.2 that makes no more than 1e-3.
    """
    flat = tilted_box((7, 7, 3), (-6, 4, 0), pl.Conductor(0.9), turn=(20, -25))
    tinted = tilted_box((8, 7, 3), (6, 4, 0), pl.Conductor((0.9, 0.6, 0.3), alpha=0.2), turn=(-25, -20))
    ball = pl.sphere(4.0, center=(0, -5, 1), material=pl.Conductor(0.8, alpha=0.1))
    return pl.Scene([flat, tinted, ball, wall((0.3, 0.5, 0.7)), floor(0.7)], [lamp(3.0)], background=0.2)


GOLD = (0.18 + 3.42j, 0.42 + 2.35j, 1.37 + 1.77j)


def metals():
    gold = tilted_box((8, 8, 3), (-6, 2, 0), pl.Conductor(index=GOLD, alpha=0.15), turn=(40, -30))
    silver = tilted_box((8, 8, 3), (6, 2, 0), pl.Conductor(0.9, index=1.2 + 7.0j), turn=(-50, -10))
    return pl.Scene([gold, silver, wall((0.7, 0.5, 0.3)), floor()], [lamp()], background=0.3)


def large_lamp():
    """Near and large, so that paths through glass meet it often."""
    return pl.QuadLight.facing((0, 22, 8), (0, -8, 0), (26, 20), radiance=3.0)


def glass():
    """A ball and a slab, and the light that they gather below and behind them."""
    ball = pl.sphere(4.0, center=(-5, -2, 0), segments=(256, 128), material=pl.Dielectric(1.5))
    slab = tilted_box((7, 9, 3), (5, -2, 0), pl.Dielectric(1.7), turn=(35, 10))
    return pl.Scene([ball, slab, wall((0.7, 0.4, 0.3)), floor(0.7)], [large_lamp()], background=0.1)


def coloured_glass():
    """Absorbing bodies; Mitsuba has a medium in them that scatters nothing."""
    blue = tilted_box(7, (-5, -3, 2), pl.Dielectric(1.3, absorption=(0.05, 0.2, 0.01)))
    grey = tilted_box((6, 6, 3), (6, -1, 2), pl.Dielectric(1.5, absorption=0.15), turn=(-20, 20))
    return pl.Scene([blue, grey, wall(0.7), floor(0.7)], [large_lamp()], background=0.5)


def _in_medium(medium, *meshes, lights):
    return pl.Scene([*meshes, wall(), floor()], lights, medium=medium)


def fog():
    """A lamp in a coloured medium that scatters backwards a little."""
    medium = pl.materials.Medium(0.0005, (0.0005, 0.001, 0.002), pl.materials.HenyeyGreenstein(-0.5))
    return _in_medium(medium, tilted_box(5, (-5, -3, 2), pl.Lambertian(0.7)), lights=[large_lamp()])


def haze():
    """Strongly forwards."""
    medium = pl.materials.Medium(0.0005, 0.002, pl.materials.HenyeyGreenstein(0.9))
    return _in_medium(medium, tilted_box(5, (-5, -3, 2), pl.Lambertian(0.7)), lights=[large_lamp()])


def cloud():
    """A body of index 1 that light from outside enters."""
    medium = pl.materials.Medium(0.01, (0.1, 0.2, 0.3), pl.materials.HenyeyGreenstein(0.6))
    body = tilted_box(8, (0, -2, 0), pl.Dielectric(1.0, medium=medium))
    return pl.Scene([body, wall(), floor()], [large_lamp()], background=0.5)


def murky_glass():
    """A body of glass with a medium in it."""
    medium = pl.materials.Medium((0.05, 0.02, 0.01), 0.15)
    return pl.Scene([tilted_box(8, (0, -2, 0), pl.Dielectric(1.3, medium=medium)), wall(), floor()], background=1.0)


def frosted_glass():
    plate = tilted_box((10, 10, 2), (-5, 0, 3), pl.Dielectric(1.5, alpha=0.15), turn=(20, 15))
    block = tilted_box((7, 7, 4), (7, -2, 3), pl.Dielectric(1.33, alpha=0.3), turn=(-30, 10))
    return pl.Scene([plate, block, wall((0.8, 0.4, 0.2)), floor(0.7)], [large_lamp()], background=0.3)


def small_lights():
    """A point, a cone that holds all that can be seen, and parallel light."""
    spot = pl.lights.SpotLight((-20, 5, 60), (20, -5, -60), (3000.0, 2000.0, 1000.0), inner_angle=0.8, outer_angle=0.9)
    sun = pl.SunLight((1, -2, -1.5), irradiance=(0.1, 0.3, 0.5), angular_radius=0.0)
    bodies = [tilted_box(6, (-4, -4, 0), pl.Lambertian(0.7)), pl.sphere(4.0, center=(5, 2, 0))]
    return pl.Scene([*bodies, wall(), floor()], [pl.lights.PointLight((10, 12, 14), 150.0), spot, sun])


def round_lights():
    """A sphere in the picture and a sun with soft shadows."""
    bodies = [tilted_box(6, (-5, -4, 0), pl.Lambertian((0.7, 0.5, 0.3))), wall(), floor()]
    sun = pl.SunLight((1, -2, -1.5), irradiance=(3.0, 2.4, 1.8), angular_radius=0.15)
    return pl.Scene(bodies, [pl.lights.SphereLight((5, 4, 1), 2.0, radiance=(1.0, 1.5, 2.0)), sun])


def sky_map(rows=256):
    """(rows, 2 rows, 3): a smooth sky with a bright spot at the upper left, bluish on the right."""
    polar = np.pi * (np.arange(rows) + 0.5) / rows
    azimuth = np.pi * ((np.arange(2 * rows) + 0.5) / rows - 1)
    x, z = np.sin(polar)[:, None] * np.sin(azimuth), -np.sin(polar)[:, None] * np.cos(azimuth)
    y = np.broadcast_to(np.cos(polar)[:, None], x.shape)
    spot = 40 * np.exp(60 * ((-0.5 * x + 0.6 * y + 0.624 * z) / np.hypot(np.hypot(0.5, 0.6), 0.624) - 1))
    return np.stack([0.3 + 0.2 * y + spot, 0.3 + 0.1 * z + 0.8 * spot, 0.4 + 0.3 * x + 0.5 * spot], axis=-1)


def environment():
    """The map itself is hidden behind a wall: it has texels here and is smooth there."""
    bodies = [
        wall(0.5),
        pl.sphere(4.0, center=(-5, 4, 0), material=pl.Lambertian(0.8)),
        pl.sphere(4.0, center=(5, 4, 0), segments=(256, 128), material=pl.Conductor(0.9)),
        tilted_box(6, (0, -5, 0), pl.Conductor(0.8, alpha=0.2)),
    ]
    return pl.Scene(bodies, background=pl.EnvironmentMap(sky_map()).rotated((1, 2, 3), 0.4))


def textured():
    """Texels of two sizes on upright and tilted surfaces, in part through a tinted pane, and on one that shines."""
    random = np.random.default_rng(4)
    coarse, fine = (pl.Texture(random.uniform(0, 1, (n, n + 2, 3))) for n in (5, 40))
    pane = pl.quad(
        (-10, -4, 6), (11, 0, 2), (0, 12, -2), material=pl.materials.ThinGlass(1.6, transmittance=(0.6, 0.9, 0.7))
    )
    picture = pl.quad((-20, -20, -8), (40, 0, 0), (0, 40, 0), material=pl.Lambertian(fine))
    block = tilted_box(8, (4, -3, 0), pl.Lambertian(coarse))
    glow = pl.quad((-9, -9, 4), (8, 0, 0), (0, 4, -6), material=pl.Emissive(coarse))
    return pl.Scene([picture, block, pane, glow], [lamp()], background=0.3)


def layers():
    """The material of glTF where it is a metal that reflects all: with a normal map, and there for some paths only.

    Mitsuba counts the way through what is not there as a bounce; after nine of them hardly any light is left here.
    """
    random = np.random.default_rng(8)
    share = pl.Texture(random.uniform(0, 1, (9, 9, 1)))
    bumps = random.uniform(-0.15, 0.15, (6, 6, 3)) + 0.5
    bumps[..., 2] = 1.0
    veil, dented = (
        pl.quad(corner, (9, 0, 2), (0, 10, -2), material=pl.MetallicRoughness(1.0, 1.0, roughness, **changes))
        for corner, roughness, changes in (
            ((-10, -6, 0), 0.4, {"opacity": share}),
            ((1, -5, 0), 0.35, {"normal_map": pl.Texture(bumps)}),
        )
    )
    return pl.Scene([veil, dented, wall((0.6, 0.4, 0.2)), floor(0.3)], [lamp()], background=0.1)


def copies():
    """One body in many places, enlarged, turned, sheared and mirrored."""
    random = np.random.default_rng(5)
    matrices = np.tile(np.eye(4), (24, 1, 1))
    matrices[:, :3, :3] = np.eye(3) + random.uniform(-0.7, 0.7, (24, 3, 3))
    matrices[::2, 0] *= -1
    matrices[:, :3, 3] = random.uniform(-9, 9, (24, 3)) * [1.0, 0.7, 0.5]
    body = pl.box((2.5, 1.5, 2.0), material=pl.Lambertian((0.8, 0.5, 0.3)))
    return pl.Scene([pl.scene.Instances(body, matrices), wall(), floor()], [lamp()], background=0.2)


def many_lights():
    """Sixty lamps of very different brightness all around."""
    random = np.random.default_rng(2)
    lamps = []
    for center in random.normal(size=(60, 3)):
        place = 30 * center / np.linalg.norm(center) + np.array([0.0, 0.0, 12.0])
        size = tuple(random.uniform(0.5, 4, 2))
        radiance = tuple(10 ** random.uniform(-0.5, 1.5) * random.uniform(0.3, 1, 3))
        lamps.append(pl.QuadLight.facing(place, (0, 0, 0), size, radiance=radiance))
    block = tilted_box(6, (-5, -3, 0), pl.Lambertian(0.7))
    ball = pl.sphere(4.0, center=(5, 3, 0), material=pl.Lambertian(0.8))
    return pl.Scene([block, ball, wall(), floor()], lamps)


def objects():
    """The reference scene, moved to the origin."""
    scene = pl.objects_scene()
    lights = [dataclasses.replace(light, center=np.add(light.center, (0, 0, 404))) for light in scene.lights]
    return pl.Scene([mesh.translated(z=404) for mesh in scene.meshes], lights, scene.background)


SCENES = (
    *(lambertian_bodies, open_box, mirrors, metals, glass, coloured_glass, frosted_glass, small_lights, round_lights),
    *(environment, textured, layers, copies, many_lights),
    *(fog, haze, cloud, murky_glass),
)
