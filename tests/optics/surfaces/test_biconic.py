"""Biconic surfaces: derivatives and bounds by many digits, the limits that are conics, and files."""

import dataclasses
import itertools
import math

import mpmath
import numpy as np
import pytest
from refracting import beam, one_surface

import plenoptic as pl
from plenoptic.optics.lens.files.zemax import lens_from_zmx
from plenoptic.optics.lens.files.zemax_writing import zmx_of_lens
from plenoptic.optics.lens.kernels.biconic import biconic_at, biconic_second_bound
from plenoptic.optics.lens.lens_record import FIRST_NUMBER
from plenoptic.optics.lens.trace import trace_part

BiconicSag = pl.optics.BiconicSag
EPS, OK, INF = np.finfo(float).eps, pl.RayStatus.OK, math.inf

SHAPES = {
    "anamorphic": (BiconicSag(20.0, 12.0, -0.5, 0.4), 9.0),
    "saddle": (BiconicSag(15.0, -11.0, 0.3, -3.0), 8.0),
    "cylinder": (BiconicSag(INF, 5.0), 4.9),
    "hyperbolic": (BiconicSag(1.0, 3.0, -1.5, -4.0), 6.0),
    "flat": (BiconicSag(1e12, -1e150), 10.0),
    "micrometres": (BiconicSag(1e-3, 2e-3, 0.0, -1.0), 0.99e-3),
    "wavelengths": (BiconicSag(INF, 1e-9), 0.9e-9),
    "hyperbolic cylinder": (BiconicSag(1.0, INF, -2.0, 5.0), 9.0),
    "steep": (BiconicSag(5.0, 7.0), 4.9997),
}


