"""Light transport against closed forms: radiance seen through a pinhole."""

import functools
import math
import sys
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl

sys.path.insert(0, str(Path(__file__).parent))
from pinholes import flat, fresnel, irradiance_of_polygon, pinhole, radiance  # noqa: E402


def directions(camera, parts):
    """(H, W, parts^2, 3) unit directions into the world from places spread over each pixel, and their weights cos^4.

    The grid of places is sheared both ways, so that all have their own x and y: edges along pixels are met finely.
    """
    (rows, columns), pitch, d = camera.sensor.shape, camera.sensor.pixel_pitch, camera.stop_to_microlenses
    i, j = np.meshgrid(np.arange(parts), np.arange(parts))
    inside = ((i + (j + 0.5) / parts) / parts).ravel(), ((j + (i + 0.5) / parts) / parts).ravel()
    x = (np.arange(columns)[:, None] + inside[0] - columns / 2) * pitch / d
    y = -(np.arange(rows)[:, None] + inside[1] - rows / 2) * pitch / d
    x, y = np.broadcast_arrays(x[None], y[:, None])
    direction = np.stack([x, y, np.full(x.shape, -1.0)], axis=-1)
    length = np.linalg.norm(direction, axis=-1)
    direction = direction / length[..., None]
    return (direction if camera.pose is None else direction @ camera.pose.rotation.T), length**-4.0


def expected_image(camera, seen, parts=16):
    """(H, W): mean over each pixel of seen(origin, directions), which returns radiances."""
    direction, weight = directions(camera, parts)
    origin = np.zeros(3) if camera.pose is None else camera.pose.position
    values = seen(origin, direction.reshape(-1, 3)).reshape(weight.shape)
    return (values * weight).sum(axis=2) / weight.sum(axis=2)


def assert_agree(measured, expected, bias=1e-3, case=None):
    """Each pixel, and all together, within standard errors and a `bias` of the largest value expected.

    Errors from 16 renderings follow Student's t with 15 degrees of freedom: beyond 6.5 once in 1e5. 4.5 errors for the
    sum. The bias is the error of the closed form, and the rounding of images to float32.
    """
    mean, error = measured[0][:, :, 0], measured[1][:, :, 0]
    allowed = bias * float(np.max(expected))
    difference, whole = mean - expected, math.sqrt(np.square(error).sum())
    assert np.all(np.abs(difference) < 6.5 * error + allowed), (case, np.abs(difference).max())
    assert abs(difference.sum()) < 4.5 * whole + allowed * difference.size, (case, difference.sum())
    # An error bar so long that everything agrees would show nothing.
    assert whole < 0.02 * np.abs(expected).sum() + allowed, case


def where_met(origin, way, z):
    """Points of the plane at z; origin (3,) or one of each way."""
    return origin + ((z - origin[..., 2]) / way[:, 2])[:, None] * way


FLOOR_Z, UP = -40.0, (0.0, 0.0, 1.0)


def floor(material, half=100.0):
    return pl.quad((-half, -half, FLOOR_Z), (2 * half, 0, 0), (0, 2 * half, 0), material=material)


def test_lights_of_all_sizes_follow_the_inverse_square():
    # Radiance of a floor of albedo rho: rho / pi I cos / d^2. A sphere of uniform radiance L, all of it above the
    # horizon, irradiates a surface by pi L (r / d)^2 cos, as would a point of intensity I = pi r^2 L in its middle.
    # Facets: a sphere of 1280 is off by some 1e-3 close by. Of spots (glTF 2.0, KHR_lights_punctual) I falls as the
    # square of the cosine's place between those of the outer and the inner angle.
    camera, place, axis, (inner, outer) = pinhole(), (16.0, 3.0, -30.0), np.array([-1.4, -0.2, -1.0]), (0.08, 0.3)
    spot = pl.lights.SpotLight(place, axis, 500.0, inner_angle=inner, outer_angle=outer)

    def seen(origin, way, light):
        to_light = np.subtract(place, where_met(origin, way, FLOOR_Z))
        d = np.linalg.norm(to_light, axis=1)
        cosine = -to_light @ axis / d / np.linalg.norm(axis)
        between = np.clip((cosine - math.cos(outer)) / (math.cos(inner) - math.cos(outer)), 0, 1)
        return 0.6 / math.pi * 500.0 * (between**2 if light is spot else 1.0) * to_light[:, 2] / d**3

    balls = {r: pl.lights.SphereLight(place, r, 500.0 / (math.pi * r**2)) for r in (1e-6, 0.3, 5.0)}
    for name, light in {"point": pl.lights.PointLight(place, 500.0), "spot": spot, **balls}.items():
        measured = radiance(pl.Scene([floor(pl.Lambertian(0.6))], [light]), camera, max_bounces=1)
        expected = expected_image(camera, functools.partial(seen, light=light), parts=200)
        assert (expected == 0).any() == (light is spot)
        assert_agree(measured, expected, {"point": 3e-4, "spot": 1e-3}.get(name, 4e-3), name)


