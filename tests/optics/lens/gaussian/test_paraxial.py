"""Cardinal points, marginal and chief ray, apertures and conjugates; lenses in media and with aspheres."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import plenoptic as pl
from plenoptic import CircularStop, ConstantMedium, LensStack, Surface, lens_names, load_lens, paraxial
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.trace import trace_part

GLASS = ConstantMedium(1.5)
GAUSS = pl.load_lens("double-gauss-100mm-f2")
WATER = pl.ConstantMedium(1.333)
IN_WATER = pl.LensStack(
    [pl.Surface(60.0, 6.0, pl.ConstantMedium(1.9), semi_diameter=14.0, conic=-0.7),
     pl.Surface(-300.0, 9.0, WATER, semi_diameter=14.0, aspheric=(1e-3, 1e-6)), pl.CircularStop(4.0, thickness=5.0),
     pl.Surface(-60.0, 4.0, pl.ConstantMedium(1.6), semi_diameter=14.0),
     pl.Surface(-50.0, 0.0, WATER, semi_diameter=14.0)], name="in water", front_medium=WATER, rear_medium=WATER,
)  # fmt: skip
LENSES = [*map(pl.load_lens, pl.lens_names()), IN_WATER]
pytestmark = pytest.mark.filterwarnings("error")


def thin(f: float, gap: float = 0.0) -> list[Surface]:
    """A lens without thickness of focal length f: (n - 1) (1 / R1 - 1 / R2) = 1 / f with R2 = -R1 and n = 1.5."""
    return [Surface(f, 0.0, GLASS, semi_diameter=0.2), Surface(-f, gap, semi_diameter=0.2)]


def test_the_reference_lens():
    """The table of the reference camera; its last digit."""
    lens = load_lens("double-gauss-100mm-f2")
    points = paraxial.cardinal_points(lens)
    assert points.efl == pytest.approx(100.72, abs=0.005)
    assert points.rear_principal == pytest.approx(1.805, abs=0.0005)
    assert points.rear_focus == pytest.approx(102.52, abs=0.005)
    assert points.exit_pupil == pytest.approx(-5.23, abs=0.005)
    assert points.pupil_magnification == pytest.approx(1.552, abs=0.0005)
    assert points.f_number == pytest.approx(2.03, abs=0.005)
    assert paraxial.image_position(lens, -404.0) == pytest.approx(134.624, abs=0.0005)
    assert paraxial.magnification(lens, -404.0) == pytest.approx(-0.3187, abs=0.00005)


def test_newton():
    """x x' = -f^2 and m = f / x for distances from the foci; principal planes and pupils are images of each other."""
    for name in lens_names():
        lens = load_lens(name)
        points = paraxial.cardinal_points(lens)
        # Terms up to some 10^2 in 2 n products.
        assert np.linalg.det(paraxial.system_matrix(lens)) == pytest.approx(1.0, abs=1e-11), name
        for z in (-1e7, -4000.0, -700.0):
            image, ahead = paraxial.image_position(lens, z), z - points.front_focus
            # x' is a difference of numbers near 100 that may be as small as 1e-3.
            assert image - points.rear_focus == pytest.approx(-(points.efl**2) / ahead, rel=1e-7), (name, z)
            assert paraxial.magnification(lens, z) == pytest.approx(points.efl / ahead, rel=1e-12), (name, z)
            assert paraxial.object_position(lens, image) == pytest.approx(z, rel=1e-7), (name, z)
        front, entrance = points.front_principal, points.entrance_pupil
        assert paraxial.magnification(lens, front) == pytest.approx(1.0, rel=1e-10), name
        assert paraxial.image_position(lens, front) == pytest.approx(points.rear_principal, abs=1e-7), name
        assert paraxial.image_position(lens, entrance) == pytest.approx(points.exit_pupil, rel=1e-9, abs=1e-9), name
        ratio = points.exit_pupil_semi_diameter / points.entrance_pupil_semi_diameter
        assert abs(paraxial.magnification(lens, entrance)) == pytest.approx(ratio, rel=1e-10), name
        size = abs(points.pupil_magnification) * lens.stop.semi_diameter
        assert points.exit_pupil_semi_diameter == pytest.approx(size, rel=1e-15), name


