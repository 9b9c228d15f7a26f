"""`pl.estimate`: pilots from the whole frame, and numbers that are in order. Times are not held to any clock."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from ghost_images import TRIPLET, camera_of
from hypothesis import given, settings
from hypothesis import strategies as st

import plenoptic as pl
from plenoptic.camera.cache import prepared_camera
from plenoptic.rendering.estimation import costs
from plenoptic.rendering.estimation.pilot import pilot_tiles, whole_tiles
from plenoptic.rendering.schedule.budget import checked_budget
from plenoptic.rendering.tiling import cut_into_tiles

CAMERA = pl.camera.example_camera(shape=(72, 208))
SCENE = pl.check_scene()
NUMBERS = ("cpu_seconds", "seconds", "peak_memory", "file_size", "checkpoint_size", "samples")


@pytest.fixture(autouse=True)
def few(monkeypatch):
    """Pilot runs with a sixteenth of the paths: these tests do not depend on their precision."""
    monkeypatch.setattr(costs, "_PATHS", 1 << 14)
    monkeypatch.setattr(costs, "_FEWEST", 1 << 10)


def estimate(scene=SCENE, camera=CAMERA, **given):
    return pl.estimate(scene, camera, progress=False, **given)


def check(found):
    for name in NUMBERS:
        number = getattr(found, name)
        assert 0 < number.low <= number.value <= number.high < np.inf, name
    assert found.seconds.low <= found.cpu_seconds.high  # several threads are no slower than one


@given(data=st.data(), seed=st.integers(0, 1000))
@settings(max_examples=80)
def test_squares_of_pilots_are_in_the_region_on_its_grid_of_8(data, seed):
    side = data.draw(st.sampled_from([1, 3, 8, 16, 64]))
    row, column = data.draw(st.tuples(st.integers(0, 50), st.integers(0, 50)))
    rows, columns = data.draw(st.tuples(st.integers(side, 300), st.integers(side, 300)))
    n, across = data.draw(st.integers(1, 20)), data.draw(st.integers(1, 4))
    tiles = pilot_tiles((row, row + rows, column, column + columns), n, across**2, side, seed)
    assert len(tiles) == n and {tile.side for tile in tiles} == {side}
    for i, tile in enumerate(tiles):
        assert (tile.row, tile.column, tile.rows, tile.columns) == (i * side * across, 0, side * across, side * across)
        assert len(tile.places) == across**2
        for r, c in tile.places:
            assert row <= r <= row + rows - side and column <= c <= column + columns - side
            assert (r - row) % 8 == 0 and (c - column) % 8 == 0


def test_pilots_are_spread_evenly_over_the_frame():
    """64 squares in 8 x 8 cells of 128 x 128 pixels: one in each, whatever the seed, and in each tile from all over."""
    length = 8 * 128
    for seed in range(20):
        places = np.array([tile.places for tile in pilot_tiles((0, length, 0, length), 4, 16, 16, seed)])
        cells = places.reshape(-1, 2) // 8 // 16
        assert {tuple(cell) for cell in cells.tolist()} == set(itertools.product(range(8), repeat=2))
        assert (places.std(axis=1) > 150).all()  # of 16 even ones: 290 +- 50


def test_the_rim_counts_as_much_as_it_is_large():
    """Squares side by side are met as often as they have pixels of their own: the last may reach into others."""
    for side, shape in ((64, (200, 328)), (16, (40, 72))):
        hits, n, seeds = np.zeros([-(-length // side) for length in shape]), 8, 400
        for seed in range(seeds):
            places = [tile.places[0] for tile in pilot_tiles((0, shape[0], 0, shape[1]), n, 1, side, seed)]
            np.add.at(hits, tuple(-(-np.array(places).T // side)), 1)
        parts = [np.minimum(side, length - side * np.arange(k)) for length, k in zip(shape, hits.shape, strict=True)]
        expected = n * seeds * np.multiply.outer(*parts) / math.prod(shape)
        # Of strata: they scatter less than by Poisson's law, and the one that is left out of 9 at random by no more.
        assert (np.abs(hits - expected) < 4 * np.sqrt(expected)).all(), side


def test_pilots_that_decide_are_the_tiles_of_the_frame():
    """Cut ones too, each once: together they have all pixels of a small frame."""
    frame = (8, 8 + 96, 16, 16 + 88)
    _, tiles = cut_into_tiles(frame, checked_budget(None, None, 0.1, 2), None, 1.0)
    pilots, camera = whole_tiles(tiles), prepared_camera(pl.camera.example_camera(shape=(128, 128))).record
    assert [(tile.rows, tile.columns) for tile in pilots] == [(64, 64), (64, 24), (32, 64), (32, 24)]
    assert [tile.row for tile in pilots] == [0, 64, 128, 160]
    for pilot, tile in zip(pilots, tiles, strict=True):
        assert np.array_equal(pilot.numbers(camera), tile.numbers(camera))
        assert np.array_equal(pilot.centres(camera), tile.centres(camera))


def test_the_interval_of_samples_holds_where_tiles_are_cut():
    """It is meant to hold in 8 of 10 cases: of 9 at least 5 do, but for a chance of 1 in 50."""
    camera, holds = pl.camera.example_camera(shape=(96, 96)), []
    for target in (0.06, 0.04, 0.025):
        result = estimate(SCENE, camera, target_error=target, truth=pl.Truth.NONE, threads=1)
        for seed in (1, 2, 3):
            shot = pl.render(SCENE, camera, target_error=target, truth=pl.Truth.NONE, seed=seed, progress=False)
            holds.append(result.samples.low <= shot.stats.paths / 96**2 <= result.samples.high)
    assert sum(holds) >= 5


def test_samples_that_are_given_are_given_back_and_regions_may_be_smaller_than_pilots():
    for options in (
        {"samples": 8, "replicates": 8, "truth": pl.Truth.ALL},
        {"samples": 3000},
        {"samples": 1, "threads": 1, "max_bounces": 1, "clamp": 4.0, "caustics": pl.rendering.Caustics.EXCLUDE},
    ):
        check(result := estimate(**options))
        assert set(result.samples) == {options["samples"]}
    for region, replicates in ((np.s_[3:4, 5:6], 2), (np.s_[3:6, 8:13], 1), (np.s_[8:16, 4:204], 2)):
        check(result := estimate(samples=4, region=region, replicates=replicates))
        pixels = (region[0].stop - region[0].start) * (region[1].stop - region[1].start)
        assert result.file_size.value < 20_000 + 20 * pixels  # what describes the camera, and three numbers a pixel


def test_a_target_ends_with_the_samples_that_are_given():
    check(result := estimate(SCENE, target_error=0.0005, samples=24))
    assert result.samples.high <= 24 and result.samples.value == 24
    check(free := estimate(None, target_error=0.2, samples=1 << 20))
    assert free.samples.value < 1000
    first = [line[:18].rstrip() for line in repr(free).splitlines()[:7]]
    assert first[:4] == ["processor time", "time", "samples per pixel", "relative error"]
    assert first[4:] == ["peak memory", "EXR file", "checkpoint"]
    assert "unvignetted core" in repr(free)
    for samples in (2, 3):  # too few to decide by
        check(result := estimate(None, samples=samples, target_error=0.02, threads=1))
        assert result.samples == (samples, samples, samples)


def test_what_is_impossible_is_refused():
    array = dataclasses.replace(CAMERA.microlenses, model=pl.optics.MicrolensModel.PINHOLE)
    pinholes = dataclasses.replace(CAMERA, microlenses=array)
    for wrong, said in (
        ({}, "samples and target_error are both None"),
        ({"samples": 4, "max_bounces": -1}, "max_bounces is -1"),
        ({"samples": 4, "ghosts": 2}, "ghosts is an int; give a Ghosts, such as"),
        ({"samples": 4, "ghosts": GHOSTS, "camera": pinholes}, "pinholes a second time"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=said):
            estimate(**wrong)


GHOSTS, QUARTER = pl.rendering.Ghosts(sensor=0.3, samples=256), pl.rendering.Ghosts()
"""With samples of their own, and with a quarter of those of the image."""


@pytest.mark.parametrize(
    "ghosts, most, options",
    [
        (None, 16, {"samples": 64}),
        (None, 256, {"target_error": 0.02}),
        (GHOSTS, 256, {"samples": 64}),
        (GHOSTS, 16, {"target_error": 0.02}),
        (QUARTER, 256, {"target_error": 0.02}),
    ],
)
def test_relative_errors_are_those_of_renders(ghosts, most, options, monkeypatch):
    """Within the intervals: seeds are fixed, and with as many runs errors are no matter of time.

    A wall is seen and a lamp is not, so that nearly all of the noise is that of ghosts.
    """
    monkeypatch.setattr(costs, "_MOST_RUNS", 2)
    monkeypatch.setattr(costs, "_MOST_SAMPLES", most)
    wall = pl.quad((-200, -200, -600), (400, 0, 0), (0, 400, 0), material=pl.Emissive(1.0))
    lamp = pl.quad((-10, 130, -400), (8, 0, 0), (0, 8, 0), material=pl.Emissive(1000.0))
    camera, scene = camera_of(TRIPLET, side=48), pl.Scene([wall, lamp])
    check(result := estimate(scene, camera, ghosts=ghosts, **options))
    found = result.relative_error
    for seed in (1, 2):
        shot = pl.render(scene, camera, ghosts=ghosts, seed=seed, progress=False, **options)
        assert found.low <= shot.relative_error <= found.high
    # Exponents of the fall of errors differ by 1 / 4 from 16 samples to 256; 20 % are unknown on each side.
    assert found.low < found.value < found.high < 3 * found.low


def test_relative_errors_that_are_unknown_are_none():
    for scene, options in (
        (SCENE, {"replicates": 1}),
        (pl.Scene(background=0.0), {}),
        (pl.Scene(points=pl.Points([[0.0, 0.0, -410.0]], intensity=1.0), background=0.1), {}),
    ):
        assert estimate(scene, samples=4, **options).relative_error is None


def test_ghosts_take_part_in_time_memory_and_error_alone(monkeypatch):
    """Not in samples, which a target decides, nor in checkpoints; white images have none."""
    monkeypatch.setattr(costs, "_MOST_SAMPLES", 32)
    camera = camera_of(TRIPLET, side=48)
    few, many = (pl.rendering.Ghosts(samples=samples) for samples in (2, 2048))
    image, with_few, both = (estimate(SCENE, camera, target_error=0.2, ghosts=ghosts) for ghosts in (None, few, many))
    # The set-up of pairs, then paths: each takes several times as long.
    assert both.cpu_seconds.low > with_few.cpu_seconds.high > with_few.cpu_seconds.low > image.cpu_seconds.high
    assert both.peak_memory.value > image.peak_memory.low
    assert (both.samples, both.checkpoint_size) == (image.samples, image.checkpoint_size)
    assert both.plan.runs(pl.rendering.Stage.GHOSTS) and not image.plan.runs(pl.rendering.Stage.GHOSTS)
    white = estimate(None, samples=16, ghosts=GHOSTS, region=np.s_[8:16, 8:16])
    assert not white.plan.runs(pl.rendering.Stage.GHOSTS)


NORMALS = {"samples": 16, "truth": pl.Truth.DEPTH | pl.Truth.NORMAL, "replicates": 8}
SIZES = [(SCENE, NORMALS), (SCENE, {"samples": 64, "region": np.s_[3:6, 8:13]})]
MORE_SIZES = [(SCENE, {"samples": 300}), (None, {"samples": 64})]


@pytest.mark.parametrize("cases", [SIZES, pytest.param(MORE_SIZES, marks=pytest.mark.slow)])
def test_files_have_the_sizes_told(cases, tmp_path):
    """Within the intervals, which are meant to hold mostly: seeds are fixed, and sizes are no matter of time."""
    for k, (scene, options) in enumerate(cases):
        result, state, file = estimate(scene, **options), tmp_path / f"{k}.state", tmp_path / f"{k}.exr"
        render_options = {"checkpoint": state, "progress": False, **options}
        shot = (
            pl.render_white(CAMERA, **render_options) if scene is None else pl.render(scene, CAMERA, **render_options)
        )
        shot.save(file)
        assert result.file_size.low <= file.stat().st_size <= result.file_size.high, options
        assert result.checkpoint_size.low <= state.stat().st_size <= result.checkpoint_size.high, options


@pytest.mark.slow
def test_a_corner_that_is_noisy_counts_as_much_as_it_is_large():
    """A matt plate under a lamp in a quarter of the picture; the rest shines by itself, and ends early."""
    camera = pl.PlenopticCamera(CAMERA.lens, pl.Sensor((128, 128), 0.1), CAMERA.stop_to_microlenses)
    wall = pl.quad((-400, -400, -1000), (800, 0, 0), (0, 800, 0), material=pl.Emissive(1.0, two_sided=True))
    plate = pl.quad((0, 0, -990), (400, 0, 0), (0, 400, 0), material=pl.Lambertian(0.8))
    lamp = pl.QuadLight((-100, -100, -300), (200, 0, 0), (0, 200, 0), radiance=5.0, two_sided=True)
    scene, options = pl.Scene([wall, plate], lights=[lamp]), {"target_error": 0.03}
    halves = slice(0, 64), slice(64, 128)
    quarters = [
        estimate(scene, camera, region=region, **options).samples for region in itertools.product(halves, halves)
    ]
    whole = estimate(scene, camera, **options)
    check(whole)
    lowest, highest = min(quarters), max(quarters)
    assert lowest.value < 0.5 * highest.value
    assert lowest.value < whole.samples.value < highest.value
    mean = np.mean([quarter.value for quarter in quarters])
    assert whole.samples.low <= mean <= whole.samples.high


def test_decisions_are_tried_with_fewer_samples_where_a_sample_takes_long(monkeypatch):
    pilots, run = [], costs.run_pilot
    monkeypatch.setattr(costs, "run_pilot", lambda *given, **more: pilots.append(given) or run(*given, **more))
    monkeypatch.setattr(costs, "_DECIDED_SECONDS", 0.0)
    check(estimate(None, region=np.s_[32:40, 96:112], target_error=1e-4, threads=1))
    # Twice the 8 of the first decision are the least from which it is known how an error falls.
    assert [budget.samples for _, _, budget, *_ in pilots if budget.target_error is not None] == [16, 16]
    # With few samples there are no more pixels: 2^18 would take half a minute. At least two tiles, of one square each.
    pilots.clear()
    monkeypatch.setattr(costs, "_PATHS", 1 << 18)
    monkeypatch.setattr(costs, "_MOST", 1 << 11)
    check(estimate(None, samples=1, threads=1))
    assert pilots and max(sum(tile.pixels for tile in tiles) for _, _, _, tiles, *_ in pilots) <= 72 * 208
