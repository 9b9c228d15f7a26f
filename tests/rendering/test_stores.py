"""Exposures as xarray datasets and zarr stores: every bit, with names, units and coordinates."""

import os
import sys

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.rendering.exposure_files import Layout, create_store
from plenoptic.truth.channels import CHANNELS, GroundTruth, Truth
from plenoptic.truth.truth_arrays import empty_truth

xarray = pytest.importorskip("xarray", reason="the extra `zarr` installs it")
pytest.importorskip("zarr", reason="the extra `zarr` installs it")

SHAPE = (5, 7)
CAMERA = pl.PlenopticCamera(pl.load_lens("double-gauss-100mm-f2"), pl.Sensor((40, 60), 0.01), 123.3)


def truth():
    """All channels, with numbers beyond the precision of float32, nan and void values."""
    random = np.random.default_rng(5)
    by_name = Truth.OBJECT_SHARE | Truth.CHORD_DISPARITY | Truth.OPTICAL_DISTANCE | Truth.TRANSMITTANCE
    arrays = empty_truth(Truth.ALL | by_name, SHAPE)
    for array in arrays.values():
        seen, whole = random.random(array.shape) < 0.7, array.dtype.kind == "i"
        array[seen] = random.integers(-(2**31), 2**31 - 1, seen.sum()) if whole else random.random(seen.sum())
    return GroundTruth(**arrays)


@pytest.fixture(scope="module")
def shot():
    random = np.random.default_rng(3)
    fields = {"standard_error": random.uniform(0, 0.1, (*SHAPE, 3)), "sample_counts": random.integers(0, 2**30, SHAPE)}
    fields |= {"samples": 2**30, "replicates": 8, "seed": 5, "white": False, "object_names": ("wall", "")}
    fields |= {"truth": truth(), "camera": CAMERA, "region": (10, 15, 20, 27)}
    fields |= {"stats": pl.rendering.RenderStats(seconds=1.5, lost=(("clipped", 3, 300),))}
    return pl.Exposure(random.uniform(-1, 2, (*SHAPE, 3)), **fields)


def test_a_store_gives_back_every_bit(shot, tmp_path):
    path = tmp_path / "shot.zarr"
    shot.save(path)
    again = pl.Exposure.load(path)
    assert again == shot and hash(again) == hash(shot)
    shot.to_xarray().to_zarr(tmp_path / "other.zarr")  # what xarray writes of a dataset is an exposure
    assert pl.Exposure.load(tmp_path / "other.zarr") == shot
    pl.Exposure(np.full((2, 2, 1), np.nan)).save(path)  # takes the place of the one before, with all its files
    assert pl.Exposure.load(path) == pl.Exposure(np.full((2, 2, 1), np.nan))
    assert {entry for entry in os.listdir(path) if not entry.endswith(".json")} == {"image", "row", "column", "channel"}


@pytest.mark.filterwarnings("error")
def test_xarray_opens_a_store_as_what_to_xarray_gives(shot, tmp_path):
    grey = pl.Exposure(np.ones((2, 3, 1)))
    for each, channels in ((shot, ["R", "G", "B"]), (grey, ["Y"])):
        path = tmp_path / f"{len(channels)}.zarr"
        each.save(path)
        for data in (xarray.open_zarr(path), xarray.open_dataset(path, engine="zarr")):
            xarray.testing.assert_identical(data.load(), each.to_xarray())
            assert data.channel.values.tolist() == channels
    # Without a camera there are no places in mm.
    data = grey.to_xarray()
    assert set(data.variables) == {"image", "row", "column", "channel"} and data.row.values.tolist() == [0, 1]


