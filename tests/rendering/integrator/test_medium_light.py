"""Light that media scatter once: points on flights are drawn by the lights and by the extinction."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.rendering.integrator.kernels import flight_profiles
from plenoptic.scene.lights.light_records import EXTENT

sys.path.insert(0, str(Path(__file__).parent))
from pinholes import flat, pinhole, radiance, radiance_once  # noqa: E402

Medium, HenyeyGreenstein = pl.materials.Medium, pl.materials.HenyeyGreenstein
NARROW = pinhole(1e-4, 2)
DEPTH = 200.0
STOP = flat(pl.box((400.0, 400.0, 1.0), center=(0, 0, -DEPTH - 0.5), material=pl.Lambertian(0.0)))
STRATUM = (np.arange(400_000) + 0.5) * (DEPTH / 400_000)


def scattered(radiant, medium, colour=0):
    """Radiance from one event of scattering along -z: `radiant` is irradiance and unit vectors to light at points."""
    points = np.zeros((len(STRATUM), 3))
    points[:, 2] = -STRATUM
    irradiance, to_light, distance = radiant(points)
    g, cosine = medium.phase.g, -to_light[:, 2]
    phase = (1 - g * g) / (4 * math.pi * (1 + g * g - 2 * g * cosine) ** 1.5)
    absorption, scattering = (np.broadcast_to(c, 3)[colour] for c in (medium.absorption, medium.scattering))
    left = np.exp(-(absorption + scattering) * (STRATUM + distance))
    return float(np.sum(scattering * left * phase * irradiance) * (DEPTH / len(STRATUM)))


def of_lamp(lamp):
    """Irradiance of a point or spot light (KHR_lights_punctual), by its definition."""

    def radiant(points):
        to_light = lamp.position - points
        distance = np.linalg.norm(to_light, axis=1)
        unit = to_light / distance[:, None]
        fraction = 1.0
        if isinstance(lamp, pl.lights.SpotLight):
            inner, outer = math.cos(lamp.inner_angle), math.cos(lamp.outer_angle)
            axis = np.asarray(lamp.direction) / np.linalg.norm(lamp.direction)
            fraction = np.clip((-unit @ axis - outer) / (inner - outer), 0.0, 1.0) ** 2
        return lamp.intensity * fraction / distance**2, unit, distance

    return radiant


def spot(position, direction, inner=0.1, outer=0.3):
    """A spot of an intensity of 1e4."""
    return pl.lights.SpotLight(position, direction, intensity=1e4, inner_angle=inner, outer_angle=outer)


LAMPS = {
    "near the ray": pl.lights.PointLight((0.5, 0.0, -100.0), intensity=1e4),
    "aside": pl.lights.PointLight((80.0, 0.0, -100.0), intensity=1e4),
    "behind the camera": pl.lights.PointLight((10.0, 0.0, 30.0), intensity=1e4),
    "across": spot((60.0, 0.0, -100.0), (-1.0, 0.1, 0.2)),
    "from the camera": spot((10.0, 0.0, 5.0), (-0.05, 0.0, -1.0)),
    "towards the camera": spot((3.0, 2.0, -150.0), (0.0, 0.0, 1.0)),
    "wide": spot((20.0, 0.0, -100.0), (-1.0, 0.0, 0.0), 1.0, 2.0),
}
MEDIA = [Medium(0.002, 0.004), Medium(1e-5, 1e-4, HenyeyGreenstein(0.8)), Medium(0.0, (0.03, 0.0, 0.001))]


@pytest.mark.parametrize("medium", MEDIA)
@pytest.mark.parametrize("lamp", LAMPS.values(), ids=LAMPS.keys())
def test_light_scattered_once_is_that_of_quadrature(lamp, medium):
    shots = radiance(pl.Scene([STOP], [lamp], medium=medium), NARROW, samples=512, seeds=12, max_bounces=1)
    for colour in range(shots[0].shape[-1]):
        mean, error = shots[0][..., colour].mean(), math.sqrt(np.square(shots[1][..., colour]).sum()) / 4
        expected = scattered(of_lamp(lamp), medium, colour)
        # A strong and a weak channel share their distances: errors of the weak one are larger.
        assert error <= (2e-3 if isinstance(medium.scattering, float) else 2e-2) * expected
        # Twelve seeds: quantile of Student's distribution beyond 4.5 standard deviations; and float32.
        assert abs(mean - expected) <= 6 * error + 2e-6 * expected, colour


def test_spots_that_light_nothing_of_the_ray_scatter_nothing():
    away = spot((60.0, 0.0, -100.0), (1.0, 0.0, 0.0))
    assert not radiance_once(pl.Scene([STOP], [away], medium=MEDIA[0]), NARROW, max_bounces=1).any()


def test_small_lamps_light_the_medium_like_points():
    # The intensity of a sphere is its radiance times pi a^2.
    sphere = pl.lights.SphereLight((10.0, 0.0, -100.0), 0.5, radiance=1e4)
    point = pl.lights.PointLight((10.0, 0.0, -100.0), intensity=1e4 * math.pi * 0.25)
    seen = [
        radiance(pl.Scene([STOP], [lamp], medium=MEDIA[0]), NARROW, samples=512, seeds=8, max_bounces=1)
        for lamp in (sphere, point)
    ]
    means = [shot[0].mean() for shot in seen]
    # Meshes of spheres are inscribed: a percent of their area is missing.
    assert means[0] == pytest.approx(means[1], rel=0.02)


@pytest.mark.parametrize(("begin", "end"), [(0.0, 200.0), (0.0, math.inf), (90.0, 130.0)])
def test_distances_follow_their_density(begin, end):
    to_light, direction = (3.0, 4.0, -100.0), (0.0, 0.0, -1.0)
    profile = flight_profiles.point_profile(to_light, direction, 0.0, begin, end)
    u = (np.arange(20_000) + 0.5) / 20_000
    t = np.array([flight_profiles.sample_profile(profile, x) for x in u])
    assert begin <= t.min() and t.max() <= end
    # du / dt is the density: by differences of u of 1 / 20 000, to some 1e-3 but where distances grow without bound.
    density = np.array([flight_profiles.profile_density(profile, x) for x in t])
    near = slice(200, -200)
    np.testing.assert_allclose(np.gradient(u, t)[near] / density[near], 1.0, rtol=1e-3)


def test_extents_are_those_of_each_lamp():
    # Two quads and two places of a bar that shines: half the diagonals of the boxes around them.
    quads = [pl.QuadLight.facing((0, 0, -z), (0, 0, 0), (6, 8), radiance=1.0) for z in (50.0, 60.0)]
    places = np.stack([np.eye(4), np.diag([3.0, 1.0, 1.0, 1.0])])
    places[:, 2, 3] = -80.0, -90.0
    bars = pl.scene.Instances(pl.box((2, 2, 1), material=pl.Emissive(1.0)), places)
    lights = pl.Scene([bars], quads, medium=MEDIA[0]).tables().lights
    extent, kinds = lights.areas[:, EXTENT], lights.items["instance"]
    np.testing.assert_allclose(extent[kinds < 0], 5.0)
    np.testing.assert_allclose(extent[kinds == 0], 1.5)
    np.testing.assert_allclose(extent[kinds == 1], 0.5 * math.sqrt(36 + 4 + 1))


def test_lights_larger_than_half_their_distance_have_no_profile():
    near, far = (flight_profiles.point_profile((x, 0.0, -9.0), (0.0, 0.0, -1.0), 5.0, 0.0, 90.0) for x in (9.9, 20.0))
    assert near == flight_profiles.no_profile() and near[1] == 0.0
    assert far[1] == pytest.approx(0.5 * (1 - 4 * 25 / 400))


def test_lamps_in_view_of_the_camera_are_hardly_noisy():
    # Distances drawn by the extinction alone have hundreds of times the variance, and an error of 1.
    lamp = pl.lights.PointLight((5.0, 3.0, -100.0), intensity=1e4)
    scene = pl.Scene([STOP], [lamp], medium=MEDIA[0])
    mean, error = radiance(scene, pinhole(0.1, 8), samples=128, seeds=12, max_bounces=1)
    assert np.sqrt(np.square(error).mean()) < 0.1 * mean.mean()


def test_only_bodies_that_hold_a_light_are_lit():
    # Boxes of 20 mm at x = 0, 40 and 80; one holds a lamp, one a glowing corner, the last nothing.
    media = [Medium(0.0, 0.01 * k) for k in (1, 2, 3)]
    bodies = [pl.box(20.0, center=(40.0 * k, 0, 0), material=pl.Dielectric(1.2, medium=m)) for k, m in enumerate(media)]
    glow = pl.box(2.0, center=(50.0, 10.0, 10.0), material=pl.Emissive(1.0))
    lamp = pl.lights.PointLight((5.0, 0, 0), intensity=1.0)
    lit = {}
    for medium in (None, Medium(0.001)):
        record = pl.Scene([*bodies, glow], [lamp], medium=medium).tables()
        lit = {round(float(s), 3): int(k) for s, k in zip(record.media.scattering[:, 0], record.media.lit, strict=True)}
        assert [lit[s] for s in (0.01, 0.02, 0.03)] == [1, 1, 0]
        np.testing.assert_allclose(record.media.squared_index[record.media.scattering[:, 0] > 0], 1.44)
    # Sheets go through everything; a body in two places has the box around both.
    sheet = pl.lights.Sheet((0, 0, 0), (1, 0, 0), (0, 1, 0), thickness=1.0, irradiance=1.0)
    assert pl.Scene(bodies, [sheet]).tables().media.lit.all()
    places = np.stack([np.eye(4)] * 2)
    places[:, 0, 3] = -30.0, 40.0
    assert pl.Scene([pl.scene.Instances(bodies[0], places)], [lamp]).tables().media.lit.all()


def test_light_within_a_body_is_scattered_by_its_medium():
    # A lamp in a body of index 1 around the camera: as in the medium of the scene.
    medium = MEDIA[0]
    around = flat(pl.box(500.0, material=pl.Dielectric(1.0, medium=medium)))
    seen = [
        radiance(scene, NARROW, samples=512, seeds=8, max_bounces=1)
        for scene in (
            pl.Scene([STOP, around], [LAMPS["near the ray"]]),
            pl.Scene([STOP], [LAMPS["near the ray"]], medium=medium),
        )
    ]
    assert seen[0][0].mean() == pytest.approx(seen[1][0].mean(), rel=5e-3)