def test_lambertian_sphere_under_a_sun():
    # rho E cos / pi. 256 x 128 facets with smooth normals: off by the square of the half angle between facets, 2e-4,
    # and along the terminator, where facets turn away before their normals do, by that angle, 0.012, in part of pixels.
    camera, travels = pinhole(), np.array([-1.0, -0.4, -0.2])
    travels /= np.linalg.norm(travels)
    centre, r = np.array([0.0, 0.0, -40.0]), 12.0
    ball = pl.sphere(r, center=centre, segments=(256, 128), material=pl.Lambertian(0.6))

    def seen(origin, way):
        b = way @ (origin - centre)
        t = -b - np.sqrt(b * b - (origin - centre) @ (origin - centre) + r * r)
        cosine = (origin + t[:, None] * way - centre) / r @ -travels
        return 0.6 * 3.0 / math.pi * np.maximum(cosine, 0)

    expected = expected_image(camera, seen)
    assert (expected == 0).any() and (expected > 0.3).any()
    assert_agree(radiance(pl.Scene([ball], [pl.SunLight(travels, 3.0)]), camera, max_bounces=1), expected, bias=6e-3)


LIGHTS = {
    "parallel square": ((0.0, 9.0, -20.0), (0, 6, 0), (6, 0, 0), 0.0),
    "standing on the floor": ((9.0, 0.0, -30.0), (0, 0, 20), (0, 50, 0), 0.0),
    "hovering above the floor": ((0.0, 0.0, -39.95), (0, 5, 0), (5, 0, 0), -39.98),
    "edge above the view": ((2.5, 0.0, -39.95), (0, 5, 0), (5, 0, 0), -39.98),
}


def test_form_factors_of_quads():
    # Parallel, perpendicular and touching, nearly touching, with the camera in the gap: rho / pi times Lambert's
    # polygon formula. 8 x 8 places a pixel resolve the rise towards a light 1 mm away.
    for place, (*sides, height) in LIGHTS.items():
        center, u, v = (np.array(x, dtype=float) for x in sides)
        light = pl.QuadLight(center, u, v, radiance=7.0)
        assert light.normal[2] < 0 or light.normal[0] < 0
        corners = center + 0.5 * np.array([-u - v, u - v, u + v, -u + v])
        camera = pinhole() if height == 0 else pinhole(0.5).posed((0, 0, height), (0, 0, FLOOR_Z))

        def seen(origin, way, corners=corners):
            return 7.0 * 0.6 / math.pi * irradiance_of_polygon(where_met(origin, way, FLOOR_Z), UP, corners)

        scene = pl.Scene([floor(pl.Lambertian(0.6))], [light])
        assert_agree(radiance(scene, camera, max_bounces=1), expected_image(camera, seen, parts=8), 2e-3, place)
    # The formula itself, for a square of side 2 a at height h above its middle: F = 4 / pi A atan(A),
    # A = a / sqrt(a^2 + h^2).
    corners = np.column_stack([np.array([(-1, -1), (-1, 1), (1, 1), (1, -1)]) * 10.0, np.full(4, 8.0)])
    factor = irradiance_of_polygon(np.zeros((1, 3)), UP, corners)[0] / math.pi
    ratio = 10.0 / math.hypot(10.0, 8.0)
    assert factor == pytest.approx(4 / math.pi * ratio * math.atan(ratio), rel=1e-12)


