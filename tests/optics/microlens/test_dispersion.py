"""Microlenses whose medium disperses: focal lengths against the wavelength, and the colours of their images."""

import dataclasses

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.core.kernels.ray_blocks import BLOCK
from plenoptic.optics.microlens.model_rules import Crossing
from plenoptic.optics.microlens.record import SensorPlane, array_record, lone_lens

FLINT = pl.ModelGlass(1.62, 36.4)
THIN, FLAT, SPHERICAL = (
    pl.optics.MicrolensModel.THIN,
    pl.optics.MicrolensModel.FLAT_HIGH_INDEX,
    pl.optics.MicrolensModel.SPHERICAL,
)


class Dense:
    """A medium for flat plates, whose index falls from blue to red."""

    def index(self, wavelength):
        return 100.0 + 0.01 * (587.6 - wavelength)


def array_of(model, side=pl.optics.ConvexSide.SCENE, **changes):
    medium = Dense() if model is FLAT else FLINT
    fields = {"pitch": 0.217, "focal_lengths": (2.0,), "model": model, "convex_side": side, "medium": medium} | changes
    return pl.MicrolensArray(**fields)


def camera_of(array, **changes):
    """A thin lens in front, so that all colour is that of the microlenses."""
    lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(5.0))
    elements = [
        dataclasses.replace(part, medium=pl.ConstantMedium(part.medium.index(587.6)))
        if isinstance(part, pl.Surface) and part.medium != pl.optics.AIR
        else part
        for part in lens.elements
    ]
    fields = {
        "lens": pl.LensStack(elements).with_model(pl.LensModel.THIN),
        "microlenses": array,
        "sensor": pl.Sensor((22, 22), 0.01),
        "stop_to_microlenses": 123.3,
        "microlenses_to_sensor": 1.7,
    } | changes
    return pl.PlenopticCamera(**fields)


# ---- focal lengths ----


@pytest.mark.parametrize("wavelength", [440.0, 587.6, 680.0])
@pytest.mark.parametrize("side", pl.optics.ConvexSide)
@pytest.mark.parametrize("model", [THIN, FLAT, SPHERICAL])
def test_the_focal_length_follows_the_index(model, side, wavelength):
    array = array_of(model, side)
    record = array_record(
        array, turn=np.eye(2), origin=np.zeros(2), reach=1.0, margin=0.0, wavelengths=(587.6, 500.0, wavelength)
    )
    # Rays parallel to the axis at small heights, of the second wavelength that is drawn.
    height = np.linspace(1e-5, 1e-4, BLOCK)
    fields = np.zeros((8, BLOCK))
    fields[0], fields[6] = height, 1.0
    blocks, waves, plane = fields.reshape(-1), np.ones(BLOCK, dtype=np.int64), SensorPlane(2.0, None)
    uncut = lone_lens(array, record.power, wavelength)
    uncut = uncut._replace(model=record.model, power_factors=record.power_factors)
    model.rules.to_lens(blocks, None, Crossing(uncut, plane, 100.0), waves)
    u, w = fields[3], fields[5]
    medium = array.medium
    focal_length = 2.0 * (medium.index(587.6) - 1.0) / (medium.index(wavelength) - 1.0)
    # Aberrations are of the order of the squared height over the squared focal length, 2.5e-9.
    assert u / w / height == pytest.approx(np.full(BLOCK, 1.0 / focal_length), rel=1e-8)


@pytest.mark.parametrize("model", [THIN, FLAT, SPHERICAL])
def test_a_medium_that_does_not_disperse_is_an_index(model):
    index = 100.0 if model is FLAT else 1.62
    seen = pl.sensor.Sensitivity([650.0, 550.0, 450.0])
    plain = camera_of(array_of(model, medium=None, index=index), sensitivity=seen)
    same = camera_of(array_of(model, medium=pl.ConstantMedium(index)), sensitivity=seen)
    shots = [pl.render_white(camera, samples=16, progress=False) for camera in (plain, same)]
    assert np.array_equal(shots[0].image, shots[1].image)


# ---- images ----


@pytest.mark.parametrize("model", [THIN, FLAT, SPHERICAL])
def test_a_line_that_paths_draw_gives_the_image_of_that_wavelength(model):
    camera = camera_of(array_of(model), wavelength=450.0)
    drawn = dataclasses.replace(camera, wavelength=587.6, sensitivity=pl.sensor.Sensitivity([450.0]))
    # All traced: white images trace less where paths draw no wavelengths.
    far, sky = dataclasses.replace(camera, wavelength=680.0), pl.Scene(background=1.0)
    one, other, red = (
        pl.render(sky, made, samples=512, seed=seed, truth=pl.Truth.NONE, progress=False)
        for seed, made in enumerate((camera, drawn, far))
    )

    def chi2(a, b):
        error = np.hypot(a.standard_error, b.standard_error)
        lit = (error > 0) & (a.image > 0)
        return float(np.mean(((a.image - b.image)[lit] / error[lit]) ** 2))

    # Errors are known about as well as those of 8 replicates: Student's t with 14 degrees of freedom has 1.17.
    assert chi2(one, other) < 1.6
    assert chi2(one, red) > 3.0


