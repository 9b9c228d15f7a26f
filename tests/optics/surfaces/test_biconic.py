"""Biconic surfaces: limits that are conics, sections, bounds, Snell's law, extremes, and Zemax files."""

import itertools
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

import plenoptic as pl
from plenoptic.optics.lens.files.zemax import lens_from_zmx
from plenoptic.optics.lens.trace import traced_part

BiconicSag = pl.optics.BiconicSag
EPS = np.finfo(float).eps
OK = pl.RayStatus.OK
SHAPES = {
    "toric": (BiconicSag(40.0, -25.0, -0.7, 1.3), 10.0),
    "cylinder": (BiconicSag(math.inf, 30.0), 12.0),
    "hyperbolic": (BiconicSag(15.0, 60.0, -3.0, -1.0), 11.0),
    "steep": (BiconicSag(10.0, 14.0, 0.5), 7.5),
    "micrometres": (BiconicSag(2e-3, 5e-3, 0.2), 1e-3),
    "nearly flat": (BiconicSag(1e12, -1e9, 5.0), 10.0),
}


def one_surface(term, size, index=1.6):
    """A biconic surface from air to glass with its vertex at z = 0: element 1."""
    surface = pl.Surface(math.inf, 1e3, pl.ConstantMedium(index), semi_diameter=size, freeform=term)
    elements = [pl.CircularStop(1e5), surface, pl.Surface(math.inf, semi_diameter=1e6)]
    return pl.LensStack(elements), surface


def disc(size, n, seed=2):
    rng = np.random.default_rng(seed)
    r, phi = size * np.sqrt(rng.uniform(size=n)), rng.uniform(0, 2 * math.pi, n)
    return r * np.cos(phi), r * np.sin(phi)


def beam(size, n, s=1.0, slant=1.0):
    x, y = disc(size, n)
    target = np.column_stack([x, y, np.zeros(n)])
    start = target + np.column_stack([*(slant * np.array(disc(size, n, seed=3))), np.full(n, -s * 4 * size)])
    return pl.RayBundle(start, target - start)


def exact_sag(term, x, y):
    """The formula, for complex points too."""
    c_x, c_y = 1.0 / term.radius_x, 1.0 / term.radius_y
    root = np.sqrt(1.0 - (1.0 + term.conic_x) * (c_x * x) ** 2 - (1.0 + term.conic_y) * (c_y * y) ** 2)
    return (c_x * x**2 + c_y * y**2) / (1.0 + root)


def test_equal_sections_are_a_conic():
    for radius, conic, size in ((50.0, 0.0, 20.0), (-30.0, -1.6, 12.0), (1e-3, 0.4, 7e-4), (1e9, -1.0, 10.0)):
        term = BiconicSag(radius, radius, conic, conic)
        surface = pl.Surface(radius, 1e3, pl.ConstantMedium(1.6), semi_diameter=size, conic=conic)
        x, y = disc(size, 500)
        assert_allclose(term.sag(x, y), surface.sag(x, y), rtol=32 * EPS)
        assert_allclose(term.gradient(x, y), surface.gradient(x, y), rtol=128 * EPS, atol=EPS * size / abs(radius))
        biconic, _ = one_surface(term, size)
        conic_lens = pl.LensStack([biconic.elements[0], surface, biconic.elements[2]])
        for reverse in (False, True):
            rays = beam(0.8 * size, 1000, -1.0 if reverse else 1.0)
            a = traced_part(biconic, rays, 1, 1, reverse=reverse)
            b = traced_part(conic_lens, rays, 1, 1, reverse=reverse)
            both = (a.status == OK) & (b.status == OK)
            assert np.mean(a.status == b.status) > 0.995 and both.sum() > 300, (radius, reverse)
            assert np.abs(a.origin[both] - b.origin[both]).max() < 1e-12 * size, (radius, reverse)
            assert np.abs(a.direction[both] - b.direction[both]).max() < 1e-11, (radius, reverse)


