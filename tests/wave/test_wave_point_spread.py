"""Images of points as waves: laws of energy and symmetry, Airy's patterns, rays as the limit, direct sums, stacks."""

import dataclasses
import json
import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.analysis.best_focus import paraxial_focus
from plenoptic.optics.lens.waves.wavefront import wavefront
from plenoptic.wave.beam import beam_of
from plenoptic.wave.field import plane_waves, through_array, to_sensor
from plenoptic.wave.grid import OVERSAMPLING, grid_for, lit_box
from plenoptic.wave.microlenses import microlenses_around
from plenoptic.wave.point_image import _add_images, _image_at

SPHERICAL, FLAT = pl.optics.MicrolensModel.SPHERICAL, pl.optics.MicrolensModel.FLAT_HIGH_INDEX
GLASS = pl.ConstantMedium(1.5)
DEVIATIONS = pl.optics.MicrolensDeviations(
    index=[(-12, 7), (-11, 7)], decentre=[(0.01, 0.0), (0.0, 0.0)], transmission=[1.0, 0.0]
)
ASIDE = (1.3, -0.7, -100.0)
LIT = np.stack(np.meshgrid(np.arange(-24, -3), np.arange(-3, 18)), axis=-1).reshape(-1, 2)
"""Microlenses of `square_array` that `ASIDE` lights."""


def singlet(model=pl.LensModel.PARAXIAL, stop=4.0, before=1.0):
    front = pl.Surface(50.0, 4.0, GLASS, semi_diameter=12.0)
    elements = [pl.CircularStop(stop, before), front, pl.Surface(-50.0, semi_diameter=12.0)]
    return pl.LensStack(elements).with_model(model)


def telecentric(model=pl.LensModel.PARAXIAL, stop=4.0):
    """The iris in the front focal plane."""
    return singlet(model, stop, 1.0 - pl.paraxial.cardinal_points(singlet()).front_focus)


def square_array(pitch=0.1, focal_length=1.0, lattice=pl.Lattice.SQUARE, **other):
    return pl.MicrolensArray(pitch=pitch, focal_lengths=(focal_length,), lattice=lattice, **other)


def small_camera(lens=None, array=None, z=100.0, b=0.8, pixel=0.01, count=300, **other):
    """Focused on z = -102, with spots of some six microlenses across of points at z = -100."""
    return pl.PlenopticCamera(
        lens=singlet() if lens is None else lens,
        microlenses=square_array() if array is None else array,
        sensor=pl.Sensor(shape=(count, count), pixel_pitch=pixel),
        stop_to_microlenses=z,
        microlenses_to_sensor=b,
        **other,
    )


def bare_camera(z, pixel, lens=None, count=200, **other):
    sensor = pl.Sensor(shape=(count, count), pixel_pitch=pixel)
    return pl.PlenopticCamera(lens=singlet() if lens is None else lens, sensor=sensor, stop_to_microlenses=z, **other)


def off(image, other):
    """Light in other places, over that of the second image."""
    return float(np.abs(image - other).sum() / other.sum())


def airy(count, scale):
    """Over its peak, in (count, count) pixels of 1 um, for k times the sine of the half angle; to 1e-4 of it."""
    inner = (np.arange(5 * count) + 0.5) / 5 * 0.001 - 0.0005 * count
    r = np.hypot(inner, inner[:, None])
    v = np.linspace(1e-9, scale * r.max(), 1 << 12)
    tau = (np.arange(256) + 0.5) * math.pi / 256
    bessel = np.cos(tau - v[:, None] * np.sin(tau)).mean(axis=-1)
    return np.interp(scale * r, v, (2 * bessel / v) ** 2).reshape(count, 5, count, 5).mean(axis=(1, 3))


@pytest.fixture(scope="module")
def aside():
    return pl.wave.point_spread(small_camera(), ASIDE)


