import dataclasses
import itertools
import math

import numpy as np
import pytest

from plenoptic import CircularStop, ConstantMedium, LensStack, Surface, lens_names, load_lens, paraxial
from plenoptic.errors import InvalidValueError

GLASS = ConstantMedium(1.5)


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
        assert points.efl == points.bfl == points.rear_focus == points.rear_principal == points.f_number == math.inf, (
            f1,
            f2,
        )
        assert points.ffl == points.front_focus == points.front_principal == -math.inf, (f1, f2)
        assert paraxial.image_position(lens, -math.inf) == math.inf, (f1, f2)
        assert paraxial.object_position(lens, math.inf) == -math.inf, (f1, f2)
        for z in (-math.inf, -700.0, 3.0):
            assert paraxial.magnification(lens, z) == pytest.approx(-f2 / f1, rel=1e-12), (f1, f2)
        # Longitudinal magnification is the square of the lateral one.
        move = paraxial.image_position(lens, -100.0) - paraxial.image_position(lens, -101.0)
        assert move == pytest.approx((f2 / f1) ** 2, rel=1e-8, abs=1e-11), (f1, f2)
    # A plane plate is afocal.
    plate = LensStack(
        [CircularStop(1.0), Surface(math.inf, 6.0, GLASS, semi_diameter=9.0), Surface(math.inf, semi_diameter=9.0)]
    )
    assert paraxial.cardinal_points(plate).efl == math.inf
    # It moves an image by d (1 - 1 / n).
    assert paraxial.image_position(plate, -50.0) == pytest.approx(-50.0 + 6.0 * (1 - 1 / 1.5), rel=1e-14)
    assert paraxial.magnification(plate, -50.0) == 1.0


def test_telecentric_lenses():
    for f in (100.0, 93.7, 1 / 3, 77.77):
        lens = thin(f)
        image_side = paraxial.cardinal_points(LensStack([CircularStop(0.1, f), *lens]))
        assert image_side.exit_pupil == image_side.exit_pupil_semi_diameter == math.inf, f
        assert image_side.entrance_pupil == 0.0, f
        assert image_side.entrance_pupil_semi_diameter == 0.1, f
        object_side = paraxial.cardinal_points(
            LensStack([lens[0], dataclasses.replace(lens[1], thickness=f), CircularStop(0.1)])
        )
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
    @dataclasses.dataclass
    class Camera:
        lens: LensStack

    camera, lens = Camera(load_lens("double-gauss-100mm-f2")), load_lens("singlet-100mm-f4")
    of_positions = (paraxial.image_position, paraxial.object_position, paraxial.magnification)
    for function in (paraxial.system_matrix, paraxial.cardinal_points, *of_positions):
        with pytest.raises(InvalidValueError, match=r"lens is a Camera; give a LensStack, such as camera\.lens"):
            function(camera, *[-404.0] * (function in of_positions))
    for function, z in itertools.product(of_positions, ("near", None, math.nan)):
        with pytest.raises(InvalidValueError, match=r"z_(object|image) is"):
            function(lens, z)


def test_cardinal_points_are_shown_one_a_line_with_their_units():
    points = paraxial.cardinal_points(load_lens("double-gauss-100mm-f2"), 546.1)
    title, *lines = repr(points).splitlines()
    assert title == "CardinalPoints at 546.1 nm"
    shown = {name: (float(number), unit) for name, number, *unit in map(str.split, lines)}
    fields = [field.name for field in dataclasses.fields(points) if field.name != "wavelength"]
    assert list(shown) == fields
    for name, (number, unit) in shown.items():
        # Six significant digits.
        assert number == pytest.approx(getattr(points, name), rel=5e-6)
        assert unit == ([] if name in ("pupil_magnification", "f_number") else ["mm"])
