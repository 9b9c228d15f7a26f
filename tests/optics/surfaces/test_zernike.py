"""Freeform surfaces: laws of refraction, of Zernike polynomials, and the limits that are aspheres."""

import dataclasses
import itertools
import math
import re
from fractions import Fraction

import numpy as np
import pytest
from refracting import beam, one_surface

import plenoptic as pl
from plenoptic.optics.lens.analysis.conditioning import blocks_of, kinds, probe_rays
from plenoptic.optics.lens.checks.finding import FindingKind
from plenoptic.optics.lens.files.zemax import lens_from_zmx
from plenoptic.optics.lens.files.zemax_writing import zmx_of_lens
from plenoptic.optics.lens.kernels.trace import fill_through_lens
from plenoptic.optics.lens.kernels.zernike import zernike_at
from plenoptic.optics.lens.lens_record import FIRST_NUMBER, lens_record
from plenoptic.optics.lens.pupil.exit_pupil import pupil_bounds
from plenoptic.optics.lens.pupil.outline import PupilRays, up_to_stops
from plenoptic.optics.lens.trace import trace_part
from plenoptic.optics.surfaces.zernike import ZernikeSag

EPS = np.finfo(float).eps
OK, CLIPPED = pl.RayStatus.OK, pl.RayStatus.CLIPPED
RNG = np.random.default_rng(11)

MILD = {"radius": 50.0, "semi_diameter": 10.0, "conic": -0.5, "aspheric": (0.0, 1e-6)}
SHAPES = {
    "mild": {**MILD, "freeform": ZernikeSag(RNG.normal(size=28) * 2e-3, 10.0)},
    "steep": {"radius": math.inf, "semi_diameter": 8.0, "freeform": ZernikeSag(RNG.normal(size=15) * 0.15, 9.0)},
    "high": {"radius": -30.0, "semi_diameter": 9.0, "conic": 1.5, "freeform": ZernikeSag([0] * 78 + [1e-3] * 13, 9)},
    "biconic": {"radius": math.inf, "semi_diameter": 9.0, "freeform": pl.optics.BiconicSag(12.0, -20.0, -0.5, 0.3)},
    "odd powers": {**MILD, "freeform": pl.optics.OddPowerSag([2e-4, -1e-6, 3e-9])},
    "cylinder": {"radius": math.inf, "semi_diameter": 9.0, "freeform": pl.optics.BiconicSag(math.inf, 9.5)},
    "to the equator": {"radius": 12, "semi_diameter": 12, "freeform": ZernikeSag([0, 0, 0, 0.02, 0.05, -0.03], 12)},
}
AT_EQUATOR = {"to the equator": 2e-3}
"""Part of the rays that no crossing is found for where the sag has no derivative: as many as with an asphere there."""


def unsettled(rays):
    """Part of the rays for which the search was given up."""
    return float(np.mean(rays.status == pl.RayStatus.NOT_CONVERGED))


def sag_of(surface, p):
    return surface.sag(p[:, 0], p[:, 1])


def noll_degree(j):
    """Degree and signed order of Noll's term j, by counting."""
    n, left = 0, j - 1
    while left > n:
        n, left = n + 1, left - n - 1
    orders = sorted((m for m in range(-n, n + 1, 2)), key=abs)
    pair = abs(orders[left])
    return n, pair if j % 2 == 0 else -pair


