"""A render that ends before its time goes on from its checkpoint, and gives the bits of one that never ended."""

import dataclasses
import functools
import json
import os
import pickle
import random
import signal
import subprocess
import sys
import tempfile
import time

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.camera.record import camera_record
from plenoptic.rendering.schedule import checkpoint as checkpoints
from plenoptic.rendering.schedule import scheduler
from plenoptic.study.cameras import reference_camera


@pytest.fixture(autouse=True)
def ctrl_c_is_heard():
    """Programs that a shell starts in the background ignore SIGINT."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


EVERY = 1e-9
"""Seconds between two savings: one after each tile."""
BITS = ("image", "standard_error", "depth", "sample_counts")
COUNTS = ("paths", "paths_through_lens", "lost", "nonfinite", "nonfinite_paths", "zero_variance", "stopped_by")


@functools.cache
def board(radiance=1.0):
    """The middle of the reference scene `check`."""
    even, odd = pl.checkerboard((40, 40), 1.0, even=pl.Emissive(radiance), odd=pl.Emissive(0.0), offset=(-0.05, 0.1))
    return pl.Scene([even.translated(z=-404), odd.translated(z=-404)])


@pytest.fixture
def quick(monkeypatch):
    """The same camera over and over needs its tables once, and no disk has to be waited for."""
    monkeypatch.setattr("plenoptic.camera.cache.camera_record", functools.cache(camera_record))
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)


def render(scene=None, camera=None, **arguments):
    """Nine tiles."""
    given = {"region": np.s_[240:264, 240:264], "tile_side": 8, "threads": 1, "progress": False, **arguments}
    return pl.render(scene or board(), camera or reference_camera(), **given)


def assert_same(one, other):
    for name in BITS:
        a, b = getattr(one, name), getattr(other, name)
        assert (a is None) == (b is None), name
        assert a is None or (a.dtype == b.dtype and a.tobytes() == b.tobytes()), f"bits of {name}"
    assert (one.samples, one.replicates, one.seed) == (other.samples, other.replicates, other.seed)
    for name in COUNTS:
        assert getattr(one.stats, name) == getattr(other.stats, name), name


@pytest.fixture
def after_saving(monkeypatch):
    """Calls a function with the number of a save and the path, whenever a checkpoint has been saved."""

    def listen(function):
        save, numbers = checkpoints.save_checkpoint, iter(range(1 << 30))

        def watched(path, *state):
            save(path, *state)
            function(next(numbers), path)

        monkeypatch.setattr(checkpoints, "save_checkpoint", watched)

    return listen


@pytest.fixture
def rendering_nothing(monkeypatch):
    """From the call on, to render a tile is an error."""

    def refuse(*_, **__):
        raise AssertionError("a tile has been rendered")

    return lambda: monkeypatch.setattr(scheduler, "render_tile", refuse)


BUDGETS = {
    "samples": {"samples": 24},
    "independent samples": {"samples": 17, "sampler": pl.rendering.Sampler.RANDOM},
    "one replicate": {"samples": 5, "replicates": 1},
    "target": {"target_error": 0.03},
    "target and samples": {"target_error": 0.03, "samples": 60, "truth": pl.Truth.NONE},
}


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("budget", BUDGETS)
def test_every_state_that_was_saved_leads_to_the_same_bits(tmp_path, after_saving, budget):
    path, states = tmp_path / "state", []
    unbroken = render(**BUDGETS[budget])
    after_saving(lambda _, path: states.append(path.read_bytes()))
    assert_same(render(checkpoint=path, checkpoint_interval=EVERY, **BUDGETS[budget]), unbroken)
    assert len(states) >= 10  # at the beginning and after each of nine tiles
    # All of the first round, after which tiles are decided upon for the first time, and some of the others.
    chosen = sorted({*range(12), *range(12, len(states), max(1, len(states) // 8)), len(states) - 1} - {len(states)})
    for number in chosen[:-1] if len(states) == 10 else chosen:
        path.write_bytes(states[number])
        assert_same(render(checkpoint=path, threads=1 + number % 2, **BUDGETS[budget]), unbroken)


@pytest.mark.usefixtures("quick")
def test_batches_of_a_tile_go_on_too(tmp_path, after_saving, monkeypatch):
    # A tile with more paths than a batch may have is rendered in several.
    monkeypatch.setattr("plenoptic.rendering.schedule.clock.PATHS_PER_BATCH", 1024)
    path, states = tmp_path / "state", []
    unbroken = render(samples=50)
    after_saving(lambda _, path: states.append(path.read_bytes()))
    assert_same(render(samples=50, checkpoint=path, checkpoint_interval=EVERY), unbroken)
    assert len(states) == 1 + 9 * 4  # 64 pixels, 16 samples at a time
    for number in (3, 9, 14, 30):
        path.write_bytes(states[number])
        assert_same(render(samples=50, checkpoint=path, threads=2), unbroken)


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(("budget", "moments"), [("samples", (3, 8)), ("target", (3, 8, 12, 17))])
def test_interrupted_renderings_go_on_to_the_same_bits(tmp_path, after_saving, budget, moments):
    path, unbroken = tmp_path / "state", render(**BUDGETS[budget])

    def interrupt(number, _):
        if number in moments:
            signal.raise_signal(signal.SIGINT)

    after_saving(interrupt)
    shots = [render(checkpoint=path, checkpoint_interval=EVERY, threads=2, **BUDGETS[budget])]
    while shots[-1].interrupted:
        assert shots[-1].stats.stopped_by is pl.rendering.StopReason.INTERRUPTED
        shots.append(render(checkpoint=path, checkpoint_interval=EVERY, threads=2, **BUDGETS[budget]))
    assert len(shots) == 1 + len(moments)
    # What is returned is what there is.
    first = shots[0].image
    assert np.any(first) and np.count_nonzero(first) < np.count_nonzero(unbroken.image)
    assert_same(shots[-1], unbroken)


@pytest.mark.usefixtures("quick")
def test_white_images_go_on_to_the_same_bits(tmp_path, after_saving):
    arguments = {"samples": 16, "region": np.s_[240:264, 240:264], "tile_side": 8, "progress": False}
    unbroken, path = pl.render_white(reference_camera(), **arguments), tmp_path / "state"
    after_saving(lambda number, _: signal.raise_signal(signal.SIGINT) if number == 4 else None)
    broken = pl.render_white(reference_camera(), checkpoint=path, checkpoint_interval=EVERY, **arguments)
    assert broken.interrupted
    assert_same(pl.render_white(reference_camera(), checkpoint=path, **arguments), unbroken)


@pytest.mark.usefixtures("quick")
def test_an_interrupted_rendering_with_a_time_limit_gets_further_each_time(tmp_path):
    path = tmp_path / "state"
    first, second = (render(time_limit=limit, checkpoint=path) for limit in (0.3, 1.0))
    assert second.stats.paths > first.stats.paths and second.stats.stopped_by is pl.rendering.StopReason.TIME_LIMIT
    assert second.stats.seconds > first.stats.seconds


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("budget", ["samples", "target"])
def test_what_is_finished_is_returned_without_rendering(tmp_path, rendering_nothing, budget):
    path = tmp_path / "state"
    first = render(checkpoint=path, **BUDGETS[budget])
    rendering_nothing()
    assert_same(render(checkpoint=path, **BUDGETS[budget]), first)


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(("interval", "saves"), [(1e9, 2), (EVERY, 10)])
def test_it_is_saved_at_the_interval_and_at_both_ends(tmp_path, after_saving, interval, saves):
    seen = []
    after_saving(lambda number, _: seen.append(number))
    render(samples=8, checkpoint=tmp_path / "state", checkpoint_interval=interval)
    assert len(seen) == saves


OTHERS = {
    "seed": ({"seed": 1}, "seed 0, not 1"),
    "samples": ({"samples": 9}, "samples 8, not 9"),
    "no samples": ({"samples": None, "target_error": 0.1}, "samples 8, not None"),
    "target": ({"target_error": 0.1}, "target_error None, not 0.1"),
    "replicates": ({"replicates": 4}, "replicates 2, not 4"),
    "sampler": ({"sampler": pl.rendering.Sampler.RANDOM}, "sampler SOBOL, not RANDOM"),
    "bounces": ({"max_bounces": 2}, "max_bounces 8, not 2"),
    "clamp": ({"clamp": 0.5}, "clamp None, not 0.5"),
    "caustics": ({"caustics": pl.rendering.Caustics.LEFT_OUT}, "caustics KEPT, not LEFT_OUT"),
    "truth": ({"truth": pl.Truth.NONE}, "truth"),
    "region": ({"region": np.s_[240:264, 239:263]}, r"region .240, 264, 240, 264., not .240, 264, 232, 264."),
    "scene": ({"scene": board(2.0)}, "another scene"),
    "lens": ({"camera": "lens"}, "another camera.lens"),
    "gap": ({"camera": "gap"}, "camera.microlenses_to_sensor 1.7, not 1.75"),
}


def other_camera(which):
    camera = reference_camera()
    if which == "gap":
        return dataclasses.replace(camera, microlenses_to_sensor=1.75)
    return dataclasses.replace(camera, lens=camera.lens.with_stop(pl.CircularStop(semi_diameter=4.0)))


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The file of a render with 8 samples."""
    path = tmp_path_factory.mktemp("finished") / "state"
    render(samples=8, checkpoint=path)
    return path.read_bytes()


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("what", OTHERS)
def test_checkpoints_of_another_rendering_are_refused_before_anything_is_rendered(
    tmp_path, finished, rendering_nothing, what
):
    arguments, message = OTHERS[what]
    arguments = {"samples": 8, **arguments}
    if "camera" in arguments:
        arguments["camera"] = other_camera(arguments["camera"])
    refuses(tmp_path / "state", finished, rendering_nothing, f"belongs to another render, with .*{message}", arguments)


