"""Zarr stores: filled region by region by several workers, whole or refused, opened a part at a time."""

import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.core.files.atomic_file import _prefix
from plenoptic.core.files.zarr_files import Store, Variable, array_shapes, attributes_of, read_arrays

xarray = pytest.importorskip("xarray", reason="the extra `zarr` installs it")
pytest.importorskip("zarr", reason="the extra `zarr` installs it")

SHAPE = (600, 1100)
"""Two by three chunks, of which four are cut by the edge."""
PARTS = [(row, min(row + 512, 600), column, min(column + 512, 1100)) for row in (0, 512) for column in (0, 512, 1024)]
VARIABLES = {
    "image": Variable(("row", "column", "channel"), (*SHAPE, 3), np.float32, np.nan, "light", "sr"),
    "object": Variable(("row", "column"), SHAPE, np.int32, -1, "number"),
    "x": Variable(("column",), (1100,), np.float64, 0, "place", "mm", {}, np.linspace(-1, 1, 1100)),
}


def pixels(region, frame=0):
    """Values of a region, which depend on the position of each pixel only."""
    rows, columns = np.arange(*region[:2])[:, None], np.arange(*region[2:])
    numbers = rows * 2000 + columns + 7 * frame
    return {"image": np.sqrt(numbers)[:, :, None] * [1.0, 0.5, 0.25], "object": numbers}


WHOLE = (0, *SHAPE[:1], 0, *SHAPE[1:])


def fill(path, parts):
    store = Store(path)
    for region in parts:
        store.put(region, pixels(region))


