import dataclasses
import math

import pytest
from camera_helpers import GAUSS as LENS
from camera_helpers import bare_camera, camera_with, refused
from hypothesis import given, settings
from hypothesis import strategies as st

import plenoptic as pl
from plenoptic.optics.lens.analysis.best_focus import best_focus
from plenoptic.optics.lens.models import FocusCriterion

POINTS = pl.paraxial.cardinal_points(LENS)
RMS = FocusCriterion.RMS_SPOT
EPS = 2.0**-52
IMAGE = pl.paraxial.image_position(LENS, -404.0)


def camera(b):
    return camera_with(b, lens=LENS)


def test_the_image_lies_where_microlenses_look():
    # a = b f / (f - b) = 11.333 before the image.
    focused = camera(1.7).focused_at(-404.0)
    assert focused.stop_to_microlenses == pytest.approx(IMAGE - 1.7 * 2.0 / 0.3, rel=1e-14)
    assert focused == dataclasses.replace(camera(1.7), stop_to_microlenses=focused.stop_to_microlenses)
    # In mode 1.0 on the array.
    for b in (2.0, 2.0 * (1 + 1e-12), 2.0 * (1 - 1e-12)):
        assert camera(b).focused_at(-404.0).stop_to_microlenses == IMAGE
    # A Keplerian array, b = 2.4, stands behind it: 1/a = 1/2 - 1/2.4.
    assert camera(2.4).focused_at(-404.0).stop_to_microlenses == pytest.approx(IMAGE + 12.0, rel=1e-13)
    # A conventional camera has it on the sensor; that of what is infinitely far, on the rear focus.
    assert bare_camera(LENS).focused_at(-404.0).z_sensor == IMAGE
    assert bare_camera(LENS).focused_at(-math.inf).z_sensor == pytest.approx(POINTS.rear_focus, rel=1e-14)


@settings(max_examples=40)
@given(z=st.floats(-1e5, -200.0), b=st.floats(0.5, 5.0))
def test_sharp_means_conjugate_through_lens_and_microlens(z, b):
    try:
        focused = camera(b).focused_at(z)
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


def test_the_best_spot_moves_the_back_as_far_as_the_image():
    for b, criterion in ((1.7, RMS), (2.0, RMS), (2.4, FocusCriterion.GEOMETRIC_SPOT)):
        moved = camera(b).focused_at(-404.0, criterion=criterion).stop_to_microlenses
        image = best_focus(LENS, z_object=-404.0, criterion=criterion)
        assert abs(image - IMAGE) > 1e-3
        # Sums of numbers below 150.
        step = moved - camera(b).focused_at(-404.0).stop_to_microlenses
        assert step == pytest.approx(image - IMAGE, abs=4 * EPS * 150), (b, criterion)


def test_what_cannot_be_focused_on_is_refused():
    thin = bare_camera(LENS.with_model(pl.LensModel.THIN))
    thin_focus = POINTS.rear_principal - POINTS.efl
    assert thin_focus < -95.0 < POINTS.front_focus < -63.0
    not_in_front = "z is .* mm; the plane must lie in front of the camera"
    no_image = "no real image behind the lens; .* "
    for each, z, message in (
        *((camera(1.7), z, not_in_front) for z in (0.0, 10.0, math.nan, math.inf)),
        *((camera(1.7), z, "z is .*; it must be a number") for z in ("x", None, [1.0, 2.0])),
        *((camera(1.7), z, f"{no_image}z = {POINTS.front_focus:g} mm") for z in (-1.0, -50.0, -63.0)),
        (thin, -95.0, f"{no_image}z = {thin_focus:g} mm"),
        # b = 1.96: a = 98 mm; infinity would want the array at 102.5 - 98 = 4.5 mm, inside the lens.
        (camera(1.96), -math.inf, "must be above 30.31"),
    ):
        with refused(message):
            each.focused_at(z)
    with refused("criterion is 'best'; it must be FocusCriterion.PARAXIAL or"):
        camera(1.7).focused_at(-404.0, criterion="best")
