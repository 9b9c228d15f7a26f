"""Seidel sums: the limit of exact rays, laws of the sums, closed forms, and surfaces free of an aberration.

Sums of surfaces are products of some ten rounded numbers; where they cancel in the lens, tolerances count from the
largest. What a tolerance has beyond that is said where it stands.
"""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_fields import ASPHERIC, GLASS

import plenoptic as pl
from plenoptic.aberrations import seidel_sums
from plenoptic.aiming import aimed_rays
from plenoptic.optics.lens.elements import with_round_stops
from plenoptic.optics.lens.trace import trace_part

GAUSS = pl.load_lens("double-gauss-100mm-f2")
WATER = pl.ConstantMedium(1.333)
IN_WATER = pl.LensStack(
    [pl.Surface(60.0, 6.0, pl.ConstantMedium(1.9), semi_diameter=14.0, conic=-0.7),
     pl.Surface(-300.0, 9.0, WATER, semi_diameter=14.0), pl.CircularStop(4.0, thickness=5.0),
     pl.Surface(-60.0, 4.0, GLASS, semi_diameter=14.0), pl.Surface(-50.0, 0.0, WATER, semi_diameter=14.0)],
    name="in water", front_medium=WATER, rear_medium=WATER,
)  # fmt: skip
CASSEGRAIN = pl.LensStack(
    [pl.CircularStop(50.0), pl.Surface(-400.0, 140.0, pl.optics.MIRROR, semi_diameter=52.0, conic=-1.0),
     pl.Surface(180.0, 0.0, pl.optics.MIRROR, semi_diameter=20.0, conic=-4.0)], name="Cassegrain",
)  # fmt: skip
MANGIN = pl.LensStack(
    [pl.CircularStop(10.0, thickness=5.0), pl.Surface(-120.0, 8.0, pl.ConstantMedium(1.5), semi_diameter=14.0),
     pl.Surface(-180.0, 8.0, pl.optics.MIRROR, semi_diameter=14.0, aspheric=(0.0, 1e-7)),
     pl.Surface(120.0, semi_diameter=14.0)], name="Mangin",
)  # fmt: skip
BUNDLED = [*map(pl.load_lens, pl.lens_names())]
# Without discs in the middle of stops, which shade rays near the axis.
LENSES = [dataclasses.replace(lens, elements=with_round_stops(lens.elements)) for lens in BUNDLED]
LENSES += [CASSEGRAIN, MANGIN, ASPHERIC, IN_WATER]


PUPIL = np.array([[0.0, 1.0], [0.0, -0.7], [1.0, 0.0], [0.6, 0.6], [-0.5, 0.3], [0.0, 0.0]])


