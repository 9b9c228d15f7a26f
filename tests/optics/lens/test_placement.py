"""Decentred and tilted elements."""

import dataclasses
import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import plenoptic as pl
from plenoptic.optics.lens.placement import rotation_about_axes
from plenoptic.optics.lens.pupil.exit_pupil import pupil_bounds

EPS = np.finfo(float).eps
LENS = pl.load_lens("double-gauss-100mm-f2")
SMALL = st.floats(-0.05, 0.05)


def rays_into(lens: pl.LensStack, n: int = 500, seed: int = 0) -> pl.RayBundle:
    rng = np.random.default_rng(seed)
    start = np.column_stack([rng.uniform(-30, 30, (n, 2)), np.full(n, -400.0)])
    target = np.column_stack([rng.uniform(-12, 12, (n, 2)), np.full(n, lens.vertices[0])])
    return pl.RayBundle(start, target - start)


@settings(max_examples=25)
@given(
    tilt=st.tuples(SMALL, SMALL, st.floats(-3, 3)),
    shift=st.tuples(SMALL, SMALL, SMALL),
    pivot=st.one_of(st.none(), st.floats(-200, 200)),
    reverse=st.booleans(),
)
def test_moving_everything_is_moving_the_rays(tilt, shift, pivot, reverse):
    moved, turn = LENS.moved(slice(None), shift=shift, tilt=tilt, pivot=pivot), rotation_about_axes(tilt)
    centre = np.array([0, 0, LENS.vertices[0] if pivot is None else pivot])
    rays, way = rays_into(LENS), "trace"
    if reverse:
        out = LENS.trace(rays)
        rays, way = pl.RayBundle(out.at_z(130.0), -out.direction, status=out.status), "trace_reverse"
    out = getattr(LENS, way)(rays)
    origin = (rays.origin - centre) @ turn.T + centre + np.asarray(shift)
    found = getattr(moved, way)(pl.RayBundle(origin, rays.direction @ turn.T, status=rays.status))
    # A ray within rounding of a rim may fall to either side.
    assert np.count_nonzero(out.status != found.status) <= 2
    clear = (out.status == 0) & (found.status == 0)
    assert clear.sum() > 100
    expected = (out.origin[clear] - centre) @ turn.T + centre + np.asarray(shift)
    # Rounding of 400 mm in each of the two frames, magnified by some ten surfaces.
    assert np.abs(found.origin[clear] - expected).max() <= 1e4 * EPS * 400
    assert np.abs(found.direction[clear] - out.direction[clear] @ turn.T).max() <= 1e4 * EPS


def plane(gap: float, n: float = 1.0) -> pl.Surface:
    return pl.Surface(math.inf, gap, pl.ConstantMedium(n), semi_diameter=20.0)


def test_tilted_planes_deviate_and_shift_as_plates_and_wedges():
    n, t, a = 1.5168, 4.0, 0.4
    plate = pl.LensStack([plane(t, n), plane(5.0), pl.CircularStop(20.0)]).moved([0, 1], tilt=(a, 0.0, 0.0))
    out = plate.trace(pl.RayBundle([[0, 0, -50.0]], [[0, 0, 1.0]]))
    # t sin(a) (1 - cos a / sqrt(n^2 - sin^2 a)), exactly.
    shift = t * math.sin(a) * (1 - math.cos(a) / math.sqrt(n * n - math.sin(a) ** 2))
    assert out.direction[0] == pytest.approx([0, 0, 1], abs=4 * EPS)
    # A positive tilt about x turns y towards z, so that the upper edge lies further on: the normal turns
    # towards -y, and the ray inside with it.
    assert out.origin[0, 1] == pytest.approx(-shift, abs=1e-14)
    back = plate.trace_reverse(pl.RayBundle([[0, -shift, 50.0]], [[0, 0, -1.0]]))
    assert back.origin[0, 1] == pytest.approx(0.0, abs=1.0) and back.at_z(-50.0)[0, 1] == pytest.approx(0, abs=1e-14)
    # A plane tilted by a behind a plane: sin(a + d) = n sin(a).
    n, a = 1.5, 0.2
    wedge = pl.LensStack([pl.CircularStop(5.0, 1.0), plane(3.0, n), plane(0.0)]).moved(2, tilt=(0.0, a, 0.0))
    out = wedge.trace(pl.RayBundle([[0, 0, -5.0]], [[0, 0, 1.0]]))
    # Tilt about y turns z towards x: the normal is (sin a, 0, cos a), and light leaves farther from it.
    deviation = math.asin(n * math.sin(a)) - a
    assert math.atan2(out.direction[0, 0], out.direction[0, 2]) == pytest.approx(-deviation, abs=8 * EPS)
    # A thin lens shifted across the axis by s images the axial point at infinity at s.
    thin = [pl.Surface(100.0, 0.0, pl.ConstantMedium(1.5), semi_diameter=10.0), pl.Surface(-100.0, semi_diameter=10.0)]
    moved = pl.LensStack([pl.CircularStop(1.0), *thin]).moved(slice(1, 3), shift=(0.3, -0.2, 0.0))
    ray = moved.trace(pl.RayBundle([[0, 0, -10.0]], [[0, 0, 1.0]]))
    assert ray.at_z(100.0)[0, :2] == pytest.approx([0.3, -0.2], abs=2e-5)  # third order: s (s / R)^2


