"""`plenoptic render`, `merge` and `estimate`: the bits of the library, parts of frames, what is refused and when."""

import dataclasses
import json
import os
import re
import signal

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.command.main import main
from plenoptic.command.tiles import missing_tiles, tile_grid
from plenoptic.rendering.schedule import tile_jobs

CAMERA = pl.camera.example_camera(shape=(21, 27))
SETTINGS = pl.rendering.RenderSettings(
    max_bounces=2, sampler=pl.rendering.Sampler.RANDOM, ghosts=pl.rendering.Ghosts(samples=2)
)
WALL = "o wall\nv -300 -300 -900\nv 300 -300 -900\nv 0 300 -900\nf 1 2 3\n"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The current folder, with a camera, settings and a scene."""
    monkeypatch.chdir(tmp_path)
    pl.package.save_value(CAMERA, "camera.json")
    pl.package.save_value(SETTINGS, "settings.json")
    (tmp_path / "wall.obj").write_text(WALL)
    return tmp_path


@pytest.fixture
def nothing_rendered(monkeypatch):
    """Where anything would be, the test fails."""

    def rendered(*arguments, **named):
        raise AssertionError("rendered")

    monkeypatch.setattr(tile_jobs, "render_tile", rendered)


def run(typed):
    assert main(typed.split()) == 0


@pytest.fixture
def refused(capsys):
    """What is said, in one line, of a command that is refused."""

    def refuse(typed):
        capsys.readouterr()
        assert main(typed.split()) == 1, typed
        out, err = capsys.readouterr()
        assert out == "" and err.count("\n") == 1 and err.startswith("plenoptic "), (typed, err)
        return err

    return refuse


def same(one, other):
    one, other = (pl.Exposure.load(shot) if isinstance(shot, str) else shot for shot in (one, other))
    assert np.array_equal(one.image, other.image) and np.array_equal(one.standard_error, other.standard_error)
    assert one.truth == other.truth and one.samples == other.samples and one.seed == other.seed
    assert one.region == other.region and one.camera == other.camera and one.settings == other.settings


def test_tiles_that_are_merged_have_the_bits_of_the_whole(capsys, refused):
    usual = "wall.obj camera.json --samples 8 --background 1 --truth depth,normal --seed 3"
    run(f"render {usual} -o whole.exr")
    out, err = capsys.readouterr()
    assert out.startswith("whole.exr: Exposure(21 x 27 x 1, 8 samples per pixel") and "RenderStats(" in out and not err
    for k in range(1, 7):
        run(f"render {usual} --tile {k}/6 -o part{k}.exr")
    capsys.readouterr()
    run("merge part4.exr part1.exr part6.exr part2.exr part5.exr part3.exr -o merged.exr")
    assert capsys.readouterr().out.startswith("merged.exr: Exposure(21 x 27 x 1, 8 samples per pixel")
    same("merged.exr", "whole.exr")
    whole = pl.Exposure.load("whole.exr").image
    scene = pl.Scene(pl.load_file("wall.obj").meshes, background=1.0)
    wanted = pl.Truth.DEPTH | pl.Truth.NORMAL
    direct = pl.render(scene, CAMERA, samples=8, seed=3, truth=wanted, progress=False)
    assert np.array_equal(direct.image, whole)

    said = refused("merge part4.exr part1.exr part6.exr part2.exr part5.exr -o less.exr")
    assert said.startswith("plenoptic merge: tile 3/6 is missing; ")
    assert "tile 4/6; 5/6; 6/6 are missing" in refused("merge part1.exr part2.exr part3.exr -o less.exr")
    run("merge part1.exr part2.exr part3.exr -o top.exr --region 0:8,0:27")
    assert np.array_equal(pl.Exposure.load("top.exr").image, whole[:8])
    refused("merge part1.exr part2.exr part1.exr -o less.exr")
    assert not os.path.exists("less.exr")


def test_tiles_in_stores_come_to_the_same(capsys, refused):
    pytest.importorskip("zarr", reason="the extra `zarr` installs it")
    run("render --white camera.json --samples 4 -o whole.zarr")
    for k in (1, 2):
        run(f"render --white camera.json --samples 4 --tile {k}/2 -o part{k}.zarr")
    run("merge part1.zarr part2.zarr -o merged.zarr")
    same("merged.zarr", "whole.zarr")
    run("render --white camera.json --samples 4 --tile 2/2 -o part2.exr")
    run("render --white camera.json --samples 4 --seed 1 -o other.exr")
    pl.package.write("other.zip", pl.Exposure.load("other.exr"))
    capsys.readouterr()
    run("merge part1.zarr part2.exr -o mixed.zarr")
    assert capsys.readouterr().out.startswith("mixed.zarr: Exposure(21 x 27 x 1, 4 samples per pixel, ")
    same("mixed.zarr", "whole.zarr")
    run("merge mixed.zarr other.zip -o both.zarr")  # two seeds, one of them in a package
    both = pl.Exposure.merged([pl.Exposure.load("whole.zarr"), pl.Exposure.load("other.exr")])
    same("both.zarr", both)
    assert both.seed == (0, 1)
    for typed, said in (
        ("part1.zarr -o less.zarr --region :,:", "are missing|is missing"),
        ("both.zarr other.exr -o less.zarr", "have the seed 1"),
    ):
        assert re.search(said, refused(f"merge {typed}")) and not os.path.exists("less.zarr")
    run("render --white merged.zarr --samples 4 -o again.exr")  # with the camera of a store
    assert np.array_equal(pl.Exposure.load("again.exr").image, pl.Exposure.load("whole.zarr").image)


def test_settings_come_from_files_and_options():
    common = "render wall.obj camera.json --samples 2 --region 0:8,:8 --truth none"
    run(f"{common} --settings settings.json --clamp 5 --caustics left-out -o a.exr")
    wanted = dataclasses.replace(SETTINGS, clamp=5.0, caustics=pl.rendering.Caustics.EXCLUDE)
    shot = pl.Exposure.load("a.exr")
    assert (shot.settings, shot.truth, shot.region) == (wanted, None, (0, 8, 0, 8))
    run(f"{common} --background 2 --max-bounces 0 --replicates 1 --threads 1 -o b.exr")
    shot = pl.Exposure.load("b.exr")
    assert (shot.settings.max_bounces, shot.replicates, shot.standard_error) == (0, 1, None)
    run("render --white a.exr --samples 2 --region 0:8,0:8 -o white.exr")  # with the camera of an image
    assert pl.Exposure.load("white.exr").white and pl.Exposure.load("white.exr").camera == CAMERA


def test_scenes_of_other_units_are_seen_from_their_cameras(folder, refused, capsys):
    """A wall of numbers in metres, seen by the file's camera, 0.9 m away; black without a background."""
    wall = pl.load_file("wall.obj").meshes[0]
    points = (wall.vertices / 1000.0 + (0.0, 0.0, 0.404)).astype("<f4")
    data = points.tobytes() + wall.faces.astype("<u4").tobytes()
    (folder / "wall.bin").write_bytes(data)
    gltf = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": "wall.bin", "byteLength": len(data)}],
        "bufferViews": [
            {"buffer": 0, "byteLength": points.nbytes},
            {"buffer": 0, "byteOffset": points.nbytes, "byteLength": len(data) - points.nbytes},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": len(points)},
            {"bufferView": 1, "componentType": 5125, "type": "SCALAR", "count": wall.faces.size},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "cameras": [{"name": "front", "type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.1}}],
        "nodes": [{"mesh": 0}, {"camera": 0, "name": "front", "translation": [0, 0, 0.404]}],
        "scenes": [{"nodes": [0, 1]}],
    }
    (folder / "wall.gltf").write_text(json.dumps(gltf))
    common = "camera.json --samples 4 --background 1 --region 0:8,0:8"
    run(f"render wall.gltf {common} --view front -o view.exr")
    run(f"render wall.gltf {common} --view 0 --diffraction microlenses -o bent.exr")
    seen, bent = (pl.Exposure.load(name) for name in ("view.exr", "bent.exr"))
    assert np.allclose(seen.depth, 900.0) and bent.camera.diffraction == pl.Diffraction()
    assert seen.camera.pose.position.tolist() == [0.0, 0.0, 404.0]
    assert "the cameras of 'wall.gltf' are 'front'" in refused(f"render wall.gltf {common} --view side -o a.exr")
    assert "unit is 'furlong'" in refused(f"render wall.gltf {common} --unit furlong -o a.exr")
    run("render wall.obj camera.json --samples 4 -o black.exr --region 0:8,0:8")
    assert "nothing in the scene emits light" in capsys.readouterr().err


def test_remedies_are_options_and_all_faults_are_named(folder, refused, capsys):
    """A triangle in metres that is read as mm, without a light; then one in mm that is read as m."""
    (folder / "metres.obj").write_text("v -0.05 -0.05 -0.4\nv 0.05 -0.05 -0.4\nv 0 0.05 -0.4\nf 1 2 3\n")
    run("render metres.obj camera.json --samples 4 -o black.exr")
    err = capsys.readouterr().err
    assert "give it --background 1" in err and "the unit of its numbers: --unit m\n" in err and "pl." not in err, err
    run("render wall.obj camera.json --samples 4 --background 1 --unit m -o large.exr")
    assert "the unit of its numbers: --unit mm" in capsys.readouterr().err
    assert "such as --samples 64" in refused("render wall.obj camera.json -o a.exr")
    assert "--samples and --target-error are missing" in refused("estimate wall.obj camera.json")


def test_what_is_refused_is_told_in_one_line_and_before(folder, refused, nothing_rendered):
    (folder / "folder.exr").mkdir()
    usual = "wall.obj camera.json --samples 4 --background 1 -o a.exr"
    for typed, said in (
        ("wall.obj camera.json --samples 4 -o nowhere/a.exr", "does not exist; make it first"),
        ("wall.obj camera.json --samples 4 -o a.jpg", "it must end in .exr, .zarr"),
        ("wall.obj camera.json --samples 4 -o folder.exr", "is a folder; give the path of a file"),
        (f"{usual} --tile 3/1000", "cannot be cut into 1000 equal rows and columns"),
        (f"{usual} --region 30:40,0:8", "it must take at least one"),
        (f"{usual} --truth depth,nrmal", "--truth has 'nrmal'; it must be one"),
        (f"{usual} --settings camera.json", "give RenderSettings"),
        (f"{usual} --checkpoint nowhere/c", "does not exist; make it first"),
        ("wall.obj camera.json -o a.exr", "--samples, --time-limit and --target-error are missing"),
        ("camera.json --samples 4 -o a.exr", "give SCENE and CAMERA, or --white and CAMERA"),
        (f"--white {usual}", "'wall.obj' is one too many"),
        ("--white camera.json --samples 4 -o a.exr --max-bounces 3", "--max-bounces is about a scene"),
        ("camera.json wall.obj --samples 4 -o a.exr", "holds no camera"),
    ):
        err = refused(f"render {typed}")
        assert said in err and err.startswith("plenoptic render: "), (typed, err)


def test_wrong_usage_ends_with_2(capsys, nothing_rendered):
    tiles = [f"-o a.exr --tile {wrong}" for wrong in ("5/4", "0/4", "a/b", "3", "1/2 --region 0:8,0:8")]
    for wrong in (*tiles, "-o a.exr --region 0:8", ""):
        with pytest.raises(SystemExit) as ended:
            main(f"render wall.obj camera.json --samples 4 {wrong}".split())
        assert ended.value.code == 2 and "usage: plenoptic render" in capsys.readouterr().err, wrong


def test_what_is_no_part_is_named(refused):
    run("render --white camera.json --samples 4 --tile 1/2 -o a.exr")
    nearer = dataclasses.replace(CAMERA, stop_to_microlenses=120.0)
    dataclasses.replace(pl.Exposure.load("a.exr"), camera=nearer).save("b.exr")
    for parts, said in (
        ("a.exr wall.obj", "'wall.obj' is a scene; give an image"),
        ("a.exr missing.exr", "'missing.exr' does not exist"),
        ("a.exr b.exr", "b.exr has another camera than a.exr"),
    ):
        assert said in refused(f"merge {parts} -o c.exr")


def test_an_interrupted_render_is_saved_and_goes_on_from_its_checkpoint(capsys, monkeypatch):
    run("render wall.obj camera.json --samples 600 -o whole.exr")
    typed = "render wall.obj camera.json --samples 600 --threads 1 --checkpoint state -o part.exr"
    original, calls = tile_jobs.render_tile, []

    def interrupted(*arguments, **named):
        result = original(*arguments, **named)
        if arguments[1].pixels:
            calls.append(0)
            if len(calls) == 2:
                signal.raise_signal(signal.SIGINT)
        return result

    with monkeypatch.context() as patched:
        patched.setattr(tile_jobs, "render_tile", interrupted)
        assert main(typed.split()) == 130
    out, err = capsys.readouterr()
    assert "part.exr: Exposure(" in out and pl.Exposure.load("part.exr").interrupted
    assert err.endswith("interrupted\n") and "warning: the render was interrupted" in err
    run(typed)
    same("part.exr", "whole.exr")


def test_estimates_are_printed_for_people_and_for_programs(capsys, refused):
    run("estimate wall.obj camera.json --samples 8 --settings settings.json --tile 1/2 --time-limit 9 -o nowhere/a.exr")
    out = capsys.readouterr().out
    for word in (
        "aperture regions, ",
        "ghosts; ",
        " others are left out",
        "processor time ",
        "samples per pixel  8",
        "peak memory ",
        "checkpoint ",
    ):
        assert word in out
    run("estimate --white camera.json --samples 8 --json")
    found = json.loads(capsys.readouterr().out)
    assert set(found) == {
        "cpu_seconds",
        "seconds",
        "peak_memory",
        "file_size",
        "checkpoint_size",
        "samples",
        "relative_error",
    }
    assert found["samples"] == {"value": 8, "low": 8, "high": 8}
    assert all(0 < one["low"] <= one["value"] <= one["high"] for one in found.values())
    assert "--samples and --target-error are missing" in refused("estimate wall.obj camera.json --time-limit 4")


def test_tiles_are_as_square_as_can_be_and_the_missing_ones_are_found():
    assert tile_grid((512, 1024), 8) == (2, 4) and tile_grid((1024, 512), 8) == (4, 2)
    assert tile_grid((5368, 7716), 64) == (8, 8) and tile_grid((512, 512), 7) in ((1, 7), (7, 1))
    assert tile_grid((16, 16), 5) is None and tile_grid((16, 16), 1 << 40) is None
    shape = (517, 389)
    camera = dataclasses.replace(CAMERA, sensor=pl.Sensor(shape=shape, pixel_pitch=0.01))
    for n in (2, 6, 16, 64):
        regions = [(r.start, r.stop, c.start, c.stop) for r, c in camera.tiles(*tile_grid(shape, n))]
        assert missing_tiles(shape, regions[:-1]) == [(n, n)]
        assert missing_tiles(shape, regions[1::2]) == [(k, n) for k in range(1, n + 1, 2)]
        assert missing_tiles(shape, [(1, 9, 0, 16)]) == []
