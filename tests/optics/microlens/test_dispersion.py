"""Microlenses whose medium disperses: focal lengths against the wavelength, and the colours of their images."""

import dataclasses
import itertools

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.core.kernels.ray_blocks import BLOCK
from plenoptic.optics.microlens.microlens_record import SensorPlane, array_record, lone_lens
from plenoptic.optics.microlens.model_records import ArrayCrossing

FLINT = pl.ModelGlass(1.62, 36.4)
Model = pl.optics.MicrolensModel
THIN, FLAT, SPHERICAL = Model.THIN, Model.FLAT_HIGH_INDEX, Model.SPHERICAL
COLOURS = pl.sensor.Sensitivity([680.0, 550.0, 440.0])


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
    elements = list(lens.elements)
    for k, part in enumerate(elements):
        if isinstance(part, pl.Surface):
            elements[k] = dataclasses.replace(part, medium=pl.ConstantMedium(part.medium.index(587.6)))
    lens, sensor = pl.LensStack(elements).with_model(pl.LensModel.THIN), pl.Sensor((22, 22), 0.01)
    place = {"microlenses": array, "stop_to_microlenses": 123.3, "microlenses_to_sensor": 1.7}
    return pl.PlenopticCamera(**({"lens": lens, "sensor": sensor} | place | changes))


def test_the_focal_length_follows_the_index():
    for model, side, wavelength in itertools.product((THIN, FLAT, SPHERICAL), pl.optics.ConvexSide, (440.0, 680.0)):
        array = array_of(model, side)
        waves = (587.6, 500.0, wavelength)
        record = array_record(array, turn=np.eye(2), origin=np.zeros(2), reach=1.0, margin=0.0, wavelengths=waves)
        # Rays parallel to the axis at small heights, of the second wavelength that is drawn.
        height = np.linspace(1e-5, 1e-4, BLOCK)
        fields = np.zeros((8, BLOCK))
        fields[0], fields[6] = height, 1.0
        blocks, plane = fields.reshape(-1), SensorPlane(2.0, None)
        uncut = lone_lens(array, record.power, wavelength)
        uncut = uncut._replace(model=record.model, power_factors=record.power_factors)
        model.refraction.to_lens(blocks, None, ArrayCrossing(uncut, plane, 100.0), np.ones(BLOCK, dtype=np.int64))
        slope_over_height = fields[3] / fields[5] / height
        medium = array.medium
        focal_length = 2.0 * (medium.index(587.6) - 1.0) / (medium.index(wavelength) - 1.0)
        # Aberrations are of the order of the squared height over the squared focal length, 2.5e-9.
        power = np.full(BLOCK, 1.0 / focal_length)
        assert slope_over_height == pytest.approx(power, rel=1e-8), (model, side, wavelength)


def test_a_medium_that_does_not_disperse_is_an_index():
    for model in (THIN, FLAT, SPHERICAL):
        index = 100.0 if model is FLAT else 1.62
        media = ({"medium": None, "index": index}, {"medium": pl.ConstantMedium(index)})
        cameras = (camera_of(array_of(model, **medium), sensitivity=COLOURS) for medium in media)
        shots = [pl.render_white(camera, samples=16, progress=False).image for camera in cameras]
        assert np.array_equal(*shots), model


def chi2(a, b):
    error = np.hypot(a.standard_error, b.standard_error)
    lit = (error > 0) & (a.image > 0)
    return float(np.mean(((a.image - b.image)[lit] / error[lit]) ** 2))


