import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scene_helpers import area, area_vectors

import plenoptic as pl
from plenoptic.lights import PointLight, SphereLight, SpotLight, SunLight

POINT = st.tuples(*[st.floats(-1e3, 1e3)] * 3)


@settings(max_examples=50)
@given(POINT, POINT, st.floats(0.1, 100), st.floats(0.1, 100))
def test_a_light_that_faces_a_point_does(center, target, width, height):
    towards = np.subtract(target, center)
    assume(np.linalg.norm(towards) > 1e-3)
    light = pl.QuadLight.facing(center, target, (width, height), radiance=2)
    # A direction of a few eps per product.
    np.testing.assert_allclose(light.normal, towards / np.linalg.norm(towards), atol=1e-12)
    assert light.area == pytest.approx(width * height, rel=1e-12)
    assert np.linalg.norm(light.edge_u) == pytest.approx(width, rel=1e-12)
    np.testing.assert_array_equal(light.center, center)
    spot = SpotLight.facing(center, target, intensity=(1, 2, 3), inner_angle=0.1, outer_angle=0.2)
    np.testing.assert_allclose(spot.direction, towards / np.linalg.norm(towards), atol=1e-12)
    assert spot == SpotLight(center, spot.direction, (1, 2, 3), 0.1, 0.2)


def test_the_mesh_winds_counter_clockwise_from_the_emitting_side():
    light = pl.QuadLight((1, 2, 3), (4, 0, 1), (0, 2, 0), radiance=(1, 2, 3), two_sided=True)
    mesh = light.mesh()
    assert (area_vectors(mesh) @ light.normal > 0).all() and area(mesh) == pytest.approx(light.area)
    np.testing.assert_allclose(mesh.vertices.mean(axis=0), light.center)
    assert mesh.material == pl.Emissive((1, 2, 3), two_sided=True)
    # pi for each side of a Lambertian emitter, area 6, mean of the channels 2.
    one, both = (pl.QuadLight((0, 0, 0), (2, 0, 0), (1, 3, 0), (1, 2, 3), two_sided=two) for two in (False, True))
    assert one.power == pytest.approx(12 * math.pi) and both.power == pytest.approx(24 * math.pi)
    # The width is horizontal, and straight up and down work.
    for target in ((0, 0, 5), (5, 0, 0), (3, 4, 5)):
        assert pl.QuadLight.facing((0, 0, 0), target, (4, 2)).edge_u[1] == 0
    for down in (-1, 1):
        np.testing.assert_allclose(pl.QuadLight.facing((0, 0, 0), (0, down, 0), (4, 2)).normal, [0, down, 0])


@settings(max_examples=25)
@given(POINT, st.floats(1e-3, 1e3))
def test_the_body_of_a_sphere_is_closed_convex_faces_outwards_and_has_its_area(center, radius):
    light = SphereLight(center, radius, (1, 2, 3))
    mesh = light.mesh()
    # Vertices around a far centre are rounded to an eps of their coordinates, areas twice as much.
    rounding = 1e-12 + 2e-15 * np.abs(center).max() / radius * 10
    a, b, c = (mesh.vertices[mesh.faces[:, k]] - center for k in range(3))
    cross = np.cross(b - a, c - a)
    outwards = ((a + b + c) * cross).sum(axis=1)
    assert (outwards > 0).all()
    found = 0.5 * np.linalg.norm(cross, axis=1).sum()
    assert found == pytest.approx(4 * math.pi * radius**2, rel=rounding)
    assert light.area == pytest.approx(found, rel=rounding)
    # A convex body of area A that emits L gives off pi L A in all.
    assert light.power == pytest.approx(math.pi * 2 * found, rel=rounding)
    assert mesh.material == pl.Emissive((1, 2, 3))
    # By how much the corners stand out, as documented.
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices - center, axis=1), radius * 1.002391, rtol=1e-6 + rounding)
    plane = outwards / (3 * np.linalg.norm(cross, axis=1))
    assert plane.min() > radius * (1 - 0.0022 - rounding)


def test_the_body_of_a_sphere_has_no_holes_and_no_preferred_direction():
    mesh = SphereLight((0, 0, 0), 1.0).mesh()
    assert len(mesh.vertices) == 642 and len(mesh.faces) == 1280
    # Each edge belongs to two triangles, which run along it in opposite directions.
    edges = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    forwards, backwards = ({tuple(edge) for edge in some.tolist()} for some in (edges, edges[:, ::-1]))
    assert len(forwards) == 3840 and forwards == backwards
    # The symmetry of an icosahedron: second moments alike.
    np.testing.assert_allclose(mesh.vertices.T @ mesh.vertices, np.eye(3) * 642 * 1.002391**2 / 3, atol=1e-3)


@settings(max_examples=50)
@given(st.floats(0, 3.1), st.floats(1e-2, 1))
def test_the_power_of_a_spot_is_its_intensity_over_all_directions(inner, more):
    outer = min(inner + more, math.pi)
    light = SpotLight((0, 0, 0), (0, 0, -1), (3.0, 0.0, 6.0), inner, outer)
    # Piece by piece the falloff is a square in the cosine, which Gauss-Legendre with three points integrates exactly,
    # up to the rounding of arc cosines: eps / (difference of the cosines, 5e-5 at least).
    node, weight = np.polynomial.legendre.leggauss(3)
    flux = 0.0
    for high, low in itertools.pairwise([1.0, math.cos(inner), math.cos(outer), -1.0]):
        angle = np.arccos(np.clip(0.5 * (high + low) + 0.5 * (high - low) * node, -1, 1))
        flux += 2 * math.pi * 3.0 * 0.5 * (high - low) * (light.falloff(angle) * weight).sum()
    assert light.power == pytest.approx(flux, rel=1e-10)


