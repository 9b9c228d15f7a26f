"""Files that were written before names, records and modules moved: they open, or are refused with a sentence."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.truth.channels import Truth

FOLDER = Path(__file__).parents[1] / "data" / "before"


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
    raw = pl.sensor.RawImage.load(FOLDER / "raw.tif")
    assert raw.model.photon_rate == 1e6 and raw.seed == 1 and raw.data.shape == (12, 16)


def test_a_checkpoint_of_another_version_is_refused_by_name(written, tmp_path):
    state = tmp_path / "state"
    state.write_bytes((FOLDER / "white.checkpoint").read_bytes())
    said = "has version 1 of the format, not 2, of another plenoptic; give checkpoint= another path, or remove the file"
    with pytest.raises(pl.errors.FileError, match=said):
        pl.render_white(written.camera(), checkpoint=state, samples=16, progress=False)
    assert state.read_bytes() == (FOLDER / "white.checkpoint").read_bytes()
