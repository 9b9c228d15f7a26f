import importlib.util
import pickle
import re
from dataclasses import replace
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import plenoptic as pl
from plenoptic.core.files import images
from plenoptic.errors import FileError, InvalidValueError
from plenoptic.rendering.crop import samples_text
from plenoptic.rendering.schedule import outcome
from plenoptic.truth.channels import GroundTruth
from plenoptic.truth.truth_arrays import empty_truth

BEFORE = Path(__file__).parents[1] / "data" / "before"

STATS = {"seconds": 1.5, "cpu_seconds": 2.75, "paths": 1000, "paths_through_lens": 640, "nonfinite": 1, "threads": 2}
STATS["lost"] = (("clipped", 3, 300), ("clipped", 7, 50), ("missed", None, 10))


def exposure(channels=1, **changes):
    random = np.random.default_rng(3)
    shape = (4, 6, channels)
    depth = random.uniform(100, 900, shape[:2])
    depth[0, 0] = np.inf
    fields = {"image": random.uniform(0, 2, shape), "standard_error": random.uniform(0, 0.1, shape)}
    fields |= {"truth": GroundTruth(depth=depth), "stats": pl.rendering.RenderStats(**STATS)}
    fields |= {"samples": 64, "replicates": 8, "seed": 5, "region": (10, 14, 20, 26)}
    return pl.Exposure(**(fields | changes))


def test_impossible_exposures():
    for change, sentence in (
        ({"seconds": -1}, "seconds is -1 s; it must be at least 0"),
        ({"paths": 10}, "paths_through_lens is 640; it must be at most paths, 10"),
        ({"threads": 0}, "threads is 0; it must be at least 1"),
        ({"lost": (("missed", None, -1),)}, "lost: count is -1"),
    ):
        with pytest.raises(InvalidValueError, match=sentence):
            pl.rendering.RenderStats(**{**STATS, **change})
    for change, sentence in (
        ({"image": np.ones((4, 6, 2))}, r"it must be \(H, W, 1\) or \(H, W, 3\)"),
        ({"image": np.ones((0, 6, 1))}, "not empty"),
        ({"standard_error": np.ones((4, 6, 3))}, r"standard_error has shape \(4, 6, 3\)"),
        ({"truth": np.ones((4, 6))}, "truth is an ndarray; give a GroundTruth"),
        ({"truth": GroundTruth(depth=np.ones((4, 5)))}, "truth has 4 x 5 pixels; it must have the image's 4 x 6"),
        ({"samples": 1.5}, "samples is 1.5; it must be a whole number"),
        ({"region": (0, 4, 0, 5)}, "has 4 x 5 pixels; it must have the image's 4 x 6"),
        ({"region": (0, 4)}, "it must be .first row, end row"),
        ({"stats": 3}, "stats is an int; give a RenderStats, such as the `stats` of another exposure"),
    ):
        with pytest.raises(InvalidValueError, match=sentence):
            exposure(**change)


def test_relative_error_is_that_of_lit_pixels():
    # The 99th percentile lies between 4 and 8: pixels above some 0.8 count.
    image, error = [[[8.0], [4.0]], [[0.1], [0.0]]], [[[2.0], [3.0]], [[5.0], [1.0]]]
    shot = pl.Exposure(image, standard_error=error)
    assert shot.relative_error == pytest.approx(np.sqrt((0.25**2 + 0.75**2) / 2))
    assert pl.lit_pixels(shot.image).tolist() == [[True, True], [False, False]]
    # Channels count together: root mean square error over mean.
    coloured = pl.Exposure([[[1.0, 2.0, 3.0]]], standard_error=[[[0.3, 0.4, 0.0]]])
    assert coloured.relative_error == pytest.approx(np.sqrt(0.25 / 3) / 2)
    assert pl.Exposure(np.ones((2, 2, 1))).relative_error is None
    black = np.zeros((2, 2, 1))
    assert np.isnan(pl.Exposure(black, standard_error=black).relative_error)
    assert pl.Exposure(black + 1, standard_error=black).relative_error == 0
    assert pl.Exposure(black, standard_error=black + 1).relative_error == np.inf
    for image in (np.ones((3, 4)), 1.0, None, "abc", np.full((2, 2, 1), np.inf)):
        with pytest.raises(InvalidValueError, match="image"):
            pl.lit_pixels(image)


