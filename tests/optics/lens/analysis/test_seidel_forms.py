"""Seidel sums of lenses and surfaces that have closed forms, and of those that are free of an aberration.

Sums of surfaces are products of some ten rounded numbers; where they cancel, tolerances count from the largest.
"""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import plenoptic as pl
from plenoptic.aberrations import seidel_sums

GLASS = pl.ConstantMedium(1.6)


# ---- closed forms ----


def thin_lens(focal_length: float, index: float, shape: float, stop: float) -> pl.LensStack:
    """A lens without thickness, its iris on it; shape (c1 + c2) / (c1 - c2)."""
    difference = 1.0 / (focal_length * (index - 1))
    c1, c2 = 0.5 * difference * (shape + 1), 0.5 * difference * (shape - 1)
    r1, r2 = (1 / c if c else math.inf for c in (c1, c2))
    medium = pl.ConstantMedium(index)
    return pl.LensStack(
        [
            pl.CircularStop(stop),
            pl.Surface(r1, 0.0, medium, semi_diameter=min(10.0, abs(r1))),
            pl.Surface(r2, semi_diameter=min(10.0, abs(r2))),
        ]
    )


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


def test_the_bending_with_the_least_spherical_aberration():
    """For an object at infinity X = 2 (n^2 - 1) / (n + 2), and without coma X = (2 n + 1) (n - 1) / (n + 1)."""
    n = 1.5
    best, without_coma = 2 * (n * n - 1) / (n + 2), (2 * n + 1) * (n - 1) / (n + 1)
    least, *around = (seidel_sums(thin_lens(100.0, n, x, 5.0), field=0.1).total for x in (best, best - 0.1, best + 0.1))
    assert all(least[0] < other[0] for other in around)
    # The parabola is symmetric about its least value.
    assert around[0][0] == pytest.approx(around[1][0], rel=1e-12)
    sums = seidel_sums(thin_lens(100.0, n, without_coma, 5.0), field=0.1)
    assert abs(sums.total[1]) <= 1e-14 * np.abs(sums.coma).max()


@given(n=st.floats(1.2, 3.0), radius=st.floats(5.0, 500.0), rim=st.floats(0.01, 0.3))
def test_a_surface_that_light_meets_from_infinity(n, radius, rim):
    """S_I = (n - 1) (y / R)^3 y / n^2, since A = y c and u' = -y c (n - 1) / n."""
    y = rim * radius
    sums = seidel_sums(front_of_glass(n, radius, y), field=0.1)
    assert sums.spherical[1] == pytest.approx((n - 1) * rim**3 * y / n**2, rel=1e-13)


# ---- surfaces without aberration ----


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
        assert abs(sums.spherical[1]) <= 1e-14 * plain.spherical[1]
        assert sums.petzval[1] == plain.petzval[1]


@given(n=st.floats(1.2, 3.0), radius=st.floats(5.0, 500.0))
def test_a_hyperboloid_collects_parallel_light_out_of_glass(n, radius):
    """A plane and then k = -n^2: the plano-convex lens without spherical aberration."""
    medium = pl.ConstantMedium(n)
    surfaces = [
        pl.Surface(math.inf, 0.2 * radius, medium, semi_diameter=0.3 * radius),
        pl.Surface(-radius, semi_diameter=0.3 * radius, conic=-(n**2)),
    ]
    lens = pl.LensStack([pl.CircularStop(0.2 * radius), *surfaces])
    sphere = dataclasses.replace(lens, elements=[*lens.elements[:2], dataclasses.replace(surfaces[1], conic=0.0)])
    largest = seidel_sums(sphere, field=0.1).spherical[2]
    sums = seidel_sums(lens, field=0.1)
    assert sums.spherical[1] == 0.0
    assert abs(sums.spherical[2]) <= 1e-13 * largest


