"""Elements of a lens at which errors of rays grow far beyond what published lenses show."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator

import numpy as np

from plenoptic.optics.lens.analysis.conditioning_rows import blocks_of, noted, sizes
from plenoptic.optics.lens.checks.finding import Finding, FindingKind
from plenoptic.optics.lens.checks.rays import passing_rays
from plenoptic.optics.lens.record import lens_record
from plenoptic.optics.lens.stack import LensStack

# Of 23 lenses of W. J. Smith, Modern Lens Design, and the bundled ones, the largest numbers are 3.4, 4.2 and 27.
_GRAZING = 10.0
_NEAR_CRITICAL = 10.0
_CANCELLED = 1e4


def condition_findings(lens: LensStack, wavelength: float, *, leave_out: Collection[int] = ()) -> Iterator[Finding]:
    """For each kind of condition number, the element at which it is largest, where that is too large.

    Of rays that pass the lens, towards the sensor. In reverse, grazing incidence is emergence close to total
    reflection, and the other way round. Elements to `leave_out` have been found to reflect rays totally.

    Examples
    --------
    >>> import plenoptic as pl
    >>> from plenoptic.optics.lens.checks.conditions import condition_findings
    >>> list(condition_findings(pl.load_lens("double-gauss-100mm-f2"), 587.6))
    []
    """
    rays = passing_rays(lens, wavelength)
    if not len(rays):
        return
    record = lens_record(lens, wavelength, reverse=False, first=0, last=len(lens.elements) - 1)
    notes = noted(record, blocks_of(rays), len(rays))
    kept = [i not in leave_out for i in range(len(lens.elements))]
    for kind, numbers, limit in (
        (FindingKind.GRAZING, notes.incidence, _GRAZING),
        (FindingKind.NEAR_TOTAL_REFLECTION, notes.refraction, _NEAR_CRITICAL),
        (FindingKind.CANCELLATION, notes.cancellation, _CANCELLED),
    ):
        largest = np.where(kept, np.nan_to_num(numbers, nan=0.0, posinf=math.inf).max(axis=1), 0.0)
        at = int(np.argmax(largest))
        if largest[at] > limit:
            yield Finding(kind, (at,), _sentence(kind, at, float(largest[at]), limit, float(sizes(record)[at])))


def _sentence(kind: FindingKind, at: int, number: float, limit: float, size: float) -> str:
    if kind is FindingKind.GRAZING:
        return (
            f"rays that pass the lens meet element {at} at up to {math.degrees(math.acos(1.0 / number)):.4g} degrees "
            f"from its normal, which magnifies their errors there {number:.3g} times (1 / cos i), and more than "
            f"{limit:g} times is too much; reduce its semi-diameter or check the radii"
        )
    if kind is FindingKind.NEAR_TOTAL_REFLECTION:
        return (
            f"rays that pass the lens are nearly totally reflected at surface {at}, which magnifies errors of their "
            f"direction {number:.3g} times (n cos i / (n' cos i')), and more than {limit:g} times is too much; reduce "
            "its semi-diameter or check the radii"
        )
    return (
        f"rays come to element {at} over lengths that add up to {number:.3g} times its size of {size:.3g} mm, so that "
        f"{math.log10(number):.2g} of 15.7 decimal digits are lost, and more than {math.log10(limit):g} are too many; "
        "reduce the gaps beside it, or check the units"
    )
