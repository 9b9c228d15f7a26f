"""Kinds of arrays in white images: limits in which one kind becomes another, and closed forms."""

import dataclasses
import math

import camera_helpers
import numpy as np
import pytest
from camera_helpers import CAMERA, agree, camera_with, refused, the_lens, total

import plenoptic as pl

LENS, ARRAY = CAMERA.lens, CAMERA.microlenses
REGION = np.s_[196:256, 160:220]
MODELS, SHAPES, GAPS = pl.optics.MicrolensModel, pl.optics.ApertureShape, pl.optics.Gaps


def with_array(camera=CAMERA, **changes):
    return camera_helpers.with_array(camera, **changes)


def white(camera, samples=64, region=REGION, seed=0):
    return camera_helpers.white(camera, samples, region, seed)


def sky(camera, region=REGION):
    """Radiance 1 everywhere, by the paths of scenes: the same ones, whatever stops or dims them."""
    return pl.render(pl.Scene(background=1.0), camera, samples=64, region=region, progress=False)


def test_listed_centres_of_a_lattice_are_the_lattice():
    centres = ARRAY.lenses((-4.0, -4.0), (4.0, 4.0)).centre
    free = with_array(lattice=pl.Lattice.FREE, centres=centres)
    agree(white(free, 256), white(CAMERA, 256, seed=1))


def test_rectangles_of_equal_sides_are_squares():
    square, rectangles = (
        with_array(lattice=lattice, pitch=pitch)
        for lattice, pitch in ((pl.Lattice.SQUARE, 0.217), (pl.Lattice.RECTANGULAR, (0.217, 0.217)))
    )
    assert np.array_equal(white(rectangles).image, white(square).image)


def test_no_imperfection_is_none():
    for model in (MODELS.THIN, MODELS.FLAT_HIGH_INDEX, MODELS.SPHERICAL):
        camera = with_array(model=model, index=100.0 if model is MODELS.FLAT_HIGH_INDEX else 1.5)
        listed = with_array(camera, imperfections=pl.MicrolensImperfections(pitch_jitter=1e-12))
        agree(white(listed, 128), white(camera, 128, seed=1), case=model)
        types = with_array(camera, focal_lengths=(2.0, 2.0, 2.0 + 1e-12))
        # Equal types are one type.
        assert np.allclose(white(types).image, white(camera).image, rtol=1e-4, atol=1e-7), model


def test_an_array_whose_lenses_are_all_missing_is_a_conventional_camera():
    camera = with_array(imperfections=pl.MicrolensImperfections(missing=1.0))
    plain = pl.PlenopticCamera(lens=LENS, sensor=CAMERA.sensor, stop_to_microlenses=CAMERA.z_sensor)
    agree(white(camera, 64), white(plain, 64, seed=1))


def test_dark_lenses_are_black_and_half_transparent_ones_halve_the_light():
    assert not white(with_array(imperfections=pl.MicrolensImperfections(dark=1.0)), 16).image.any()
    index = ARRAY.lenses((-4.0, -4.0), (4.0, 4.0)).index
    half = with_array(imperfections=pl.optics.MicrolensDeviations(index=index, transmission=np.full(len(index), 0.5)))
    agree(white(half, 256), white(CAMERA, 256, seed=1), 0.5)
    # One dark lens on the axis: its image disappears, others stay as they are.
    one = with_array(imperfections=pl.optics.MicrolensDeviations(index=[(0, 0)], transmission=[0.0]))
    region = np.s_[230:282, 230:282]
    shot, whole = white(one, 256, region), white(CAMERA, 256, region, seed=1)
    assert shot.image[26, 26, 0] == 0 < whole.image[26, 26, 0]
    agree(shot, whole, region=np.s_[:8, :8])


def test_each_type_images_as_an_array_of_its_own():
    # In mode 2.0 with a small stop, images do not overlap: pixels under a lens are its own.
    small, focal_lengths = dataclasses.replace(CAMERA, lens=the_lens(3.0)), (1.6, 2.0, 2.5)
    lenses = with_array(focal_lengths=focal_lengths).microlenses.lenses((-2.0, -2.0), (2.0, 2.0))
    points = CAMERA.sensor.centre_of(*np.mgrid[REGION]).reshape(-1, 2) * (123.3 + 5.23) / (125.0 + 5.23)
    owner = np.linalg.norm(points[:, None] - lenses.centre, axis=-1).argmin(axis=1)
    kind = lenses.type[owner].reshape(60, 60)
    assert set(np.unique(kind)) == {0, 1, 2}
    for model in (MODELS.THIN, MODELS.SPHERICAL):
        several = with_array(small, model=model, focal_lengths=focal_lengths)
        shot = white(several, 128)
        for number, f in enumerate(focal_lengths):
            single_type = white(with_array(several, focal_lengths=(f,)), 128, seed=1)
            agree(shot, single_type, region=kind == number, case=(model, f))