def test_all_that_glows_gives_light():
    # Seen directly, in a mirror, and on a floor: radiance times opacity each time. One bounce: what it reflects itself
    # is not in it.
    corners = np.array([(5.0, -2, -38), (5, 2, -38), (9, 2, -38), (9, -2, -38)])
    base, shaded = floor(pl.Lambertian(0.6)), pinhole(0.05).posed((-10, 0, -39), (-2, 0, FLOOR_Z))

    def seen(origin, way):
        return 2.0 * 0.6 / math.pi * irradiance_of_polygon(where_met(origin, way, FLOOR_Z), UP, corners)

    expected = expected_image(shaded, seen)
    for name, material in {
        "emissive": pl.Emissive(2.0),
        "glowing plastic": pl.MetallicRoughness(0.5, 0.2, 0.5, emission=2.0),
        "glowing veil": pl.MetallicRoughness(0.5, 0.2, 0.5, emission=8.0, opacity=0.25),
    }.items():
        lamp = pl.quad((5.0, -2, -38), (0, 4, 0), (4, 0, 0), material=material)
        assert_agree(radiance(pl.Scene([base, lamp]), shaded, max_bounces=1), expected, 2e-3, name)
        below = pinhole(0.02, pixels=4).posed((7, 0, -50), (7, 0, -38))
        assert_agree(radiance(pl.Scene([lamp]), below, max_bounces=0), np.full((4, 4), 2.0), 2e-3, name)
        above = pinhole(0.02, pixels=4).posed((1, 0, -36), (7, 0, -42))
        measured = radiance(pl.Scene([floor(pl.Conductor(0.9)), lamp]), above, max_bounces=1)
        assert_agree(measured, np.full((4, 4), 0.9 * 2.0), 2e-3, name)
        turned_away = pl.Mesh(lamp.vertices, lamp.faces[:, ::-1], material)
        assert not radiance(pl.Scene([base, turned_away]), shaded, 16, seeds=2, max_bounces=1)[0].any(), name


def test_suns_are_seen_and_shine_through_glass():
    # Irradiance E from a disc of radiance E / (pi sin^2 a): seen directly and in mirrors; under a pane
    # E cos (1 - R) / (1 + R), found only by paths that meet the disc by chance.
    travels, angular_radius = np.array([0.3, 0.0, -1.0]) / math.hypot(0.3, 1.0), 0.1
    sun = pl.SunLight(travels, 3.0, angular_radius)
    disc = 3.0 / (math.pi * math.sin(angular_radius) ** 2)
    direct = pinhole(1e-3, pixels=4).posed((0, 0, 0), -travels)
    assert_agree(radiance(pl.Scene(lights=[sun]), direct, 16), np.full((4, 4), disc), bias=1e-5)
    mirrored = pinhole(1e-3, pixels=4).posed((0, 0, 0), travels * [-1, 1, 1])
    measured = radiance(pl.Scene([floor(pl.Conductor(0.9))], [sun]), mirrored, 16)
    assert_agree(measured, np.full((4, 4), 0.9 * disc), bias=1e-5)
    pane = pl.quad((-100, -100, -39), (200, 0, 0), (0, 200, 0), material=pl.materials.ThinGlass(1.5))
    below = pinhole(0.1).posed((0, 0, -39.5), (0, 0, FLOOR_Z))
    # Incidence varies by the sun's radius: second order, a few 1e-3. One path in a hundred meets the disc.
    cosine = 1 / math.hypot(0.3, 1.0)
    r = fresnel(cosine, 1.5)
    expected = 0.6 / math.pi * 3.0 * cosine * (1 - r) / (1 + r)
    mean, error = radiance(pl.Scene([floor(pl.Lambertian(0.6)), pane], [sun]), below, 2048, max_bounces=2)
    whole = math.sqrt(np.square(error).sum()) / error.size
    assert whole < 0.015 * expected
    assert abs(mean.mean() - expected) < 4.5 * whole + 2e-3 * expected


def test_integrating_sphere_sums_a_geometric_series():
    # A light of intensity I in the middle: every scattering gives the same irradiance everywhere, so that the wall's
    # radiance is I / (pi r^2) (rho + rho^2 + ... + rho^k) with k scatterings: the number that max_bounces is, and
    # Russian roulette must not change. Flat facets 2.8 degrees wide: cosines and distances off by 6e-4.
    ball = flat(pl.sphere(10.0, segments=(128, 64), material=pl.Lambertian(0.8)))
    scene = pl.Scene([ball], [pl.lights.PointLight((0, 0, 0), 50.0)])
    camera = pinhole().posed((0, 0, 4.0), (0, 0, 0))
    for bounces in (1, 3, 8, 200):
        expected = 50.0 / (math.pi * 100.0) * sum(0.8**k for k in range(1, bounces + 1))
        measured = radiance(scene, camera, 64, max_bounces=bounces)
        assert_agree(measured, np.full((8, 8), expected), 2e-3, bounces)


