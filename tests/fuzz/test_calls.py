"""Whatever is given to the public API: it works, or the package's own error says in a sentence what is wrong.

Run longer with ``python tests/fuzz/fuzzed_calls.py SEED COUNT``.
"""

import os
import subprocess
import sys
import warnings
from pathlib import Path

import pytest
from fuzzed_calls import findings
from valid_calls import calls, camera, lens, shot

import plenoptic as pl

RENDERING = ("render", "render.target", "render_white", "ground_truth", "warm_up", "replay", "replay_all", "project")
RENDERING += (
    "estimate",
    "point_spread",
    "point_weights",
    "landing_points",
    "microlens_centres",
    "design_camera",
    "decode",
    "report",
)


def test_200_random_calls_end_or_are_refused():
    quick = set(calls()) - set(RENDERING)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        wrong, ended = findings(0, 200, quick, used=False)
    assert not wrong, "\n".join(wrong)
    assert min(ended["accepted"], ended["refused"]) > 30  # both are looked at


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.skipif(sys.platform != "linux", reason="reads the size of the process from /proc")
def test_2500_random_calls_and_what_follows_from_them():
    script = Path(__file__).with_name("fuzzed_calls.py")
    paths = os.pathsep.join([str(Path(pl.__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    run = [sys.executable, str(script), "1", "2500"]
    done = subprocess.run(run, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": paths})
    assert done.returncode == 0, done.stdout[-5000:] + done.stderr[-5000:]


def test_functions_and_classes_of_the_top_are_called():
    called = {getattr(function, "__qualname__", "").split(".")[0] for function, _ in calls().values()}
    left_out = {"PlenopticError", "GroundTruth", "LensStack", "Target"}  # an error; what functions make
    left_out |= {"camera_names", "lens_names", "check_scene", "objects_scene", "still_life"}  # without arguments
    left_out |= {"load_lens", "load_file", "load_meshes", "save_lens"}  # of files, which have tests of their own
    left_out |= {"calibrate"}  # of whole sets of observations, whose mistakes tests/calibration has
    made = {n for n in pl.__all__ if callable(getattr(pl, n)) and not hasattr(getattr(pl, n), "__members__")}
    assert made - called - left_out == set()


def white(array, gap, **how):
    camera = pl.PlenopticCamera(pl.no_lens(1.0), pl.Sensor((4, 4), 0.2), 2.0, array, gap)
    return pl.render_white(camera, samples=1, progress=False, **how)


def test_what_took_minutes_or_raised_what_it_should_not():
    fine = pl.MicrolensArray(pitch=1e-4, focal_lengths=(1e3,))
    for call, message in (
        (lambda: pl.PolygonStop(blades=123456789, semi_diameter=5.0), "blades is 123456789; it must be at most 1024"),
        (lambda: pl.StarStop(123456789, 5.0, 1.0), "points is 123456789; it must be at most 1024"),
        (lambda: camera(microlenses_to_sensor=1e-30), "microlenses_to_sensor is 1e-30 mm; it must be above 1e-15"),
        (lambda: camera(stop_to_microlenses=1e28), "stop_to_microlenses is 1e.28 mm; it must be within 1e.15 mm of 0"),
        (lambda: lens().moved(0, shift=(0, 1e38, 0)), "shift holds 1e.38 mm"),
        (lambda: pl.MicrolensArray(0.2, focal_lengths=(1e-300,)), "focal_lengths is .*; give one in mm for each type"),
        (lambda: pl.Sensor((4, 4), pixel_pitch=1e300), "pixel_pitch is 1e.300 mm; it must be from"),
        (lambda: pl.Sensor((4, 2**64), 0.01), "columns of the sensor is 18446744073709551616; it must be"),
        (lambda: pl.Sensor((2**20, 2**20), 0.01), "rows of the sensor x columns .* is 1048576 x 1048576; it must"),
        (lambda: pl.Scene(background=[[1], [2, 3]]), "background is not an array of numbers"),
        (lambda: pl.render_white(camera(), samples=1, progress=[1.0, 2.0]), "progress is .*; it must be True or False"),
        (lambda: pl.render_white(camera(), samples=1, conditioning=123456789), "conditioning is .* at most 1048576"),
        (lambda: pl.sphere(1.0, segments=(8, 2**64 - 1)), "segments from pole to pole is 18446744073709551615; it"),
        (lambda: pl.sphere(1.0, segments=(1 << 15, 1 << 15)), "segments x .* is 32768 x 32768; it must be at most"),
        (lambda: pl.lightfield.decode(shot(), shot(), views=123456789), "views is 123456789; it must be at most 4095"),
        (lambda: pl.lightfield.decode(shot(), shot(), views=541), "views is 541, and at this step .* span four micro"),
        (lambda: pl.Surface(float("inf"), semi_diameter=9.0, aspheric=[1e3]), "gives slopes of 1.8e.04 .* at most 100"),
        (lambda: pl.project(camera(), (0, 0, -400), rays=1 << 31), "rays is 2147483648; it must be at most 16777216"),
        (lambda: pl.project(camera(), [[2**64, 0.0, 2**63]]), "points"),
        *((lambda s=side: white(fine, 1e6, tile_side=s), "microlenses, and the limit is 100000") for side in (None, 3)),
    ):
        with pytest.raises(pl.PlenopticError, match=message):
            call()
