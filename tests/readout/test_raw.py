"""Raw images: the way back to light, files, notebooks, refusals."""

import dataclasses
import re

import numpy as np
import pytest
from PIL import Image

import plenoptic as pl
from plenoptic.core.files import images
from plenoptic.errors import FileError, InvalidValueError
from plenoptic.optics.sensor.color_filter import BayerPattern
from plenoptic.optics.sensor.model import SensorModel, ShotNoise
from plenoptic.readout.develop import develop
from plenoptic.readout.raw import RawImage

NUMBERS = {"gain": 2.0, "black_level": 256.0, "bits": 16, "full_well": 30000.0, "colour_filters": BayerPattern.GBRG}
SENSOR = SensorModel((3e4, 5e4, 4e4), quantum_efficiency=0.5, read_noise=3.0, dead=[(1, 2)], **NUMBERS)


def raw(model=SENSOR, channels=3, region=(10, 16, 21, 30)):
    image = np.random.default_rng(2).uniform(0, 1.2, (6, 9, channels))
    return develop(pl.Exposure(image, region=region, samples=64), model, seed=7)


def test_the_way_back_is_the_inverse_of_the_way_there():
    quiet = {"read_noise": 0.0, "dead": 0.0, "shot_noise": ShotNoise.NONE}
    plain = dataclasses.replace(SENSOR, bits=None, full_well=None, dark_current=50.0, **quiet)
    image = np.random.default_rng(2).uniform(0, 1.2, (6, 9, 3)).astype(np.float32)
    for filters in (None, BayerPattern.RGGB, [[0, 1, 2]]):
        model = dataclasses.replace(plain, colour_filters=filters)
        made = develop(pl.Exposure(image, region=(11, 17, 22, 31)), model)
        seen = image
        if filters is not None:
            seen = np.take_along_axis(image, made.channels[:, :, np.newaxis], axis=2)[:, :, 0]
        # Adding and taking away a dark signal of 356 from at least 2e-3 costs 2e5 eps.
        np.testing.assert_allclose(made.linear(), seen, rtol=1e-10, atol=1e-14)
    # Quantisation bounds the error.
    model, image = dataclasses.replace(SENSOR, colour_filters=None, **quiet), np.minimum(image, 1.0)
    error = np.abs(develop(pl.Exposure(image), model).linear() - image)
    assert np.all(error <= 0.5 / (model.gain * model.electrons_per_unit) * (1 + 1e-9))


def test_it_knows_its_levels_and_filters():
    made = raw()
    assert (made.black_level, made.white_level) == (256.0, 60256.0)
    assert made.colour_filters == BayerPattern.GBRG
    # Row 10 is even and column 21 odd: the second filter of the first row.
    assert made.channels[:2, :2].tolist() == [[2, 1], [1, 0]]
    assert (made.samples, made.seed, made.region) == (64, 7, (10, 16, 21, 30))
    bright = develop(pl.Exposure(np.full((4, 4, 1), 100.0)), dataclasses.replace(SENSOR, read_noise=0.0, dead=0.0))
    assert bright.fraction_saturated == 1.0
    assert repr(bright) == "RawImage(4 x 4, GBRG, 16 bits, 100 % saturated)"
    # Notebooks see a picture and the facts.
    html = made._repr_html_()
    assert "6 x 9, GBRG, 16 bits" in html and "rows 10:16, columns 21:30" in html
    assert len(html) < 200_000 and "data:image/png" in html


def test_files_give_back_every_bit(tmp_path):
    whole = RawImage(np.arange(65536).reshape(256, 256), SensorModel(1.0, bits=16))
    filtered = [raw(dataclasses.replace(SENSOR, colour_filters=f)) for f in (None, BayerPattern.GBRG, [[0, 1, 2]])]
    for ending in (".tif", ".tiff", ".png"):
        for made in (*filtered, whole):
            made.save(tmp_path / f"raw{ending}")
            assert RawImage.load(tmp_path / f"raw{ending}") == made
    assert np.array_equal(np.asarray(Image.open(tmp_path / "raw.png")), whole.data)


def test_files_that_are_no_raw_images_are_refused(tmp_path):
    made = RawImage([[4095]], SensorModel(1.0))
    made.save(tmp_path / "raw.png")
    _, metadata = images.read_channels(tmp_path / "raw.png")
    spoilt = {"plenoptic:model": metadata["plenoptic:model"]}
    images.write_16bit(tmp_path / "other.png", np.zeros((2, 2, 1), np.uint16))
    images.write_16bit(tmp_path / "spoilt.png", np.full((1, 1, 1), 4096, np.uint16), spoilt)
    for name, said in (
        ("other", "names no sensor model"),
        ("spoilt", "image: data must be whole numbers from 0 to 4095"),
    ):
        with pytest.raises(FileError, match=said):
            RawImage.load(tmp_path / f"{name}.png")
    with pytest.raises(FileError, match="must end in"):
        made.save(tmp_path / "raw.exr")
    with pytest.raises(InvalidValueError, match="not quantised"):
        RawImage([[0.5]], SensorModel(1.0, bits=None)).save(tmp_path / "raw.png")


def test_impossible_data_are_refused():
    whole = "whole numbers from 0 to 65535"
    for data, sentence in (
        *(([[number]], whole) for number in (-1, 65536, 0.5, np.nan)),
        (np.zeros((2, 2, 2)), "data has shape (2, 2, 2)"),
        (np.zeros((0, 2)), "not empty"),
        (np.zeros((2, 2, 3)), "behind colour filters it must be (H, W)"),
    ):
        with pytest.raises(InvalidValueError, match=re.escape(sentence)):
            RawImage(data, SENSOR)
