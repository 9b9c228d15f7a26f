"""Images of points as waves: laws of energy and symmetry, Airy's patterns, rays as the limit, and direct sums."""

import dataclasses
import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.waves.wavefront import wavefront
from plenoptic.wave.beam import beam_of
from plenoptic.wave.field import plane_waves, through_array, to_sensor
from plenoptic.wave.grid import DENSER, grid_for, lit_box
from plenoptic.wave.microlenses import microlenses_around
from plenoptic.wave.patterns import _added, _of_wavelength

SPHERICAL, FLAT = pl.optics.MicrolensModel.SPHERICAL, pl.optics.MicrolensModel.FLAT_HIGH_INDEX
GLASS = pl.ConstantMedium(1.5)
DEVIATIONS = pl.optics.MicrolensDeviations(
    index=[(-12, 7), (-11, 7)], decentre=[(0.01, 0.0), (0.0, 0.0)], transmission=[1.0, 0.0]
)
ASIDE = (1.3, -0.7, -100.0)


def singlet(model=pl.LensModel.PARAXIAL, stop=4.0, before=1.0):
    front = pl.Surface(50.0, 4.0, GLASS, semi_diameter=12.0)
    elements = [pl.CircularStop(stop, before), front, pl.Surface(-50.0, semi_diameter=12.0)]
    return pl.LensStack(elements).with_model(model)


def square_array(pitch=0.1, focal_length=1.0, **other):
    given = {"lattice": pl.Lattice.SQUARE} | other
    return pl.MicrolensArray(pitch=pitch, focal_lengths=(focal_length,), **given)


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


def airy(r, scale):
    """Over its peak, at distances r, for k times the sine of the half angle; to 1e-4 of it."""
    v = np.linspace(1e-9, scale * r.max(), 1 << 12)
    tau = (np.arange(256) + 0.5) * math.pi / 256
    bessel = np.cos(tau - v[:, None] * np.sin(tau)).mean(axis=-1)
    return np.interp(scale * r, v, (2 * bessel / v) ** 2)


@pytest.fixture(scope="module")
def aside():
    return pl.wave.point_spread(small_camera(), ASIDE)


def test_all_light_is_accounted_for(aside):
    shapes, opening = pl.optics.ApertureShape, pl.optics.MicrolensAperture
    clear = opening(fill_factor=0.8, gaps=pl.optics.Gaps.CLEAR)
    for array in (
        None,
        square_array(model=SPHERICAL),
        square_array(aperture=opening(shapes.CIRCLE, fill_factor=0.7)),
        pl.MicrolensArray(pitch=0.1, focal_lengths=(1.0, 1.3, 1.6), model=SPHERICAL, aperture=clear),
    ):
        spread = aside if array is None else pl.wave.point_spread(small_camera(array=array, count=400), ASIDE)
        array = square_array() if array is None else array
        told = spread.samplings[0]
        kept = (1 - told.beside) * (1 - told.stopped) * (1 - told.lost)
        # Slopes weigh light by cos^4 before and after microlenses: by at most twice the square of the largest slope.
        assert spread.landed == pytest.approx(kept, abs=1e-4 if array.is_plate else 2 * 0.1**2), array
        opaque = array.aperture is not None and array.aperture.gaps is pl.optics.Gaps.OPAQUE
        # Over some 30 microlenses, of which those on the spot's rim are lit in part.
        assert told.stopped == pytest.approx(1 - array.aperture.fill_factor if opaque else 0.0, abs=0.02), array


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
    focal = pl.paraxial.cardinal_points(singlet())
    # The iris in the front focal plane.
    lens = singlet(before=1.0 - focal.front_focus)
    z = -100.0
    larger = pl.paraxial.magnification(lens, z)
    camera = small_camera(lens=lens, z=126.0)
    first, second = (pl.wave.point_spread(camera, (x, 0.0, z)).whole() for x in (0.3, 0.3 + 0.1 / abs(larger)))
    assert off(np.roll(first, 10, axis=1), second) < 2e-3