def test_exr_keeps_everything(tmp_path):
    camera = pl.camera.example_camera().posed((1, 2, 900), (0, 0, 0))
    for channels, names in ((1, "Y"), (3, "RGB")):
        shot = exposure(channels, camera=camera)
        shot.save(tmp_path / "shot.exr")
        again = pl.Exposure.load(tmp_path / "shot.exr")
        # Depth is float32 in the file; everything else has every bit.
        rounded = shot.depth.astype(np.float32).astype(np.float64)
        assert again == exposure(channels, truth=GroundTruth(depth=rounded), camera=camera)
        planes, metadata = images.read_channels(tmp_path / "shot.exr")
        assert set(planes) == {*names, "depth.Z", *(f"error.{name}" for name in names)}
        assert metadata["Software"].startswith("plenoptic ")
        assert "float32" in metadata["plenoptic:note"]
        assert (shot.image.dtype, shot.standard_error.dtype, shot.depth.dtype) == (np.float32, np.float32, np.float64)
        again = pickle.loads(pickle.dumps(shot))
        assert again == shot and not again.image.flags.writeable
    image_only = pl.Exposure(np.ones((2, 3, 1)))
    image_only.save(tmp_path / "alone.exr")
    assert pl.Exposure.load(tmp_path / "alone.exr") == image_only
    # Numbers of samples beyond those of float32 stay within all samples.
    counts = [[16777219, 16777217]]
    shot = pl.Exposure(np.ones((1, 2, 1)), samples=16777219, sample_counts=counts, seed=0, replicates=1)
    shot.save(tmp_path / "a.exr")
    np.testing.assert_allclose(pl.Exposure.load(tmp_path / "a.exr").sample_counts, counts, rtol=2**-24)


def test_exr_keeps_all_ground_truth(tmp_path):
    # What float32 holds, and what stands for nothing.
    random, arrays = np.random.default_rng(8), empty_truth(pl.Truth.ALL & ~pl.Truth.DEPTH, (4, 6))
    for array in arrays.values():
        valid, whole = random.random(array.shape) < 0.7, array.dtype.kind == "i"
        drawn = random.integers(-(2**24), 2**24 + 1, valid.sum()) if whole else random.uniform(-1e3, 1e3, valid.sum())
        array[valid] = drawn.astype(np.float32)
    truth = GroundTruth(**arrays)
    shot = exposure(truth=truth)
    shot.save(tmp_path / "shot.exr")
    again = pl.Exposure.load(tmp_path / "shot.exr")
    assert again.truth == truth and again.depth is None
    names, metadata = images.read_channels(tmp_path / "shot.exr")
    assert {"truth.position.X", "truth.microlens.I", "truth.microlens.type"} < set(names)
    assert "depth.Z" not in names and "2^24" in metadata["plenoptic:note"]
    assert "with distance, position, normal, object, material, microlens, virtual depth, disparity" in repr(shot)


