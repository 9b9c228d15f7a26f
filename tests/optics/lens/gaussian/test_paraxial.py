import dataclasses
import math
import warnings
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from plenoptic import paraxial
from plenoptic.errors import InvalidValueError
from plenoptic.optics.glass.media import AIR, ConstantMedium
from plenoptic.optics.lens.files.library import lens_names, load_lens
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.stops.circle import CircularStop
from plenoptic.optics.surfaces.surface import Surface

GLASS = ConstantMedium(1.5)


@pytest.fixture(autouse=True)
def no_warnings() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def thin(f: float, gap: float = 0.0) -> list[Surface]:
    """A lens without thickness of focal length f: (n - 1) (1 / R1 - 1 / R2) = 1 / f with R2 = -R1 and n = 1.5."""
    return [Surface(f, 0.0, GLASS, semi_diameter=0.2), Surface(-f, gap, semi_diameter=0.2)]


# ---- numbers ----


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


@dataclasses.dataclass
class Published:
    """Of a lens, with half a unit of the last digit to which its lengths and its indices are printed."""

    name: str
    efl: float | None
    bfl: float
    f_number: float
    length_digit: float = 0.0005
    index_digit: float = 0.0005


PUBLISHED = [
    # W. J. Smith, Modern Lens Design, 1992, pages 312, 351, 166, 178 and 186: scaled to 100 mm (Mandler's is not), the
    # last distance of the table, and the aperture of the title.
    Published("double-gauss-100mm-f2", 100.0, 72.228, 2.0),
    Published("double-gauss-105mm-f1.4", None, 62.112, 1.4),
    Published("fisheye-100mm-f8", 100.0, 150.119, 8.0),
    Published("telephoto-100mm-f2.8", 100.0, 22.862, 2.8),
    Published("topogon-100mm-f6.3", 100.0, 77.809, 6.3),
    # Thorlabs AC254-100-A, catalogue: f = 100.1 mm, f_b = 97.1 mm, 90 % of 25.4 mm.
    Published("achromat-100mm-f4.4", 100.1, 97.1, 4.38, length_digit=0.05, index_digit=0.0),
]


def as_printed(lens: LensStack, length_digit: float, index_digit: float) -> list[LensStack]:
    """The same lens with one number after the other larger by half a unit of its last printed digit."""
    made = []
    for i, element in enumerate(lens.elements):
        changes: list[dict[str, object]] = []
        if isinstance(element, Surface):
            if lens.gap_media[i + 1] != AIR and index_digit > 0:
                nd = element.medium.index(587.5618) + index_digit
                changes.append({"medium": ConstantMedium(nd)})
            if math.isfinite(element.radius):
                changes.append({"radius": element.radius + length_digit})
        if i + 1 < len(lens.elements) and element.thickness > 0:
            changes.append({"thickness": element.thickness + length_digit})
        for change in changes:
            elements = [*lens.elements[:i], dataclasses.replace(element, **change), *lens.elements[i + 1 :]]
            made.append(dataclasses.replace(lens, elements=elements))
    return made


@pytest.mark.parametrize("published", PUBLISHED, ids=lambda published: published.name)
def test_published_values(published: Published):
    lens = load_lens(published.name)
    points = paraxial.cardinal_points(lens, 587.5618)
    others = [
        paraxial.cardinal_points(other, 587.5618)
        for other in as_printed(lens, published.length_digit, published.index_digit)
    ]
    # What digits that are not printed leave open: each one even within half a unit, so sqrt(1/3) of it; two deviations.
    open_bfl = 2 * math.sqrt(sum((other.bfl - points.bfl) ** 2 for other in others) / 3)
    open_efl = 2 * math.sqrt(sum((other.efl - points.efl) ** 2 for other in others) / 3)
    assert open_bfl < 1.0
    assert points.bfl == pytest.approx(published.bfl, abs=open_bfl + published.length_digit)
    if published.efl is not None:
        # What is scaled to 100 mm is so to a unit of the third digit.
        last_digit = published.length_digit if published.index_digit == 0 else 1.0
        assert points.efl == pytest.approx(published.efl, abs=open_efl + last_digit)
    # Apertures are round numbers of the usual series; 6.3 stands for 2^(8/3) = 6.35.
    assert points.f_number == pytest.approx(published.f_number, rel=0.03)