def test_derivatives_and_bounds():
    for name, (term, size) in SHAPES.items():
        x, y = disc(size, 4000)
        scale = size / np.hypot(x, y)
        x[:400], y[:400] = (scale * x)[:400] * (1 - 4 * EPS), (scale * y)[:400] * (1 - 4 * EPS)
        step = 1e-30 * size  # complex steps have no rounding error
        slopes = [exact_sag(term, x + 1j * step, y).imag, exact_sag(term, x, y + 1j * step).imag]
        bounds = term.bounds(size)
        assert_allclose(term.gradient(x, y), np.array(slopes) / step, rtol=1e-11, atol=4 * EPS * bounds.slope)
        h = 1e-4 * size
        inside = np.hypot(x, y) < size - 2 * h
        across = term.gradient(x[inside], y[inside] + h) - term.gradient(x[inside], y[inside] - h)
        along = term.gradient(x[inside] + h, y[inside]) - term.gradient(x[inside] - h, y[inside])
        second = np.stack([along, across]) / (2 * h)
        bending = np.linalg.norm(second.transpose(2, 0, 1), ord=2, axis=(1, 2)).max()
        largest = (np.hypot(*term.gradient(x, y)).max(), bending, np.abs(term.sag(x, y)).max())
        for found, bound in zip(largest, bounds[:3], strict=True):
            assert found <= bound * (1 + 1e-6) and bound < 12 * found, name
    # For a sphere the bounds are its largest slope c r / w, bending c / w^3 and sag.
    sphere = BiconicSag(10.0, 10.0).bounds(8.0)
    assert sphere[:3] == pytest.approx((0.8 / 0.6, 0.1 / 0.6**3, 4.0))
    assert not np.isfinite(BiconicSag(10.0, 20.0).bounds(10.0)).any()


def test_the_sag_keeps_its_digits():
    mpmath = pytest.importorskip("mpmath")
    for name, (term, size) in SHAPES.items():
        x, y = disc(size, 40)
        with mpmath.workdps(40):
            c = [1 / mpmath.mpf(r) for r in (term.radius_x, term.radius_y)]
            for px, py, sag in zip(x, y, term.sag(x, y), strict=True):
                a, b = c[0] * mpmath.mpf(px), c[1] * mpmath.mpf(py)
                root = mpmath.sqrt(1 - (1 + mpmath.mpf(term.conic_x)) * a * a - (1 + mpmath.mpf(term.conic_y)) * b * b)
                exact = (a * mpmath.mpf(px) + b * mpmath.mpf(py)) / (1 + root)
                assert abs(sag - float(exact)) <= term.bounds(size).rounding, name


def test_both_sections_have_their_paraxial_focus():
    # From z = -inf, the section with radius R of a surface from 1 to n focuses n R / (n - 1) behind the vertex.
    index, height = 1.6, 1e-4
    for term in (BiconicSag(40.0, 25.0, -0.7, 1.3), BiconicSag(80.0, -30.0), BiconicSag(math.inf, 20.0)):
        lens, surface = one_surface(term, 5.0, index)
        rays = pl.RayBundle([[height, 0.0, -10.0], [0.0, height, -10.0]], [[0.0, 0.0, 1.0]] * 2)
        out = traced_part(lens, rays, 1, 1)
        slopes = out.direction[[0, 1], [0, 1]] / out.direction[:, 2]
        expected = [-height * (index - 1.0) / (index * radius) for radius in (term.radius_x, term.radius_y)]
        # The fourth order is (h / R)^2 times smaller.
        assert slopes == pytest.approx(expected, rel=1e-9, abs=1e-20)
        mean = 0.5 * (1.0 / term.radius_x + 1.0 / term.radius_y)
        assert surface.vertex_curvature == pytest.approx(mean)