def test_an_afocal_lens_and_a_plane_plate():
    """Kepler's telescope: the lateral magnification is -f2 / f1 wherever the object is."""
    for f1, f2 in ((100.0, 50.0), (93.7, 31.1), (1 / 3, 0.7), (1000.0, 10.0)):
        lens = LensStack([CircularStop(0.1, 0.0), *thin(f1, f1 + f2), *thin(f2)])
        points = paraxial.cardinal_points(lens)
        infinite = points.efl, points.bfl, points.rear_focus, points.rear_principal, points.f_number
        assert infinite == (math.inf,) * 5, (f1, f2)
        assert points.ffl == points.front_focus == points.front_principal == -math.inf, (f1, f2)
        assert paraxial.image_position(lens, -math.inf) == math.inf, (f1, f2)
        assert paraxial.object_position(lens, math.inf) == -math.inf, (f1, f2)
        for z in (-math.inf, -700.0, 3.0):
            assert paraxial.magnification(lens, z) == pytest.approx(-f2 / f1, rel=1e-12), (f1, f2)
        # Longitudinal magnification is the square of the lateral one.
        move = paraxial.image_position(lens, -100.0) - paraxial.image_position(lens, -101.0)
        assert move == pytest.approx((f2 / f1) ** 2, rel=1e-8, abs=1e-11), (f1, f2)
    # A plane plate is afocal.
    sides = Surface(math.inf, 6.0, GLASS, semi_diameter=9.0), Surface(math.inf, semi_diameter=9.0)
    plate = LensStack([CircularStop(1.0), *sides])
    assert paraxial.cardinal_points(plate).efl == math.inf
    # It moves an image by d (1 - 1 / n).
    assert paraxial.image_position(plate, -50.0) == pytest.approx(-50.0 + 6.0 * (1 - 1 / 1.5), rel=1e-14)
    assert paraxial.magnification(plate, -50.0) == 1.0


def test_telecentric_lenses():
    for f in (100.0, 93.7, 1 / 3, 77.77):
        lens = thin(f)
        image_side = paraxial.cardinal_points(LensStack([CircularStop(0.1, f), *lens]))
        assert image_side.exit_pupil == image_side.exit_pupil_semi_diameter == math.inf, f
        assert image_side.entrance_pupil == 0.0 and image_side.entrance_pupil_semi_diameter == 0.1, f
        object_side = paraxial.cardinal_points(LensStack([*thin(f, f), CircularStop(0.1)]))
        assert object_side.entrance_pupil == object_side.entrance_pupil_semi_diameter == math.inf, f
        assert (object_side.exit_pupil, object_side.pupil_magnification) == (0.0, 1.0), f


def test_the_focus_and_the_horizon():
    lens = load_lens("double-gauss-100mm-f2")
    points = paraxial.cardinal_points(lens)
    assert paraxial.image_position(lens, -math.inf) == points.rear_focus
    assert paraxial.object_position(lens, math.inf) == points.front_focus
    assert paraxial.magnification(lens, -math.inf) == 0.0
    thin_lens = LensStack([CircularStop(1.0), *thin(100.0)])
    assert paraxial.image_position(thin_lens, -100.0) == paraxial.magnification(thin_lens, -100.0) == math.inf
    assert paraxial.object_position(thin_lens, 100.0) == -math.inf
    negative = paraxial.cardinal_points(LensStack([CircularStop(1.0), *thin(-100.0)]))
    assert (negative.efl, negative.rear_focus, negative.f_number) == pytest.approx((-100.0, -100.0, 50.0), rel=1e-14)
    # Other stops have no part in it.
    lens = load_lens("double-gauss-100mm-f2")
    before, after = (paraxial.cardinal_points(x) for x in (lens, lens.inserted(CircularStop(1.0), 40.0)))
    for field in dataclasses.fields(before):
        # The exit pupil is counted from another last element: rounding of 40.
        assert getattr(after, field.name) == pytest.approx(getattr(before, field.name), rel=1e-13, abs=1e-13)


