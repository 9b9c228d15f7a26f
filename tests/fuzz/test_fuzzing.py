"""Whatever camera, scene and options are given: an error of the package, or an image that is finite and consistent.

Run the long one with ``PLENOPTIC_FUZZED_CAMERAS=840 pytest -m slow tests/fuzz``.
What fails is printed together with ``@reproduce_failure(...)``.
"""

import collections
import faulthandler
import os
import sys
import threading
import time
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

import plenoptic as pl

sys.path.insert(0, str(Path(__file__).parent))
from fuzzed_analyses import an_analysis, check_analysis  # noqa: E402
from fuzzed_renderings import check_case, check_refusal, some_cases  # noqa: E402

CAMERAS = int(os.environ.get("PLENOPTIC_FUZZED_CAMERAS", "60"))
"""Of the slow run, each before three scenes. 840 of them, 2000 renderings and more, take half an hour."""
RANDOM = st.randoms(use_true_random=True)
HANGS = 300.0
"""s. An example takes some 0.1 s, one whose kernels must be compiled first some 20 s."""
SLOW = 30.0
"""s of CPU, with kernels that are compiled: up to 1e5 microlenses may feed each of 64 pixels."""


def fuzzing(examples):
    """The same examples every time. They are not shrunk: each is drawn from one number, and another is another one."""
    return settings(
        phases=[Phase.generate],
        max_examples=examples,
        derandomize=True,
        print_blob=True,
        database=None,
        suppress_health_check=list(HealthCheck),
    )


@pytest.fixture
def watchdog(capfd):
    """Ends the process, with a traceback of all threads, where an example hangs: nothing else can stop a kernel."""
    with capfd.disabled():
        shown = os.fdopen(os.dup(2), "w")

    def bark(example):
        shown.write(f"\nhangs: {example!r}\n")
        shown.flush()
        faulthandler.dump_traceback(shown, all_threads=True)
        os._exit(1)

    def watch(example, function, *arguments, **options):
        timer = threading.Timer(HANGS, bark, [example])
        timer.start()
        try:
            return function(*arguments, **options)
        finally:
            timer.cancel()

    with shown:
        yield watch


def run(case, watch, *, again):
    """What is fuzzed: the laws for one case."""
    if isinstance(case, pl.PlenopticError):
        check_refusal(case)
        return "refused"
    begin = time.process_time()
    shot = watch(case, check_case, case, again=again)
    if time.process_time() - begin > SLOW:
        begin = time.process_time()
        watch(case, check_case, case, again=False)
        assert time.process_time() - begin < SLOW
    if shot is None:
        return "not rendered"
    return "lit" if shot.image.any() else "dark"


def fuzz_renderings(watch, cameras, scenes, *, again, common):
    """Renderings of some scenes with each of some cameras; one in `again` is repeated."""
    seen = collections.Counter()

    @fuzzing(cameras)
    @given(st.builds(some_cases, RANDOM, count=st.just(scenes), common=st.just(common)))
    def law(cases):
        for case in cases:
            seen[run(case, watch, again=seen.total() % again == 0)] += 1

    law()
    # They are worth it: most are rendered, and light comes through in many.
    assert seen["lit"] > 0.3 * seen.total()
    assert seen["refused"] + seen["not rendered"] < 0.35 * seen.total()
    return seen.total()


def test_simple_renderings(watchdog):
    assert fuzz_renderings(watchdog, 7, 2, again=4, common=True) >= 12


@pytest.mark.slow
@pytest.mark.timeout(0)  # the watchdog is there for that
def test_renderings_of_everything(watchdog):
    # Of a camera that is refused there is one case instead of three.
    assert fuzz_renderings(watchdog, CAMERAS, 3, again=8, common=False) >= 0.8 * 3 * CAMERAS


def run_analysis(case, watch):
    if isinstance(case, pl.PlenopticError):
        check_refusal(case)
        return "refused"
    return "passed" if watch(case, check_analysis, case) else "lost"


def fuzz_lenses(watch, examples, *, common):
    seen = collections.Counter()

    @fuzzing(examples)
    @given(st.builds(an_analysis, RANDOM, common=st.just(common)))
    def law(case):
        seen[run_analysis(case, watch)] += 1

    law()
    assert seen.total() >= examples
    assert seen["passed"] > 0.2 * examples


def test_simple_lenses(watchdog):
    fuzz_lenses(watchdog, 20, common=True)


@pytest.mark.slow
def test_400_lenses_of_all_kinds(watchdog):
    fuzz_lenses(watchdog, 400, common=False)