def test_exr_keeps_what_the_numbers_of_objects_mean(tmp_path, monkeypatch):
    wall, ball = pl.box((280, 280, 1)).translated(0, 0, -600), pl.sphere(40.0).translated(-60, 0, -500)
    lamp = pl.QuadLight.facing((60, 0, -500), (60, 0, 0), (80, 80), radiance=1.0)
    scene = pl.Scene([replace(wall, name="wall"), ball], [pl.lights.PointLight((0, 0, 0), intensity=1.0), lamp])
    assert scene.object_names == ("wall", "Mesh 1", "QuadLight 1", "")
    lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=1.0))
    camera = pl.PlenopticCamera(lens=lens, sensor=pl.Sensor(shape=(9, 33), pixel_pitch=2.0), stop_to_microlenses=123.3)
    settings = {"samples": 1, "replicates": 1, "truth": pl.Truth.OBJECT, "progress": False}
    pl.render(scene, camera, **settings).save(tmp_path / "shot.exr")
    shot = pl.Exposure.load(tmp_path / "shot.exr")
    names = np.array(shot.object_names)[shot.truth.object][4].tolist()
    assert [name for name, _ in groupby(names)] == ["", "wall", "Mesh 1", "wall", "QuadLight 1", "wall", ""]
    assert pl.render(scene, camera, **(settings | {"truth": pl.Truth.DEPTH})).object_names is None
    assert pl.Scene([replace(wall, name="w" * 5000)]).object_names == ("w" * 100, "")
    monkeypatch.setattr(outcome, "MOST_NAMES", 3)
    assert pl.render(scene, camera, **settings).object_names is None


def test_16_bits_keep_the_image_to_half_a_step(tmp_path):
    kinds = (".tif", 1, None), (".tif", 3, 5.0), (".tiff", 1, None), (".png", 1, 5.0), (".png", 3, None)
    for ending, channels, scale in kinds:
        shot, path = exposure(channels), tmp_path / f"shot{ending}"
        shot.save(path, scale=scale)
        again = pl.Exposure.load(path)
        # Half a step of 65535, times the steepest slope of the decoding curve (2.4 / 1.055 for sRGB), and float32.
        slope = 2.4 / 1.055 if ending == ".png" else 1.0
        largest = shot.image.max() if scale is None else scale
        np.testing.assert_allclose(again.image, shot.image, rtol=0, atol=largest * (slope * 0.5 / 65535 + 1e-6))
        assert (again.samples, again.seed, again.region) == (64, 5, (10, 14, 20, 26)), ending
        assert again.standard_error is None and again.depth is None


def test_16_bits_cut_what_does_not_fit(tmp_path):
    shot = pl.Exposure(np.array([-1.0, 0.5, 2.0, np.inf, np.nan]).reshape(1, 5, 1))
    shot.save(tmp_path / "shot.tif", scale=1.0)
    again = pl.Exposure.load(tmp_path / "shot.tif").image.ravel()
    np.testing.assert_allclose(again, [0, 0.5, 1, 1, 0], atol=1 / 65535)
    shot.save(tmp_path / "shot.tif")
    np.testing.assert_allclose(pl.Exposure.load(tmp_path / "shot.tif").image.max(), 2.0)
    pl.Exposure(np.zeros((2, 2, 3))).save(tmp_path / "black.png")
    assert pl.Exposure.load(tmp_path / "black.png").image.max() == 0
    # Other programs see an sRGB picture.
    pl.Exposure(np.full((2, 2, 3), 0.214)).save(tmp_path / "grey.png", scale=1.0)
    codes = np.asarray(Image.open(tmp_path / "grey.png").convert("RGB"))
    assert abs(int(codes[0, 0, 0]) - 128) <= 1


def test_foreign_files_load_with_what_they_have(tmp_path):
    for names in ("Y", "RGBA"):
        images.write_channels(tmp_path / "a.exr", {name: np.full((2, 3), 0.5) for name in names})
        expected = pl.Exposure(np.full((2, 3, 1 if names == "Y" else 3), 0.5))
        assert pl.Exposure.load(tmp_path / "a.exr") == expected, names
    Image.new("RGB", (3, 2), (255, 128, 0)).save(tmp_path / "a.jpg", quality=100, subsampling=0)
    shot = pl.Exposure.load(tmp_path / "a.jpg")
    assert shot.image.shape == (2, 3, 3)
    # JPEG may be off by a code or two of 255, sRGB's slope is below 2.4.
    np.testing.assert_allclose(shot.image[0, 0], [1, 0.2158, 0], atol=2.4 * 2 / 255)


