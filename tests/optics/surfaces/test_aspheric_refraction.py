"""Spheres, conics, even aspheres, surfaces beyond their equator: shapes, laws of refraction, stigmatic surfaces."""

import itertools
import math
import sys

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import plenoptic as pl
from plenoptic.errors import InvalidValueError, PrescriptionError
from plenoptic.optics.lens.trace import trace_part

EPS = np.finfo(float).eps
OK, MISSED, CLIPPED = pl.RayStatus.OK, pl.RayStatus.MISSED, pl.RayStatus.CLIPPED


RADII = st.one_of(st.floats(1e-3, 1e9), st.floats(-1e9, -1e-3))


@given(radius=RADII, fraction=st.floats(0.0, 1.0))
def test_sag_lies_on_the_sphere(radius, fraction):
    r = fraction * abs(radius)
    z = float(pl.Surface(radius, semi_diameter=abs(radius)).sag(r))
    # r^2 + (z - R)^2 = R^2, divided by R^2; a handful of roundings of terms not above 1.
    u, v = r / radius, z / radius
    assert u * u + v * (v - 2) == pytest.approx(0.0, abs=16 * EPS) and z * radius >= 0


@given(radius=RADII, fraction=st.floats(0.0, 1e-3))
def test_sag_is_a_parabola_near_the_vertex(radius, fraction):
    r = fraction * abs(radius)
    sag = float(pl.Surface(radius, semi_diameter=abs(radius)).sag(r))
    # The next term of the series is (r / R)^2 / 4 of the first.
    assert sag == pytest.approx(r * r / (2 * radius), rel=0.26e-6, abs=1e-300)


def test_impossible_spheres_are_refused():
    for radius in (0.0, -0.0, math.nan, 5e-324, None, 10**400):
        with pytest.raises(PrescriptionError, match=r"radius is .*math\.inf"):
            pl.Surface(radius, semi_diameter=1.0)
    for semi_diameter in (0.0, math.nan, math.inf, 10.0001):
        with pytest.raises(InvalidValueError, match="semi_diameter"):
            pl.Surface(-10.0, semi_diameter=semi_diameter)
    with pytest.raises(InvalidValueError, match="thickness is"):
        pl.Surface(10.0, -1e-9, semi_diameter=1.0)
    # Texts and lists have an index() too, and a class has one without an instance.
    for medium in (1.5, "BK7", [1.5], pl.ConstantMedium):
        with pytest.raises(PrescriptionError, match=r"medium is .*ConstantMedium"):
            pl.Surface(50, 5, medium, semi_diameter=10)
    with pytest.raises(PrescriptionError, match="r reaches 11 mm"):
        pl.Surface(10.0, semi_diameter=5.0).sag([1.0, 11.0])


def test_sag_is_as_exact_at_the_ends_of_the_numbers():
    # Four times the radius would overflow; powers of two change no bit.
    small, large = pl.Surface(1.3, semi_diameter=1.3), pl.Surface(1.3 * 2.0**1023, semi_diameter=1.0)
    for fraction in (0.25, 0.75, 1.0):
        assert float(large.sag(1.3 * fraction * 2.0**1023)) == float(small.sag(1.3 * fraction)) * 2.0**1023
    plane = pl.Surface(math.inf, semi_diameter=10.0)
    assert plane == pl.Surface(-math.inf, semi_diameter=10.0) and plane.curvature == 0.0
    assert plane.sag([0.0, 5.0, 1e9]).tolist() == [0.0, 0.0, 0.0]


@example(radius=8.98846567431158e307, thickness=0.0, semi_diameter=8.98846567431158e307)
@example(radius=-sys.float_info.max, thickness=0.0, semi_diameter=sys.float_info.max)
@given(radius=st.floats(), thickness=st.floats(), semi_diameter=st.floats())
def test_what_surface_is_accepted_is_usable(radius, thickness, semi_diameter):
    try:
        surface = pl.Surface(radius, thickness, semi_diameter=semi_diameter)
    except InvalidValueError:
        return
    assert math.isfinite(surface.curvature) and np.isfinite(surface.sag(surface.semi_diameter))


def one_surface(radius, index, *, ahead=1.0, **shape):
    """A surface from a medium of index `ahead` to one of `index`; its vertex is at z = 0."""
    medium, before = pl.ConstantMedium(index), pl.ConstantMedium(ahead)
    surface = pl.Surface(radius, thickness=1e4, medium=medium, **shape)
    # Stop and plane in front are there to make it a lens; tests trace element 2 alone.
    front = [pl.CircularStop(1e5), pl.Surface(math.inf, 0.0, before, semi_diameter=1e4)]
    return pl.LensStack([*front, surface, pl.Surface(math.inf, semi_diameter=1e5)])


def refracted(lens, origin, direction, *, reverse=False):
    """Through the surface alone."""
    return trace_part(lens, pl.RayBundle(origin, direction), 2, 2, reverse=reverse)


