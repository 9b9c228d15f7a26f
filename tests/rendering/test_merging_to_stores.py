"""`merge_to_store`: every byte of the store of `Exposure.merged`, with a band of it in memory."""

import dataclasses
import tracemalloc

import numpy as np
import pytest
import test_merging
from test_merging import cuts_of, part_of
from test_zarr_files import content

import plenoptic as pl
from plenoptic.rendering import RenderStats
from plenoptic.rendering.exposure_files import metadata_of_image, metadata_of_store
from plenoptic.rendering.exposure_metadata import metadata_of
from plenoptic.rendering.merging.merge import merge_parts, merge_to_store
from plenoptic.rendering.merging.merge_plan import FilePart, StorePart, memory_part

pytest.importorskip("zarr", reason="the extra `zarr` installs it")

CAMERA = pl.PlenopticCamera(pl.load_lens("double-gauss-100mm-f2"), pl.Sensor((1400, 40), 0.01), 123.3)
REGION = (200, 1300, 8, 32)
"""Three bands of rows."""


def made_up(rng, seed, *, region=REGION, **changes):
    """An exposure of random numbers with all that there may be."""
    stats = RenderStats(1.0 + seed, 2.0, 90, 80, (("clipped", 0, 10),), clamped=0.1 * seed)
    return test_merging.made_up(rng, region, **({"seed": seed, "camera": CAMERA, "stats": stats} | changes))


def saved(shot, folder, ending):
    """An exposure as a part: in memory, in a store, or in an EXR file."""
    path = folder / f"{len(list(folder.iterdir()))}{ending or ''}"
    if ending is None:
        return memory_part(path.name, shot)
    shot.save(path)
    if ending == ".zarr":
        return StorePart(path)
    return FilePart(path.name, metadata_of_image(path), lambda: pl.Exposure.load(path))


@pytest.mark.parametrize("seed", [0, 2])
def test_a_store_has_every_byte_of_what_is_merged_in_memory(seed, tmp_path):
    """Regions beside each other, with one to three replicates on each, in memory, in stores and in EXR files."""
    rng = np.random.default_rng(seed)
    shots = [made_up(rng, number) for number in range(3)]
    parts = [
        part_of(shot, region)
        for region in cuts_of(rng, REGION, 1 + 4 * seed)
        for shot in shots[: int(rng.integers(1, 4))]
    ]
    parts = [parts[k] for k in rng.permutation(len(parts))]
    (tmp_path / "parts").mkdir()
    together = pl.Exposure.merged(parts)
    files = [saved(part, tmp_path / "parts", (None, ".zarr", ".exr")[int(rng.integers(3))]) for part in parts]
    head = merge_to_store(files, tmp_path / "streamed.zarr")
    together.save(tmp_path / "held.zarr")
    assert content(tmp_path / "streamed.zarr") == content(tmp_path / "held.zarr")
    assert pl.Exposure.load(tmp_path / "streamed.zarr") == together and head == metadata_of(together)
    assert merge_parts(files) == together


def test_what_one_part_lacks_the_store_lacks(tmp_path):
    rng = np.random.default_rng(2)
    top, bottom = (200, 600, *REGION[2:]), (600, *REGION[1:])
    bare = {name: None for name in ("standard_error", "truth", "sample_counts", "stats")}
    parts = [part_of(made_up(rng, 0), top), dataclasses.replace(part_of(made_up(rng, 0), bottom), **bare)]
    merge_to_store([memory_part("a", parts[0]), memory_part("b", parts[1])], tmp_path / "a.zarr")
    assert pl.Exposure.load(tmp_path / "a.zarr") == pl.Exposure.merged(parts)
    # Counts that come to the same are not kept.
    one = made_up(rng, 0)
    two = dataclasses.replace(made_up(rng, 1), sample_counts=8 - one.sample_counts)
    head = merge_to_store([memory_part("a", one), memory_part("b", two)], tmp_path / "b.zarr")
    together = pl.Exposure.merged([one, two])
    assert (together.samples, together.sample_counts) == (8, None) and "sample_counts" not in head.arrays
    together.save(tmp_path / "c.zarr")
    assert content(tmp_path / "b.zarr") == content(tmp_path / "c.zarr")


