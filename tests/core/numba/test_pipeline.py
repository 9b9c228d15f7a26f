"""Deviations of the compiler of kernels, and the fallback to Numba's own pipeline."""

import os
import subprocess
import sys

import numpy as np
import pytest

from plenoptic.core.numba.deviations import ALL, deviations
from plenoptic.core.numba.jit import device, kernel


def test_kernels_release_the_gil_divide_as_ieee_and_contract():
    @kernel
    def ratio(x, y):
        return x / y

    assert ratio.targetoptions["nogil"] is True
    assert ratio.targetoptions["fastmath"] == {"contract"}
    assert ratio(1.0, 0.0) == float("inf")
    assert deviations() == ALL  # the Numba of the tests is a known one


def test_a_number_that_is_written_in_a_call_makes_no_variant():
    @device
    def picked(values, i):
        return values[i]

    @device  # not from the cache
    def fill_sum(values, i):
        values[0] = picked(values, 1) + picked(values, 2) + picked(values, i)

    fill_sum.compile("(f8[::1], i8)")
    assert len(picked.signatures) == 1


def test_specialized_kernels_run_the_code_for_the_types_of_their_first_call():
    @kernel
    def first(record):
        return record[0][0] / record[1]

    for kind in (np.float32, np.int64, np.float32):
        record, by_type = (np.array([7], dtype=kind), 2), first.specialize()
        assert [by_type(record), by_type(record)] == [3.5, 3.5]
    assert len(first.signatures) == 2


def test_an_error_of_typing_is_that_of_the_kernel_and_no_reason_to_go_on_plainly():
    @device
    def add(x, y):
        return x + y

    @kernel
    def fill(x):
        x[0] = add(x, "text")

    with pytest.raises(Exception, match="No implementation of function"):
        fill(np.zeros(1))
    assert deviations() == ALL


TRACE = """
import sys, warnings
import numpy as np, plenoptic as pl
places = np.random.default_rng(0).uniform(-20.0, 20.0, (1000, 2))
rays = pl.RayBundle(np.column_stack([places, np.full(1000, -400.0)]), np.column_stack([-places / 400.0, np.ones(1000)]))
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    behind = pl.load_lens("double-gauss-100mm-f2").trace(rays)
np.save(sys.argv[1], np.hstack([behind.origin, behind.direction]))
from plenoptic.core.numba.deviations import deviations
print(len(deviations()), [str(one.message) for one in caught if "Numba" in str(one.message)])
"""
BREAKAGES = {
    "an internal is missing": "import numba.core.codegen as module\ndel module.JITCodeLibrary\n",
    "a pass is called otherwise": "from plenoptic.core.numba.library import LightLibrary\n"
    "LightLibrary._optimize_functions = lambda self: None\n",
    "numbers differ": "import plenoptic.core.kernels.probe as module\n"
    "module._TESTED, module._fill_sums = ((0, 1), (0, 2)), lambda *_: None\n",
}


@pytest.mark.slow
def test_where_numba_differs_kernels_compile_plainly_with_one_warning(tmp_path):
    def run(code=TRACE, **variables):
        name = tmp_path / f"{len(list(tmp_path.iterdir()))}.npy"
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), **variables}
        command = [sys.executable, "-c", code, str(name)]
        process = subprocess.run(command, capture_output=True, text=True, env=environment)
        assert process.returncode == 0, process.stderr
        return process.stdout.strip(), np.load(name)

    said, traced = run()
    assert said == f"{len(ALL)} []"
    plain_said, plain = run(PLENOPTIC_PLAIN_NUMBA="1")
    assert plain_said == "0 []"
    # LLVM may fuse other products and sums: some roundings of lengths of 400 mm at each of 11 surfaces.
    np.testing.assert_allclose(plain, traced, rtol=0, atol=1e-11)
    for reason, breakage in BREAKAGES.items():
        # Missing: the import of an internal fails. Otherwise: kernels fail to compile. Differ: of a newer version.
        said, broken = run(breakage + TRACE, NUMBA_CACHE_DIR=str(tmp_path / reason))
        assert said.startswith("0 [") and said.count("this version of Numba differs") == 1, (reason, said)
        assert np.array_equal(broken, plain), reason
