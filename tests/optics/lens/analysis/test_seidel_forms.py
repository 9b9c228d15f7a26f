"""Seidel sums of lenses and surfaces that have closed forms, and of those that are free of an aberration.

Sums of surfaces are products of some ten rounded numbers; where they cancel, tolerances count from the largest.
"""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import plenoptic as pl
from plenoptic.aberrations import seidel_sums

GLASS = pl.ConstantMedium(1.6)


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
        assert abs(sums.spherical[1]) <= 1e-14 * plain.spherical[1]
        assert sums.petzval[1] == plain.petzval[1]


def plate(n: float, thickness: float, stop: float) -> pl.LensStack:
    front = pl.Surface(math.inf, thickness, pl.ConstantMedium(n), semi_diameter=100.0)
    return pl.LensStack([pl.CircularStop(stop), front, pl.Surface(math.inf, semi_diameter=100.0)])


@given(u=st.floats(0.01, 0.3), n=st.floats(1.2, 2.5), thickness=st.floats(0.1, 30.0))
def test_a_plane_plate_in_parallel_light_and_in_a_beam_that_spreads(u, n, thickness):
    """S_I = -d u^4 (n^2 - 1) / n^3: overcorrected in a converging beam too, by the even power of u."""
    sums = seidel_sums(plate(n, thickness, 5.0), field=u)
    assert not sums.total[:4].any() and abs(sums.total[4]) <= 1e-15
    assert not np.isfinite(sums.transverse).any()
    sums = seidel_sums(plate(n, thickness, 100.0 * u), field=1.0, z_object=-100.0)
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
