"""A render that ends before its time goes on from its checkpoint, and gives the bits of one that never ended."""

import dataclasses
import errno
import functools
import itertools
import os
import pickle
import random
import signal
import subprocess
import sys
import tempfile
import time
import types
import warnings

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.camera.camera_record import camera_record
from plenoptic.core.files.record_log import RecordLog
from plenoptic.rendering.schedule import budget as budgets
from plenoptic.rendering.schedule import tile_jobs
from plenoptic.rendering.schedule.checkpoint import KIND

CAMERA = pl.camera.example_camera()
BITS = ("image", "standard_error", "depth", "sample_counts")
COUNTS = ("paths", "paths_through_lens", "lost", "nonfinite")
COUNTS += ("nonfinite_paths", "zero_variance", "stopped_by", "processors")


@functools.cache
def board(radiance=1.0):
    """The middle of the reference scene `check`."""
    even, odd = pl.checkerboard((40, 40), 1.0, even=pl.Emissive(radiance), odd=pl.Emissive(0.0), offset=(-0.05, 0.1))
    return pl.Scene([even.translated(z=-404), odd.translated(z=-404)])


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    """The same camera over and over needs its tables once, and no disk has to be waited for."""
    monkeypatch.setattr("plenoptic.camera.cache.camera_record", functools.cache(camera_record))
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)


def render(scene=None, camera=None, **arguments):
    """Nine tiles."""
    options = {"region": np.s_[240:264, 240:264], "tile_side": 8, "threads": 1, "progress": False, **arguments}
    return pl.render(scene or board(), camera or CAMERA, **options)


def assert_same(one, other):
    for name in BITS:
        a, b = getattr(one, name), getattr(other, name)
        assert (a is None) == (b is None), name
        assert a is None or (a.dtype == b.dtype and a.tobytes() == b.tobytes()), f"bits of {name}"
    assert (one.samples, one.replicates, one.seed) == (other.samples, other.replicates, other.seed)
    for name in COUNTS:
        assert getattr(one.stats, name) == getattr(other.stats, name), name
    assert one.stats.clamped == pytest.approx(other.stats.clamped, rel=1e-12)


@pytest.fixture
def after_tiles(monkeypatch):
    """Calls a function with the number of a tile whenever one is to be rendered; and counts them."""
    original = tile_jobs.render_tile

    def listen(function=lambda number: None):
        numbers = []

        def watched(context, tile, *others, **named):
            if tile.pixels:  # others are compiled ahead with
                numbers.append((tile, others[0].first, others[0].samples))
                function(len(numbers) - 1)
            return original(context, tile, *others, **named)

        monkeypatch.setattr(tile_jobs, "render_tile", watched)
        return numbers

    return listen


BUDGETS = {"samples": {"samples": 24}, "independent samples": {"samples": 17, "sampler": pl.rendering.Sampler.RANDOM}}
BUDGETS |= {"one replicate": {"samples": 5, "replicates": 1}, "target": {"target_error": 0.03}}
BUDGETS |= {"target and samples": {"target_error": 0.03, "samples": 60, "truth": pl.Truth.NONE}}
QUICK = "target and samples"


@functools.cache
def unbroken(name):
    return render(**BUDGETS[name])


def entries_of(path):
    """The records of a file, as facts and the place where each ends."""
    log = RecordLog(path, KIND)
    log.close()
    return [(entry.facts, entry.position + entry.length) for entry in log.entries]


