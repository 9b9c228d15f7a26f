"""Progress of a render: steps, decisions by the other colour, and interruptions."""

import dataclasses
import gc
import itertools
import math
import os
import signal
import time
import weakref

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import plenoptic as pl
from plenoptic.camera.sampling.sampling_records import batch_record
from plenoptic.core.progress import bar
from plenoptic.rendering.film import replicate_counts
from plenoptic.rendering.plan.stages import Subject
from plenoptic.rendering.schedule import progress_bar
from plenoptic.rendering.schedule.budget import Budget, checked_budget
from plenoptic.rendering.schedule.clock import Clock
from plenoptic.rendering.schedule.interrupts import Interrupts
from plenoptic.rendering.schedule.progress import FilmRegion, Progress
from plenoptic.rendering.schedule.time_history import TimeHistory
from plenoptic.rendering.tile import Tile, TileResult
from plenoptic.rendering.tiling import cut_into_tiles

REPLICATES = 8


@given(replicates=st.integers(1, 64), steps=st.integers(1, 60))
def test_steps_add_at_most_a_quarter_and_double_in_four(replicates: int, steps: int):
    budget = Budget(None, None, 0.1, replicates)
    counts = [budget.following(0)]
    for _ in range(steps):
        counts.append(budget.following(counts[-1]))
    assert counts[0] == budget.enough and (24 <= counts[0] <= 32 or counts[0] == 4 * replicates)
    for before, after in itertools.pairwise(counts):
        assert before < after <= 1.25 * before and after % replicates == 0
    for before, after in zip(counts, counts[4:], strict=False):
        assert after == 2 * before


@given(replicates=st.integers(1, 64))
def test_with_a_time_limit_all_pixels_have_something_soon(replicates: int):
    budget, timed = Budget(None, None, 0.1, replicates), Budget(None, 1.0, 0.1, replicates)
    counts = list(itertools.accumulate(range(12), lambda samples, _: timed.following(samples), initial=0))
    first = counts.index(timed.enough)
    assert counts[1 : first + 1] == [replicates << k for k in range(first)]
    assert counts[first + 1 :] == [budget.following(samples) for samples in counts[first:-1]]
    samples = counts[first]
    nothing = (0.0, 0.0)
    assert budget.towards(samples, 1e3, nothing) == 4 * samples and timed.towards(samples, 1e3, nothing) == 2 * samples


@given(done=st.sampled_from([8, 32, 56, 1024]), affordable=st.floats(0.0, 1e6))
def test_what_is_affordable_is_most_of_the_next_step(done: int, affordable: float):
    budget = Budget(None, 1.0, None, REPLICATES)
    step = budget.within(done, affordable)
    assert step == budget.following(done) or step - done <= 0.6 * affordable < budget.following(step) - done
    assert Budget(None, 1.0, 0.1, REPLICATES).within(done, affordable) == budget.following(done)  # errors decide there
    assert Budget(step - 1, 1.0, None, REPLICATES).within(done, affordable) == step - 1


@given(samples=st.integers(1, 10**6), replicates=st.integers(1, 64))
def test_steps_end_with_the_samples_and_many_are_rendered_in_two_passes(samples: int, replicates: int):
    budget, total = Budget(samples, 1.0, None, replicates), 0
    while (step := budget.following(total)) > total:
        total = step
    assert total == samples
    budget = Budget(samples, None, None, min(replicates, samples))
    first = budget.following(0)
    assert budget.passes == (first < samples) == (samples >= max(256, 16 * replicates))
    if budget.passes:  # a sixteenth everywhere, as many of each replicate, and then the rest
        assert first % replicates == 0 and samples / 16 - replicates < first <= samples / 16
        assert budget.following(first) == samples