def refuses(path, content, rendering_nothing, message, arguments):
    path.write_bytes(content)
    rendering_nothing()
    with pytest.raises(pl.errors.FileError, match=message):
        render(checkpoint=path, **arguments)
    assert path.read_bytes() == content and os.listdir(path.parent) == [path.name]


@pytest.mark.usefixtures("quick")
def test_damaged_and_foreign_files_are_refused_before_anything_is_rendered(tmp_path, finished, rendering_nothing):
    flipped = bytearray(finished)
    flipped[-9] ^= 4
    for content, message in (
        (bytes(flipped), "damaged checkpoint, its data have changed"),
        (finished[:-1], "damaged checkpoint"),
        (finished[:50], "damaged checkpoint"),
        (b"", "empty file"),
        (b"my diary", "is not a checkpoint"),
    ):
        refuses(tmp_path / "state", content, rendering_nothing, message, {"samples": 8})


@pytest.mark.usefixtures("quick")
def test_places_that_cannot_be_written_are_refused_before_anything_is_rendered(tmp_path, rendering_nothing):
    rendering_nothing()
    for path, message in ((tmp_path / "none" / "state", "does not exist; make it first"), (tmp_path, "is a folder")):
        with pytest.raises(pl.errors.FileError, match=message):
            render(samples=8, checkpoint=path)
    assert not os.listdir(tmp_path)


