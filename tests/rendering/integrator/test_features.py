"""Features of light transport, each against an equivalent scene without it."""

import dataclasses
import math
import sys
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.scene.lights import build_lights
from plenoptic.truth.channels import Truth

sys.path.insert(0, str(Path(__file__).parent))
from pinholes import flat, fresnel, pinhole  # noqa: E402

CAMERA = pinhole()


def shoot(scene, camera=CAMERA, samples=512, truth=Truth.NONE, **options):
    shot = pl.render(scene, camera, samples=samples, truth=truth, progress=False, **options)
    assert shot.stats.nonfinite == 0
    return shot


def brightness(camera=CAMERA, samples=512):
    """(H, W, 1): image of radiance 1, with the same seed."""
    return shoot(pl.Scene([], background=1.0), camera, samples).image.astype(float)


def mixed(shots, weights):
    """Images and squared errors of a weighted sum, the weights of which are numbers or (H, W, 1)."""
    image = sum(w * shot.image.astype(float) for shot, w in zip(shots, weights, strict=True))
    variance = sum((w * shot.standard_error.astype(float)) ** 2 for shot, w in zip(shots, weights, strict=True))
    return image, variance


def assert_same(one, other, rounding=3e-6, most_error=0.02):
    """Two renderings, or pairs of images and squared errors, within joint standard errors.

    8 replicates give an error 7 degrees of freedom, that of a difference up to 14: beyond 8 once in 1e6 (twice that
    where one of them alone is noisy). 4.5 for the sum. `rounding` is that of images to float32, and of what was before.
    """
    (a, va), (b, vb) = (x if isinstance(x, tuple) else mixed([x], [1.0]) for x in (one, other))
    error, allowed = np.sqrt(va + vb), rounding * np.abs(b).max()
    assert np.all(np.abs(a - b) < 12 * error + allowed), np.abs(a - b).max()
    whole, difference = np.sqrt(np.square(error).sum(axis=(0, 1))), (a - b).sum(axis=(0, 1))
    assert np.all(np.abs(difference) < 4.5 * whole + rounding * np.abs(b).sum()), (difference, whole)
    # An error bar so long that everything agrees would show nothing.
    assert np.all(whole < most_error * np.abs(b).sum(axis=(0, 1)) + allowed)


def plate(z, material, half=100.0):
    """Fronts towards the camera."""
    return pl.quad((-half, -half, z), (2 * half, 0, 0), (0, 2 * half, 0), material=material)


def nearest(values):
    """A texture of squares, one channel."""
    return pl.Texture(np.asarray(values, dtype=np.float32)[..., None], filter=pl.materials.TextureFilter.NEAREST)


MATT = pl.Lambertian(0.6)
BLACK = pl.Lambertian(0.0)
POINT = pl.lights.PointLight((14.0, 3.0, -20.0), 500.0)


QUARTERS = np.array([[0.0, 0.3], [0.7, 1.0]])