def test_all_light_is_accounted_for():
    opening, gaps = pl.optics.MicrolensAperture, pl.optics.Gaps
    clear = opening(fill_factor=0.8, gaps=gaps.CLEAR)
    for array in (
        square_array(),
        square_array(model=SPHERICAL),
        square_array(aperture=opening(pl.optics.ApertureShape.CIRCLE, fill_factor=0.7)),
        pl.MicrolensArray(pitch=0.1, focal_lengths=(1.0, 1.3, 1.6), model=SPHERICAL, aperture=clear),
    ):
        spread = pl.wave.point_spread(small_camera(array=array, count=400), ASIDE)
        sampling = spread.samplings[0]
        expected = (1 - sampling.beside) * (1 - sampling.stopped) * (1 - sampling.lost)
        # Slopes weigh light by cos^4 before and after microlenses: by at most twice the square of the largest slope.
        assert spread.landed == pytest.approx(expected, abs=1e-4 if array.is_plate else 2 * 0.1**2), array
        opaque = array.aperture is not None and array.aperture.gaps is gaps.OPAQUE
        # Over some 30 microlenses, of which those on the spot's rim are lit in part.
        assert sampling.stopped == pytest.approx(1 - array.aperture.fill_factor if opaque else 0.0, abs=0.02), array


def test_light_of_the_lens_is_that_of_rays():
    camera = bare_camera(100.0, 0.02)
    traced = pl.point_spread(camera, ASIDE, progress=False)
    assert pl.wave.point_spread(camera, ASIDE).light == pytest.approx(traced.light, rel=1e-3)


def test_wavelengths_add_up_by_weight(aside):
    camera, waves = small_camera(), (aside.wavelengths[0], 700.0)
    one, other = aside.whole(), pl.wave.point_spread(camera, ASIDE, wavelengths=700.0).whole()
    both = pl.wave.point_spread(camera, ASIDE, wavelengths=waves, weights=(1.0, 3.0))
    assert np.allclose(both.whole(), 0.25 * one + 0.75 * other, rtol=0, atol=1e-12 * one.max())
    assert both.wavelengths.tolist() == list(waves) and both.weights.tolist() == [0.25, 0.75]


def test_what_is_symmetric_stays_so():
    camera = small_camera(array=square_array(lattice=pl.Lattice.HEXAGONAL))
    image = pl.wave.point_spread(camera, (0.0, 0.0, -100.0)).whole()
    # Fields are float32: some hundred roundings.
    assert off(image[::-1], image) < 1e-3 and off(image[:, ::-1], image) < 1e-3


def test_an_array_moved_by_its_pitch_is_the_same(aside):
    moved = small_camera().moved(pl.CameraPart.MICROLENSES, shift=(0.1, -0.2, 0.0))
    assert off(pl.wave.point_spread(moved, ASIDE).whole(), aside.whole()) < 1e-4


def test_behind_a_telecentric_lens_a_pitch_moves_the_image():
    camera = small_camera(telecentric(), z=126.0)
    step = 0.1 / abs(pl.paraxial.magnification(camera.lens, -100.0))
    first, second = (pl.wave.point_spread(camera, (x, 0.0, -100.0)).whole() for x in (0.3, 0.3 + step))
    assert off(np.roll(first, 10, axis=1), second) < 2e-3


def test_in_focus_the_pattern_is_airys():
    lens = singlet()
    points = pl.paraxial.cardinal_points(lens)
    z = points.rear_principal + 1.0 / (1.0 / points.efl - 1.0 / (points.front_principal + 100.0))
    camera = bare_camera(z, 0.001, wavelength=550.0)
    spread = pl.wave.point_spread(camera, (0.0, 0.0, -100.0))
    sine = math.sin(math.atan(points.exit_pupil_semi_diameter / (z - points.exit_pupil)))
    # The peak of the light E is E pi NA^2 / wavelength^2.
    expected = airy(200, 2 * math.pi / 550e-6 * sine) * spread.light * math.pi * sine**2 / 550e-6**2
    # The edge of the opening is known to a quarter of a step of directions, of which 48 lie across.
    assert np.abs(spread.whole() - expected).max() < 5e-3 * expected.max()