@pytest.mark.usefixtures("quick")
def test_threads_do_not_matter(tmp_path, after_saving):
    path, unbroken = tmp_path / "state", render(samples=8)
    after_saving(lambda number, _: signal.raise_signal(signal.SIGINT) if number == 4 else None)
    assert render(samples=8, checkpoint=path, checkpoint_interval=EVERY, threads=3).interrupted
    assert_same(render(samples=8, checkpoint=path, threads=1), unbroken)


# ---- killed from outside ----

KILLS = 5
"""Of each of four renderings."""
LONG = {"samples": {"samples": 4096}, "target": {"target_error": 0.008}}

RENDERING = """
import pickle, sys
import plenoptic as pl
scene, camera, arguments = pickle.load(sys.stdin.buffer)
shot = pl.render(scene, camera, checkpoint=sys.argv[1], checkpoint_interval=0.05, progress=False, **arguments)
sys.stdout.buffer.write(pickle.dumps({name: getattr(shot, name) for name in (*sys.argv[2:], "stats")}))
sys.stdout.flush()
"""


class Child:
    """A process that renders with a checkpoint."""

    def __init__(self, path, arguments):
        command = [sys.executable, "-c", RENDERING, str(path), *BITS]
        self._path = path
        # Files, not pipes: a child that has finished must not wait for somebody to read.
        self._out, self._errors = tempfile.TemporaryFile(), tempfile.TemporaryFile()  # noqa: SIM115
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=self._out, stderr=self._errors, start_new_session=True
        )
        self._process.stdin.write(pickle.dumps((board(), reference_camera(), arguments)))
        self._process.stdin.close()
        self._process.stdin = None

    def wait_for_progress(self):
        """Wait until it has saved, which it does while it renders; False if it ends before."""
        begun = self._saved()
        while self._saved() == begun:
            if self._process.poll() is not None:
                return False
            time.sleep(0.002)
        return True

    def _saved(self):
        return self._path.stat().st_ino if self._path.exists() else None

    def kill(self):
        """Whether it was still at work."""
        self._process.kill()
        return self._process.wait() == -signal.SIGKILL and not contents(self._out)

    def result(self):
        assert self._process.wait(timeout=300) == 0, contents(self._errors).decode()
        return pickle.loads(contents(self._out))