def test_what_is_no_lens_and_no_position_is_refused():
    of_positions = (paraxial.image_position, paraxial.object_position, paraxial.magnification)
    for function in (paraxial.system_matrix, paraxial.cardinal_points, *of_positions):
        with pytest.raises(InvalidValueError, match=r"lens is an int; give a LensStack, such as camera\.lens"):
            function(5, *[-404.0] * (function in of_positions))
    for function, z in itertools.product(of_positions, ("near", None, math.nan)):
        with pytest.raises(InvalidValueError, match=r"z_(object|image) is"):
            function(load_lens("singlet-100mm-f4"), z)


def test_a_paraxial_ray_goes_as_the_matrix_says_and_exact_rays_tend_to_it():
    for lens in LENSES:
        surfaces = [i for i, e in enumerate(lens.elements) if isinstance(e, pl.Surface)]
        first, last, left = surfaces[0], surfaces[-1], []
        for height, angle in ((1.0, 0.0), (0.0, 0.01), (3.0, -0.02)):
            ray = paraxial.paraxial_ray(lens, height=height, angle=angle)
            found = paraxial.system_matrix(lens) @ [ray.height[first], ray.angle[first]]
            # Some 40 products of heights up to some 10 mm.
            assert found == pytest.approx([ray.height[last], ray.angle[last + 1]], rel=1e-12, abs=1e-12), lens.name
        for scale in (0.02, 0.01):
            height, angle = 0.5 * lens.stop.semi_diameter * scale, -0.05 * scale
            rays = pl.RayBundle([[0.0, height, lens.vertices[0]]], [[0.0, angle, 1.0]])
            out = trace_part(lens, rays, 0, len(lens.elements) - 1, clipping=False)
            ray = paraxial.paraxial_ray(lens, height=height, angle=angle)
            slope = out.direction[0, 1] / out.direction[0, 2]
            left.append([out.at_z(lens.vertices[-1])[0, 1] - ray.height[-1], slope - ray.angle[-1]])
        # What is left is of the third order: an eighth, but for the fifth.
        assert np.divide(*left) == pytest.approx(8.0, rel=0.02), lens.name


