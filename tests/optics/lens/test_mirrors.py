"""Lenses with mirrors: laws of reflection, conics between their foci, closed forms of telescopes."""

import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.errors import PrescriptionError
from plenoptic.optics import Mirror

MIRROR = pl.optics.MIRROR
GLASS = pl.ConstantMedium(1.5)


def cassegrain(*, ring: float = 0.0, gap: float = 140.0, back: float = 180.0) -> pl.LensStack:
    """Classical: a paraboloid of 200 mm, and a hyperboloid from its focus to `back` mm behind the secondary."""
    ahead = 200.0 - gap
    m = back / ahead
    radius, conic = 2.0 / (1.0 / ahead - 1.0 / back), -(((m + 1.0) / (m - 1.0)) ** 2)
    stop = pl.optics.RingStop(50.0, ring) if ring else pl.CircularStop(50.0)
    primary = pl.Surface(-400.0, gap, MIRROR, semi_diameter=52.0, conic=-1.0)
    return pl.LensStack([stop, primary, pl.Surface(radius, 0.0, MIRROR, semi_diameter=20.0, conic=conic)])


def mangin() -> pl.LensStack:
    """A meniscus of glass whose rear side reflects: light passes its front side twice."""
    glass = pl.Surface(-120.0, 8.0, GLASS, semi_diameter=14.0), pl.Surface(-180.0, 8.0, MIRROR, semi_diameter=14.0)
    return pl.LensStack([pl.CircularStop(10.0, thickness=5.0), *glass, pl.Surface(120.0, semi_diameter=14.0)])


def folded() -> pl.LensStack:
    """An asphere and a surface without symmetry, both out of place, and a glass between them."""
    bump = pl.optics.ZernikeSag([0, 0, 0, 0, 1e-3, 2e-3, 1e-3], norm_radius=20.0)
    asphere = pl.Surface(-300.0, 60.0, MIRROR, semi_diameter=20.0, conic=-0.7, aspheric=(0.0, 1e-8))
    freeform = pl.Surface(500.0, 50.0, MIRROR, semi_diameter=20.0, freeform=bump)
    glass = pl.Surface(80.0, 5.0, GLASS, semi_diameter=20.0), pl.Surface(-90.0, semi_diameter=20.0)
    stack = pl.LensStack([pl.CircularStop(8.0, thickness=20.0), asphere, freeform, *glass])
    return stack.moved(1, tilt=(0.02, -0.01, 0.0), shift=(0.3, 0.2, 0.1)).moved(2, tilt=(0.0, 0.03, 0.0))


LENSES = {"cassegrain": cassegrain(), "mangin": mangin(), "folded": folded()}


def beam(n: int, width: float, *, seed: int = 0) -> pl.RayBundle:
    rng = np.random.default_rng(seed)
    y, slope = rng.uniform(-width, width, (n, 2)), rng.uniform(-0.01, 0.01, (n, 2))
    return pl.RayBundle(np.column_stack([y, np.full(n, -300.0)]) - 300.0 * np.column_stack([slope, np.zeros(n)]),
                        np.column_stack([slope, np.ones(n)]))  # fmt: skip


def test_an_ellipsoid_images_one_focus_into_the_other():
    # Semi-axes: e = 0.5, R = a (1 - e^2); from the vertex the foci lie at a (1 - e) and a (1 + e).
    a, e = 100.0, 0.5
    mirror = pl.Surface(-a * (1 - e * e), medium=MIRROR, semi_diameter=40.0, conic=-e * e)
    lens = pl.LensStack([pl.CircularStop(500.0, thickness=200.0), mirror])
    near, far = a * (1 - e), a * (1 + e)
    angle = np.linspace(-0.6, 0.6, 9)
    directions = np.stack([0 * angle, np.sin(angle), np.cos(angle)], axis=1)
    out = lens.trace(pl.RayBundle(np.tile([0.0, 0.0, 200.0 - near], (9, 1)), directions))
    assert (out.status == 0).all() and np.abs(out.at_z(200.0 + far)[:, :2]).max() < 1e-12
    assert pl.paraxial.image_position(lens, 200.0 - near) == pytest.approx(200.0 + far, rel=1e-14)


