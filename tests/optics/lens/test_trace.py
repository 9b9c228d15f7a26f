import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import plenoptic as pl
from plenoptic.optics.element_record import SPHERE
from plenoptic.optics.lens.lens_record import ROW, LensRecord
from plenoptic.optics.lens.trace import trace_record

EPS = np.finfo(float).eps
OK, MISSED, CLIPPED = pl.RayStatus.OK, pl.RayStatus.MISSED, pl.RayStatus.CLIPPED
TOTAL_REFLECTION, NOT_FINITE = pl.RayStatus.TOTAL_REFLECTION, pl.RayStatus.NOT_FINITE
DOUBLE_GAUSS = pl.load_lens("double-gauss-100mm-f2")


def surface_record(curvatures, ratios, vertices, *, s=1.0):
    """Bare surfaces in air or glass, without a stop: what no LensStack can be."""
    numbers = enumerate(zip(vertices, curvatures, ratios, strict=True))
    rows = np.array([(SPHERE, z, c, ratio, math.inf, math.inf, i) for i, (z, c, ratio) in numbers], ROW)
    none = dict.fromkeys(("conic", "aspheric", "freeform", "frames", "mirrors", "masks", "index_ratios"))
    first_edge = np.zeros(len(rows) + 1, dtype=np.int64)
    return LensRecord(rows=rows, edges=np.zeros((0, 4)), first_edge=first_edge, direction=s, **none)


def through(record, origin, direction):
    """Points, directions and statuses behind the last of the record's elements."""
    out = trace_record(record, pl.RayBundle(origin, direction))
    return out.origin, out.direction, out.status, out.lost_at


def random_directions(rng, n, widest):
    """Unit vectors within an angle of +z."""
    cos = rng.uniform(math.cos(widest), 1.0, n)
    azimuth = rng.uniform(0, 2 * math.pi, n)
    sin = np.sqrt(1 - cos * cos)
    return np.stack([sin * np.cos(azimuth), sin * np.sin(azimuth), cos], axis=1)


@settings(max_examples=40)
@given(
    curvature=st.one_of(st.just(0.0), st.floats(-0.2, 0.2), st.sampled_from([1e-9, -1e-9, 20.0])),
    mu=st.floats(0.4, 2.5),
    s=st.sampled_from([1.0, -1.0]),
    seed=st.integers(0, 1000),
)
def test_snell_at_a_surface(curvature: float, mu: float, s: float, seed: int):
    rng = np.random.default_rng(seed)
    size = min(4.0, 0.8 / abs(curvature) if curvature else 4.0)
    target = np.column_stack([rng.uniform(-size, size, (256, 2)), np.zeros(256)])
    d = random_directions(rng, 256, 1.2) * [1, 1, s]
    p, out, status, _ = through(surface_record([curvature], [mu], [0.0], s=s), target - 7.0 * d, d)
    kept = status == OK
    p, d, out = p[kept], d[kept], out[kept]
    normal = np.array([0, 0, 1.0]) - curvature * p
    # On the surface: F / 2 is the distance from it; a hit p is good to a few eps of p, and of the closest approach.
    distance = 0.5 * curvature * np.einsum("ij,ij->i", p, p) - p[:, 2]
    cos_i = np.abs(np.einsum("ij,ij->i", normal, d))
    scale = np.linalg.norm(p, axis=1) + size
    assert np.all(np.abs(distance) <= 8 * EPS * scale)
    # n x d' = mu n x d: what is subtracted is along the normal to rounding of terms of size mu + 1.
    sideways = np.cross(normal, out) - mu * np.cross(normal, d)
    assert np.all(np.linalg.norm(sideways, axis=1) <= 8 * EPS * (1 + mu))
    # In one plane: the triple product of unit vectors.
    assert np.all(np.abs(np.einsum("ij,ij->i", np.cross(d, normal), out)) <= 8 * EPS * (1 + mu))
    # Unit length: cos i is good to eps / cos i, and enters through cos t with mu^2 cos i / cos t.
    cos_t = np.abs(np.einsum("ij,ij->i", normal, out))
    condition = (1 + mu) ** 2 * (1 + 1 / np.minimum(cos_i, cos_t))
    assert np.all(np.abs(np.linalg.norm(out, axis=1) - 1) <= 4 * EPS * condition)
    # Neither reflected nor on the wrong side.
    assert np.all(s * np.einsum("ij,ij->i", normal, out) >= 0)


