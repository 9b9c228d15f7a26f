"""What the simulator can be trusted with: studies that print a table. ``python -m plenoptic.study`` runs them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from plenoptic.study.stability_table import StabilityTable

QUICK = 40
"""Rays of a case that show that all works."""

THOROUGH = 1000
"""Rays of a case, unless told otherwise."""


def stability(*, rays: int = THOROUGH, seed: int = 0, only: Sequence[str] | None = None) -> StabilityTable:
    """Rounding errors of ray tracing, against a trace with 50 digits and other formulas.

    The cases are ordinary lenses and what is hard for floating-point numbers: very large and very small radii, distant
    origins, grazing rays, tangents, total reflection, indices that are almost the same, strong aspheres, numbers that
    are not finite. Every ray is held to a bound of its own; see `plenoptic.study.rounding_bounds`.

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
        `print` shows it; `to_markdown()`, and `rows` with the numbers.

    Raises
    ------
    PlenopticError
        If mpmath is not installed; an InvalidValueError if `rays` is below 1 or no case is left.

    Examples
    --------
    >>> import plenoptic as pl
    >>> table = pl.study.stability(rays=10, only=["radius 50"])
    >>> table.holds, [row.case for row in table.rows][:2]
    (True, ['radius 50', 'radius 50, in reverse'])
    """
    from plenoptic.study.stability_table import stability_table

    return stability_table(rays=rays, seed=seed, only=only)
