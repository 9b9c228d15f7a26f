"""Renders of cameras whose light bends at microlenses and iris, against closed forms."""

import dataclasses
import functools
import math

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import plenoptic as pl
from plenoptic.errors import InvalidValueError
from plenoptic.optics import ApertureShape, Gaps, MicrolensAperture
from plenoptic.rendering import Stage

CIRCLE, SQUARE = ApertureShape.CIRCLE, ApertureShape.SQUARE
ROUND, FILLED = MicrolensAperture(CIRCLE, math.pi / 4), MicrolensAperture(SQUARE, 1.0)
PIXELS = 20
"""Pixels of a microlens along a side: whatever leaves a pixel lands between there and the neighbours' images."""
CAMERAS = {"R12": (2.4, 5.5e-3, 0.767, 0.778), "README": (7.8, 10e-3, 0.648, 0.664)}
CAMERAS |= {"Illum": (2.0, 1.4e-3, 0.479, 0.503), "microscope": (20.0, 7.4e-3, 0.252, 0.291)}
"""f-numbers of microlenses, pixel pitches in mm, light that stays in its pixel by round and by square ones."""


def slow(value):
    return pytest.param(value, marks=pytest.mark.slow)


def lit_square(number, pitch, aperture, *, part=1.0, across=PIXELS, size=2 * PIXELS + 1):
    """A camera without a lens whose microlenses image a square opening, sharply, onto `part` pixels in their middle."""
    width, distance = across * pitch, 100.0
    height = number * width
    half = 0.5 * part * pitch * distance / height
    hole = [pl.PolygonStop(4, half * math.sqrt(2), math.pi / 4), pl.Surface(math.inf, semi_diameter=4 * half)]
    lens, focal_length = pl.LensStack(hole, model=pl.LensModel.NONE), 1 / (1 / height + 1 / distance)
    array = pl.MicrolensArray(width, (focal_length,), pl.Lattice.SQUARE, aperture=aperture)
    camera = pl.PlenopticCamera(lens, pl.Sensor((size, size), pitch), distance, array, height, wavelength=550.0)
    return dataclasses.replace(camera, diffraction=pl.Diffraction())


def straight(camera):
    """The same camera without diffraction."""
    return dataclasses.replace(camera, diffraction=None)


def white(camera, samples, **more):
    """Image and standard error of even light."""
    shot = pl.render_white(camera, samples=samples, progress=False, **more)
    return shot.image.squeeze().astype(float), shot.standard_error.squeeze().astype(float)


@pytest.mark.parametrize("name", [slow("R12"), "README", slow("Illum"), slow("microscope")])
def test_the_share_of_light_that_stays_in_its_pixel_and_contrast_at_the_nyquist_frequency(name):
    # The integral of the aperture's MTF times the pixel's squared; the image without bends is known in closed form.
    number, pitch, *shares = CAMERAS[name]
    for aperture, fraction in zip((ROUND, FILLED), shares, strict=True):
        camera, middle = lit_square(number, pitch, aperture), np.s_[PIXELS : PIXELS + 1, PIXELS : PIXELS + 1]
        image, error = white(camera, 1 << 13, replicates=16, region=middle)
        # The integral of cos^4 over the lens: 1 - 2 <r^2> / f^2.
        whole = (math.pi / 4 if aperture is ROUND else 1.0) / number**2
        whole *= 1 - 2 * (1 / 8 if aperture is ROUND else 1 / 6) / number**2
        assert float(error) < 0.003 * whole
        assert float(image) / whole == pytest.approx(fraction, abs=0.01), aperture
    # Sharp squares one pixel wide in a lattice of six, on pixels a quarter as wide: 24 of these are a period.
    camera = lit_square(number, pitch / 4, ROUND, part=4.0, across=24, size=48)
    image, error = (a[12:36, 12:36] for a in white(camera, 4096, replicates=8))
    # Light from beyond the rim of the sensor is missing, evenly: what a period has without bends tells all of it.
    total = white(straight(camera), 256)[0][12:36, 12:36].sum()
    # What neighbours share, they err in together.
    noise = 2 * float(np.linalg.norm(error)) / total
    assert noise < 0.006
    # Of the squares' spectrum what pixels fold onto this frequency, 1/8.
    f = 1 / 8 + np.arange(-4, 5)
    part = np.minimum(np.abs(f) * 550e-6 * number / (pitch / 4), 1.0)
    mtf = 2 / math.pi * (np.arccos(part) - part * np.sqrt(1 - part**2))
    contrast = image.sum(axis=0) @ np.cos(np.pi * (np.arange(24) - 11.5) / 4) / total
    # The closed form is of small angles; for R12 its contrast is 0.0013 smaller, with any number of samples.
    assert contrast == pytest.approx(float(mtf @ (np.sinc(4 * f) * np.sinc(f))), abs=0.002 + 3 * noise)


