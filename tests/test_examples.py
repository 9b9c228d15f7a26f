"""Every example runs, at small size and in a folder of its own, and leaves files that load."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = ROOT / "examples"

FILES = {
    "first_light": {
        *("raw.exr", "raw.png", "white.exr", "white.png", "depth.png"),
        *("overview.png", "first_light.png"),
    },
    "paper_camera": {
        "check_2.0.exr",
        "check_1.0.exr",
        "objects_2.0.exr",
        "objects_1.0.exr",
        "check.png",
        "objects.png",
    },
    "stop_shapes": {
        *(
            f"{stop}_{place}.exr"
            for stop in ("circle", "12_blades", "6_blades", "circle_and_stop_behind")
            for place in ("on_the_axis", "halfway", "upper_left_corner")
        ),
        "stop_shapes.png",
    },
    "textured_mesh": {
        *("label.png", "tin.obj", "tin.mtl"),
        *(f"{name}{ending}" for name in ("raw", "conventional") for ending in (".exr", ".png", "_overview.png")),
    },
    "disparity": {"disparity.exr", "disparity.png"},
    "lens_report": {"contrast.png", "fans.png", "field.png", "layout.png", "spots.png", "third_order.png"},
}


def _run(script, folder):
    """Run a script in a folder; returns what it printed."""
    surroundings = {**os.environ, "PLENOPTIC_EXAMPLE_SIZE": "small", "MPLBACKEND": "Agg"}
    process = subprocess.run(
        [sys.executable, str(script)], cwd=folder, env=surroundings, capture_output=True, text=True, timeout=300
    )
    assert process.returncode == 0, process.stderr
    return process.stdout


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """Run an example once; returns its output folder and what it printed."""
    done = {}

    def run(name):
        if name not in done:
            folder = tmp_path_factory.mktemp(name)
            done[name] = folder / "output" / name, _run(EXAMPLES / f"{name}.py", folder)
        return done[name]

    return run


def test_every_example_is_tested():
    assert {path.stem for path in EXAMPLES.glob("*.py")} == set(FILES)


@pytest.mark.parametrize("name", FILES)
def test_example_leaves_its_files_and_says_where(ran, name):
    folder, said = ran(name)
    assert {path.name for path in folder.iterdir()} == FILES[name]
    for file in FILES[name] - {"label.png", "tin.obj", "tin.mtl"}:
        assert file in said
        if file.endswith((".exr", ".png")):
            image = pl.Exposure.load(folder / file).image
            assert np.isfinite(image).all() and image.max() > 0


def test_readme_runs(tmp_path):
    (code,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), flags=re.DOTALL)
    script = tmp_path / "readme.py"
    script.write_text(code, encoding="utf-8")
    _run(script, tmp_path)
    assert pl.Exposure.load(tmp_path / "shot.exr").image.shape == (64, 64, 3)
    assert (tmp_path / "shot.png").exists()


def test_first_light_keeps_everything(ran):
    folder, said = ran("first_light")
    raw, white = (pl.Exposure.load(folder / name) for name in ("raw.exr", "white.exr"))
    assert raw.image.shape == (48, 48, 3) and white.image.shape == (48, 48, 1)
    assert raw.camera == white.camera and raw.standard_error is not None and white.standard_error is not None
    assert np.isfinite(raw.depth).any() and raw.stats.nonfinite == 0
    assert "relative error" in said and str(folder.resolve()) in said


def test_stop_behind_the_lens_cuts_microlens_images_off_in_the_corner_only(ran):
    folder, _ = ran("stop_shapes")

    def light(stop, place):
        shot = pl.Exposure.load(folder / f"{stop}_{place}.exr")
        return _mean_and_error(shot, np.ones(shot.image.shape[:2], dtype=bool))

    whole, error = light("circle", "on_the_axis")
    cut, its_error = light("circle_and_stop_behind", "on_the_axis")
    assert abs(cut - whole) < 4 * np.hypot(error, its_error)
    # The lens of two overlapping circles that is left holds clearly less.
    assert light("circle_and_stop_behind", "upper_left_corner")[0] < 0.8 * light("circle", "upper_left_corner")[0]


def test_straight_blades_pass_the_share_of_the_circle_that_their_polygon_has(ran):
    folder, _ = ran("stop_shapes")
    # The microlens on the axis alone: its image ends 10.3 pixels from the centre, its neighbours' begin at 11.8.
    place = np.arange(24) - 11.5
    alone = np.hypot(place[:, None], place) < 11

    def light(stop):
        return _mean_and_error(pl.Exposure.load(folder / f"{stop}_on_the_axis.exr"), alone)

    round_one, error = light("circle")
    for blades in (6, 12):
        share = blades / (2 * np.pi) * np.sin(2 * np.pi / blades)
        cut, its_error = light(f"{blades}_blades")
        # Four standard errors, and 1 %: cos^4 varies by less over the image, and the pupil has hardly any distortion.
        assert abs(cut - share * round_one) < 4 * np.hypot(its_error, share * error) + 0.01 * share * round_one


def _mean_and_error(shot, where):
    """Mean over some pixels and its standard error; pixels are independent."""
    errors = shot.standard_error[where].astype(np.float64)
    return float(shot.image[where].mean(dtype=np.float64)), float(np.sqrt(np.sum(errors**2)) / errors.size)
