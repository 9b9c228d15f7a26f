"""Data sets: frames are what `render` gives, and the same bits however often writing was stopped."""

import csv
import dataclasses
import hashlib
import itertools
import json
import os
import shutil

import fake_client
import numpy as np
import pytest
from PIL import Image

import plenoptic as pl
from plenoptic.core.files.atomic_file import claim_folder
from plenoptic.dataset import tables, task, writing
from plenoptic.errors import FileError, FileWarning, InvalidValueError
from plenoptic.scene.geometry.instance import Instances

pytest.importorskip("zarr", reason="the extra `zarr` installs it")

CAMERA = dataclasses.replace(pl.camera.example_camera(), sensor=pl.Sensor(shape=(12, 16), pixel_pitch=0.2))
FLAT = dataclasses.replace(CAMERA, microlenses=None, microlenses_to_sensor=0.0)
RIGHT = dataclasses.replace(CAMERA, pose=pl.Pose.look_at((10, 0, 0), target=(0, 0, -404)))
DIE = dataclasses.replace(pl.box(2.4).translated(z=-404), name="die")
SCENE = pl.Scene([pl.quad((-80, -80, -420), (160, 0, 0), (0, 160, 0)), DIE], background=0.3)
TURN = pl.Motion.screw((0, 1), axis=(1, 2, 0.5), through=(0, 0, -404), angle_deg=60, advance=1.5)
TRUTH = pl.Truth.DEPTH | pl.Truth.OBJECT
HOW = {"samples": 8, "truth": TRUTH, "progress": False}
PAIR = {"left": CAMERA, "right": RIGHT}
OF_PAIR = {**HOW, "cameras": PAIR, "motion": True, "seed": 5}


def sequence(frames=3, **changes):
    return pl.Sequence(SCENE, CAMERA, np.arange(frames) / 4, motions={"die": TURN}, **changes)


def contents(folder):
    """All arrays of all stores, and the manifest without the hashes of inputs."""
    found = {}
    for store in sorted(folder.glob("*.zarr")):
        data = pl.dataset.read(folder).open(store.stem)
        found |= {(store.stem, name): data[name].values for name in data.variables}
    return found, json.loads((folder / "manifest.json").read_text())


def assert_same(one, other):
    (arrays, manifest), (others, theirs) = contents(one), contents(other)
    assert arrays.keys() == others.keys() and manifest == theirs
    for name, array in arrays.items():
        np.testing.assert_array_equal(array, others[name], err_msg=str(name))


@pytest.fixture(scope="module")
def single(tmp_path_factory):
    return pl.dataset.write(tmp_path_factory.mktemp("sets") / "single", sequence(2), **HOW)


@pytest.fixture
def copied(single, tmp_path):
    """A copy of the set of two frames, another one at each call."""
    numbers = itertools.count()
    return lambda: shutil.copytree(single.path, tmp_path / f"copy {next(numbers)}")


@pytest.fixture
def mended(single):
    """Goes on with a folder, which then holds the set of two frames."""

    def write(folder, **more):
        pl.dataset.write(folder, sequence(2), **HOW, **more)
        assert_same(single.path, folder)

    return write


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return pl.dataset.write(tmp_path_factory.mktemp("sets") / "pair", sequence(), **OF_PAIR)


def test_frames_are_what_render_gives(made):
    assert repr(made) == "DataSet(3 frames, cameras left, right)" and made.complete
    seeds = set()
    for name, camera in PAIR.items():
        for k, seen in enumerate(dataclasses.replace(sequence(), camera=camera)):
            got = made.frame(k, name)
            shot = pl.render(seen.scene, seen.camera, seed=got.seed, **HOW)
            assert got == dataclasses.replace(shot, stats=None)
            assert got.camera == seen.camera and seen.time == k / 4
            seeds.add(got.seed)
    assert len(seeds) == 6 and made.frame(-1, "left") == made.frame(2, "left")


def test_motions_are_those_of_motion_truth(made):
    for name, camera in PAIR.items():
        _, now, following = dataclasses.replace(sequence(), camera=camera)
        wanted, got = pl.sequences.motion_truth(now, following, progress=False), made.motion(1, name)
        for field in ("position", "shift", "visible"):
            np.testing.assert_array_equal(getattr(got, field), getattr(wanted, field))
    with pytest.raises(InvalidValueError, match="frame 2 of 'left' has no motion: it is the last one"):
        made.motion(2, "left")


