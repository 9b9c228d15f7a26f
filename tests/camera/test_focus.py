import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import plenoptic as pl
from plenoptic.optics.lens.analysis.focus import best_focus
from plenoptic.optics.lens.analysis.spots import spot_diagram
from plenoptic.optics.lens.models import FocusCriterion

LENS = pl.load_lens("double-gauss-100mm-f2")
POINTS = pl.paraxial.cardinal_points(LENS)
RMS = FocusCriterion.RMS_SPOT
EPS = 2.0**-52
IMAGE = pl.paraxial.image_position(LENS, -404.0)


def camera_with(b, lens=LENS):
    array = pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)) if b > 0 else None
    return pl.PlenopticCamera(lens, pl.Sensor(shape=(512, 512), pixel_pitch=0.01), 123.3, array, b)


def test_the_image_lies_where_microlenses_look():
    # Image at 134.624, a = b f / (f - b) = 11.333 before it; the reference's 123.3 holds the plane within 0.1 mm.
    focused = camera_with(1.7).focused_at(-404.0)
    assert focused.stop_to_microlenses == pytest.approx(IMAGE - 1.7 * 2.0 / 0.3, rel=1e-14)
    assert focused.stop_to_microlenses == pytest.approx(123.29, abs=0.005)
    assert pl.paraxial.object_position(LENS, 123.3 + 1.7 * 2.0 / 0.3) == pytest.approx(-404.0, abs=0.1)
    assert focused == dataclasses.replace(camera_with(1.7), stop_to_microlenses=focused.stop_to_microlenses)
    # In mode 1.0 on the array.
    for b in (2.0, 2.0 * (1 + 1e-12), 2.0 * (1 - 1e-12)):
        assert camera_with(b).focused_at(-404.0).stop_to_microlenses == IMAGE
    # A Keplerian array, b = 2.4, stands behind it: 1/a = 1/2 - 1/2.4.
    assert camera_with(2.4).focused_at(-404.0).stop_to_microlenses == pytest.approx(IMAGE + 12.0, rel=1e-13)
    # A conventional camera has it on the sensor; that of what is infinitely far, on the rear focus.
    assert camera_with(0.0).focused_at(-404.0).z_sensor == IMAGE
    assert camera_with(0.0).focused_at(-math.inf).z_sensor == pytest.approx(POINTS.rear_focus, rel=1e-14)


@settings(max_examples=40)
@given(z=st.floats(-1e5, -200.0), b=st.floats(0.5, 5.0))
def test_sharp_means_conjugate_through_lens_and_microlens(z, b):
    try:
        focused = camera_with(b).focused_at(z)
    except pl.errors.InvalidValueError:
        # Too near the lens: the image minus a lies inside it.
        a = b * 2.0 / (2.0 - b)
        assert pl.paraxial.image_position(LENS, z) - a <= 31.0
        return
    if math.isclose(b, 2.0, rel_tol=1e-6):
        return
    # Back from the sensor: the microlens's image of the sensor, then the lens's image of that.
    a = 1 / (1 / b - 1 / 2.0)
    # 1/b - 1/2 is good to eps, so a is to eps a^2; behind the lens that grows by the longitudinal magnification.
    error = 8 * EPS * (a * a + abs(a) + focused.stop_to_microlenses) * (1 + abs(z) / 100) ** 2
    assert pl.paraxial.object_position(LENS, focused.stop_to_microlenses + a) == pytest.approx(z, abs=error)


def fan(lens, reach, x=0.0):
    slopes = np.linspace(-reach, reach, 5)
    out = lens.trace(pl.RayBundle([[x, 0, -404.0]] * 5, np.column_stack([slopes, 0 * slopes, np.ones(5)])))
    assert np.all(out.status == 0)
    return out


def test_rays_of_a_sharp_plane_meet_on_the_sensor():
    # Law behind all of it, by exact tracing near the axis of a lens with a small stop: rays of one point through one
    # microlens, seen from the array, come from the distance a.
    camera = camera_with(1.7, LENS.with_stop(pl.CircularStop(0.1))).focused_at(-404.0)
    out = fan(camera.lens, 1e-4)
    on_array = out.at_z(camera.stop_to_microlenses)[:, 0]
    bent = out.direction[:, 0] / out.direction[:, 2] - on_array / 2.0
    # Heights on the array are 3e-4 mm; aberrations of third order bring 1e-3 (1e-4 x 404 mm / 25 mm)^2 of them.
    assert np.abs(on_array).max() > 1e-3 * 0.1
    assert np.abs(on_array + 1.7 * bent).max() < 1e-5 * np.abs(on_array).max()


