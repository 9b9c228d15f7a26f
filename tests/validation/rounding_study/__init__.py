"""Rounding errors of the kernels against a trace with 50 digits: what `plenoptic study stability` runs in a clone."""

from collections import Counter

import numpy as np
from mpmath import mp

import plenoptic as pl
from plenoptic.core.rays import RayStatus
from plenoptic.optics.lens.optical_path import paths_of_part

from .exact_trace import trace_exactly
from .rounding_bounds import RayErrors, ray_errors
from .rounding_cases import rounding_cases

__all__ = ["case_errors", "rounding_cases"]


def case_errors(case, *, rays, seed=0):
    """Errors of each ray of a case, and how many rays have which status."""
    # The rays of a case do not depend on the other cases.
    lens, bundle, first, last, reverse = case.setup(np.random.default_rng([seed, *case.name.encode()]), rays)
    traced = paths_of_part(lens, bundle, first, last, reverse=reverse)
    finite = np.flatnonzero(bundle.status == RayStatus.OK)
    elements = lens.elements[first : last + 1][:: -1 if reverse else 1]
    surfaces = [element for element in elements if isinstance(element, pl.Surface)]
    with mp.workdps(case.digits):
        exact = trace_exactly(lens, bundle.selected(finite), first, last, reverse=reverse, digits=case.digits)
        sign = -1 if reverse else 1
        errors = [
            ray_errors(traced, i, ray, lens, surfaces, case.law, sign) for i, ray in zip(finite, exact, strict=True)
        ]
    # A ray that is not finite at the start is lost at the start.
    void = np.flatnonzero(bundle.status != RayStatus.OK)
    errors += [
        RayErrors(bool(traced[0].status[i] == bundle.status[i] and np.isnan(traced[0].origin[i]).all())) for i in void
    ]
    counts = Counter(RayStatus(int(status)).name for status in traced[0].status)
    return errors, sorted(counts.items(), key=lambda item: RayStatus[item[0]])