def test_a_ball_turns_every_ray_by_twice_i_minus_r():
    for s in (1.0, -1.0):
        # Rays from all sides, also across and against the axis: which root is right depends on the direction of travel
        # along the stack, not on the sign of N.
        radius, n = 10.0, 1.5
        rng = np.random.default_rng(4)
        d = rng.normal(size=(4096, 3))
        d /= np.linalg.norm(d, axis=1, keepdims=True)
        aside = np.cross(d, rng.normal(size=(4096, 3)))
        aside *= (radius * np.sqrt(rng.uniform(0, 0.98, 4096)) / np.linalg.norm(aside, axis=1))[:, None]
        record = surface_record([s / radius, -s / radius], [1 / n, n], [0.0, s * 2 * radius], s=s)
        _, out, status, _ = through(record, aside + np.array([0, 0, s * radius]) - 40 * d, d)
        assert np.all(status == OK), s
        sine = np.linalg.norm(aside, axis=1) / radius
        expected = 2 * (np.arcsin(sine) - np.arcsin(sine / n))
        turned = np.arctan2(np.linalg.norm(np.cross(d, out), axis=1), np.einsum("ij,ij->i", d, out))
        # The impact parameter is good to some 10 eps of 40 mm, 40 eps of the radius; d asin(s) / ds = 1 / cos i.
        assert np.all(np.abs(turned - expected) <= 2 * 48 * EPS / np.sqrt(1 - sine**2)), s


@settings(max_examples=30)
@given(angle=st.floats(-1.3, 1.3), thickness=st.floats(0.01, 50.0), n=st.floats(1.0, 3.0))
def test_a_plate_shifts_rays_sideways(angle: float, thickness: float, n: float):
    front = pl.Surface(math.inf, thickness, pl.ConstantMedium(n), semi_diameter=1e6)
    lens = pl.LensStack([pl.CircularStop(1e6, 1.0), front, pl.Surface(math.inf, semi_diameter=1e6)])
    d = np.array([math.sin(angle), 0.0, math.cos(angle)])
    out = lens.trace(pl.RayBundle(-3.0 * d[None], d[None]))
    # Not 1 - cos / sqrt(n^2 - sin^2) of the textbook, which the sine's rounding spoils where n is near 1.
    root = math.sqrt(math.cos(angle) ** 2 + (n - 1) * (n + 1))
    shift = thickness * math.sin(angle) * (1 - math.cos(angle) / root)
    found = out.origin[0, 2] * d[0] - out.origin[0, 0] * d[2]
    # Distances along the slanted ray are good to a few eps of them; they are up to (thickness + 4) / cos.
    scale = (thickness + 4) / math.cos(angle) ** 2
    assert found == pytest.approx(shift, abs=16 * EPS * scale)
    assert np.abs(out.direction[0] - d).max() <= 8 * EPS * n * n / math.cos(angle)


