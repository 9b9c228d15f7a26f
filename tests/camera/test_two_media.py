"""Cameras whose scene and sensor are in different media: radiance, white images, projection and focus."""

import dataclasses
import math

import numpy as np
import pytest
from camera_helpers import bare_camera, camera_with, in_world, total, white

import plenoptic as pl

AIR, WATER, VITREOUS = pl.optics.AIR, pl.ConstantMedium(1.333), pl.ConstantMedium(1.336)
LIGHT, LIGHTER = pl.ConstantMedium(1.15), pl.ConstantMedium(1.1)
EXACT, THIN, PARAXIAL = pl.LensModel.EXACT, pl.LensModel.THIN, pl.LensModel.PARAXIAL


def between(front, rear, *, port=False):
    """The double Gauss with other media around it, which shift its focus, or in air behind a flat port."""
    lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(5.0))
    elements = [*lens.elements[:-1], dataclasses.replace(lens.elements[-1], medium=rear)]
    if port:
        window = [pl.Surface(math.inf, 8.0, pl.ConstantMedium(1.5), semi_diameter=200.0),
                  pl.Surface(math.inf, 20.0, AIR, semi_diameter=200.0)]  # fmt: skip
        elements = [*window, *elements]
    iris = lens.iris_index + (2 if port else 0)
    return pl.LensStack(elements, iris, lens.name, front_medium=front, rear_medium=rear)


def focused(lens, z=-900.0, before=11.0, **array):
    """A camera with the array some mm in front of the image of a plane, for the same microlenses as in air."""
    image = pl.paraxial.image_position(lens, z)
    return camera_with(shape=(96, 96), lens=lens, to_array=image - before, **array)


def test_a_medium_before_a_flat_port_divides_radiance_by_its_squared_index():
    # The rays that pass are the same; outside they are refracted into the water. In water L / n^2 is that of air.
    for array in (None, {}, {"model": pl.optics.MicrolensModel.SPHERICAL}):
        cameras = []
        for medium in (AIR, WATER):
            lens = between(medium, AIR, port=True)
            bare = bare_camera(lens, z=106.0, shape=(96, 96))
            cameras.append(bare if array is None else camera_with(shape=(96, 96), lens=lens, **array))
        air, wet = (white(camera, 32).image for camera in cameras)
        assert air.max() > 0
        np.testing.assert_allclose(wet * 1.333**2, air, rtol=1e-6)
        # A furnace: a scene of radiance 1 all around is the white image.
        scene = pl.Scene(background=1.0)
        seen = pl.render(scene, cameras[1], samples=32, progress=False).image
        np.testing.assert_allclose(seen.mean() * 1.333**2, air.mean(), rtol=1e-3)


def test_each_wavelength_has_the_radiance_of_its_indices():
    glass = pl.glass("N-SF6")
    lens = between(glass, AIR, port=True)
    for wavelength in (450.0, 650.0):
        lines = pl.sensor.Sensitivity.lines((wavelength,))
        dry = bare_camera(between(AIR, AIR, port=True), z=106.0, shape=(16, 16))
        dry = dataclasses.replace(dry, sensitivity=lines)
        wet = dataclasses.replace(dry, lens=lens)
        ratio = white(wet, 64).image.mean() / white(dry, 64).image.mean()
        assert ratio == pytest.approx(float(glass.index(wavelength)) ** -2, rel=1e-6), wavelength


def brute_force(camera, points=64, steps=12):
    """Mean of the white image by rays in reverse from a grid of the sensor through a grid of the microlens plane."""
    lens, array, sensor = camera.lens, camera.microlenses, camera.sensor
    b, height = camera.microlenses_to_sensor, sensor.size[0]
    side = (np.arange(points) + 0.5) / points - 0.5
    starts = height * np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    reach, rng, light = 0.5 * array.pitches[0], np.random.default_rng(2), 0.0
    local = 2 * reach * (np.stack(np.meshgrid(*[(np.arange(steps) + 0.5) / steps - 0.5] * 2), axis=-1).reshape(-1, 2))
    centres = np.stack(np.meshgrid(*[np.arange(-4, 5) * 2 * reach] * 2), axis=-1).reshape(-1, 2)
    for start in starts + rng.uniform(-0.5, 0.5, starts.shape) * height / points:
        near = centres[np.hypot(*(centres - start).T) < 0.42]
        aims = (near[:, None] + local).reshape(-1, 2)
        slope = (aims - start) / b
        weight = (1 + (slope**2).sum(axis=1)) ** -2 / b**2 * (2 * reach / steps) ** 2
        out = slope - np.tile(local, (len(near), 1)) / array.focal_lengths[0]
        origin = np.column_stack([aims, np.full(len(aims), camera.stop_to_microlenses)])
        rays = pl.RayBundle(origin, np.column_stack([out, -np.ones(len(out))]), camera.wavelength)
        light += float((weight * lens.trace_reverse(rays).weight).sum())
    return light / len(starts)


