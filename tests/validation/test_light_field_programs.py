"""Other programs open what is exported for them, by their own command lines, and find what this package knows.

They need old libraries, in an environment of their own, which the tests make. Where that cannot be had, tests skip.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl

pytestmark = [pytest.mark.validation, pytest.mark.timeout(1200)]

# Of torch, which plenpy asks for, a stub is enough.
PROGRAMS = ["plenopticam==0.9.3", "plenpy==0.9.2"]
LIBRARIES = Path(__file__).resolve().parents[2] / "examples" / "benchmark" / "programs.txt"
STUBS = """
import sys, types
class Stub(types.ModuleType):
    def __getattr__(self, name):
        if name.startswith("__"):
            raise AttributeError(name)
        return type(name, (), {})
for name in ("torch", "torchvision", "torchvision.transforms"):
    sys.modules[name] = Stub(name)
"""


@pytest.fixture(scope="module")
def programs(tmp_path_factory):
    """The folder with their Python and commands."""
    return installed(tmp_path_factory.mktemp("programs"), ["--no-deps", *PROGRAMS], ["-r", str(LIBRARIES)])


def installed(folder, *wanted):
    """The commands of a new environment with what pip is to install, step by step."""
    folder = folder / "env"
    pip = [str(folder / "bin" / "python"), "-m", "pip", "install", "-q"]
    for step in ([sys.executable, "-m", "venv", str(folder)], *([*pip, *part] for part in wanted)):
        done = subprocess.run(step, capture_output=True, text=True)
        if done.returncode:
            pytest.skip(f"cannot be installed: {done.stderr[-300:]}")
    return folder / "bin"


def camera_of(shape, **array):
    lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=3.5))
    return pl.PlenopticCamera(lens, pl.Sensor(shape, 0.01), 134.6, pl.MicrolensArray(0.147, (1.2,), **array), 1.2)


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """A plenoptic 1.0 camera, and folders for both programs."""
    camera = camera_of((604, 604))
    camera = camera.moved(pl.CameraPart.MICROLENSES, shift=(0.03, -0.05, 0.0), tilt=(0.0, 0.0, 0.002))
    white = pl.render_white(camera, samples=16, seed=1, progress=False)
    shot = pl.render(pl.check_scene(), camera, samples=16, progress=False)
    folder = tmp_path_factory.mktemp("exported")
    pl.export.plenopticam(folder / "a", shot, white)
    pl.export.plenpy(folder / "b", shot, white)
    return camera, shot, white, folder


def run(folder, command):
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, env={**os.environ, "MPLBACKEND": "Agg"})
    return done.stdout + done.stderr


def found_by(folder, python, script):
    """What a script prints as JSON behind FOUND."""
    said = run(folder, [str(python), "-c", script])
    lines = [line for line in said.splitlines() if line.startswith("FOUND")]
    assert lines, said[-3000:]
    return json.loads(lines[0][6:])


def distances(found, known):
    return np.sqrt(((np.asarray(found)[:, None] - np.asarray(known)[None]) ** 2).sum(axis=2)).min(axis=1)


def commands(folder):
    """What README.txt tells to type, by what stands before it."""
    found = {}
    for line in (folder / "README.txt").read_text().splitlines():
        name, _, command = line.partition(":")
        if " --" in command:
            found[name] = command.partition("  (")[0].split()
    return found


def test_plenopticam_finds_our_centres_and_makes_views(programs, exported):
    *_, folder = exported
    own = json.loads((folder / "a" / "shot_centres.json").read_text())["mic_list"]
    typed = commands(folder / "a")

    def typing(what):
        program, *arguments = typed[what]
        return run(folder / "a", [str(programs / program), *arguments])

    said = typing("with its own search")
    found = json.loads((folder / "a" / "shot_white.json").read_text())["mic_list"]
    off = distances(np.array(found)[:, :2], np.array(own)[:, :2])
    # It lists lenses at the border that are not wholly in the image.
    inside = off < 3.0
    assert inside.sum() >= 0.95 * len(own), said[-2000:]
    assert np.sqrt(np.mean(off[inside] ** 2)) < 0.05
    said = typing("with these centres")
    views = sorted((folder / "a" / "shot").glob("viewpoints_*/*.png"))
    size = int(np.sqrt(len(views)))
    assert size >= 9 and size**2 == len(views), said[-2000:]
    # The squares of the scene are seen: bright and black ones.
    seen = pl.images.read_linear(views[len(views) // 2])[:, :, 0]
    assert min(seen.shape) > 30 and np.percentile(seen, 90) > 10 * np.percentile(seen, 10)


def test_plenpy_finds_our_centres_and_makes_views(programs, exported):
    *_, folder = exported
    text = (folder / "b" / "README.txt").read_text()
    call = text[text.index("from plenpy") : text.index("What it cannot")]
    script = f"""{STUBS}
import json
folder = {str(folder / "b")!r}
{call}
from plenpy.utilities.grids import HexGrid
points = HexGrid(camera._calibrationDb[0]["ideal_grid_params"]).gridPoints
print("FOUND", json.dumps([list(camera.get_decoded_image(0).shape), points.tolist()]))
"""
    shape, points = found_by(folder, programs / "python", script)
    assert shape[0] == shape[1] >= 9
    listed = np.array(json.loads((folder / "a" / "shot_centres.json").read_text())["mic_list"])
    off = distances(listed[:, :2], np.array(points))
    # Its grid ends before the border.
    inside = off < 3.0
    assert inside.mean() > 0.9 and np.sqrt(np.mean(off[inside] ** 2)) < 0.1


def test_pyolaf_loads_our_microscope_and_finds_its_lenses(tmp_path):
    camera = camera_of((500, 600), lattice=pl.Lattice.SQUARE)
    white = pl.render_white(camera, samples=16, progress=False)
    pl.export.pyolaf(tmp_path, white, white)
    script = """
import json, numpy as np, tifffile
from pyolaf.geometry import LFM_processWhiteImage, LFM_setCameraParams
camera = LFM_setCameraParams("config.yaml", 15)
pitch = camera["lensPitch"] / camera["pixelPitch"]
model, centres = LFM_processWhiteImage(tifffile.imread("calib.tif"), pitch, "reg", False)
print("FOUND", json.dumps([camera["M"], float(model["HSpacing"]), np.asarray(centres).reshape(-1, 2).tolist()]))
"""
    larger, spacing, centres = found_by(tmp_path, installed(tmp_path, ["pyolaf==0.2.1"]) / "python", script)
    known, found = pl.microlens_centres(camera).pixel, np.array(centres)[:, ::-1]
    inside = ((found > 15) & (found < np.array(camera.sensor.shape) - 15)).all(axis=1)
    assert larger == pytest.approx(abs(pl.paraxial.magnification(camera.lens, float(camera.report().array_plane))))
    # It looks for whole pixels, and needs images that do not touch: where they fill 0.95 of their distance, it is 2 px
    # off.
    assert spacing == pytest.approx(np.abs(np.diff(np.unique(known[:, 1].round(3)))).max(), rel=1e-3)
    assert inside.sum() > 1000 and np.sqrt(np.mean(distances(found[inside], known) ** 2)) < 0.2