@pytest.mark.filterwarnings("ignore:.* bytes of .* are damaged:plenoptic.errors.FileWarning")
@pytest.mark.parametrize("budget", [pytest.param(n, marks=() if n == QUICK else pytest.mark.slow) for n in BUDGETS])
def test_every_beginning_of_a_file_leads_to_the_same_bits(tmp_path, after_tiles, budget):
    path = tmp_path / "state"
    assert_same(render(checkpoint=path, **BUDGETS[budget]), unbroken(budget))
    content, records = path.read_bytes(), entries_of(path)
    ends = [content.index(b"\x93plenoptic rec\r\n"), *(end for _, end in records)]
    assert len(records) >= 9 and ends[-1] == len(content)
    # All of the first round, after which tiles are decided upon for the first time, and some of the others.
    chosen = sorted({*range(11), *range(11, len(ends), max(1, len(ends) // 6))} & {*range(len(ends))})
    numbers = after_tiles()
    for whole in chosen:
        length = ends[whole]
        if whole % 2 and whole + 1 < len(ends):  # within the next record
            length += (ends[whole + 1] - length) * whole // len(ends)
        path.write_bytes(content[:length])
        numbers.clear()
        assert_same(render(checkpoint=path, threads=1 + whole % 2, **BUDGETS[budget]), unbroken(budget))
        assert len(numbers) == len(records) - whole  # what is there is not rendered again
        assert len(entries_of(path)) == len(records)


def test_batches_of_a_tile_go_on_too(tmp_path, after_tiles, monkeypatch):
    # A tile with more paths than a batch may have is rendered in several.
    monkeypatch.setattr("plenoptic.rendering.schedule.clock.PATHS_PER_BATCH", 1024)
    path, whole = tmp_path / "state", render(samples=50)
    assert_same(render(samples=50, checkpoint=path), whole)
    content, ends = path.read_bytes(), [end for _, end in entries_of(path)]
    assert len(ends) == 9 * 4  # 64 pixels, 16 samples at a time
    numbers = after_tiles()
    for number in (2, 8, 13, 29):
        path.write_bytes(content[: ends[number]])
        numbers.clear()
        assert_same(render(samples=50, checkpoint=path, threads=2), whole)
        assert len(numbers) == 35 - number


CHANGES = {
    "more samples": ({"samples": 16}, {"samples": 24}, 9),
    "more independent samples": ({"samples": 16, "sampler": pl.rendering.Sampler.RANDOM}, {"samples": 24}, 9),
    "from a number of samples that others cannot follow": ({"samples": 17}, {"samples": 24}, 9),
    "fewer samples, where no step ends": ({"samples": 24}, {"samples": 16}, 9),
    "one sample of one replicate": ({"samples": 3, "replicates": 1}, {"samples": 5}, 9),
    "a smaller error": ({"target_error": 0.06}, {"target_error": 0.03}, None),
    "a larger error": ({"target_error": 0.03}, {"target_error": 0.06}, None),
    "an error after samples": ({"samples": 32}, {"target_error": 0.06}, None),
    "samples after an error": ({"target_error": 0.06}, {"samples": 64}, 9),
}


def test_other_samples_and_errors_go_on_from_what_is_there(tmp_path, after_tiles):
    numbers = after_tiles()
    for what, (before, budget, rendered) in CHANGES.items():
        budget, path = {**before, "samples": None, "target_error": None, **budget}, tmp_path / what
        numbers.clear()
        render(checkpoint=path, **before)
        stored = set(numbers)
        numbers.clear()
        fresh = render(**budget)
        needed = set(numbers)
        numbers.clear()
        assert_same(render(checkpoint=path, **budget), fresh)
        assert not stored & set(numbers), what
        if rendered is None:  # fewer than without the file
            assert 0 < len(numbers) < len(needed), what
        else:
            assert len(numbers) == rendered, what
        numbers.clear()
        assert_same(render(checkpoint=path, **budget), fresh)
        assert not numbers, what
    # A file has the tiles of its first render.
    path = tmp_path / "state"
    render(samples=8, checkpoint=path, tile_side=12)
    numbers.clear()
    shot = render(samples=16, checkpoint=path, tile_side=None)
    assert {(tile.rows, tile.columns) for tile, *_ in numbers} == {(12, 12)} and {n[1:] for n in numbers} == {(8, 8)}
    assert_same(shot, render(samples=16, tile_side=12))


def raising(error):
    def fail(*_, **__):
        raise error

    return fail


def test_a_damaged_record_is_rendered_again(tmp_path, after_tiles):
    path, whole = tmp_path / "state", unbroken("target")
    render(checkpoint=path, **BUDGETS["target"])
    content, ends = bytearray(path.read_bytes()), [end for _, end in entries_of(path)]
    numbers = after_tiles()
    for place, said in ((ends[3] - 9, "a record of .* is damaged"), (ends[3] + 20, r"bytes of .* are damaged")):
        changed = content.copy()
        changed[place] ^= 4
        path.write_bytes(changed)
        numbers.clear()
        with pytest.warns(pl.errors.FileWarning, match=said + ".*rendered again"):
            assert_same(render(checkpoint=path, threads=2, **BUDGETS["target"]), whole)
        assert len(numbers) == 1


def test_what_cannot_be_written_is_rendered_all_the_same(tmp_path, monkeypatch):
    path, append, calls = tmp_path / "state", RecordLog.append, []

    def failing(log, *record):
        calls.append(0)
        if len(calls) % 3:
            raise pl.errors.FileError("no room")
        return append(log, *record)

    with monkeypatch.context() as full:
        full.setattr(RecordLog, "append", failing)
        with pytest.warns(pl.errors.FileWarning, match="the checkpoint has not been written: no room"):
            assert_same(render(checkpoint=path, **BUDGETS["target"]), unbroken("target"))
    assert len(entries_of(path)) == len(calls) // 3
    assert_same(render(checkpoint=path, **BUDGETS["target"]), unbroken("target"))


def test_two_renders_may_use_one_file_at_a_time(tmp_path, after_tiles):
    path, inner = tmp_path / "state", []
    render(samples=2, checkpoint=path)

    def other(number):
        if number == 4:
            inner.append(render(checkpoint=path, **BUDGETS["target"]))

    numbers = after_tiles(other)
    assert_same(render(checkpoint=path, **BUDGETS["target"]), unbroken("target"))
    assert_same(inner[0], unbroken("target"))
    numbers.clear()
    assert_same(render(checkpoint=path, **BUDGETS["target"]), unbroken("target"))
    assert not numbers


def test_interrupted_renderings_go_on_to_the_same_bits(tmp_path, after_tiles):
    path, moments = tmp_path / "state", (3, 8, 12, 17)
    numbers = after_tiles(lambda number: signal.raise_signal(signal.SIGINT) if number in moments else None)
    shots = []
    while not shots or shots[-1].interrupted:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", pl.errors.BudgetWarning)
            shots.append(render(checkpoint=path, **BUDGETS["target"]))
    assert len(shots) == 1 + len(moments)
    assert len(numbers) <= len({*numbers}) + len(moments)  # what is at work is given up
    assert {shot.stats.stopped_by for shot in shots[:-1]} == {pl.rendering.StopReason.INTERRUPTED}
    # What is returned is what there is.
    first, whole = shots[0].image, unbroken("target")
    assert np.any(first) and np.count_nonzero(first) < np.count_nonzero(whole.image)
    assert_same(shots[-1], whole)
    assert [shot.stats.seconds for shot in shots] == sorted(shot.stats.seconds for shot in shots)


def test_a_first_pass_goes_over_all_tiles_and_leaves_the_bits(tmp_path, after_tiles, monkeypatch):
    whole = render(samples=48)
    monkeypatch.setattr(budgets, "_PASSES", 48)
    numbers = after_tiles()
    assert_same(render(samples=48), whole)
    assert [n[1:] for n in numbers] == 9 * [(0, 2)] + 9 * [(2, 46)]
    numbers.clear()
    numbers = after_tiles(lambda number: signal.raise_signal(signal.SIGINT) if number == 10 else None)
    with pytest.warns(pl.errors.BudgetWarning, match="interrupted"):
        shot = render(samples=48, checkpoint=tmp_path / "state")
    assert shot.interrupted and set(np.unique(shot.sample_counts)) == {2, 48}
    assert_same(render(samples=48, checkpoint=tmp_path / "state"), whole)


def test_an_interrupted_rendering_with_a_time_limit_gets_further_each_time(tmp_path):
    first, second = (render(time_limit=limit, checkpoint=tmp_path / "state") for limit in (0.2, 0.6))
    assert second.stats.paths > first.stats.paths and second.stats.stopped_by is pl.rendering.StopReason.TIME_LIMIT
    assert second.stats.seconds > first.stats.seconds


def test_it_is_put_on_the_disk_at_the_interval_and_at_the_end(tmp_path, monkeypatch):
    path, flushed = tmp_path / "state", []
    render(samples=2, checkpoint=path)
    begun = path.read_bytes()
    monkeypatch.setattr(RecordLog, "flush", lambda log: flushed.append(len(entries_of(path))))
    for interval, expected in ((1e9, [18]), (1e-9, [*[9] * 9, *range(10, 19), 18])):  # records are in the file before
        path.write_bytes(begun)
        flushed.clear()
        render(samples=8, checkpoint=path, checkpoint_interval=interval)
        assert flushed == expected

    monkeypatch.setattr(RecordLog, "flush", raising(pl.errors.FileError(os.strerror(errno.EIO))))
    with pytest.warns(pl.errors.FileWarning, match="the checkpoint has not been written"):
        render(samples=8, checkpoint=path)


OTHERS = (
    ({"seed": 1}, "seed 0, not 1"),
    ({"replicates": 4}, "replicates 2, not 4"),
    ({"sampler": pl.rendering.Sampler.RANDOM}, "sampler SOBOL, not RANDOM"),
    ({"max_bounces": 2}, "max_bounces 8, not 2"),
    ({"clamp": 0.5}, "clamp None, not 0.5"),
    ({"caustics": pl.rendering.Caustics.EXCLUDE}, "caustics INCLUDE, not EXCLUDE"),
    ({"truth": pl.Truth.NONE}, "truth"),
    ({"region": np.s_[240:264, 239:263]}, r"region .240, 264, 240, 264., not .240, 264, 232, 264."),
    ({"scene": board(2.0)}, "another scene"),
    ({"camera": dataclasses.replace(CAMERA, lens=CAMERA.lens.with_stop(pl.CircularStop(4.0)))}, "another camera.lens"),
    ({"camera": dataclasses.replace(CAMERA, microlenses_to_sensor=1.75)}, "camera.microlenses_to_sensor 1.7, not 1.75"),
)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The file of a render with 8 samples."""
    path = tmp_path_factory.mktemp("finished") / "state"
    render(samples=8, checkpoint=path)
    return path.read_bytes()


def test_checkpoints_that_cannot_be_used_are_refused_before_anything_is_rendered(tmp_path, finished, monkeypatch):
    monkeypatch.setattr(tile_jobs, "render_tile", raising(AssertionError("a tile has been rendered")))
    path = tmp_path / "state"
    for content, message, arguments in (
        *((finished, f"belongs to another render, with .*{message}", arguments) for arguments, message in OTHERS),
        (finished[:50], "damaged checkpoint", {}),
        (b"", "empty file", {}),
        (b"my diary", "is not a checkpoint; give checkpoint= another path, or remove the file", {}),
    ):
        path.write_bytes(content)
        with pytest.raises(pl.errors.FileError, match=message):
            render(checkpoint=path, **{"samples": 8, **arguments})
        assert path.read_bytes() == content and os.listdir(tmp_path) == ["state"], message
    path.unlink()
    for place, message in ((tmp_path / "none" / "state", "does not exist; make it first"), (tmp_path, "is a folder")):
        with pytest.raises(pl.errors.FileError, match=message):
            render(samples=8, checkpoint=place)
    assert not os.listdir(tmp_path)


@pytest.fixture
def files(monkeypatch):
    """Open checkpoint files."""
    opened, begin = [], RecordLog.__init__

    def listening(log, *given):
        begin(log, *given)
        opened.append(log._file)

    monkeypatch.setattr(RecordLog, "__init__", listening)
    return opened


def test_the_file_is_closed_on_every_way_out(tmp_path, finished, files, monkeypatch):
    path = tmp_path / "state"
    places = [f"rendering.schedule.scheduler.{name}" for name in ("cut_into_tiles", "drive", "exposure_of")]
    places.append("camera.conditioning.camera_conditioning")
    for existing, place, error in itertools.product(
        (True, False), places, (KeyboardInterrupt("now"), pl.errors.InvalidValueError("now"))
    ):
        path.unlink(missing_ok=True)
        if existing:
            path.write_bytes(finished)
        files.clear()
        with monkeypatch.context() as failing, pytest.raises(type(error), match="now"):
            failing.setattr(f"plenoptic.{place}", raising(error))
            render(samples=8, conditioning=4, checkpoint=path)
        assert all(file.closed for file in files) and (files or not existing), (existing, place)
    files.clear()
    render(samples=8, checkpoint=path)
    path.write_bytes(finished)
    with pytest.raises(pl.errors.FileError, match="belongs to another render"):
        render(samples=8, seed=1, checkpoint=path)
    path.write_bytes(finished + b"rest")
    with warnings.catch_warnings(), pytest.raises(pl.errors.FileWarning, match="4 bytes of"):
        warnings.simplefilter("error", pl.errors.FileWarning)
        render(samples=8, checkpoint=path)
    assert len(files) == 3 and all(file.closed for file in files)


KILLS = 3  # of each of two renderings
LONG = {"samples": {"samples": 2048}, "target": {"target_error": 0.008}}

RENDERING = """
import pickle, sys
import plenoptic as pl
scene, camera, arguments = pickle.load(sys.stdin.buffer)
shot = pl.render(scene, camera, checkpoint=sys.argv[1], checkpoint_interval=0.05, progress=False, **arguments)
sys.stdout.buffer.write(pickle.dumps({name: getattr(shot, name) for name in sys.argv[2:]}))
sys.stdout.flush()
"""


def start(path, arguments):
    """Process that renders with a checkpoint, and the file of its output: it must not wait for a reader."""
    out = tempfile.TemporaryFile()  # noqa: SIM115
    command = [sys.executable, "-c", RENDERING, str(path), *BITS, "stats", "samples", "replicates", "seed"]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=out, start_new_session=True)
    process.stdin.write(pickle.dumps((board(), CAMERA, arguments)))
    process.stdin.close()
    return process, out


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
@pytest.mark.parametrize(("budget", "threads"), [("samples", 2), ("target", 1)])
def test_a_rendering_that_is_killed_again_and_again_gives_the_same_bits(tmp_path, budget, threads):
    arguments = {"region": np.s_[224:320, 224:320], "tile_side": 16, "threads": threads, **LONG[budget]}
    path, moments, hit, paths = tmp_path / "state", random.Random(f"{budget}{threads}"), 0, []

    def size():
        return path.stat().st_size if path.exists() else None

    while hit < KILLS:
        begun = size()
        process, out = start(path, arguments)
        while size() == begun:  # the file grows while it renders
            assert process.poll() is None, f"it ended after {hit} kills"
            time.sleep(0.002)
        time.sleep(moments.uniform(0.0, 0.2))
        process.kill()
        hit += process.wait() == -signal.SIGKILL and os.fstat(out.fileno()).st_size == 0  # it was still at work
        # Whatever it was doing: the file is not behind what it was.
        paths.append(sum(facts["paths"] for facts, _ in entries_of(path)))
        assert len(os.listdir(tmp_path)) <= 2 and paths == sorted(paths)
    assert paths[0] < paths[-1]
    process, out = start(path, arguments)
    assert process.wait(timeout=300) == 0
    out.seek(0)
    loaded = types.SimpleNamespace(**pickle.load(out))
    assert paths[-1] < loaded.stats.paths, "it was finished before it was killed the last time"
    assert os.listdir(tmp_path) == ["state"]
    assert_same(loaded, pl.render(board(), CAMERA, progress=False, **arguments))


def test_a_checkpoint_of_another_kind_of_processor_goes_on_with_a_warning(tmp_path, monkeypatch):
    # Bits depend on instructions: a cluster of several kinds mixed them without a word.
    path, processors = tmp_path / "shot.part", render(samples=4).stats.processors
    assert len(processors) == 1
    with monkeypatch.context() as elsewhere:
        elsewhere.setattr("plenoptic.core.numba.jit.processor", lambda: "another kind")
        assert render(samples=4, checkpoint=path).stats.processors == ("another kind",)
    with pytest.warns(pl.errors.PlenopticWarning, match="begun on another kind of processor, another kind; this is "):
        shot = render(samples=4, checkpoint=path)
    assert shot.stats.processors == ("another kind", *processors)
    shot.save(tmp_path / "shot.exr")
    assert pl.Exposure.load(tmp_path / "shot.exr").stats.processors == shot.stats.processors