def miss_and_third_order(lens: pl.LensStack, z_object: float, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """Where exact rays miss the Gaussian image, and what the sums say of it, (n, 2) each, in mm."""
    small = lens.with_stop(pl.CircularStop(lens.stop.semi_diameter * scale))
    field = scale * (0.3 if math.isinf(z_object) else 90.0)
    sums = seidel_sums(small, field=field, z_object=z_object)
    (w040, w131, w222, w220, w311), (x, y) = sums.wavefront, PUPIL.T
    square = x * x + y * y
    slope_x = 4 * w040 * square * x + 2 * w131 * x * y + 2 * w220 * x
    slope_y = 4 * w040 * square * y + w131 * (square + 2 * y * y) + 2 * (w222 + w220) * y + w311
    rays = aimed_rays(small, field=(0.0, field), z_object=z_object, pupil=PUPIL)
    out = trace_part(small, rays, 0, len(small.elements) - 1, clipping=False)
    far = math.isinf(z_object)
    efl, m = pl.paraxial.cardinal_points(small).efl, pl.paraxial.magnification(small, z_object)
    ideal = -efl * math.tan(field) if far else m * field
    found = out.at_z(pl.paraxial.image_position(small, z_object))[:, :2] - [0.0, ideal]
    return found, np.column_stack([slope_x, slope_y]) / sums.aperture


def test_exact_rays_tend_to_the_third_order():
    for lens, z_object in itertools.product(LENSES, (-math.inf, -300.0)):
        if lens.name[:7] in ("fisheye", "mirror-"):
            # The sixth element of the fisheye meets objects at 300 mm; what its mirror lens leaves is of the seventh
            # order here.
            continue
        found = [miss_and_third_order(lens, z_object, scale) for scale in (0.1, 0.05)]
        remainders = [np.abs(exact - third).max() for exact, third in found]
        # All signs and factors are right if what is left is of the fifth order: half the aperture and field, a 32nd.
        # The seventh order disturbs that by some (0.1)^2 times coefficients of about 10.
        assert remainders[0] / remainders[1] == pytest.approx(32.0, rel=0.1), (lens.name, z_object)
        assert remainders[1] < 0.1 * np.abs(found[1][1]).max(), (lens.name, z_object)


def test_transverse_aberrations_are_those_of_the_rim():
    exact, third = miss_and_third_order(ASPHERIC, -300.0, 0.05)
    small = ASPHERIC.with_stop(pl.CircularStop(ASPHERIC.stop.semi_diameter * 0.05))
    spherical, coma, tangential, sagittal, distortion = seidel_sums(small, field=4.5, z_object=-300.0).transverse
    # The first ray goes through the top of the iris, the third through its side, the last through its centre.
    assert spherical + coma + tangential + distortion == pytest.approx(third[0, 1], rel=1e-13)
    assert spherical + sagittal == pytest.approx(third[2, 0], rel=1e-13)
    assert distortion == pytest.approx(third[5, 1], rel=1e-13)
    assert exact == pytest.approx(third, rel=0.05, abs=1e-6)


def test_the_petzval_sum_and_distortion_as_the_other_sums_have_it():
    """Welford's first form: S_V = (S_III + S_IV) Abar / A of each spherical surface."""
    for lens in LENSES:
        sums, below = (seidel_sums(lens, field=field) for field in (0.1, -0.1))
        invariant = pl.paraxial.lagrange_invariant(pl.paraxial.marginal_ray(lens), pl.paraxial.chief_ray(lens, 0.1))
        curvature = np.array([getattr(e, "vertex_curvature", 0.0) for e in lens.elements])
        # Behind a mirror the index counts as negative.
        mirrors = [getattr(e, "medium", None) == pl.optics.MIRROR for e in lens.elements]
        step = np.where(mirrors, -1, 1) / lens.indices()[1:] - 1 / lens.indices()[:-1]
        assert sums.petzval == pytest.approx(-(invariant**2) * curvature * step, rel=1e-13), lens.name
        assert sums.total[3] == pytest.approx(sums.petzval.sum(), rel=1e-12), lens.name
        # Those of odd order change signs with the field.
        assert np.array_equal(sums.table * [1, -1, 1, 1, -1], below.table), lens.name
        elements = list(lens.elements)
        for i, e in enumerate(elements):
            if isinstance(e, pl.Surface):
                size = min(e.semi_diameter, abs(e.radius))
                elements[i] = dataclasses.replace(e, conic=0.0, aspheric=(), semi_diameter=size)
        sums = seidel_sums(dataclasses.replace(lens, elements=elements), field=0.2)
        bent = np.abs(sums.coma) > 1e-6 * np.abs(sums.coma).max()
        expected = ((sums.astigmatism + sums.petzval) * sums.coma)[bent] / sums.spherical[bent]
        assert sums.distortion[bent] == pytest.approx(expected, rel=1e-9, abs=1e-13), lens.name


def thin_lens(focal_length: float, index: float, shape: float, stop: float) -> pl.LensStack:
    """A lens without thickness, its iris on it; shape (c1 + c2) / (c1 - c2)."""
    difference = 1.0 / (focal_length * (index - 1))
    r1, r2 = (1 / c if c else math.inf for c in (0.5 * difference * (shape + 1), 0.5 * difference * (shape - 1)))
    front = pl.Surface(r1, 0.0, pl.ConstantMedium(index), semi_diameter=min(10.0, abs(r1)))
    return pl.LensStack([pl.CircularStop(stop), front, pl.Surface(r2, semi_diameter=min(10.0, abs(r2)))])


@settings(max_examples=50)
@given(
    f=st.sampled_from([100.0, -70.0]),
    n=st.floats(1.3, 2.5),
    shape=st.floats(-3, 3),
    z_object=st.one_of(st.just(-math.inf), st.floats(-1e4, -150.0)),
    field=st.floats(0.01, 0.3),
)
def test_a_thin_lens(f, n, shape, z_object, field):
    """Welford, chapter 12, with shape X, conjugates Y = (u + u') / (u - u') and the stop at the lens."""
    h = 5.0
    u = 0.0 if math.isinf(z_object) else h / -z_object
    y = (2 * u - h / f) / (h / f)
    size = field if math.isinf(z_object) else field * -z_object
    invariant = h * math.tan(field) if math.isinf(z_object) else u * size
    bracket = (n / (n - 1)) ** 2 - n / (n + 2) * y * y
    bracket += (n + 2) / (n * (n - 1) ** 2) * (shape + 2 * (n * n - 1) / (n + 2) * y) ** 2
    spherical = h**4 / (4 * f**3) * bracket
    coma = -(h**2) * invariant / (2 * f**2) * ((n + 1) / (n * (n - 1)) * shape + (2 * n + 1) / n * y)
    expected = [spherical, coma, invariant**2 / f, invariant**2 / (n * f), 0.0]
    sums = seidel_sums(thin_lens(f, n, shape, h), field=size, z_object=z_object)
    # The two surfaces cancel more, the flatter the lens is for its curvatures.
    assert np.all(np.abs(sums.total - expected) <= 1e-12 * np.abs(sums.table).sum(axis=0) + 1e-15)


def front_of_glass(n: float, radius: float, rim: float, **shape) -> pl.LensStack:
    first = pl.Surface(radius, 0.1, pl.ConstantMedium(n), semi_diameter=0.5 * radius, **shape)
    return pl.LensStack([pl.CircularStop(rim), first, pl.Surface(math.inf, semi_diameter=radius)])


@given(n=st.floats(1.2, 3.0), radius=st.floats(5.0, 500.0))
def test_an_ellipsoid_collects_parallel_light(n, radius):
    """Descartes: k = -1 / n^2; in third order its r^4 term on a sphere does the same."""
    k = -1 / n**2
    plain = seidel_sums(front_of_glass(n, radius, 0.1 * radius), field=0.1)
    fourth = k / (8 * radius**3)
    for shape in ({"conic": k}, {"aspheric": (0.0, fourth)}, {"aspheric": (0.0, fourth, radius**-5)}):
        sums = seidel_sums(front_of_glass(n, radius, 0.1 * radius, **shape), field=0.1)
        assert abs(sums.spherical[1]) <= 1e-14 * plain.spherical[1] and sums.petzval[1] == plain.petzval[1]


def plate(n: float, thickness: float, stop: float) -> pl.LensStack:
    front = pl.Surface(math.inf, thickness, pl.ConstantMedium(n), semi_diameter=100.0)
    return pl.LensStack([pl.CircularStop(stop), front, pl.Surface(math.inf, semi_diameter=100.0)])


@given(u=st.floats(0.01, 0.3), n=st.floats(1.2, 2.5), thickness=st.floats(0.1, 30.0))
def test_a_plane_plate_in_parallel_light_and_in_a_beam_that_spreads(u, n, thickness):
    """S_I = -d u^4 (n^2 - 1) / n^3: overcorrected in a converging beam too, by the even power of u."""
    sums = seidel_sums(plate(n, thickness, 5.0), field=u)
    assert not sums.total[:4].any() and abs(sums.total[4]) <= 1e-15 and not np.isfinite(sums.transverse).any()
    sums = seidel_sums(plate(n, thickness, 100.0 * u), field=1.0, z_object=-100.0)
    # The difference of the two surfaces, 100 u against d u.
    tolerance = 1e-13 * np.abs(sums.spherical).max()
    assert sums.total[0] == pytest.approx(-thickness * u**4 * (n * n - 1) / n**3, rel=1e-12, abs=tolerance)


def test_impossible_questions_are_refused():
    for call, message in (
        (lambda: seidel_sums(GAUSS, field=0.1, z_object=5.0), "must lie in front of the first element"),
        (lambda: seidel_sums("lens", field=0.1), "lens is a str; give a LensStack"),
        (lambda: seidel_sums(GAUSS, field=0.1, wavelength=100.0), "100"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            call()
