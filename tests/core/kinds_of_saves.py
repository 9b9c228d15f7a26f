"""A small and a large file that the package writes, and what is left where writing ends early.

    python tests/core/kinds_of_saves.py FOLDER TIMES END[,END ...]

An end is SIGKILL or SIGINT, which are to meet TIMES saves, or `limit`, which allows few bytes a file. For each kind two
different files take turns. Whatever happens, the one that is there is one of the two to the last byte, at most one
temporary file is beside it after a signal, none after an error, and none after the next save.
"""

import os
import random
import re
import resource
import signal
import sys
import time
import traceback
from pathlib import Path

import numpy as np
import OpenImageIO  # noqa: F401  An interrupt while it is loaded aborts the process.

import plenoptic as pl
from plenoptic.core.files.serialization import describe
from plenoptic.errors import FileError

describe(pl.SensorModel(photon_rate=1.0))  # Looks for its name everywhere: each child would import all of that.
LENS = pl.load_lens("double-gauss-100mm-f2")
SEED = 7
DATE = re.compile(rb"\d{4}:\d\d:\d\d \d\d:\d\d:\d\d")
"""What image files say about when they were written."""
MOST = 200
"""Signals sent for each that is to meet a save: some come between two of them."""


def lens(path, n):
    pl.save_lens(LENS.with_stop(pl.CircularStop(semi_diameter=5.0 + n)), path)


def shot(path, n):
    noise = np.random.default_rng(n).random((2, 96, 96, 3))
    pl.Exposure(noise[0], standard_error=noise[1], samples=64, seed=n).save(path)


KINDS = {"lens.json": lens, "shot.exr": shot}


def in_child(work):
    """The number of a process that does some work until it is interrupted.

    Image libraries begin threads, which forks do not have: only children use them.
    """
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    child = os.fork()
    if child == 0:
        code = 1
        try:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
            work()
            code = 0
        except KeyboardInterrupt:
            code = 0
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(code)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    return child


def end(child, number):
    """Send a signal until the child has ended: Python drops interrupts that come while it frees objects."""
    while True:
        os.kill(child, number)
        for _ in range(1000):
            pid, status = os.waitpid(child, os.WNOHANG)
            if pid:
                return status
            time.sleep(0.003)


def done(work):
    assert os.waitpid(in_child(work), 0)[1] == 0


def content(path):
    return DATE.sub(b"", path.read_bytes())


def both(path, save):
    """Possible contents of the file, duration of a save, and size of the second content; the first one is saved."""
    contents, sizes, begin = set(), [], time.perf_counter()
    for n in (1, 0):
        done(lambda n=n: save(path, n))
        contents.add(content(path))
        sizes.append(path.stat().st_size)
    assert len(contents) == 2 and os.listdir(path.parent) == [path.name]
    return contents, (time.perf_counter() - begin) / 2, sizes[0]


def ended_by(number, times, path, save):
    """Number of signals that met a save, up to `times`, and number of signals sent."""
    contents, seconds, _ = both(path, save)

    def saving():
        while True:
            for n in (1, 0):
                save(path, n)

    n_met = sent = 0
    while n_met < times and sent < MOST * times:
        child = in_child(saving)
        time.sleep(random.uniform(0, 2 * seconds))
        status = end(child, number)
        # An interrupt may come out of a library as another error.
        assert os.WIFEXITED(status) if number == signal.SIGINT else status == number, status
        left = set(os.listdir(path.parent)) - {path.name}
        assert len(left) <= 1 and content(path) in contents, (path.name, left, path.stat().st_size)
        n_met, sent = n_met + (number == signal.SIGINT or len(left)), sent + 1
    done(lambda: save(path, 0))
    assert os.listdir(path.parent) == [path.name] and content(path) in contents
    return n_met, sent


def without_room(path, save):
    """Number of saves refused for lack of space, and number of attempts."""
    _, _, size = both(path, save)
    before = content(path)

    def refused(room):
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, -1))
        try:
            save(path, 1)
        except FileError as error:
            assert "No space left" in str(error) or "File too large" in str(error), error
        else:
            raise AssertionError(f"{path.name} has been saved where there were {room} bytes of {size}")

    rooms = (0, size // 3, max(size - 4096, 1), size - 1)
    for room in rooms:
        done(lambda room=room: refused(room))
        assert content(path) == before and os.listdir(path.parent) == [path.name]
    done(lambda: save(path, 1))
    return len(rooms), len(rooms)


if __name__ == "__main__":
    folder, times, ends = sys.argv[1:]
    random.seed(SEED)
    for how in ends.split(","):
        for kind in KINDS:
            place = Path(folder) / kind
            if how == "limit":
                print(how, kind, *without_room(place, KINDS[kind]))
            else:
                print(how, kind, *ended_by(signal.Signals[how], int(times), place, KINDS[kind]))
            place.unlink()