def test_the_manifest_says_where_things_are(made):
    again = pl.dataset.read(made.path)
    assert again.manifest == made.manifest and len(again) == 3
    images = made.manifest["images"]
    assert [(image["frame"], image["camera"]) for image in images[:3]] == [(0, "left"), (0, "right"), (1, "left")]
    for image in images:
        matrix = np.array(image["object_to_world"]["die"])
        np.testing.assert_allclose(matrix, TURN.matrices([image["time"]])[0], atol=1e-12)
        assert made.manifest["object_names"][image["object_names"]] == ["Mesh 0", "die", ""]
    assert len(made.manifest["cameras"]["left"]) == 1  # poses are said of each image
    assert len({image["inputs"] for image in images}) == len({image["parts"][0]["sha256"] for image in images}) == 6


def test_the_manifest_has_the_hashes_of_what_xarray_reads(made):
    for image in made.manifest["images"]:
        data = made.open(image["camera"]).isel(frame=image["frame"])
        for part in image["parts"]:
            sha, rows, motion = hashlib.sha256(), slice(*part["rows"]), part["of"] == "motion"
            assert part["arrays"] == sorted(name for name in data if name.startswith("motion") == motion)
            for name in part["arrays"]:
                sha.update(name.encode() + data[name].values[rows].tobytes())
            assert sha.hexdigest() == part["sha256"]


def test_places_are_told_of_names_that_one_object_has(tmp_path):
    there = [Instances(DIE, np.eye(4)[None]), Instances(dataclasses.replace(DIE, name=""), np.eye(4)[None])]
    twice = [Instances(dataclasses.replace(DIE, name="twin"), np.eye(4)[None]) for _ in range(2)]
    frame = pl.sequences.Frame(pl.Scene([*there, *twice], background=0.3), CAMERA, 0.0)
    found = pl.dataset.write(tmp_path / "set", [frame], **HOW)
    assert list(found.manifest["images"][0]["object_to_world"]) == ["die", "Instances 1"]


def test_statistics_and_contact_sheet_are_those_of_the_images(made):
    sheet = np.asarray(Image.open(made.path / "contact_sheet.png").convert("L"))
    assert sheet.shape[1] > 3 * 80 and sheet.min() < 100 and sheet.max() == 255
    # "left: 3 frames, 0.123 is white": letters are at most 2 pixels apart, words at least 4.
    inked = (sheet[1:14] < 128).any(axis=0)
    gaps = np.diff(np.flatnonzero(inked)) - 1
    assert (gaps >= 4).sum() == 5 and not ((gaps > 2) & (gaps < 4)).any()
    with open(made.path / "statistics.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 6
    for row in rows:
        shot = made.frame(int(row["frame"]), row["camera"])
        assert float(row["mean"]) == pytest.approx(shot.image.mean(dtype=np.float64), rel=1e-12)
        assert float(row["percentile_99"]) == pytest.approx(np.percentile(shot.image, 99), rel=1e-6)
        assert float(row["relative_error"]) == shot.relative_error
        assert float(row["cpu_seconds"]) >= 0 and int(row["paths"]) == 12 * 16 * 8
        assert (row["motion_visible"] == "") == (row["frame"] == "2")


def test_xarray_knows_times_and_units(made):
    data = made.open("right")
    assert data.sizes["frame"] == 3 and data.time.values.tolist() == [0.0, 0.25, 0.5] and data.time.units == "s"
    assert data.motion_shift.units == "px" and data.along.values.tolist() == ["columns", "rows"]
    with pytest.raises(InvalidValueError, match="camera is None; it must be one of left, right"):
        made.open()


STEPS = ("render", "motion_truth", "put", "flush", "add", "write_manifest", "write_contact_sheet")


class Killed(BaseException):
    pass


def test_stopped_before_any_step_it_goes_on_with_the_same_bits(tmp_path, monkeypatch):
    how = {**HOW, "motion": True}
    whole = pl.dataset.write(tmp_path / "whole", sequence(2), **how)
    for step in STEPS:
        broken = tmp_path / step
        owner = {"put": writing.Store, "flush": writing.Store, "add": writing.Journal}.get(step, writing)
        real, calls = getattr(owner, step), itertools.count(1)
        last = 1 if step.startswith("write") or step == "motion_truth" else 2

        def killing(*given, real=real, calls=calls, last=last, **named):
            if next(calls) == last:
                raise Killed
            return real(*given, **named)

        with monkeypatch.context() as patch:
            patch.setattr(owner, step, killing)
            with pytest.raises(Killed):
                pl.dataset.write(broken, sequence(2), **how)
        assert pl.dataset.write(broken, sequence(2), **how).complete, broken
        assert_same(whole.path, broken)


def test_killed_before_its_log_was_begun_it_goes_on(mended, tmp_path):
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / f".{'0' * 16}-{'1' * 16}.part").write_bytes(b"plenoptic data")
    mended(tmp_path / "set")