def test_marginal_and_chief_ray_end_in_image_and_field():
    for lens, z_object in itertools.product(LENSES, (-math.inf, -5000.0, -2000.0)):
        case, far, i = (lens.name, z_object), math.isinf(z_object), lens.iris_index
        field = 0.2 if far else 50.0
        marginal, chief = paraxial.marginal_ray(lens, z_object), paraxial.chief_ray(lens, field, z_object)
        # Rounding of heights up to some 500 mm in front of the fisheye.
        assert marginal.height[i] == pytest.approx(lens.stop.semi_diameter, rel=1e-12), case
        assert marginal.height[0] > 0 and abs(chief.height[i]) < 1e-11, case
        if far:
            assert marginal.angle[0] == 0.0
            assert -chief.angle[0] == pytest.approx(math.tan(field), rel=1e-14), case
        else:
            before = lens.vertices[0] - z_object
            assert marginal.height[0] - before * marginal.angle[0] == pytest.approx(0.0, abs=1e-12), case
            assert chief.height[0] - before * chief.angle[0] == pytest.approx(field, rel=1e-12), case
        behind = paraxial.image_position(lens, z_object) - lens.vertices[-1]
        scale = -paraxial.cardinal_points(lens).efl if far else paraxial.magnification(lens, z_object)
        image = chief.height[-1] + behind * chief.angle[-1]
        assert marginal.height[-1] + behind * marginal.angle[-1] == pytest.approx(0.0, abs=1e-10), case
        assert image == pytest.approx(scale * (math.tan(field) if far else field), rel=1e-11), case
        # The chief ray points at the pupils, and the marginal ray at their rims.
        points = paraxial.cardinal_points(lens)
        to_entrance, to_exit = points.entrance_pupil - lens.vertices[0], points.exit_pupil - lens.vertices[-1]
        middles = chief.height[0] + chief.angle[0] * to_entrance, chief.height[-1] + chief.angle[-1] * to_exit
        assert middles == pytest.approx((0.0, 0.0), abs=1e-10), case
        at_entrance = marginal.height[0] + marginal.angle[0] * to_entrance
        at_exit = marginal.height[-1] + marginal.angle[-1] * to_exit
        assert abs(at_entrance) == pytest.approx(points.entrance_pupil_semi_diameter, rel=1e-11), case
        assert abs(at_exit) == pytest.approx(points.exit_pupil_semi_diameter, rel=1e-11), case
        # Lagrange's invariant is n' u' times the height of the image, and positive.
        invariant = paraxial.lagrange_invariant(marginal, chief)
        everywhere = marginal.index[1:] * (marginal.angle[1:] * chief.height - chief.angle[1:] * marginal.height)
        assert everywhere == pytest.approx(invariant, rel=1e-10), case
        assert 0 < invariant == pytest.approx(marginal.index[-1] * marginal.angle[-1] * image, rel=1e-10), case
        assert paraxial.lagrange_invariant(chief, marginal) == -invariant


def test_apertures_of_far_and_near_objects():
    for lens in LENSES:
        points, n = paraxial.cardinal_points(lens), float(lens.indices()[0])
        before, behind = paraxial.numerical_apertures(lens)
        assert before == 0.0
        assert behind == pytest.approx(n * points.entrance_pupil_semi_diameter / points.efl, rel=1e-11), lens.name
        assert paraxial.working_f_number(lens) == pytest.approx(points.f_number / n, rel=1e-11), lens.name
        for z_object in (-5000.0, -1500.0):
            m = paraxial.magnification(lens, z_object)
            before, behind = paraxial.numerical_apertures(lens, z_object)
            # Abbe's sine condition, paraxially.
            assert before == pytest.approx(abs(m) * behind, rel=1e-11), lens.name
            slope = points.entrance_pupil_semi_diameter / (points.entrance_pupil - z_object)
            assert before == pytest.approx(n * slope, rel=1e-11), lens.name
            # N (1 - m / p) with the pupils' magnification p (Smith, Modern Optical Engineering, 4th ed., section 9.7);
            # negative for objects within the front focal length, whose images are virtual.
            pupils = paraxial.magnification(lens, points.entrance_pupil)
            expected = abs(points.f_number / n * (1 - m / pupils))
            assert paraxial.working_f_number(lens, z_object) == pytest.approx(expected, rel=1e-10), lens.name


def test_conjugates_have_their_magnification():
    for lens, m in itertools.product(LENSES, (-30.0, -1.0, -0.3187, 0.5, 1.0, 7.0)):
        z_object, z_image = paraxial.conjugates(lens, m)
        points = paraxial.cardinal_points(lens)
        assert paraxial.magnification(lens, z_object) == pytest.approx(m, rel=1e-10), (lens.name, m)
        # Newton; differences of numbers up to the focal length times m.
        size = abs(points.efl) * max(1.0, abs(m), 1 / abs(m)) + abs(lens.vertices[0])
        expected = points.front_focus + points.efl / m, points.rear_focus - points.efl * m
        assert (z_object, z_image) == pytest.approx(expected, rel=0, abs=1e-13 * size), (lens.name, m)