def content(path):
    """Every byte of a store; metadata without their order."""
    files = {file.relative_to(path).as_posix(): file.read_bytes() for file in path.rglob("*") if file.is_file()}
    return {name: json.loads(held) if name.endswith(".json") else held for name, held in files.items()}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A store that was written by one call."""
    path = tmp_path_factory.mktemp("zarr") / "whole.zarr"
    Store.create(path, VARIABLES, {"a": "b"}).put(WHOLE, pixels(WHOLE))
    return path


def test_two_processes_write_the_store_that_one_writes(whole, tmp_path):
    path = tmp_path / "parts.zarr"
    Store.create(path, VARIABLES, {"a": "b"})
    spawn = multiprocessing.get_context("spawn")
    # The second one imports this file by its path, since it is no module of a package.
    code = f"import runpy; runpy.run_path({__file__!r})['fill']({str(path)!r}, {PARTS[1::2]})"
    other = spawn.Process(target=exec, args=(code,))
    other.start()
    fill(path, PARTS[::2])
    other.join()
    assert other.exitcode == 0 and content(path) == content(whole)


def test_what_is_not_named_at_the_end_is_gone_and_texts_are_there(whole, tmp_path):
    path = tmp_path / "a.zarr"
    more = {"counts": VARIABLES["object"], **VARIABLES}
    store = Store.create(path, more, {})
    store.put(WHOLE, {**pixels(WHOLE), "counts": pixels(WHOLE)["object"]})
    store.finish(("image", "object"), {"a": "b"})
    assert content(path) == content(whole)


def test_chunks_of_a_colour_image_have_three_mebibytes_and_checksums(whole):
    described = json.loads((whole / "image" / "zarr.json").read_text())
    assert described["chunk_grid"]["configuration"]["chunk_shape"] == [512, 512, 3]
    names = [codec["name"] for codec in described["codecs"]]
    assert names == ["bytes", "blosc", "crc32c"] and described["codecs"][1]["configuration"]["cname"] == "zstd"
    assert described["dimension_names"] == ["row", "column", "channel"]


@pytest.mark.filterwarnings("error")
def test_xarray_opens_it_a_part_at_a_time_and_unseen_pixels_are_none(tmp_path):
    path = tmp_path / "a.zarr"
    Store.create(path, VARIABLES, {"a": "b"}).put(PARTS[1], pixels(PARTS[1]))
    data = xarray.open_zarr(path)
    assert dict(data.sizes) == {"row": 600, "column": 1100, "channel": 3} and data.attrs == {"a": "b"}
    assert set(data.coords) == {"x"} and data.image.attrs == {"long_name": "light", "units": "sr"}
    part = data.isel(row=slice(100, 103), column=slice(600, 604))
    expected = pixels((100, 103, 600, 604))
    np.testing.assert_array_equal(part.image, expected["image"].astype(np.float32))
    np.testing.assert_array_equal(part.object, expected["object"])
    assert np.isnan(data.image[0, :512]).all() and (data.object[512:] == -1).all() and data.object.dtype == np.int32
    # What has been written is what there is a file of.
    chunks = [file for file in (path / "object" / "c").rglob("*") if file.is_file()]
    assert [file.relative_to(path).as_posix() for file in chunks] == ["object/c/0/1"]


def test_what_does_not_fit_is_refused(whole):
    before, first = content(whole), (0, 512, 0, 512)
    for name, array, error, sentence in (
        ("image", np.ones((512, 512, 1)), pl.errors.InvalidValueError, r"it must have \(512, 512, 3\)"),
        ("image", np.ones((512, 500, 3)), pl.errors.InvalidValueError, r"it must have \(512, 512, 3\)"),
        ("depth", np.ones((512, 512)), pl.errors.FileError, "has no array depth; restore it"),
        ("object", np.full((512, 512), 0.5), pl.errors.InvalidValueError, "object must hold whole numbers"),
        ("object", np.full((512, 512), 1 << 40), pl.errors.InvalidValueError, "object must hold whole numbers"),
    ):
        with pytest.raises(error, match=sentence):
            Store(whole).put(first, {name: array})
    assert content(whole) == before


def test_a_sequence_is_written_frame_by_frame_and_grows(tmp_path):
    path = tmp_path / "many.zarr"
    store = Store.create(path, VARIABLES, {}, frames=2)
    store.put(WHOLE, pixels(WHOLE, 1), frame=1)
    store.extend(3)
    for region in PARTS:
        Store(path).put(region, pixels(region, 2), frame=2)
    with pytest.raises(pl.errors.InvalidValueError, match="has 3 frames already; it cannot be given 2"):
        store.extend(2)
    data = xarray.open_zarr(path)
    assert data.image.dims == ("frame", "row", "column", "channel") and data.sizes["frame"] == 3
    assert np.isnan(data.image[0]).all()
    for frame in (1, 2):
        np.testing.assert_array_equal(data.object[frame], pixels(WHOLE, frame)["object"])


def copied(whole, tmp_path):
    return Path(shutil.copytree(whole, tmp_path / "copy.zarr"))


def test_a_damaged_chunk_is_found(whole, tmp_path):
    path = copied(whole, tmp_path)
    chunk = path / "image" / "c" / "0" / "1" / "0"
    damaged = bytearray(chunk.read_bytes())
    damaged[len(damaged) // 2] ^= 1
    chunk.write_bytes(damaged)
    with pytest.raises(pl.errors.FileError, match="cannot be read as a zarr store: .*checksum"):
        read_arrays(path, ("image",))
    assert read_arrays(path, ("object",))["object"].shape == SHAPE


def test_only_chunks_of_the_rows_that_are_read_are_checked(whole, tmp_path):
    path = copied(whole, tmp_path)
    (path / "image" / "c" / "1" / "1" / "0").write_bytes(b"\x28\xb5\x2f\xfd\xe0" + bytes([255] * 16))
    for rows in (slice(0, 512), slice(500, 512)):
        expected = pixels(WHOLE)["image"][rows].astype(np.float32)
        np.testing.assert_array_equal(read_arrays(path, ("image",), rows=rows)["image"], expected)
    for rows in (slice(None), slice(511, 513), slice(599, 600)):
        with pytest.raises(pl.errors.FileError, match=r"image/c/1/1/0' holds \d+ bytes where 3145728 belong"):
            read_arrays(path, ("image",), rows=rows)


def test_a_store_whose_writer_was_killed_is_found_by_each_reader(whole, tmp_path):
    for read in (array_shapes, read_arrays):
        path = copied(whole, tmp_path)
        shutil.move(path, path.with_name(f"{_prefix(path)}0.old"))
        assert "image" in read(path, ("image",)) and path.is_dir()
        shutil.rmtree(path)


def test_what_a_store_claims_is_checked(whole, tmp_path):
    path, lz4 = copied(whole, tmp_path), {"name": "numcodecs.lz4", "configuration": {}}
    described, unread = (path / "object" / "zarr.json").read_text(), "cannot be read as a zarr store"
    for change, sentence in (
        (lambda array: array.update(shape=[1 << 20, 1 << 20]), "would take .* bytes of memory"),
        (lambda array: array["chunk_grid"]["configuration"].update(chunk_shape=[1 << 20, 1 << 20]), "would take"),
        (lambda array: array["codecs"].append(lz4), "is not read here|numcodecs.lz4"),
        (lambda array: array["codecs"].append({"name": "mine", "configuration": {}}), unread),
        (lambda array: array.update(data_type="string"), f"{unread}|is not read here"),
        (lambda array: array.update(shape=[-1]), unread),
        (lambda array: array.pop("codecs"), unread),
    ):
        array = json.loads(described)
        change(array)
        (path / "object" / "zarr.json").write_text(json.dumps(array))
        whole_store = json.loads((whole / "zarr.json").read_text())
        whole_store.pop("consolidated_metadata")
        (path / "zarr.json").write_text(json.dumps(whole_store))
        with pytest.raises(pl.errors.FileError, match=sentence):
            read_arrays(path, ("object",))


def test_links_and_large_stores_are_refused(whole, tmp_path):
    with pytest.raises(pl.errors.FileError, match=r"bytes; the limit is 1000: .*xarray.open_zarr"):
        read_arrays(whole, ("object",), pl.images.FileLimits(file_size=1000))
    path = copied(whole, tmp_path)
    (path / "object" / "c" / "0" / "0").unlink()
    (path / "object" / "c" / "0" / "0").symlink_to("/dev/zero")
    with pytest.raises(pl.errors.FileError, match="is no ordinary file"):
        read_arrays(path, ("object",))


def test_what_is_no_store_has_no_attributes(tmp_path):
    for text in ["", "[]", "{}", '{"node_type": "array", "attributes": {}}', "[" * 10_000]:
        (tmp_path / "zarr.json").write_text(text)
        assert attributes_of(tmp_path) is None and attributes_of(tmp_path / "nothing") is None, text


SAVING = """
    import sys, numpy as np, plenoptic as pl
    noise = np.random.default_rng(1).random((2, 1200, 1200, 3), dtype=np.float32)
    shots = [pl.Exposure(image) for image in noise]
    shots[0].save(sys.argv[1])
    print("begin", flush=True)
    while True:
        for shot in shots:
            shot.save(sys.argv[1])
"""


@pytest.mark.skipif(os.name == "nt", reason="needs signals")
@pytest.mark.slow
def test_a_signal_while_it_is_saved_leaves_one_of_the_two(tmp_path):
    path = tmp_path / "shot.zarr"
    noise = np.random.default_rng(1).random((2, 1200, 1200, 3), dtype=np.float32)
    command = [sys.executable, "-c", textwrap.dedent(SAVING), str(path)]
    for number, wait in ((signal.SIGKILL, 0.1), (signal.SIGINT, 0.1), (signal.SIGINT, 0.23), (signal.SIGKILL, 0.23)):
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as child:
            assert child.stdout.readline() == b"begin\n"
            with pytest.raises(subprocess.TimeoutExpired):
                child.wait(wait)
            child.send_signal(number)
        loaded = pl.Exposure.load(path).image
        assert any(np.array_equal(loaded, image) for image in noise), (number, wait)
        assert len(os.listdir(tmp_path)) <= 2
    pl.Exposure(noise[0]).save(path)
    assert os.listdir(tmp_path) == ["shot.zarr"]