def test_an_evenly_lit_microlens_makes_its_airy_pattern():
    aperture = pl.optics.MicrolensAperture(pl.optics.ApertureShape.CIRCLE, fill_factor=0.5)
    array = square_array(pitch=0.12, focal_length=1.0, aperture=aperture)
    camera = small_camera(array=array, z=92.0, pixel=0.001, count=100, wavelength=550.0)
    beam = beam_of(camera, np.array([0.0, 0.0, -100.0]))
    # The sensor where the microlens images the focus.
    b = 1.0 / (1.0 + 1.0 / beam.focus[2])
    camera = dataclasses.replace(camera, microlenses_to_sensor=b)
    image = pl.wave.point_spread(camera, (0.0, 0.0, -100.0)).whole()
    middle = image[50 - 20 : 50 + 20, 50 - 20 : 50 + 20]
    # A converging beam passes the opening: on the sensor the pattern is that of the converging light's slope.
    expected = airy(40, 2 * math.pi / 550e-6 * array.opening.radius / b)
    expected *= middle.sum() / expected.sum()
    # Ripples behind the edge of the main lens, and what neighbours send: some per cent in amplitude.
    assert np.abs(middle - expected).max() < 0.02 * expected.max()


@pytest.mark.parametrize(
    "lens, array",
    [
        (pl.LensModel.EXACT, {"model": SPHERICAL}),
        pytest.param(pl.LensModel.THIN, {}, marks=pytest.mark.slow),
        pytest.param(pl.LensModel.EXACT, {"model": FLAT, "index": 100.0}, marks=pytest.mark.slow),
    ],
)
def test_rays_are_the_limit_of_short_waves(lens, array):
    far = []
    for wavelength in (600.0, 150.0):
        camera = small_camera(singlet(lens), square_array(**array), wavelength=wavelength)
        traced = pl.point_spread(camera, ASIDE, progress=False)
        spread = pl.wave.point_spread(camera, ASIDE)
        far.append(off(spread.whole(), traced.whole()))
    # Diffraction reaches as far as the wavelength is long; a pixel takes 10 um of it.
    assert far[1] < 0.4 * far[0] and far[1] < 0.16


def test_light_goes_in_the_mean_where_rays_go():
    part = pl.CameraPart
    oblong = small_camera(array=square_array((0.1, 0.13), lattice=pl.Lattice.RECTANGULAR))
    for camera in (
        small_camera(array=square_array(imperfections=DEVIATIONS)).moved(
            part.SENSOR, shift=(0.05, -0.02, 0.0), tilt=(0.0, 0.0, 0.3)
        ),
        oblong.moved(part.MICROLENSES, tilt=(0.0, 0.0, 0.3)).moved(
            part.LENS, shift=(0.2, 0.1, 0.3), tilt=(0.01, -0.02, 0.0)
        ),
    ):
        traced = pl.point_spread(camera, ASIDE, rays=1 << 16, progress=False)
        image = pl.wave.point_spread(camera, ASIDE).whole()
        centroid = np.tensordot(image, camera.sensor.centre_of(*np.indices(image.shape)), 2) / image.sum()
        # Some 1 % of the light is diffracted beside what is looked at: its mean is known to half a spot, 0.3 mm.
        assert np.abs(centroid - traced.centroid).max() < 3e-3, camera.microlenses


def test_listed_centres_are_those_of_the_lattice(aside):
    free = square_array(lattice=pl.Lattice.FREE, centres=0.1 * LIT)
    listed = pl.wave.point_spread(small_camera(array=free), ASIDE)
    # Cells could be larger: other samples are taken.
    assert off(listed.whole(), aside.whole()) < aside.samplings[0].error


def test_microlenses_that_pass_a_quarter_show_a_quarter(aside):
    dim = pl.optics.MicrolensDeviations(index=LIT, transmission=np.full(len(LIT), 0.25))
    found = pl.wave.point_spread(small_camera(array=square_array(imperfections=dim)), ASIDE)
    # At corners of cells parts add up to a little more, which does not pass where all of the rest does.
    assert off(found.whole(), 0.25 * aside.whole()) < 1e-3