def test_the_way_back_is_the_way_there():
    for name in pl.lens_names():
        lens = pl.load_lens(name)
        rng = np.random.default_rng(7)
        points = pl.paraxial.cardinal_points(lens)
        size = points.entrance_pupil_semi_diameter
        aim = np.column_stack([rng.uniform(-size, size, (3000, 2)), np.full(3000, points.entrance_pupil)])
        d = random_directions(rng, 3000, 0.05 if name.startswith("mirror") else 0.5)
        rays = pl.RayBundle(aim - 3 * lens.length * d, d)
        there = lens.trace(rays)
        kept = there.status == OK
        assert np.count_nonzero(kept) > 30, name
        there, rays = there.selected(kept), rays.selected(kept)
        back = lens.trace_reverse(pl.RayBundle(there.origin, -there.direction))
        # At the rim the last bit may decide.
        held = back.status == OK
        assert np.count_nonzero(~held) <= 2, name
        # Each of up to 33 passages adds some eps of direction over levers of the lens's length, amplified on the way by
        # what the elements magnify (up to 4) and, near grazing, by 1 / cos i (up to 4).
        turns = 16 * 2 * len(lens.elements)
        assert np.abs(back.direction + rays.direction)[held].max() <= turns * EPS, name
        away = np.cross(back.origin - rays.origin, rays.direction)[held]
        assert np.abs(away).max() <= turns * EPS * 4 * lens.length, name


def pair(*, stop=5.0, rear=6.0):
    """A plano-convex lens behind a stop; elements 0, 1, 2."""
    front = pl.Surface(20.0, 4.0, pl.ConstantMedium(1.5), semi_diameter=6.0)
    return pl.LensStack([pl.CircularStop(stop, 2.0), front, pl.Surface(math.inf, semi_diameter=rear)])


def status_of(rays: pl.RayBundle) -> list[tuple[pl.RayStatus, int]]:
    return [(pl.RayStatus(s), int(k)) for s, k in zip(rays.status, rays.lost_at, strict=True)]


def test_lost_rays_name_the_element():
    rays = pl.RayBundle(
        # Through the lens; beside the stop; through the stop and beside the first surface; beside the last one.
        [[0, 0, -10], [5.1, 0, -10], [0, -4.9, 0], [0, 4.9, 0]],
        [[0, 0, 1], [0, 0, 1], [0, -0.8, 1], [0, 0.2, 1]],
    )
    out = pair(rear=5.0).trace(rays)
    assert status_of(out) == [(OK, -1), (CLIPPED, 0), (CLIPPED, 1), (CLIPPED, 2)]
    assert out.weight.tolist() == [1, 0, 0, 0]
    assert np.isnan(out.origin[1:]).all() and np.isnan(out.direction[1:]).all()
    # The reference is clipped by its stop.
    lens = DOUBLE_GAUSS.with_stop(pl.CircularStop(5.0))
    heights = [0.0, 10.0, 24.0, 25.3]
    out = lens.trace(pl.RayBundle([[0, h, -404.0] for h in heights], [[0, 0, 1.0]] * 4))
    assert status_of(out) == [(OK, -1), (CLIPPED, 5), (CLIPPED, 5), (CLIPPED, 0)]
    # Beside a sphere rays miss.
    ball = pl.Surface(10.0, 1.0, pl.ConstantMedium(1.5), semi_diameter=10.0)
    lens = pl.LensStack([pl.CircularStop(30.0, 2.0), ball, pl.Surface(math.inf, semi_diameter=50.0)])
    out = lens.trace(pl.RayBundle([[9.0, 0, -5], [10.5, 0, -5]], [[0, 0, 1.0], [0, 0, 1]]))
    assert status_of(out) == [(OK, -1), (MISSED, 1)]


def test_total_reflection_begins_at_the_critical_angle():
    for s, n in itertools.product((1.0, -1.0), (1.3, 1.5, 2.4)):
        critical = math.asin(1 / n)
        # cos^2 t = 1 - n^2 sin^2 i has the slope 2 n cos(i) in the angle, and is good to a few eps n^2.
        step = 16 * EPS * n * n / math.cos(critical)
        angles = critical + np.array([-0.1, -1e-9, -step, step, 1e-9, 0.1])
        d = np.stack([np.sin(angles), 0 * angles, s * np.cos(angles)], axis=1)
        _, out, status, lost_at = through(surface_record([0.0], [n], [0.0], s=s), -2 * d, d)
        assert status.tolist() == [OK] * 3 + [TOTAL_REFLECTION] * 3, (s, n)
        assert lost_at.tolist() == [-1] * 3 + [0] * 3, (s, n)
        # Near the critical angle the ray grazes: cos t = sqrt(2 n cos(i) step), 3e-5 at 1e-9.
        assert np.all(s * out[:3, 2] >= 0) and out[1, 2] * s < 1e-3, (s, n)