# ---- closed forms ----


@given(f1=st.floats(20.0, 500.0), f2=st.floats(20.0, 500.0), d=st.floats(0.0, 300.0))
def test_two_thin_lenses(f1: float, f2: float, d: float):
    """Gullstrand: 1 / f = 1 / f1 + 1 / f2 - d / (f1 f2)."""
    assume(abs(f1 + f2 - d) > 0.01)
    points = paraxial.cardinal_points(LensStack([CircularStop(1.0), *thin(f1, d), *thin(f2)]))
    # The difference f1 + f2 - d of numbers up to 1000 keeps 0.01: 1e5 of some 10 eps.
    assert points.efl == pytest.approx(f1 * f2 / (f1 + f2 - d), rel=1e-9)
    assert points.bfl == pytest.approx(f2 * (f1 - d) / (f1 + f2 - d), rel=1e-9, abs=1e-8)


@given(n0=st.sampled_from([1.0, 1.333]), m=st.floats(1.3, 2.5), radius=st.floats(0.1, 100.0))
def test_the_ball_lens(n0: float, m: float, radius: float):
    """efl = m R / (2 (m - 1)) with the relative index m, principal planes in its middle."""
    around = ConstantMedium(n0)
    first = Surface(radius, radius, ConstantMedium(m * n0), semi_diameter=radius)
    last = Surface(-radius, 0.0, around, semi_diameter=radius)
    ball = LensStack([first, CircularStop(radius / 2, radius), last], ambient=around)
    points = paraxial.cardinal_points(ball)
    assert points.efl == pytest.approx(m * radius / (2 * (m - 1)), rel=1e-13)
    assert points.front_principal == pytest.approx(0.0, abs=1e-12 * radius)
    assert points.rear_principal == pytest.approx(0.0, abs=1e-12 * radius)


# ---- laws ----


@pytest.mark.parametrize("name", lens_names())
def test_the_determinant_is_one(name: str):
    # Terms up to some 10^2 in 2 n products.
    assert np.linalg.det(paraxial.system_matrix(load_lens(name))) == pytest.approx(1.0, abs=1e-11)


@pytest.mark.parametrize("name", lens_names())
@pytest.mark.parametrize("z", [-1e7, -4000.0, -700.0])
def test_newton(name: str, z: float):
    """x x' = -f^2 and m = f / x for distances from the foci."""
    lens = load_lens(name)
    points = paraxial.cardinal_points(lens)
    image = paraxial.image_position(lens, z)
    # x' is a difference of numbers near 100 that may be as small as 1e-3.
    assert image - points.rear_focus == pytest.approx(-(points.efl**2) / (z - points.front_focus), rel=1e-7)
    assert paraxial.magnification(lens, z) == pytest.approx(points.efl / (z - points.front_focus), rel=1e-12)
    assert paraxial.object_position(lens, image) == pytest.approx(z, rel=1e-7)


@given(z=st.floats(-1e5, 1e5))
def test_conjugates_are_each_others_inverse(z: float):
    lens = load_lens("double-gauss-100mm-f2")
    image = paraxial.image_position(lens, z)
    assume(abs(image) < 1e6)
    # dz / dz' = -(x / f)^2, at most 1e6, times the rounding of z', some 1e-13.
    assert paraxial.object_position(lens, image) == pytest.approx(z, rel=1e-9, abs=1e-6)


@pytest.mark.parametrize("name", lens_names())
def test_principal_planes_are_imaged_one_to_one(name: str):
    lens = load_lens(name)
    points = paraxial.cardinal_points(lens)
    assert paraxial.magnification(lens, points.front_principal) == pytest.approx(1.0, rel=1e-10)
    assert paraxial.image_position(lens, points.front_principal) == pytest.approx(points.rear_principal, abs=1e-7)