@given(done=st.sampled_from([8, 16, 32, 40, 512]), excess=st.floats(1.06, 30.0))
def test_with_a_core_samples_are_few_and_approached_from_below(done: int, excess: float):
    budget = Budget(None, None, 0.01, 2, with_core=True)
    steps = itertools.accumulate(range(6), lambda n, _: budget.following(n), initial=0)
    assert list(steps) == [0, 8, 16, 24, 32, 40, 48]
    # An error that falls like 1 / n needs `excess` times the samples.
    aimed = budget.towards(done, 0.01 * excess, (done / 2, 0.02 * excess))
    assert aimed == budget.following(done) or aimed <= done * excess < budget.following(aimed)


@given(slope=st.floats(0.5, 0.9), target=st.floats(1e-3, 1.0), excess=st.floats(1.01, 30.0))
def test_the_samples_that_are_needed_are_known_from_two_errors(slope: float, target: float, excess: float):
    # Errors fall like n^-slope: what is predicted reaches the target, and a step less would not.
    budget, total, error = Budget(None, None, target, REPLICATES), 128, target * excess
    aimed = budget.towards(total, error, (32.0, error * 4**slope))
    needed = total * excess ** (1 / slope)
    assert needed * (1 - 1e-9) <= aimed <= max(1.25 * needed * (1 + 1e-9), budget.following(total))
    # With one error alone it is taken to fall as usual, and few samples are lost where it falls faster.
    from_one_error, usual = budget.towards(total, error, (0.0, 0.0)), total * excess ** (1 / 0.6)
    assert (
        min(usual * (1 - 1e-9), 4 * total)
        <= from_one_error
        <= min(max(1.25 * usual * (1 + 1e-9), 1.25 * total), 4 * total)
    )
    # Nothing known: twice as many.
    assert budget.towards(total, 0.0, (0.0, 0.0)) == 2 * total
    assert Budget(150, None, target, REPLICATES).towards(total, error, (0.0, 0.0)) <= 150


def test_many_pixels_decide_where_time_is_not_short():
    for limit, target, replicates, side in (
        (None, 0.1, 2, 64),
        (None, 0.1, 64, 22),
        (1.0, 0.1, 2, 32),
        (1.0, None, 2, 32),
    ):
        assert cut_into_tiles((0, 512, 0, 512), Budget(None, limit, target, replicates), None, 1.0)[0] == side