def test_the_first_cause_stays():
    # Clipped by the stop; later beside everything, or totally reflected.
    lens = pair(stop=1.0)
    out = lens.trace(pl.RayBundle([[3.0, 0, -10], [300.0, 0, -10]], [[0, 0, 1.0], [0.9, 0, 0.1]]))
    assert status_of(out) == [(CLIPPED, 0), (CLIPPED, 0)]
    # Lost before it came here.
    lost = {"status": [TOTAL_REFLECTION, MISSED, OK], "lost_at": [7, -1, -1]}
    out = lens.trace(pl.RayBundle([[0, 0, -10.0]] * 3, [[0, 0, 1.0]] * 3, **lost))
    assert status_of(out) == [(TOTAL_REFLECTION, 7), (MISSED, -1), (OK, -1)]
    assert status_of(lens.trace_reverse(out))[:2] == status_of(out)[:2]
    # Rays far beside the axis or along a stop are lost.
    for reverse in (False, True):
        d = [[0, 0, -1.0 if reverse else 1.0]] * 3
        rays = pl.RayBundle([[1e300, 0, 0], [0, -1e300, 0], [1e155, 1e155, 0]], d)
        out = DOUBLE_GAUSS.trace_reverse(rays) if reverse else DOUBLE_GAUSS.trace(rays)
        assert np.all(out.status != OK), reverse
    out = pair().trace(pl.RayBundle([[0, 0, 0.0], [0, 0, -1.0]], [[1.0, 0, 0], [0, 1.0, 0]]))
    assert np.all(out.status != OK)


def test_threads_and_neighbours_do_not_change_a_bit():
    rng = np.random.default_rng(3)
    n = (1 << 16) + 77
    start = np.column_stack([rng.uniform(-80, 80, (n, 2)), np.full(n, -404.0)])
    aim = np.column_stack([rng.uniform(-20, 20, (n, 2)), np.full(n, -33.77)])
    rays = pl.RayBundle(start, aim - start)
    one, two = DOUBLE_GAUSS.trace(rays, threads=1), DOUBLE_GAUSS.trace(rays, threads=2)
    assert one == two
    for length in (0, 1, 255, 256, 257, 1000, (1 << 15) - 1, (1 << 15) + 1):
        part = np.arange(length)
        assert DOUBLE_GAUSS.trace(rays.selected(part)) == one.selected(part)
    # Nor does the place in a block.
    assert DOUBLE_GAUSS.trace(rays.selected(np.arange(131, 900))) == one.selected(np.arange(131, 900))


def test_rays_that_go_the_other_way_are_lost():
    for name, reverse in itertools.product(pl.lens_names(), (False, True)):
        # A sphere's far half, which such rays would meet, is not part of the surface.
        lens = pl.load_lens(name)
        height = np.linspace(0, 0.5 * lens.elements[0].semi_diameter, 50)
        origin = np.column_stack([np.zeros(50), height, np.full(50, 500.0 if reverse else -500.0)])
        rays = pl.RayBundle(origin, np.tile([0.0, 0.0, 1.0 if reverse else -1.0], (50, 1)))
        out = lens.trace_reverse(rays) if reverse else lens.trace(rays)
        assert np.all(out.status != pl.RayStatus.OK), (name, reverse)
        assert np.all(np.isnan(out.origin)) and not out.weight.any(), (name, reverse)