@given(n=st.floats(1.2, 3.0), distance=st.floats(1.0, 50.0), thickness=st.floats(0.5, 20.0))
def test_an_aplanatic_front_lens(n, distance, thickness):
    """Its first surface has the object in its centre, its second in the point of Weierstrass, R (1 + 1 / n) away."""
    radius = (distance + thickness) * n / (n + 1)
    lens = pl.LensStack(
        [
            pl.Surface(-distance, thickness, pl.ConstantMedium(n), semi_diameter=0.5 * distance),
            pl.Surface(-radius, 1.0, semi_diameter=0.5 * radius),
            pl.CircularStop(0.2 * radius),
        ]
    )
    z_object = float(lens.vertices[0]) - distance
    sums = seidel_sums(lens, field=0.05 * distance, z_object=z_object)
    # Terms that cancel are y / R or u, and some 0.2 squared or cubed times the radius.
    assert np.all(np.abs(sums.spherical) <= 1e-14 * radius)
    assert np.all(np.abs(sums.coma) <= 1e-13 * radius)
    assert abs(sums.astigmatism[1]) <= 1e-13 * radius
    # The first surface magnifies by 1 / n, the second by n^2.
    assert pl.paraxial.magnification(lens, z_object) == pytest.approx(n, rel=1e-11)


def test_a_ball_with_the_stop_in_its_centre():
    """Every chief ray goes through the centre: no coma, no astigmatism, no distortion, and a curved field."""
    ball = pl.LensStack(
        [
            pl.Surface(10.0, 10.0, pl.ConstantMedium(1.5), semi_diameter=10.0),
            pl.CircularStop(1.0, 10.0),
            pl.Surface(-10.0, semi_diameter=10.0),
        ]
    )
    sums = seidel_sums(ball, field=0.4)
    assert np.abs(sums.table[:, [1, 2, 4]]).max() <= 1e-16
    assert sums.total[0] > 0 < sums.total[3]


@given(field=st.floats(0.01, 0.5), n=st.floats(1.2, 2.5), thickness=st.floats(0.1, 30.0))
def test_a_plane_plate_does_nothing_to_parallel_light(field, n, thickness):
    plate = pl.LensStack(
        [
            pl.CircularStop(5.0, 1.0),
            pl.Surface(math.inf, thickness, pl.ConstantMedium(n), semi_diameter=50.0),
            pl.Surface(math.inf, semi_diameter=50.0),
        ]
    )
    sums = seidel_sums(plate, field=field)
    assert not sums.total[:4].any()
    assert abs(sums.total[4]) <= 1e-15
    assert not np.isfinite(sums.transverse).any()


@given(u=st.floats(0.01, 0.3), n=st.floats(1.2, 2.5), thickness=st.floats(0.1, 30.0))
def test_a_plane_plate_in_a_beam_that_spreads(u, n, thickness):
    """S_I = -d u^4 (n^2 - 1) / n^3: overcorrected in a converging beam too, by the even power of u."""
    plate = pl.LensStack(
        [
            pl.CircularStop(100.0 * u, 0.0),
            pl.Surface(math.inf, thickness, pl.ConstantMedium(n), semi_diameter=100.0),
            pl.Surface(math.inf, semi_diameter=100.0),
        ]
    )
    sums = seidel_sums(plate, field=1.0, z_object=-100.0)
    # The difference of the two surfaces, 100 u against d u.
    tolerance = 1e-13 * np.abs(sums.spherical).max()
    assert sums.total[0] == pytest.approx(-thickness * u**4 * (n * n - 1) / n**3, rel=1e-12, abs=tolerance)


def test_a_curvature_is_a_curvature_however_it_is_written():
    def lens(radius, **shape) -> pl.LensStack:
        first = pl.Surface(radius, 4.0, GLASS, semi_diameter=8.0, **shape)
        return pl.LensStack([pl.CircularStop(4.0, 2.0), first, pl.Surface(-70.0, semi_diameter=8.0)])

    # r^2 / 100 is a paraboloid of radius 50.
    paraboloid = seidel_sums(lens(50.0, conic=-1.0), field=0.2, z_object=-300.0)
    series = seidel_sums(lens(math.inf, aspheric=(0.01,)), field=0.2, z_object=-300.0)
    assert series.table == pytest.approx(paraboloid.table, rel=1e-12, abs=1e-16)