def test_impossible_budgets_are_refused():
    for numbers, said in (
        ((None, None, None, 8), "all None"),
        ((0, None, None, 8), "samples is 0"),
        ((2**31, None, None, 8), "at most 2147483647"),
        ((None, -1.0, None, 8), "time_limit"),
        ((None, math.nan, None, 8), "time_limit"),
        ((None, None, 0.0, 8), "target_error"),
        ((None, None, 0.02, 1), "at least 2"),
        ((None, None, 0.02, 0), "replicates is 0"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=said):
            checked_budget(*numbers)


TILE = Tile(0, 0, 2, 2)


def result(tile: Tile, sums: np.ndarray, first: int, samples: int) -> TileResult:
    """Result of a tile; sums (rows, columns, replicates, 1) of all samples so far, equal in all replicates."""
    powers = np.square(sums).sum(axis=2, keepdims=True) * REPLICATES / (first + samples)
    sums = np.concatenate([sums, powers], axis=2)
    batch = batch_record(np.uint64(0), first, samples, REPLICATES, 0, 0)
    return TileResult(
        tile, batch, sums, np.ones(sums.shape[:2]), np.zeros(8, dtype=np.int64),
        None, samples * tile.rows * tile.columns, 0, (), 0, 0.0, 0.0,
    )  # fmt: skip


def progress(tiles: list[Tile], shape: tuple[int, int], target: float, samples: int | None = None) -> Progress:
    budget = Budget(samples, None, target, REPLICATES)
    return Progress(
        tiles, (*shape, 1), budget, FilmRegion(0, 0, 1.0, 1e-9, deflected=False), {}, 8, counted=True, begin=(0.0, 0.0)
    )


def noisy(colour: int, samples: int, value: float = 1.0) -> np.ndarray:
    """Sums of replicates of four pixels, of which those of one colour are noisy and the others almost not."""
    spread = np.where(np.arange(REPLICATES) % 2, 1.0, -1.0)
    size = np.where(np.add.outer(np.arange(2), np.arange(2)) % 2 == colour, 1.0, 1e-6)
    return value * (1.0 + 0.5 * size[:, :, None] * spread)[..., None] * (samples / REPLICATES)


EVEN = noisy(0, 32) + noisy(1, 32) - 32 / REPLICATES  # both colours


def decided(tiles, shape, target, sums):
    """Progress after all tiles have brought 32 samples."""
    state = progress(tiles, shape, target)
    for i, tile in enumerate(tiles):
        state.take(i, result(tile, sums[i], 0, 32))
    state.decide()
    return state


@pytest.mark.parametrize("colour", [0, 1])
def test_a_colour_ends_when_the_other_is_good(colour):
    # Errors: 0.5 / sqrt(7) = 0.19 of the noisy colour, 1e-6 of the other, whatever the samples.
    state = decided([TILE], (2, 2), 0.1, [noisy(colour, 32)])
    assert state.open[0].tolist() == [colour == 1 - c for c in range(2)]  # the noisy one ends, the good one goes on
    before = state.film.mean.copy()
    samples = 32 + state.next_samples(0)
    state.take(0, result(TILE, noisy(colour, samples, 3.0), 32, samples - 32))
    state.decide()
    changed = state.film.mean[..., 0] != before[..., 0]
    checkered = np.add.outer(np.arange(2), np.arange(2)) % 2
    assert np.array_equal(changed, checkered != colour)
    assert np.array_equal(state.sample_counts(), np.where(checkered == colour, 32, samples))
    assert state.pending() == [0]
    more = state.next_samples(0)
    state.take(
        0, result(TILE, noisy(1 - colour, samples + more), samples, more)
    )  # now the other way round: both have ended
    state.decide()
    assert state.pending() == []


def test_an_error_that_is_hardly_too_large_will_do():
    # Both colours have 0.5 / sqrt(7) = 0.189.
    for tile, sums, target, ends in (
        (TILE, EVEN, 0.19, True),
        (TILE, EVEN, 0.182, True),
        (TILE, EVEN, 0.178, False),
        (Tile(0, 0, 1, 1), noisy(0, 32)[:1, :1], 0.1, False),  # a single lit pixel decides for itself
        (TILE, np.zeros((2, 2, REPLICATES, 1)), 0.1, True),  # dark tiles end at once
    ):
        assert (decided([tile], (tile.rows, tile.columns), target, [sums]).pending() == []) == ends, target


def test_nothing_is_decided_before_all_have_begun():
    tiles = [TILE, Tile(0, 2, 2, 2)]
    state = progress(tiles, (2, 4), target=10.0)
    state.take(0, result(tiles[0], noisy(0, 32), 0, 32))
    state.decide()
    assert state.pending() == [1] and state.open.all()
    state.take(1, result(tiles[1], noisy(0, 32), 0, 32))
    state.decide()
    assert state.pending() == []


def test_a_few_bright_paths_do_not_make_all_other_pixels_dark():
    # A pixel of each colour has met something a million times as bright, in one replicate of eight.
    tiles = [Tile(row, column, 2, 2) for row in range(0, 8, 2) for column in range(0, 8, 2)]
    rare = EVEN.copy()
    rare[0, :, 0] = 1e6
    sums = [rare if (tile.row, tile.column) == (4, 4) else EVEN for tile in tiles]
    assert decided(tiles, (8, 8), 0.1, sums).open.all()


def rare_light(value):
    """Four tiles of 32 x 32 pixels, all as good as wanted but one of each colour, which has met a bright path."""
    tiles = [Tile(row, column, 32, 32) for row in (0, 32) for column in (0, 32)]
    sums = [np.tile(EVEN, (16, 16, 1, 1)) for _ in tiles]
    sums[1][8, 8:10, 0] += value
    return decided(tiles, (64, 64), 0.3, sums)


def test_where_the_error_rests_on_few_pixels_all_tiles_go_on():
    assert not rare_light(0.0).open.any()
    state = rare_light(1e4)
    assert state.open.all()
    # Until there are 4096 samples, or as many as were asked for.
    assert state.budget.enough_of_rare == 4096
    assert Budget(64, None, 0.3, REPLICATES).enough_of_rare == 64
    assert Budget(None, 1.0, 0.3, REPLICATES).enough_of_rare > 1 << 30


def test_stopping_by_the_other_colour_does_not_bias():
    # Rare bright samples: Bernoulli of probability 0.02 and value 50. Pixels that stopped by their own errors would
    # mostly do so when they had seen few of them.
    rng = np.random.default_rng(7)
    side, target = 25, 0.6
    tiles = [Tile(2 * row, 2 * column, 2, 2) for row in range(side) for column in range(side)]
    state = progress(tiles, (2 * side, 2 * side), target, samples=512)
    naive, stopped, sums = np.zeros((side * side, 4)), np.zeros(side * side, dtype=bool), [0.0] * side * side
    while left := state.pending():
        for i in left:
            first, more = int(state.done[i]), state.next_samples(i)
            drawn = 50.0 * rng.binomial(replicate_counts(more, REPLICATES), 0.02, size=(2, 2, REPLICATES))[..., None]
            sums[i] = sums[i] + drawn
            state.take(i, result(tiles[i], sums[i], first, more))
            if not stopped[i]:
                naive[i] = sums[i].sum(axis=(2, 3)).ravel() / (first + more)
                means = sums[i][..., 0] * REPLICATES / (first + more)
                error = means.std(axis=2, ddof=1) / math.sqrt(REPLICATES)
                stopped[i] = np.sqrt(np.mean(error**2)) < target
        state.decide()
    honest = state.film.mean.mean(), state.film.mean.std() / math.sqrt(state.film.mean.size)
    assert abs(honest[0] - 1.0) < 3 * honest[1]
    assert naive.mean() < 1.0 - 4 * naive.std() / math.sqrt(naive.size)


def test_the_first_interrupt_is_noted_and_told_and_the_second_raised():
    before, calls = signal.getsignal(signal.SIGINT), []
    with Interrupts(lambda: calls.append(1)) as interrupts:
        assert not interrupts.asked and not calls
        signal.raise_signal(signal.SIGINT)
        assert interrupts.asked
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before and calls == [1]


@pytest.fixture
def terminal(monkeypatch):
    monkeypatch.setattr(bar, "terminal_size", lambda: os.terminal_size((80, 24)))


def test_the_bar_ends_with_the_error(capsys, terminal):
    shot = pl.render_white(small_camera(), target_error=0.5)
    said = capsys.readouterr().err
    assert "100%" in said and f"error {100 * shot.relative_error:.2g} %" in said
    pl.render_white(small_camera(), samples=8, progress=False)
    assert capsys.readouterr().err == ""


def test_the_bar_shows_how_much_is_left(monkeypatch, capsys, terminal):
    clock, tiles = [100.0], [Tile(0, 2 * k, 2, 2) for k in range(4)]
    monkeypatch.setattr(progress_bar.time, "perf_counter", lambda: clock[0])

    def began(state, seconds, *expected):
        bar = progress_bar.ProgressBar(seconds, show=True)
        bar.start(state, *expected)

        def later(by, tile=None):
            """Text of the bar after some seconds, with another tile."""
            if tile is not None:
                state.take(tile, result(tiles[tile], noisy(0, 32), 0, 32))
            clock[0] += by
            bar.update()
            return capsys.readouterr().err

        return bar, later

    bar, later = began(progress(tiles, (2, 8), target=1e-9, samples=32), 100.0)
    # One colour of a tile is good to 0.5 / sqrt(7), the other to 1e-6: 13 % together.
    said = later(1000.0, 0)  # compiling, mostly
    assert "25%" in said and "left" not in said and "error 13 %" in said
    said = later(300.0, 1)
    assert "50%" in said and "10 min left" in said
    bar.end()
    said = capsys.readouterr().err
    assert "interrupted, ending" in said and "left" not in said
    # With a time limit, 20 s of which were spent before.
    budget, region = Budget(None, 50.0, None, 8), FilmRegion(0, 0, 1.0, 1.0, deflected=False)
    state = Progress([TILE], (2, 2, 1), budget, region, {}, 8, counted=True, begin=(0.0, 0.0))
    _, later = began(state, clock[0] - 20.0)
    later(5.0)
    said = later(5.0)
    assert "60%" in said and "20 s left" in said
    # It begins with what was expected, 400 s, and ends with the pace.
    _, later = began(progress(tiles, (2, 8), target=1e-9, samples=32), clock[0], 400.0)
    assert "0%" in (said := capsys.readouterr().err) and "7 min left" in said
    for i, text in ((0, "5 min"), (1, "9 min"), (2, "6 min")):
        # The first tile may have had to be compiled: 3/4 of 400 s. Then the pace is 430 s for a quarter, 1720 s in all:
        # (1 - s) (s 1720 + (1 - s) 400) = 530 s at s = 1/2, and 347 s at 3/4.
        assert f"{text} left" in later(430.0, i).rpartition("|")[2]


def small_camera():
    return pl.PlenopticCamera(pl.load_lens("double-gauss-100mm-f2"), pl.Sensor((8, 8), 0.1), 130.0)


def bar_of(monkeypatch, shot):
    """Expected time passed to the progress bar of a render."""
    expected, start = [], progress_bar.ProgressBar.start
    with monkeypatch.context() as listening:
        listening.setattr(
            progress_bar.ProgressBar, "start", lambda bar, *given: (expected.append(given[1]), start(bar, *given))
        )
        shot()
    return expected[0]


def test_a_render_begins_with_what_was_estimated_of_it(monkeypatch):
    camera, scene, quiet = small_camera(), pl.shapes.white_plane(), {"progress": False}
    estimated = pl.estimate(scene, camera, samples=4, **quiet).seconds.value
    white = pl.estimate(None, camera, target_error=0.5, threads=1, **quiet).seconds.value
    for more, other in (({}, False), ({"seed": 1}, False), ({"samples": 5}, True), ({"truth": pl.Truth.NONE}, True)):
        expected = bar_of(monkeypatch, lambda more=more: pl.render(scene, camera, **{"samples": 4, **quiet, **more}))
        assert expected == (None if other else estimated), more
    again = dataclasses.replace(camera)
    assert bar_of(monkeypatch, lambda: pl.render(scene, again, samples=4, **quiet)) is None
    assert bar_of(monkeypatch, lambda: pl.render_white(camera, target_error=0.5, threads=1, **quiet)) == white
    assert bar_of(monkeypatch, lambda: pl.render_white(camera, target_error=0.5, threads=2, **quiet)) is None


def test_estimates_keep_no_scene_alive():
    times, camera = TimeHistory(), small_camera()
    for n in range(40):
        scene = pl.Scene(background=1.0 + n)
        times.record(Subject(scene, camera), n, seconds=float(n))
        assert times.seconds_of(Subject(scene, camera), n) == n and times.seconds_of(Subject(None, camera), n) is None
    gone = weakref.ref(scene)
    del scene
    gc.collect()
    assert gone() is None and times.seconds_of(Subject(None, camera), 39) is None
    assert times.seconds_of(Subject(pl.Scene(background=40.0), camera), 39) is None


def test_batches_hold_as_many_samples_of_each_replicate():
    clock = Clock(0.0, None)
    room = clock.paths_per_batch()
    for pixels, replicates in ((1, 1), (100, 7), (65536, 16), (1 << 21, 8)):
        samples = clock.samples_per_batch(pixels, replicates)
        assert samples % replicates == 0
        assert samples * pixels <= room or samples == replicates
        assert (samples + replicates) * pixels > room


def test_a_clock_leaves_time_to_finish_large_images():
    begin = time.perf_counter()
    assert Clock(begin - 0.5, 1.0).has_time(1)
    assert not Clock(begin - 0.5, 1.0, numbers=10**9).has_time(1)  # half of the limit at most
    assert Clock(begin - 0.3, 1.0, numbers=10**9).has_time(1)