def test_snell_and_the_way_back():
    for (name, (term, size)), reverse, slant in itertools.product(SHAPES.items(), (False, True), (1.0, 12.0)):
        lens, surface = one_surface(term, size)
        rays = beam(size, 1000, -1.0 if reverse else 1.0, slant)
        out = traced_part(lens, rays, 1, 1, reverse=reverse)
        assert not np.any(out.status == pl.RayStatus.NOT_CONVERGED), name
        passes = out.status == OK
        assert passes.mean() > (0.05 if slant > 1 else 0.3), (name, reverse, slant)
        p, d, bent = out.origin[passes], np.asarray(rays.direction)[passes], out.direction[passes]
        normal = np.column_stack([*-surface.gradient(p[:, 0], p[:, 1]), np.ones(len(p))])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        cos_i = np.abs(np.einsum("ij,ij->i", normal, d))
        rounding = 64 * EPS * size + 4 * term.bounds(size).rounding
        assert np.all(np.abs(p[:, 2] - term.sag(p[:, 0], p[:, 1])) * normal[:, 2] <= rounding / cos_i), name
        n_before, n_behind = (1.6, 1.0) if reverse else (1.0, 1.6)
        off = n_behind * np.cross(normal, bent) - n_before * np.cross(normal, d)
        assert np.abs(off).max() <= 1e-10, (name, reverse, slant)
        back = traced_part(lens, pl.RayBundle(p + size * bent, -bent), 1, 1, reverse=not reverse)
        same = (back.status == OK) & (np.abs(back.origin - p).max(axis=1) <= 1e-9 * size)
        assert same.mean() > 0.95, (name, reverse, slant)


def test_wrong_radii_and_points_are_refused():
    for call, message in (
        (lambda: BiconicSag(0.0, 1.0), "radius_x is 0 mm; it must not be 0"),
        (lambda: BiconicSag(1.0, math.nan), "radius_y"),
        (lambda: BiconicSag(1.0, 1.0, math.inf), "conic_x"),
        (lambda: BiconicSag(10.0, 20.0).sag(11.0, 0.0), "has no sag"),
        (lambda: one_surface(BiconicSag(10.0, 20.0), 10.0), "no finite height"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            call()


ZMX = """MODE SEQ
UNIT CM
SURF 0
DISZ INFINITY
SURF 1
PARM 1 5.0
PARM 2 -0.5
CURV 0.2
TYPE BICONICX
CONI -1.0
DISZ 0.4
GLAS ___BLANK 1 0 1.5 60 0 0 0 0 0
DIAM 1
SURF 2
DISZ 0.5
DIAM 1
SURF 3
STOP
DIAM 0.5
DISZ 9
SURF 4
"""


def test_zemax_files_are_read_and_lenses_saved(tmp_path):
    # CURV and CONI are those along y, PARM 1 and 2 radius and conic constant along x; PARM 1 of 0 is straight.
    surface = lens_from_zmx(ZMX, "mine.zmx").elements[0]
    assert math.isinf(surface.radius) and surface.conic == 0.0 and surface.aspheric == ()
    term = surface.freeform
    assert (term.radius_x, term.conic_x, term.conic_y) == (50.0, -0.5, -1.0) and term.radius_y == pytest.approx(50.0)
    cylinder = lens_from_zmx(ZMX.replace("PARM 1 5.0\n", ""), "mine.zmx").elements[0].freeform
    assert math.isinf(cylinder.radius_x) and cylinder.radius_y == pytest.approx(50.0)
    flat = ZMX.replace("PARM 1 5.0\n", "").replace("CURV 0.2", "CURV 0")
    assert lens_from_zmx(flat, "mine.zmx").elements[0].freeform is None
    with pytest.raises(pl.errors.PrescriptionError, match="PARM 9 is 1; only PARM 1 to 8"):
        lens_from_zmx(ZMX.replace("PARM 2 -0.5", "PARM 9 1"), "mine.zmx")
    lens, path = lens_from_zmx(ZMX, "mine.zmx"), tmp_path / "lens.json"
    pl.optics.save_lens(lens, path)
    assert pl.load_lens(path).elements == lens.elements
    path.write_text(path.read_text().replace('"freeform"', '"departure"'))  # as versions before wrote it
    assert pl.load_lens(path).elements == lens.elements
