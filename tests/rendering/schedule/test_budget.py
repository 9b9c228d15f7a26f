"""Ends of a render by samples, time, error or interruption, none of which may bias the image."""

import dataclasses
import math
import os
import signal
import statistics
import threading
import time

import numpy as np
import pytest
from honesty import counts_of

import plenoptic as pl
from plenoptic.rendering.schedule import tile_jobs
from plenoptic.rendering.schedule.progress import Progress

CAMERA = pl.camera.example_camera()
MIDDLE = np.s_[240:264, 240:264]
LONG = 1 << 22  # samples that would take minutes


def white(region=MIDDLE, **settings):
    return pl.render_white(CAMERA, region=region, progress=False, **settings)


def shoot(scene, region=MIDDLE, **settings):
    return pl.render(scene, CAMERA, region=region, **{"truth": pl.Truth.NONE, "progress": False, **settings})


def same_bits(a, b):
    pairs = (a.image, b.image), (a.standard_error, b.standard_error), (counts_of(a), counts_of(b))
    return all(np.array_equal(*pair) for pair in pairs)


def test_budgets_that_cannot_end_a_render_are_refused():
    one = np.s_[256:257, 256:257]
    for settings, said in (
        ({}, "give one of them"),
        ({"target_error": 0.1, "replicates": 1}, "replicates is 1.*at least 2"),
        ({"target_error": 5}, "500 %"),
        ({"region": one, "target_error": 0.05, "replicates": 8}, "single pixel"),  # nobody decides for it
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=said):
            white(**settings)
    # With fewer replicates the rest of its block decides with it.
    for columns, replicates in ((slice(256, 258), 8), (slice(256, 257), 2)):
        shot = white((slice(256, 257), columns), target_error=0.2, replicates=replicates)
        assert shot.stats.stopped_by is pl.rendering.StopReason.TARGET_ERROR


def test_whichever_comes_first_ends_it():
    # 45 is on no step, and replicates do not divide it.
    few = white(samples=45, target_error=0.0001, time_limit=100.0)
    assert few.stats.stopped_by is pl.rendering.StopReason.SAMPLES and few.stats.paths == 45 * 24 * 24
    assert few.samples == 45 and few.sample_counts is None and same_bits(few, white(samples=45))
    coarse = white(samples=LONG, target_error=0.1, time_limit=100.0)
    assert coarse.stats.stopped_by is pl.rendering.StopReason.TARGET_ERROR
    assert coarse.relative_error < 0.11 and coarse.samples < 1000
    short = white(samples=LONG, target_error=1e-5, time_limit=0.3)
    assert short.stats.stopped_by is pl.rendering.StopReason.TIME_LIMIT
    assert short.samples < LONG
    assert not (few.interrupted or coarse.interrupted or short.interrupted)
    # An error that is there at once takes the fewest samples: fewer where unvignetted light is known.
    assert same_bits(white(target_error=0.9), white(samples=8))
    sky = pl.Scene(background=1.0)
    assert same_bits(shoot(sky, target_error=0.9), shoot(sky, samples=32))


def test_few_samples_come_before_any_target():
    for samples in (1, 5, 7):
        shot = white(np.s_[240:244, 240:244], samples=samples, target_error=0.1)
        assert shot.stats.stopped_by is pl.rendering.StopReason.SAMPLES and shot.samples == samples
        assert np.array_equal(shot.image, white(np.s_[240:244, 240:244], samples=samples).image)


def test_black_scenes_end_and_an_error_that_was_missed_is_announced():
    # All that there is is black: no pixel is lit, and no error is left.
    black = pl.Scene([pl.quad((-30, -30, -404), (60, 0, 0), (0, 60, 0), material=pl.Lambertian(0.5))])
    with pytest.warns(UserWarning, match="nothing in the scene emits light"):
        shot = shoot(black, target_error=0.02)
    assert shot.stats.stopped_by is pl.rendering.StopReason.TARGET_ERROR
    assert not shot.image.any() and shot.samples == 32
    # Light that no path has met is no target reached.
    behind = pl.Scene(lights=[pl.QuadLight((0, 0, 500.0), (1, 0, 0), (0, 1, 0), radiance=5.0)])
    with pytest.warns(UserWarning, match="no path met the scene"):
        shot = shoot(behind, target_error=0.05)
    assert shot.stats.stopped_by is pl.rendering.StopReason.TARGET_MISSED and shot.relative_error == math.inf
    # One lit pixel of a thousand: its neighbours of the other colour are black and have nothing to say.
    lamp = pl.Scene([pl.quad((-0.4, -0.4, -404), (0.8, 0, 0), (0, 0.8, 0), material=pl.Emissive(1e3))])
    bare = dataclasses.replace(CAMERA, microlenses=None, microlenses_to_sensor=0.0, stop_to_microlenses=CAMERA.z_sensor)
    bare = dataclasses.replace(bare.focused_at(z=-404.0), sensor=pl.Sensor(shape=(33, 33), pixel_pitch=0.4))
    with pytest.warns(UserWarning, match=r"instead of 0\.5 %"):
        shot = pl.render(lamp, bare, target_error=0.005, samples=100000, progress=False)
    assert shot.stats.stopped_by is pl.rendering.StopReason.TARGET_MISSED


