"""Rounding errors of ray tracing against a trace with 50 digits, which is part of the tests in a clone."""

from __future__ import annotations

import importlib
import sys
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from plenoptic.core.files.extras import MissingPackageError
from plenoptic.core.values import seed_number, whole
from plenoptic.errors import InvalidValueError
from plenoptic.study.study_table import Cell, StudyTable, run_until_interrupt

QUICK, THOROUGH = 40, 1000
"""Rays of a case: to see that all works, and by default."""

_REFERENCE = "rounding_study"
"""The package with cases and reference, in the folder tests/validation of the repository."""


class StabilityRow(NamedTuple):
    """Largest rounding errors of the rays of one case, None if no ray has one; ratios are error over bound.

    Examples
    --------
    See `stability`.
    """

    case: str
    rays: int
    position: float | None
    """Distance of the traced point from the exact one, mm."""
    ulps: float | None
    """The same in spacings of float64 at the size of the point, or of the vertex's z if that is larger."""
    position_ratio: float | None
    direction: float | None
    """Length of the difference of the unit vectors."""
    direction_ratio: float | None
    snell_ratio: float | None
    """Error of the direction against Snell's law at the traced point, over its bound."""
    path: float | None
    """Error of the optical path, in waves."""
    path_ratio: float | None
    returned: tuple[tuple[str, int], ...]
    """Names of statuses, and the numbers of rays that have them."""
    wrong: int
    """Rays whose status is not an allowed one, or whose numbers do not fit it."""
    seconds: float

    @property
    def holds(self) -> bool:
        """True if every ray is within its bounds and has an allowed status."""
        ratios = (self.position_ratio, self.direction_ratio, self.snell_ratio, self.path_ratio)
        return self.wrong == 0 and all(ratio is None or ratio <= 1 for ratio in ratios)

    @property
    def cells(self) -> tuple[Cell, ...]:
        """Texts with the heads of their columns."""
        return (
            ("case", self.case),
            ("rays", str(self.rays)),
            ("position, mm", _size(self.position)),
            ("ulps", _ratio(self.ulps)),
            ("/ bound", _ratio(self.position_ratio)),
            ("direction", _size(self.direction)),
            ("/ bound", _ratio(self.direction_ratio)),
            ("Snell / bound", _ratio(self.snell_ratio)),
            ("path, waves", _size(self.path)),
            ("/ bound", _ratio(self.path_ratio)),
            ("returned", ", ".join(f"{count} {name}" for name, count in self.returned)),
            ("wrong", str(self.wrong)),
            ("s", f"{self.seconds:.1f}"),
        )


def stability(*, rays: int = THOROUGH, seed: int = 0, only: Sequence[str] | None = None) -> StudyTable[StabilityRow]:
    """Measure rounding errors of ray tracing against a trace with 50 digits and other formulas.

    The cases are ordinary lenses and numbers that are hard for floating point: very large and very small radii, distant
    origins, grazing rays, tangents, total reflection, indices that are almost equal, strong aspheres, numbers that
    are not finite. Every ray is held to a bound of its own. Cases, trace and bounds are in tests/validation of the
    repository; the working directory must be a clone, or the package be installed from it in place.

    Parameters
    ----------
    rays : int, optional
        For each case. A thousand take about a minute, most of it with 50 digits.
    seed : int, optional
        Of the random rays.
    only : sequence of str, optional
        Beginnings of the names of the cases wanted.

    Returns
    -------
    StudyTable
        Its rows are `StabilityRow`, its note says which are beyond their bounds. After Ctrl-C it is `interrupted`, with
        the cases that were done.

    Raises
    ------
    PlenopticError
        If mpmath is not installed or the repository not there.
    InvalidValueError
        If an argument is of another kind, `rays` is below 1, or no case is left.

    Examples
    --------
    >>> import plenoptic as pl
    >>> table = pl.study.stability(rays=10, only=["plane", "miss"])
    >>> table.rows[-1].returned, table.rows[-1].holds
    ((('MISSED', 10),), True)
    """
    count, first = whole(rays, "rays", at_least=1), seed_number(seed)
    beginnings = None if only is None else _checked_beginnings(only)
    study = _reference()
    cases = study.rounding_cases()
    chosen = [case for case in cases if beginnings is None or case.name.startswith(beginnings)]
    if not chosen:
        names = ", ".join(repr(case.name) for case in cases)
        raise InvalidValueError(f"only is {only!r}, and no case begins so; the cases are {names}")

    def measure(case: Any) -> StabilityRow:
        begin = time.perf_counter()
        errors, returned = study.case_errors(case, rays=count, seed=first)
        right, *columns = zip(*errors, strict=True)
        largest = [max((error for error in column if error is not None), default=None) for column in columns]
        seconds = time.perf_counter() - begin
        return StabilityRow._make((case.name, count, *largest, tuple(returned), right.count(False), seconds))

    rows = run_until_interrupt(measure, chosen)
    beyond = [row.case for row in rows if not row.holds]
    note = f"{len(beyond)} beyond their bounds: {', '.join(beyond)}" if beyond else "all within their bounds"
    return StudyTable(rows, [f"{len(rows)} cases, {note}."], interrupted=len(rows) < len(chosen))


def _checked_beginnings(only: Sequence[str]) -> tuple[str, ...]:
    """Beginnings of names as a tuple; a text alone would be taken as its letters."""
    beginnings = () if isinstance(only, str | bytes) or not isinstance(only, Iterable) else tuple(only)
    if not beginnings or not all(isinstance(name, str) for name in beginnings):
        raise InvalidValueError(f"only is {only!r}; it must be a sequence of names or their beginnings: ['plane']")
    return beginnings


def _reference() -> Any:
    """The package of cases and reference, in the clone of this file or around the working directory."""
    try:
        import mpmath  # noqa: F401
    except ImportError as error:
        raise MissingPackageError(
            f"the trace with 50 digits needs mpmath, which cannot be imported ({error}); pip install mpmath"
        ) from error
    for root in (Path(__file__).parents[2], Path.cwd()):
        folder = root / "tests" / "validation"
        if (folder / _REFERENCE).is_dir():
            sys.path.insert(0, str(folder))
            try:
                return importlib.import_module(_REFERENCE)
            finally:
                sys.path.remove(str(folder))
    raise MissingPackageError(
        f"the trace with 50 digits is tests/validation/{_REFERENCE} of the repository, which is not installed; run "
        "this in a clone"
    )


def _size(error: float | None) -> str:
    return "" if error is None else "0" if error == 0 else f"{error:.1e}"


def _ratio(ratio: float | None) -> str:
    if ratio is None:
        return ""
    return f"{ratio:.2f}" if ratio < 100 else f"{ratio:.1e}"