def test_rays_turned_back_go_the_way_they_came():
    for name, lens in LENSES.items():
        rays = beam(600, 7.0)
        out = lens.trace(rays)
        passed = out.status == 0
        assert passed.mean() > 0.5, name
        assert np.abs(np.linalg.norm(out.direction[passed], axis=1) - 1.0).max() < 1e-14, name
        back = lens.trace_reverse(pl.RayBundle(out.at(30.0 + 0 * out.weight)[passed], -out.direction[passed]))
        assert (back.status == 0).all(), name
        # Directions of some ten roundings, over 500 mm.
        assert np.abs(back.direction + rays.direction[passed]).max() < 1e-13, name
        assert np.abs(back.at_z(-300.0) - rays.at_z(-300.0)[passed]).max() < 5e-11, name
        assert np.linalg.det(pl.paraxial.system_matrix(lens)) == pytest.approx(1.0, abs=1e-13), name


def test_a_turned_mirror_turns_light_by_twice_its_angle():
    flat = pl.LensStack([pl.CircularStop(5.0, thickness=20.0), pl.Surface(math.inf, medium=MIRROR, semi_diameter=20.0)])
    ray = pl.RayBundle([[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]])
    assert flat.trace(ray).direction[0].tolist() == [0.0, 0.0, 1.0]
    angle = 0.01
    turned = flat.moved(1, tilt=(angle, 0.0, 0.0)).trace(ray)
    # Turned about x, y towards z: the normal leans to -y, and reflected light too, which is seen in the plane z = 20.
    assert turned.direction[0] == pytest.approx([0.0, math.sin(2 * angle), math.cos(2 * angle)], abs=1e-15)
    assert flat.moved(1, shift=(0.0, 0.0, 0.5)).trace(ray).origin[0].tolist() == [0.0, 0.0, 19.5]


def test_light_along_the_axis_turns_by_twice_the_slope_of_an_asphere():
    # A paraboloid and a term in r^4: the sag is r^2 / (2 R) + a r^4, whatever the height.
    radius, a, r = -200.0, 2e-8, np.linspace(-40.0, 40.0, 9)
    mirror = pl.Surface(radius, medium=MIRROR, semi_diameter=45.0, conic=-1.0, aspheric=(0.0, a))
    outwards = np.stack([0.6 * r, 0.8 * r, 0 * r], axis=1)
    out = pl.LensStack([pl.CircularStop(50.0), mirror]).trace(pl.RayBundle(outwards, [[0.0, 0.0, 1.0]] * 9))
    turned = 2.0 * np.arctan(r / radius + 4.0 * a * r**3)
    # Some ten roundings.
    np.testing.assert_allclose(out.direction[:, :2] @ [0.6, 0.8], np.sin(turned), rtol=0, atol=2e-15)
    np.testing.assert_allclose(out.direction[:, 2], np.cos(turned), rtol=0, atol=2e-15)


def test_a_cassegrain_has_no_spherical_aberration_and_the_coma_of_a_paraboloid():
    lens = cassegrain()
    f1, f2, d = 200.0, -0.5 * lens.elements[2].radius, 140.0
    points = pl.paraxial.cardinal_points(lens)
    assert points.efl == pytest.approx(f1 * f2 / (f1 + f2 - d), rel=1e-13) == pytest.approx(600.0, rel=1e-13)
    assert points.rear_focus == pytest.approx(140.0 + 180.0, rel=1e-13)
    y = np.linspace(-48.0, 48.0, 9)
    parallel = pl.RayBundle(np.stack([np.full(9, 3.0), y, np.full(9, -300.0)], axis=1), [[0.0, 0.0, 1.0]] * 9)
    assert np.abs(lens.trace(parallel).at_z(320.0)[:, :2]).max() < 1e-12
    sums = pl.aberrations.seidel_sums(lens, field=0.005)
    # S_I of one mirror alone is y^4 / (4 f^3) = 0.2 mm; both cancel.
    assert abs(sums.total[0]) < 1e-15
    # D. Schroeder, Astronomical Optics, 2nd ed., table 6.6: coma is that of a paraboloid of the same focal length,
    # S_II = y^3 theta / (2 f^2).
    assert abs(sums.total[1]) == pytest.approx(50.0**3 * math.tan(0.005) / (2 * 600.0**2), rel=1e-12)
    # Petzval: -H^2 c (1 / n' - 1 / n) with n' = -n.
    petzval = (50.0 * math.tan(0.005)) ** 2 * 2.0 * (1 / -400.0 + 1 / lens.elements[2].radius)
    assert sums.total[3] == pytest.approx(petzval, rel=1e-12)
    found = pl.aberrations.field_curvature(lens, [0.005])
    astigmatism, n_u2 = sums.total[2], 2.0 * (50.0 / 600.0) ** 2
    assert found.sagittal[0] == pytest.approx(-(astigmatism + petzval) / n_u2, rel=1e-3)
    assert found.tangential[0] == pytest.approx(-(3 * astigmatism + petzval) / n_u2, rel=1e-3)