def fields(camera, point):
    """Beam, grid, and the field behind the array and on the sensor, with the grid's carrier."""
    beam = beam_of(camera, np.array(point))
    lenses = microlenses_around(beam.record, *lit_box(beam))
    grid = grid_for(beam, lenses, beam.record.parts.distance, OVERSAMPLING)
    waves = through_array(plane_waves(beam, grid).waves, beam, grid, lenses).waves
    behind = np.fft.ifft2(waves, norm="ortho").copy()
    to_sensor(waves, beam, grid)
    return beam, grid, behind, np.fft.ifft2(waves, norm="ortho")


def denser_by(factor, field):
    """The field at so many times more places along both axes."""
    n, m = field.shape
    waves = np.fft.fftshift(np.fft.fft2(field))
    rows, columns = (factor - 1) * n // 2, (factor - 1) * m // 2
    padded = np.pad(waves, ((rows, (factor - 1) * n - rows), (columns, (factor - 1) * m - columns)))
    return np.fft.ifft2(np.fft.ifftshift(padded)) * factor**2


@pytest.mark.slow
def test_propagation_is_rayleighs_and_sommerfelds_sum():
    array = square_array(pitch=0.06, focal_length=0.4, model=SPHERICAL, thickness=0.05)
    camera = small_camera(singlet(stop=5.0), array, z=101.5, b=0.35, wavelength=550.0)
    beam, grid, behind, arriving = fields(camera, (1.0, -0.6, -100.0))
    # The kernel must be sampled too, at all slopes at which the grid's far side is seen.
    times, k = 4, 2 * math.pi / beam.wavelength
    x, y = (grid.first[axis] + grid.spacing[axis] / times * np.arange(times * grid.shape[axis]) for axis in (0, 1))
    field = denser_by(times, behind) * np.exp(1j * k * (grid.carrier[0] * x + grid.carrier[1] * y[:, None]))
    rows, columns = (np.linspace(part.start + 2, part.stop - 3, 7).astype(int) for part in grid.valid[::-1])
    brightest = np.unravel_index(np.abs(arriving).argmax(), arriving.shape)
    for row, column in [brightest, (rows[2], columns[4])]:
        position = grid.first + grid.shift + grid.spacing * np.array([column, row])
        r = np.sqrt(grid.distance**2 + (position[0] - x) ** 2 + ((position[1] - y) ** 2)[:, None])
        kernel = grid.distance / r * (1 / r - 1j * k) * np.exp(1j * k * r) / r / (2 * math.pi)
        direct = abs((field * kernel).sum()) * grid.spacing.prod() / times**2
        assert abs(abs(arriving[row, column]) - direct) < 1e-3 * np.abs(arriving).max()


def test_the_field_on_the_array_is_huygens_sum():
    lens, point = singlet(pl.LensModel.EXACT, stop=3.0), np.array([1.0, 0.5, -100.0])
    sharp = pl.aberrations.wavefront(lens, z_object=-100.0, wavelength=550.0).z_image
    for z in (sharp, sharp + 0.4):
        options = {"field": (1.0, 0.5), "z_object": -100.0, "z_image": z, "wavelength": 550.0}
        waves = wavefront(lens, pupil=pl.aiming.square_grid(128), **options)
        beam = beam_of(bare_camera(z, 0.01, lens=lens, wavelength=550.0), point)
        grid = grid_for(beam, None, 0.0, OVERSAMPLING)
        field = np.abs(np.fft.ifft2(plane_waves(beam, grid).waves, norm="ortho")) ** 2
        x, y = (grid.positions(axis, slice(0, n)) for axis, n in enumerate(grid.shape))
        rows, columns = (np.abs(part - middle) < 0.03 for part, middle in ((y, waves.image[1]), (x, waves.image[0])))
        near = field[np.ix_(rows, columns)]
        offsets = np.stack(np.meshgrid(x[columns], y[rows]), axis=-1) - waves.image[:2]
        summed = waves.point_spread(np.concatenate([offsets, np.zeros((*offsets.shape[:2], 1))], axis=-1))
        # Edges are known to a part of a step; with the defocus, that of the pupil is a place on its sphere.
        assert np.abs(near / near.max() - summed / summed.max()).max() < 1e-2, z