def points_in(size, n, seed=5):
    rng = np.random.default_rng(seed)
    r, phi = size * np.sqrt(rng.uniform(size=n)), rng.uniform(0.0, 2.0 * math.pi, n)
    r[: n // 4], phi[: n // 8] = size, 0.5 * math.pi * rng.integers(0, 4, n // 8)
    return r * np.cos(phi), r * np.sin(phi)


def exact(term, x, y):
    """Sag, first and second derivatives (x, y; x x, x y, y y) by 60 digits and steps of 20."""
    with mpmath.workdps(60):
        cx, cy = (0 if math.isinf(r) else 1 / mpmath.mpf(r) for r in (term.radius_x, term.radius_y))
        kx, ky = 1 + mpmath.mpf(term.conic_x), 1 + mpmath.mpf(term.conic_y)

        def sag(u, v):
            return (cx * u**2 + cy * v**2) / (1 + mpmath.sqrt(1 - kx * cx**2 * u**2 - ky * cy**2 * v**2))

        x, y = mpmath.mpf(x), mpmath.mpf(y)
        h = mpmath.mpf(10) ** -18 * (abs(x) + abs(y))
        s = {(i, j): sag(x + i * h, y + j * h) for i, j in itertools.product((-1, 0, 1), repeat=2)}
        first = (s[1, 0] - s[-1, 0]) / (2 * h), (s[0, 1] - s[0, -1]) / (2 * h)
        mixed = (s[1, 1] - s[1, -1] - s[-1, 1] + s[-1, -1]) / (4 * h * h)
        second = (s[1, 0] - 2 * s[0, 0] + s[-1, 0]) / h**2, mixed, (s[0, 1] - 2 * s[0, 0] + s[0, -1]) / h**2
        return [float(number) for number in (s[0, 0], *first, *second)]


def test_sag_derivatives_and_bounds():
    for name, (term, size) in SHAPES.items():
        x, y = points_in(size, 200)
        reference = np.array([exact(term, *point) for point in zip(x, y, strict=True)]).T
        gradient, bounds = reference[1:3], term.bounds(size)
        row = np.array([0.0] * (FIRST_NUMBER - 1) + list(term.numbers()))
        kernel = np.array([biconic_at.py_func(*point, row) for point in zip(x, y, strict=True)]).T
        # 1 / w, w the root in the denominator, is the largest condition of the derivatives; rounding of w^2 over w^2.
        steep = [c * xy for c, xy in zip((1 / term.radius_x, 1 / term.radius_y), (x, y), strict=True)]
        w2 = 1 - (1 + term.conic_x) * steep[0] ** 2 - (1 + term.conic_y) * steep[1] ** 2
        error = 16 * EPS * np.maximum(1.0, 1.0 / w2) * (1.0 + np.abs(1.0 - w2))
        for sag, slopes in ((term.sag(x, y), term.gradient(x, y)), (kernel[0], kernel[1:])):
            assert np.all(np.abs(sag - reference[0]) <= bounds.rounding), name
            assert np.all(np.abs(slopes - gradient) <= error * bounds.slope), name
        hessian = reference[[3, 4, 4, 5]].T.reshape(-1, 2, 2)
        values = np.hypot(*gradient).max(), np.linalg.norm(hessian, ord=2, axis=(1, 2)).max(), abs(reference[0]).max()
        for value, bound in zip(values, bounds, strict=False):
            # Cells of a steep cone, in which w is 1 somewhere and many elsewhere.
            assert value <= bound * (1 + 1e-9) and bound < (9 if "hyperbolic" in name else 2.5) * value, (
                name,
                value,
                bound,
            )
        within = [biconic_second_bound.py_func(r2, row) for r2 in x * x + y * y]
        assert np.all(np.linalg.norm(hessian, ord=2, axis=(1, 2)) <= np.multiply(within, 1 + 1e-9)), name
        assert term.vertex == (0.0, 0.0, 1 / term.radius_x, 0.0, 1 / term.radius_y)
        assert term.inverted.sag(x, y) == pytest.approx(-term.sag(x, y), rel=0, abs=0)


def biconic(term, size):
    return one_surface(radius=INF, semi_diameter=size, freeform=term)


def test_equal_sections_are_a_conic():
    for (radius, conic, size), slant, s in itertools.product(
        [(10.0, 0.0, 9.0), (-10.0, -0.6, 9.0), (5.0, -3.0, 8.0), (2e-3, 0.0, 1.9e-3), (7.0, 1.0, 4.5), (1e9, 0.0, 9.0)],
        (0.0, 1.0, 20.0),  # 20: grazing
        (1.0, -1.0),
    ):
        case = radius, conic, slant, s
        lenses = (
            biconic(BiconicSag(radius, radius, conic, conic), size),
            one_surface(radius=radius, semi_diameter=size, conic=conic),
        )
        rays = beam(size, 2000, s, slant)
        ours, conics = (trace_part(lens, rays, 2, 2, reverse=s < 0) for lens in lenses)
        # The conic's kernel takes the first crossing of the whole conic, this one that inside the semi-diameter.
        both = (ours.status == OK) & (conics.status == OK)
        assert np.all(ours.status[conics.status == OK] != pl.RayStatus.NOT_CONVERGED), case
        near = np.hypot(*ours.origin[both, :2].T) < 0.999 * size
        p, q = (rays.origin[both][near] for rays in (ours, conics))
        same = np.abs(p - q).max(axis=1) <= 1e-9 * size
        # Grazing light from glass is reflected, or meets the rim from outside.
        assert both.sum() > (0.2 if slant < 20 else 0.01) * len(both), case
        assert same.mean() > (1.0 if slant < 20 else 0.9) - 1e-9, case
        bent = np.abs(ours.direction[both][near] - conics.direction[both][near]).max(axis=1)
        assert np.all(bent[same] <= 1e-8), case


def test_no_ray_is_given_up():
    for name, (term, size) in SHAPES.items():
        for slant, s in itertools.product((0.0, 3.0, 100.0), (1.0, -1.0)):
            out = trace_part(biconic(term, size), beam(size, 1000, s, slant), 2, 2, reverse=s < 0)
            lost = np.mean(out.status == pl.RayStatus.NOT_CONVERGED)
            assert lost == 0, (name, slant, s, lost)
            ok = out.status == OK
            p = out.origin[ok]
            assert np.abs(p[:, 2] - term.sag(p[:, 0], p[:, 1])).max(initial=0.0) <= 1e-7 * size, (name, slant, s)


def test_numbers_that_cannot_be_are_refused():
    for call, message in (
        (lambda: BiconicSag(0.0, 5.0), "radius_x is 0 mm; it must not be 0 or nan"),
        (lambda: BiconicSag(5.0, math.nan), "radius_y is nan mm"),
        (lambda: BiconicSag("5", 5.0), "radius_x is '5'; it must be a number"),
        (lambda: BiconicSag(5.0, 5.0, INF), "conic_x is inf; it must be finite"),
        (lambda: biconic(BiconicSag(5.0, INF), 5.0), "has no finite sag and slope up to the semi-diameter 5 mm"),
        (lambda: BiconicSag(5.0, INF).sag(6.0, 0.0), "the points reach 6 mm from the vertex, beyond BiconicSag"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            call()
    assert BiconicSag(-INF, 5) == BiconicSag(INF, 5.0)


def test_json_keeps_every_bit(tmp_path):
    lens = biconic(BiconicSag(INF, 1.0 / 3.0, -0.1, 0.7), 0.2)
    pl.save_lens(lens, tmp_path / "lens.json")
    assert pl.load_lens(tmp_path / "lens.json") == lens
    text = (tmp_path / "lens.json").read_text(encoding="utf-8").replace('"freeform"', '"departure"')
    (tmp_path / "before.json").write_text(text, encoding="utf-8")  # as earlier versions wrote it
    assert "departure" in text and pl.load_lens(tmp_path / "before.json") == lens


ZMX = (
    "MODE SEQ; UNIT CM; SURF 0; DISZ INFINITY; SURF 1; TYPE BICONICX; CURV 0.2; CONI -0.5; PARM 1 3.0; PARM 2 0.25; "
    "DISZ 0.4; GLAS ___BLANK 1 0 1.5 60 0 0 0 0 0; DIAM 1; SURF 2; DISZ 0.5; DIAM 1; SURF 3; STOP; DIAM 0.5; DISZ 9; "
    "SURF 4"
).replace("; ", "\n")


def test_zemax_files_are_read():
    surface = lens_from_zmx(ZMX, "mine.zmx").elements[0]
    term = surface.freeform
    assert (term.radius_x, term.radius_y) == pytest.approx((30.0, 50.0), rel=4 * EPS)
    assert (term.conic_x, term.conic_y) == (0.25, -0.5)
    assert surface == pl.Surface(
        INF, surface.thickness, surface.medium, semi_diameter=10.0, freeform=BiconicSag(30.0, term.radius_y, 0.25, -0.5)
    )
    for old, new, expected in (
        ("PARM 1 3.0", "PARM 1 0.0", BiconicSag(INF, term.radius_y, 0.25, -0.5)),
        ("PARM 1 3.0\nPARM 2 0.25", "PARM 3 0", BiconicSag(INF, term.radius_y, 0.0, -0.5)),
        ("CURV 0.2", "CURV 0", BiconicSag(30.0, INF, 0.25, -0.5)),
        ("CURV 0.2\nCONI -0.5\nPARM 1 3.0", "CURV 0", None),
    ):
        assert lens_from_zmx(ZMX.replace(old, new), "mine.zmx").elements[0].freeform == expected, new
    with pytest.raises(pl.errors.PrescriptionError, match="PARM 3 is 1; only PARM 1 to 2 of BICONICX surfaces"):
        lens_from_zmx(ZMX.replace("PARM 2 0.25", "PARM 3 1"), "mine.zmx")
    with pytest.raises(pl.errors.PrescriptionError, match="line 7: freeform BiconicSag.* no finite sag and slope"):
        lens_from_zmx(ZMX.replace("PARM 1 3.0", "PARM 1 0.9"), "mine.zmx")
    with pytest.raises(pl.errors.PrescriptionError, match="element 0 has a freeform term"):
        zmx_of_lens(lens_from_zmx(ZMX, "mine.zmx"))


def test_a_mirror_behind_a_mirror_is_seen_from_the_other_side():
    term = BiconicSag(-300.0, -200.0, -1.0, 0.5)
    mirror = pl.Surface(INF, 50.0, pl.optics.MIRROR, semi_diameter=20.0, freeform=term)
    assert mirror.from_behind == dataclasses.replace(mirror, freeform=BiconicSag(300.0, 200.0, -1.0, 0.5))
    lens = pl.LensStack([pl.CircularStop(10.0, 60.0), mirror, pl.Surface(INF, semi_diameter=30.0)])
    h = 1e-3
    out = lens.trace(pl.RayBundle([[h, 0.0, -1.0], [0.0, h, -1.0]], [[0.0, 0.0, 1.0]] * 2))
    slopes = np.diagonal(out.direction[:, :2]) / out.direction[:, 2]
    # The focus of a section is at half its radius.
    assert slopes == pytest.approx([-h / 150.0, -h / 100.0], rel=1e-8)