@pytest.mark.parametrize("name", lens_names())
def test_the_lens_images_one_pupil_to_the_other(name: str):
    lens = load_lens(name)
    points = paraxial.cardinal_points(lens)
    assert paraxial.image_position(lens, points.entrance_pupil) == pytest.approx(points.exit_pupil, rel=1e-9, abs=1e-9)
    ratio = points.exit_pupil_semi_diameter / points.entrance_pupil_semi_diameter
    assert abs(paraxial.magnification(lens, points.entrance_pupil)) == pytest.approx(ratio, rel=1e-10)
    assert points.exit_pupil_semi_diameter == pytest.approx(
        abs(points.pupil_magnification) * lens.stop.semi_diameter, rel=1e-15
    )


@given(factor=st.floats(0.01, 100.0))
def test_lengths_scale(factor: float):
    lens = load_lens("double-gauss-100mm-f2")
    scaled = LensStack(
        [
            dataclasses.replace(e, thickness=e.thickness * factor, semi_diameter=e.semi_diameter * factor)
            if not isinstance(e, Surface)
            else Surface(e.radius * factor, e.thickness * factor, e.medium, semi_diameter=e.semi_diameter * factor)
            for e in lens.elements
        ]
    )
    before, after = paraxial.cardinal_points(lens), paraxial.cardinal_points(scaled)
    # Some 40 products of rounded numbers.
    assert after.efl == pytest.approx(before.efl * factor, rel=1e-12)
    assert after.exit_pupil == pytest.approx(before.exit_pupil * factor, rel=1e-11)
    assert after.f_number == pytest.approx(before.f_number, rel=1e-12)


def test_a_symmetric_lens_has_symmetric_pupils():
    points = paraxial.cardinal_points(
        LensStack(
            [
                Surface(30.0, 5.0, GLASS, semi_diameter=10.0),
                Surface(80.0, 7.0, semi_diameter=10.0),
                CircularStop(4.0, 7.0),
                Surface(-80.0, 5.0, GLASS, semi_diameter=10.0),
                Surface(-30.0, semi_diameter=10.0),
            ]
        )
    )
    assert points.exit_pupil == pytest.approx(-points.entrance_pupil, rel=1e-13)
    assert points.exit_pupil_semi_diameter == pytest.approx(points.entrance_pupil_semi_diameter, rel=1e-13)
    assert points.rear_focus == pytest.approx(-points.front_focus, rel=1e-13)
    # Pupils of a symmetric lens lie in its principal planes.
    assert points.exit_pupil == pytest.approx(points.rear_principal, rel=1e-12)


# ---- limits ----


@pytest.mark.parametrize(("f1", "f2"), [(100.0, 50.0), (93.7, 31.1), (1 / 3, 0.7), (1000.0, 10.0)])
def test_an_afocal_lens(f1: float, f2: float):
    """Kepler's telescope: the lateral magnification is -f2 / f1 wherever the object is."""
    lens = LensStack([CircularStop(0.1, 0.0), *thin(f1, f1 + f2), *thin(f2)])
    points = paraxial.cardinal_points(lens)
    assert points.efl == points.bfl == points.rear_focus == points.rear_principal == points.f_number == math.inf
    assert points.ffl == points.front_focus == points.front_principal == -math.inf
    assert paraxial.image_position(lens, -math.inf) == math.inf
    assert paraxial.object_position(lens, math.inf) == -math.inf
    for z in (-math.inf, -700.0, 3.0):
        assert paraxial.magnification(lens, z) == pytest.approx(-f2 / f1, rel=1e-12)
    # Longitudinal magnification is the square of the lateral one.
    move = paraxial.image_position(lens, -100.0) - paraxial.image_position(lens, -101.0)
    assert move == pytest.approx((f2 / f1) ** 2, rel=1e-8, abs=1e-11)