def slab(material, tilt_deg=0.0):
    return pl.box((800.0, 800.0, 10.0), material=material).rotated_deg((0, 1, 0), tilt_deg).translated(z=-100.0)


def test_slabs_transmit_and_reflect_all_orders():
    # With R of one surface, T = 1 - R, and a = exp(-absorption d / cos'): T^2 a / (1 - R^2 a^2) passes,
    # R + T^2 R a^2 / (1 - R^2 a^2) returns; without absorption (1 - R) / (1 + R) and 2 R / (1 + R).
    camera = pinhole(0.002, pixels=4)
    # Small enough to be missed by what is reflected past the slab.
    wall = pl.quad((-200, -200, -700), (400, 0, 0), (0, 400, 0), material=pl.Emissive(2.0))
    black = wall.with_material(pl.Emissive(0.0))
    for tilt_deg, absorption in ((0.0, 0.03), (45.0, 0.0), (75.0, 0.03)):
        cosine = math.cos(math.radians(tilt_deg))
        r = fresnel(cosine, 1.5)
        a = math.exp(-absorption * 10.0 / math.sqrt(1 - (1 - cosine**2) / 2.25))
        through = (1 - r) ** 2 * a / (1 - r * r * a * a)
        back = r + (1 - r) ** 2 * r * a * a / (1 - r * r * a * a)
        glass = slab(pl.Dielectric(1.5, absorption=absorption), tilt_deg=tilt_deg)
        measured = radiance(pl.Scene([glass, wall]), camera, 1024, max_bounces=64)
        # The angle changes by 0.002 over the view, to both sides: second order.
        assert_agree(measured, np.full((4, 4), 2.0 * through), 1e-3, (tilt_deg, absorption))
        measured = radiance(pl.Scene([glass, black], background=2.0), camera, 1024, max_bounces=64)
        assert_agree(measured, np.full((4, 4), 2.0 * back), 2e-3, (tilt_deg, absorption))


def test_colours_of_absorption_do_not_mix():
    glass = slab(pl.Dielectric(1.0, absorption=(0.2, 0.05, 0.0)))
    mean, error = radiance(pl.Scene([glass], background=1.0), pinhole(0.002, pixels=4), 64, seeds=4)
    # Index 1: nothing is reflected or bent, exp(-10 absorption) is left; 10 mm within cos of 0.003.
    np.testing.assert_allclose(mean, np.broadcast_to(np.exp([-2.0, -0.5, 0.0]), (4, 4, 3)), rtol=2e-5)
    assert not (error > 1e-6).any()


def test_light_is_absorbed_on_its_way_from_a_lamp_to_a_surface():
    # A floor and a lamp in a tank of coloured matter of index 1, the camera before it: exp(-absorption (d + s)) for d
    # mm from lamp to floor, and s mm from floor to the tank's lid at z = -25.
    camera, place, absorption = pinhole(), np.array([14.0, 3.0, -30.0]), 0.02
    tank = pl.box((180, 180, 55), center=(0, 0, -52.5), material=pl.Dielectric(1.0, absorption=absorption))
    # The small quad faces the middle of the view, and has the intensity 500 cos.
    facing = np.array([0.0, 0.0, FLOOR_Z]) - place
    point = pl.lights.PointLight(place, 500.0)
    quad = pl.QuadLight.facing(place, (0, 0, FLOOR_Z), (0.1, 0.1), radiance=500.0 / 0.01)
    for light in (point, quad):

        def seen(origin, way, light=light):
            met = where_met(origin, way, FLOOR_Z)
            to_light = place - met
            d = np.linalg.norm(to_light, axis=1)
            s = np.linalg.norm(met - where_met(origin, way, -25.0), axis=1)
            emitted = 500.0 if light is point else 500.0 * -(to_light @ facing) / d / np.linalg.norm(facing)
            return 0.6 / math.pi * emitted * to_light[:, 2] / d**3 * np.exp(-absorption * (d + s))

        scene = pl.Scene([floor(pl.Lambertian(0.6), half=80.0), tank], [light])
        measured = radiance(scene, camera, max_bounces=2)
        assert_agree(measured, expected_image(camera, seen, parts=64), 1e-3, type(light).__name__)