def test_the_falloff_is_that_of_gltf():
    light = SpotLight((0, 0, 0), (0, 0, -1), 1.0, 0.3, 0.9)
    # KHR_lights_punctual: saturate(cos a scale + offset)^2.
    angle = np.linspace(0, math.pi, 1001)
    scale = 1 / (math.cos(0.3) - math.cos(0.9))
    expected = np.clip(np.cos(angle) * scale - math.cos(0.9) * scale, 0, 1) ** 2
    np.testing.assert_allclose(light.falloff(angle), expected, atol=1e-14)
    assert light.falloff(0.2) == light.falloff(0.3) == 1 and light.falloff(0.9) == light.falloff(3.0) == 0
    assert PointLight((0, 0, 0), (1, 2, 3)).power == pytest.approx(8 * math.pi)


def test_directions_of_any_length_are_kept_as_unit_vectors():
    direction = np.array([2.0, -3.0, 6.0]) / 7
    for length in (1e-300, 1.0, 7.0, 1e300):
        for light in (SpotLight((0, 0, 0), length * direction), SunLight(length * direction)):
            np.testing.assert_allclose(light.direction, direction, rtol=1e-15)
            # Unit vectors keep their bits, so that lights survive a round trip through their own fields.
            assert type(light)(**{name: getattr(light, name) for name in light.__dataclass_fields__}) == light
    # A sun stands where its angles say.
    for azimuth, elevation, stands in (
        (0, 0, (0, 0, -1)),
        (math.pi / 2, 0, (1, 0, 0)),
        (math.pi, 0, (0, 0, 1)),
        (1.0, math.pi / 2, (0, 1, 0)),
        (0, math.pi / 4, (0, math.sqrt(0.5), -math.sqrt(0.5))),
    ):
        sun = SunLight.from_angles(azimuth, elevation, irradiance=2.0, angular_radius=0.1)
        np.testing.assert_allclose(-sun.direction, stands, atol=1e-15)
        assert (sun.irradiance, sun.angular_radius) == (2.0, 0.1)
    # IAU 2015 Resolution B3: 695700 km; 1 au = 149597870.7 km. The default has three digits.
    assert SunLight((0, -1, 0)).angular_radius == pytest.approx(math.asin(695700 / 149597870.7), abs=5e-6)


ORIGIN, X, Y, UP = (0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)
REFUSED = {
    pl.errors.SceneError: [
        (lambda: pl.QuadLight(ORIGIN, X, (2, 0, 0)), "parallel"),
        (lambda: pl.QuadLight(ORIGIN, ORIGIN, X), "no area"),
        (lambda: pl.QuadLight(ORIGIN, (1e300, 0, 0), (0, 1e300, 0)), "within"),
        (lambda: SphereLight((0, 0, 1e6), 1e-4), "at least 0.001 mm"),
        (lambda: SphereLight((0, 0, 9.9e14), 1e13), "within"),
        (lambda: PointLight((0, 0, 2e15)), "within"),
        (lambda: PointLight(ORIGIN, -1.0), "intensity"),
        (lambda: SpotLight(ORIGIN, ORIGIN), "direction"),
        (lambda: SpotLight.facing((1, 2, 3), (1, 2, 3)), "above 0"),
        (lambda: SunLight(ORIGIN), "direction"),
        (lambda: SunLight(UP, 1e308, 1e-6), "infinite"),
    ],
    pl.errors.InvalidValueError: [
        (lambda: pl.QuadLight.facing(ORIGIN, ORIGIN, (1, 1)), "above 0"),
        (lambda: pl.QuadLight.facing(ORIGIN, UP, (0, 1)), "width"),
        (lambda: SphereLight(ORIGIN, 0.0), "radius"),
        (lambda: SpotLight(ORIGIN, UP, outer_angle=0.0), "outer_angle"),
        (lambda: SpotLight(ORIGIN, UP, outer_angle=3.2), "outer_angle"),
        (lambda: SpotLight(ORIGIN, UP, outer_angle=1e-8), "cosine"),
        (lambda: SpotLight(ORIGIN, UP, inner_angle=-0.1), "inner_angle"),
        (lambda: SpotLight(ORIGIN, UP, 1.0, 0.5, 0.5), "reduce inner_angle"),
        (lambda: SunLight(UP, 1.0, -0.1), "angular_radius"),
        (lambda: SunLight(UP, 1.0, 1e-7), "parallel"),
        (lambda: SunLight(UP, 1.0, math.pi / 2), "angular_radius"),
        (lambda: SunLight.from_angles(0.0, 1.6), "elevation"),
    ],
}


def test_lights_that_cannot_be_are_refused():
    for kind, cases in REFUSED.items():
        for make, said in cases:
            with pytest.raises(kind, match=said):
                make()
