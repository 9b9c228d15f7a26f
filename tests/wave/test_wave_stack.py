"""Stacks of patterns: what they are made of, mirrored places, and files for programs of microscopy."""

import json

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.analysis.focus import paraxial_focus


def microscope(count=101, pixel=0.01, pitch=0.05, **other):
    """Telecentric towards the array, five pixels a microlens, in focus at z = -60."""
    glass = pl.ConstantMedium(1.5)
    front = pl.Surface(50.0, 4.0, glass, semi_diameter=12.0)
    before = pl.LensStack([pl.CircularStop(3.0, 1.0), front, pl.Surface(-50.0, semi_diameter=12.0)])
    focal = 1.0 - pl.paraxial.cardinal_points(before).front_focus
    lens = pl.LensStack([pl.CircularStop(1.0, focal), front, pl.Surface(-50.0, semi_diameter=12.0)])
    return pl.PlenopticCamera(
        lens=lens,
        microlenses=pl.MicrolensArray(pitch=pitch, focal_lengths=(0.6,), lattice=pl.Lattice.SQUARE),
        sensor=pl.Sensor(shape=(count, count), pixel_pitch=pixel),
        stop_to_microlenses=paraxial_focus(lens, -60.0, 587.6),
        microlenses_to_sensor=0.6,
        **other,
    )


@pytest.fixture(scope="module")
def stack():
    return pl.wave.point_spread_stack(microscope(), [-62.0, -60.0], across=3, threads=1, progress=False)


def test_patterns_are_those_of_their_points(stack):
    for place in ((0, 0, 1), (1, 2, 1)):
        alone = pl.wave.point_spread(stack.camera, stack.points[place])
        (row, column), (rows, columns) = stack.corner, stack.images.shape[-2:]
        there = alone.whole()[row : row + rows, column : column + columns]
        assert np.abs(there - stack.images[place]).sum() < 1e-3 * there.sum()
        assert stack.light[place] == pytest.approx(alone.light, rel=1e-6)


def test_places_follow_the_image(stack):
    rows, columns = np.indices(stack.images.shape[-2:])
    images = stack.images[1]
    down = (images * rows).sum(axis=(-2, -1)) / images.sum(axis=(-2, -1))
    right = (images * columns).sum(axis=(-2, -1)) / images.sum(axis=(-2, -1))
    assert np.all(np.diff(down, axis=0) > 0) and np.all(np.diff(right, axis=1) > 0)


def test_pyolaf_gets_patterns_around_the_point(stack, tmp_path):
    pl.export.pyolaf_patterns(tmp_path, stack)
    found = np.load(tmp_path / "H.npy")
    assert found.shape[:3] == (3, 3, 2) and found.dtype == np.float32
    # Moved back by whole pixels, from -2 to 2.
    part = stack.camera.sensor.pixel_pitch**2 / stack.light[1, 0, 1]
    assert np.allclose(found[0, 1, 1][2:], part * stack.images[1, 0, 1][:-2], rtol=1e-6)
    assert np.all(found.sum(axis=(-2, -1)) <= 1.0)
    said = json.loads((tmp_path / "patterns.json").read_text())
    assert said["across"] == 3 and said["z_objects"] == [-62.0, -60.0]
    compile((tmp_path / "load_patterns.py").read_text(), "load_patterns.py", "exec")


def test_napari_lf_gets_coordinates_of_all_light(stack, tmp_path):
    pl.export.napari_lf_patterns(tmp_path, stack)
    found = np.load(tmp_path / "psf_db.npz")
    first, last = 0, found["ends"][0]
    assert found["places"][0].tolist() == [0, 0, 0] and len(found["places"]) == 18
    u, v, s, t = found["coordinates"][first:last].T
    rows, columns = stack.images.shape[-2:]
    made = np.zeros((rows, columns))
    made[t * 5 + v + (rows - 5) // 2, s * 5 + u + (columns - 5) // 2] = found["coefficients"][first:last]
    part = stack.camera.sensor.pixel_pitch**2 / stack.light[0, 0, 0]
    # Places (x, y) are columns, rows; what is below 1e-6 of the brightest is left out.
    assert np.allclose(made, part * stack.images[0, 0, 0], atol=2e-6 * found["coefficients"].max())
    assert found["z_coords"].tolist() == [-1000.0, 1000.0]
    compile((tmp_path / "load_patterns.py").read_text(), "load_patterns.py", "exec")


def test_hexagons_and_even_pixels_are_refused(stack, tmp_path):
    hexagonal = pl.PlenopticCamera(
        lens=stack.camera.lens,
        microlenses=pl.MicrolensArray(pitch=0.05, focal_lengths=(0.6,)),
        sensor=stack.camera.sensor,
        stop_to_microlenses=140.0,
        microlenses_to_sensor=0.6,
    )
    with pytest.raises(InvalidValueError, match="SQUARE"):
        pl.wave.point_spread_stack(hexagonal, [-60.0], across=1)
    even = pl.wave.point_spread_stack(microscope(count=100), [-60.0], across=1, threads=1, progress=False)
    with pytest.raises(InvalidValueError, match="odd"):
        pl.export.pyolaf_patterns(tmp_path, even)