def test_a_mangin_mirror_is_its_front_twice_and_the_mirror_in_glass():
    n, c1, c2, t = 1.5, 1 / -120.0, 1 / -180.0, 8.0
    front, silver = (n - 1.0) * c1, -2.0 * n * c2
    refract = lambda power: np.array([[1.0, 0.0], [-power, 1.0]])  # noqa: E731
    gap = np.array([[1.0, t / n], [0.0, 1.0]])
    matrix = refract(front) @ gap @ refract(silver) @ gap @ refract(front)
    assert pl.paraxial.cardinal_points(mangin()).efl == pytest.approx(-1.0 / matrix[1, 0], rel=1e-14)


def test_a_ring_stops_the_middle_and_passes_its_edges():
    lens = cassegrain(ring=18.0)
    y = np.array([0.0, 17.99, 18.0, 49.9, 50.0, 50.1])
    out = lens.trace(pl.RayBundle(np.stack([0 * y, y, 0 * y - 100.0], 1), [[0.0, 0.0, 1.0]] * 6))
    assert (out.status == 0).tolist() == [False, False, True, True, True, False]
    assert out.lost_at.tolist() == [0, 0, -1, -1, -1, 0]
    ring = pl.optics.RingStop(5.0, 2.0, thickness=1.0)
    assert ring.area == pytest.approx(math.pi * 21.0) and ring.image(-2.0) == pl.optics.RingStop(10.0, 4.0)
    assert ring.transmission_at([0.0, 3.0], 0.0).tolist() == [0.0, 1.0]
    with pytest.raises(pl.errors.InvalidValueError, match="inner_semi_diameter is 5 mm, and no light passes"):
        pl.optics.RingStop(5.0, 5.0)


def test_files_keep_mirrors_and_rings(tmp_path):
    askew = Mirror((0.0, 0.1, 1.0))
    lens = cassegrain(ring=18.0)
    bent = pl.LensStack([*lens.elements[:2], pl.Surface(90.0, medium=askew, semi_diameter=9.0)], name="bent")
    pl.save_lens(bent, tmp_path / "lens.json")
    assert pl.load_lens(tmp_path / "lens.json") == bent
    with pytest.raises(PrescriptionError, match="only round stops|element 0"):
        pl.save_lens(lens, tmp_path / "lens.zmx")
    with pytest.raises(PrescriptionError, match="element 1 is a mirror, which cannot be written as .zmx"):
        pl.save_lens(cassegrain(), tmp_path / "lens.zmx")
    table = "radius;thickness;material;index;v-no;sa\n;0;;;;50\n-400;140;mirror;;;52\n180;0;mirror;;;20\n"
    (tmp_path / "lens.csv").write_text(table)
    read = pl.load_lens(tmp_path / "lens.csv")
    assert [getattr(e, "medium", None) for e in read.elements] == [None, MIRROR, MIRROR]


def test_mirrors_say_what_they_are_not():
    for make, text in (
        (lambda: MIRROR.index(500.0), "a mirror has no refractive index at 500 nm"),
        (lambda: Mirror((1.0, 0.0, 0.0)), "fold is .*; it must be the normal of a plane"),
        (lambda: cassegrain().moved(slice(0, 3), shift=(0.1, 0, 0)), "lie on both sides of the mirror 1"),
    ):
        with pytest.raises(PrescriptionError, match=text):
            make()
    assert cassegrain().moved(slice(0, 2), shift=(0.1, 0.0, 0.0)).elements[1].placement is not None
    assert Mirror((0.0, 0.0, -2.0)) == MIRROR and mangin().indices(587.6).tolist() == [1.0, 1.0, 1.5, 1.5, 1.0]
    assert mangin().glasses == ((1, 2), (2, 3))