def opacity_of_pixels(values, pixels=8):
    """(H, W, 1): a texture of 2 x 2 squares over the whole view."""
    return np.kron(np.asarray(values), np.ones((pixels // 2, pixels // 2)))[..., None]


def test_what_is_half_there_looks_like_the_mean_of_there_and_not_there():
    # The plate fills the view exactly, so that the squares of its texture are quarters of the image. No light crosses
    # it but that of the wall to the camera.
    wall = plate(-60.0, pl.Emissive(nearest(np.arange(16.0).reshape(4, 4))), half=12.0)
    front = plate(-30.0, pl.MetallicRoughness(0.8, 0.2, 0.5), half=6.0)
    light = pl.lights.PointLight((5.0, 3.0, -10.0), 3000.0)
    present, absent = (shoot(pl.Scene(m, [light]), max_bounces=1) for m in ([wall, front], [wall]))
    assert 0.1 < present.image.mean() / absent.image.mean() < 10
    for fields, opacity in (
        ({"opacity": 0.3}, 0.3),
        ({"opacity": nearest(QUARTERS)}, opacity_of_pixels(QUARTERS)),
        ({"opacity": nearest(QUARTERS), "cutoff": 0.5}, opacity_of_pixels(QUARTERS >= 0.5)),
    ):
        half = front.with_material(dataclasses.replace(front.material, **fields))
        rendered = shoot(pl.Scene([wall, half], [light]), max_bounces=1, seed=1)
        # Pixels at the border between squares: the pinhole blurs by 1e-4 of 5 mm.
        assert_same(rendered, mixed([present, absent], [opacity, 1 - np.asarray(opacity)]), rounding=2e-3)


SHEET = pl.MetallicRoughness(0.0, 1.0, 1.0)  # black but for grazing angles


def test_shadows_of_layers_multiply():
    # Between a floor and a point light, beside the view. What shadow rays lose is not drawn but multiplied: no noise.
    floor = plate(-40.0, MATT)
    light = pl.lights.PointLight((120.0, 3.0, -10.0), 5e5)
    options = {"samples": 16, "max_bounces": 1, "replicates": 1}
    lit = shoot(pl.Scene([floor], [light]), **options).image
    assert lit.min() > 0
    for gap, opacities in ((1.0, [0.2, 0.5, 0.75]), (1e-3, [0.1] * 12), (1e-3, [1e-9, 0.5]), (1e-3, [0.5, 1.0])):
        sheets = [
            pl.quad((9.0, -90, k * gap - 34), (180, 0, 0), (0, 180, 0), material=dataclasses.replace(SHEET, opacity=o))
            for k, o in enumerate(opacities)
        ]
        shadow = shoot(pl.Scene([floor, *sheets], [light]), **options).image
        expected = lit * np.prod(1 - np.array(opacities))
        np.testing.assert_allclose(shadow, expected, rtol=2e-6, err_msg=f"{gap} {opacities}")


def test_a_stack_of_layers_lets_pass_what_all_of_them_do():
    # Seen through 1, 2, 4 and 8 layers in the four quarters of the view: 0.7 to that power. 1e-3 mm apart.
    layers = []
    for k in range(8):
        opacities = [[0.3, 0.3 * (k < 4)], [0.3 * (k < 2), 0.3 * (k < 1)]]
        material = dataclasses.replace(SHEET, opacity=nearest(opacities))
        layers.append(plate(-30.0 - 1e-3 * k, material, half=6.0))
    wall = plate(-60.0, pl.Emissive(2.0))
    rendered = shoot(pl.Scene([*layers, wall]), samples=2048, max_bounces=1)
    expected = brightness(samples=2048) * 2.0 * 0.7 ** opacity_of_pixels([[8, 4], [2, 1]])
    assert_same(rendered, (expected, 0.0), rounding=2e-3)


def test_truth_goes_through_what_is_less_than_half_there():
    for opacity, depth in ((0.49, 40.0), (0.5, 30.0), (0.0, 40.0), (1.0, 30.0)):
        material = dataclasses.replace(SHEET, opacity=opacity)
        scene = pl.Scene([plate(-30.0, material), plate(-35.0, material), plate(-40.0, MATT)])
        truth = pl.ground_truth(scene, CAMERA, truth=Truth.DEPTH | Truth.OBJECT | Truth.DISTANCE | Truth.NORMAL)
        # Two steps onto what is behind: some eps of 40 mm. The opening of the pinhole is 1e-4 of 10 mm wide.
        np.testing.assert_allclose(truth.depth, depth, rtol=1e-14)
        np.testing.assert_allclose(truth.distance[3, 3], depth * math.sqrt(1 + 2 * 0.025**2), rtol=1e-7)
        assert (truth.object == (0 if depth == 30 else 2)).all() and (truth.normal == (0, 0, 1)).all(), opacity
    # It follows textures and cutoffs.
    for cutoff, opaque in ((None, QUARTERS >= 0.5), (0.25, QUARTERS >= 0.25), (0.75, QUARTERS >= 0.75)):
        front = plate(-30.0, dataclasses.replace(SHEET, opacity=nearest(QUARTERS), cutoff=cutoff), half=6.0)
        depth = pl.ground_truth(pl.Scene([front, plate(-60.0, MATT)]), CAMERA, truth=Truth.DEPTH).depth
        np.testing.assert_allclose(depth, np.where(opacity_of_pixels(opaque)[..., 0], 30.0, 60.0), rtol=1e-14)


def test_what_is_not_there_at_all_changes_nothing():
    # Sheets across all light, seen, drawn and met by chance, inside an absorbing body.
    pool = pl.box((80, 80, 35), center=(0, 0, -35), material=pl.Dielectric(1.0, absorption=0.05))
    floor = plate(-40.0, pl.Conductor(0.9, alpha=0.3), half=30.0)
    lamp = pl.quad((9, -8, -38), (6, 0, 14), (0, 16, 0), material=pl.Emissive(30.0))
    sheets = [plate(z, dataclasses.replace(SHEET, opacity=1e-12), half=35.0) for z in (-20.0, -30.0, -39.0, -39.9)]
    without = shoot(pl.Scene([pool, floor, lamp]), samples=2048, max_bounces=3)
    assert_same(shoot(pl.Scene([pool, floor, lamp, *sheets]), samples=2048, max_bounces=3, seed=1), without)


def framed(opening, z=-60.0, half=200.0):
    """A black wall with a square hole of width 2 `opening`, filled by an object."""
    h, width = half - opening, 2 * opening
    pieces = ((-half, -half), 2 * half, h), ((-half, opening), 2 * half, h), ((-half, -opening), h, width)
    pieces = (*pieces, ((opening, -opening), h, width), ((-opening, -opening), width, width))
    *wall, window = (pl.quad((*corner, z), (u, 0, 0), (0, v, 0), material=BLACK) for corner, u, v in pieces)
    return wall, window.with_material(pl.Emissive(3.0))


def test_light_through_frosted_glass_is_the_same_drawn_or_met():
    # A window in a black wall behind a frosted plate, with a bright world behind, which is never drawn directly, or
    # with a light in it, which is. All else is black: the plate is as large as the wall.
    wall, window = framed(10.0)
    glass = pl.box((400, 400, 2), center=(0, 0, -40), material=pl.Dielectric(1.3, alpha=0.4, absorption=0.4))
    behind = pl.quad((-200, -200, 5), (0, 400, 0), (400, 0, 0), material=BLACK)  # behind the camera
    room = [behind, glass, *wall, shroud()]
    by_chance = shoot(pl.Scene(room, background=3.0), samples=2048, max_bounces=16)
    drawn = shoot(pl.Scene([*room, window]), samples=2048, max_bounces=16, seed=1)
    assert_same(drawn, by_chance)


def shroud():
    """Four black sides between z = 5 and z = -60, 200 mm from the axis."""
    body = pl.box((400, 400, 65), center=(0, 0, -27.5), material=BLACK)
    along_the_axis = np.ptp(body.vertices[body.faces][:, :, 2], axis=1) > 0
    return pl.Mesh(body.vertices, body.faces[along_the_axis], BLACK)


def places(*shifts, mirrored=()):
    """Turned and stretched along the axes of the mesh, some of them mirrored."""
    rng = np.random.default_rng(6)
    matrices = np.tile(np.eye(4), (len(shifts), 1, 1))
    turn = np.linalg.qr(rng.normal(size=(len(shifts), 3, 3)))[0]
    turn[:, :, 0] *= np.sign(np.linalg.det(turn))[:, None]
    for k in mirrored:
        turn[k, :, 1] *= -1
    matrices[:, :3, :3] = turn * rng.uniform(0.8, 1.3, (len(shifts), 1, 3))
    matrices[:, :3, 3] = shifts
    return matrices


SQUARES = np.kron([[0.2, 0.9, 0.4], [0.9, 0.1, 0.6], [0.3, 0.8, 0.9]], np.ones((2, 2)))


def groups():
    """Glass, a bulb that shines outwards, an open box whose front shines, and one with holes in it."""
    bulb = flat(pl.sphere(0.8, segments=(8, 6), material=pl.Emissive(20.0)))
    glass = flat(pl.sphere(2.0, segments=(12, 8), material=pl.Dielectric(1.5, absorption=0.2)))
    square = pl.quad((-2, -2, 0), (4, 0, 0), (0, 4, 0), material=pl.Emissive(nearest(10 * SQUARES)))
    paint = pl.MetallicRoughness(nearest(SQUARES), 0.2, 0.4, opacity=nearest(1 - SQUARES / 2))
    return [
        pl.scene.Instances(glass, places((-3.0, 2.5, -38), (3.5, -3.0, -36), mirrored=[1])),
        pl.scene.Instances(bulb, places((-5.0, -4.0, -36), (0.5, 6.0, -35), mirrored=[0])),
        pl.scene.Instances(square, places((5.0, 4.0, -37), (-5.5, 5.0, -36), mirrored=[1])),
        pl.scene.Instances(square.with_material(paint), places((0, 0, -35), mirrored=[0])),
    ]


@pytest.mark.slow
def test_instances_look_as_copies_do():
    floor = plate(-42.0, MATT)
    copies = [copy for group in groups() for copy in group.meshes()]
    truth = Truth.DEPTH | Truth.NORMAL | Truth.MATERIAL | Truth.OBJECT
    options = {"truth": truth, "samples": 2048, "max_bounces": 6}
    one = shoot(pl.Scene([floor, *groups()]), **options)
    other = shoot(pl.Scene([floor, *copies]), seed=1, **options)
    assert_same(one, other)
    # Rays at borders between triangles may find the other one, whose depth is the same.
    np.testing.assert_allclose(one.truth.depth, other.truth.depth, rtol=1e-12)
    np.testing.assert_allclose(one.truth.normal, other.truth.normal, rtol=0, atol=1e-12)
    assert np.array_equal(one.truth.material, other.truth.material) and len(np.unique(one.truth.material)) == 5
    assert set(np.unique(one.truth.object)) == {0, 1, 2, 3, 4}  # instances of one mesh are one object
    # Each kind of them matters.
    assert one.image.max() > 3 * one.image.min() > 0


def test_smooth_instances_are_shaded_as_copies_are():
    # The same paths. Normals of copies have unit length at corners, 7.5 degrees apart, and differ in between: by the
    # square of half of that, 4e-3, times the stretch.
    ball = pl.sphere(2.0, segments=(48, 32), material=MATT)
    group = pl.scene.Instances(ball, places((-2.5, 1.0, -36), (2.5, -1.0, -38), mirrored=[1]))
    one, other = (shoot(pl.Scene(some, [POINT]), samples=16, max_bounces=1).image for some in ([group], group.meshes()))
    assert (other > 0).mean() > 0.2
    np.testing.assert_allclose(one, other, rtol=0, atol=4e-3 * other.max())


def test_light_from_a_screen_is_that_of_its_pieces():
    # Beside the view, facing it; or each texel a piece of its own, where rows count downwards. Drawn over the whole
    # screen alike, or texel by texel by their power; met by chance and weighed, too.
    values = np.array([[0.0, 5.0, 1.0, 0.0], [30.0, 0.0, 0.0, 2.0], [0.0, 0.0, 8.0, 0.0]])
    corner, right, above = np.array([9.0, -8, -38]), np.array([6.0, 0, 14]), np.array([0.0, 16, 0])
    screen = pl.quad(corner, right, above, material=pl.Emissive(nearest(values)))
    u, v = right / 4, above / 3
    pieces = [
        pl.quad(corner + j * u + (2 - i) * v, u, v, material=pl.Emissive(value))
        for (i, j), value in np.ndenumerate(values)
    ]
    for material in (MATT, pl.Conductor(0.9, alpha=0.05)):
        floor = plate(-40.0, material)
        one = shoot(pl.Scene([floor, screen]), samples=4096, max_bounces=1)
        assert_same(one, shoot(pl.Scene([floor, *pieces]), samples=4096, max_bounces=1, seed=1))


def test_lights_that_are_drawn_bring_what_they_bring_by_chance():
    # A window in a black room, above the camera: with the bright world behind it, which is never drawn directly, or a
    # light in it.
    wall, window = framed(20.0, half=300.0)
    *wall, window = (mesh.rotated_deg((1, 0, 0), 180).translated(y=25, z=-58) for mesh in (*wall, window))
    settings = {"samples": 4096, "max_bounces": 1, "replicates": 16}
    for material in (MATT, pl.Conductor(0.9, alpha=0.1), pl.MetallicRoughness(0.7, 0.3, 0.4)):
        room = [plate(-40.0, material), *wall, shroud()]
        by_chance = shoot(pl.Scene(room, background=3.0), **settings)
        drawn = shoot(pl.Scene([*room, window]), seed=1, **settings)
        assert_same(drawn, by_chance)
        assert drawn.standard_error.mean() < 0.9 * by_chance.standard_error.mean(), material


def test_the_light_of_a_map_and_that_of_a_lamp_add_up():
    # One of them is drawn, by its share of their power: a seventh for the map. A point hides nothing of it.
    world = pl.EnvironmentMap(np.random.default_rng(3).random((4, 8, 1)))
    lamp = pl.lights.PointLight((120.0, 3.0, -10.0), 2e5)
    cases = ([lamp], world), ([lamp], 0.0), ([], world)
    both, *alone = (
        shoot(pl.Scene([plate(-40.0, MATT)], *case), samples=1024, max_bounces=1, seed=seed)
        for seed, case in enumerate(cases)
    )
    assert_same(both, mixed(alone, [1, 1]), most_error=2e-3)


def many_lamps():
    """Lamps of all kinds and brightnesses; some face away, or are hidden by the still life."""
    random = np.random.default_rng(4)
    lamps = [pl.lights.PointLight((6, -3, -30), (40.0, 80.0, 20.0)), pl.SunLight((0.3, -0.2, -1.0), 0.2)]
    lamps.append(pl.lights.SphereLight((-9, 6, -34), 1.0, radiance=(5.0, 2.0, 1.0)))
    for x, y in random.uniform(-14, 14, (15, 2)):
        target, radiance = random.normal((0, 0, -40), 6), 10 ** random.uniform(-0.5, 1.5)
        lamps.append(pl.QuadLight.facing((x, y, random.uniform(-32, -20)), target, (1.5, 2.0), radiance=radiance))
    return lamps


@pytest.mark.parametrize("material", [MATT, pl.Conductor(0.9, alpha=0.1), pl.MetallicRoughness(0.7, 0.3, 0.4)])
def test_lamps_of_which_one_is_chosen_bring_what_all_bring(monkeypatch, material):
    """By its contribution, of four; or each that is drawn counts, with more noise."""
    meshes, lamps, settings = still(material), many_lamps(), {"samples": 1024, "max_bounces": 2, "replicates": 16}
    drawn = shoot(pl.Scene(meshes, lamps), seed=1, **settings)
    monkeypatch.setattr(build_lights, "_MANY", len(lamps))
    chosen = shoot(pl.Scene(meshes, lamps), **settings)
    assert_same(chosen, drawn, most_error=0.03)
    assert np.mean(chosen.standard_error**2) < 0.85 * np.mean(drawn.standard_error**2)


def test_a_texture_of_one_value_is_that_value():
    # Each of them alone: what one of them needs is there without the others. The same random numbers for the same
    # things; float32 holds a quarter exactly.
    for name in ("base", "metallic", "roughness", "opacity", "emission"):
        values = 0.25, pl.Texture(np.full((2, 2, 1), 0.25))
        meshes = [plate(-40.0, pl.MetallicRoughness(**{name: value})) for value in values]
        images = [shoot(pl.Scene([mesh], [POINT], 0.5), samples=64, max_bounces=2).image for mesh in meshes]
        np.testing.assert_allclose(images[1], images[0], rtol=1e-6, err_msg=name)


def still(material=MATT):
    """A floor with a ball of another material and a wall on it."""
    ball = flat(pl.sphere(3.0, center=(-2, 1, -37), segments=(24, 12), material=pl.MetallicRoughness(0.8, 0.5, 0.3)))
    wall = pl.quad((4, -6, -40), (0, 0, 5), (0, 12, 0), material=MATT)
    return [plate(-40.0, material), ball, wall]


def test_a_sun_is_a_disc_of_a_map():
    # Row 0 of a map of 12 rows is the disc of angular radius pi / 12 around its pole, which is turned to the sun.
    rows, irradiance = 12, 3.0
    towards = np.array([0.48, 0.36, 0.8])
    sun = pl.SunLight(-towards, irradiance, math.pi / rows)
    texels = np.zeros((rows, 4, 1))
    texels[0] = sun.radiance
    x = np.cross(towards, [0, 0, 1.0])
    x /= np.linalg.norm(x)
    world = pl.EnvironmentMap(texels, rotation=np.column_stack([x, towards, np.cross(x, towards)]))
    assert world.radiance(towards[None])[0, 0] == pytest.approx(sun.radiance)
    drawn = shoot(pl.Scene(still(), [sun]), samples=1024, max_bounces=3)
    assert_same(drawn, shoot(pl.Scene(still(), background=world), samples=1024, max_bounces=3, seed=1))


def everything():
    """Coloured materials of all kinds, textures of all uses, instances and lights of all kinds."""
    rng = np.random.default_rng(7)
    paint = pl.Texture(rng.random((5, 7, 3)) * 0.9)
    bumps = np.concatenate([rng.uniform(-0.3, 0.3, (4, 4, 2)), np.ones((4, 4, 1))], axis=2)
    bumps = pl.Texture((bumps / np.linalg.norm(bumps, axis=2, keepdims=True) + 1) / 2)
    glow, veil = pl.Texture(0.2 * rng.random((3, 3, 3))), nearest(1 - SQUARES / 2)
    tile = pl.MetallicRoughness(paint, nearest(SQUARES), nearest(SQUARES / 2 + 0.4), normal_map=bumps)
    tile = dataclasses.replace(tile, emission=glow, opacity=veil)
    glass, bulb, screen_, _ = groups()
    glass = glass.with_material(pl.Dielectric(1.5, absorption=(0.05, 0.2, 0.4)))
    frosted = pl.sphere(1.5, center=(-4, -3, -38), segments=(16, 8), material=pl.Dielectric(1.4, 0.2, (0.3, 0.1, 0)))
    gold = pl.sphere(1.5, center=(3, 2, -39), segments=(16, 8), material=pl.Conductor(index=GOLD, alpha=0.15))
    mirror = pl.quad((-7, 3, -41), (5, 0, 0), (0, 4, 1), material=pl.Conductor((0.9, 0.8, 0.7)))
    pane = pl.quad((-1, -7, -37), (5, 0, 0), (0, 4, -1), material=pl.materials.ThinGlass(transmittance=(0.9, 0.5, 0.8)))
    floor = plate(-42.0, pl.materials.RoughDiffuse((0.6, 0.5, 0.3), 0.7))
    square = pl.quad((-2, -2, 0), (4, 0, 0), (0, 4, 0), material=tile)
    tiles = pl.scene.Instances(square, places((0, 0, -36), (6, -5, -39)))
    lights = [
        pl.SunLight((-0.3, -0.5, -1.0), (0.5, 0.4, 0.3), 0.05),
        pl.SunLight((0.3, -0.5, -1.0), (0.1, 0.2, 0.3), 0.0),
        pl.lights.PointLight((3, 8, -25), (90, 60, 30)),
        pl.lights.SpotLight((-8, 0, -20), (0.4, 0, -1.0), (50, 90, 70), 0.2, 0.5),
        pl.QuadLight((0, 15, -20), (0, 4, 0), (6, 0, 0), (5, 5, 9)),
        pl.lights.SphereLight((12, 4, -30), 1.0, (20, 9, 5)),
    ]
    world = pl.EnvironmentMap(rng.random((4, 8, 3)) * 0.3).rotated((1, 2, 3), 0.7)
    return pl.Scene([floor, glass, bulb, screen_, tiles, frosted, gold, mirror, pane], lights, world)


GOLD = (0.18 + 3.4j, 0.42 + 2.35j, 1.37 + 1.77j)


def test_the_same_bits_for_any_threads_tiles_and_regions():
    # Bundles of 16384 paths: of many pixels, and of parts of some.
    scene = everything()
    for more in ({}, {"clamp": 2.0, "caustics": pl.rendering.Caustics.EXCLUDE}):
        options = {"samples": 320, "truth": Truth.ALL, **more}
        whole = shoot(scene, threads=1, **options)
        other = shoot(scene, threads=3, tile_side=3, **options)
        assert np.array_equal(whole.image, other.image) and np.array_equal(whole.standard_error, other.standard_error)
        part = shoot(scene, threads=2, tile_side=2, region=np.s_[2:7, 1:4], **options)
        assert np.array_equal(whole.image[2:7, 1:4], part.image), more
        for name in ("depth", "normal", "position", "object", "material"):
            assert np.array_equal(getattr(whole.truth, name), getattr(other.truth, name)), name
            assert np.array_equal(getattr(whole.truth, name)[2:7, 1:4], getattr(part.truth, name)), name
        assert whole.image.min() > 0


@pytest.mark.slow
def test_wavelengths_see_what_channels_see():
    # At these wavelengths colours are lifted to spectra by their own channel, but for 3 % of red at 450 nm.
    lines = pl.sensor.Sensitivity.lines((640.0, 550.0, 450.0))
    basis = pl.sensor.rgb_basis(np.array([640.0, 550.0, 450.0]))
    assert basis[:2].tolist() == np.eye(3)[:2].tolist() and np.abs(basis[2] - (0, 0, 1)).max() < 0.03
    one = shoot(everything(), dataclasses.replace(CAMERA, sensitivity=lines), samples=3072)
    assert_same(one, shoot(everything(), samples=1024, seed=1), np.array([1e-5, 1e-5, 0.05]), most_error=0.05)


def test_what_is_clamped_away_is_what_is_missing():
    scene = everything()
    free = shoot(scene, samples=256)
    for clamp in (0.1, 10.0):
        less = shoot(scene, samples=256, clamp=clamp)
        left = less.image.sum(dtype=float) / free.image.sum(dtype=float)
        # The same paths; images are rounded to float32.
        assert left == pytest.approx(1 - less.stats.clamped, rel=1e-6)
        assert 0 < less.stats.clamped < 1 and np.all(less.image <= free.image)
        assert less.standard_error.sum() < free.standard_error.sum()
        # No path brings more than the clamp, and so no mean of paths does.
        assert np.all(less.image <= clamp * brightness(samples=256) * (1 + 1e-6))
    beyond = shoot(scene, samples=256, clamp=1e30)
    assert np.array_equal(beyond.image, free.image)
    assert beyond.stats.clamped == free.stats.clamped == 0.0
    for clamp in (0.0, float("nan"), float("inf"), "some"):
        with pytest.raises(pl.errors.InvalidValueError, match="clamp"):
            shoot(scene, clamp=clamp)


def test_without_mirrors_and_glass_there_are_no_caustics():
    lit = pl.Scene(still(), [POINT, pl.QuadLight((12, 0, -30), (0, 4, 0), (0, 0, 8), 5.0)], background=0.3)
    # Under a point light nothing is met by chance, so that with 1 bounce no ray is sent on. What is seen in mirrors is
    # no caustic.
    point = pl.Scene([plate(-40.0, MATT)], [POINT])
    ball = pl.sphere(5.0, center=(0, 0, -35), segments=(256, 128), material=pl.Conductor(0.9))
    mirrored = pl.Scene([plate(-40.0, BLACK, half=30.0), ball], background=1.0)
    for scene, bounces in ((lit, 8), (point, 0), (point, 1), (point, 2), (mirrored, 2)):
        options = {"samples": 64, "max_bounces": bounces}
        with_caustics, without = (
            shoot(scene, caustics=caustics, **options).image for caustics in pl.rendering.Caustics
        )
        assert np.array_equal(with_caustics, without) and (with_caustics.any() or bounces == 0), bounces
    said = "caustics is 'none'; it must be Caustics.INCLUDE or Caustics.EXCLUDE"
    with pytest.raises(pl.errors.InvalidValueError, match=said):
        shoot(lit, samples=64, caustics="none")


def test_caustics_are_the_light_that_a_mirror_throws_onto_a_floor():
    # A mirror ball above a small part of the floor, in a world of radiance 1. With two bounces, what the ball adds is
    # the share of directions, by their cosine, that meet it and are reflected past the floor.
    centre, radius, rho = np.array([4.0, 0.0, -35.0]), 3.0, 0.6
    ball = pl.sphere(radius, center=centre, segments=(256, 128), material=pl.Conductor())
    camera = pinhole(half=0.002, pixels=2)
    scene = pl.Scene([plate(-40.0, MATT, half=1e6), ball], background=1.0)
    with_caustics, without = (shoot(scene, camera, 1 << 15, max_bounces=2, caustics=c) for c in pl.rendering.Caustics)
    black = pl.Scene([scene.meshes[0], ball.with_material(BLACK)], background=1.0)
    shadow = shoot(black, camera, 1 << 15, max_bounces=2)
    # What is left out is all that the ball brings; the same paths but for those.
    np.testing.assert_allclose(without.image, shadow.image, rtol=1e-6)
    rng = np.random.default_rng(1)
    n = 1_000_000
    square, azimuth = rng.random(n), 2 * math.pi * rng.random(n)
    direction = np.column_stack(
        [np.sqrt(square) * np.cos(azimuth), np.sqrt(square) * np.sin(azimuth), np.sqrt(1 - square)]
    )
    away = np.array([0.0, 0.0, -40.0]) - centre
    b = direction @ away
    root = b * b - away @ away + radius**2
    hit = (root > 0) & (b < 0)
    normal = (away + (-b - np.sqrt(np.maximum(root, 0)))[:, None] * direction) / radius
    reflected = direction - 2 * np.sum(direction * normal, axis=1, keepdims=True) * normal
    fraction = (hit & (reflected[:, 2] > 0)).mean()
    caustics = (with_caustics.image.astype(float) - without.image) / brightness(camera, 1 << 15)
    # 2^17 paths, and a million directions: sqrt(share (1 - share) / n), 1 % together. The view is 0.16 mm wide.
    error = math.sqrt(fraction * (1 - fraction) * (1 / (4 << 15) + 1 / n))
    assert 0.01 < fraction < 0.3 and error < 0.02 * fraction
    assert caustics.mean() == pytest.approx(rho * fraction, abs=4.5 * rho * error + 1e-3 * fraction)


def test_the_caustic_of_a_glass_ball_lies_under_it():
    # A lamp above a glass ball above a floor: a bright spot on its axis, next to nothing far from it; the ball itself,
    # and the floor seen through it, stay.
    ball = pl.sphere(2.0, center=(0, 0, -35), segments=(64, 32), material=pl.Dielectric(1.5))
    lamp = pl.QuadLight((0, 0, 30), (0, 16, 0), (16, 0, 0), radiance=30.0)
    camera = pinhole(0.6, 12).posed((18.0, 0, -20), (0, 0, -40))
    scene = pl.Scene([plate(-40.0, MATT), ball], [lamp])
    with_caustics, without = (shoot(scene, camera, 2048, max_bounces=4, caustics=c) for c in pl.rendering.Caustics)
    # The same paths, some of which bring nothing now.
    difference = with_caustics.image[..., 0].astype(float) - without.image[..., 0]
    assert np.all(difference >= -1e-6 * with_caustics.image.max())
    truth = pl.ground_truth(scene, camera, truth=Truth.POSITION | Truth.OBJECT)
    off = np.linalg.norm(truth.position[..., :2], axis=-1)
    assert off[difference > 0.5 * difference.max()].max() < 3.0
    assert difference[(truth.object == 0) & (off > 10.0)].mean() < 0.02 * difference.max()
    # The whole noise is that of the caustic.
    at = np.unravel_index(difference.argmax(), difference.shape)
    assert without.standard_error[at] < 0.5 * with_caustics.standard_error[at]


def test_absorption_goes_on_behind_a_body_within_a_body():
    # A lamp seen through a pool, 1.5 mm to an inner body of 2 mm, which absorbs nothing, and 2 mm behind it; straight
    # on, and at 50 degrees. Radiance leaves the pool with T / n^2, as solid angles widen by n^2 and T passes; the lamp
    # is black, so that nothing is reflected to and fro.
    camera, n = pinhole(half=0.002, pixels=2), 1.33
    pool = pl.box((600, 600, 40), center=(0, 0, -20), material=pl.Dielectric(n, absorption=0.3))
    inner = pl.box((200, 200, 2), center=(0, 0, -2.5), material=pl.Dielectric(n, exterior=n))
    bodies = pool, inner, plate(-5.5, pl.Emissive(2.0), half=250.0)
    for tilt_deg in (0.0, 50.0):
        scene = pl.Scene([body.rotated_deg((0, 1, 0), tilt_deg).translated(z=-100) for body in bodies])
        rendered = (shoot(scene, camera, samples=1 << 14, max_bounces=8).image / brightness(camera, 1 << 14)).mean()
        cosine = math.cos(math.radians(tilt_deg))
        path_length = 3.5 / math.sqrt(1 - (1 - cosine**2) / n**2)
        expected = 2.0 * (1 - fresnel(cosine, n)) / n**2 * math.exp(-0.3 * path_length)
        np.testing.assert_allclose(rendered, expected, rtol=5e-3, err_msg=f"{tilt_deg}")
    # A camera in a body knows it, whatever stands in the way: a cube in the direction by which its medium is found.
    pool, lamp = pl.box(100.0, material=pl.Dielectric(1.0, absorption=0.1)), plate(-30.0, pl.Emissive(2.0), half=20.0)
    cube = pl.box(2.0, center=(3.6, 4.8, 8.0), material=pl.Dielectric(1.5))
    rendered = shoot(pl.Scene([pool, cube, lamp]), camera, samples=64, max_bounces=2).image / brightness(camera, 64)
    np.testing.assert_allclose(rendered, 2.0 * math.exp(-3.0), rtol=1e-5)


def test_emitters_that_repeat_each_other_shine_once():
    lamp = pl.quad((-2, 2, -30), (0, -4, 0), (4, 0, 0), material=pl.Emissive(5.0))
    assert lamp.vertices[lamp.faces[0]].shape == (3, 3)
    again = pl.Mesh(lamp.vertices, np.concatenate([lamp.faces, lamp.faces[:, [1, 2, 0]]]), lamp.material)
    floor = plate(-40.0, MATT)
    once, twice = (shoot(pl.Scene([floor, body]), samples=2048, max_bounces=1) for body in (lamp, again))
    assert_same(once, twice)
    # Two that face away from each other are two.
    back = pl.Mesh(lamp.vertices, np.concatenate([lamp.faces, lamp.faces[:, ::-1]]), lamp.material)
    assert len(pl.Scene([floor, back]).tables().lights.items) == 4
