"""Files that were written before names, records and modules moved: they open, or are refused with a sentence."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.truth.channels import Truth

FOLDER = Path(__file__).parents[1] / "data" / "before"
SETTINGS = {"samples": 16, "progress": False, "threads": 1}


@pytest.fixture
def written():
    """The module that wrote the files."""
    spec = importlib.util.spec_from_file_location("before", FOLDER / "write.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_an_exposure_opens_with_camera_settings_and_all_truth_of_its_time(written):
    shot = pl.Exposure.load(FOLDER / "shot.exr")
    assert shot.camera == written.camera() and shot.settings.clamp == 9.0 and shot.samples == 16
    assert shot.truth.kinds == Truth.ALL & ~(Truth.INCIDENCE_ANGLE | Truth.STATE)
    assert shot.stats.paths_through_lens > 0 and shot.stats.lost_by_cause
    again = pl.replay(shot, written.scene(), pixel=(6, 8), sample=3)
    assert np.isfinite(again.contribution).all()


def test_a_raw_image_opens_with_its_sensor():
    raw = pl.sensor.RawImage.load(FOLDER / "raw.tif")
    assert raw.model.photon_rate == 1e6 and raw.seed == 1 and raw.data.shape == (12, 16)


def test_a_checkpoint_goes_on_or_is_refused(written, tmp_path):
    state = tmp_path / "state"
    state.write_bytes((FOLDER / "white.checkpoint").read_bytes())
    try:
        white = pl.render_white(written.camera(), checkpoint=state, **SETTINGS)
    except pl.errors.FileError as error:
        assert "belongs to another render, with" in str(error) and "checkpoint= another path" in str(error)
    else:
        np.testing.assert_array_equal(white.image, np.load(FOLDER / "white.npy"))


def test_a_checkpoint_of_a_scene_is_refused_where_scenes_are_compiled_otherwise(written, tmp_path):
    state = tmp_path / "state"
    state.write_bytes((FOLDER / "scene.checkpoint").read_bytes())
    with pytest.raises(pl.errors.FileError, match="belongs to another render, with .*another scene"):
        pl.render(written.scene(), written.camera(), region=np.s_[0:4, 0:4], checkpoint=state, **SETTINGS)