def test_a_line_that_paths_draw_gives_the_image_of_that_wavelength():
    for model in (THIN, FLAT, SPHERICAL):
        camera = camera_of(array_of(model), wavelength=450.0)
        drawn = dataclasses.replace(camera, wavelength=587.6, sensitivity=pl.sensor.Sensitivity([450.0]))
        # All traced: white images trace less where paths draw no wavelengths.
        far, sky = dataclasses.replace(camera, wavelength=680.0), pl.Scene(background=1.0)
        one, other, red = (
            pl.render(sky, made, samples=512, seed=seed, truth=pl.Truth.NONE, progress=False)
            for seed, made in enumerate((camera, drawn, far))
        )
        # Errors are known about as well as those of 8 replicates: Student's t with 14 degrees of freedom has 1.17.
        assert chi2(one, other) < 1.6 and chi2(one, red) > 3.0, model


def test_light_of_points_meets_microlenses_of_its_wavelength():
    for model in (THIN, FLAT, SPHERICAL):
        camera = camera_of(array_of(model), wavelength=450.0)
        array = camera.microlenses
        constant = array.medium.index(450.0)
        landed = pl.camera.landing_points(camera, (0.0, 0.0, -404.0), rays=2048)
        assert (landed.index == 0).all(axis=1).sum() > 10, model
        # A plate of the constant index with the same surfaces: its focal length at 450 nm, and as thick.
        focal_length = 2.0 * (array.index - 1.0) / (constant - 1.0)
        shorter = array_of(model, medium=None, index=constant, focal_lengths=(focal_length,))
        assert shorter.radius == pytest.approx(array.radius, rel=1e-12), model
        moved = shorter.thickness / shorter.index - array.thickness / array.index if model is not THIN else 0.0
        distance = camera.microlenses_to_sensor + moved
        twin = dataclasses.replace(camera, microlenses=shorter, microlenses_to_sensor=distance)
        expected = pl.camera.landing_points(twin, (0.0, 0.0, -404.0), rays=2048)
        assert landed.position == pytest.approx(expected.position, abs=1e-12), model


def test_impossible_media_are_refused():
    for fields, said in [
        ({"medium": 1.5}, "medium of the microlenses is 1.5; it must be a medium: pl.optics.AIR"),
        ({"medium": FLINT, "index": 1.7}, "index of the microlenses is 1.7, and their medium has 1.62"),
        ({"medium": pl.optics.AIR}, "index of the microlenses is 1.0; it must be above 1"),
        ({"medium": FLINT, "model": FLAT}, "FLAT_HIGH_INDEX stands for a nearly flat lens and needs at least 10"),
    ]:
        with pytest.raises(pl.errors.InvalidValueError, match=said):
            pl.MicrolensArray(**({"pitch": 0.217, "focal_lengths": (2.0,), "model": SPHERICAL} | fields))


def test_reports_focus_and_designs_are_those_of_the_focal_length_at_the_wavelength():
    wavelength = 450.0
    focal_length = 2.0 * (FLINT.index(587.6) - 1.0) / (FLINT.index(wavelength) - 1.0)
    arrays = array_of(THIN), array_of(THIN, medium=None, focal_lengths=(focal_length,))
    assert arrays[0].focal_lengths_at(wavelength) == pytest.approx((focal_length,), rel=1e-14)
    one, other = (camera_of(designs, wavelength=wavelength) for designs in arrays)
    assert str(one.report()) == str(other.report())
    assert one.report().focus[0].z == pytest.approx(other.report().focus[0].z, rel=1e-9)
    moved = [camera.focused_at(-500.0).stop_to_microlenses for camera in (one, other)]
    assert moved[0] == pytest.approx(moved[1], rel=1e-12)
    wishes = {"sensor": one.sensor, "kind": pl.CameraKind.PLENOPTIC_1, "z": -500.0, "wavelength": wavelength}
    designs = [pl.design_camera(one.lens, microlenses=microlenses, **wishes).camera for microlenses in arrays]
    assert designs[0].microlenses_to_sensor == pytest.approx(focal_length, rel=1e-12)
    assert designs[0].stop_to_microlenses == pytest.approx(designs[1].stop_to_microlenses, rel=1e-12)
    assert designs[0].report().kind is wishes["kind"]