def zernike(j, rho, phi):
    """Noll's definition, with exact coefficients."""
    n, m = noll_degree(j)
    low, total = abs(m), 0.0
    for k in range((n - low) // 2 + 1):
        a = Fraction((-1) ** k * math.factorial(n - k), math.factorial(k))
        a /= math.factorial((n + low) // 2 - k) * math.factorial((n - low) // 2 - k)
        total = total + float(a) * rho ** (n - 2 * k)
    turn = 1.0 if m == 0 else math.sqrt(2.0) * (np.cos(low * phi) if m > 0 else np.sin(low * phi))
    return math.sqrt(n + 1.0) * total * turn


def test_terms_are_nolls():
    for j in range(1, 92):
        sag = ZernikeSag([0.0] * (j - 1) + [1.0], 2.0)
        r, phi = 2.0 * np.sqrt(RNG.uniform(size=200)), RNG.uniform(-math.pi, math.pi, 200)
        reference = zernike(j, r / 2.0, phi) - zernike(j, 0.0, 0.0)
        heights = sag.sag(r * np.cos(phi), r * np.sin(phi))
        # The powers of degree 12 cancel from 4e4 to the values of some units.
        assert heights == pytest.approx(reference, abs=4e5 * EPS), j
        assert sag.offset == pytest.approx(float(zernike(j, 0.0, 0.0)), abs=64 * EPS), j
        of_wavefronts = pl.aberrations.zernike(j, r / 2.0 * np.cos(phi), r / 2.0 * np.sin(phi))
        assert of_wavefronts == pytest.approx(zernike(j, r / 2.0, phi), abs=4e5 * EPS), j


def test_the_polynomial_of_kernels_is_the_sum_of_terms():
    x, y = 3.0 * np.sqrt(RNG.uniform(size=500)) * np.array([np.cos(turn := RNG.uniform(0, 7, 500)), np.sin(turn)])
    some = [RNG.normal(size=n) for n in (1, 4, 15, 28, 91)]
    for terms in [*([0.0] * (j - 1) + [1.0] for j in range(1, 92)), *some, []]:
        term = ZernikeSag(terms, 2.5)
        row = np.array([0.0] * (FIRST_NUMBER - 1) + list(term.numbers()))
        sag, *gradient = zernike_at.py_func(x, y, row)
        bounds, degree = term.bounds(3.0), row[FIRST_NUMBER]
        # Both sums are rounded; the derivative of a power multiplies its rounding by the power.
        assert np.all(np.abs(sag - term.sag(x, y)) <= 2 * bounds.rounding), len(terms)
        assert np.abs(gradient - term.gradient(x, y)).max() <= 2 * degree * bounds.rounding / 2.5, len(terms)


def test_derivatives_and_bounds():
    for name, shape in SHAPES.items():
        freeform, size = shape["freeform"], shape["semi_diameter"]
        r, phi = size * np.sqrt(RNG.uniform(size=4000)), RNG.uniform(0, 2 * math.pi, 4000)
        r[:400] = size
        x, y = r * np.cos(phi), r * np.sin(phi)
        h = 1e-4 * size
        gradient = freeform.gradient(x, y)
        right, left, up, down = (freeform.sag(x + dx, y + dy) for dx, dy in ((h, 0), (-h, 0), (0, h), (0, -h)))
        bounds = freeform.bounds(size)
        # Central differences: h^2 / 6 of the third derivative, some degree^3 times the sag, and rounding over h.
        error = 1e-8 * 12**3 * bounds.slope + 4 * (bounds.rounding + EPS * bounds.height) / h
        assert gradient == pytest.approx(np.stack([right - left, up - down]) / (2 * h), abs=error), name
        change = np.stack([freeform.gradient(x + h, y) - freeform.gradient(x - h, y), np.zeros((2, len(x)))])
        change[1] = freeform.gradient(x, y + h) - freeform.gradient(x, y - h)
        bending = np.linalg.norm((change / (2 * h)).transpose(2, 0, 1), ord=2, axis=(1, 2)).max()
        slope, height = np.hypot(*gradient).max(), np.abs(freeform.sag(x, y)).max()
        for values, bound in ((slope, bounds.slope), (bending, bounds.bending), (height, bounds.height)):
            # Many terms that do not add up in size anywhere: the sum of their sizes is some times the whole.
            assert values <= bound * (1 + 1e-5) and bound < 6 * values, name


def test_the_vertex_is_what_the_derivatives_say():
    freeform, h = ZernikeSag(RNG.normal(size=40) * 1e-2, 7.0), 1e-4
    dx, dy = freeform.gradient(0.0, 0.0)
    (dxx, dxy), (dyx, dyy) = (
        (freeform.gradient(*(h * np.eye(2)[k])) - freeform.gradient(*(-h * np.eye(2)[k]))) / (2 * h) for k in (0, 1)
    )
    assert freeform.sag(0.0, 0.0) == 0.0
    assert freeform.vertex == pytest.approx((dx, dy, dxx, 0.5 * (dxy + dyx), dyy), rel=1e-5)
    surface = pl.Surface(40.0, semi_diameter=5.0, freeform=freeform)
    assert surface.vertex_curvature == pytest.approx(1 / 40 + 0.5 * (dxx + dyy), rel=1e-5)


def test_snell_and_the_way_back():
    for (name, shape), reverse in itertools.product(SHAPES.items(), (False, True)):
        lens, surface, size = one_surface(**shape), pl.Surface(**shape), shape["semi_diameter"]
        rays = beam(size, 3000, -1.0 if reverse else 1.0)
        out = trace_part(lens, rays, 2, 2, reverse=reverse)
        passes = out.status == OK
        assert passes.mean() > 0.3 and unsettled(out) <= AT_EQUATOR.get(name, 0.0), (name, reverse)
        p, d, bent = out.origin[passes], np.asarray(rays.direction)[passes], out.direction[passes]
        inside = np.hypot(p[:, 0], p[:, 1]) < size * (1 - 1e-6)  # at an equator normals are infinitely steep
        p, d, bent = p[inside], d[inside], bent[inside]
        normal = np.column_stack([*-surface.gradient(p[:, 0], p[:, 1]), np.ones(len(p))])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        cos_i = np.abs(np.einsum("ij,ij->i", normal, d))
        rounding = 64 * EPS * size + 4 * surface.freeform.bounds(size).rounding
        assert np.all(np.abs(p[:, 2] - sag_of(surface, p)) * normal[:, 2] <= rounding / cos_i), (name, reverse)
        n_before, n_behind = (1.6, 1.0) if reverse else (1.0, 1.6)
        off = n_behind * np.cross(normal, bent) - n_before * np.cross(normal, d)
        # The normal turns with the point, by its curvature.
        assert np.abs(off).max() <= 1e-11, (name, reverse)
        back = trace_part(lens, pl.RayBundle(p + size * bent, -bent), 2, 2, reverse=not reverse)
        same = (back.status == OK) & (np.abs(back.origin - p).max(axis=1) <= 1e-9 * size)
        # A ray back may meet a steep surface earlier, on its way.
        assert same.mean() > (0.95 if name == "steep" else 0.999), (name, reverse)


def test_the_first_crossing_is_found():
    for (name, shape), slant in itertools.product(SHAPES.items(), (0.5, 12.0)):
        lens, surface, size = one_surface(**shape), pl.Surface(**shape), shape["semi_diameter"]
        rays = beam(size, 100, slant=slant)
        out = trace_part(lens, rays, 2, 2)
        p, d = np.asarray(rays.origin), np.asarray(rays.direction)
        # By looking closely: the gap z - sag at 4000 places of the ray in the clear cylinder.
        sin2, half = (d[:, :2] ** 2).sum(axis=1), (p[:, :2] * d[:, :2]).sum(axis=1)
        root = half**2 - sin2 * ((p[:, :2] ** 2).sum(axis=1) - size**2)
        crosses = root > 0
        ends = (-half[:, None] + np.sqrt(np.maximum(root, 0.0))[:, None] * [-1.0, 1.0]) / sin2[:, None]
        tall = 1.01 * np.abs(surface.sag(np.linspace(0, size, 99))).max() + 2 * surface.freeform.bounds(size).height
        near, far = (-tall - p[:, 2]) / d[:, 2], (tall - p[:, 2]) / d[:, 2]
        t = np.linspace(np.maximum(ends[:, 0], near), np.minimum(ends[:, 1], far), 4002)[1:-1]
        at = p + t[..., None] * d
        scale = np.minimum(1.0, size * (1 - 1e-12) / np.hypot(at[..., 0], at[..., 1]))
        gap = at[..., 2] - surface.sag(scale * at[..., 0], scale * at[..., 1])
        up = (gap[:-1] < 0) & (gap[1:] >= 0) & crosses
        first = np.where(up.any(axis=0), t[np.argmax(up, axis=0), np.arange(len(p))], np.nan)
        step = t[1] - t[0]
        hits = np.isfinite(out.origin[:, 2])
        reached = np.einsum("ij,ij->i", out.origin - p, d)
        clear = crosses & np.isfinite(first)
        # What is found is never behind the first change of sign that was seen, and where none was seen none is
        # taken, but for crossings between two places.
        both = clear & hits
        assert both.sum() > 0.2 * len(p), (name, slant)
        assert np.all(reached[both] <= first[both] + 1.01 * step[both]), (name, slant)
        assert np.mean(np.abs(reached[both] - first[both]) <= 1.01 * step[both]) > 0.98, (name, slant)
        lost = clear & ~hits & (out.status != pl.RayStatus.TOTAL_REFLECTION)
        assert not lost.any() and unsettled(out) <= 10 * AT_EQUATOR.get(name, 0.0), (name, slant)


def test_rotational_terms_are_an_even_asphere():
    size, r2 = 9.0, 10.0**2
    a4, a11, a22 = 0.03, -0.02, 0.01
    terms = np.zeros(22)
    terms[[3, 10, 21]] = a4, a11, a22
    z4, z11, z22 = math.sqrt(3) * a4, math.sqrt(5) * a11, math.sqrt(7) * a22
    # 2 u - 1, 6 u^2 - 6 u + 1 and 20 u^3 - 30 u^2 + 12 u - 1 without their constants.
    even = ((2 * z4 - 6 * z11 + 12 * z22) / r2, (6 * z11 - 30 * z22) / r2**2, 20 * z22 / r2**3)
    base, aspheric = {"radius": 40.0, "semi_diameter": size, "conic": -0.7}, {"aspheric": (0.0, 1e-5)}
    none = ZernikeSag([], 5.0), ZernikeSag([0.3], 5.0)  # piston alone moves nothing
    same = [({"freeform": ZernikeSag(terms, 10.0)}, {"aspheric": even})]
    same += [({"freeform": sag, **more}, more) for sag in none for more in ({}, aspheric)]
    for pair, reverse in itertools.product(same, (False, True)):
        rays = beam(size, 3000, -1.0 if reverse else 1.0, slant=3.0)
        one, other = (one_surface(**base, **more) for more in pair)
        a, b = (trace_part(lens, rays, 2, 2, reverse=reverse) for lens in (one, other))
        assert np.mean(a.status == b.status) > 0.999, (pair, reverse)  # rounding decides at the rim
        both = (a.status == OK) & (b.status == OK)
        assert np.abs(a.origin[both] - b.origin[both]).max() < 1e-11, (pair, reverse)
        assert np.abs(a.direction[both] - b.direction[both]).max() < 1e-12, (pair, reverse)
        # Paraxial data too.
        curvatures = [lens.elements[2].vertex_curvature for lens in (one, other)]
        assert curvatures[0] == pytest.approx(curvatures[1], rel=1e-13), pair


def test_turned_terms_are_a_turned_surface():
    # cos m(phi - t) = cos m t cos m phi + sin m t sin m phi.
    turn, terms, turned = 0.7, RNG.normal(size=36) * 5e-3, np.zeros(36)
    numbers = {noll_degree(j): j - 1 for j in range(1, 37)}
    for (n, m), j in numbers.items():
        turned[j] += terms[j] * math.cos(m * turn)
        turned[numbers[n, -m]] += terms[j] * math.sin(m * turn) * (m != 0)
    lens, other = (one_surface(radius=50.0, semi_diameter=9.0, freeform=ZernikeSag(k, 9.0)) for k in (terms, turned))
    matrix = np.array([[math.cos(turn), -math.sin(turn), 0], [math.sin(turn), math.cos(turn), 0], [0, 0, 1]])
    rays = beam(6.0, 500, slant=0.3)
    out = trace_part(lens, rays, 2, 2)
    turned_rays = pl.RayBundle(rays.origin @ matrix.T, rays.direction @ matrix.T)
    for same in (other, lens.moved(2, tilt=(0.0, 0.0, turn))):
        rotated = trace_part(same, turned_rays, 2, 2)
        assert rotated.origin == pytest.approx(out.origin @ matrix.T, abs=1e-12)
        assert rotated.direction == pytest.approx(out.direction @ matrix.T, abs=1e-13)


def freeform_lens():
    glass = pl.ConstantMedium(1.5)
    freeform = ZernikeSag([0, 0, 0, 0, 0.01, 0.02, 0.02, 0], 9.0)
    front = pl.Surface(60.0, 4.0, glass, semi_diameter=9.0, freeform=freeform)
    return pl.LensStack([front, pl.Surface(-60.0, 6.0, semi_diameter=9.0), pl.CircularStop(5.0)], name="free")


@pytest.mark.slow
def test_bounds_on_the_pupil_hold_all_round():
    lens, z_plane = freeform_lens(), 50.0
    bounds = pupil_bounds(lens, z_plane=z_plane, largest_radius=10.0, cell_radius=0.1, wavelength=587.6)
    parts, side = up_to_stops(lens_record(lens, 587.6, reverse=True)), np.linspace(-7, 7, 101)
    grid = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    for azimuth, rho in itertools.product((0.3, 2.0, 4.5), (0.0, 4.0, 9.5)):
        cos, sin = math.cos(azimuth), math.sin(azimuth)
        sight = PupilRays(parts, np.array([rho * cos, rho * sin, z_plane]), bounds.z)
        passing = grid[sight.fates(grid).code == 0]
        assert len(passing) > 100, (azimuth, rho)
        turned = passing @ np.array([[cos, -sin], [sin, cos]])
        row = min(int(rho / bounds.step), len(bounds.support) - 1)
        assert np.all(turned @ bounds.normals.T <= bounds.support[row]), (azimuth, rho)


def test_what_needs_an_axis_is_refused():
    lens = freeform_lens()
    for call, message in (
        (lambda: pl.aberrations.seidel_sums(lens, field=0.01), "surface 0 has a freeform term, for which Seidel"),
        (lambda: pl.aberrations.distortion(lens, [0.01]), "element 0 of 'free' has a freeform term"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            call()
    profile = lens.profiles()[0]
    assert profile[:, 0] - lens.vertices[0] == pytest.approx(lens.elements[0].sag(0.0, profile[:, 1]))
    surface = lens.elements[0]
    assert surface.osculating == dataclasses.replace(surface, freeform=None)


def test_what_cannot_be_is_refused():
    for made, message in [
        (lambda: ZernikeSag([0.0] * 91 + [1.0], 5.0), "coefficients has 92 terms, up to degree 13; at most 91"),
        (lambda: ZernikeSag([1.0], 0.0), "norm_radius"),
        (lambda: ZernikeSag([1.0], 1e-160), "norm_radius is 1e-160 mm; it must be from 1e-09"),
        (lambda: ZernikeSag([1.0], 1e300), "norm_radius"),
        (lambda: pl.Surface(9.0, semi_diameter=9.0, depth=10.0, freeform=ZernikeSag([], 9.0)), "without equator"),
        (lambda: pl.Surface(9.0, semi_diameter=5.0, freeform=ZernikeSag([0, 0, 0, 1e300], 1e-9)), "no finite sag"),
    ]:
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            made()


@pytest.mark.slow
def test_notes_and_colour():
    lens = freeform_lens()
    assert [finding.elements for finding in lens.check() if finding.kind is FindingKind.VERTEX] == [(0,)]
    rays = pl.RayBundle([[1.0, 2.0, -50.0], [0.0, -3.0, -50.0]], [[0.0, 0.0, 1.0], [0.01, 0.05, 1.0]])
    notes = probe_rays(lens_record(lens, rays.wavelength, reverse=False), blocks_of(rays), 2)
    normal = np.column_stack([*-lens.elements[0].gradient(*trace_part(lens, rays, 0, 0).origin[:, :2].T), np.ones(2)])
    cosine = np.einsum("ij,ij->i", normal, rays.direction) / np.linalg.norm(normal, axis=1)
    assert notes.incidence[0] == pytest.approx(1.0 / cosine, rel=1e-12)
    assert kinds(notes.lens) == ("freeform", "sphere", "stop")
    blocks = blocks_of(rays)
    fill_through_lens(blocks, lens_record(lens, np.array([500.0, 600.0]), reverse=False), np.ones(256, np.int64))
    out = lens.trace(dataclasses.replace(rays, wavelength=600.0))
    assert blocks[:2] == pytest.approx(out.origin[:, 0], abs=1e-12)


ZMX = (
    "MODE SEQ; UNIT CM; SURF 0; DISZ INFINITY; SURF 1; TYPE SZERNSAG; CURV 0.2; CONI -0.5; PARM 2 1.0E-3; "
    'XDAT 1 6.000000000E+000 0 0 1.0 0.0 0 0 ""; XDAT 2 1.100000000E+000 0 0 1.0 0.0 0 0 ""; '
    'XDAT 6 2.000000000E-003 0 0 1.0 0.0 0 0 ""; XDAT 8 -1.00000000E-003 0 0 1.0 0.0 0 0 ""; '
    "DISZ 0.4; GLAS ___BLANK 1 0 1.5 60 0 0 0 0 0; DIAM 1; SURF 2; DISZ 0.5; DIAM 1; SURF 3; STOP; DIAM 0.5; DISZ 9; "
    "SURF 4"
).replace("; ", "\n")


def test_zemax_files_are_read():
    lens = lens_from_zmx(ZMX, "mine.zmx")
    surface = lens.elements[0]
    freeform = surface.freeform
    assert freeform.norm_radius == pytest.approx(11.0)
    assert freeform.coefficients == pytest.approx((0, 0, 0, 0.02, 0, -0.01))
    assert surface.aspheric == pytest.approx((0.0, 1e-6)) and surface.radius == pytest.approx(50.0)
    # Zemax's surface goes through Z4(0) = -sqrt(3) at its place: the vertex lies that far in front of it.
    z = lens.vertices
    offset = -0.02 * math.sqrt(3)
    assert z[1] - z[0] == pytest.approx(4.0 - offset) and z[2] - z[1] == pytest.approx(5.0)
    height = surface.sag(3.0, -2.0) + z[0]
    conic_sag = dataclasses.replace(surface, freeform=None).sag(math.hypot(3, 2))
    rho, phi = math.hypot(3, 2) / 11, math.atan2(-2, 3)
    conic_sag += 0.02 * zernike(4, rho, phi) - 0.01 * zernike(6, rho, phi)
    assert height == pytest.approx(-9.0 + conic_sag)
    with pytest.raises(pl.errors.PrescriptionError, match="element 0 has a freeform term"):
        zmx_of_lens(lens)
    for nothing in (re.sub(r"(XDAT [68]) \S+", r"\1 0", ZMX), ZMX.replace("XDAT 1 6.0", "XDAT 1 0.0")):
        assert lens_from_zmx(nothing, "mine.zmx").elements[0].freeform is None


def test_zemax_files_that_cannot_be_read():
    number = "XDAT 1, the number of Zernike terms, is missing or invalid"
    for old, new, message in (
        ("XDAT 2 1.1", "XDAT 90 1.1", "line 13.*XDAT 2, the norm radius of the Zernike terms, is missing"),
        ("PARM 2", "PARM 9", "PARM 9 is 0.001; only PARM 1 to 8"),
        ("XDAT 1 6.0", "XDAT 1 7.0", "line 13.*states 7 Zernike terms, but XDAT 9, the last of them, is missing"),
        ("XDAT 1 6.0", "XDAT 1 1e15 ", "XDAT 1000000000000002, the last of them, is missing"),
        *(("XDAT 1 6.0", wrong, number) for wrong in ("XDAT 1 5.5", "XDAT 1 -6.0", "XDAT 90 6.0")),
        ("SZERNSAG", "FZERNSAG", "the surfaces that can be read are STANDARD, EVENASPH, .*, SZERNSAG, BICONICX"),
    ):
        with pytest.raises(pl.errors.PrescriptionError, match=message):
            lens_from_zmx(ZMX.replace(old, new), "mine.zmx")