SHAPES = [
    {"radius": 50.0, "semi_diameter": 20.0, "conic": -0.5, "aspheric": (0.0, 1e-5, -1e-8)},
    {"radius": math.inf, "semi_diameter": 8.0, "aspheric": (1e-3, 1e-4, -1e-7)},
    {"radius": 40.0, "semi_diameter": 15.0, "conic": 2.0},
    {"radius": 30.0, "semi_diameter": 25.0, "conic": -3.0},
    {"radius": -25.0, "semi_diameter": 14.0, "conic": -1.0, "aspheric": (0.0, -3e-5, 2e-8)},
    {"radius": -1e9, "semi_diameter": 14.0, "conic": -1e3, "aspheric": (0.0, 0.0, 1e-9)},
    {"radius": 1e-3, "semi_diameter": 5e-4, "conic": -0.7, "aspheric": (0.0, 1e7)},
]


def test_snell_and_the_way_back():
    for shape, reverse in itertools.product(SHAPES, [False, True]):
        lens, surface = one_surface(index=1.6, **shape), pl.Surface(**shape)
        rng, n, size = np.random.default_rng(3), 4000, shape["semi_diameter"]
        s = -1.0 if reverse else 1.0
        target = np.column_stack([rng.uniform(-size, size, (n, 2)), np.zeros(n)])
        start = np.column_stack([rng.uniform(-size, size, (n, 2)), np.full(n, -s * 4 * size)])
        rays = pl.RayBundle(start, target - start)
        out = refracted(lens, rays.origin, rays.direction, reverse=reverse)
        passes = out.status == OK
        assert passes.mean() > 0.3 and out.status.max() <= pl.RayStatus.TOTAL_REFLECTION, (shape, reverse)
        p, d, bent = out.origin[passes], rays.direction[passes], out.direction[passes]
        r = np.hypot(p[:, 0], p[:, 1])
        assert r.max() <= size * (1 + 4 * EPS), (shape, reverse)
        normal = np.column_stack([-surface.slope(r)[:, None] * p[:, :2] / r[:, None], np.ones(len(p))])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        # A point is good to a few eps of its coordinates, and its height over the surface to that over cos i.
        scale = np.abs(p).max(axis=1) + np.abs(surface.sag(r))
        cos_i = np.abs(np.einsum("ij,ij->i", normal, d))
        assert np.all(np.abs(p[:, 2] - surface.sag(r)) <= 16 * EPS * scale / cos_i), (shape, reverse)
        n_before, n_behind = (1.6, 1.0) if reverse else (1.0, 1.6)
        off = n_behind * np.cross(normal, bent) - n_before * np.cross(normal, d)
        assert np.abs(off).max() <= 32 * EPS, (shape, reverse)
        # Back: from a point further on.
        there = p + size * bent
        back = refracted(lens, there, -bent, reverse=not reverse)
        assert np.all(back.status == OK), (shape, reverse)
        assert np.all(np.abs(back.origin - p).max(axis=1) <= 64 * EPS * (size + scale) / cos_i), (shape, reverse)


def test_a_hyper_hemisphere_is_stigmatic():
    # Weierstrass: rays from the point R / n beyond the centre leave the sphere as if from n R beyond it; and those from
    # the centre leave undeviated. The rays go beyond the equator, which a hemisphere's root does not reach.
    radius, index = 5.0, 1.8
    lens = one_surface(radius, index, semi_diameter=radius, depth=radius * (1 + 1 / index))
    for inside, source, steepest in ((radius / index, index * radius, 1.54), (0.0, 0.0, 2.0)):
        angle = np.linspace(-steepest, steepest, 401)
        # In reverse: from within the glass towards -z and beyond.
        along = np.column_stack([0 * angle, np.sin(angle), -np.cos(angle)])
        out = refracted(lens, np.broadcast_to([0.0, 0.0, radius + inside], (401, 3)), along, reverse=True)
        passes = out.status == OK
        assert passes.mean() > 0.95 and np.nanmax(out.origin[passes, 2]) > 1.2 * radius, inside
        # Distance of the rays' lines from the point they seem to come from.
        off = np.linalg.norm(np.cross(out.origin[passes] - [0, 0, radius + source], out.direction[passes]), axis=1)
        assert off.max() <= 64 * EPS * (radius + source), inside
        # What meets the sphere deeper than its rim has missed it.
        assert np.all(out.status[~passes] == MISSED), inside


def test_impossible_surfaces_are_refused():
    for fields, message in [
        ({"conic": 0.5}, "exceeds the semi-axis of the ellipsoid, 8.16497 mm"),
        ({"aspheric": (0.0, math.inf)}, "aspheric.1. is inf"),
        ({"aspheric": (1e300,) * 30}, "gives slopes of inf"),
        ({"depth": 4.0}, "has a depth from 10 to 20"),
        ({"depth": 12.0}, "a semi_diameter of 10"),
        ({"depth": 12.0, "conic": -1.0}, "surface without equator"),
    ]:
        with pytest.raises(pl.PlenopticError, match=message):
            pl.Surface(10.0, semi_diameter=9.0, **fields)


