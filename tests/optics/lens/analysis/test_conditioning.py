"""Condition numbers: closed forms, finite differences, 50 digits; counts of steps and of lost rays."""

import itertools
import math
import sys
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.errors import InvalidValueError
from plenoptic.optics import Condition, FindingKind, conditioning
from plenoptic.optics.lens.analysis.conditioning import ProbeRecords, blocks_of, probe_rays, sizes
from plenoptic.optics.lens.checks.check import findings
from plenoptic.optics.lens.lens_record import lens_record
from plenoptic.optics.lens.trace import trace_part

sys.path.insert(0, str(Path(__file__).parents[3] / "validation"))
from rounding_study import rounding_cases
from rounding_study.exact_trace import trace_exactly

EPS = float(np.finfo(float).eps)
GLASS, INDEX = pl.ConstantMedium(1.5), 1.5
STOP = pl.CircularStop(50.0, 1.0)
CASES = {case.name: case for case in rounding_cases()}
ASPHERE = pl.Surface(50.0, 5.0, GLASS, semi_diameter=25.0, conic=-1.0, aspheric=(0.0, 1e-6, -2e-9))
STRONG = pl.Surface(20.0, 5.0, GLASS, semi_diameter=4.5, aspheric=(0.0, -4e-3, 4e-4, -1e-5))
SHAPES = {
    "plane": pl.Surface(math.inf, 5.0, GLASS, semi_diameter=25.0),
    "sphere": pl.Surface(-40.0, 5.0, GLASS, semi_diameter=25.0),
    "conic": pl.Surface(50.0, 5.0, GLASS, semi_diameter=25.0, conic=2.0),
    "asphere": ASPHERE,
    "moved": pl.Surface(50.0, 5.0, GLASS, semi_diameter=25.0, placement=pl.optics.Placement(shift=(1.0, 2.0, 0.5))),
}


def stack(surface: pl.Surface) -> pl.LensStack:
    """Behind a stop, and with a plane far behind: the surface is element 1."""
    return pl.LensStack([STOP, surface, pl.Surface(math.inf, semi_diameter=1e4)])


def beam(n: int, size: float, slope: float, z: float = -20.0, seed: int = 0) -> pl.RayBundle:
    rng = np.random.default_rng(seed)
    start = np.column_stack([rng.uniform(-size, size, (n, 2)), np.full(n, z)])
    return pl.RayBundle(start, np.column_stack([rng.uniform(-slope, slope, (n, 2)), np.ones(n)]))


def at_element(lens, rays, k, *, reverse=False, clipping=True) -> ProbeRecords:
    """What is probe_rays of rays that go through element k alone."""
    record = lens_record(lens, rays.wavelength, reverse=reverse, first=k, last=k, clipping=clipping)
    return probe_rays(record, blocks_of(rays), len(rays))


def test_numbers_in_closed_form():
    for degrees in (0.0, 30.0, 60.0, 89.0, 89.999):
        # Into glass at i: 1 / cos i, cos i / (n cos i'). Out of it the same numbers the other way round: close to the
        # critical angle for the ray inside, so that a change of direction is magnified by n cos i' / cos i.
        plate = pl.LensStack([pl.CircularStop(1e9), pl.Surface(math.inf, 1e-6, GLASS, semi_diameter=1e9),
                              pl.Surface(math.inf, semi_diameter=1e9)])  # fmt: skip
        i = math.radians(degrees)
        cos_i, cos_t = math.cos(i), math.sqrt(1.0 - (math.sin(i) / INDEX) ** 2)
        found = conditioning(plate, pl.RayBundle([[0, 0, -1.0]], [[0, math.sin(i), math.cos(i)]]))
        # cos^2 behind the second plane is the difference of two numbers of size 1.
        rtol = 16 * EPS / cos_i**2
        np.testing.assert_allclose(found.incidence[:, 0], [1 / cos_i, 1 / cos_i, 1 / cos_t], rtol=rtol)
        expected = [1.0, cos_i / (INDEX * cos_t), INDEX * cos_t / cos_i]
        np.testing.assert_allclose(found.refraction[:, 0], expected, rtol=rtol)
        assert found.kinds == ("stop", "plane", "plane")
    # Along the axis: from where the ray came from to the vertex, and the way to the point, over the size.
    lens = pl.LensStack([pl.Surface(30.0, 4.0, GLASS, semi_diameter=8.0), pl.Surface(math.inf, 3.0, semi_diameter=8.0),
                         pl.CircularStop(5.0)])  # fmt: skip
    found = conditioning(lens, pl.RayBundle([[0, 0, -1007.0]], [[0, 0, 1.0]]))
    # The first element stands 7 mm before the lens's origin, which counts too; the last one at it.
    np.testing.assert_allclose(found.cancellation[:, 0], [2007.0 / 8.0, 8.0 / 8.0, 6.0 / 5.0], rtol=8 * EPS * 1000)
    np.testing.assert_allclose(found.digits_lost[:, 0], np.log10([2007.0 / 8.0, 1.0, 1.2]), atol=1e-12)
    assert found.worst[:2] == (0, Condition.CANCELLATION)