def test_opaque_gaps_take_their_area_s_part_of_the_light():
    # In mode 1.0 each point of a cell sends as much light to the image below it: a wide stop, far from its rims.
    camera = dataclasses.replace(CAMERA, microlenses_to_sensor=2.0, lens=the_lens(3.0))
    region = np.s_[206:250, 206:250]
    for model in (MODELS.THIN, MODELS.SPHERICAL):
        full = white(with_array(camera, model=model), 256, region, seed=1)
        for shape in SHAPES:
            narrow = with_array(camera, model=model, aperture=pl.optics.MicrolensAperture(shape, 0.6))
            # Images are cut by the region's border: twice the pixels' row of 172, at most 2 % of their light unequal.
            agree(white(narrow, 256, region), full, 0.6, relative=0.02, case=(model, shape))


def test_clear_gaps_pass_what_opaque_ones_stop():
    region = np.s_[185:280, 185:280]
    for model in (MODELS.THIN, MODELS.SPHERICAL):
        full = with_array(model=model)
        clear, opaque = (
            with_array(full, aperture=pl.optics.MicrolensAperture(SHAPES.CIRCLE, 0.5, gaps))
            for gaps in (GAPS.CLEAR, GAPS.OPAQUE)
        )
        # What passes beside the openings is what flat glass would pass there.
        none = {"imperfections": pl.MicrolensImperfections(missing=1.0)}
        shown = (full, 1), (clear, 0), (opaque, 0), (with_array(full, **none), 0), (with_array(opaque, **none), 0)
        whole, open_, shut, plain, flat = (white(each, 32, region, seed) for each, seed in shown)
        # All light of the cells arrives somewhere: with clear gaps, the mean over a large region is that of full
        # lenses. 9025 pixels of 32 paths know their sum to 0.24 %, and what passes beside the openings to 0.7 %.
        agree(open_, whole, relative=0.01)
        expected = total(plain)[0] - total(flat)[0]
        assert total(open_)[0] - total(shut)[0] == pytest.approx(expected, rel=0.02), model


def camera_array(**changes):
    """3 x 3 cameras of 10 mm with openings of 1 mm radius."""
    opening = pl.optics.MicrolensAperture(SHAPES.CIRCLE, math.pi / 100)
    parameters = {"lattice": pl.Lattice.SQUARE, "aperture": opening, "walls": pl.optics.Walls.OPAQUE} | changes
    array = pl.MicrolensArray(pitch=10.0, focal_lengths=(8.0,), **parameters)
    return pl.PlenopticCamera(pl.no_lens(30.0), pl.Sensor(shape=(60, 60), pixel_pitch=0.5), 1.0, array, 8.2)