def test_what_has_been_removed_is_refused_and_rendered_again(copied, mended):
    for lost in ("camera.zarr", "camera.zarr/image/c/1", "camera.zarr/depth/c/0/0/0"):
        folder = copied()
        path, frame = folder / lost, int("c/1" in lost)
        shutil.rmtree(path) if path.is_dir() else path.unlink()
        with pytest.raises(FileError):
            pl.dataset.read(folder).frame(frame)
        mended(folder)


def test_the_manifest_knows_what_each_image_was_made_by(tmp_path, monkeypatch):
    pl.dataset.write(tmp_path / "set", sequence(1), **HOW)
    monkeypatch.setattr(tables.platform, "python_version", lambda: "9.9")
    manifest = pl.dataset.write(tmp_path / "set", sequence(2), **HOW).manifest
    first, second = (manifest["versions"][image["versions"]] for image in manifest["images"])
    assert second == {**first, "python": "9.9"} != first and first["numpy"] == np.__version__


def test_a_sequence_may_become_longer_and_not_shorter(tmp_path):
    how = {**HOW, "motion": True}
    whole = pl.dataset.write(tmp_path / "whole", sequence(3), **how)
    assert len(pl.dataset.write(tmp_path / "grown", sequence(2), **how)) == 2
    long = pl.dataset.write(tmp_path / "grown", sequence(3), **how)
    assert_same(whole.path, long.path)
    assert np.isfinite(long.motion(1).shift).any()
    with pytest.raises(
        FileError, match="frame [12] is in .*, and the sequence has 1 frames; it may only become longer"
    ):
        pl.dataset.write(long.path, sequence(1), **how)
    assert pl.dataset.read(long.path).manifest == long.manifest


def test_nothing_is_rendered_twice(made, monkeypatch):
    def render(*_, **__):
        raise AssertionError("rendered again")

    monkeypatch.setattr(writing, "render", render)
    assert pl.dataset.write(made.path, sequence(), **OF_PAIR).manifest == made.manifest


def test_an_interrupted_frame_is_not_kept(tmp_path, monkeypatch):
    real, calls = writing.render, [0]

    def interrupting(*given, **named):
        calls[0] += 1
        shot = real(*given, **named)
        stopped = dataclasses.replace(shot.stats, stopped_by=pl.rendering.StopReason.INTERRUPTED)
        return shot if calls[0] < 2 else dataclasses.replace(shot, stats=stopped)

    monkeypatch.setattr(writing, "render", interrupting)
    partly = pl.dataset.write(tmp_path / "set", sequence(), **HOW)
    assert not partly.complete and repr(partly) == "DataSet(3 frames, 1 of 3 images, camera camera)"
    assert partly.frame(0).image.any()
    with pytest.raises(InvalidValueError, match="frame 1 of 'camera' is not there yet"):
        partly.frame(1)


def test_bands_have_the_bits_of_whole_frames(tmp_path, monkeypatch):
    """A frame of three bands, with truth, motions and errors of pixels at the rims."""
    tall = dataclasses.replace(CAMERA, sensor=pl.Sensor(shape=(1030, 4), pixel_pitch=0.01))
    frames = pl.Sequence(SCENE, tall, (0.0, 0.2), motions={"die": TURN})
    how = {**HOW, "samples": 2, "motion": True}
    one = pl.dataset.write(tmp_path / "one", frames, **how)
    monkeypatch.setattr(task, "_PART", 1)
    monkeypatch.setattr(writing, "_LONG", 1)  # with checkpoints
    other = pl.dataset.write(tmp_path / "other", frames, **how)
    assert [part["rows"] for part in other.manifest["images"][0]["parts"]][:3] == [[0, 512], [512, 1024], [1024, 1030]]
    for k in range(2):
        assert one.frame(k) == other.frame(k)
    np.testing.assert_array_equal(one.motion(0).shift, other.motion(0).shift)
    assert not list(other.path.glob("*.checkpoint"))