def test_in_focus_the_pattern_is_airys():
    lens = singlet()
    points = pl.paraxial.cardinal_points(lens)
    z = points.rear_principal + 1.0 / (1.0 / points.efl - 1.0 / (points.front_principal + 100.0))
    camera = bare_camera(z, 0.001, wavelength=550.0)
    spread = pl.wave.point_spread(camera, (0.0, 0.0, -100.0))
    sine = math.sin(math.atan(points.exit_pupil_semi_diameter / (z - points.exit_pupil)))
    inner = (np.arange(1000) + 0.5) / 5 * 0.001 - 0.1
    fine = airy(np.hypot(inner, inner[:, None]), 2 * math.pi / 550e-6 * sine)
    expected = fine.reshape(200, 5, 200, 5).mean(axis=(1, 3))
    # The peak of the light E is E pi NA^2 / wavelength^2.
    expected *= spread.light * math.pi * sine**2 / 550e-6**2
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
    scale = 2 * math.pi / 550e-6 * array.opening.radius / b
    inner = (np.arange(200) + 0.5) / 5 * 0.001 - 0.02
    expected = airy(np.hypot(inner, inner[:, None]), scale).reshape(40, 5, 40, 5).mean(axis=(1, 3))
    expected *= middle.sum() / expected.sum()
    # Ripples behind the edge of the main lens, and what neighbours send: some per cent in amplitude.
    assert np.abs(middle - expected).max() < 0.02 * expected.max()


@pytest.mark.parametrize(
    "lens, array",
    [
        (pl.LensModel.EXACT, {"model": SPHERICAL}),
        pytest.param(pl.LensModel.PARAXIAL, {}, marks=pytest.mark.slow),
        pytest.param(pl.LensModel.THIN, {}, marks=pytest.mark.slow),
        pytest.param(pl.LensModel.EXACT, {"model": FLAT, "index": 100.0}, marks=pytest.mark.slow),
    ],
)
def test_rays_are_the_limit_of_short_waves(lens, array):
    far = []
    for wavelength in (600.0, 150.0):
        camera = small_camera(singlet(lens), square_array(**array), wavelength=wavelength)
        traced = pl.point_spread(camera, ASIDE, progress=False)
        found = pl.wave.point_spread(camera, ASIDE)
        far.append(off(found.whole(), traced.whole()))
    # Diffraction reaches as far as the wavelength is long; a pixel takes 10 um of it.
    assert far[1] < 0.4 * far[0] and far[1] < 0.16


PARTS = pl.CameraPart
PLACED = (
    ({"imperfections": DEVIATIONS}, {PARTS.SENSOR: {"shift": (0.05, -0.02, 0.0), "tilt": (0.0, 0.0, 0.3)}}),
    (
        {"lattice": pl.Lattice.RECTANGULAR, "pitch": (0.1, 0.13)},
        {
            PARTS.MICROLENSES: {"tilt": (0.0, 0.0, 0.3)},
            PARTS.LENS: {"shift": (0.2, 0.1, 0.3), "tilt": (0.01, -0.02, 0.0)},
        },
    ),
)


def test_light_goes_in_the_mean_where_rays_go():
    for array, moved in PLACED:
        camera = small_camera(array=square_array(**array))
        for part, how in moved.items():
            camera = camera.moved(part, **how)
        traced, found = (
            pl.point_spread(camera, ASIDE, rays=1 << 16, progress=False),
            pl.wave.point_spread(camera, ASIDE).whole(),
        )
        centroid = np.tensordot(found, camera.sensor.centre_of(*np.indices(found.shape)), 2) / found.sum()
        # Some 1 % of the light is diffracted beside what is looked at: its mean is that of the spot to 0.3 mm, half of
        # it.
        assert np.abs(centroid - traced.centroid).max() < 3e-3, moved