@pytest.mark.parametrize("aperture", [ROUND, slow(FILLED), slow(MicrolensAperture(CIRCLE, 0.5, Gaps.CLEAR))])
def test_no_light_is_lost_between_microlenses(aperture):
    # Over a period of the lattice as much comes in as goes out, but for what comes from beyond the sensor: by Airy's
    # tail and that of a square, no more than 2 lambda N / (pi^2 d) beyond a distance d.
    camera = lit_square(7.8, 0.01, aperture, part=12.0, size=4 * PIXELS + 1)
    period = (slice(3 * PIXELS // 2, 5 * PIXELS // 2),) * 2
    bent, error = white(camera, 256, replicates=8)
    plain, other = white(straight(camera), 256, replicates=8)
    total, sigma = plain[period].sum(), math.hypot(*(np.linalg.norm(e[period]) for e in (error, other)))
    missing = 2 * 550e-6 * 7.8 / (math.pi**2 * 0.01 * (3 * PIXELS / 2 + 8))
    assert sigma < 0.004 * total
    # Neighbours err together.
    assert bent[period].sum() == pytest.approx(total * (1 - missing / 2), abs=6 * sigma + total * missing / 2)
    assert np.abs(bent - plain).max() > 0.05 * plain.max()


def test_tails_reach_far_pixels():
    # From 12 x 12 lit pixels to a ring 30 pixels away: beyond what is known with a pixel, by the bounds of its point.
    camera = lit_square(7.8, 0.01, ROUND, part=12.0, size=75)
    array = dataclasses.replace(camera.microlenses, lattice=pl.Lattice.FREE, centres=[(0.0, 0.0)])
    image, error = white(dataclasses.replace(camera, microlenses=array), 1 << 12, replicates=16)
    row, column = np.indices(image.shape) - 37
    ring = np.abs(np.hypot(row, column) - 30) < 4
    # Airy's tail: the mean of J1^2 / (pi r^2) is lambda N / (pi^3 r^3).
    steps = np.arange(12) - 5.5
    r2 = (row[ring][:, None, None] - steps[:, None]) ** 2 + (column[ring][:, None, None] - steps) ** 2
    tail = math.pi / 4 / 7.8**2 * 550e-6 * 7.8 / (math.pi**3 * 0.01) * float((r2**-1.5).sum())
    sigma = float(np.linalg.norm(error[ring]))
    assert sigma < 0.05 * tail
    assert image[ring].sum() == pytest.approx(tail, abs=4 * sigma + 0.02 * tail)


def small_camera(**more):
    """Three by three microlenses of the README's camera."""
    camera, sensor = pl.camera.example_camera(), pl.Sensor(shape=(64, 64), pixel_pitch=0.01)
    lens = camera.lens.with_stop(pl.CircularStop(8.0))
    return dataclasses.replace(camera, **{"lens": lens, "sensor": sensor, "diffraction": pl.Diffraction(), **more})


def test_bits_do_not_depend_on_tiles_threads_and_regions():
    camera, scene = small_camera(), pl.check_scene()
    whole = pl.render(scene, camera, samples=8, threads=1, progress=False)
    other = pl.render(scene, camera, samples=8, threads=2, tile_side=24, progress=False)
    part = pl.render(scene, camera, samples=8, region=np.s_[10:30, 20:50], progress=False)
    for name in ("image", "standard_error", "depth"):
        assert_array_equal(getattr(other, name), getattr(whole, name))
        assert_array_equal(getattr(part, name), getattr(whole, name)[10:30, 20:50])
    assert_array_equal(pl.render(scene, straight(camera), samples=8, progress=False).depth, whole.depth)
    for more in ({"tile_side": 24}, {"region": np.s_[10:30, 20:50]}):
        part, plain = more.get("region", ...), white(pinhole_camera(), 8, replicates=8)
        for values, expected in zip(white(pinhole_camera(), 8, replicates=8, **more), plain, strict=True):
            assert_array_equal(values, expected[part])


def pinhole_camera(size=64):
    """Micro images of 7 pixels, 41 pixels apart: only deflected light comes between them."""
    lens = pl.load_lens("cooke-triplet-50mm-f5").with_stop(pl.CircularStop(0.5))
    array = pl.MicrolensArray(0.2, (1.5,), pl.Lattice.HEXAGONAL)
    camera = pl.PlenopticCamera(lens, pl.Sensor((size, size), 0.005), 50.0, array, 1.5).focused_at(z=-500.0)
    return dataclasses.replace(camera, diffraction=pl.Diffraction())


@pytest.mark.parametrize("seeds", [8, slow(24)])
def test_no_pixel_is_certain_and_errors_are_true_in_the_dark(seeds):
    # Intervals of 95 %, 2.365 standard errors by Student's distribution of eight replicates, in classes of brightness.
    # These have 70 pixels or more, which err together; eight seeds know the share to some 0.02.
    camera = pinhole_camera()
    truth, error = white(camera, 256 * seeds, replicates=16, seed=99)
    classes = np.digitize(truth / truth.max(), [1e-4, 1e-3, 1e-2, 1e-1])
    tolerance = 0.0 if seeds == 24 else 0.02
    for replicates in (2, 8):
        shots = [white(camera, 64, replicates=replicates, seed=seed) for seed in range(seeds)]
        assert all((stated > 0).all() for _, stated in shots)
        covered = np.mean([np.abs(i - truth) <= 2.365 * np.hypot(stated, error) for i, stated in shots], axis=0)
        coverage = [float(covered[classes == k].mean()) for k in range(1, 5)]
        assert min(coverage) > 0.9 - tolerance and max(coverage) < 0.98 + tolerance, (replicates, coverage)


@pytest.mark.parametrize("samples", [512, slow(2048)])
def test_light_from_microlenses_around_the_sensor_reaches_the_dark(samples):
    # Pixels in the middle of a larger sensor get all of it. 0.10 to 0.16 were lost when 8 pixels around were followed.
    # `pytest -rP -m slow -k around_the_sensor` prints the loss between micro images, and on their flanks.
    (image, error), (whole, other) = (
        white(pinhole_camera(size), samples, replicates=8, seed=size, region=np.s_[k : k + 64, k : k + 64])
        for size, k in ((64, 0), (664, 300))
    )
    level = (image + whole) / (2 * whole.max())
    for low, high in ((0.0, 0.01), (0.01, 0.1)):
        part = (level >= low) & (level < high)
        sigma = 2 * math.hypot(*(np.linalg.norm(e[part]) for e in (error, other))) / whole[part].sum()  # err together
        loss = 1 - image[part].sum() / whole[part].sum()
        print(f"{low:g} to {high:g} of the maximum, {part.sum()} pixels: loss {100 * loss:.2f} +- {100 * sigma:.2f} %")
        assert sigma < 0.02 and abs(loss) < 0.01 + 2 * sigma


def test_deflections_do_not_depend_on_the_times_of_paths():
    # A curtain shuts in the middle of the exposure, before square openings. As much light reaches the rows above as
    # those below, beyond the kernel, whose light is not drawn.
    camera = lit_square(*CAMERAS["microscope"][:2], FILLED)
    curtain = pl.quad((1000, -50, -200), (4000, 0, 0), (0, 100, 0), material=pl.Lambertian(0.0))
    motion = pl.Motion.screw((0, 1), axis=(-1, 0, 0), advance=2000.0)
    scene = pl.Scene([dataclasses.replace(curtain, name="curtain")], background=1.0)
    camera = dataclasses.replace(camera, shutter=pl.sequences.Shutter(1.0))
    frame = pl.Sequence(scene, camera, [0.5], motions={"curtain": motion})[0]
    shot = pl.render(frame.scene, frame.camera, samples=4096, replicates=16, progress=False, truth=pl.Truth.NONE)
    image, error = shot.image[..., 0].astype(float), shot.standard_error[..., 0].astype(float)
    parts = (np.s_[PIXELS - 9 : PIXELS - 3], np.s_[PIXELS + 4 : PIXELS + 10])
    above, below = (image[part].sum() for part in parts)
    sigma = 2 * math.hypot(*(np.linalg.norm(error[part]) for part in parts))
    assert sigma < 0.2 * above
    assert above == pytest.approx(below, abs=4 * sigma)


def test_points_are_spread_as_surfaces_are_rendered():
    # Light forwards from points all over a small lamp, and backwards from pixels to it.
    camera, side, at = small_camera(diffraction=pl.Diffraction(iris=True)), 1.2, np.array([0.6, -0.3, -404.0])
    lamp = pl.quad(at - [side / 2, side / 2, 0], (side, 0, 0), (0, side, 0), material=pl.Emissive(1.0))
    shot = pl.render(pl.Scene([lamp]), camera, samples=512, replicates=16, progress=False, truth=pl.Truth.NONE)
    parts = np.random.default_rng(3).uniform(-0.5, 0.5, (4, 40, 2))
    references = []
    for part in parts:
        points = at + side * np.column_stack([part, np.zeros(len(part))])
        references.append(pl.point_spread(camera, points, rays=1 << 10, progress=False).whole().mean(axis=0) * side**2)
    image, error = (a[..., 0] for a in (shot.image, shot.standard_error))
    mean, scatter = np.mean(references, axis=0), np.std(references, axis=0, ddof=1) / 2
    bright = mean > 0.2 * mean.max()
    assert image.sum() == pytest.approx(mean.sum(), rel=0.01)
    chi = (image - mean)[bright] / np.hypot(error[bright], np.maximum(scatter[bright], np.median(scatter[bright])))
    assert float(np.sqrt((chi**2).mean())) < 1.3


def test_an_iris_spreads_a_point_as_airy_says():
    # An ideal lens focused on a far point: 83.8 % and 91.0 % of the light within the first two dark rings.
    lens = dataclasses.replace(pl.load_lens("double-gauss-100mm-f2"), model=pl.LensModel.THIN)
    lens = lens.with_stop(pl.CircularStop(1.5))
    points = pl.paraxial.cardinal_points(lens, 550.0)
    distance = 1e6
    image = 1 / (1 / points.efl - 1 / distance)
    sensor, optics = pl.Sensor((201, 201), 0.002), {"wavelength": 550.0, "diffraction": pl.Diffraction(iris=True)}
    camera = pl.PlenopticCamera(lens, sensor, points.rear_principal + image, **optics)
    spread = pl.point_spread(camera, (0.0, 0.0, points.front_principal - distance), rays=1 << 18, progress=False)
    ring = 550e-6 * image / (2 * points.entrance_pupil_semi_diameter)
    row, column = np.indices((201, 201)) - 100
    radius, light = 0.002 * np.hypot(row, column), spread.whole()
    for dark, part in ((1.2197, 0.8378), (2.2331, 0.9099), (3.2383, 0.9376)):
        assert light[radius < dark * ring].sum() / light.sum() == pytest.approx(part, abs=0.012)
    assert pl.plan(None, camera).runs(Stage.DIFFRACTION)


def test_colours_bend_by_their_wavelengths():
    camera = small_camera(sensor=pl.Sensor((24, 24), 0.01), sensitivity=pl.sensitivities.linear_srgb())
    camera = dataclasses.replace(camera, lens=camera.lens.with_stop(pl.CircularStop(1.0)))
    image = pl.render_white(camera, samples=2048, replicates=8, progress=False).image
    plain = pl.render_white(straight(camera), samples=512, replicates=8, progress=False).image
    dark = plain.max(axis=2) < 0.01 * plain.max()
    red, green, blue = image[dark].sum(axis=0) / image.sum(axis=(0, 1))
    assert red > 1.05 * green > 1.05**2 * blue > 0.01


def test_paths_can_be_followed_again():
    # Those whose light pixels share run as without bends.
    camera, scene, radiances = small_camera(), pl.check_scene(), []
    for each in (camera, straight(camera)):
        shot = pl.render(scene, each, samples=16, replicates=2, progress=False)
        radiances.append(pl.replaying.replay_all(shot, scene, [(30, 31, sample) for sample in range(16)]))
    for bent, plain in zip(*radiances, strict=True):
        assert bent.events == plain.events
        assert_array_equal(bent.contribution, plain.contribution)


def test_what_has_no_pattern_is_refused():
    array = functools.partial(pl.MicrolensArray, 0.217, (2.0,))
    for more, words in (
        ({"diffraction": True}, "must be a Diffraction or None"),
        ({"microlenses": None, "microlenses_to_sensor": 0.0}, "without microlenses"),
        ({"microlenses": array(pl.Lattice.FREE, centres=[(0.0, 0.0)])}, "give the array an aperture"),
        ({"microlenses": array(model=pl.optics.MicrolensModel.PINHOLE)}, "take THIN ones"),
        ({"microlenses": array(walls=pl.optics.Walls.OPAQUE)}, "walls"),
    ):
        with pytest.raises(InvalidValueError, match=words):
            small_camera(**more)
    # Points through openings and beside them.
    camera = small_camera(microlenses=array(aperture=MicrolensAperture(CIRCLE, 0.7, Gaps.CLEAR)))
    with pytest.raises(InvalidValueError, match="render the point"):
        pl.point_spread(camera, (0.0, 0.0, -404.0), progress=False)