@pytest.mark.parametrize("array", [{}, pytest.param({"model": SPHERICAL}, marks=pytest.mark.slow)])
def test_twice_as_dense_samples_agree_within_the_error(array):
    camera, point = small_camera(array=square_array(**array)), np.array(ASIDE)
    spread = pl.wave.point_spread(camera, point)
    dense = _add_images(camera, point, np.array([587.6]), np.ones(1), [_image_at(camera, point, 2 * OVERSAMPLING)])
    assert off(spread.whole(), dense.whole()) < spread.samplings[0].error


def test_pixels_see_through_their_openings(aside):
    camera = small_camera()
    sensor = dataclasses.replace(camera.sensor, pixel_aperture=(0.5, 1.0))
    part = pl.wave.point_spread(dataclasses.replace(camera, sensor=sensor), ASIDE)
    assert np.all(part.whole() <= aside.whole() * (1 + 1e-6) + 1e-12)
    # Spots of some 10 um lie around the middles of pixels, along x less than half a pixel wide in part.
    assert 0.5 < part.landed / aside.landed < 0.9


def test_figure_shows_the_light_of_a_point(aside):
    plt = pytest.importorskip("matplotlib.pyplot")
    ax = pl.plots.plot_camera_spread(aside)
    assert np.asarray(ax.images[0].get_array()).sum() == pytest.approx(aside.image.sum(), rel=1e-12)
    assert not ax.lines and f"{1e3 * aside.light * aside.landed:.3g} msr" in ax.get_title()
    plt.close("all")


def test_a_point_out_of_sight_is_dark():
    spread = pl.wave.point_spread(small_camera(singlet(pl.LensModel.EXACT)), (5000.0, 0.0, -5.0))
    assert spread.light == 0 and not spread.image.any() and spread.samplings == () and spread.landed == 0


def test_what_is_not_known_is_refused():
    for camera, match in (
        (small_camera(array=square_array(model=pl.optics.MicrolensModel.PINHOLE)), "PINHOLE"),
        (small_camera(array=square_array(walls=pl.optics.Walls.OPAQUE)), "walls"),
        (small_camera().moved(pl.CameraPart.SENSOR, tilt=(0.01, 0.0, 0.0)), "tilted"),
        (small_camera(singlet(stop=12.0), z=70.0), "samples"),
    ):
        with pytest.raises(InvalidValueError, match=match):
            pl.wave.point_spread(camera, (0.0, 0.0, -100.0))
    with pytest.raises(InvalidValueError, match="weights"):
        pl.wave.point_spread(small_camera(), ASIDE, wavelengths=(500.0, 600.0), weights=(1.0,))


def test_points_in_focus_of_wholly_lit_microlenses():
    """Rays that bend stand for waves; the page on diffraction has the table of where that does not hold."""
    camera, point = dataclasses.replace(pl.camera.example_camera(), diffraction=pl.Diffraction()), (7.6, 0.0, -404.0)
    wave = pl.wave.point_spread(camera, point).whole()
    bent = pl.point_spread(camera, point, rays=1 << 19, progress=False).whole()
    # Around the spots of microlenses that are lit all over.
    rays = pl.camera.landing_points(camera, point, rays=1 << 18)
    lenses, counts = np.unique(rays.index, axis=0, return_counts=True)
    row, column = np.indices(wave.shape) - 255.5
    lit = np.zeros(wave.shape, dtype=bool)
    for lens in lenses[counts > 0.99 * np.percentile(counts, 90)]:
        x, y = rays.position[(rays.index == lens).all(axis=1)].mean(axis=0) / 0.01
        lit |= np.hypot(column + x, row - y) < 11
    off_by = np.abs(bent - wave) / wave.max()
    assert lit.any() and off_by[lit].max() < 0.03
    # Of those at the edge of the light less is lit than the model has: the test is not blind.
    assert off_by[~lit].max() > 0.05
    assert bent.sum() == pytest.approx(wave.sum(), rel=0.005)