def test_a_plane_plate_is_afocal():
    plate = LensStack(
        [CircularStop(1.0), Surface(math.inf, 6.0, GLASS, semi_diameter=9.0), Surface(math.inf, semi_diameter=9.0)]
    )
    assert paraxial.cardinal_points(plate).efl == math.inf
    # It moves an image by d (1 - 1 / n).
    assert paraxial.image_position(plate, -50.0) == pytest.approx(-50.0 + 6.0 * (1 - 1 / 1.5), rel=1e-14)
    assert paraxial.magnification(plate, -50.0) == 1.0


@pytest.mark.parametrize("f", [100.0, 93.7, 1 / 3, 77.77])
def test_telecentric_lenses(f: float):
    lens = thin(f)
    image_side = paraxial.cardinal_points(LensStack([CircularStop(0.1, f), *lens]))
    assert image_side.exit_pupil == image_side.exit_pupil_semi_diameter == math.inf
    assert image_side.entrance_pupil == 0.0
    assert image_side.entrance_pupil_semi_diameter == 0.1
    object_side = paraxial.cardinal_points(
        LensStack([lens[0], dataclasses.replace(lens[1], thickness=f), CircularStop(0.1)])
    )
    assert object_side.entrance_pupil == object_side.entrance_pupil_semi_diameter == math.inf
    assert (object_side.exit_pupil, object_side.pupil_magnification) == (0.0, 1.0)


def test_a_negative_lens():
    lens = LensStack([CircularStop(1.0), *thin(-100.0)])
    points = paraxial.cardinal_points(lens)
    assert points.efl == pytest.approx(-100.0, rel=1e-14)
    assert points.rear_focus == pytest.approx(-100.0, rel=1e-14)
    assert points.f_number == pytest.approx(50.0, rel=1e-14)


def test_the_focus_and_the_horizon():
    lens = load_lens("double-gauss-100mm-f2")
    points = paraxial.cardinal_points(lens)
    assert paraxial.image_position(lens, -math.inf) == points.rear_focus
    assert paraxial.object_position(lens, math.inf) == points.front_focus
    assert paraxial.magnification(lens, -math.inf) == 0.0
    thin_lens = LensStack([CircularStop(1.0), *thin(100.0)])
    assert paraxial.image_position(thin_lens, -100.0) == paraxial.magnification(thin_lens, -100.0) == math.inf
    assert paraxial.object_position(thin_lens, 100.0) == -math.inf


@pytest.mark.parametrize("function", [paraxial.image_position, paraxial.object_position, paraxial.magnification])
@pytest.mark.parametrize("z", ["near", None, math.nan])
def test_what_is_no_position(function, z):
    with pytest.raises(InvalidValueError, match=r"z_(object|image) is"):
        function(load_lens("singlet-100mm-f4"), z)


def test_other_stops_have_no_part_in_it():
    lens = load_lens("double-gauss-100mm-f2")
    before, after = (paraxial.cardinal_points(x) for x in (lens, lens.inserted(CircularStop(1.0), 40.0)))
    for field in dataclasses.fields(before):
        # The exit pupil is counted from another last element: rounding of 40.
        assert getattr(after, field.name) == pytest.approx(getattr(before, field.name), rel=1e-13, abs=1e-13)


def test_a_camera_is_no_lens():
    @dataclasses.dataclass
    class Camera:
        lens: LensStack

    camera = Camera(load_lens("double-gauss-100mm-f2"))
    asked = [
        lambda: paraxial.system_matrix(camera),
        lambda: paraxial.cardinal_points(camera),
        lambda: paraxial.image_position(camera, -404.0),
        lambda: paraxial.object_position(camera, 134.0),
        lambda: paraxial.magnification(camera, -404.0),
    ]
    for ask in asked:
        with pytest.raises(InvalidValueError, match=r"lens is a Camera; give a LensStack, such as camera\.lens"):
            ask()


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
