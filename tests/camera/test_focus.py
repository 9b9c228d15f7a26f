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
SENSOR = pl.Sensor(shape=(512, 512), pixel_pitch=0.01)
ARRAY = pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,))
EPS = 2.0**-52
IMAGE = pl.paraxial.image_position(LENS, -404.0)


def camera_with(b: float, stop_to_microlenses: float = 123.3, **changes) -> pl.PlenopticCamera:
    fields = {"lens": LENS, "sensor": SENSOR, "microlenses": ARRAY} | changes
    return pl.PlenopticCamera(stop_to_microlenses=stop_to_microlenses, microlenses_to_sensor=b, **fields)


def test_the_reference_in_mode_2() -> None:
    # Image at 134.624, a = b f / (f - b) = 11.333 before it; the reference's 123.3 holds the plane within 0.1 mm.
    focused = camera_with(1.7).focused_at(-404.0)
    assert focused.stop_to_microlenses == pytest.approx(IMAGE - 1.7 * 2.0 / 0.3, rel=1e-14)
    assert focused.stop_to_microlenses == pytest.approx(123.29, abs=0.005)
    assert pl.paraxial.object_position(LENS, 123.3 + 1.7 * 2.0 / 0.3) == pytest.approx(-404.0, abs=0.1)
    assert focused == dataclasses.replace(camera_with(1.7), stop_to_microlenses=focused.stop_to_microlenses)


@pytest.mark.parametrize("b", [2.0, 2.0 * (1 + 1e-12), 2.0 * (1 - 1e-12)])
def test_mode_1_puts_the_image_on_the_array(b: float) -> None:
    assert camera_with(b).focused_at(-404.0).stop_to_microlenses == IMAGE


def test_a_keplerian_array_stands_behind_the_image() -> None:
    # b = 2.4: 1/a = 1/2 - 1/2.4, a = 12 in front of the array.
    focused = camera_with(2.4).focused_at(-404.0)
    assert focused.stop_to_microlenses == pytest.approx(IMAGE + 12.0, rel=1e-13)


def test_a_conventional_camera_puts_the_image_on_the_sensor() -> None:
    camera = camera_with(0.0, microlenses=None)
    assert camera.focused_at(-404.0).z_sensor == IMAGE
    # At infinity, on the rear focus.
    rear_focus = pl.paraxial.cardinal_points(LENS).rear_focus
    assert camera.focused_at(-math.inf).z_sensor == pytest.approx(rear_focus, rel=1e-14)


@settings(max_examples=60)
@given(z=st.floats(-1e5, -200.0), b=st.floats(0.5, 5.0))
def test_sharp_means_conjugate_through_lens_and_microlens(z: float, b: float) -> None:
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


def test_rays_of_a_sharp_plane_meet_on_the_sensor() -> None:
    # Law behind all of it, by exact tracing near the axis of a lens with a small stop: rays of one point through one
    # microlens, seen from the array, come from the distance a.
    camera = camera_with(1.7, lens=LENS.with_stop(pl.CircularStop(0.1))).focused_at(-404.0)
    slopes = np.linspace(-1e-4, 1e-4, 5)
    rays = pl.RayBundle([[0, 0, -404.0]] * 5, np.column_stack([slopes, 0 * slopes, np.ones(5)]))
    out = camera.lens.trace(rays)
    assert np.all(out.status == 0)
    on_array = out.at_z(camera.stop_to_microlenses)[:, 0]
    bent = out.direction[:, 0] / out.direction[:, 2] - on_array / 2.0
    on_sensor = on_array + 1.7 * bent
    # Heights on the array are 3e-4 mm; aberrations of third order bring 1e-3 (1e-4 x 404 mm / 25 mm)^2 of them.
    assert np.abs(on_array).max() > 1e-3 * 0.1
    assert np.abs(on_sensor).max() < 1e-5 * np.abs(on_array).max()


@pytest.mark.parametrize("z", [0.0, 10.0, math.nan, math.inf])
def test_planes_that_are_not_in_front(z: float) -> None:
    with pytest.raises(pl.errors.InvalidValueError, match="z is .* mm; the plane must lie in front of the camera"):
        camera_with(1.7).focused_at(z)


@pytest.mark.parametrize("z", ["x", None, [1.0, 2.0]])
def test_what_is_no_distance(z) -> None:
    with pytest.raises(pl.errors.InvalidValueError, match="z is .*; it must be a number"):
        camera_with(1.7).focused_at(z)


@pytest.mark.parametrize("z", [-1.0, -50.0, -63.0])
def test_planes_within_the_front_focus(z: float) -> None:
    focus = pl.paraxial.cardinal_points(LENS).front_focus
    assert focus < -63.0
    with pytest.raises(pl.errors.InvalidValueError, match=f"no real image behind the lens; .* z = {focus:g} mm"):
        camera_with(1.7).focused_at(z)