def test_rays_behind_a_tilted_plane_miss_it():
    for form in ({}, {"conic": 2.0}):
        first = dataclasses.replace(plane(5.0, 1.5), **form)
        tilted = pl.LensStack([first, plane(5.0), pl.CircularStop(20.0)]).moved(0, tilt=(0.0, math.radians(70.0), 0.0))
        # The normal is 70 degrees from the axis, and a ray 20.1 degrees to the other side sees the plane's back.
        slopes = np.tan(np.radians([-60.0, -30.0, -20.1, -19.9, 0.0, 60.0]))
        rays = pl.RayBundle(np.tile([0.0, 0.0, -1.0], (6, 1)), np.stack([slopes, 0 * slopes, 1 + 0 * slopes], axis=1))
        out = tilted.trace(rays)
        missed = (out.status == pl.RayStatus.MISSED) & (out.lost_at == 0)
        assert missed.tolist() == [True] * 3 + [False] * 3 and pl.RayStatus.NOT_FINITE not in out.status, form


def test_moves_add_up_and_go_back():
    there = LENS.moved([2, 3, 4], shift=(0.1, 0.2, 0.05), tilt=(0.01, -0.02, 0.3), pivot=-20.0)
    assert [e.placement is not None for e in there.elements] == [i in (2, 3, 4) for i in range(11)]
    placement = there.elements[3].placement
    assert there.moved(3, tilt=(0.0, 0.0, 1.0)).elements[3].placement != placement
    assert np.abs(np.asarray(placement.rotation) - rotation_about_axes((0.01, -0.02, 0.3))).max() <= 2 * EPS
    # The inverse motion leaves nothing.
    home = LENS.moved(5, shift=(1.0, 0, 0)).moved(5, shift=(-1.0, 0, 0))
    assert home == LENS and home.elements[5].placement is None
    # Another stop keeps the place of the iris.
    moved = LENS.moved(LENS.iris_index, shift=(0.5, 0.0, 0.0))
    other = moved.with_stop(pl.PolygonStop(blades=5, semi_diameter=3.0))
    assert other.stop.placement.shift.tolist() == [0.5, 0.0, 0.0]
    assert pickle.loads(pickle.dumps(other)) == other and hash(other) != hash(LENS)


def test_impossible_moves_are_refused():
    for call, message in (
        ({"which": 40}, "which is 40; it must select elements, from 0 to 10"),
        ({"which": []}, "must select elements"),
        ({"which": 1, "tilt": (0.1, 0.2)}, "three angles"),
        ({"which": 1, "tilt": (2.0, 0.0, 0.0)}, "give radians"),
        ({"which": 1, "shift": (0.1, math.nan, 0)}, "not finite"),
        ({"which": 1, "pivot": math.inf}, "pivot is inf"),
    ):
        with pytest.raises(pl.PlenopticError, match=message):
            LENS.moved(**call)
    for last, message in ((1.001, "orthonormal"), (-1.0, "determinant 1")):
        with pytest.raises(pl.errors.PrescriptionError, match=message):
            pl.optics.Placement(rotation=np.diag([1.0, 1.0, last]))


SLOW = [pytest.param(which, marks=pytest.mark.slow) for which in (slice(0, 5), 3, slice(6, 11))]