@given(
    n0=st.one_of(st.just(1.0), st.floats(1.0, 1.8)),
    n=st.floats(1.3, 2.2),
    r1=st.one_of(st.floats(20.0, 1e4), st.floats(-1e4, -20.0)),
    r2=st.one_of(st.floats(20.0, 1e4), st.floats(-1e4, -20.0)),
    d=st.floats(0.0, 15.0),
)
def test_the_thick_lens_in_a_medium(n0, n, r1, r2, d):
    """Hecht, Optics, 5th ed., eqs. 6.1 to 6.4, with the relative index."""
    around, m = pl.ConstantMedium(n0), n / n0
    power = (m - 1) * (1 / r1 - 1 / r2 + (m - 1) * d / (m * r1 * r2))
    # The difference of indices keeps 1e-3 / 2 of its digits, the power 1e-6 of terms of up to 0.1: 10 eps / 5e-9.
    assume(abs(power) > 1e-6 and abs(m - 1) > 1e-3)
    lens = pl.LensStack(
        [pl.CircularStop(1.0), pl.Surface(r1, d, pl.ConstantMedium(n), semi_diameter=5.0),
         pl.Surface(r2, 0.0, around, semi_diameter=5.0)], front_medium=around, rear_medium=around
    )  # fmt: skip
    points, f = paraxial.cardinal_points(lens), 1 / power
    close = {"rel": 1e-9, "abs": 1e-9 * abs(f)}
    assert points.efl == pytest.approx(f, rel=1e-9)
    assert points.front_principal == pytest.approx(-f * (m - 1) * d / (m * r2), **close)
    assert points.rear_principal == pytest.approx(d - f * (m - 1) * d / (m * r1), **close)
    assert points.exit_pupil == pytest.approx(paraxial.image_position(lens, 0.0), rel=1e-9)
    assert np.linalg.det(paraxial.system_matrix(lens)) == pytest.approx(1.0, rel=1e-12)
    assert points.rear_focus - points.rear_principal == pytest.approx(points.efl, rel=1e-12)
    assert points.front_principal - points.front_focus == pytest.approx(points.efl, rel=1e-12)
    assert [points.bfl, points.ffl] == pytest.approx([points.rear_focus - d, points.front_focus], **close)


def test_telecentric_and_afocal_lenses():
    telecentric = LensStack([*thin(77.77, 77.77), CircularStop(0.1)])
    telescope = LensStack([CircularStop(0.1), *thin(100.0, 150.0), *thin(50.0)])
    for call, text in (
        (lambda: paraxial.chief_ray(telecentric, 0.1), "the entrance pupil is at infinity; give an object plane"),
        (lambda: paraxial.marginal_ray(telecentric), "onto its iris"),
        (lambda: paraxial.conjugates(telescope, -1.0), r"afocal, so its magnification is -0\.5 for all planes"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=text):
            call()
    chief = paraxial.chief_ray(telecentric, 5.0, -200.0)
    assert chief.angle[0] == 0.0 and chief.height[-1] == pytest.approx(0.0, abs=1e-14)
    assert paraxial.working_f_number(telescope) == math.inf


def test_impossible_questions_are_refused():
    for call, message in (
        (lambda: paraxial.conjugates(GAUSS, 0.0), "magnification is 0"),
        (lambda: paraxial.conjugates(GAUSS, math.inf), "magnification is inf"),
        (lambda: paraxial.marginal_ray(GAUSS, 5.0), "must lie in front of the first element"),
        (lambda: paraxial.marginal_ray(GAUSS, math.inf), "must lie in front of the first element"),
        (lambda: paraxial.marginal_ray(GAUSS, math.nan), "z_object is nan"),
        (lambda: paraxial.chief_ray(GAUSS, math.nan), "field is nan"),
        (lambda: paraxial.chief_ray(GAUSS, math.pi / 2), "less than pi / 2"),
        (lambda: paraxial.paraxial_ray(GAUSS, height=math.inf, angle=0.0), "height is inf"),
        (lambda: paraxial.numerical_apertures(5), "lens is an int; give a LensStack"),
        (lambda: paraxial.chief_ray(None, 0.1), "give a LensStack"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            call()