@pytest.mark.slow
@pytest.mark.parametrize("media", [(WATER, AIR), (AIR, VITREOUS), (LIGHT, LIGHTER)])
def test_white_images_are_the_light_of_a_brute_force(media):
    lens = between(*media)
    z = pl.paraxial.cardinal_points(lens).rear_focus + 2.0
    camera = camera_with(shape=(64, 64), lens=lens, to_array=z, lattice=pl.Lattice.SQUARE)
    n, m = (medium.index(587.6) for medium in media)
    for model in (EXACT, PARAXIAL, THIN):
        made = dataclasses.replace(camera, lens=lens.with_model(model))
        shot, expected = white(made, 256), (m / n) ** 2 * brute_force(made)
        light, error = (number / shot.image.size for number in total(shot))
        # Of 4096 jittered points on edges of micro images: 0.2 % as measured with one medium on both sides.
        assert light == pytest.approx(expected, rel=6e-3, abs=4 * error), model


@pytest.mark.parametrize("media", [(WATER, AIR), (AIR, VITREOUS), (LIGHT, LIGHTER)])
def test_forward_rays_bring_the_light_of_an_image(media):
    # A small emitter in the render, and `point_spread` of its centre: E = L dA times the spread.
    camera = focused(between(*media))
    for model in (EXACT, PARAXIAL, THIN):
        made = dataclasses.replace(camera, lens=camera.lens.with_model(model))
        side, z = 0.2, -900.0
        quad = pl.quad((-side, -side, z), (2 * side, 0, 0), (0, 2 * side, 0), material=pl.Emissive(1.0))
        scene = pl.Scene([quad])
        image = pl.render(scene, made, samples=512, progress=False)
        spread = pl.point_spread(made, (0.0, 0.0, z), rays=1 << 16, progress=False)
        light, error = total(image)
        area = made.sensor.pixel_pitch**2
        assert light * area == pytest.approx(spread.light * (2 * side) ** 2, rel=5e-3, abs=4 * error * area), model


@pytest.mark.parametrize("media", [(WATER, AIR), (AIR, VITREOUS), (LIGHT, LIGHTER)])
def test_projections_are_where_forward_rays_land(media):
    small = {"aperture": pl.optics.MicrolensAperture(pl.optics.ApertureShape.CIRCLE, 0.1)}
    camera = focused(between(*media), before=25.0, **small)
    point = in_world(camera, [(0.5, 0.3, -905.0)])
    projection = pl.camera.project(camera, point, progress=False)
    landed = pl.camera.landing_points(camera, point, rays=1 << 18)
    rows = {tuple(index): k for k, index in enumerate(projection.index.tolist()) if projection.passes[k]}
    compared = 0
    for index in {tuple(each) for each in landed.index.tolist()} & rows.keys():
        on = (landed.index == index).all(axis=1)
        if on.sum() > 100 and projection.visible[rows[index]]:
            spot = landed.position[on]
            miss = np.hypot(*(spot.mean(axis=0) - projection.position[rows[index]]))
            assert miss < 3e-4 + 5 * np.hypot(*spot.std(axis=0)) / math.sqrt(on.sum()), index
            compared += 1
    assert compared > 4


def test_focus_and_report_are_those_of_gaussian_optics_in_the_media():
    for media in ((WATER, AIR), (AIR, VITREOUS), (WATER, VITREOUS)):
        lens = between(*media)
        points = pl.paraxial.cardinal_points(lens)
        for model in (EXACT, PARAXIAL, THIN):
            camera = dataclasses.replace(focused(lens), lens=lens.with_model(model))
            camera = camera.focused_at(z=-900.0)
            report = camera.report()
            assert report.efl == pytest.approx(points.efl) and report.f_number == pytest.approx(points.f_number)
            focus = report.focus[0]
            assert focus.z == pytest.approx(-900.0, rel=1e-8), (media, model)
            if model is not THIN:
                # The cone at the array: the paraxial marginal ray from the image of the iris.
                z, scale = camera.stop_to_microlenses, points.exit_pupil_semi_diameter
                slope = scale / (z - points.exit_pupil)
                assert report.working_f_number_paraxial == pytest.approx(0.5 / abs(slope), rel=1e-9)
                image = camera.stop_to_microlenses + focus.image_distance
                plane = pl.paraxial.object_position(lens, image)
                assert focus.magnification == pytest.approx(pl.paraxial.magnification(lens, plane), rel=1e-9)
            near, far = (pl.paraxial.image_position(lens, z) for z in (focus.z_near, focus.z_far))
            if model is PARAXIAL:
                b, f, q = camera.microlenses_to_sensor, focus.focal_length, camera.sensor.pixel_pitch
                for image in (near, far):
                    s = image - camera.stop_to_microlenses
                    assert 0.217 * b * abs(1 / s - 1 / b + 1 / f) == pytest.approx(q, rel=1e-6)
                assert focus.z_near > focus.z > focus.z_far


def test_diffraction_has_the_wavelength_in_the_medium_of_each_side():
    from plenoptic.camera.camera_record import camera_record

    for media in ((AIR, AIR), (WATER, AIR), (AIR, VITREOUS)):
        camera = dataclasses.replace(focused(between(*media)), diffraction=pl.Diffraction(iris=True))
        record, (n, m) = camera_record(camera), (medium.index(587.6) for medium in media)
        assert record.iris.wavelengths[0] == pytest.approx(587.6e-6 / n, rel=1e-15)
        assert record.deflection.wavelengths[0] == pytest.approx(587.6e-6 / m, rel=1e-15)
        assert (record.radiance_scale is None) == (n == m)