def test_the_best_spot_moves_the_back_as_far_as_the_image():
    for b, criterion in ((1.7, RMS), (2.0, RMS), (2.4, FocusCriterion.GEOMETRIC_SPOT)):
        moved = camera_with(b).focused_at(-404.0, criterion=criterion).stop_to_microlenses
        image = best_focus(LENS, z_object=-404.0, criterion=criterion)
        assert abs(image - IMAGE) > 1e-3
        # Sums of numbers below 150.
        step = moved - camera_with(b).focused_at(-404.0).stop_to_microlenses
        assert step == pytest.approx(image - IMAGE, abs=4 * EPS * 150), (b, criterion)


def test_the_best_spot_makes_the_smallest_blur_on_the_sensor():
    radius = {}
    for criterion in FocusCriterion:
        z = camera_with(0.0).focused_at(-404.0, criterion=criterion).z_sensor
        spot = spot_diagram(LENS, z_object=-404.0, z_image=z, rays=1 << 14)
        radius[criterion] = (spot.rms_radius, spot.geometric_radius)
    assert min(radius, key=lambda c: radius[c][0]) is FocusCriterion.RMS_SPOT
    assert min(radius, key=lambda c: radius[c][1]) is FocusCriterion.GEOMETRIC_SPOT


def test_ideal_lenses_focus_by_their_cardinal_points_whatever_the_criterion():
    thin, paraxial, nothing = (
        camera_with(0.0, LENS.with_model(model))
        for model in (pl.LensModel.THIN, pl.LensModel.PARAXIAL, pl.LensModel.NONE)
    )
    # 1 / image - 1 / object = 1 / f, both measured from the one plane of the model.
    image = POINTS.rear_principal + 1.0 / (1.0 / POINTS.efl + 1.0 / (-404.0 - POINTS.rear_principal))
    for criterion in FocusCriterion:
        given = {"criterion": criterion}
        assert thin.focused_at(-404.0, **given).z_sensor == pytest.approx(image, abs=1e-11)
        assert thin.focused_at(-math.inf, **given).z_sensor == pytest.approx(POINTS.rear_focus, abs=1e-11)
        assert paraxial.focused_at(-404.0, **given).z_sensor == pytest.approx(IMAGE, abs=1e-11)
        with pytest.raises(pl.errors.InvalidValueError, match=r"LensModel\.NONE, which bends no ray, so no plane is"):
            nothing.focused_at(-404.0, **given)
    for camera in (thin.focused_at(-404.0), paraxial.focused_at(-404.0)):
        assert np.ptp(fan(camera.lens, 0.05, x=3.0).at_z(camera.z_sensor)[:, 0]) < 1e-12


def test_what_cannot_be_focused_on_is_refused():
    thin = camera_with(0.0, LENS.with_model(pl.LensModel.THIN))
    thin_focus = POINTS.rear_principal - POINTS.efl
    assert thin_focus < -95.0 < POINTS.front_focus < -63.0
    not_in_front, no_image = (
        "z is .* mm; the plane must lie in front of the camera",
        "no real image behind the lens; .* ",
    )
    for camera, z, message in (
        *((camera_with(1.7), z, not_in_front) for z in (0.0, 10.0, math.nan, math.inf)),
        *((camera_with(1.7), z, "z is .*; it must be a number") for z in ("x", None, [1.0, 2.0])),
        *((camera_with(1.7), z, f"{no_image}z = {POINTS.front_focus:g} mm") for z in (-1.0, -50.0, -63.0)),
        (thin, -95.0, f"{no_image}z = {thin_focus:g} mm"),
        # b = 1.96: a = 98 mm; infinity would want the array at 102.5 - 98 = 4.5 mm, inside the lens.
        (camera_with(1.96), -math.inf, "must be above 30.31"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            camera.focused_at(z)
    with pytest.raises(pl.errors.InvalidValueError, match="criterion is 'best'; it must be FocusCriterion.PARAXIAL or"):
        camera_with(1.7).focused_at(-404.0, criterion="best")
