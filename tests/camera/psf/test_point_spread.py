"""Forward tracing: closed forms, errors, and points of all kinds."""

import dataclasses
import math
import warnings

import numpy as np
import pytest
from camera_helpers import CAMERA, bare_camera, refused, the_lens, with_array

import plenoptic as pl
from plenoptic.camera.psf import sensor_hits
from plenoptic.camera.psf.point_spread import landing_points, point_spread
from plenoptic.optics.lens.pupil.entrance_pupil import entrance, entrance_polygon


def test_light_of_a_perfect_lens_is_pi_m2_sin2():
    # All rays through the exit pupil with the slopes u / m, weighed by du dv cos^4: pi m^2 sin^2 of the image-side
    # angle. For a narrow pupil it is the projected solid angle of the entrance pupil, off it by the cosines.
    lens = the_lens(20.0, pl.LensModel.PARAXIAL)
    points = pl.paraxial.cardinal_points(lens)
    away = points.front_focus + 404.0
    m, image = points.efl / away, points.rear_focus + points.efl**2 / away
    tangent = points.exit_pupil_semi_diameter / (image - points.exit_pupil)
    a, d = points.entrance_pupil_semi_diameter, points.entrance_pupil + 404.0
    for z in (110.0, 134.624):
        light = point_spread(bare_camera(lens, z=z, pitch=0.1), (0, 0, -404), replicates=8).light
        assert abs(light / (math.pi * m * m * math.sin(math.atan(tangent)) ** 2) - 1) < 1e-4
        assert abs(light / (math.pi * a * a / (a * a + d * d)) - 1) < tangent**2


def test_light_of_a_stop_alone_is_that_of_a_disc_seen_from_beside():
    # Point and disc in parallel planes: pi / 2 (1 - (h^2 + s^2 - R^2) / sqrt((h^2 + s^2 + R^2)^2 - 4 R^2 s^2)), H. C.
    # Hottel's disc seen from an element (J. R. Howell, A Catalog of Radiation Configuration Factors, B-13).
    lens = the_lens(20.0, pl.LensModel.NONE)
    h, s, r = 50.0, 40.0, 20.0
    q = h * h + s * s
    expected = math.pi / 2 * (1 - (q - r * r) / math.sqrt((q + r * r) ** 2 - 4 * r * r * s * s))
    spread = point_spread(bare_camera(lens, z=40.0, shape=(100, 100), pitch=5.0), (24, -32, -50))
    assert abs(spread.light - expected) < 5 * spread.light_error
    assert spread.light_error < 1e-3 * expected
    assert spread.fraction_by_fate["beside_sensor"] == 0


def test_a_perfect_lens_in_focus_gathers_all_light_in_the_paraxial_image_point():
    lens = the_lens(20.0, pl.LensModel.PARAXIAL)
    points = pl.paraxial.cardinal_points(lens)
    camera = bare_camera(lens).focused_at(z=-404.0)
    m = points.efl / (points.front_focus + 404.0)
    for height in (0.0, 5.0):
        point, image = (height, -0.3 * height, -404), [-m * height, 0.3 * m * height]
        trace_task, spread = landing_points(camera, point), point_spread(camera, point)
        # eps times lengths of some 500 mm, times a few.
        np.testing.assert_allclose(trace_task.position, np.tile(image, (len(trace_task.position), 1)), atol=1e-11)
        np.testing.assert_allclose(spread.centroid, image, atol=1e-11)
        assert trace_task.microlens is None
        # The image of a point that lies between two or four pixels may be split by rounding.
        assert spread.image.size <= 4


def test_standard_errors_are_honest():
    # 12 seeds: the spread of 'light' against what each reports, F-distributed with 11 and 372 degrees of freedom.
    spreads = [point_spread(CAMERA, (5, 3, -380), rays=1 << 12, seed=s) for s in range(12)]
    light = np.array([s.light for s in spreads])
    reported = np.mean([s.light_error**2 for s in spreads])
    assert 0.2 < light.var(ddof=1) / reported < 3.0
    # Of 32 replicates, each variance is off by sqrt(2 / 31) = 0.25; of 8, by 0.53.
    assert np.std([s.light_error**2 for s in spreads], ddof=1) / reported < 0.42
    pixels = np.array([s.whole() for s in spreads])
    errors = np.zeros_like(pixels)
    for error, s in zip(errors, spreads, strict=True):
        error[s.regions[0]] = s.standard_error
    is_bright = pixels.mean(axis=0) > 0.2 * pixels.mean(axis=0).max()
    ratio = pixels.var(axis=0, ddof=1)[is_bright].mean() / (errors**2).mean(axis=0)[is_bright].mean()
    assert 0.7 < ratio < 1.4


