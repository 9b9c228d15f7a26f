"""Micro images of white images, drawn and rendered, against the places at which they were put."""

import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.calibration.lattice_search import lattice_of
from plenoptic.errors import InvalidValueError

find = pl.calibration.find_micro_images
HEXAGONAL, SQUARE, RECTANGULAR, _ = pl.Lattice
ROOT = math.sqrt(3.0) / 2.0


def drawn(basis, shape=(260, 320), radius=8.6, electrons=5000.0, bits=12, blur=(1.0,), dead=0.0, turn=0.0, full=0.7):
    """White image of a sensor with noise, and the centres (n, 2) of its discs; a dead one is dark."""
    rng = np.random.default_rng(4)
    cos, sin = math.cos(turn), math.sin(turn)
    steps = np.stack(np.meshgrid(*[np.arange(-40, 41)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    centres = steps @ np.array(basis) @ [[cos, sin], [-sin, cos]] + (131.7, 153.2)
    near = (centres > -12).all(axis=1) & (centres < np.array(shape) + 12).all(axis=1)
    steps, centres = steps[near], centres[near]
    lit = rng.random(len(centres)) >= dead
    row, column = np.mgrid[: shape[0], : shape[1]]
    light = np.zeros(shape)
    for (r, c), (k, l), is_lit in zip(centres, steps, lit, strict=True):
        part = np.s_[max(int(r) - 16, 0) : int(r) + 17, max(int(c) - 16, 0) : int(c) + 17]
        distance = np.hypot(row[part] - r, column[part] - c)
        vignetting = 1.0 - 0.5 * ((r / shape[0] - 0.5) ** 2 + (c / shape[1] - 0.5) ** 2)
        profile = np.clip(0.5 + (radius - distance) / blur[(k - l) % len(blur)], 0.0, 1.0)
        light[part] += is_lit * vignetting * profile
    noisy = rng.poisson(electrons * light) + rng.normal(0.0, 4.0, shape) + 0.03 * electrons
    return np.clip(np.rint(noisy * full * 2**bits / electrons), 0, 2**bits - 1).astype(np.uint16), centres[lit]


def errors_of(grid, centres):
    """Distances (n, 2) of measured centres from the nearest true ones."""
    nearest = [np.hypot(*(centres - centre).T).argmin() for centre in grid.centre]
    return grid.centre - centres[nearest]


LATTICES = {
    "along rows": (HEXAGONAL, [(0.0, -20.0), (20.0 * ROOT, -10.0)], True),
    "along columns": (HEXAGONAL, [(10.0, -20.0 * ROOT), (20.0, 0.0)], False),
    "square": (SQUARE, [(0.0, -20.0), (20.0, 0.0)], True),
    "rectangular": (RECTANGULAR, [(0.0, -20.0), (24.0, 0.0)], True),
}


@pytest.mark.parametrize("name", LATTICES)
def test_lattices_are_told_apart_turned_by_any_angle(name):
    lattice, basis, along_rows = LATTICES[name]
    for turn in (-0.2, -0.03, 0.0, 0.11, 0.24):
        image, centres = drawn(basis, turn=turn)
        grid = find(image)
        assert grid.lattice is lattice and grid.is_along_rows is along_rows
        # Of the step of 20 pixels over some 13, whose ends are known to 0.01 pixels at worst.
        assert grid.rotation == pytest.approx(turn, abs=5e-4)
        np.testing.assert_allclose(grid.pitches, np.hypot(*np.array(basis).T), rtol=5e-4)
        # 5 % of the light is in pixels of borders, which the drawing samples at their centres.
        assert np.sqrt(np.mean(errors_of(grid, centres) ** 2)) < 0.012 and len(grid.index) > 100
        assert grid.deviation is None and grid.type_pattern.tolist() == [[0]]


def test_steps_of_a_lattice_turned_by_half_a_right_angle_are_different():
    assert np.linalg.det(lattice_of(np.array([(4.0, -4.0), (-4.001, -4.001)]))[1]) == pytest.approx(32.0, rel=1e-3)


def test_standard_errors_are_those_of_the_noise():
    for electrons, bits in ((400.0, 10), (1500.0, 14)):
        image, centres = drawn(LATTICES["along rows"][1], electrons=electrons, bits=bits, shape=(400, 500))
        grid = find(image)
        z = errors_of(grid, centres) / grid.standard_error
        # 4 standard errors of the RMS of some 800 numbers, and 10 % for the estimate of the noise.
        assert 0.85 < np.sqrt(np.mean(z**2)) < 1.2
        # Of Poisson numbers in a disc: half the radius over the root of their sum.
        assert np.median(grid.standard_error) == pytest.approx(4.3 / math.sqrt(electrons * math.pi * 8.6**2), rel=0.2)


def test_standard_errors_hold_the_displacements_by_texture():
    image, centres = drawn(LATTICES["along rows"][1], electrons=20000.0, bits=16, shape=(400, 500))
    texture = np.kron(1.0 + 0.06 * np.random.default_rng(2).standard_normal((67, 84)), np.ones((6, 6)))[:400, :500]
    # Squares of 6 pixels, some 6 in a disc, 0.06 times half the radius over their root along an axis.
    plain, textured = find(image), find(image * texture)
    assert np.median(plain.standard_error) < 0.003
    error = errors_of(textured, centres)
    assert (
        0.06 < np.sqrt(np.mean(error**2)) < 0.12
        and 0.7 < np.sqrt(np.mean((error / textured.standard_error) ** 2)) < 1.4
    )


def test_colour_filters_bits_and_float_arrays_do_not_matter():
    image, centres = drawn(LATTICES["along rows"][1], bits=16)
    filtered = image - 0.02 * 2**16
    filtered[::2, ::2] *= 0.5
    filtered[1::2, 1::2] *= 0.7
    for raw in (filtered, image / 65535.0, image[..., None], np.stack([image] * 3, axis=-1), image >> 8):
        grid = find(raw)
        assert grid.lattice is HEXAGONAL and np.sqrt(np.mean(errors_of(grid, centres) ** 2)) < 0.02


def test_dead_microlenses_are_left_out():
    image, centres = drawn(LATTICES["square"][1], dead=0.04, radius=9.5)
    _, all_centres = drawn(LATTICES["square"][1], radius=9.5)
    grid = find(image)
    assert len(centres) < len(all_centres)
    assert np.abs(errors_of(grid, centres)).max() < 0.1
    assert np.sqrt(np.mean(errors_of(grid, centres) ** 2)) < 0.02


def test_radii_and_types_are_those_of_the_discs():
    image, _ = drawn(LATTICES["along columns"][1], shape=(420, 480), radius=6.5, blur=(1.0, 3.0, 6.0))
    grid = find(image)
    assert sorted(grid.type_pattern.ravel().tolist()) == [0] * 3 + [1] * 3 + [2] * 3
    radius = [np.median(grid.radius[grid.types_of(grid.index) == t]) for t in range(3)]
    np.testing.assert_allclose(radius, 6.5, atol=0.1)
    # A linear border falls from 75 to 25 % over half of its width, that of a hexagonal opening over 0.42 of it; and the
    # drawing has no pixels that blur.
    expected = np.sqrt(np.maximum((np.array([1.0, 3.0, 6.0]) * 0.5 / 0.42) ** 2 - 1.45**2, 0.0))
    np.testing.assert_allclose(grid.border, expected, atol=0.4)
    # Neighbours are of other types.
    assert (grid.types_of([(1, 0), (0, 1)]) != grid.types_of((0, 0))).all()


def test_what_is_no_white_image_is_refused():
    basis = LATTICES["along rows"][1]
    image, _ = drawn(basis)
    rng = np.random.default_rng(1)
    row, column = np.mgrid[:260, :320]
    scene = image * (1.0 + 0.9 * np.sin(column / 17.0 + 2.0 * np.sin(row / 11.0)))
    for raw, reason in (
        (rng.poisson(500.0 + 9.0 * row), "shows no lattice of micro images"),
        (1000.0 + 300.0 * np.sin(column / 3.0) + rng.normal(0.0, 10.0, (260, 320)), "no lattice"),
        (scene, "scene|not white"),
        (image * np.where((row // 3 + column // 3) % 2, 1.0, 0.3), "within micro images"),
        (pl.check_scene(), "white is a Scene; give an array"),
        ("white.png", "white is a str"),
        (np.minimum(image, 2000), "saturated"),
        (rng.poisson(1.0, (200, 200)), "too dark"),
        (drawn(basis, radius=10.4, full=0.3)[0], "overlap|no lattice"),
        (np.zeros((10, 300)), "shape"),
        (np.full((100, 100), np.nan), "finite"),
        (pl.Exposure(np.ones((64, 64, 1)), white=False), "shows a scene"),
    ):
        with pytest.raises(InvalidValueError, match=reason):
            find(raw)


def rendered(turn, lattice, pitch, focal_lengths, distance, stop, bits, filters):
    """A camera with vignetting, dark, missing and displaced microlenses; raw white image of its sensor."""
    spoiled = pl.MicrolensImperfections(pitch_jitter=0.0005, dark=0.01, missing=0.005, seed=3)
    array = pl.MicrolensArray(pitch, focal_lengths, lattice=lattice, imperfections=spoiled)
    lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(stop))
    camera = pl.PlenopticCamera(lens, pl.Sensor((300, 400), 0.01), 123.3, array, distance)
    camera = camera.moved(pl.CameraPart.MICROLENSES, shift=(0.031, -0.017, 0.0), tilt=(0.0, 0.0, turn))
    white = pl.render_white(camera, samples=32, progress=False)
    image = white.image if filters is None else np.repeat(white.image, 3, axis=2)
    rate = 0.75 * 15000 / (0.6 * np.percentile(image, 99.9))
    sensor = pl.SensorModel(
        rate,
        quantum_efficiency=0.6 if filters is None else (0.35, 0.6, 0.45),
        gain=0.95 * 2**bits / 15000,
        read_noise=4.0,
        black_level=2**bits // 64,
        bits=bits,
        full_well=15000,
        prnu=0.005,
        colour_filters=filters,
    )
    return camera, pl.Exposure(image, white=True, camera=camera).develop(sensor, seed=1)


RENDERED = {
    "columns, 2.0": (0.0, HEXAGONAL, 0.217, (2.0,), 1.7, 4.6, 12, None),
    "rows, touching": (math.pi / 2, HEXAGONAL, 0.217, (2.0,), 2.0, 4.6, 12, pl.BayerPattern.RGGB),
    "turned": (0.3, HEXAGONAL, 0.217, (2.0,), 2.0, 4.4, 12, pl.BayerPattern.GRBG),
    "three types": (0.0, HEXAGONAL, 0.217, (1.5, 1.8, 2.3), 1.7, 4.2, 12, pl.BayerPattern.RGGB),
    "small": (0.001, HEXAGONAL, 0.12, (1.1,), 1.1, 4.4, 10, pl.BayerPattern.RGGB),
    "square, turned": (0.04, SQUARE, 0.217, (2.0,), 2.0, 4.4, 12, None),
    "square, large": (-0.002, SQUARE, 0.3, (2.7,), 2.7, 4.4, 8, None),
    "square, few": (0.0, SQUARE, 0.2907, (3.185,), 2.707, 4.3755, 8, None),
    "rectangular, turned": (-0.1, RECTANGULAR, (0.17, 0.23), (2.0,), 2.0, 3.6, 16, None),
    "rectangular, flat": (0.01, RECTANGULAR, (0.25, 0.2), (2.0,), 1.9, 4.0, 14, pl.BayerPattern.RGGB),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", RENDERED)
def test_centres_are_the_centroids_of_the_camera(name):
    camera, raw = rendered(*RENDERED[name])
    grid = find(raw)
    truth = pl.microlens_centres(camera, pl.CentreMethod.CENTROID, margin=1.0, progress=False)
    error = errors_of(grid, truth.pixel[np.isfinite(truth.pixel[:, 0])])
    assert grid.lattice is camera.microlenses.lattice
    assert len(np.unique(grid.type_pattern)) == len(camera.microlenses.focal_lengths)
    assert np.sqrt(np.mean(error**2)) < 0.02 and len(grid.index) > 50
    assert np.sqrt(np.mean((error / grid.standard_error) ** 2)) < 2.0


def test_touching_micro_images_of_designed_cameras_are_found():
    lens = pl.load_lens("double-gauss-100mm-f2").with_model(pl.LensModel.THIN)
    for pitch, focal_length in ((0.1, 1.7), (0.11, 3.0)):
        camera = pl.design_camera(
            lens, sensor=pl.Sensor((200, 240), 0.0135), kind=pl.CameraKind.PLENOPTIC_1, z=-478.0, pitch=pitch,
            focal_length=focal_length,
        ).camera.moved(pl.CameraPart.MICROLENSES, shift=(0.05, -0.03, 0.0), tilt=(0.0, 0.0, 0.01))  # fmt: skip
        white = pl.render_white(camera, samples=64, progress=False)
        sensor = pl.SensorModel(8e3 / float(white.image.max()), read_noise=4.0, gain=0.2, bits=14, full_well=60000)
        truth = pl.microlens_centres(camera, pl.CentreMethod.CENTROID, margin=1.0, progress=False)
        for image in (white, white.develop(sensor, seed=1)):
            grid = find(image)
            error = errors_of(grid, truth.pixel[np.isfinite(truth.pixel[:, 0])])
            assert np.sqrt(np.mean(error**2)) < 0.02 and len(grid.index) > 500


@pytest.mark.parametrize("lattice, turn", [(HEXAGONAL, -0.003), (HEXAGONAL, math.pi / 2 + 0.002), (SQUARE, -0.1)])
def test_a_grid_calibrates_as_it_is(lattice, turn):
    lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(4.6)).with_model(pl.LensModel.THIN)
    array = pl.MicrolensArray(0.4, (2.0,), lattice=lattice)
    camera = pl.PlenopticCamera(lens, pl.Sensor((260, 300), 0.02), 156.0, array, 3.0)
    camera = camera.moved(pl.CameraPart.MICROLENSES, shift=(0.03, -0.05, 0.0), tilt=(0.0, 0.0, turn))
    grid = find(pl.render_white(camera, samples=16, progress=False))
    symmetry = math.pi / 3 if lattice is HEXAGONAL else math.pi / 2
    from_camera = math.pi / 6 if lattice is HEXAGONAL and grid.is_along_rows else 0.0
    # 1e-4 rad are 0.02 pixels at the border.
    assert abs(math.remainder(grid.rotation + from_camera - turn, symmetry)) < 1e-4
    design = pl.targets.checkerboard(6, 5, square=3.0)
    boards = [design.rotated_deg(axis, 25).translated(z=-380) for axis in ((1, 0, 0), (-1, 0, 0), (0, 1, 0))]
    corners, centres = pl.package.calibration_points(camera, boards), pl.microlens_centres(camera, margin=1.0)
    in_grid = dict(zip(map(tuple, centres.index.tolist()), grid.indices_of(centres.pixel).tolist(), strict=True))
    observations = pl.calibration.Observations(
        index=[in_grid[index] for index in map(tuple, corners.index.tolist())],
        pixel=corners.pixel, frame=corners.frame, point=corners.point, board=design.points,
        centre_index=grid.index, centre_pixel=grid.centre, sensor=camera.sensor, lattice=grid.lattice,
    )  # fmt: skip
    start = pl.calibration.NominalCamera(focal_length=100.0, f_number=8.0)
    calibration = pl.calibrate(observations, start=start, board=0.0)
    # Centroids differ from chief rays.
    assert calibration.corner_rms < 1e-6 and calibration.centre_rms < 0.005
    assert abs(math.remainder(calibration[pl.calibration.Parameter.TURN] - turn, symmetry)) < 1e-4