def microscope(count=101, lattice=pl.Lattice.SQUARE):
    """Telecentric towards the array, five pixels a microlens, in focus at z = -60."""
    lens = telecentric(pl.LensModel.EXACT, 1.0)
    array = square_array(0.05, 0.6, lattice)
    return small_camera(lens, array, paraxial_focus(lens, -60.0, 587.6), b=0.6, count=count)


@pytest.fixture(scope="module")
def stack():
    return pl.wave.point_spread_stack(microscope(), [-62.0, -60.0], across=3, threads=1, progress=False)


def test_patterns_are_those_of_their_points(stack):
    for place in ((0, 0, 1), (1, 2, 1)):
        single = pl.wave.point_spread(stack.camera, stack.points[place])
        (row, column), (rows, columns) = stack.corner, stack.images.shape[-2:]
        window = single.whole()[row : row + rows, column : column + columns]
        assert np.abs(window - stack.images[place]).sum() < 1e-3 * window.sum()
        assert stack.light[place] == pytest.approx(single.light, rel=1e-6)


def test_places_follow_the_image(stack):
    rows, columns = np.indices(stack.images.shape[-2:])
    images = stack.images[1]
    down, right = (np.tensordot(images, part, 2) / images.sum(axis=(-2, -1)) for part in (rows, columns))
    assert np.all(np.diff(down, axis=0) > 0) and np.all(np.diff(right, axis=1) > 0)


def test_pyolaf_gets_patterns_around_the_point(stack, tmp_path):
    pl.export.pyolaf_patterns(tmp_path, stack)
    patterns = np.load(tmp_path / "H.npy")
    assert patterns.shape[:3] == (3, 3, 2) and patterns.dtype == np.float32
    # Moved back by whole pixels, from -2 to 2.
    part = stack.camera.sensor.pixel_pitch**2 / stack.light[1, 0, 1]
    assert np.allclose(patterns[0, 1, 1][2:], part * stack.images[1, 0, 1][:-2], rtol=1e-6)
    assert np.all(patterns.sum(axis=(-2, -1)) <= 1.0)
    said = json.loads((tmp_path / "patterns.json").read_text())
    assert said["across"] == 3 and said["z_objects"] == [-62.0, -60.0]
    compile((tmp_path / "load_patterns.py").read_text(), "load_patterns.py", "exec")


def test_napari_lf_gets_coordinates_of_all_light(stack, tmp_path):
    pl.export.napari_lf_patterns(tmp_path, stack)
    database = np.load(tmp_path / "psf_db.npz")
    first, last = 0, database["ends"][0]
    assert database["places"][0].tolist() == [0, 0, 0] and len(database["places"]) == 18
    u, v, s, t = database["coordinates"][first:last].T
    rows, columns = stack.images.shape[-2:]
    pattern = np.zeros((rows, columns))
    pattern[t * 5 + v + (rows - 5) // 2, s * 5 + u + (columns - 5) // 2] = database["coefficients"][first:last]
    part = stack.camera.sensor.pixel_pitch**2 / stack.light[0, 0, 0]
    # Places (x, y) are columns, rows; what is below 1e-6 of the brightest is left out.
    assert np.allclose(pattern, part * stack.images[0, 0, 0], atol=2e-6 * database["coefficients"].max())
    assert database["z_coords"].tolist() == [-1000.0, 1000.0]
    compile((tmp_path / "load_patterns.py").read_text(), "load_patterns.py", "exec")


def test_hexagons_and_even_pixels_are_refused(stack, tmp_path):
    with pytest.raises(InvalidValueError, match="SQUARE"):
        pl.wave.point_spread_stack(microscope(lattice=pl.Lattice.HEXAGONAL), [-60.0], across=1)
    even = pl.wave.point_spread_stack(microscope(100), [-60.0], across=1, threads=1, progress=False)
    with pytest.raises(InvalidValueError, match="odd"):
        pl.export.pyolaf_patterns(tmp_path, even)