def test_listed_centres_are_those_of_the_lattice(aside):
    # All that the spot around (-1.3, 0.7) lights.
    columns, rows = np.meshgrid(np.arange(-24, -3), np.arange(-3, 18))
    free = square_array(lattice=pl.Lattice.FREE, centres=0.1 * np.stack([columns, rows], axis=-1).reshape(-1, 2))
    listed = pl.wave.point_spread(small_camera(array=free), ASIDE)
    # Cells could be larger: other samples are taken.
    assert off(listed.whole(), aside.whole()) < aside.samplings[0].error


def fields(camera, point):
    """Beam, grid, and the field behind the array and on the sensor, with the grid's carrier."""
    beam = beam_of(camera, np.array(point))
    lenses = microlenses_around(beam.record, *lit_box(beam))
    grid = grid_for(beam, lenses, beam.record.array.parts.distance, DENSER)
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
    rows, columns = (np.linspace(part.start + 2, part.stop - 3, 7).astype(int) for part in grid.seen[::-1])
    brightest = np.unravel_index(np.abs(arriving).argmax(), arriving.shape)
    off_by = []
    for row, column in [brightest, *((i, j) for i in rows[2:5:2] for j in columns[2:5:2])]:
        there = [grid.first[a] + grid.shift[a] + grid.spacing[a] * n for a, n in ((0, column), (1, row))]
        r = np.sqrt(grid.distance**2 + (there[0] - x) ** 2 + ((there[1] - y) ** 2)[:, None])
        kernel = grid.distance / r * (1 / r - 1j * k) * np.exp(1j * k * r) / r / (2 * math.pi)
        direct = abs((field * kernel).sum()) * grid.spacing.prod() / times**2
        off_by.append(abs(abs(arriving[row, column]) - direct))
    assert max(off_by) < 1e-3 * np.abs(arriving).max()


def test_the_field_on_the_array_is_huygens_sum():
    lens, point = singlet(pl.LensModel.EXACT, stop=3.0), np.array([1.0, 0.5, -100.0])
    sharp = pl.aberrations.wavefront(lens, z_object=-100.0, wavelength=550.0).z_image
    for z in (sharp, sharp + 0.4):
        given = {"field": (1.0, 0.5), "z_object": -100.0, "z_image": z, "wavelength": 550.0}
        waves = wavefront(lens, pupil=pl.aiming.square_grid(128), **given)
        beam = beam_of(bare_camera(z, 0.01, lens=lens, wavelength=550.0), point)
        grid = grid_for(beam, None, 0.0, DENSER)
        field = np.abs(np.fft.ifft2(plane_waves(beam, grid).waves, norm="ortho")) ** 2
        x, y = (grid.places(axis, slice(0, n)) for axis, n in enumerate(grid.shape))
        rows, columns = (np.abs(part - middle) < 0.03 for part, middle in ((y, waves.image[1]), (x, waves.image[0])))
        near = field[np.ix_(rows, columns)]
        there = np.stack(np.meshgrid(x[columns], y[rows]), axis=-1) - waves.image[:2]
        summed = waves.point_spread(np.concatenate([there, np.zeros((*there.shape[:2], 1))], axis=-1))
        # The edges of either are known to a part of a step; with the defocus, that of the pupil is a place on its
        # sphere.
        assert np.abs(near / near.max() - summed / summed.max()).max() < 1e-2, z


def twice_as_dense(camera):
    point, part = np.array(ASIDE), _of_wavelength(camera, np.array(ASIDE), 2 * DENSER)
    return _added(camera, point, np.array([587.6]), np.ones(1), [part])


def test_twice_as_dense_samples_agree_within_the_error(aside):
    assert off(aside.whole(), twice_as_dense(small_camera()).whole()) < aside.samplings[0].error


@pytest.mark.slow
def test_twice_as_dense_samples_behind_plates_agree_within_the_error():
    camera = small_camera(array=square_array(model=SPHERICAL))
    found = pl.wave.point_spread(camera, ASIDE)
    assert off(found.whole(), twice_as_dense(camera).whole()) < found.samplings[0].error


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
    assert not ax.lines
    assert f"{1e3 * aside.light * aside.landed:.3g} msr" in ax.get_title()
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
