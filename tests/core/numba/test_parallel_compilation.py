"""Kernels compiled by helpers, each time in processes of their own, with kernels of one line."""

import os
import shutil
import signal
import subprocess
import sys
import time

import pytest

KERNELS = """
from plenoptic.core.numba.jit import device, kernel

@device
def twice(x):
    return 2.0 * x
""" + "".join(
    f"""
@kernel
def fill_{k}(x, out):
    for i in range(x.size):
        out[i] = twice(x[i]) + {k}
"""
    for k in range(4)
)
USE = """
import os, sys, time
import numpy as np
import some_kernels
from plenoptic.core.numba import parallel_compilation as module

kernels = [getattr(some_kernels, f"fill_{k}") for k in range(4)]

def run(n=0):
    out = np.empty(n)
    for kernel in kernels:
        kernel(np.arange(float(n)), out)
    return out

EXECUTABLE
with module.compile_in_parallel(run, threads=2):
    end = time.monotonic() + 60.0
    while WAIT and (module._tasks.waiting or module._tasks.begun) and time.monotonic() < end:
        time.sleep(0.01)
    assert run(3).tolist() == [3.0, 5.0, 7.0]
assert not module._tasks.waiting
print(sum(sum(kernel.stats.cache_hits.values()) for kernel in kernels))
"""

WATCHED = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
helpers, start_helper = [], module._start_helper
module._start_helper = lambda: helpers.append(start_helper()) or helpers[-1]
"""


@pytest.fixture
def hits(tmp_path):
    """Run USE in a new process with an empty cache; returns how many kernels it found in the cache."""
    (tmp_path / "some_kernels.py").write_text(KERNELS)

    def use(executable="", *, wait=True):
        paths = [str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])]
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": os.pathsep.join(paths)}
        code = USE.replace("EXECUTABLE", executable).replace("WAIT", str(wait))
        process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
        assert process.returncode == 0, process.stderr
        return int(process.stdout)

    return use


def test_helpers_compile_what_a_run_without_data_calls(hits):
    assert hits() == 4
    assert hits() == 4  # from the cache, without helpers


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="needs a script that can be executed")
def test_without_helpers_or_with_dead_ones_this_process_compiles(hits, tmp_path):
    script = tmp_path / "python-that-dies"
    script.write_text("#!/bin/sh\nexit 1\n")
    script.chmod(0o755)
    for program in (None, "/no/such/python", "some-other-program", str(script)):
        shutil.rmtree(tmp_path / "cache", ignore_errors=True)
        assert hits(f"sys.executable = {program!r}", wait=False) == 0, program


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="asks ps")
@pytest.mark.parametrize("name", ["SIGINT", "SIGKILL"])
def test_no_helper_outlives_its_parent(tmp_path, name):
    (tmp_path / "some_kernels.py").write_text(KERNELS)
    code = USE.replace("EXECUTABLE", WATCHED).replace("WAIT", "(print(helpers[0].pid, flush=True) or True)")
    paths = [str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": os.pathsep.join(paths)}
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as parent:
        helper = parent.stdout.readline().strip()
        parent.send_signal(getattr(signal, name))
        parent.communicate()
    end = time.monotonic() + 60.0
    while state(helper) not in ("", "Z") and time.monotonic() < end:
        time.sleep(0.05)
    assert state(helper) in ("", "Z")


def state(process):
    """First letter of the state of a process in the output of ps; empty if it has ended."""
    return subprocess.run(["ps", "-o", "stat=", "-p", process], capture_output=True, text=True).stdout.strip()[:1]


def test_called_from_python_a_device_function_runs_as_python(hits, tmp_path):
    # There is no wrapper that could be called: before and after a kernel has been compiled with it.
    assert hits("assert some_kernels.twice(1.5) == 3.0; run(1); assert some_kernels.twice(1.5) == 3.0") == 0


@pytest.mark.slow
def test_what_is_listed_is_what_a_render_calls():
    code = """
import numpy as np, plenoptic as pl
from plenoptic.core.numba import kernel_cache, parallel_compilation as module

kernel_cache.KernelCache.lacks = lambda *_: True  # all kernels are listed, none is given to helpers
listed, list_tasks = [], module._list_tasks
module._list_tasks = lambda run: listed.extend(list_tasks(run)) or []
lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=5.0))
camera = pl.PlenopticCamera(lens=lens, microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    sensor=pl.Sensor(shape=(16, 16), pixel_pitch=0.01), stop_to_microlenses=123.3, microlenses_to_sensor=1.7)
pl.render(pl.still_life(), camera, samples=8, threads=2, progress=False)
print(len(listed), [kernel.__name__ for kernel, types in listed if types not in kernel.overloads])
"""
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert process.returncode == 0, process.stderr
    count, unused = process.stdout.split(" ", 1)
    assert int(count) >= 15
    assert unused.strip() == "[]"