@pytest.mark.parametrize("which", [5, *SLOW])
def test_bounds_of_a_lens_out_of_place_hold_all_light(which):
    lens = LENS.with_stop(pl.CircularStop(5.0)).moved(which, shift=(0.6, -0.3, 0.0), tilt=(0.02, 0.03, 0.0))
    z_plane, cell, radius = 123.3, 0.125, 12.0
    bounds = pupil_bounds(lens, z_plane=z_plane, largest_radius=radius, cell_radius=cell, wavelength=587.6)
    rng, n = np.random.default_rng(5), 200_000
    rho, turn = radius * rng.uniform(size=n), rng.uniform(0, 2 * math.pi, n)
    away, angle = cell * np.sqrt(rng.uniform(size=n)), rng.uniform(0, 2 * math.pi, n)
    start = rho * [np.cos(turn), np.sin(turn)] + away * [np.cos(angle), np.sin(angle)]
    aim, z = rng.uniform(-21, 21, (n, 2)), float(lens.vertices[-1])
    start, end = (np.column_stack([place, np.full(n, at)]) for place, at in ((start.T, z_plane), (aim, z)))
    passed = lens.trace_reverse(pl.RayBundle(start, end - start)).status == 0
    assert passed.sum() > 5000
    x = np.cos(turn) * aim[:, 0] + np.sin(turn) * aim[:, 1]
    y = np.cos(turn) * aim[:, 1] - np.sin(turn) * aim[:, 0]
    interval = np.minimum((rho / bounds.step).astype(int), len(bounds.support) - 1)
    over = (np.stack([x, y], axis=1) @ bounds.normals.T - bounds.support[interval]).max(axis=1)
    assert np.all(over[passed] <= 0)


@pytest.mark.slow
def test_a_small_iris_far_from_the_axis_is_not_overlooked():
    # A pixel without microlenses sees the exit pupil; where the iris moves by s = 3.2 mm its image moves by 1.552 s.
    # Light changes to second order: by cos^4, -2 (1.552 s / 128)^2 = -0.3 %, and by what spherical aberration does to
    # the pupil's magnification, some (s / 25)^2 = 1.6 %.
    lens = LENS.with_stop(pl.CircularStop(0.05))
    array = pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,))
    # Behind microlenses few of the samples pass so small an opening: some 10 % of noise.
    for microlenses, gap, samples, allowed in ((None, 0.0, 128, 0.02), (array, 1.7, 2048, 0.4)):
        place = {"stop_to_microlenses": 123.3, "microlenses": microlenses, "microlenses_to_sensor": gap}
        centred, moved = (
            pl.PlenopticCamera(lens=one, sensor=pl.Sensor(shape=(32, 32), pixel_pitch=0.1), **place)
            for one in (lens, lens.moved(lens.iris_index, shift=(3.0, -1.0, 0)))
        )
        a, b = (pl.render_white(c, samples=samples, progress=False).image.mean() for c in (centred, moved))
        assert b == pytest.approx(a, rel=allowed), microlenses


@pytest.mark.slow
def test_light_in_thin_crescents_is_found():
    # A strong lens whose pupil has a second part: grazing rays beside those that are totally reflected.
    sides = pl.Surface(10.0, 14.0, pl.ConstantMedium(1.5), semi_diameter=8.0), pl.Surface(-8.0, semi_diameter=7.84)
    lens = pl.LensStack([pl.CircularStop(2.0, 2.0), *sides])
    z = float(lens.vertices[-1]) + 4.0
    sensor = pl.Sensor(shape=(1, 57), pixel_pitch=0.1)
    camera = pl.PlenopticCamera(lens=lens, sensor=sensor, stop_to_microlenses=z)
    white = pl.render_white(camera, samples=1 << 13, region=np.s_[0:1, 0:1], progress=False)
    x = float(sensor.centre_of(0, 0)[0])
    rng, n = np.random.default_rng(0), 1 << 19
    l, m = rng.uniform(-1, 1, (2, n))
    real = l * l + m * m < 1
    cosines = np.column_stack([l, m, -np.sqrt(np.maximum(1 - l * l - m * m, 0))])[real]
    passed = lens.trace_reverse(pl.RayBundle(np.broadcast_to([x, 0, z], cosines.shape), cosines)).status == 0
    brute, error = 4 * passed.sum() / n, 4 * math.sqrt(passed.sum()) / n
    allowed = 5 * math.hypot(error, float(white.standard_error[0, 0, 0]))
    # The pixel has an extent, over which light changes by some 0.5 %.
    assert abs(float(white.image[0, 0, 0]) - brute) < allowed + 0.01 * brute
