"""Progress bars of long calls, Ctrl-C during compilation, and threads."""

import os
import re
import signal
import subprocess
import sys
import threading
import time

import pytest

from plenoptic.core.parallel import MAX_THREADS, Cancelled, check_cancellation, run_in_order, thread_count
from plenoptic.core.progress import bar
from plenoptic.core.progress import compiling as module
from plenoptic.core.progress.bar import CallProgress, Poller, current_progress
from plenoptic.core.progress.compiling import ENDING, Compiling, compiling, compiling_text
from plenoptic.core.progress.deferring import defer_interrupts
from plenoptic.errors import InvalidValueError


@pytest.fixture(autouse=True)
def ctrl_c_is_heard():
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def quick(monkeypatch):
    """Everything ten times as soon, in a terminal."""
    monkeypatch.setattr(bar, "terminal_size", lambda: os.terminal_size((80, 24)))
    monkeypatch.setattr(bar, "DELAY", 0.1)
    monkeypatch.setattr(bar, "_INTERVAL", 0.02)


def test_what_takes_long_shows_how_far_it_is_and_vanishes(capsys, quick):
    with CallProgress("waiting", kind="camera", show=True):
        list(run_in_order(time.sleep, [0.05] * 8, threads=1))
        for _ in range(20):  # short steps do not move the bar back
            list(run_in_order(time.sleep, [0.01, 0.0], threads=1))
    output = capsys.readouterr().err
    *before, after = re.findall(r"(\d+)%", output)
    assert after == "100" and sorted(before, key=int) == before
    assert "waiting: " in output and "50%" in output and output.endswith("\r")


def test_compiling_is_told_by_a_thread_of_its_own(capsys, quick):
    def work(seconds):
        with compiling.track("some_kernel"):
            time.sleep(seconds)

    for threads in (1, 2):
        with CallProgress("waiting", kind="camera", show=True):
            list(run_in_order(work, [0.4], threads=threads))
        assert "compiling, first time for this kind of camera" in capsys.readouterr().err, threads
        assert compiling.since() is None, threads


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs a terminal")
def test_a_terminal_that_does_not_know_its_size_shows_a_bar():
    script = "from plenoptic.core.progress import bar; bar.DELAY = bar._INTERVAL = -1.0\n"
    script += "with bar.CallProgress('waiting', kind='camera', show=True) as shown: shown.step(1, 2)"
    reader, terminal = os.openpty()  # 0 x 0
    subprocess.run([sys.executable, "-c", script], stderr=terminal, check=True)
    os.close(terminal)
    assert b"waiting: " in os.read(reader, 1000)
    os.close(reader)


def test_nothing_is_shown_where_it_is_not_wanted(capsys, quick):
    def elsewhere():
        with CallProgress("elsewhere", kind="camera", show=True):
            list(run_in_order(time.sleep, [0.05] * 4, threads=1))

    with CallProgress("waiting", kind="camera", show=False):
        list(run_in_order(time.sleep, [0.05] * 4, threads=1))
        with CallProgress("inside", kind="camera", show=True):  # the outermost decides
            list(run_in_order(time.sleep, [0.05] * 4, threads=1))
    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert capsys.readouterr().err == "" and current_progress() is None


def test_files_get_no_bar(capsys, quick, monkeypatch):
    monkeypatch.undo()
    monkeypatch.setattr(bar, "DELAY", -1.0)
    with CallProgress("waiting", kind="camera", show=True) as shown:
        shown.step(1, 2)
        shown._update()
    assert shown._bar.disable and capsys.readouterr() == ("", "")


def test_what_is_quick_shows_nothing_and_starts_no_thread(capsys):
    before = threading.active_count()
    with CallProgress("waiting", kind="camera", show=True):
        assert list(run_in_order(abs, range(-3, 0), threads=2)) == [3, 2, 1]
    with Poller(lambda: None):
        assert threading.active_count() == before
        with compiling.track(None):
            assert threading.active_count() == before + 1
    assert threading.active_count() == before and capsys.readouterr() == ("", "")