def test_threads_and_other_points_do_not_change_a_bit(monkeypatch):
    camera, points = CAMERA, [(5, 3, -380), (0, 0, -404), (-2, 1, -500)]
    single, one = (point_spread(camera, points_, rays=5000, threads=1) for points_ in (points[0], points))
    assert one == point_spread(camera, points, rays=5000, threads=3)
    np.testing.assert_array_equal(single.whole(), one.whole()[0])
    assert point_spread(camera, points[0], rays=5000, seed=1) != single
    # More chunks sum in another order only.
    monkeypatch.setattr(sensor_hits, "CHUNK", 100)
    np.testing.assert_allclose(point_spread(camera, points[0], rays=5000).whole(), single.whole(), rtol=1e-12)


def test_landing_points_are_the_rays_of_the_spread():
    camera, points = CAMERA, [(5, 3, -380), (0, 0, -404)]
    spread = point_spread(camera, points, rays=4096, replicates=1)
    trace_task = landing_points(camera, points, rays=4096)
    assert trace_task == landing_points(camera, points, rays=4096, threads=1)
    for k in range(2):
        mine = trace_task.source == k
        assert trace_task.weight[mine].sum() == pytest.approx(spread.light[k], rel=1e-12)
        mean = trace_task.weight[mine] @ trace_task.position[mine] / trace_task.weight[mine].sum()
        np.testing.assert_allclose(spread.centroid[k], mean, rtol=1e-10)
    assert spread.standard_error is None and spread.light_error is None and spread.centroid_error is None


def test_spread_keeps_the_lit_pixels_and_the_fates_of_all_rays():
    spread = point_spread(CAMERA, [(5, 3, -380), (8.5, 0, -404), (0, 0, -404)], rays=1 << 14)
    assert spread.image.shape == spread.standard_error.shape and len(spread.image) == 3
    np.testing.assert_allclose(spread.fractions.sum(axis=1), 1.0, rtol=1e-12)
    np.testing.assert_allclose(spread.image.sum(axis=(1, 2)) * 1e-4, spread.light, rtol=1e-12)
    # The light of the second point falls half beside the sensor.
    assert 0.1 < spread.fraction_by_fate["beside_sensor"][1] < 0.9 and spread.fraction_by_fate["beside_sensor"][2] == 0
    # Rays are aimed closely: the iris alone stops the few that pass it by.
    assert spread.fates[2:] == (("clipped", 5),) and spread.fraction_by_fate["landed"][2] > 0.85
    one = spread.of(1)
    np.testing.assert_array_equal(one.whole(), spread.whole()[1])
    assert one.of(0) is one and spread.of(2).light == spread.light[2]
    assert repr(one).startswith("<CameraSpread of 1 point: ") and "3 points" in repr(spread)
    with refused("3 points"):
        spread.of(3)


def test_a_point_out_of_sight_leaves_nothing():
    spread = point_spread(CAMERA, [(1e4, 0, -50), (0, 0, -404)], rays=1024)
    dark = spread.of(0)
    assert dark.light == 0 and dark.light_error == 0 and not dark.image.any() and np.isnan(dark.centroid).all()
    assert dark.fraction_by_fate["landed"] == 0 and spread.light[1] > 0
    assert not point_spread(CAMERA, (1e4, 0, -50), rays=8).whole().any()
    assert len(landing_points(CAMERA, (1e4, 0, -50)).position) == 0


def test_near_far_and_tiny():
    lens = the_lens(0.01)
    # A stop of a hundredth of a millimetre, 1000 km away: E = pi a^2 / d^2.
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        far = point_spread(bare_camera(lens, z=102.52), (0, 0, -1e9), rays=1 << 14)
        near = point_spread(bare_camera(the_lens(5.0), shape=(16, 16), pitch=10.0), (0, 0, -33.771), rays=1 << 14)
        beyond = point_spread(CAMERA, [(0, 0, -1e300), (1e300, 0, -100)], rays=64)
    a = pl.paraxial.cardinal_points(lens).entrance_pupil_semi_diameter
    assert far.light == pytest.approx(math.pi * a * a / 1e18, rel=1e-4)
    assert 0 < near.light < math.pi
    assert not beyond.light.any() and not np.isnan(beyond.image).any()
    np.testing.assert_allclose(near.fractions.sum(), 1.0, rtol=1e-12)