@settings(max_examples=40)
@given(
    radius=st.floats(1.0, 1e6),
    conic=st.floats(-5, 5),
    a=st.floats(-1e-6, 1e-6),
    share=st.floats(0.01, 0.9),
    sign=st.sampled_from([1, -1]),
)
def test_slope_is_the_derivative_of_sag(radius, conic, a, share, sign):
    size = share * min(radius / math.sqrt(max(1.0 + conic, 1e-3)), 50.0)
    surface = pl.Surface(sign * radius, semi_diameter=size, conic=conic, aspheric=(0.0, a))
    h = 1e-4 * size
    difference = (surface.sag(size + h) - surface.sag(size - h)) / (2 * h)
    # Central differences: h^2 / 6 times a third derivative that grows as (1 - share^2)^-5/2, plus rounding.
    assert surface.slope(size) == pytest.approx(float(difference), rel=1e-5, abs=1e-9 / h * EPS * size + 1e-9)
    assert surface.vertex_curvature == surface.curvature


def test_rays_along_the_axis_meet_the_vertex():
    for shape, reverse in itertools.product(SHAPES, [False, True]):
        lens = one_surface(index=1.6, **shape)
        s = -1.0 if reverse else 1.0
        starts = np.array([[0.0, 0.0, -s * z] for z in (0.0, 1e-16, 3e-9, 0.1, 17.3, 1e9)])
        out = refracted(lens, starts, np.broadcast_to([0.0, 0.0, s], starts.shape), reverse=reverse)
        assert np.all(out.status == OK), (shape, reverse)
        assert np.abs(out.direction - [0.0, 0.0, s]).max() <= 2 * EPS, (shape, reverse)
        assert np.all(np.abs(out.origin) <= 1e-20 * shape["semi_diameter"]), (shape, reverse)


CHEBYSHEV = tuple(0.1 * np.polynomial.chebyshev.cheb2poly(np.eye(17)[16])[2::2] / 5.0 ** np.arange(2, 17, 2))
STEEP = [
    *({"radius": -10.0, "semi_diameter": 10.0 * share, "aspheric": (0.0, 1e-5, -1e-7)} for share in (0.9, 0.97, 0.99)),
    {"radius": 10.0, "semi_diameter": 14.14, "conic": -0.5, "aspheric": (0.0, 1e-5)},
    {"radius": math.inf, "semi_diameter": 5.0, "aspheric": CHEBYSHEV},
    {"radius": math.inf, "semi_diameter": 5.0, "aspheric": (0.0,) * 19 + (1e-28,)},
]


def test_bounds_on_aspheres_are_bounds_and_not_much_more():
    for shape in STEEP:
        surface = pl.Surface(**shape)
        steepest, sharpest, tallest = surface.row().aspheric[:3]
        r = np.linspace(0.0, surface.semi_diameter, 200_001)
        slope = np.abs(surface.slope(r)).max()
        # A chord's slope is a mean of the second derivative, so never above its largest size but for rounding.
        bend = np.abs(np.diff(surface.slope(r)) / np.diff(r)).max()
        assert slope <= steepest * (1 + 1e-9) <= 1.2 * slope, shape
        assert bend <= sharpest * (1 + 1e-6) <= 1.5 * bend, shape
        assert np.abs(surface.sag(r)).max() <= tallest * (1 + 1e-9), shape


def test_grazing_rays_end_on_the_asphere():
    for shape, reverse in itertools.product(STEEP, [False, True]):
        lens, surface = one_surface(index=1.5, **shape), pl.Surface(**shape)
        rng, n = np.random.default_rng(4), 20_000
        radius = surface.semi_diameter * rng.uniform(0.5, 1.0, n)
        target = np.column_stack([np.zeros(n), radius, surface.sag(radius)])
        tilt = rng.uniform(1.2, 1.57, n) * rng.choice([-1, 1], n)
        along = np.column_stack([np.zeros(n), np.sin(tilt), np.cos(tilt)]) * (-1.0 if reverse else 1.0)
        out = refracted(lens, target, along, reverse=reverse)
        ok = out.status == OK
        # The rounding of the sag is that of the sum of its terms' sizes, over the sine of how flatly the ray meets
        # it.
        r = np.minimum(np.hypot(out.origin[ok, 0], out.origin[ok, 1]), surface.semi_diameter)
        size = r + sum(abs(a) * r ** (2 * i + 2) for i, a in enumerate(surface.aspheric))
        assert ok.sum() > 1000, (shape, reverse)
        allowed = 200 * EPS * size * (1 + np.abs(surface.slope(r)))
        assert np.all(np.abs(out.origin[ok, 2] - surface.sag(r)) <= allowed), (shape, reverse)
