"""Particles and light sheets: intensities, motion, checks."""

import math

import numpy as np
import pytest

import plenoptic as pl

SHEET = pl.lights.Sheet((0, 0, -404), (2, 0, 0), (0, 0, 1), thickness=1.0, irradiance=5.0, divergence=0.1)


def test_the_light_of_a_sheet_is_conserved_along_it():
    """The integral of the irradiance of planes across is irradiance w0 sqrt(pi / 2) everywhere."""
    across = np.linspace(-20, 20, 20001)
    for along in (-30.0, 0.0, 7.0, 60.0):
        points = np.column_stack([np.full(across.size, along), np.zeros(across.size), -404 + across])
        integral = (SHEET.irradiance_at(points) * SHEET.directions_at(points)[:, 0]).sum() * 0.002
        assert abs(integral / (5.0 * 0.5 * math.sqrt(math.pi / 2)) - 1) < 1e-9
    # Half the thickness from the middle: 1 / e^2. Far away the width is s tan(divergence).
    assert abs(SHEET.irradiance_at([(0, 3, -403.5)])[0] / 5.0 - math.exp(-2)) < 1e-12
    s = 1e4
    far = SHEET.irradiance_at([(s, 0, -404), (s, 0, -404 + s * math.tan(0.1))])
    assert abs(far[1] / far[0] * math.cos(0.1) - math.exp(-2)) < 1e-6


def test_intensity_is_irradiance_times_cross_section_times_phase():
    positions, camera = np.array([(0.0, 0, -404), (0, 0, -403.5)]), (0.0, 0.0, 0.0)
    isotropic = pl.Points(positions, sheet=SHEET, diameter=0.02).intensities(camera)
    assert np.allclose(isotropic, SHEET.irradiance_at(positions) * math.pi * 0.01**2 / (4 * math.pi), rtol=1e-14)
    # Rayleigh: 3 / (16 pi) (1 + cos^2), which is 3 / (16 pi) at right angles and twice that forwards.
    angle = np.linspace(0, math.pi, 2001)
    rayleigh = np.column_stack([angle, 3 / (16 * math.pi) * (1 + np.cos(angle) ** 2)])
    points = pl.Points(positions[:1], sheet=SHEET, cross_section=2.0, phase=rayleigh)
    assert abs(points.intensities(camera)[0] / (5.0 * 2.0 * 3 / (16 * math.pi)) - 1) < 1e-6
    assert abs(points.intensities((100.0, 0, -404))[0] / points.intensities(camera)[0] - 2.0) < 1e-6
    assert abs(points.intensities((-100.0, 0, -404))[0] / points.intensities(camera)[0] - 2.0) < 1e-6
    forward = np.array([[0.0, 1.0], [math.pi, 0.0]])
    lobe = pl.Points(positions[:1], sheet=SHEET, cross_section=1.0, phase=forward)
    assert lobe.intensities((100.0, 0, -404))[0] > 0.99 * 5.0 and lobe.intensities((-100.0, 0, -404))[0] < 1e-6
    assert lobe.intensities((0.0, 0, -404)) == lobe.intensities((1e-9, 0, -404))  # at the particle: forwards
    red = pl.lights.Sheet((0, 0, -404), (1, 0, 0), (0, 0, 1), thickness=1.0, irradiance=(5.0, 1.0, 0.0))
    coloured = pl.Points(positions, sheet=red, cross_section=1.0).intensities(camera)
    assert coloured.shape == (2, 3) and np.allclose(coloured[0], np.array([5.0, 1.0, 0.0]) / (4 * math.pi))


def test_particles_leave_the_sheet_as_they_move():
    points = pl.Points([(0, 0, -404)], sheet=SHEET, cross_section=1.0)
    later = points.moved([(0, 0, 50.0)], 0.01)
    assert later.positions.tolist() == [[0, 0, -403.5]] and later.sheet == SHEET
    assert abs(later.intensities((0, 0, 0))[0] / points.intensities((0, 0, 0))[0] - math.exp(-2)) < 1e-12


def test_scaled_scenes_keep_their_irradiances():
    matrix = np.array([[0, -2.0, 0, 1], [2.0, 0, 0, 2], [0, 0, 2.0, 3], [0, 0, 0, 1]])
    points = pl.Points([(1, 2, -404)], sheet=SHEET, diameter=0.1)
    moved = pl.Scene(points=points).transformed(matrix).points
    assert np.allclose(moved.positions, [[-3, 4, -805]]) and moved.diameter[0] == 0.2
    old, new = points.intensities((0, 0, 0))[0], moved.intensities(matrix[:3, 3])[0]
    assert abs(new / (4 * old) - 1) < 1e-12
    shining = pl.Points([(1, 2, -404)], intensity=3.0, diameter=0.1)
    assert shining.under(matrix).intensity[0] == 12.0


def test_scenes_keep_their_particles():
    points = pl.Points([(1, 2, -404)], intensity=1.0)
    scene = pl.Scene(points=points)
    assert scene.merged(pl.Scene(background=1.0)).points is points
    assert pl.Scene(background=1.0).merged(scene).points is points
    assert scene.with_lights([]).points is points and scene.bounds.tolist() == [[1, 2, -404]] * 2
    with pytest.raises(pl.errors.SceneError, match="both scenes have points"):
        scene.merged(scene)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"intensity": None}, "neither intensity nor sheet"),
        ({"sheet": SHEET}, "both intensity and sheet"),
        ({"intensity": [-1.0]}, "intensity holds -1"),
        ({"intensity": np.nan}, "intensity holds nan"),
        ({"intensity": [1.0, 2.0]}, "shape"),
        ({"diameter": [-0.1]}, "diameter holds -0.1"),
        ({"positions": [(0, 0, np.inf)]}, "positions holds inf"),
        ({"positions": np.zeros((0, 3))}, "positions is empty"),
        ({"cross_section": 1.0}, "need a sheet"),
        ({"intensity": None, "sheet": SHEET, "phase": [[1.0, 1.0], [0.5, 1.0]]}, "phase must hold"),
        ({"intensity": None, "sheet": 3.0}, "sheet"),
    ],
)
def test_bad_particles_are_refused(arguments, message):
    with pytest.raises(pl.errors.InvalidValueError, match=message):
        pl.Points(**{"positions": [(0, 0, -404)], "intensity": 1.0} | arguments)


def test_bad_sheets_and_scenes_are_refused():
    with pytest.raises(pl.errors.SceneError, match="give the sheet a start="):
        pl.Scene(medium=pl.materials.fog(1e4), points=pl.Points([(0, 0, -400)], sheet=SHEET))
    with pytest.raises(pl.errors.SceneError, match="right angles"):
        pl.lights.Sheet((0, 0, 0), (1, 0, 0), (1, 1, 0), thickness=1.0)
    with pytest.raises(pl.errors.InvalidValueError, match="divergence"):
        pl.lights.Sheet((0, 0, 0), (1, 0, 0), (0, 1, 0), thickness=1.0, divergence=2.0)
    with pytest.raises(pl.errors.InvalidValueError, match="velocity has shape"):
        pl.Points([(0, 0, -404)], intensity=1.0).moved(np.zeros((2, 3)), 1.0)