def test_heads_are_those_of_what_is_loaded(tmp_path):
    rng = np.random.default_rng(3)
    full = made_up(rng, 4)
    for shot in (
        full,
        dataclasses.replace(full, seed=(3, 9), sample_counts=None, truth=None),
        pl.Exposure(rng.random((3, 4, 1)), samples=4),
    ):
        shot.save(tmp_path / "a.exr")
        shot.save(tmp_path / "a.zarr")
        assert metadata_of_image(tmp_path / "a.exr") == metadata_of(pl.Exposure.load(tmp_path / "a.exr"))
        assert (
            metadata_of_store(tmp_path / "a.zarr")
            == metadata_of(pl.Exposure.load(tmp_path / "a.zarr"))
            == metadata_of(shot)
        )


def peak_of(rows, folder):
    """Bytes that are taken at most while two seeds of so many rows are merged, in two stores each."""
    folder.mkdir()
    rng, parts = np.random.default_rng(4), []
    for seed, first in ((0, 0), (0, rows // 2), (1, 0), (1, rows // 2)):
        region = (first, first + rows // 2, 0, 128)
        shot = made_up(rng, seed, region=region, camera=None, truth=None, stats=None)
        parts.append(saved(shot, folder, ".zarr"))
    del shot
    tracemalloc.start()
    try:
        merge_to_store(parts, folder / "whole.zarr")
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_memory_does_not_grow_with_rows(tmp_path):
    """2048 more rows are 7.3 MB of image, error and counts; chunks in flight, of 0.8 MB at most, vary by a few."""
    peak_of(1024, tmp_path / "first")  # what is imported on the way
    low, high = peak_of(2048, tmp_path / "low"), peak_of(4096, tmp_path / "high")
    assert high < low + 2.5e6


def test_a_merge_that_fails_leaves_what_was_there(tmp_path):
    whole = made_up(np.random.default_rng(6), 0)
    before = pl.Exposure(np.ones((2, 3, 1)))
    before.save(tmp_path / "a.zarr")
    top, bottom = (part_of(whole, (*rows, *REGION[2:])) for rows in ((200, 900), (900, 1300)))

    def interrupted():
        raise KeyboardInterrupt

    for load, error in (
        (interrupted, KeyboardInterrupt),
        (lambda: dataclasses.replace(bottom, seed=1), pl.errors.FileError),
    ):
        with pytest.raises(error, match="b.exr has been changed while" if error is pl.errors.FileError else None):
            merge_to_store([memory_part("a", top), FilePart("b.exr", metadata_of(bottom), load)], tmp_path / "a.zarr")
        assert pl.Exposure.load(tmp_path / "a.zarr") == before
        assert [entry.name for entry in tmp_path.iterdir()] == ["a.zarr"]


def test_what_does_not_fit_is_refused_before_any_pixel_is_read(tmp_path):
    whole = made_up(np.random.default_rng(7), 0)

    def never():
        raise AssertionError("read")

    for rows, said in (
        (((200, 300), (250, 350)), r"a.exr \(rows 200:300, columns 8:32\) and b.exr \(rows 250:350, .* overlap"),
        (((200, 300), (310, 400)), "leave rows 300:310, columns 8:32 out"),
        (((200, 300), (300, 400), (200, 300)), "2 parts of rows 200:300, columns 8:32 have the seed 0"),
    ):
        heads = [metadata_of(part_of(whole, (*ends, 8, 32))) for ends in rows]
        parts = [FilePart(f"{name}.exr", head, never) for name, head in zip("abc", heads, strict=False)]
        with pytest.raises(pl.errors.InvalidValueError, match=said):
            merge_to_store(parts, tmp_path / "a.zarr")
        assert not (tmp_path / "a.zarr").exists()
