"""The main lens as none, as a thin lens, as a paraxial one, and exactly."""

import dataclasses
import itertools
import math

import numpy as np
import pytest

import plenoptic as pl

EPS = np.finfo(float).eps
LENS = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=5.0))
NONE, THIN, PARAXIAL, EXACT = pl.LensModel
POINTS = pl.paraxial.cardinal_points(LENS)


def bundle(z: float, height: float, n: int = 200, spread: float = 3.0) -> pl.RayBundle:
    """Rays from the point (0.3 height, height, z) towards the lens."""
    rng = np.random.default_rng(0)
    target = np.column_stack([rng.uniform(-spread, spread, (n, 2)), np.full(n, -30.0)])
    start = np.array([0.3 * height, height, z])
    return pl.RayBundle(np.broadcast_to(start, (n, 3)), target - start)


def test_a_paraxial_lens_images_perfectly():
    for z in (-404.0, -1e6):
        lens = LENS.with_model(PARAXIAL)
        image, scale = pl.paraxial.image_position(LENS, z), pl.paraxial.magnification(LENS, z)
        height = 20.0 if z > -1e5 else 2e4
        out = lens.trace(bundle(z, height))
        assert np.all(out.status == 0), z
        # Heights of 1e-16 |z| at the lens are what directions can tell.
        assert out.at_z(image)[:, 1] == pytest.approx(scale * height, abs=64 * EPS * abs(z)), z
        assert out.at_z(image)[:, 0] == pytest.approx(0.3 * scale * height, abs=64 * EPS * abs(z)), z


def test_the_way_back_is_the_way_there():
    stops = pl.CircularStop(5.0), pl.PolygonStop(blades=3, semi_diameter=5.0)
    for model, stop in itertools.product((NONE, THIN, PARAXIAL), stops):
        lens = LENS.with_stop(stop).with_model(model)
        out = lens.trace(bundle(-404.0, 5.0, spread=9.0))
        ok = out.status == 0
        assert 10 < ok.sum() < 200, (model, stop)
        back = lens.trace_reverse(pl.RayBundle(out.at_z(130.0)[ok], -out.direction[ok]))
        assert np.all(back.status == 0), (model, stop)
        assert np.abs(back.at_z(-404.0) - [1.5, 5.0, -404.0]).max() <= 256 * EPS * 404, (model, stop)
        assert np.all(out.lost_at[~ok] == LENS.iris_index), (model, stop)


def test_without_a_lens_rays_go_straight_through_the_stops():
    lens = LENS.inserted(pl.CircularStop(9.0), z=35.0).with_model(NONE)
    rays = bundle(-404.0, 50.0, spread=12.0, n=2000)
    out = lens.trace(rays)
    ok = out.status == 0
    expected = (np.hypot(*rays.at_z(0.0)[:, :2].T) <= 5) & (np.hypot(*rays.at_z(35.0)[:, :2].T) <= 9)
    assert np.array_equal(ok, expected) and 50 < ok.sum() < 1900
    assert np.abs(out.direction - rays.direction)[ok].max() == 0


def test_a_thin_lens_has_one_principal_plane():
    lens = LENS.with_model(THIN)
    out = lens.trace(pl.RayBundle([[0, 1.0, -50.0], [0, 3.0, -50.0]], [[0, 0, 1.0], [0, 0.0, 1.0]]))
    slope = out.direction[:, 1] / out.direction[:, 2]
    assert slope == pytest.approx([-1 / POINTS.efl, -3 / POINTS.efl], rel=8 * EPS)
    assert out.origin[:, 2] == pytest.approx(POINTS.rear_principal, abs=1e-12)
    assert out.at_z(POINTS.rear_focus)[:, 1] == pytest.approx(0.0, abs=1e-13)
    # The same f-number: the opening is as large as the entrance pupil.
    edge = POINTS.entrance_pupil_semi_diameter
    rays = pl.RayBundle([[0, 0.999 * edge, -50], [0, 1.001 * edge, -50]], [[0, 0, 1.0]] * 2)
    assert lens.trace(rays).status.tolist() == [0, pl.RayStatus.CLIPPED]


def camera(model, **fields) -> pl.PlenopticCamera:
    given = {"sensor": pl.Sensor(shape=(1, 1), pixel_pitch=1e-3), "stop_to_microlenses": 134.6} | fields
    return pl.PlenopticCamera(lens=LENS.with_model(model), **given)


def test_a_pixel_on_the_axis_measures_the_exit_pupil():
    for model, z, a in (
        (NONE, 0.0, 5.0),
        (THIN, POINTS.rear_principal, POINTS.entrance_pupil_semi_diameter),
        (PARAXIAL, POINTS.exit_pupil, POINTS.exit_pupil_semi_diameter),
        (EXACT, POINTS.exit_pupil, POINTS.exit_pupil_semi_diameter),
    ):
        white = pl.render_white(camera(model), samples=8192, progress=False)
        d = 134.6 - z
        expected = math.pi * a * a / (a * a + d * d)
        # Exactly a disc but for the exact lens, whose pupil has spherical aberration: some (5 / 100)^2, found 4.4e-3.
        allowed = 5e-3 if model is EXACT else 1e-6
        off = abs(float(white.image[0, 0, 0]) - expected)
        assert off < 5 * float(white.standard_error[0, 0, 0]) + allowed * expected, model


def test_little_is_wasted_with_ideal_lenses():
    array, sensor = pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)), pl.Sensor(shape=(128, 128), pixel_pitch=0.010)
    place = {"microlenses": array, "sensor": sensor, "stop_to_microlenses": 123.3, "microlenses_to_sensor": 1.7}
    for model in (NONE, PARAXIAL):
        white = pl.render_white(camera(model, **place), samples=16, progress=False)
        # Without a lens, the iris is seen as smaller than its image through one, and cells are larger beside it.
        assert white.stats.fraction_through_lens > (0.5 if model is NONE else 0.6), model


def test_the_model_is_part_of_the_lens():
    lens = LENS.with_model(THIN)
    assert lens != LENS and lens.with_model(EXACT) == LENS
    with pytest.raises(pl.errors.InvalidValueError, match="model is 7"):
        dataclasses.replace(LENS, model=7)
    # An afocal lens has no ideal model.
    plate = pl.LensStack([pl.CircularStop(5.0), pl.Surface(math.inf, semi_diameter=9.0)])
    with pytest.raises(pl.errors.PrescriptionError, match="no focal length"):
        plate.with_model(THIN).trace(bundle(-404.0, 0.0))
    assert np.all(plate.with_model(NONE).trace(bundle(-404.0, 0.0)).status == 0)
