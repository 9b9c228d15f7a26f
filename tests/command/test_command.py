"""The command `plenoptic`: what it prints, its exit codes, and one line for whatever it refuses."""

import subprocess
import sys
import webbrowser

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.command.main import COMMANDS, main
from plenoptic.core.warn import warn
from plenoptic.rendering import warm_up as warming
from plenoptic.rendering.exposure_files import Layout, create_store

LENS = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(5.0))
CAMERA = pl.camera.example_camera(shape=(4, 6))
SHOT = pl.Exposure(np.linspace(0.0, 1.0, 24).reshape(4, 6, 1), camera=CAMERA)


@pytest.fixture
def files(tmp_path, monkeypatch):
    """One of each kind, in the current folder."""
    monkeypatch.chdir(tmp_path)
    pl.package.save_value(CAMERA, "camera.json")
    pl.save_lens(LENS, "lens.json")
    SHOT.save("shot.exr")
    SHOT.save("shot.png")
    SHOT.develop(pl.SensorModel(photon_rate=1e3, bits=12)).save("raw.tif")
    (tmp_path / "wall.obj").write_text("v 0 0 0\nv 3 0 0\nv 0 2 0\nf 1 2 3\n")
    (tmp_path / "broken.json").write_text("{")
    (tmp_path / "notes.md").write_text("hello")
    (tmp_path / "empty").mkdir()
    return tmp_path


def test_info_says_what_a_file_is(files, capsys):
    for name, kind, said in (
        ("camera.json", "PlenopticCamera", "focused plenoptic camera, Galilean"),
        ("lens.json", "a lens", "focal length 100.716 mm"),
        ("double-gauss-100mm-f2", "comes with the package", "f/2.03"),
        ("shot.exr", "an image", "values 0 to 1, median 0.5"),
        ("shot.png", "an image", "Exposure(4 x 6 x 1"),
        ("raw.tif", "a raw image", "12 bits"),
        ("wall.obj", "a scene", "3 x 2 x 0 mm, from (0, 0, 0) to (3, 2, 0)\nmaterials: Lambertian"),
    ):
        assert main(["info", name]) == 0, name
        out, err = capsys.readouterr()
        assert out.startswith(f"{name}: ") and kind in out.splitlines()[0] and said in out and err == "", name


def test_info_says_what_a_package_and_a_light_field_are(files, capsys):
    views = np.random.default_rng(1).random((3, 3, 8, 8, 3))
    folder = files / "field"
    folder.mkdir()
    for number, view in enumerate(views.reshape(9, 8, 8, 3)):
        pl.Exposure(view).save(folder / f"input_Cam{number:03d}.png", scale=1.0)
    text = "[intrinsics]\nfocal_length_mm = 100\nimage_resolution_x_px = 8\nimage_resolution_y_px = 8\n"
    text += "sensor_size_mm = 35\nfstop = 100\n[extrinsics]\nnum_cams_x = 3\nnum_cams_y = 3\nbaseline_mm = 30\n"
    (folder / "parameters.cfg").write_text(text + "focus_distance_m = 1\n[meta]\nscene = x\ncategory = x\n")
    assert main(["info", "field"]) == 0
    assert "LightField(3 x 3 views of 8 x 8 x 3)" in capsys.readouterr().out


def test_info_without_a_file_names_versions_threads_and_the_cache(capsys):
    assert main(["info"]) == 0
    out = capsys.readouterr().out
    for word in (f"plenoptic {pl.__version__}", f"numpy {np.__version__}", "threads", "compiled code: ", "achromat"):
        assert word in out


def test_info_says_what_a_store_holds_and_view_opens_it(files, capsys):
    pytest.importorskip("zarr", reason="the extra `zarr` installs it")
    SHOT.save("shot.zarr")
    create_store("many.zarr", Layout((4, 6), 1, ("image", "depth")), {}, times=np.arange(5.0))
    for name, said in (
        ("shot", "an exposure in a zarr store\n"),
        ("shot", "image (row 4, column 6, channel 1) float32, scene units sr, irradiance"),
        ("shot", "focused plenoptic camera, Galilean"),
        ("many", "a sequence of exposures in a zarr store\n"),
        ("many", "depth (frame 5, row 4, column 6) float64, mm, -z in the camera's frame"),
    ):
        assert main(["info", f"{name}.zarr"]) == 0
        assert said in capsys.readouterr().out
    assert main(["view", "shot.zarr", "--output", "page.html", "--no-browser"]) == 0
    assert main(["view", "many.zarr", "--output", "page.html", "--no-browser"]) == 1
    assert "holds a sequence; open it with xarray.open_zarr" in capsys.readouterr().err


