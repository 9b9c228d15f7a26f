"""Dispersion formulas of glass catalogues: the index as a function of wavelength and coefficients."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Sequence

from plenoptic.core.values import choice, set_field, value
from plenoptic.errors import InvalidValueError
from plenoptic.optics.glass.media import checked_coefficients, index_by_formula, set_limits


class Formula(enum.IntEnum):
    r"""Dispersion formulas of glass catalogues, with their numbers in AGF files.

    The wavelength is in micrometres. `a` to `j` are the coefficients in the order of the file.

    ==================== ==== ==============================================================================
    SCHOTT               6    n^2 = a + b w^2 + c w^-2 + d w^-4 + e w^-6 + f w^-8
    SELLMEIER_1          6    n^2 = 1 + a w^2 / (w^2 - b) + c w^2 / (w^2 - d) + e w^2 / (w^2 - f)
    HERZBERGER           6    n = a + b L + c L^2 + d w^2 + e w^4 + f w^6, L = 1 / (w^2 - 0.028)
    SELLMEIER_2          5    n^2 = 1 + a + b w^2 / (w^2 - c^2) + d / (w^2 - e^2)
    CONRADY              3    n = a + b / w + c / w^3.5
    SELLMEIER_3          8    as SELLMEIER_1, with four terms
    HANDBOOK_OF_OPTICS_1 4    n^2 = a + b / (w^2 - c) - d w^2
    HANDBOOK_OF_OPTICS_2 4    n^2 = a + b w^2 / (w^2 - c) - d w^2
    SELLMEIER_4          5    n^2 = a + b w^2 / (w^2 - c) + d w^2 / (w^2 - e)
    EXTENDED             8    as SCHOTT, then g w^-10 + h w^-12
    SELLMEIER_5          10   as SELLMEIER_1, with five terms
    EXTENDED_2           8    as SCHOTT, then g w^4 + h w^6
    EXTENDED_3           9    n^2 = a + b w^2 + c w^4 + d w^-2 + e w^-4 + f w^-6 + g w^-8 + h w^-10 + i w^-12
    ==================== ==== ==============================================================================

    The second column is the number of coefficients. See `DispersionFormula`.
    """

    SCHOTT = 1
    SELLMEIER_1 = 2
    HERZBERGER = 3
    SELLMEIER_2 = 4
    CONRADY = 5
    SELLMEIER_3 = 6
    HANDBOOK_OF_OPTICS_1 = 7
    HANDBOOK_OF_OPTICS_2 = 8
    SELLMEIER_4 = 9
    EXTENDED = 10
    SELLMEIER_5 = 11
    EXTENDED_2 = 12
    EXTENDED_3 = 13


def _powers(w: float, k: Sequence[float], *exponents: int) -> float:
    return sum(a * w**exponent for a, exponent in zip(k, exponents, strict=True))


def _sellmeier(w: float, k: Sequence[float]) -> float:
    return 1.0 + sum(b * w * w / (w * w - c) for b, c in zip(k[::2], k[1::2], strict=True) if b)


def _herzberger(w: float, k: Sequence[float]) -> float:
    resonance = 1.0 / (w * w - 0.028)
    return k[0] + k[1] * resonance + k[2] * resonance**2 + k[3] * w**2 + k[4] * w**4 + k[5] * w**6


_SQUARES: dict[Formula, Callable[[float, Sequence[float]], float]] = {
    Formula.SCHOTT: lambda w, k: _powers(w, k, 0, 2, -2, -4, -6, -8),
    Formula.SELLMEIER_1: _sellmeier,
    Formula.SELLMEIER_2: lambda w, k: 1.0 + k[0] + k[1] * w * w / (w * w - k[2] ** 2) + k[3] / (w * w - k[4] ** 2),
    Formula.SELLMEIER_3: _sellmeier,
    Formula.HANDBOOK_OF_OPTICS_1: lambda w, k: k[0] + k[1] / (w * w - k[2]) - k[3] * w * w,
    Formula.HANDBOOK_OF_OPTICS_2: lambda w, k: k[0] + k[1] * w * w / (w * w - k[2]) - k[3] * w * w,
    Formula.SELLMEIER_4: lambda w, k: k[0] + k[1] * w * w / (w * w - k[2]) + k[3] * w * w / (w * w - k[4]),
    Formula.EXTENDED: lambda w, k: _powers(w, k, 0, 2, -2, -4, -6, -8, -10, -12),
    Formula.SELLMEIER_5: _sellmeier,
    Formula.EXTENDED_2: lambda w, k: _powers(w, k, 0, 2, -2, -4, -6, -8, 4, 6),
    Formula.EXTENDED_3: lambda w, k: _powers(w, k, 0, 2, 4, -2, -4, -6, -8, -10, -12),
}
"""Formulas that give n^2, of the wavelength w in micrometres and the coefficients k."""

_INDICES: dict[Formula, Callable[[float, Sequence[float]], float]] = {
    Formula.HERZBERGER: _herzberger,
    Formula.CONRADY: lambda w, k: k[0] + k[1] / w + k[2] / w**3.5,
}
"""Formulas that give n itself."""

COEFFICIENT_COUNTS = dict(zip(Formula, (6, 6, 6, 5, 3, 8, 4, 4, 5, 8, 10, 8, 9), strict=True))
"""Number of coefficients of each formula."""


@value
class DispersionFormula:
    """A medium described by a dispersion formula of glass catalogues.

    Parameters
    ----------
    formula : Formula
        One of the members of `Formula`, which tabulates them.
    coefficients : sequence of float
        For wavelengths in micrometres, as many as the formula has and in the order of an AGF file.
    name, wavelength_range
        As of `Sellmeier`.

    Raises
    ------
    InvalidValueError
        If the number of coefficients is not that of the formula, one is not finite, or the index is below 1 or not
        finite at both ends and the middle of the range.

    Notes
    -----
    The second Sellmeier formula is published in two versions; the last term here has no w^2 in its numerator.

    References
    ----------
    The formulas are those of the user manual of Zemax OpticStudio, "The glass dispersion formulas".

    Examples
    --------
    >>> import plenoptic as pl
    >>> numbers = (1.57410327, 1.39786149e-2, 8.3004511e-4)
    >>> basf5 = pl.optics.DispersionFormula(pl.optics.Formula.CONRADY, numbers, "BASF5", (334.0, 2325.0))
    >>> round(basf5.index(587.5618), 5)
    1.60323
    """

    formula: Formula
    coefficients: Sequence[float]
    name: str = ""
    wavelength_range: tuple[float, float] = (365.0, 1014.0)

    def __post_init__(self) -> None:
        set_field(self, "formula", choice(self.formula, Formula, "formula"))
        count = COEFFICIENT_COUNTS[self.formula]
        set_field(self, "coefficients", checked_coefficients(self.coefficients, "coefficients", count))
        if not isinstance(self.name, str):
            raise InvalidValueError(f"name is {self.name!r:.40}; it must be a text")
        set_limits(self, self.wavelength_range)

    def index(self, wavelength: float) -> float:
        """Refractive index at a wavelength in nm; an InvalidValueError outside `wavelength_range`."""

        def formula(w: float) -> float:
            if self.formula in _INDICES:
                return _INDICES[self.formula](w, self.coefficients)
            return math.sqrt(_SQUARES[self.formula](w, self.coefficients))

        name = self.name or f"this {self.formula.name} medium"
        return index_by_formula(formula, wavelength, self.wavelength_range, name)