def test_what_has_stopped_is_what_so_many_samples_give():
    region = np.s_[240:280, 240:280]
    shot = white(region, target_error=0.003, tile_side=16)
    numbers = np.unique(shot.sample_counts)
    assert len(numbers) >= 2
    for samples in numbers:
        stopped = shot.sample_counts == samples
        plain = white(region, samples=int(samples))
        assert np.array_equal(shot.image[stopped], plain.image[stopped])
        # Where replicates agree, what a sample brings is known from neighbours, which may have other numbers of them.
        other = shot.standard_error[stopped] != plain.standard_error[stopped]
        assert np.count_nonzero(other) <= plain.stats.zero_variance
        np.testing.assert_allclose(shot.standard_error[stopped], plain.standard_error[stopped], rtol=0.1)


def test_independent_samples_stop_too():
    shot = white(target_error=0.02, sampler=pl.rendering.Sampler.RANDOM)
    assert shot.stats.stopped_by is pl.rendering.StopReason.TARGET_ERROR
    assert shot.relative_error < 0.022
    assert shot.samples > white(target_error=0.02).samples


def test_hardly_any_time():
    for limit in (1e-9, 0.05):
        begin = time.perf_counter()
        with pytest.warns(UserWarning, match="tiles were begun within|nothing has been rendered"):
            shot = shoot(pl.check_scene(), np.s_[:, :], time_limit=limit, truth=pl.Truth.DEPTH | pl.Truth.OBJECT)
        assert time.perf_counter() - begin < 60  # and not that of all 262 144 pixels over and over
        assert shot.stats.stopped_by is pl.rendering.StopReason.TIME_LIMIT
        counts = counts_of(shot)
        unseen = counts == 0
        assert np.all(np.isfinite(shot.image)) and counts.sum() == shot.stats.paths
        assert not shot.image[unseen].any() and np.all(np.isinf(shot.standard_error[unseen]))
        assert np.all(np.isfinite(shot.standard_error[~unseen]))
        # Pixels without time are unknown and not far away.
        assert unseen.any() and np.isnan(shot.depth[unseen]).all() and (shot.truth.object[unseen] == -1).all()
        assert not np.isnan(shot.depth[~unseen]).any()


def test_too_little_time_is_announced(monkeypatch):
    with pytest.warns(UserWarning, match="nothing has been rendered within 1e-09 s, and the image is black"):
        white(time_limit=1e-9)
    original = tile_jobs.render_tile

    def slow(*arguments, **named):
        result = original(*arguments, **named)
        time.sleep(0.8 if result.tile.pixels else 0.0)
        return result

    monkeypatch.setattr(tile_jobs, "render_tile", slow)
    with pytest.warns(UserWarning, match=r"rendering took [0-9.]+ s instead of 0.1 s"):
        white(time_limit=0.1)


def test_all_samples_of_limited_time_count():
    shot = white(time_limit=0.3)
    assert shot.stats.stopped_by is pl.rendering.StopReason.TIME_LIMIT
    assert counts_of(shot).sum() == shot.stats.paths
    for samples in np.unique(counts_of(shot)):
        complete = counts_of(shot) == samples
        assert np.array_equal(shot.image[complete], white(samples=int(samples)).image[complete])