def test_what_is_left_is_told_by_the_bytes_of_code_and_the_pace(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(module.time, "perf_counter", lambda: now[0])
    monkeypatch.setattr(module, "_busy", lambda: 1.5)
    one = Compiling()
    assert one.seconds_left() is None
    one.left, one.workers = {"first": 10_000, "second": 20_000, "third": 10_000}, 2
    assert one.seconds_left() == pytest.approx(40_000 * 3.3e-4 / 2)
    with one.track("first"):
        with one.track("a device function"):
            pass
        now[0] += 1.65  # twice as fast as expected
    # Of 15 000 bytes, 5000 count as expected: (5000 p + 1.65) / 15000.
    pace = (5000 * 3.3e-4 + 1.65) / 15_000
    assert one.names == ["first"] and one.seconds_left() == pytest.approx(30_000 * pace / 2)
    with one.track("second"):
        now[0] += 10_000 * pace
        assert one.seconds_left() == pytest.approx(20_000 * pace / 2)
        now[0] += 90_000 * pace  # far beyond what was expected: it does not grow
        assert one.seconds_left() == pytest.approx(20_000 * pace / 2)


def test_the_text_is_as_exact_as_what_is_known(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(module.time, "perf_counter", lambda: now[0])
    monkeypatch.setattr(module, "_busy", lambda: 1.0)
    monkeypatch.setattr(module, "compiling", one := Compiling())
    assert compiling_text("scene", after=1.0) == ""
    with one.track("kernel"):
        assert compiling_text("scene", after=1.0) == ""
        now[0] += 2.0
        assert compiling_text("scene", after=1.0).endswith("kind of scene")
        one.left = {"others": 100_000}
        assert compiling_text("scene", after=1.0).endswith("about 25 s")
        one.left = {"others": 10_000}
        assert compiling_text("scene", after=1.0).endswith("a few seconds")
        one.left = {}
        now[0] += 20.0
        assert compiling_text("scene", after=1.0).endswith("kind of scene")
        one.interrupted = True
        assert compiling_text("scene", after=1.0) == ENDING


def test_ctrl_c_while_compiling_is_obeyed_afterwards():
    has_ended, heard = False, []
    with pytest.raises(KeyboardInterrupt), defer_interrupts():
        signal.raise_signal(signal.SIGINT)
        assert compiling.interrupted
        has_ended = True
    assert has_ended and not compiling.interrupted and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    signal.signal(signal.SIGINT, lambda *_: heard.append(1))
    with defer_interrupts():
        signal.raise_signal(signal.SIGINT)
        assert heard == [1]  # handlers of others hear it at once


def test_what_nobody_waits_for_gives_up():
    ended, begun = [], threading.Event()

    def work(task):
        if task == 0:
            return begun.wait()
        begun.set()
        while True:
            try:
                check_cancellation()
            except Cancelled:
                ended.append(task)
                raise
            time.sleep(0.01)

    results = run_in_order(work, [0, 1], threads=2)
    assert next(results)
    results.close()  # waits for the other one
    assert ended == [1]
    with pytest.raises(Cancelled):
        list(run_in_order(work, [1], threads=1, is_cancelled=lambda: True))
    check_cancellation()  # nothing is given up here


def test_numba_num_threads_is_the_most_that_is_taken_unasked(monkeypatch):
    # It was ignored: on a shared machine every process took all processors.
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)), raising=False)
    monkeypatch.delenv("NUMBA_NUM_THREADS", raising=False)
    assert thread_count(None) == 8
    for variable, threads in (("3", 3), ("64", 8), ("1", 1), ("many", 8), ("", 8)):
        monkeypatch.setenv("NUMBA_NUM_THREADS", variable)
        assert thread_count(None) == threads
    assert thread_count(5) == 5
    for variable in ("0", "-1"):
        monkeypatch.setenv("NUMBA_NUM_THREADS", variable)
        with pytest.raises(InvalidValueError, match=f"NUMBA_NUM_THREADS is {variable} in the environment; set it to 1"):
            thread_count(None)
    with pytest.raises(InvalidValueError, match=f"threads is {MAX_THREADS + 1}; it must be at most {MAX_THREADS}"):
        thread_count(MAX_THREADS + 1)


def test_results_come_in_the_order_of_their_tasks():
    assert list(run_in_order(lambda task: -task, range(100), threads=3)) == [-task for task in range(100)]


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="sends SIGINT")
@pytest.mark.parametrize("what", ["render", "project"])
def test_ctrl_c_in_a_cold_process_ends_it_soon(tmp_path, what):
    code = """
import os, signal, sys, threading, time
import plenoptic as pl
from plenoptic.core.progress.compiling import compiling
signal.signal(signal.SIGINT, signal.default_int_handler)
camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(5.0)),
    microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    sensor=pl.Sensor(shape=(48, 48), pixel_pitch=0.01), stop_to_microlenses=123.3, microlenses_to_sensor=1.7)
scene, what = pl.check_scene(), sys.argv[1]
after = {"render": "fill_cells", "project": "fill_through_lens"}[what]

def interrupt():
    while after not in (compiling._current or ("",)):
        time.sleep(0.001)
    time.sleep(0.05)
    os.kill(os.getpid(), signal.SIGINT)

threading.Thread(target=interrupt, daemon=True).start()
calls = {"render": lambda samples: pl.render(scene, camera, samples=samples).interrupted,
         "project": lambda _: camera.project((0, 0, -404)) is None}
try:
    print(calls[what](4096))
except KeyboardInterrupt:
    print("KeyboardInterrupt")
print(len(compiling.names))
print(calls["project"](2))
"""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    process = subprocess.run([sys.executable, "-c", code, what], capture_output=True, text=True, env=environment)
    assert process.returncode == 0, process.stderr
    said, compiled, later = process.stdout.split()
    assert said == ("True" if what == "render" else "KeyboardInterrupt")
    assert int(compiled) <= 6 and later == "False"
