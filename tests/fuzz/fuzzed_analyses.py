"""What is asked of fuzzed lenses: checks, cardinal points and rays."""

import dataclasses
import math
import warnings

import numpy as np
from fuzzed_lenses import CENTRED, MOVED, Glass, a_lens
from fuzzed_numbers import length
from fuzzed_renderings import check_refusal

import plenoptic as pl


@dataclasses.dataclass
class Analysis:
    """A lens, and rays (n, 3) in its frame."""

    lens: pl.LensStack
    origin: np.ndarray
    direction: np.ndarray


def an_analysis(rnd, *, common=False):
    """A lens with some rays towards it, or the error with which the package refuses it."""
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
    return Analysis(lens, origin, target - origin)


def check_analysis(case):
    """The laws. Returns the number of rays that came through."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", UserWarning)  # the package's own
        for finding in check_or_refuse(lambda: case.lens.check(), ()):
            check_refusal(finding)
        points = check_or_refuse(lambda: pl.paraxial.cardinal_points(case.lens), None)
        if points is not None:
            # inf where there is none, and never nan.
            numbers = [getattr(points, field.name) for field in dataclasses.fields(points)]
            assert not any(isinstance(number, float) and math.isnan(number) for number in numbers), points
        out = check_or_refuse(lambda: case.lens.trace(pl.RayBundle(case.origin, case.direction)), None)
    if out is None:
        return 0
    passed = out.status == pl.RayStatus.OK
    assert np.isfinite(out.origin[passed]).all() and np.isfinite(out.direction[passed]).all()
    # Renormalised nowhere: some roundings for each of up to fifteen elements.
    np.testing.assert_allclose(np.linalg.norm(out.direction[passed], axis=1), 1.0, rtol=1e-12)
    assert ((out.weight >= 0) & (out.weight <= 1)).all()
    if all(element.placement is None for element in case.lens.elements):
        # A plane that is tilted so far that a ray meets its back is met at infinity.
        assert (out.status != pl.RayStatus.NOT_FINITE).all()
    assert (out.lost_at[~passed] < len(case.lens.elements)).all()
    return int(passed.sum())


def check_or_refuse(function, otherwise):
    try:
        return function()
    except pl.PlenopticError as error:
        check_refusal(error)
        return otherwise
