"""`Exposure.merged` and `camera.tiles`: parts have the bits of the whole, seeds the errors of their mean."""

import dataclasses
import re

import numpy as np
import pytest
from honesty import counts_of
from hypothesis import given, settings
from hypothesis import strategies as st

import plenoptic as pl
from plenoptic.rendering import RenderStats, StopReason
from plenoptic.rendering.exposure_metadata import metadata_of
from plenoptic.rendering.merging.merge_plan import missing_regions

CAMERA = pl.camera.example_camera(shape=(29, 43))
SCENE = pl.check_scene()
merged = pl.Exposure.merged


def cuts_of(rng, region, n, *, block=1):
    """A region, cut n times along a row or a column between blocks, wherever that can be."""
    regions = [region]
    for _ in range(n):
        row, end_row, column, end_column = whole = regions.pop(int(rng.integers(len(regions))))
        rows = np.arange(-(-(row + 1) // block) * block, end_row, block)
        columns = np.arange(-(-(column + 1) // block) * block, end_column, block)
        if rows.size and (rng.random() < 0.5 or not columns.size):
            at = int(rng.choice(rows))
            regions += [(row, at, column, end_column), (at, end_row, column, end_column)]
        elif columns.size:
            at = int(rng.choice(columns))
            regions += [(row, end_row, column, at), (row, end_row, at, end_column)]
        else:
            regions.append(whole)
    return regions


def made_up(rng, region, **changes):
    """An exposure of random numbers that EXR files hold too, with all that there may be."""
    shape = region[1] - region[0], region[3] - region[2]
    depth, normal = (rng.random(part, dtype=np.float32) for part in (shape, (*shape, 3)))
    truth = pl.GroundTruth(depth=depth, normal=normal, object=rng.integers(-1, 9, shape))
    fields = {"standard_error": rng.random((*shape, 3)), "truth": truth, "sample_counts": rng.integers(0, 9, shape)}
    fields |= {"samples": 8, "replicates": 2, "seed": 5, "region": region, "white": False, "object_names": ("a", "")}
    fields |= {"settings": pl.rendering.RenderSettings()}
    return pl.Exposure(rng.random((*shape, 3)), **(fields | changes))


def part_of(whole, region):
    """Crop of an exposure to a region."""
    first_row, _, first_column, _ = metadata_of(whole).sensor_region
    rows = slice(region[0] - first_row, region[1] - first_row)
    columns = slice(region[2] - first_column, region[3] - first_column)
    changes = {name: getattr(whole, name)[rows, columns] for name in ("image", "standard_error", "sample_counts")}
    truth = {name: array[rows, columns] for name, array in whole.truth.arrays().items()}
    return dataclasses.replace(whole, region=region, truth=pl.GroundTruth(**truth), **changes)


@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 12))
@settings(max_examples=60)
def test_any_cuts_come_together_and_what_is_left_out_is_named(seed, n):
    rng = np.random.default_rng(seed)
    row, column, rows, columns = (int(k) for k in rng.integers((0, 0, 1, 2), (20, 20, 20, 20)))
    region = (row, row + rows, column, column + columns)
    whole = made_up(rng, region)
    regions = cuts_of(rng, region, n)
    parts = [part_of(whole, regions[i]) for i in rng.permutation(len(regions))]
    together = merged(parts)
    assert np.array_equal(together.image, whole.image) and together.truth == whole.truth
    assert np.array_equal(together.standard_error, whole.standard_error)
    assert np.array_equal(counts_of(together), whole.sample_counts)
    assert (together.region, together.seed, together.replicates) == (region, 5, 2)
    assert together.object_names == ("a", "")
    missing = int(rng.integers(len(regions)))
    remaining = regions[:missing] + regions[missing + 1 :]
    assert missing_regions(region, regions) == [] and missing_regions(region, remaining) == [regions[missing]]


def test_tiles_have_the_bits_of_the_whole():
    for replicates in (1, 2):
        options = {"samples": 16, "replicates": replicates, "seed": 7, "progress": False}
        options["truth"] = pl.Truth.DEPTH | pl.Truth.OBJECT
        whole, rng = pl.render(SCENE, CAMERA, **options), np.random.default_rng(replicates)
        random = [np.s_[r[0] : r[1], r[2] : r[3]] for r in cuts_of(rng, (0, 29, 0, 43), 5, block=8)]
        for regions in (CAMERA.tiles(2, 3), random):
            parts = [pl.render(SCENE, CAMERA, region=region, **options) for region in regions]
            together = merged(parts)
            assert np.array_equal(together.image, whole.image) and together.truth == whole.truth
            assert (together.standard_error is None) == (replicates == 1)
            assert replicates == 1 or np.array_equal(together.standard_error, whole.standard_error)
            for name in ("samples", "replicates", "seed", "region", "camera", "settings", "white", "object_names"):
                assert getattr(together, name) == getattr(whole, name), name
            assert together.sample_counts is None
            for name in ("paths", "paths_through_lens", "nonfinite", "zero_variance", "stopped_by", "processors"):
                assert getattr(together.stats, name) == getattr(whole.stats, name), name
            assert sorted(together.stats.lost) == sorted(whole.stats.lost)
            assert together.stats.seconds == pytest.approx(sum(part.stats.seconds for part in parts))
    white = pl.render_white(CAMERA, samples=4, progress=False)
    together = merged(pl.render_white(CAMERA, samples=4, region=r, progress=False) for r in CAMERA.tiles(2, 2))
    assert np.array_equal(together.image, white.image) and together.white
    assert np.array_equal(together.standard_error, white.standard_error)


def seeds(*numbers, **given):
    given = {"region": np.s_[0:24, 8:40], "truth": pl.Truth.NONE, "progress": False, **given}
    return [pl.render(SCENE, CAMERA, seed=k, **given) for k in numbers]


def test_single_replicates_get_their_errors_from_each_other():
    """Right on average: squares of true errors and of those told have sums within four standard errors of each other.

    That of a sum of independent differences is the root of the sum of their squares.
    """
    (reference,) = seeds(99, samples=4096, replicates=16)  # its error is an eighth of those held against it, or less
    lit = reference.image[..., 0] > 0.1 * np.percentile(reference.image, 99)
    for n in (2, 8):
        shots = seeds(*range(n), samples=8, replicates=1)
        assert shots[0].standard_error is None
        together = merged(shots)
        assert (together.samples, together.replicates) == (8 * n, n)
        off = (together.image.astype(float) - reference.image)[lit]
        stated = np.square(together.standard_error)[lit] + np.square(reference.standard_error)[lit]
        gap = off**2 - stated
        assert abs(gap.sum()) < 4 * np.sqrt((gap**2).sum()), n
        assert gap.size > 400 and np.sqrt((gap**2).sum()) < 0.2 * stated.sum()  # sharp enough to tell


def test_seeds_are_weighed_by_their_samples():
    one, two = *seeds(0, samples=8), *seeds(1, samples=32)
    together = merged([one, two])
    mean = (8 * one.image.astype(float) + 32 * two.image) / 40
    np.testing.assert_allclose(together.image, mean, rtol=2**-24)
    squares = np.square(8 * one.standard_error.astype(float)) + np.square(32 * two.standard_error)
    np.testing.assert_allclose(together.standard_error, np.sqrt(squares) / 40, rtol=2**-23)
    assert np.array_equal(merged([two, one]).image, together.image)
    assert together.samples == 40 and together.replicates == one.replicates + two.replicates
    assert together.seed == (0, 1) and together.sample_counts is None
    # In tiles, whatever their order.
    tiles = (np.s_[0:24, 8:16], np.s_[0:24, 16:40])
    parts = [part for tile in tiles for part in seeds(0, 1, samples=8, region=tile)]
    whole = merged(seeds(0, 1, samples=8))
    for order in ((3, 0, 2, 1), (1, 2, 0, 3)):
        again = merged(parts[i] for i in order)
        assert np.array_equal(again.image, whole.image) and again.region == whole.region
        assert np.array_equal(again.standard_error, whole.standard_error)


def test_pixels_without_samples_count_nothing():
    rng = np.random.default_rng(3)
    one = made_up(rng, (0, 4, 0, 6))
    two = dataclasses.replace(made_up(rng, (0, 4, 0, 6)), seed=6)
    together = merged([one, two])
    counts = one.sample_counts + two.sample_counts
    assert np.array_equal(counts_of(together), counts)
    only = (one.sample_counts > 0) & (two.sample_counts == 0)
    np.testing.assert_allclose(together.image[only], one.image[only], rtol=2**-23)
    np.testing.assert_allclose(together.standard_error[only], one.standard_error[only], rtol=2**-23)
    none = counts == 0
    assert (together.image[none] == 0).all() and np.isinf(together.standard_error[none]).all()


def test_seeds_are_kept_and_do_not_count_twice(tmp_path):
    rng = np.random.default_rng(5)
    shots = [dataclasses.replace(made_up(rng, (0, 2, 0, 3)), seed=seed) for seed in (5, 2**64 - 1, 0)]
    merged(shots[:2]).save(tmp_path / "a.exr")
    both, three = pl.Exposure.load(tmp_path / "a.exr"), merged(shots)
    again = merged([both, shots[2]])
    assert both.seed == (5, 2**64 - 1) and again.seed == three.seed == (0, 5, 2**64 - 1)
    # Means and errors are rounded to float32 once more, by at most 2^-24 of the largest that is weighed.
    np.testing.assert_allclose(again.image, three.image, rtol=2**-22, atol=2**-23)
    np.testing.assert_allclose(again.standard_error, three.standard_error, rtol=2**-22)
    with pytest.raises(pl.errors.InvalidValueError, match="2 parts of rows 0:2, columns 0:3 have the seed 5"):
        merged([both, shots[0]])
    # Regions beside each other share no random numbers, whatever their seeds.
    assert merged([both, dataclasses.replace(made_up(rng, (0, 2, 3, 4)), seed=5)]).seed == both.seed


def alike(region=(0, 2, 0, 4), **changes):
    shape = region[1] - region[0], region[3] - region[2]
    return pl.Exposure(np.ones((*shape, 1)), **{"samples": 4, "seed": 0, "region": region, **changes})


def test_what_one_part_lacks_the_whole_lacks():
    error, truth = np.ones((2, 4, 1)), pl.GroundTruth(depth=np.ones((2, 4)))
    both = pl.GroundTruth(depth=np.full((2, 4), 2.0), distance=np.ones((2, 4)))
    one = alike(standard_error=error, truth=truth, replicates=2, stats=RenderStats(), object_names=("a", ""))
    together = merged([one, alike((2, 4, 0, 4), truth=both)])
    assert together.standard_error is None and together.replicates is None and together.stats is None
    assert np.array_equal(together.depth, np.repeat([1.0, 2.0], 2)[:, None] * np.ones((4, 4)))
    assert together.truth.distance is None and together.object_names == ("a", "")
    assert merged([one, alike((2, 4, 0, 4))]).truth is None
    assert merged([one]).standard_error is not None and merged([one]).region == (0, 2, 0, 4)


def test_statistics_are_those_of_all():
    one = RenderStats(2.0, 3.0, 100, 80, (("clipped", 0, 15), ("missed", None, 5)), 1, 2, 0.0, ((1, 2, 3),), 4)
    two = RenderStats(
        1.0, 1.5, 50, 30, (("clipped", 0, 20),), 2, 4, 0.5, ((7, 8, 9),), 6, StopReason.INTERRUPTED, None, ("x",)
    )
    together = merged([alike(stats=one), alike((2, 4, 0, 4), stats=two)]).stats
    assert (together.seconds, together.cpu_seconds) == (3.0, 4.5)
    assert (together.paths, together.paths_through_lens, together.nonfinite) == (150, 110, 3)
    assert together.lost_by_cause == {"clipped": 35, "missed": 5} and together.threads == 4
    assert together.nonfinite_paths == ((1, 2, 3), (7, 8, 9)) and together.zero_variance == 10
    assert together.stopped_by is StopReason.INTERRUPTED and together.processors == ("x",)
    # Both kept as much light, and the second one lost as much again: 1 of 3.
    assert together.clamped == pytest.approx(1 / 3)
    assert merged([alike(stats=one), alike(seed=1, stats=two)]).stats.zero_variance == 4


def test_what_does_not_fit_is_refused():
    below, some = (2, 4, 0, 4), pl.rendering.RenderSettings
    both = "part 0 (rows 0:2, columns 0:4) and part 1 (rows 1:3, columns 0:4) overlap; regions of parts must be"
    left = "rows 1:4, columns 4:5; rows 2:4, columns 2:4 out|rows 2:4, columns 2:4; rows 1:2, columns 4:5|out; give"
    for parts, said in (
        ([], "parts is empty"),
        ([3], "an item of parts is"),
        ([alike(), alike((1, 3, 0, 4))], both),
        ([alike(), alike((0, 2, 8, 9))], "parts of rows 0:2, columns 0:9 leave rows 0:2, columns 4:8 out"),
        ([alike(), alike((2, 4, 0, 2)), alike((0, 1, 4, 5))], left),
        ([alike(), alike()], "2 parts of rows 0:2, columns 0:4 have the seed 0"),
        ([alike(), alike(seed=None)], "one does not know its seed"),
        ([alike(), alike(below, samples=None)], "part 1 does not know its samples"),
        ([alike(samples=None)], "part 0 does not know its samples"),
        ([alike(), alike(below, camera=CAMERA)], "part 1 has another camera than part 0"),
        ([alike(), alike(below, white=True)], "part 1 has another subject than part 0"),
        ([alike(settings=some()), alike(below, settings=some(3))], "part 1 has other settings than part 0"),
        ([alike(), pl.Exposure(np.ones((2, 4, 3)), samples=4, region=below)], "part 1 has 3 channels and part 0"),
        ([alike(samples=(1 << 31) - 1), alike(seed=1, samples=1)], f"have {1 << 31} samples together; "),
        ([alike(samples=1 << 40)], f"have {1 << 40} samples together; "),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=said if "|" in said else re.escape(said)):
            merged(parts)
    assert merged([alike(samples=(1 << 31) - 2), alike(seed=1, samples=1)]).samples == (1 << 31) - 1


@given(shape=st.tuples(st.integers(1, 90), st.integers(1, 90)), data=st.data())
@settings(max_examples=60)
def test_tiles_are_whole_blocks_and_cover_the_sensor_once(shape, data):
    blocks = [-(-length // 8) for length in shape]
    rows, columns = (data.draw(st.integers(1, n)) for n in blocks)
    camera = dataclasses.replace(CAMERA, sensor=pl.Sensor(shape=shape, pixel_pitch=0.01))
    tiles = camera.tiles(rows, columns)
    assert len(tiles) == rows * columns and list(tiles) == sorted(tiles, key=lambda t: (t[0].start, t[1].start))
    covered = np.zeros(shape, dtype=int)
    for tile in tiles:
        covered[tile] += 1
        assert tile[0].start % 8 == 0 and tile[1].start % 8 == 0
    assert (covered == 1).all()
    high = {-(-(tile[0].stop - tile[0].start) // 8) for tile in tiles}
    assert max(high) - min(high) <= 1  # alike, to a block
    with pytest.raises(pl.errors.InvalidValueError, match=f"give at most {blocks[0]}"):
        camera.tiles(blocks[0] + 1, 1)
    with pytest.raises(pl.errors.InvalidValueError, match="columns is 0"):
        camera.tiles(1, 0)