@pytest.mark.slow
@pytest.mark.parametrize(("name", "limit"), [("white", 2.0), ("check", 0.5), ("objects", 2.0)])
def test_a_time_limit_is_kept(name, limit):
    region = MIDDLE if limit < 1 else np.s_[:, :]
    scene = {"white": lambda: None, "check": pl.check_scene, "objects": pl.objects_scene}[name]()
    call = (lambda **k: white(region, **k)) if scene is None else (lambda **k: shoot(scene, region, **k))
    call(samples=8)  # compiles
    took, warned = [], []
    for _ in range(3):
        begin = time.perf_counter()
        shot = call(time_limit=limit)
        took.append(time.perf_counter() - begin)
        assert shot.stats.stopped_by is pl.rendering.StopReason.TIME_LIMIT
        warned.append(shot.stats.seconds)
    assert statistics.median(took) == pytest.approx(statistics.median(warned), abs=0.3)
    allowed = max(0.1 * limit, 0.8)  # a slow machine ends its last tiles late
    assert limit - allowed < statistics.median(took) < limit + allowed, took


@pytest.fixture
def handler():
    """The handler of SIGINT, which every test must leave as it was."""
    before = signal.getsignal(signal.SIGINT)
    yield before
    assert signal.getsignal(signal.SIGINT) is before
    signal.signal(signal.SIGINT, before)


def interrupt_after(monkeypatch, number):
    """Ctrl-C once so many batches have been taken."""
    original, results = Progress.take, []

    def take(*arguments):
        original(*arguments)
        results.append(True)
        if len(results) == number:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(Progress, "take", take)


def test_ctrl_c_gives_what_is_there(handler, monkeypatch):
    interrupt_after(monkeypatch, 4)
    begin = time.perf_counter()
    with pytest.warns(pl.errors.BudgetWarning, match="the render was interrupted with .* samples in "):
        shot = white(threads=2, target_error=1e-6)
    assert time.perf_counter() - begin < 30
    assert shot.interrupted and shot.stats.stopped_by is pl.rendering.StopReason.INTERRUPTED
    assert "interrupted" in repr(shot)
    counts = counts_of(shot)
    assert 0 < counts.max() < 1 << 15
    complete = counts == counts.max()
    assert np.array_equal(shot.image[complete], white(samples=int(counts.max())).image[complete])
    assert counts.sum() <= shot.stats.paths


def test_ctrl_c_before_anything_is_there(handler, monkeypatch):
    original = tile_jobs.render_tile
    times = iter(range(1 << 20))

    def interrupted(*arguments, **named):
        for _ in range(1 if next(times) == 0 else 2):
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.1)
        return original(*arguments, **named)

    monkeypatch.setattr(tile_jobs, "render_tile", interrupted)
    with pytest.warns(pl.errors.BudgetWarning, match="with no samples in 100 % of the pixels; .* are black"):
        shot = white(samples=LONG, threads=1)
    assert shot.interrupted and not shot.image.any() and np.all(np.isinf(shot.standard_error))
    assert not counts_of(shot).any()
    # A second one raises: both while the first batch is in work, on the thread that does it.
    for threads in (1, 2):
        with pytest.raises(KeyboardInterrupt):
            white(samples=LONG, threads=threads)


def test_rendering_goes_on_in_other_threads(handler):
    # Only the main thread can listen to signals.
    shots = []
    thread = threading.Thread(target=lambda: shots.append(white(samples=32, threads=2)))
    thread.start()
    thread.join()
    assert same_bits(shots[0], white(samples=32))


def test_an_interrupted_exposure_says_how_much_of_the_frame_has_what(handler, monkeypatch, tmp_path):
    with monkeypatch.context() as patched, pytest.warns(pl.errors.BudgetWarning) as said:
        interrupt_after(patched, 6)
        shot = white(time_limit=600.0, tile_side=8, threads=1)  # nine tiles, of which six are begun
    text = f"{shot.samples} samples in 66.7 % of the pixels, none in 33.3 %"
    assert [str(one.message).partition(";")[0] for one in said] == [f"the render was interrupted with {text}"]
    assert text in repr(shot)
    shot.save(tmp_path / "shot.exr")  # it is saved as an interrupted one
    back = pl.Exposure.load(tmp_path / "shot.exr")
    assert back.interrupted and same_bits(back, shot)
    # It is told in the last moment too.
    interrupt_after(monkeypatch, 1)
    said = "the render was interrupted with 8 samples in 100 % of the pixels$"
    with pytest.warns(pl.errors.BudgetWarning, match=said):
        shot = white(samples=8, threads=1)
    assert shot.interrupted and shot.samples == 8 and shot.sample_counts is None