def test_what_cannot_be_saved_or_loaded(tmp_path):
    shot = exposure()
    for call, error, said in (
        (lambda: shot.save(tmp_path / "a.png", scale=0.0), InvalidValueError, "scale is 0; it must be above 0"),
        (lambda: exposure(camera=object()).save(tmp_path / "a.exr"), InvalidValueError, "cannot be described in a"),
        (lambda: pl.Exposure.load(None), FileError, "is not a path; give the name of a file"),
        (lambda: shot.save(b"shot.exr"), FileError, "is not a path; give the name of a file"),
    ):
        with pytest.raises(error, match=said):
            call()
    for texts, said in (
        ({"plenoptic:samples": "-1"}, "holds no possible exposure: samples is -1"),
        ({"plenoptic:object_names": "7"}, "holds no possible exposure: object_names is 7; it must be texts"),
        ({"plenoptic:camera": "nonsense"}, "a description cannot be understood"),
        ({"plenoptic:scale": "0"}, "holds no possible exposure: scale is 0"),
    ):
        images.write_channels(tmp_path / "a.exr", {"Y": np.ones((2, 2))}, texts)
        with pytest.raises(FileError, match=said):
            pl.Exposure.load(tmp_path / "a.exr")


def test_repr_is_one_line_of_facts():
    said = r"64 samples per pixel, relative error \S+ %, with depth, rows 10:14, columns 20:26, 1.5 s"
    assert re.fullmatch(rf"Exposure\(4 x 6 x 1, {said}\)", repr(exposure()))
    # How much of the frame has what.
    assert samples_text(np.array([[64, 64], [8, 0]])) == "64 samples in 50 % of the pixels, 8 in 25 %, none in 25 %"
    assert samples_text(np.array([[8, 8, 4, 2]])) == "8 samples in 50 % of the pixels, 2 to 4 in 50 %"
    assert samples_text(np.zeros(4, int)) == "no samples in 100 % of the pixels"
    # Statistics add up.
    stats = pl.rendering.RenderStats(**STATS)
    assert stats.fraction_through_lens == 0.64
    assert stats.lost_by_cause == {"clipped": 350, "missed": 10}
    assert np.isnan(pl.rendering.RenderStats().fraction_through_lens)
    assert repr(stats) == (
        "RenderStats(1.5 s, 2 threads, 1000 paths, 64 % through the lens, lost: 350 clipped, 10 missed, 1 not finite)"
    )


@pytest.fixture
def written():
    """The module that wrote files before names, records and modules moved."""
    spec = importlib.util.spec_from_file_location("before", BEFORE / "write.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_an_exposure_opens_with_camera_settings_and_all_truth_of_its_time(written):
    shot = pl.Exposure.load(BEFORE / "shot.exr")
    assert shot.camera == written.camera() and shot.settings.clamp == 9.0 and shot.samples == 16
    assert shot.truth.kinds == pl.Truth.ALL & ~(pl.Truth.INCIDENCE_ANGLE | pl.Truth.STATE)
    assert shot.stats.paths_through_lens > 0 and shot.stats.lost_by_cause
    assert np.isfinite(pl.replay(shot, written.scene(), pixel=(6, 8), sample=3).contribution).all()
    raw = pl.sensor.RawImage.load(BEFORE / "raw.tif")
    assert raw.model.photon_rate == 1e6 and raw.seed == 1 and raw.data.shape == (12, 16)


def test_a_checkpoint_of_another_version_is_refused_by_name(written, tmp_path):
    state = tmp_path / "state"
    state.write_bytes((BEFORE / "white.checkpoint").read_bytes())
    said = "has version 1 of the format, not 2, of another plenoptic; give checkpoint= another path, or remove the file"
    with pytest.raises(pl.errors.FileError, match=said):
        pl.render_white(written.camera(), checkpoint=state, samples=16, progress=False)
    assert state.read_bytes() == (BEFORE / "white.checkpoint").read_bytes()
