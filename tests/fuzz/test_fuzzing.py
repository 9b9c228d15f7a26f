"""Whatever camera, scene and options are given: an error of the package, or an image that is finite and consistent.

Run the long one with ``PLENOPTIC_FUZZED_CAMERAS=840 pytest -m slow tests/fuzz``.
What fails is printed together with ``@reproduce_failure(...)``.
"""

import collections
import dataclasses
import faulthandler
import math
import os
import threading
import time
import warnings

import numpy as np
import pytest
from fuzzed_cameras import CENTRED, MOVED, Glass, a_lens
from fuzzed_numbers import length
from fuzzed_renderings import check_case, check_refusal, some_cases
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

import plenoptic as pl

CAMERAS = int(os.environ.get("PLENOPTIC_FUZZED_CAMERAS", "60"))
"""Of the slow run, each before three scenes. 840 of them, 2000 renderings and more, take half an hour."""
RANDOM = st.randoms(use_true_random=True)
HANGS = 300.0
"""s. An example takes some 0.1 s, one whose kernels must be compiled first some 20 s."""
SLOW = 30.0
"""s of CPU, with kernels that are compiled: up to 1e5 microlenses may feed each of 64 pixels."""


def fuzzing(examples):
    """The same examples every time. They are not shrunk: each is drawn from one number, and another is another one."""
    how = {"phases": [Phase.generate], "derandomize": True, "print_blob": True, "database": None}
    return settings(max_examples=examples, suppress_health_check=list(HealthCheck), **how)


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


def an_analysis(rnd, *, common=False):
    """A lens with some rays (n, 3) towards it, or the error with which the package refuses it."""
    try:
        lens, scale = a_lens(rnd, features=Glass.PLAIN if common else rnd.choice(CENTRED + MOVED))
    except pl.PlenopticError as error:
        return error
    rng = np.random.default_rng(rnd.randint(0, 99))
    distance, n = length(rnd, 10.0 * scale, spread=3.0), rnd.randint(0, 20)
    first = lens.elements[0].semi_diameter
    z = float(lens.vertices[0])
    target, origin = np.full((2, n, 3), z)
    target[:, :2] = rng.uniform(-1.0, 1.0, (n, 2)) * length(rnd, 0.5 * first)
    origin[:, :2] = rng.uniform(-1.0, 1.0, (n, 2)) * length(rnd, min(scale, distance))
    origin[:, 2] -= distance
    return lens, origin, target - origin


def check_analysis(lens, origin, direction):
    """The laws. Returns the number of rays that came through."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", UserWarning)  # the package's own
        for finding in check_or_refuse(lambda: lens.check(), ()):
            check_refusal(finding)
        points = check_or_refuse(lambda: pl.paraxial.cardinal_points(lens), None)
        if points is not None:
            # inf where there is none, and never nan.
            numbers = [getattr(points, field.name) for field in dataclasses.fields(points)]
            assert not any(isinstance(number, float) and math.isnan(number) for number in numbers), points
        out = check_or_refuse(lambda: lens.trace(pl.RayBundle(origin, direction)), None)
    if out is None:
        return 0
    passed = out.status == pl.RayStatus.OK
    assert np.isfinite(out.origin[passed]).all() and np.isfinite(out.direction[passed]).all()
    # Renormalised nowhere: some roundings for each of up to fifteen elements.
    np.testing.assert_allclose(np.linalg.norm(out.direction[passed], axis=1), 1.0, rtol=1e-12)
    assert ((out.weight >= 0) & (out.weight <= 1)).all()
    if all(element.placement is None for element in lens.elements):
        # A plane that is tilted so far that a ray meets its back is met at infinity.
        assert (out.status != pl.RayStatus.NOT_FINITE).all()
    assert (out.lost_at[~passed] < len(lens.elements)).all()
    return int(passed.sum())


def check_or_refuse(function, otherwise):
    try:
        return function()
    except pl.PlenopticError as error:
        check_refusal(error)
        return otherwise


def fuzz_lenses(watch, examples, *, common):
    seen = collections.Counter()

    @fuzzing(examples)
    @given(st.builds(an_analysis, RANDOM, common=st.just(common)))
    def law(case):
        if isinstance(case, pl.PlenopticError):
            check_refusal(case)
        elif watch(case, check_analysis, *case):
            seen["passed"] += 1
        seen["all"] += 1

    law()
    assert seen["all"] >= examples
    assert seen["passed"] > 0.2 * examples


def test_simple_lenses(watchdog):
    fuzz_lenses(watchdog, 20, common=True)


@pytest.mark.slow
def test_400_lenses_of_all_kinds(watchdog):
    fuzz_lenses(watchdog, 400, common=False)