@pytest.mark.slow
def test_numbers_are_what_a_small_change_of_the_ray_is_magnified_by():
    for name, reverse in itertools.product(SHAPES, (False, True)):
        lens, n, step = stack(SHAPES[name]), 200, 1e-6
        rays = beam(n, 12.0, 0.6, z=1.0)
        if reverse:
            rays = pl.RayBundle(rays.origin + np.array([0, 0, 10.0]), -rays.direction)
        met = trace_part(lens, rays, 1, 1, reverse=reverse)
        kept = met.status == 0
        assert kept.sum() > n / 2, (name, reverse)
        d, hit = rays.direction[kept], met.origin[kept]
        notes = at_element(lens, rays, 1, reverse=reverse)
        cos_i, bent = 1.0 / notes.incidence[0, kept], met.direction[kept]
        # d' - mu d lies along the normal.
        normal = bent - (INDEX if reverse else 1 / INDEX) * d
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        np.testing.assert_allclose(np.abs((normal * d).sum(axis=1)), cos_i, rtol=1e-12)
        across = normal - (normal * d).sum(axis=1)[:, None] * d
        across /= np.linalg.norm(across, axis=1)[:, None]
        ok = np.linalg.norm(np.cross(normal, d), axis=1) > 1e-3
        # Central differences: an error of some step^2, and of rounding eps x 20 mm / step = 4e-9, times 1 / cos.
        shifted = [trace_part(lens, pl.RayBundle(hit + s * step * across, d), 1, 1, reverse=reverse) for s in (1, -1)]
        apart = np.linalg.norm(shifted[0].origin - shifted[1].origin, axis=1) / (2 * step)
        np.testing.assert_allclose(apart[ok], 1 / cos_i[ok], rtol=1e-6)
        turned = [trace_part(lens, pl.RayBundle(hit, d + s * step * across), 1, 1, reverse=reverse) for s in (1, -1)]
        change = np.linalg.norm(turned[0].direction - turned[1].direction, axis=1) / (2 * step)
        np.testing.assert_allclose(change[ok], notes.refraction[0, kept][ok], rtol=1e-6)


def test_an_ideal_lens_changes_angles_by_its_cosines():
    lens = pl.load_lens("double-gauss-100mm-f2").with_model(pl.LensModel.THIN)
    place = float(lens_record(lens, 587.6, reverse=False).rows[0]["z"])
    u = np.array([0.1 - 1e-6, 0.1, 0.1 + 1e-6])
    # Slopes about the point where the middle ray meets the lens.
    rays = pl.RayBundle([[0, 6.0, place]] * 3, np.column_stack([0 * u, u, np.ones(3)]))
    found = conditioning(lens, pl.RayBundle([[0.0, 6.0, place]], rays.direction[1:2]))
    out, before = (np.arctan2(d[:, 1], d[:, 2]) for d in (lens.trace(rays).direction, rays.direction))
    assert found.kinds[0] == "ideal lens"
    assert found.refraction[0, 0] == pytest.approx((out[2] - out[0]) / (before[2] - before[0]), rel=1e-6)


SINGLE = [name for name, case in CASES.items() if case.law.name == "SURFACES" and case.setup(
    np.random.default_rng(0), 1).first == case.setup(np.random.default_rng(0), 1).last and "wrong way" not in name
    and name != "miss"]  # fmt: skip


def exactly(name, n=8):
    """Rays of a case at their surface: notes, the size of the element, what was traced and what is true."""
    setup = CASES[name].setup(np.random.default_rng(3), n)
    k, reverse = setup.first, setup.reverse
    notes = at_element(setup.lens, setup.rays, k, reverse=reverse)
    traced = trace_part(setup.lens, setup.rays, k, k, reverse=reverse)
    true = trace_exactly(setup.lens, setup.rays, k, k, reverse=reverse)
    both = [i for i in range(n) if traced.status[i] == 0 and true[i].status == 0]
    return setup, notes, float(sizes(notes.lens)[0]), traced, true, both


