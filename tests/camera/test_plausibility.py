"""Numbers that no camera has are named by `render`, once; those of real cameras are not."""

import dataclasses
import warnings

import numpy as np
import pytest
from camera_helpers import CAMERA, the_lens, with_array

import plenoptic as pl
from plenoptic.camera.checks import warn_if_implausible
from plenoptic.errors import ImplausibleCameraWarning

LENS = CAMERA.lens
SWAPPED = pl.MicrolensArray(pitch=2.0, focal_lengths=(0.217,))
IN_METRES = {"microlenses": pl.MicrolensArray(2.17e-4, (2e-3,)), "microlenses_to_sensor": 1.7e-3}
IMPLAUSIBLE = {
    "a sensor smaller than a microlens": ({"sensor": pl.Sensor((16, 16), 0.01)}, "the sensor is 0.16 x 0.16 mm large"),
    "pixels in metres": ({"sensor": pl.Sensor((512, 512), 1e-5)}, "pixel_pitch is 1e-05 mm"),
    "pixels in micrometres": ({"sensor": pl.Sensor((512, 512), 10.0)}, "the sensor is 5120 x 5120 mm large"),
    "a pitch in micrometres": ({"microlenses": pl.MicrolensArray(217.0, (2.0,))}, "microlens of pitch 217 mm"),
    "pitch and focal length swapped": ({"microlenses": SWAPPED}, "were they swapped"),
    "an array in metres": (IN_METRES, "a pixel of 0.01 mm is larger than a microlens of pitch 0.000217 mm"),
    "a stop of 200 mm": ({"lens": the_lens(200.0)}, "a stop of semi_diameter 200 mm makes the lens f/0.1"),
    "a gap in micrometres": ({"microlenses_to_sensor": 1700.0}, "microlenses_to_sensor is 1700 mm"),
    "a gap in metres": ({"microlenses_to_sensor": 0.0017}, "microlenses_to_sensor is 0.0017 mm"),
    "a back in micrometres": ({"stop_to_microlenses": 123300.0}, "stop_to_microlenses is 123300 mm, 1.22e.03 focal"),
}


def test_a_number_that_no_camera_has_is_named():
    for case, (changes, words) in IMPLAUSIBLE.items():
        with pytest.warns(ImplausibleCameraWarning, match=words) as warned:
            warn_if_implausible(dataclasses.replace(CAMERA, **changes))
        assert len(warned) == 1, case


def test_render_says_it_once():
    small = dataclasses.replace(CAMERA, sensor=pl.Sensor((16, 16), 0.01))
    for shoot in (lambda **k: pl.render(pl.check_scene(), small, **k), lambda **k: pl.render_white(small, **k)):
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            shoot(samples=8, threads=2, tile_side=4, progress=False)
        assert [warning.category for warning in warned] == [ImplausibleCameraWarning]


def sane_cameras():
    """Lenses of the library and stops, focused at near and far; pixels from 0.7 to 100 micrometres; other kinds."""
    for name in pl.lens_names():
        lens = pl.load_lens(name)
        if pl.paraxial.cardinal_points(lens).bfl < 20.0:
            continue  # the array would stand in the lens
        yield pl.PlenopticCamera(lens, pl.Sensor((1000, 1500), 0.024), 1000.0).focused_at(-np.inf)
        for f, b in ((2.0, 2.0), (2.0, 1.7), (2.0, 2.4), (0.3, 0.25)):
            array = pl.MicrolensArray(0.1 * f, (f,))
            camera = pl.PlenopticCamera(lens, pl.Sensor((512, 512), 0.006), 1000.0, array, b)
            yield camera.focused_at(-np.inf)
            yield camera.focused_at(-50.0 * pl.paraxial.cardinal_points(lens).efl)
    for pitch in (0.0007, 0.003, 0.1):
        yield pl.PlenopticCamera(LENS, pl.Sensor((4000, 6000) if pitch < 0.1 else (64, 64), pitch), 123.3)
    yield pl.PlenopticCamera(pl.no_lens(0.05), pl.Sensor((64, 64), 0.01), 10.0)
    yield pl.PlenopticCamera(pl.no_lens(50.0), pl.Sensor((64, 64), 0.05), 100.0, pl.MicrolensArray(1.0, (3.0,)), 3.0)
    yield with_array(CAMERA, model=pl.optics.MicrolensModel.PINHOLE)
    one = pl.MicrolensArray(20.0, (10.0,), pl.Lattice.FREE, centres=[(0, 0)])
    yield pl.PlenopticCamera(pl.no_lens(5.0), pl.Sensor((64, 64), 0.05), 1.0, one, 11.0)
    yield dataclasses.replace(CAMERA, microlenses=pl.MicrolensArray(0.125, (0.5, 0.6, 0.7)), microlenses_to_sensor=0.4)


def test_cameras_that_can_be_built_are_silent():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        count = sum(warn_if_implausible(camera) is None for camera in sane_cameras())
    assert count > 60