def through_ball(origin, way, radius, index):
    """Exit points and directions of rays through a ball about the origin, and the transmission of two surfaces."""

    def refract(way, normal, ratio):  # normal against the way, the index before over that behind
        cosine = -np.sum(way * normal, axis=1, keepdims=True)
        return ratio * way + (ratio * cosine - np.sqrt(1 - ratio**2 * (1 - cosine**2))) * normal

    b = way @ origin
    entry = origin + (-b - np.sqrt(b * b - origin @ origin + radius**2))[:, None] * way
    normal = entry / radius
    inside = refract(way, normal, 1 / index)
    passed = (1 - fresnel(-np.sum(way * normal, axis=1), index)) ** 2
    leave = entry - 2 * np.sum(entry * inside, axis=1, keepdims=True) * inside
    return leave, refract(inside, -leave / radius, index), passed


def test_ball_lenses_focus_at_n_d_over_4_n_minus_1():
    radius, index = 10.0, 1.5
    efl = index * 2 * radius / (4 * (index - 1))
    # The exact rays of this test, near the axis and from far away, cross it there.
    leave, away, _ = through_ball(np.array([1e-3, 0.0, 1e6]), np.array([[0.0, 0.0, -1.0]]), radius, index)
    assert -(leave - leave[:, :1] / away[:, :1] * away)[0, 2] == pytest.approx(efl, rel=1e-6)
    # A wall that shines for x > 1.5, at twice the focal length: the picture is upside down, its edge at a height of the
    # lens that depends on the focal length. 512 x 256 facets with smooth normals.
    camera = pinhole(0.02).posed((0, 0, 200.0), (0, 0, 0))
    ball = pl.sphere(radius, segments=(512, 256), material=pl.Dielectric(index))
    wall = pl.quad((1.5, -50, -2 * efl), (50, 0, 0), (0, 100, 0), material=pl.Emissive(1.0))

    def seen(origin, way):
        leave, away, passed = through_ball(origin, way, radius, index)
        return (where_met(leave, away, -2 * efl)[:, 0] > 1.5) * passed

    expected = expected_image(camera, seen, parts=32)
    assert expected[3, 0] > 0.9 and expected[3, 7] == 0
    measured = radiance(pl.Scene([ball, wall]), camera, 512, max_bounces=2)
    # Facets of 0.12 mm and smooth normals; the edge is bent a little.
    assert_agree(measured, expected, bias=0.01)


def test_light_that_falls_through_glass_is_all_there():
    # An endless floor of albedo rho below glass below a uniform sky: with tau of diffuse light passing and 1 - tau
    # returned on either side, the floor's radiance is rho tau / (1 - rho (1 - tau)). The camera hangs in between. A
    # large light above is found through glass only by paths that hit it. Ends at 2000 of 5: (5 / 2000)^2.
    # tau is the integral of 2 cos sin (1 - R) / (1 + R), and d(cos^2) = 2 cos sin d(angle).
    x, w = np.polynomial.legendre.leggauss(200)
    r = fresnel(np.sqrt((x + 1) / 2), 1.5)
    tau, rho = float((w / 2) @ ((1 - r) / (1 + r))), 0.7
    expected = np.full((8, 8), 2.0 * rho * tau / (1 - rho * (1 - tau)))
    slab_above = pl.box((4000, 4000, 1), center=(0, 0, 1.5), material=pl.Dielectric(1.5))
    pane = pl.quad((-2000, -2000, 1), (4000, 0, 0), (0, 4000, 0), material=pl.materials.ThinGlass(1.5))
    ground = pl.quad((-2000, -2000, 0), (4000, 0, 0), (0, 4000, 0), material=pl.Lambertian(rho))
    lamp = pl.QuadLight((0, 0, 5), (0, 4000, 0), (4000, 0, 0), radiance=2.0)
    camera = pinhole(0.3).posed((0, 0, 0.9), (0, 0, 0), up=(0, 1, 0))
    for name, scene in {
        "slab, world": pl.Scene([slab_above, ground], background=2.0),
        "slab, light": pl.Scene([slab_above, ground], [lamp]),
        "pane, light": pl.Scene([pane, ground], [lamp]),
    }.items():
        assert_agree(radiance(scene, camera, 256, max_bounces=100), expected, 2e-3, name)