def test_rounding_stays_below_the_condition_numbers():
    # 4 eps max(|hit|, |z of the vertex|, terms) / cos i, ten times that at grazing incidence, is what `bounds_of` holds
    # every ray to; cancellation x size counts these lengths and more. On the direction, 4 eps (1 + mu^2) / cos t,
    # where 1 / cos t = refraction x incidence / mu; and the normal turns with the point: by curvature x error of it,
    # which counts times |cos t - mu cos i| (1 + mu / cos t).
    seen = 0
    for name in SINGLE:
        _, notes, size, traced, true, both = exactly(name)
        for i in both:
            hit = true[i].hits[-1]
            incidence, refraction = float(notes.incidence[0, i]), float(notes.refraction[0, i])
            mu, cos_i, cos_t = float(hit.mu), float(hit.cos_i), math.sqrt(float(hit.cos2_t))
            if abs(float(hit.cos2_t)) <= 8 * mu**2 * EPS:
                continue  # rounding decides whether it is reflected
            assert incidence == pytest.approx(1 / cos_i, rel=1e-2 if cos_i > 1e-6 else 1.0)
            allowed = 4 * EPS * incidence * float(notes.cancellation[0, i]) * size * (10.0 if cos_i < 1e-2 else 1.0)
            off = math.dist(traced.origin[i], [float(x) for x in true[i].origin])
            # The true point is itself rounded to float64 here.
            assert off <= allowed + EPS * math.hypot(*traced.origin[i]), name
            turned = math.sqrt(
                sum((float(x) - y) ** 2 for x, y in zip(traced.direction[i], true[i].direction, strict=True))
            )
            bend = abs(cos_t - mu * cos_i) * (1 + mu / cos_t)
            of_normal = bend * float(hit.curvature) * allowed
            assert turned <= 4 * EPS * (1 + mu * mu) * refraction * incidence / mu * 1.1 + of_normal + 2 * EPS, name
            seen += 1
    assert seen > 200


def test_spheres_take_no_steps_and_strong_aspheres_more():
    counts = {}
    for name, surface in {**SHAPES, "strong": STRONG}.items():
        found = conditioning(stack(surface), beam(500, 2.5, 0.02))
        counts[name] = found.newton[1]
        assert found.kinds[1] == {"moved": "sphere", "strong": "asphere"}.get(name, name)
    for name in ("plane", "sphere", "conic", "moved"):
        assert counts[name].tolist() == [0.0, 0.0], name
    # The asphere departs from its conic by 1e-6 x 3.5^4 = 0.15 um, the strong one by 0.6 mm.
    assert 1 <= counts["asphere"][1] < counts["strong"][1] <= counts["strong"][0] <= 12
    # Neither rims nor the other rays of a block change how many steps a ray takes.
    for surface in (ASPHERE, STRONG):
        rays, lens = beam(600, 3.0, 0.2, z=0.5), stack(surface)
        notes, unclipped = at_element(lens, rays, 1), at_element(lens, rays, 1, clipping=False)
        ok = notes.codes == 0
        assert ok.sum() > 300
        np.testing.assert_array_equal(notes.newton[0, ok], unclipped.newton[0, ok])
        for i in np.flatnonzero(ok)[:20]:
            assert at_element(lens, rays.selected([i]), 1).newton[0, 0] == notes.newton[0, i]


def test_searches_and_their_failures_are_counted():
    setup = CASES["wild numbers, asphere"].setup(np.random.default_rng(0), 2000)
    notes = at_element(setup.lens, setup.rays, setup.first)
    status = trace_part(setup.lens, setup.rays, setup.first, setup.first).status
    failed = status == pl.RayStatus.NOT_CONVERGED
    assert failed.sum() > 5
    # A ray ends NOT_CONVERGED after 400 steps, or where rounding leads past the surface: after a step at least.
    assert np.nanmax(notes.search) == 400 and (notes.search[0, failed] >= 1).all()
    assert (notes.codes % 8 == pl.RayStatus.NOT_CONVERGED).sum() == failed.sum()
    # Rays that cross once are not searched.
    assert conditioning(stack(ASPHERE), beam(500, 8.0, 0.2)).searched.tolist() == [0, 0, 0]
    gull = pl.Surface(math.inf, 5.0, GLASS, semi_diameter=3.0, aspheric=(0.5, -0.1))
    found = conditioning(stack(gull), beam(500, 2.0, 1.0, z=0.0))
    assert found.searched[1] > 50 and found.search[1, 0] > 1


