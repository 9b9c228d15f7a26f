"""The table of the stability study: measured rounding errors, row by row."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence

import numpy as np

from plenoptic.core.rays import RayStatus
from plenoptic.core.values import seed_number, set_field, value, whole
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.optical_path import paths_of_part
from plenoptic.optics.surfaces.surface import Surface
from plenoptic.study.interruption import until_interrupted, with_note
from plenoptic.study.rounding.bounds import Found, compared
from plenoptic.study.rounding.cases import Setup, StabilityCase, stability_cases
from plenoptic.study.rounding.reference import exact_rays, mpmath_context
from plenoptic.study.text_table import markdown_table, plain_table

QUICK = 40
"""Rays of a case that show that all works."""

THOROUGH = 1000
"""Rays of a case, unless told otherwise."""

_COLUMNS = (
    *("case", "rays", "position, mm", "ulps", "/ bound", "direction", "/ bound"),
    *("Snell / bound", "path, waves", "/ bound"),
    *("returned", "wrong", "s"),
)


@value
class StabilityRow:
    """Results of one case. Errors are the largest of all rays, None where no ray has one.

    Parameters
    ----------
    case : str
    rays : int
    position_error : float or None
        Distance of the point found from the exact one, mm.
    position_ulps : float or None
        The same in spacings of float64 at the size of the point (or of the vertex's z, where that is larger).
    position_ratio : float or None
        The largest ratio of a ray's error to its own bound.
    direction_error : float or None
        Length of the difference of the unit vectors.
    direction_ratio : float or None
    snell_ratio : float or None
        The error of the direction against Snell's law at the point found, over 4 eps (1 + mu^2) / cos t.
    path_error : float or None
        Of the optical path, in waves.
    path_ratio : float or None
        The same over its bound, which is 1e-6 waves at least.
    returned : sequence of (str, int)
        Names of statuses, and how many rays have them.
    wrong : int
        Rays whose status is not the one it must be, or whose numbers do not fit it.
    seconds : float
        For tracing, almost all of them with many digits.
    """

    case: str
    rays: int
    position_error: float | None
    position_ulps: float | None
    position_ratio: float | None
    direction_error: float | None
    direction_ratio: float | None
    snell_ratio: float | None
    path_error: float | None
    path_ratio: float | None
    returned: Sequence[tuple[str, int]]
    wrong: int
    seconds: float

    def __post_init__(self) -> None:
        set_field(self, "returned", tuple(self.returned))

    @property
    def holds(self) -> bool:
        """True if every ray is within its bounds and has a status that it may have."""
        ratios = (self.position_ratio, self.direction_ratio, self.snell_ratio, self.path_ratio)
        return self.wrong == 0 and all(ratio is None or ratio <= 1 for ratio in ratios)

    @property
    def cells(self) -> tuple[str, ...]:
        """Cells of the table."""
        returned = ", ".join(f"{count} {name}" for name, count in self.returned)
        return (
            self.case,
            str(self.rays),
            _size(self.position_error),
            _share(self.position_ulps),
            _share(self.position_ratio),
            _size(self.direction_error),
            _share(self.direction_ratio),
            _share(self.snell_ratio),
            _size(self.path_error),
            _share(self.path_ratio),
            returned,
            str(self.wrong),
            f"{self.seconds:.1f}",
        )


@value
class StabilityTable:
    """Rounding errors of ray tracing, case by case; `print` shows it."""

    rows: Sequence[StabilityRow]
    interrupted: bool = False

    def __post_init__(self) -> None:
        set_field(self, "rows", tuple(self.rows))

    @property
    def holds(self) -> bool:
        """True if all rows hold."""
        return all(row.holds for row in self.rows)

    def to_markdown(self) -> str:
        """The table in Markdown."""
        return with_note(markdown_table(_COLUMNS, [row.cells for row in self.rows]), interrupted=self.interrupted)

    def _repr_markdown_(self) -> str:
        return self.to_markdown()

    def __str__(self) -> str:
        return with_note(plain_table(_COLUMNS, [row.cells for row in self.rows]), interrupted=self.interrupted)

    def __repr__(self) -> str:
        missed = [row.case for row in self.rows if not row.holds]
        how = f"{len(missed)} beyond their bounds: {', '.join(missed)}" if missed else "all within their bounds"
        return f"<StabilityTable: {len(self.rows)} cases, {how}{', interrupted' * self.interrupted}>"


def _size(error: float | None) -> str:
    return "" if error is None else "0" if error == 0 else f"{error:.1e}"


def _share(ratio: float | None) -> str:
    if ratio is None:
        return ""
    return f"{ratio:.2f}" if ratio < 100 else f"{ratio:.1e}"


def stability_row(case: StabilityCase, *, rays: int, seed: int = 0) -> StabilityRow:
    """Trace one case in float64 and with many digits."""
    begin = time.perf_counter()
    # A case's rays do not depend on which other cases there are.
    setup = case.setup(np.random.default_rng([seed, *case.name.encode()]), rays)
    found, returned = _found(case, setup)

    def largest(error: str) -> float | None:
        return max((one for ray in found if (one := getattr(ray, error)) is not None), default=None)

    return StabilityRow(
        case.name,
        rays,
        largest("position"),
        largest("ulps"),
        largest("position_ratio"),
        largest("direction"),
        largest("direction_ratio"),
        largest("snell_ratio"),
        largest("path"),
        largest("path_ratio"),
        returned,
        sum(not ray.right for ray in found),
        time.perf_counter() - begin,
    )


def _found(case: StabilityCase, setup: Setup) -> tuple[list[Found], list[tuple[str, int]]]:
    lens, rays, first, last, reverse = setup
    traced = paths_of_part(lens, rays, first, last, reverse=reverse)
    finite = np.flatnonzero(rays.status == RayStatus.OK)
    parts = lens.elements[first : last + 1][:: -1 if reverse else 1]
    surfaces = [part for part in parts if isinstance(part, Surface)]
    with mpmath_context().workdps(case.digits):
        exact = exact_rays(lens, rays.selected(finite), first, last, reverse=reverse, digits=case.digits)
        s = -1 if reverse else 1
        found = [
            compared(traced, int(i), ray, lens, surfaces, case.law, s) for i, ray in zip(finite, exact, strict=True)
        ]
    # What is not finite from the start is lost from the start.
    void = np.flatnonzero(rays.status != RayStatus.OK)
    found += [Found(bool(traced[0].status[i] == rays.status[i] and np.isnan(traced[0].origin[i]).all())) for i in void]
    counts = Counter(RayStatus(int(status)).name for status in traced[0].status)
    return found, sorted(counts.items(), key=lambda item: RayStatus[item[0]])


def stability(*, rays: int = THOROUGH, seed: int = 0, only: Sequence[str] | None = None) -> StabilityTable:
    """Rounding errors of ray tracing, against a trace with 50 digits and other formulas.

    The cases are ordinary lenses and those that are hard for floating-point numbers: very large and very small radii,
    distant origins, grazing rays, tangents, total reflection, indices that are almost the same, strong aspheres,
    numbers that are not finite. Every ray is held to a bound of its own; see `plenoptic.study.rounding.bounds`.

    Parameters
    ----------
    rays : int, optional
        For each case. A thousand take about a minute, most of it with many digits.
    seed : int, optional
        Of the random rays.
    only : sequence of str, optional
        Beginnings of the names of the cases wanted.

    Returns
    -------
    StabilityTable
        `print` shows it; `to_markdown()`, and `rows` with the numbers; after Ctrl-C those of the cases that were done.

    Raises
    ------
    PlenopticError
        If mpmath is not installed; an InvalidValueError if `rays` is below 1 or no case is left.

    Examples
    --------
    >>> import plenoptic as pl
    >>> table = pl.study.stability(rays=10, only=["plane", "miss"])
    >>> table, [(row.case, row.returned, row.holds) for row in table.rows][-1]
    (<StabilityTable: 3 cases, all within their bounds>, ('miss', (('MISSED', 10),), True))
    """
    count = whole(rays, "rays", at_least=1)
    chosen = [case for case in stability_cases() if only is None or case.name.startswith(tuple(only))]
    if not chosen:
        names = ", ".join(repr(case.name) for case in stability_cases())
        raise InvalidValueError(f"only is {only!r}, and no case begins so; the cases are {names}")
    first = seed_number(seed)
    rows = until_interrupted(lambda case: stability_row(case, rays=count, seed=first), chosen)
    return StabilityTable(rows, interrupted=len(rows) < len(chosen))