def test_dimensions_coordinates_units_and_types(shot):
    data = shot.to_xarray()
    assert data.image.dims == ("row", "column", "channel") and data.sample_counts.dims == ("row", "column")
    assert np.shares_memory(data.image.values, shot.image)
    # Row and column count from the sensor's corner, and x and y are those of the conventions: rotated by 180 degrees.
    assert data.row.values.tolist() == [10, 11, 12, 13, 14] and data.column.values[[0, -1]].tolist() == [20, 26]
    for row, column in ((0, 0), (4, 2)):
        x, y = CAMERA.sensor.centre_of(10 + row, 20 + column)
        assert (data.x.values[column], data.y.values[row]) == (x, y)
    assert data.x.units == data.y.units == "mm" and data.x.values[0] > data.x.values[-1]
    for name, channel in CHANNELS.items():
        array = data[name]
        assert array.dtype == channel.dtype and array.long_name == channel.meaning
        assert array.units == (channel.unit or "1")
        assert float(array.nothing_there) == channel.void or np.isnan(channel.void)
        assert array.dims[2:] == tuple([channel.numbers.lower()] if channel.numbers else [])
    assert data.position.sel(xyz="Z").shape == SHAPE and data.microlens.sel(ij="I").shape == SHAPE
    assert float(data.depth.sel(row=12, column=22)) == shot.depth[2, 2]


def test_what_is_something_else_is_not_replaced(shot, tmp_path):
    sequence = create_store(tmp_path / "many.zarr", Layout(SHAPE, 1, ("image", "depth")), {}, times=np.zeros(1))
    folder = tmp_path / "mine.zarr"
    folder.mkdir()
    (folder / "notes.txt").write_text("mine")
    (tmp_path / "file.zarr").write_text("mine")
    for path in (sequence.path, folder, tmp_path / "file.zarr"):
        with pytest.raises(pl.errors.FileError, match="is there and holds no exposure; choose a new name"):
            shot.save(path)
        with pytest.raises(pl.errors.FileError, match="xarray.open_zarr"):
            pl.Exposure.load(path)
    assert (folder / "notes.txt").read_text() == (tmp_path / "file.zarr").read_text() == "mine"
    for path, said in ((sequence.path, "holds a sequence; open it with"), (tmp_path / "none.zarr", "does not exist")):
        with pytest.raises(pl.errors.FileError, match=said):
            pl.Exposure.load(path)
    with pytest.raises(pl.errors.InvalidValueError, match="zarr files keep the values as they are"):
        shot.save(tmp_path / "a.zarr", scale=2.0)
    (tmp_path / "empty.zarr").mkdir()
    shot.save(tmp_path / "empty.zarr")
    assert pl.Exposure.load(tmp_path / "empty.zarr") == shot
    (tmp_path / "far").mkdir()
    (tmp_path / "link.zarr").symlink_to(tmp_path / "far" / "real.zarr")
    for _ in range(2):  # a link stays one
        shot.save(tmp_path / "link.zarr")
        assert (tmp_path / "link.zarr").is_symlink() and pl.Exposure.load(tmp_path / "link.zarr") == shot


def test_a_store_that_holds_no_possible_exposure_is_refused(tmp_path):
    data = pl.Exposure(np.ones((2, 3, 1)), samples=4, sample_counts=np.full((2, 3), 4)).to_xarray()
    for changed, sentence in (
        (data.drop_vars("image"), "has no array image; restore it"),
        (data.transpose("channel", "row", "column"), "holds no possible exposure: "),
        (data.assign(sample_counts=data.sample_counts + 1), "no possible exposure: sample_counts go from 5 to 5"),
        (data.assign_attrs({"plenoptic:samples": "{"}), "a description cannot be understood"),
        (data.assign_attrs({"plenoptic:kind": "other"}), "holds no exposure; open it with xarray.open_zarr"),
    ):
        changed.to_zarr(tmp_path / "a.zarr", mode="w")
        with pytest.raises(pl.errors.FileError, match=sentence):
            pl.Exposure.load(tmp_path / "a.zarr")


def test_without_the_packages_it_says_how_to_get_them(shot, tmp_path, monkeypatch):
    shot.save(tmp_path / "there.zarr")
    for name in ("zarr", "xarray"):
        monkeypatch.setitem(sys.modules, name, None)  # as if it were not installed
    for call, package in (
        (lambda: shot.save(tmp_path / "a.zarr"), "zarr"),
        (lambda: pl.Exposure.load(tmp_path / "there.zarr"), "zarr"),
        (shot.to_xarray, "xarray"),
    ):
        with pytest.raises(ImportError, match=f"needs the package {package}: pip install zarr xarray") as caught:
            call()
        assert isinstance(caught.value, pl.PlenopticError)
    assert os.listdir(tmp_path) == ["there.zarr"]