def test_lost_rays_are_those_of_trace_and_many_are_taken_in_parts():
    for reverse in (False, True):
        lens = pl.load_lens("double-gauss-100mm-f2")
        rays = beam(3000, 30.0, 0.3, z=-60.0)
        if reverse:
            rays = pl.RayBundle(rays.origin * [1, 1, -1], rays.direction * [1, 1, -1])
        status = np.where(np.arange(3000) % 100 == 0, np.uint8(pl.RayStatus.OUTSIDE_MICROLENS), np.uint8(0))
        rays = pl.RayBundle(rays.origin, rays.direction, status=status)
        out = lens.trace_reverse(rays) if reverse else lens.trace(rays)
        found = conditioning(lens, rays, reverse=reverse)
        gone = np.stack([out.status, out.lost_at], axis=1)[out.status != 0]
        kinds, counts = np.unique(gone, axis=0, return_counts=True)
        expected = {
            (pl.RayStatus(s).name.lower(), None if at < 0 else at): int(k)
            for (s, at), k in zip(kinds.tolist(), counts, strict=True)
        }
        assert {(cause, at): count for cause, at, count in found.lost} == expected, reverse
        assert found.lost_at(None) == {"outside_microlens": 30}, reverse
        assert sum(found.lost_by_cause.values()) == (out.status != 0).sum(), reverse
        # Each element is reached by those that none before has lost.
        lost = [sum(found.lost_at(int(k)).values()) for k in found.elements]
        np.testing.assert_array_equal(found.reached, 3000 - 30 - np.cumsum([0, *lost[:-1]]))
        assert found.elements.tolist() == (list(range(10, -1, -1)) if reverse else list(range(11))), reverse
    # 64 blocks of 256 rays at a time: the 20000 rays are 5000 four times over.
    lens, rays = pl.load_lens("singlet-100mm-f4"), beam(5000, 10.0, 0.1)
    four = pl.RayBundle(np.tile(rays.origin, (4, 1)), np.tile(rays.direction, (4, 1)))
    once, often = conditioning(lens, rays), conditioning(lens, four)
    np.testing.assert_array_equal(often.reached, 4 * once.reached)
    np.testing.assert_array_equal(often.incidence[:, 0], once.incidence[:, 0])
    none = conditioning(lens, pl.RayBundle(np.empty((0, 3)), np.empty((0, 3))))
    assert none.rays == 0 and none.worst is None and np.isnan(none.incidence).all()
    broken = conditioning(lens, pl.RayBundle([[0, 0, math.nan]], [[0, 0, 1.0]]))
    assert broken.lost == (("not_finite", None, 1),) and broken.worst is None
    assert "1 not finite" in str(broken) and "before the lens" in str(broken)


def test_it_prints_as_a_table():
    found = conditioning(stack(STRONG), beam(300, 6.0, 0.3))
    lines = str(found).splitlines()
    assert len(lines) == 1 + 3 + 2 and lines[2].split()[:3] == ["1", "asphere", str(found.reached[1])]
    assert "clipped" in lines[2] and lines[-1].startswith("worst: ")
    for make, text in (
        (lambda: conditioning("double-gauss-100mm-f2", beam(1, 1.0, 0.1)), "lens is"),
        (lambda: conditioning(stack(ASPHERE), None), "rays is"),
    ):
        with pytest.raises(InvalidValueError, match=text):
            make()


def test_extreme_lenses_are_found():
    # A ball behind an iris of nearly its own size: rays meet it at its rim.
    ball = [pl.Surface(5.0, 10.0, GLASS, semi_diameter=5.0, depth=5.0), pl.Surface(-5.0, semi_diameter=5.0, depth=5.0)]
    wide = findings(pl.LensStack([pl.CircularStop(5.0, 0.0), *ball]))
    assert FindingKind.GRAZING in {finding.kind for finding in wide}
    # Plates to both sides of an iris: rays up to 88 degrees go in grazing and come out nearly totally reflected.
    plate = [pl.Surface(math.inf, 1.0, GLASS, semi_diameter=60.0), pl.Surface(math.inf, 1.0, semi_diameter=60.0)]
    near = findings(pl.LensStack([*plate, pl.CircularStop(1.0, 1.0), *plate]))
    assert [f.kind for f in near] == [FindingKind.GRAZING, FindingKind.NEAR_TOTAL_REFLECTION]
    cos_i, cos_t = math.cos(math.radians(88.0)), math.sqrt(1 - (math.sin(math.radians(88.0)) / INDEX) ** 2)
    assert f"up to 88 degrees at element 0, which magnifies their errors there {1 / cos_i:.3g} times" in near[0].message
    assert f"direction {INDEX * cos_t / cos_i:.3g} times (n cos i / (n' cos i'))" in near[1].message
    # A surface of a micrometre 100 mm behind the others: lengths of 100 mm, twice, over 1e-3 mm.
    tiny = [pl.Surface(50.0, 2.0, GLASS, semi_diameter=5.0), pl.Surface(math.inf, 98.0, semi_diameter=5.0),
            pl.Surface(1e-3, 1e-3, GLASS, semi_diameter=1e-3), pl.Surface(math.inf, semi_diameter=5.0)]  # fmt: skip
    lost = [f for f in findings(pl.LensStack([pl.CircularStop(0.5, 1.0), *tiny])) if f.kind is FindingKind.CANCELLATION]
    assert [f.elements for f in lost] == [(3,)] and "digits are lost" in lost[0].message