def test_what_is_refused_is_told_in_one_line(files, capsys):
    # As Python has the byte ff of a Latin-1 file name.
    latin = ("info ?.exr", "info ?.json", "view ?.png", "view shot.exr --output ?.html", "warm-up --scene ?.obj")
    for typed, said in (
        ("info missing.exr", "plenoptic info: 'missing.exr' does not exist; check the path"),
        ("info notes.md", "ends in '.md'; files that can be opened end in .csv, .exr"),
        ("info broken.json", "is not JSON"),
        ("info empty", "give one of them, or a file"),
        ("view wall.obj", "plenoptic view: 'wall.obj' is a scene; give an image"),
        ("view shot.exr --output nowhere/page.html", "make it first"),
        ("warm-up --scene camera.json", "is a value of the kind PlenopticCamera; give a scene"),
        ("warm-up --camera wall.obj", "holds no camera"),
        *((typed.replace("?", "\udcff"), "is not UTF-8; rename") for typed in (*latin, "warm-up --camera ?.json")),
    ):
        assert main(typed.split()) == 1, typed
        out, err = capsys.readouterr()
        assert out == "" and said in err and err.count("\n") == 1 and err.startswith("plenoptic "), (typed, err)


def test_images_in_folders_that_are_not_utf_8_are_refused(files):
    for call in (pl.Exposure.load, SHOT.save):
        with pytest.raises(pl.errors.FileError, match="is not UTF-8"):
            call("\udcff/shot.exr")


def test_wrong_usage_ends_with_2_and_help_is_there(capsys):
    for typed in ("", "frobnicate", "info a b", "view", "warm-up --samples 4"):
        with pytest.raises(SystemExit) as ended:
            main(typed.split())
        assert ended.value.code == 2 and "usage: plenoptic" in capsys.readouterr().err, typed
    for name in (None, *COMMANDS):
        with pytest.raises(SystemExit) as ended:
            main([*([] if name is None else [name]), "--help"])
        out = capsys.readouterr().out
        assert ended.value.code == 0 and all(command in out for command in ([name] if name else COMMANDS))


def test_view_writes_a_page_and_opens_it(files, capsys, monkeypatch):
    opened = []
    monkeypatch.setattr(pl.Exposure, "save_html", lambda shot, path: path.write_text(repr(shot)), raising=False)
    monkeypatch.setattr(webbrowser, "open", lambda address: opened.append(address) or True)
    assert main(["view", "shot.exr", "--output", "page.html", "--no-browser"]) == 0
    assert capsys.readouterr().out == "page.html\n" and "Exposure(4 x 6 x 1" in (files / "page.html").read_text()
    assert opened == []
    assert main(["view", "shot.exr"]) == 0
    written = capsys.readouterr().out.strip()
    assert written.endswith("shot.html") and opened[0].startswith("file:///")
    monkeypatch.setattr(webbrowser, "open", lambda address: False)
    assert main(["view", "shot.exr", "--output", "page.html"]) == 1
    assert "no browser could be opened" in capsys.readouterr().err


def test_warnings_take_one_line_and_interrupted_it_ends_with_130(capsys, monkeypatch):
    def run(options):
        warn("first\nsecond")
        raise KeyboardInterrupt

    monkeypatch.setattr(COMMANDS["info"], "run", run)
    assert main(["info"]) == 130
    assert capsys.readouterr().err == "warning: first second\ninterrupted\n"


def test_warm_up_names_scene_and_camera(files, capsys, monkeypatch):
    given = []
    done = warming.WarmUp(("fill_through_lens",), 1.5)
    monkeypatch.setattr(warming, "warm_up", lambda *of, depth, progress: given.append((*of, depth)) or done)
    assert main(["warm-up", "--scene", "wall.obj", "--camera", "shot.exr", "--depth"]) == 0
    assert capsys.readouterr().out == "wall.obj, shot.exr: compiled in 1.5 s: fill_through_lens\n"
    assert given[0][1] == CAMERA and len(given[0][0].meshes) == 1
    assert main(["warm-up"]) == 0
    assert [depth for *_, depth in given] == [True] + 9 * [False]


def test_it_is_a_program(files):
    call = [sys.executable, "-m", "plenoptic"]
    done = subprocess.run([*call, "info", "wall.obj"], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "") and "1 triangle" in done.stdout
    loaded = "import sys, plenoptic.study, plenoptic.command.main; print({*sys.modules} & {*sys.argv})"
    slow = ["numba", "trimesh", "matplotlib", "mpmath"]
    assert subprocess.run([sys.executable, "-c", loaded, *slow], capture_output=True, text=True).stdout == "set()\n"