def test_frames_of_all_kinds_are_what_render_gives(tmp_path):
    frame = pl.sequences.Frame
    wide = dataclasses.replace(CAMERA, stop_to_microlenses=125.0, pose=pl.Pose.look_at((1, 2, 3), target=(0, 0, -404)))
    lit = pl.Scene(SCENE.meshes, [pl.QuadLight.facing((0, 60, -300), (0, 0, -404), (40, 40), radiance=10)])
    slow = dataclasses.replace(CAMERA, shutter=pl.sequences.Shutter(duration=0.02, row_time=1e-4))
    past = pl.Motion((0, 1), [pl.Pose.look_at((x, 0, 0), target=(0, 0, -404)) for x in (-5, 5)])
    found = {}
    for name, frames, changes in (
        ("scenes and cameras of their own", [frame(lit, CAMERA, 0.0), frame(SCENE, wide, 1.0)], {}),
        ("microlenses and none", [frame(SCENE, one, 0.0) for one in (FLAT, CAMERA, FLAT)], {"truth": pl.Truth.ALL}),
        ("no meshes", [frame(one, CAMERA, 0.0) for one in (pl.Scene(background=1.0), SCENE)], {}),
        ("a target error", sequence(2), {"target_error": 0.1, "samples": None}),
        ("a moving camera with a shutter", pl.Sequence(SCENE, slow, (0.2, 0.4), camera_motion=past), {}),
    ):
        how = {**HOW, **changes}
        found[name] = pl.dataset.write(tmp_path / name, frames, **how)
        for k, one in enumerate(frames):
            got = found[name].frame(k)
            shot = pl.render(one.scene, one.camera, seed=got.seed, **how)
            assert got == dataclasses.replace(shot, stats=None) and got.camera == one.camera, name
            assert "target_error" not in changes or got.relative_error < 0.13
    manifest = found["scenes and cameras of their own"].manifest
    assert len(manifest["cameras"]["camera"]) == 2 and len(manifest["object_names"]) == 2


def test_grey_frames_fit_among_coloured_ones_and_what_does_not_fit_is_refused(tmp_path):
    colour = pl.Scene(SCENE.meshes, background=(0.3, 0.2, 0.1))
    frames = [pl.sequences.Frame(scene, CAMERA, time) for time, scene in enumerate((colour, SCENE))]
    grey = pl.dataset.write(tmp_path / "set", frames, **HOW).frame(1).image
    assert grey.shape[2] == 3 and (grey == grey[:, :, :1]).all() and grey.any()
    with pytest.raises(InvalidValueError, match="frame 1 of 'camera' has colours, and the data set began with grey"):
        pl.dataset.write(tmp_path / "other", frames[::-1], **HOW)
    frames = [pl.sequences.Frame(SCENE, camera, 0.0) for camera in (FLAT, CAMERA)]
    with pytest.raises(InvalidValueError, match="frames 0 and 1 have no motion: the frames have different cameras"):
        pl.dataset.write(tmp_path / "moving", frames, motion=True, **HOW)


def test_tiles_of_frames_may_be_rendered_elsewhere(mended, tmp_path):
    client = fake_client.FakeClient(seed=2)
    mended(tmp_path / "set", client=client)
    client.close()
    assert client.calls.count("run_jobs") >= 2


def test_another_data_set_is_not_mixed_with_it(single):
    before = contents(single.path)[1]
    for changes, message in (
        ({"seed": 1}, "holds another data set, with seed 0, not 1; give another folder"),
        ({"samples": 16}, "with samples 8, not 16"),
        ({"settings": pl.rendering.RenderSettings(max_bounces=1)}, "max_bounces 8, not 1"),
        ({"truth": pl.Truth.DEPTH}, "truth DEPTH|OBJECT, not DEPTH"),
        ({"cameras": {"other": CAMERA}}, "cameras camera, not other"),
    ):
        with pytest.raises(FileError) as error:
            pl.dataset.write(single.path, sequence(2), **{**HOW, **changes})
        assert message in str(error.value)
        assert contents(single.path)[1] == before
    scene = pl.Scene(SCENE.meshes, background=0.4)
    other = pl.Sequence(scene, CAMERA, (0.0, 0.25), motions={"die": TURN})
    with pytest.raises(FileError, match="frame 0 in .* was rendered with another scene, camera or time than frame 0"):
        pl.dataset.write(single.path, other, **HOW)


def test_what_is_refused_changes_no_store(tmp_path):
    """Longer, and other from the last frame on, at whose end a motion was found."""
    how = {**HOW, "motion": True}
    made = pl.dataset.write(tmp_path / "set", sequence(2), **how)
    before = made.open().load()
    other = pl.Sequence(SCENE, CAMERA, (0, 0.3, 0.5), motions={"die": TURN})
    with pytest.raises(FileError, match="frame 0 in .* was followed with another .* or the one after it, has now"):
        pl.dataset.write(tmp_path / "set", other, **how)
    assert made.open().identical(before)