def test_a_back_inside_the_lens_is_out_of_reach() -> None:
    # b = 1.96: a = 98 mm; infinity would want the array at 102.5 - 98 = 4.5 mm, inside the lens.
    with pytest.raises(pl.errors.InvalidValueError, match="must be above 30.31"):
        camera_with(1.96).focused_at(-math.inf)


# ---- by the best spot, and by models of the lens ----

SPOTS = (FocusCriterion.RMS_SPOT, FocusCriterion.GEOMETRIC_SPOT)


@pytest.mark.parametrize("criterion", SPOTS)
@pytest.mark.parametrize("b", [1.7, 2.0, 2.4])
def test_the_best_spot_moves_the_back_as_far_as_the_image(b: float, criterion: FocusCriterion) -> None:
    camera = camera_with(b)
    moved = camera.focused_at(-404.0, criterion=criterion).stop_to_microlenses
    image = best_focus(LENS, z_object=-404.0, criterion=criterion)
    assert abs(image - IMAGE) > 1e-3
    # Sums of numbers below 150.
    assert moved - camera.focused_at(-404.0).stop_to_microlenses == pytest.approx(image - IMAGE, abs=4 * EPS * 150)


def test_the_best_spot_makes_the_smallest_blur_on_the_sensor() -> None:
    camera = camera_with(0.0, microlenses=None)
    radius = {}
    for criterion in FocusCriterion:
        z = camera.focused_at(-404.0, criterion=criterion).z_sensor
        spot = spot_diagram(LENS, z_object=-404.0, z_image=z, rays=1 << 14)
        radius[criterion] = (spot.rms_radius, spot.geometric_radius)
    assert min(radius, key=lambda c: radius[c][0]) is FocusCriterion.RMS_SPOT
    assert min(radius, key=lambda c: radius[c][1]) is FocusCriterion.GEOMETRIC_SPOT


@pytest.mark.parametrize("criterion", list(FocusCriterion))
def test_a_thin_lens_focuses_by_its_focal_length(criterion: FocusCriterion) -> None:
    points = pl.paraxial.cardinal_points(LENS)
    camera = camera_with(0.0, microlenses=None, lens=LENS.with_model(pl.LensModel.THIN))
    z = camera.focused_at(-404.0, criterion=criterion).z_sensor
    # 1 / image - 1 / object = 1 / f, both measured from the one plane of the model.
    image = 1.0 / (1.0 / points.efl + 1.0 / (-404.0 - points.rear_principal))
    assert z == pytest.approx(points.rear_principal + image, abs=1e-11)
    assert camera.focused_at(-math.inf, criterion=criterion).z_sensor == pytest.approx(points.rear_focus, abs=1e-11)


@pytest.mark.parametrize("criterion", list(FocusCriterion))
def test_a_paraxial_lens_focuses_by_its_cardinal_points(criterion: FocusCriterion) -> None:
    camera = camera_with(0.0, microlenses=None, lens=LENS.with_model(pl.LensModel.PARAXIAL))
    assert camera.focused_at(-404.0, criterion=criterion).z_sensor == pytest.approx(IMAGE, abs=1e-11)


@pytest.mark.parametrize("model", [pl.LensModel.THIN, pl.LensModel.PARAXIAL])
def test_rays_of_a_perfect_lens_meet_on_the_focused_sensor(model: pl.LensModel) -> None:
    camera = camera_with(0.0, microlenses=None, lens=LENS.with_model(model)).focused_at(-404.0)
    slopes = np.linspace(-0.05, 0.05, 5)
    rays = pl.RayBundle([[3.0, 0, -404.0]] * 5, np.column_stack([slopes, 0 * slopes, np.ones(5)]))
    out = camera.lens.trace(rays)
    assert np.all(out.status == 0)
    assert np.ptp(out.at_z(camera.z_sensor)[:, 0]) < 1e-12


@pytest.mark.parametrize("criterion", list(FocusCriterion))
def test_without_a_lens_nothing_is_focused(criterion: FocusCriterion) -> None:
    camera = camera_with(0.0, microlenses=None, lens=LENS.with_model(pl.LensModel.NONE))
    with pytest.raises(
        pl.errors.InvalidValueError, match=r"LensModel\.NONE, which bends no ray, so no plane is its image"
    ):
        camera.focused_at(-404.0, criterion=criterion)


def test_a_thin_lens_has_its_own_front_focus() -> None:
    points = pl.paraxial.cardinal_points(LENS)
    camera = camera_with(0.0, microlenses=None, lens=LENS.with_model(pl.LensModel.THIN))
    focus = points.rear_principal - points.efl
    assert focus < -95.0 < points.front_focus
    with pytest.raises(pl.errors.InvalidValueError, match=f"no real image behind the lens; .* z = {focus:g} mm"):
        camera.focused_at(-95.0)


def test_what_is_no_criterion() -> None:
    with pytest.raises(pl.errors.InvalidValueError, match="criterion is 'best'; it must be FocusCriterion.PARAXIAL or"):
        camera_with(1.7).focused_at(-404.0, criterion="best")