@pytest.mark.parametrize("model", [THIN, SPHERICAL])
def test_microlens_images_are_red_at_their_rim_in_front_of_the_focus(model):
    # A ray through the height y of a microlens lands at y (1 - distance / f) beside the ray through its centre: nearer
    # than the focus, blue light, whose focal length is shorter, lands nearer to it.
    camera = camera_of(
        array_of(model, medium=pl.ModelGlass(1.62, 20.0)), sensitivity=pl.sensor.Sensitivity([680.0, 550.0, 440.0])
    )
    shot = pl.render_white(camera, samples=2048, progress=False)
    x = (np.arange(22) - 10.5) * 0.01
    radius2 = x[:, None] ** 2 + x**2
    light = shot.image.astype(float)
    spread = np.einsum("ij,ijc->c", radius2, light) / light.sum(axis=(0, 1))
    assert spread[0] > spread[1] > spread[2]


@pytest.mark.parametrize("model", [THIN, FLAT, SPHERICAL])
def test_light_of_points_meets_microlenses_of_its_wavelength(model):
    camera = camera_of(array_of(model), wavelength=450.0)
    constant = camera.microlenses.medium.index(450.0)
    landed = pl.camera.landing_points(camera, (0.0, 0.0, -404.0), rays=4096)
    middle = (landed.index == 0).all(axis=1)
    assert middle.sum() > 20
    # A plate of the constant index with the same surfaces: its focal length at 450 nm, and as thick.
    shorter = array_of(
        model, medium=None, index=constant, focal_lengths=(2.0 * (camera.microlenses.index - 1.0) / (constant - 1.0),)
    )
    assert shorter.radius == pytest.approx(camera.microlenses.radius, rel=1e-12)
    inside = camera.microlenses.thickness / camera.microlenses.index if model is not THIN else 0.0
    moved = shorter.thickness / shorter.index if model is not THIN else 0.0
    twin = dataclasses.replace(
        camera, microlenses=shorter, microlenses_to_sensor=camera.microlenses_to_sensor + moved - inside
    )
    expected = pl.camera.landing_points(twin, (0.0, 0.0, -404.0), rays=4096)
    assert landed.position == pytest.approx(expected.position, abs=1e-12)


# ---- what is refused ----


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"medium": 1.5}, "medium of the microlenses is 1.5; it must be a medium: pl.optics.AIR"),
        ({"medium": "N-BK7"}, "medium of the microlenses is 'N-BK7'; it must be a medium"),
        ({"medium": FLINT, "index": 1.7}, "index of the microlenses is 1.7, and their medium has 1.62"),
        ({"medium": pl.optics.AIR}, "index of the microlenses is 1.0; it must be above 1"),
        ({"medium": FLINT, "model": FLAT}, "FLAT_HIGH_INDEX stands for a nearly flat lens and needs at least 10"),
    ],
)
def test_impossible_media_are_refused(fields, said):
    with pytest.raises(pl.errors.InvalidValueError, match=said):
        pl.MicrolensArray(**({"pitch": 0.217, "focal_lengths": (2.0,), "model": SPHERICAL} | fields))


# ---- reports ----


@pytest.mark.parametrize("wavelength", [450.0, 680.0])
def test_reports_focus_and_designs_are_those_of_the_focal_length_at_the_wavelength(wavelength):
    focal_length = 2.0 * (FLINT.index(587.6) - 1.0) / (FLINT.index(wavelength) - 1.0)
    array = array_of(THIN)
    plain = array_of(THIN, medium=None, focal_lengths=(focal_length,))
    assert array.focal_lengths_at(wavelength) == pytest.approx((focal_length,), rel=1e-14)
    one, other = (camera_of(made, wavelength=wavelength) for made in (array, plain))
    assert str(one.report()) == str(other.report())
    assert one.report().focus[0].z == pytest.approx(other.report().focus[0].z, rel=1e-9)
    moved = [camera.focused_at(-500.0).stop_to_microlenses for camera in (one, other)]
    assert moved[0] == pytest.approx(moved[1], rel=1e-12)
    kind = pl.CameraKind.PLENOPTIC_1
    made = [
        pl.design_camera(
            one.lens, sensor=one.sensor, kind=kind, z=-500.0, microlenses=given, wavelength=wavelength
        ).camera
        for given in (array, plain)
    ]
    assert made[0].microlenses_to_sensor == pytest.approx(focal_length, rel=1e-12)
    assert made[0].stop_to_microlenses == pytest.approx(made[1].stop_to_microlenses, rel=1e-12)
    assert made[0].report().kind is kind