def test_folders_of_something_else_are_refused(tmp_path):
    (tmp_path / "letters.txt").write_text("mine")
    with pytest.raises(FileError, match="is there and holds no data set"):
        pl.dataset.write(tmp_path, sequence(), **HOW)
    with pytest.raises(FileError, match="does not exist; make it first"):
        pl.dataset.write(tmp_path / "no" / "such", sequence(), **HOW)
    with pytest.raises(FileError, match="is no data set"):
        pl.dataset.read(tmp_path)


@pytest.mark.skipif(os.name == "nt", reason="no locks")
def test_one_program_at_a_time_writes(single):
    with claim_folder(single.path), pytest.raises(FileError, match="another program is writing to"):
        pl.dataset.write(single.path, sequence(2), **HOW)


def test_impossible_calls_make_no_folder(tmp_path):
    for changes, message in (
        (dict(samples=None), "samples and target_error are both None"),
        (dict(sequence=SCENE), "sequence is a Scene"),
        (dict(sequence=[]), "sequence is empty"),
        (dict(sequence=list(sequence(2)), cameras={"a": CAMERA}), "the frames of a list have their own"),
        (dict(cameras={"../a": CAMERA}), "'../a' is no name of a camera"),
        (dict(cameras={"a": SCENE}), r"cameras\['a'\] is a Scene"),
        (dict(cameras={"a": CAMERA, "A": CAMERA}), "differ in capital letters only"),
        (dict(truth="DEPTH"), "truth is a str; give a Truth"),
        (dict(client=3, threads=1), "leave one of them out"),
    ):
        how = {"sequence": sequence(2), **HOW, **changes}
        with pytest.raises(InvalidValueError, match=message):
            pl.dataset.write(tmp_path / "set", **how)
        assert not (tmp_path / "set").exists(), message


def test_what_is_damaged_in_the_log_is_rendered_again(copied, mended):
    """Its end, or the camera, which is noted once for all frames."""
    for damage in (lambda log: log[:-20], lambda log: log.replace(b"PlenopticCamera", b"QlenopticCamera", 1)):
        folder = copied()
        (folder / "frames.log").write_bytes(damage((folder / "frames.log").read_bytes()))
        with pytest.warns(FileWarning, match="are damaged; what they noted is rendered again"):
            mended(folder)


def test_stores_that_claim_to_be_huge_are_refused_at_once(copied):
    folder = copied()
    file = folder / "camera.zarr/image/zarr.json"
    content = json.loads(file.read_text())
    content["shape"] = [2, 10**9, 10**9, 1]
    content["chunk_grid"]["configuration"]["chunk_shape"] = [1, 1, 1, 1]
    file.write_text(json.dumps(content))
    with pytest.raises(FileError, match="bytes of memory"):
        pl.dataset.read(folder).frame(0)


@pytest.mark.filterwarnings("ignore:Object at:UserWarning")
def test_a_store_without_an_array_is_refused(copied):
    for array in ("image", "depth"):
        folder = copied()
        (folder / "camera.zarr" / array / "zarr.json").unlink()
        for use in (lambda: pl.dataset.read(folder).frame(0), lambda: pl.dataset.write(folder, sequence(2), **HOW)):  # noqa: B023
            with pytest.raises((FileError, InvalidValueError), match=f"has no array {array}"):
                use()


def test_a_damaged_chunk_is_an_error_that_names_its_store(copied, mended):
    folder = copied()
    chunk = folder / "camera.zarr/image/c/1/0/0/0"
    chunk.write_bytes(chunk.read_bytes()[:-7])
    for use in (lambda: pl.dataset.read(folder).frame(1), lambda: mended(folder)):
        with pytest.raises(FileError, match="camera.zarr' cannot be read as a zarr store"):
            use()
    chunk.unlink()
    mended(folder)


def test_made_up_manifests_are_refused(single, tmp_path):
    for change in (
        lambda m: m.update(format="other-1"),
        lambda m: m.update(frames="3"),
        lambda m: m.update(frames=-1),
        lambda m: m.update(cameras="ab", images=[]),
        lambda m: m["images"][0]["parts"][0].update(arrays=["depth"]),
        lambda m: m.pop("made_with"),
        lambda m: m["cameras"].update({"../x": []}),
        lambda m: m["images"][0].pop("pose"),
        lambda m: m["images"][0].update(camera_value=7),
    ):
        manifest = json.loads((single.path / "manifest.json").read_text())
        change(manifest)
        (tmp_path / "manifest.json").write_text(json.dumps(manifest))
        with pytest.raises(FileError, match="is no manifest of a data set"):
            pl.dataset.read(tmp_path)