def test_each_camera_of_an_array_lights_its_own_part():
    # Without a main lens and with walls, each camera is a thin lens over a dark box: E = A cos^4 / b^2.
    listed = [(10.0 * i, 10.0 * j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    for changes in ({}, {"lattice": pl.Lattice.FREE, "centres": listed}):
        camera = camera_array(**changes)
        shot = white(camera, 256, None)
        points = camera.sensor.centre_of(*np.mgrid[:60, :60])
        off = points - 10.0 * np.round(points / 10.0)
        cos2 = 1.0 / (1.0 + (off**2).sum(axis=-1) / 8.2**2)
        expected = math.pi * cos2**2 / 8.2**2
        middle = np.hypot(*off.transpose(2, 0, 1)) < 2.5
        # cos^4 is 1 - 2 r^2 / b^2: averaged over the opening, where r^2 is 1/2 on average, it is 1.5 % lower.
        assert shot.image[middle, 0].sum() == pytest.approx(0.985 * expected[middle].sum(), rel=0.005)
        # Single pixels: 256 points on a disc of which half or less are hit scatter by some 2 %, rarely by 5 times that.
        assert shot.image[middle, 0] == pytest.approx(expected[middle], rel=0.15)
        assert np.ptp(shot.image.reshape(3, 20, 3, 20).sum(axis=(1, 3), dtype=float)) < 6 * total(shot)[1] / 3
        without = white(camera_array(**changes | {"walls": pl.optics.Walls.NONE}), 64, None)
        assert without.image.sum() > 1.5 * shot.image.sum()


def test_reports_and_centres_know_an_array_of_cameras():
    camera = camera_array()
    report = camera.report()
    assert report.kind is pl.CameraKind.CAMERA_ARRAY
    assert (report.microlenses, report.image_pitch_pixels, report.overlap_fraction) == (9, pytest.approx(20.0), 0.0)
    assert report.warnings == ()
    straight, chief = (pl.microlens_centres(camera, m) for m in (pl.CentreMethod.ORTHOGONAL, pl.CentreMethod.CHIEF_RAY))
    assert len(chief) == 9 and np.array_equal(chief.position, straight.position)
    with refused("walls"):
        pl.microlens_centres(camera, pl.CentreMethod.CENTROID)


def test_cameras_of_an_array_see_points_with_the_disparity_of_their_baseline():
    # A small emitter 500 mm in front of the array: images shift against the centres by baseline times b / distance.
    camera = camera_array()
    camera = dataclasses.replace(camera, sensor=pl.Sensor(shape=(600, 600), pixel_pitch=0.05))
    emitter = pl.quad((-2.0, -2.0, -499.0), (4.0, 0, 0), (0, 4.0, 0), material=pl.Emissive(1.0))
    scene, options = pl.Scene(meshes=[emitter]), {"samples": 64, "truth": pl.Truth.NONE, "progress": False}
    for i, j in ((0, 0), (1, -1), (-1, 0)):
        # All of the pixels behind one camera; row 0 is at the bottom, and column 0 on the right.
        rows, columns = (slice(200 + 200 * k, 400 + 200 * k) for k in (j, -i))
        points = camera.sensor.centre_of(*np.mgrid[rows, columns])
        assert (np.abs(points - 10.0 * np.array([i, j])) < 5.0).all()
        light = pl.render(scene, camera, region=(rows, columns), **options).image[..., 0].astype(float)
        centroid = (light[..., None] * points).sum(axis=(0, 1)) / light.sum()
        # The pixel raster cuts an image 1.3 pixels wide: a tenth of a pixel, and half of that for noise.
        assert centroid == pytest.approx(10.0 * np.array([i, j]) * (1 + 8.2 / 500.0), abs=0.0075), (i, j)
    # Forwards, light lands where it is seen: nine images, and nothing behind other cells.
    landed = pl.camera.landing_points(camera, (0.0, 0.0, -499.0), rays=1 << 15)
    assert len(np.unique(landed.index, axis=0)) == 9
    assert np.abs(landed.position - 10.0 * landed.index).max() < 5.0
    open_camera = with_array(camera, walls=pl.optics.Walls.NONE)
    assert np.abs(pl.camera.landing_points(open_camera, (0.0, 0.0, -20.0)).position).max() > 5.0
    projection = camera.project((0.0, 0.0, -499.0))
    projection = projection.selected(projection.visible)
    assert len(projection) == 9 and np.allclose(projection.position, 10.0 * projection.index * (1 + 8.2 / 500.0))


def test_small_pixel_openings_see_the_middle_and_their_share():
    half, third = (camera_with(pixels={"pixel_aperture": part}) for part in ((0.5, 0.8), (1 / 3, 1 / 3)))
    agree(white(half, 256), white(CAMERA, 256, seed=1), 0.4, relative=2e-3)
    # A pixel three times as fine and in the middle of a coarse one sees what the coarse one's opening sees.
    fine = dataclasses.replace(CAMERA, sensor=pl.Sensor(shape=(1536, 1536), pixel_pitch=0.010 / 3))
    coarse_shot, fine_shot = white(third, 1024, np.s_[233:247, 233:247]), white(fine, 1024, np.s_[699:741, 699:741], 1)
    (coarse, error), (middle, its_error) = total(coarse_shot), total(fine_shot, np.s_[1::3, 1::3])
    assert abs(9 * coarse - middle) < 4 * math.hypot(9 * error, its_error)


def test_angular_response_weighs_directions():
    # A tiny pupil: each pixel is lit from one direction.
    response = pl.sensor.AngularResponse(well_depth=1.2, index=1.4, pupil_distance=90.0, exponent=2.0)
    lens = the_lens(1.0, pl.LensModel.THIN)
    straight = pl.PlenopticCamera(lens=lens, sensor=pl.Sensor((24, 24), pixel_pitch=2.0), stop_to_microlenses=60.0)
    moved = straight.moved(pl.CameraPart.SENSOR, shift=(1.0, -2.0, 3.0), tilt=(0.1, -0.2, 0.4))
    pupil = np.array([0.0, 0.0, pl.paraxial.cardinal_points(lens, 587.6).rear_principal])
    on_sensor = straight.sensor.centre_of(*np.mgrid[:24, :24])
    for camera in (straight, moved):
        seeing = dataclasses.replace(camera, sensor=dataclasses.replace(camera.sensor, angular_response=response))
        turn, shift = (np.eye(3), np.zeros(3))
        if camera is moved:
            turn, shift = (np.asarray(getattr(camera.sensor_placement, name)) for name in ("rotation", "shift"))
        points = np.concatenate([on_sensor, np.zeros((24, 24, 1))], axis=-1) @ turn.T + shift + [0, 0, camera.z_sensor]
        rays = (pupil - points) @ turn
        expected = response.at(
            rays[..., 0] / -rays[..., 2], rays[..., 1] / -rays[..., 2], x=on_sensor[..., 0], y=on_sensor[..., 1]
        )
        measured = white(seeing, 1024, None).image[..., 0] / white(camera, 1024, None).image[..., 0]
        # Pixels are 2 mm wide at 60 mm and the response is not linear across them: a few tenths of a per cent.
        inner = expected > 0.2
        assert inner.sum() > 300
        assert measured[inner] == pytest.approx(expected[inner], rel=0.02)


def test_dust_on_the_rear_lens_is_an_obstacle_in_the_pupil():
    # A conventional camera, stop at the rear: an opaque grain on the last vertex's plane takes its share of the beam.
    grain = pl.Blemishes(pl.BlemishSite.LENS_REAR, [(0.0, 0.0)], [(0.0, 0.0)], [2.0], [0.0])
    camera = pl.PlenopticCamera(lens=LENS, sensor=pl.Sensor((8, 8), 0.01), stop_to_microlenses=134.6)
    clean, dusty = white(camera, 1024, None), white(dataclasses.replace(camera, blemishes=(grain,)), 1024, None)
    # As seen from the axial point, the cone through the exit pupil (radius 5 x 1.552 at -5.23) is cut at 30.31.
    fraction = (camera.z_sensor - 30.31) / (camera.z_sensor + 5.233)
    beam = 5.0 * 1.5521 * fraction
    assert total(dusty)[0] / total(clean)[0] == pytest.approx(1 - (2.0 / beam) ** 2, rel=0.01)


def test_dust_on_the_front_lens_dims_as_its_transmission_says():
    grain = pl.Blemishes(pl.BlemishSite.LENS_FRONT, [(0.0, 0.0)], [(0.0, 0.0)], [30.0], [0.25])
    shot = sky(dataclasses.replace(CAMERA, blemishes=(grain,)))
    assert np.allclose(shot.image, 0.25 * sky(CAMERA).image, rtol=1e-6)


def test_dust_on_pixels_and_array_covers_its_area():
    half = pl.Blemishes(pl.BlemishSite.SENSOR, [(-100.0, 50.0)], [(100.0, 50.0)], [50.0], [0.0])
    shot, plain = (sky(each, np.s_[250:262, :]) for each in (dataclasses.replace(CAMERA, blemishes=(half,)), CAMERA))
    # Row r lies at y = (r + 1/2 - 256) pitch: rows from 256 on are covered.
    assert not shot.image[6:].any() and np.array_equal(shot.image[:6], plain.image[:6])
    lens = pl.Blemishes(pl.BlemishSite.ARRAY, [(0.0, 0.0)], [(0.0, 0.0)], [0.108], [0.0])
    covered = white(dataclasses.replace(CAMERA, blemishes=(lens,)), region=np.s_[246:266, 246:266])
    assert covered.image.sum() < 0.25 * white(CAMERA, region=np.s_[246:266, 246:266]).image.sum()


def test_dust_above_the_sensor_blurs():
    # A grain of 0.02 mm radius at 1 mm under microlenses at f/7.8: the shadow is 0.13 mm wider, and lighter.
    def shadow(height):
        grain = pl.Blemishes(pl.BlemishSite.SENSOR, [(0.0, 0.0)], [(0.0, 0.0)], [0.02], [0.0], height=height)
        region = np.s_[236:276, 236:276]
        dusty = dataclasses.replace(CAMERA, blemishes=(grain,))
        clean = white(CAMERA, 256, region).image
        lit = clean > 0.5 * clean.max()
        return (1 - white(dusty, 256, region).image / np.maximum(clean, 1e-9))[lit]

    sharp, blurred = shadow(0.0), shadow(1.0)
    assert sharp.max() > 0.99 > 0.9 > blurred.max() > 0.02
    assert (sharp > 0.01).sum() < (blurred > 0.01).sum()


def test_clean_cameras_are_as_they_were():
    nothing = pl.Blemishes(pl.BlemishSite.SENSOR, [], [], [], [])
    assert np.array_equal(white(dataclasses.replace(CAMERA, blemishes=(nothing,))).image, white(CAMERA).image)
    grain = pl.Blemishes(pl.BlemishSite.SENSOR, [(0.0, 0.0)], [(0.0, 0.0)], [0.1], [0.0])
    assert dataclasses.replace(CAMERA, blemishes=grain).blemishes == (grain,)
    with refused("in front of the sensor"):
        dataclasses.replace(CAMERA, blemishes=(pl.Blemishes(pl.BlemishSite.SENSOR, [], [], [], [], height=1.8),))