def contents(file):
    file.seek(0)
    return file.read()


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("budget", LONG)
def test_a_rendering_that_is_killed_again_and_again_gives_the_same_bits(tmp_path, budget, threads):
    arguments = {"region": np.s_[224:320, 224:320], "tile_side": 16, "threads": threads, **LONG[budget]}
    path, moments, hit = tmp_path / "state", random.Random(f"{budget}{threads}"), 0
    paths = []
    while hit < KILLS:
        child = Child(path, arguments)
        assert child.wait_for_progress(), f"it ended after {hit} kills: {child.result()['stats']}"
        time.sleep(moments.uniform(0.0, 0.2))
        hit += child.kill()
        # Whatever it was doing: the file is whole, and not behind what it was.
        paths.append(paths_in(path))
        assert len(os.listdir(tmp_path)) <= 2 and paths == sorted(paths)
    assert paths[0] < paths[-1]
    found = Child(path, arguments).result()
    assert paths[-1] < found["stats"].paths, "it was finished before it was killed the last time"
    assert os.listdir(tmp_path) == ["state"]
    unbroken = pl.render(board(), reference_camera(), progress=False, **arguments)
    for name in BITS:
        one, other = found[name], getattr(unbroken, name)
        assert (one is None) == (other is None), name
        assert one is None or one.tobytes() == other.tobytes(), f"bits of {name}"
    for name in COUNTS:
        assert getattr(found["stats"], name) == getattr(unbroken.stats, name), name


def paths_in(path):
    """Paths in a checkpoint, which must be whole."""
    header = json.loads(path.read_bytes().split(b"\n", 3)[2])
    _, facts = checkpoints.load_checkpoint(path, header["identity"])
    return facts["paths"]


def test_a_checkpoint_of_another_kind_of_processor_goes_on_with_a_warning(tmp_path, monkeypatch):
    # Bits depend on instructions: a cluster of several kinds mixed them without a word.
    path, here = tmp_path / "shot.part", render(samples=4).stats.processors
    assert len(here) == 1
    with monkeypatch.context() as elsewhere:
        elsewhere.setattr("plenoptic.core.jit.processor", lambda: "another kind")
        assert render(samples=4, checkpoint=path).stats.processors == ("another kind",)
    with pytest.warns(pl.errors.PlenopticWarning, match="begun on another kind of processor, another kind; this is "):
        shot = render(samples=4, checkpoint=path)
    assert shot.stats.processors == ("another kind", *here)
    shot.save(tmp_path / "shot.exr")
    assert pl.Exposure.load(tmp_path / "shot.exr").stats.processors == shot.stats.processors