def test_polygons_around_the_light_hold_all_of_it():
    rng = np.random.default_rng(4)
    near_axis = [(0, 0, -404.0), (60, 90, -404), (20, 10, -60)]
    lenses = [the_lens(17.1), the_lens(1.0), the_lens(5.0).moved(0, shift=(4, 0, 0), tilt=(0.1, 0.05, 0))]
    # A pupil 4 mm wide at the rim of a front lens of 900 mm, beside where the paraxial one is.
    cases = [(lens, near_axis) for lens in lenses] + [(pl.load_lens("fisheye-100mm-f8"), [(300, 0, -606.679)])]
    for lens, seen_from in cases:
        where = entrance(lens, 587.6)
        for point in np.array(seen_from):
            corners = entrance_polygon(where, point)
            assert corners is not None
            low, high = corners.min(axis=0), corners.max(axis=0)
            close = rng.uniform(1.5 * low - 0.5 * high, 1.5 * high - 0.5 * low, (5000, 2))
            everywhere = rng.uniform(-35, 35, (20000, 2))
            aims = np.column_stack([np.concatenate([close, everywhere]), np.full(25000, where.z)])
            passing = aims[lens.trace(pl.RayBundle(np.tile(point, (25000, 1)), aims - point)).status == 0, :2]
            assert len(passing) > 100
            edges = np.roll(corners, -1, axis=0) - corners
            offset = passing[:, None] - corners
            assert (edges[:, 0] * offset[..., 1] - edges[:, 1] * offset[..., 0] >= 0).all()


def test_impossible_arguments_are_refused():
    pinholes = with_array(CAMERA, model=pl.optics.MicrolensModel.PINHOLE)
    small, behind = dataclasses.replace(CAMERA, sensor=pl.Sensor((8, 8), 0.01)), CAMERA.posed((0, 0, 900), (0, 0, 0))
    assert point_spread(behind, (0, 0, 500), rays=64).light > 0
    for changed, message in (
        ({"points": (0, 0, -30)}, "in front of it"),
        ({"points": (0, 0, 500)}, "point 0 lies at z = 500 mm"),
        ({"camera": behind, "points": (0, 0, 1000)}, "in front"),
        ({"points": [(0, 0, -404), (0, 0, -33.76)]}, "point 1"),
        ({"points": (0, float("nan"), -404)}, "finite"),
        ({"points": (0, -404)}, "shape"),
        ({"points": np.zeros((0, 3))}, "at least one point"),
        ({"points": [(0, 0, -404), (0, -404)]}, "points"),
        ({"rays": 0}, "rays"),
        ({"replicates": 0}, "replicates"),
        ({"seed": 1 << 64}, "at most 18446744073709551615"),
        ({"threads": 0}, "threads"),
        ({"camera": "camera"}, "PlenopticCamera"),
        ({"camera": pinholes}, "PINHOLE"),
    ):
        with refused(message):
            point_spread(**{"camera": small, "points": (0, 0, -404), **changed})


def test_figure_shows_the_pixels_where_the_sensor_has_them():
    plt = pytest.importorskip("matplotlib.pyplot")
    from plenoptic.plots.camera import plot_camera_spread

    spread = point_spread(CAMERA, [(3, 1, -404), (-4, 2, -404)], rays=1 << 13)
    ax = plot_camera_spread(spread)
    image = np.asarray(ax.images[0].get_array())
    left, right, bottom, top = ax.images[0].get_extent()
    assert image.sum() == pytest.approx(spread.image.sum(), rel=1e-12)
    whole = spread.whole().sum(axis=0)
    cut = whole[round(top + 0.5) : round(bottom + 0.5), round(left + 0.5) : round(right + 0.5)]
    np.testing.assert_allclose(image, cut, rtol=1e-12)
    # The cross lies at the mean of the pixels, to within a pixel's half.
    rows, columns = np.indices(whole.shape)
    mine = spread.of(0).whole() / spread.of(0).whole().sum()
    place = [(mine * rows).sum(), (mine * columns).sum()]
    np.testing.assert_allclose(ax.lines[0].get_xydata()[0][::-1], place, atol=0.5)
    dark = plot_camera_spread(point_spread(CAMERA, (1e4, 0, -50), rays=8))
    assert "no light" in [text.get_text() for text in dark.texts]
    plt.close("all")
    with refused("CameraSpread"):
        plot_camera_spread("spread")
