"""Which light is drawn how often."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scene_helpers import CORNERS, GREY, area_vectors, square

import plenoptic as pl
from plenoptic.scene.lights import build_lights
from plenoptic.scene.lights.light_records import ENVIRONMENT, POINT, SUN, TRIANGLE


def record_of(meshes=(), lights=(), background=None, floor=GREY):
    return pl.Scene([square(floor), *meshes], lights, background).tables()


def lights_of(*parts, **named):
    return record_of(*parts, **named).lights


def shares(lights):
    """Probability of each item."""
    return np.diff(lights.cdf, prepend=0.0)


# Far from where a power that is computed by hand underflows.
radiance = st.just(0.0) | st.floats(1e-100, 1e3)
emitter = st.tuples(radiance | st.tuples(*[radiance] * 3), st.booleans(), st.floats(0.1, 10))


@settings(max_examples=50)
@given(st.lists(emitter, min_size=1, max_size=5))
def test_triangles_are_drawn_by_the_power_they_emit(kinds):
    meshes = [square(pl.Emissive(r, both)).scaled(size).translated(z=k) for k, (r, both, size) in enumerate(kinds)]
    tables = record_of(meshes)
    lights = tables.lights
    # By hand: two triangles of area 2 size^2 each; the floor has rows 0 and 1.
    power = np.array([np.mean(r) * 2 * s**2 * (2 if both else 1) for r, both, s in kinds for _ in range(2)])
    if not any(power):
        assert lights.cdf is None and (tables.emission is None or tables.emission.pdf is None)
        return
    lit = np.flatnonzero(power)
    assert lights.items["row"].tolist() == (lit + 2).tolist()
    assert not lights.items["kind"].any() and (lights.items["instance"] < 0).all()
    expected = power[lit] / power.sum()
    # A sum of some ten terms, a few eps each.
    np.testing.assert_allclose(shares(lights), expected, atol=1e-14)
    assert lights.cdf[-1] == 1.0
    areas = np.array([2 * s**2 for _, _, s in kinds for _ in range(2)])[lit]
    density = tables.emission.pdf[tables.geometry.triangle_material[lit + 2]]
    np.testing.assert_allclose(density * areas, expected, rtol=1e-13)


ONE_OF_EACH = [
    pl.lights.PointLight((0, 0, 5), (3.0, 6.0, 9.0)),
    pl.lights.SpotLight((0, 0, 5), (0, 0, -1), 40.0, 0.3, 0.9),
    pl.QuadLight((0, 0, 9), (3, 0, 0), (0, 4, 0), radiance=2.0, two_sided=True),
    pl.lights.SphereLight((9, 0, 9), 0.5, radiance=(1.0, 2.0, 3.0)),
]


def test_near_lights_of_all_kinds_are_drawn_by_their_power():
    lights = lights_of(lights=ONE_OF_EACH)
    # Radiance mm^2 sr: pi L A for each side that shines, 4 pi I, and what `power` says.
    expected = [math.pi * 2.0 * 12.0 * 2, ONE_OF_EACH[3].power, 4 * math.pi * 6.0, ONE_OF_EACH[1].power]
    drawn = shares(lights)
    triangles = lights.items["kind"] == TRIANGLE
    quad = triangles & (lights.items["row"] < 4)
    found = [drawn[quad].sum(), drawn[triangles & ~quad].sum(), *drawn[lights.items["kind"] == POINT]]
    assert lights.items["kind"].tolist() == [TRIANGLE] * 1282 + [POINT] * 2
    # The mesh of a sphere has the sphere's area to rounding: 1280 triangles.
    np.testing.assert_allclose(found, np.array(expected) / np.sum(expected), rtol=1e-11)
    # Places, axes and colours of points and spots.
    lights = lights_of(lights=ONE_OF_EACH[:2])
    np.testing.assert_allclose(lights.points[0].tolist(), [0, 0, 5, 0, 0, 0, -2, -2])
    np.testing.assert_allclose(lights.points[1].tolist(), [0, 0, 5, 0, 0, -1, math.cos(0.9), math.cos(0.3)], rtol=1e-15)
    assert lights.point_colors.tolist() == [[3, 6, 9], [40, 40, 40]]
    assert lights.items["row"].tolist() == [0, 1]


def test_extreme_radiances_give_finite_probabilities():
    for brightest in (1e300, 1e308):
        back = square(pl.Emissive(brightest, two_sided=True)).translated(z=-1)
        record = record_of([square(pl.Emissive(brightest)), back])
        np.testing.assert_allclose(shares(record.lights), [1 / 6, 1 / 6, 1 / 3, 1 / 3])
        assert np.isfinite(record.emission.pdf).all()
    # Faint ones are drawn if there are no others.
    lights = lights_of([square(pl.Emissive(1e-300)).scaled(10)], [pl.lights.PointLight((0, 0, 5), 0.0)])
    drawn = shares(lights)
    np.testing.assert_allclose(drawn[lights.items["kind"] == TRIANGLE], 0.5)
    assert drawn[lights.items["kind"] == POINT].tolist() == [0.0]
    # Triangles without area can be met but are no lights.
    mesh = pl.Mesh(CORNERS, [[0, 1, 1], [0, 1, 2], [3, 3, 3]], pl.Emissive(1.0))
    tables = pl.Scene([square(), mesh]).tables()
    assert len(tables.geometry.triangles) == 5
    assert tables.lights.items["row"].tolist() == [3] and tables.lights.cdf.tolist() == [1.0]


def test_neither_near_nor_distant_lights_go_without_draws():
    for irradiance, expected in ((1e-9, [0.9, 0.1]), (1e9, [0.1, 0.9])):
        lights = lights_of(lights=[pl.lights.PointLight((0, 0, 5), 7.0), pl.SunLight((0, 0, -1), irradiance)])
        assert lights.items["kind"].tolist() == [POINT, SUN]
        # A tenth of the draws, at least, goes to either.
        np.testing.assert_allclose(shares(lights), expected)
        np.testing.assert_allclose(lights.sky.suns[0]["pdf"], shares(lights)[1])
    # In between, by what the sun sends through the scene.
    point, sun = pl.lights.PointLight((0, 0, 1), 2.0), pl.SunLight((0, 0, -1), 3.0)
    lights = pl.Scene([square()], [point, sun]).tables().lights
    # Irradiance on a disc around the box of meshes and lamps: 2 x 2 x 1, diagonal 3.
    through = 3.0 * math.pi * 1.5**2
    expected = np.array([point.power, through]) / (point.power + through)
    np.testing.assert_allclose(shares(lights), expected, rtol=1e-13)
    # From any point of the scene that far leads beyond it.
    assert lights.far > 3.0


def test_suns_and_worlds_share_the_distant_draws_by_irradiance():
    first, second = (0.5, 1.0, 1.5), (2.0, 4.0, 3.0)
    suns = [pl.SunLight((0, 0, -1), first), pl.SunLight((0, -1, 0), second, 0.0), pl.SunLight((0, 1, 0), 0.0)]
    lights = lights_of(lights=suns, background=pl.EnvironmentMap(np.full((4, 8, 1), 0.25)))
    assert lights.items["kind"].tolist() == [SUN] * 3 + [ENVIRONMENT]
    # A world of radiance 1/4 all around sends pi, as irradiance all around: 4 pi / 4.
    expected = np.array([1.0, 3.0, 0.0, math.pi]) / (4 + math.pi)
    np.testing.assert_allclose(shares(lights), expected, rtol=1e-12, atol=1e-15)
    kept = [*lights.sky.suns["pdf"], lights.sky.environment.probability]
    np.testing.assert_allclose(kept, expected, rtol=1e-12, atol=1e-15)
    # Towards the sun; radiance of the disc, or the irradiance where there is none.
    np.testing.assert_allclose(lights.sky.suns[["x", "y", "z"]].tolist(), [[0, 0, 1], [0, 1, 0], [0, -1, 0]])
    angle = suns[0].angular_radius
    np.testing.assert_allclose(lights.sky.suns["cap"], [1 - math.cos(angle), 0, 1 - math.cos(angle)], rtol=1e-10)
    np.testing.assert_allclose(lights.sky.sun_colors[0], np.array(first) / (math.pi * math.sin(angle) ** 2), rtol=1e-12)
    assert lights.sky.sun_colors[1].tolist() == [2, 4, 3]


NOTHING = [
    pl.lights.PointLight((0, 0, 5), 0.0),
    pl.lights.SpotLight((0, 0, 5), (0, 0, -1), 0.0),
    pl.SunLight((0, 0, -1), 0.0),
    pl.QuadLight((0, 0, 9), (3, 0, 0), (0, 4, 0), radiance=0.0),
]


def test_lights_without_light_and_constant_worlds_are_not_drawn():
    lights = lights_of(lights=NOTHING)
    assert lights.cdf is None and lights.items is None
    assert lights_of().cdf is None
    lights = lights_of(lights=[*NOTHING, pl.lights.PointLight((0, 0, 5), 1e-12)])
    drawn = shares(lights)
    assert drawn[lights.items["row"] == 2].tolist() == [1.0] and drawn.sum() == 1.0 and lights.cdf[-1] == 1.0
    assert lights_of(background=1.0).cdf is None
    lights = lights_of(lights=[pl.lights.PointLight((0, 0, 5))], background=1.0)
    assert lights.cdf.tolist() == [1.0] and lights.sky.environment is None
    # Where nothing reflects, lights are only seen.
    for light in (*ONE_OF_EACH, pl.SunLight((0, 0, -1))):
        lights = lights_of(lights=[light], floor=pl.Lambertian(0.0))
        assert lights.cdf is None and lights.points is None
        assert (lights.sky.suns is not None) == isinstance(light, pl.SunLight)


def test_instanced_emitters_are_lights_at_every_place():
    rng = np.random.default_rng(3)
    matrices = np.tile(np.eye(4), (3, 1, 1))
    matrices[:, :3, :3] = rng.normal(size=(3, 3, 3))
    matrices[:, :3, 3] = rng.uniform(-9, 9, (3, 3))
    bulb, plain = pl.sphere(1.0, segments=(6, 4), material=pl.Emissive(2.0)), square(pl.Emissive(2.0))
    group = pl.scene.Instances(bulb, matrices)
    tables = pl.Scene([square(), pl.scene.Instances(square(), matrices[:2]), group, plain]).tables()
    lights = tables.lights
    expected = np.linalg.norm(np.concatenate([area_vectors(mesh) for mesh in (plain, *group.meshes())]), axis=1)
    density = tables.emission.pdf[tables.geometry.triangle_material[lights.items["row"]]]
    np.testing.assert_allclose(shares(lights), expected / expected.sum(), rtol=0, atol=1e-14)
    # One density for one material, at all places.
    np.testing.assert_allclose(density, 1 / expected.sum(), rtol=1e-12)
    # Floor, plain emitter, then the two meshes that are repeated; places 0 and 1 are those of the grey square.
    n = len(bulb.faces)
    assert lights.items["row"].tolist() == [2, 3, *3 * list(range(6, 6 + n))]
    assert lights.items["instance"].tolist() == [-1, -1, *[2] * n, *[3] * n, *[4] * n]


def test_ten_thousand_lights_keep_their_shares():
    rng = np.random.default_rng(4)
    power = rng.random(10_000) ** 8
    power[::7] = 0.0
    power[-10:] = 0.0
    many = [pl.lights.PointLight(place, p) for place, p in zip(rng.uniform(-50, 50, (10_000, 3)), power, strict=True)]
    lights = lights_of(lights=many)
    # Each share is a difference of two sums of about 1: some 10^4 roundings of eps / 2, mostly cancelling.
    np.testing.assert_allclose(shares(lights), power / power.sum(), rtol=0, atol=1e-13)
    assert (np.diff(lights.cdf) >= 0).all()
    # The largest random number below 1 must not draw a light of no power, nor divide by its probability.
    last = np.flatnonzero(power)[-1]
    assert np.searchsorted(lights.cdf, np.nextafter(1.0, 0.0), side="right") == last
    assert (lights.cdf[last:] == 1.0).all()


def test_of_many_lights_several_are_drawn(monkeypatch):
    """A ball of many triangles is one light, a mesh in several places several."""
    monkeypatch.setattr(build_lights, "_MANY", 12)
    lamp, ball = square(pl.Emissive(1.0)), pl.sphere(1.0, center=(0, 0, 5), material=pl.Emissive(1.0))
    lamps, points = [lamp.translated(z=k) for k in range(10)], ONE_OF_EACH[:1]
    places = np.tile(np.eye(4), (11, 1, 1))
    places[:, 2, 3] = np.arange(11)
    for meshes, lights, expected in (
        ([*lamps, ball], [], 1),
        ([*lamps, ball], points, 4),
        ([pl.scene.Instances(ball, places)], [], 1),
        ([pl.scene.Instances(ball, places)], points, 4),
        ([], 11 * points, 1),
        ([], 12 * points, 4),
        ([ball], [], 1),
        ([], [], 1),
    ):
        assert lights_of(meshes, lights).candidates == expected
