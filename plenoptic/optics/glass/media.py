"""Optical media: the refractive index as a function of the wavelength."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from plenoptic.core.values import Floats, coefficients, finite, positive, set_field, value
from plenoptic.errors import InvalidValueError, PrescriptionError

F_LINE = 486.1327
"""Blue hydrogen line, nm."""
D_LINE = 587.5618
"""Yellow helium line, nm: the index n_d and the Abbe number V_d refer to it."""
C_LINE = 656.2725
"""Red hydrogen line, nm."""
MODEL_GLASS_RANGE = (360.0, 1100.0)
"""Range of wavelengths in nm within which a `ModelGlass` follows real glasses."""

# Real glasses have n_d of 1.4 to 2.2 and V_d of 15 to 100; n_d and V_d in the wrong order exceed these limits.
_LARGEST_ND = 4.0
_SMALLEST_VD = 5.0


@runtime_checkable
class Medium(Protocol):
    """Protocol of media: objects with a refractive index at each wavelength.

    Any object with this method is a medium; only media of this package can be compared (`==`) and saved.

    Examples
    --------
    >>> import plenoptic as pl
    >>> isinstance(pl.optics.AIR, pl.optics.Medium), pl.optics.AIR.index(587.6)
    (True, 1.0)
    """

    def index(self, wavelength: float) -> float:
        """Refractive index at a wavelength in nm, relative to air, or for `Air` and `Absolute` to vacuum."""
        ...


def check_medium(medium: object, name: str) -> None:
    """Raise PrescriptionError if an object is no medium."""
    # A text or a list has an index(), too, which searches its items; a class has one without an instance.
    if hasattr(medium, "complex_index"):
        raise PrescriptionError(
            f"{name} is {medium!r}, which absorbs within a wavelength; metals are the material of films, or mirrors: "
            "pl.optics.MIRROR"
        )
    if isinstance(medium, Sequence | type) or not callable(getattr(medium, "index", None)):
        raise PrescriptionError(
            f"{name} is {medium!r}; it must be a medium: pl.optics.AIR, pl.ConstantMedium(1.5) or a glass, such as "
            'pl.glass("N-BK7") or pl.ModelGlass(1.5168, 64.17)'
        )


def checked_index(index: float, wavelength: float, medium: str) -> float:
    """A refractive index, or an error if it is no number of at least 1."""
    # Written so that nan fails it.
    if not 1.0 <= index < math.inf:
        raise InvalidValueError(
            f"the refractive index of {medium} is {index:g} at {wavelength:g} nm; it must be finite and at least 1: "
            "correct its coefficients"
        )
    return index


def wavelength_within(wavelength: float, limits: tuple[float, float], medium: str) -> float:
    """A wavelength in nm, or an error if it lies outside of the range of a medium."""
    number = finite(wavelength, "wavelength")
    if not limits[0] <= number <= limits[1]:
        raise InvalidValueError(
            f"wavelength {number:g} nm is outside {limits[0]:g} to {limits[1]:g} nm, where {medium} is defined; "
            "choose one inside, in nanometres, or another medium"
        )
    return number


def checked_coefficients(values: Sequence[float], name: str, count: int | None = None) -> tuple[float, ...]:
    """Finite coefficients, `count` of them unless it is None, or an error."""
    numbers = coefficients(values, name)
    if not numbers or (count is not None and len(numbers) != count):
        raise InvalidValueError(f"{name} has {len(numbers)} numbers; it must have {count or 'at least 1'}")
    return numbers


def index_by_formula(
    formula: Callable[[float], float], wavelength: float, limits: tuple[float, float], medium: str
) -> float:
    """Refractive index by a formula for wavelengths in micrometres."""
    micrometres = wavelength_within(wavelength, limits, medium) * 1e-3
    try:
        index = formula(micrometres)
    except (ZeroDivisionError, OverflowError):
        index = math.inf
    except ValueError:  # the root of a negative number
        index = math.nan
    return checked_index(index, wavelength, medium)


def set_limits(medium: Medium, limits: Sequence[float]) -> None:
    """Set the range of wavelengths of a medium in nm, and refuse a medium whose index is invalid in all of it."""
    try:
        low, high = limits
    except (TypeError, ValueError):
        raise InvalidValueError(f"wavelength_range is {limits!r}; it must be two wavelengths in nm") from None
    ends = low, high = positive(low, "wavelength_range", "nm"), positive(high, "wavelength_range", "nm")
    if not low < high:
        raise InvalidValueError(f"wavelength_range ({low:g}, {high:g}) is empty; put the shorter wavelength first")
    set_field(medium, "wavelength_range", ends)
    # A fit may leave 1 at an end of its range, where `index` is an error then.
    for wavelength in (low, 0.5 * (low + high), high):
        try:
            medium.index(wavelength)
            return
        except InvalidValueError as error:
            last_error = error
    raise last_error


def refractive_indices(media: Sequence[Medium], wavelength: float) -> Floats:
    """Refractive indices of media at a wavelength in nm; an error for one below 1 or not finite."""
    indices = np.array([float(medium.index(wavelength)) for medium in media])
    for i in np.flatnonzero(~((indices >= 1.0) & (indices < np.inf))):
        raise PrescriptionError(
            f"the medium behind element {i - 1} has the refractive index {indices[i]:g} at {wavelength:g} nm; "
            "it must be finite and at least 1: use another medium"
        )
    return indices


def abbe_number(medium: Medium) -> float:
    """Abbe number V_d = (n_d - 1) / (n_F - n_C) of a medium; inf if the index is the same at F and C.

    Examples
    --------
    >>> import plenoptic as pl
    >>> round(pl.optics.abbe_number(pl.glass("N-BK7")), 2)
    64.17
    """
    check_medium(medium, "medium")
    dispersion = medium.index(F_LINE) - medium.index(C_LINE)
    return (medium.index(D_LINE) - 1.0) / dispersion if dispersion != 0 else math.inf


@value
class ConstantMedium:
    """A medium with the same refractive index at all wavelengths.

    Parameters
    ----------
    refractive_index : float
        Relative to air as all indices (except with `Air` and `Absolute`: to vacuum), at least 1.

    Raises
    ------
    InvalidValueError
        If the index is below 1 or not finite.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.ConstantMedium(1.670).index(587.6)
    1.67
    """

    refractive_index: float

    def __post_init__(self) -> None:
        number = finite(self.refractive_index, "refractive_index")
        if number < 1.0:
            raise InvalidValueError(
                f"refractive_index is {number:g}; it must be at least 1, the index of air: use 1 or more"
            )
        set_field(self, "refractive_index", number)

    def index(self, wavelength: float) -> float:
        """Refractive index, the same at all wavelengths (nm)."""
        return self.refractive_index


AIR = ConstantMedium(1.0)
"""Air: its index is 1, since all indices are relative to air."""

VACUUM = ConstantMedium(1.0)
"""Vacuum, around a lens whose glasses are `Absolute`. It equals `AIR` by value; the name states the meaning."""


_SECOND = (-3.47727, 198.428, -1571.87)
_THIRD = (-2.01370, 154.268, -2431.02)
"""Coefficients of 1, 1 / V_d and 1 / V_d^2, fitted by docs/fit_model_glass.py to the 1618 bundled glasses."""
_FITTED_VD = (15.0, 100.0)
"""Range of V_d of real glasses; beyond it, the shape of the dispersion is that at its end."""


def chromatic_coordinate(wavelength: float) -> float:
    """Buchdahl's chromatic coordinate of a wavelength in nm: 0 at the line d, with his constant 2.5."""
    difference = (wavelength - D_LINE) * 1e-3
    return difference / (1.0 + 2.5 * difference)


@value
class ModelGlass:
    r"""A glass known by its index n_d and its Abbe number V_d only, as in most old prescriptions.

    Buchdahl's formula in his chromatic coordinate :math:`\omega`, with

    .. math:: n = n_d + \frac{n_d - 1}{V_d} \left[ \frac{\omega}{\omega_F - \omega_C}
              + q_2 (\omega^2 - s_2\, \omega) + q_3 (\omega^3 - s_3\, \omega) \right], \qquad
              \omega = \frac{\lambda - \lambda_d}{1 + 2.5 (\lambda - \lambda_d)}

    where :math:`s_k = (\omega_F^k - \omega_C^k) / (\omega_F - \omega_C)`, so that n_d and V_d are exact. q_2 and q_3
    are parabolas in 1 / V_d, fitted to the 1618 glasses of the makers' catalogues that are bundled. Against these the
    largest error of a glass within 365 to 1014 nm has the median 3.5e-4, is below 9.9e-4 for 95 % of them and 9.7e-3 at
    worst (L-BBH1, at 365 nm); within 400 to 700 nm 1.1e-4, 3.8e-4 and 1.8e-3. The residual is the difference between
    glasses of the same n_d and V_d, largest for anomalous partial dispersion: use `glass` for a glass known by name.

    Parameters
    ----------
    nd : float
        Index at 587.5618 nm, above 1 and at most 4.
    vd : float
        Abbe number, at least 5.
    name : str, optional
        Description, for instance "BAF10".

    Raises
    ------
    InvalidValueError
        If a number is out of range, or gives an index that is below 1 or that rises with the wavelength
        somewhere in 360 to 1100 nm.

    References
    ----------
    P. N. Robb and R. I. Mercado, Calculation of refractive indices using Buchdahl's chromatic coordinate, Appl. Opt.
    22, 1198 (1983), doi:10.1364/AO.22.001198. The fit is docs/fit_model_glass.py.

    Examples
    --------
    >>> import plenoptic as pl
    >>> glass = pl.ModelGlass(1.670, 47.1, "BAF10")
    >>> round(glass.index(486.1327) - glass.index(656.2725), 6)       # 0.670 / 47.1
    0.014225
    """

    nd: float
    vd: float
    name: str = ""

    def __post_init__(self) -> None:
        set_field(self, "nd", finite(self.nd, "nd"))
        if self.nd <= 1.0:
            raise InvalidValueError(f"nd is {self.nd:g}; a glass must have an index above 1: for air use pl.optics.AIR")
        set_field(self, "vd", positive(self.vd, "vd"))
        if not isinstance(self.name, str):
            raise InvalidValueError(f"name is {self.name!r}; it must be a text")
        if self.nd > _LARGEST_ND:
            raise InvalidValueError(
                f"nd is {self.nd:g}; it must be at most {_LARGEST_ND:g}: give the index first and the Abbe number "
                "second, as in ModelGlass(1.5168, 64.17)"
            )
        if self.vd < _SMALLEST_VD:
            raise InvalidValueError(
                f"vd is {self.vd:g}; it must be at least {_SMALLEST_VD:g}: real glasses have 15 to 100"
            )
        shortest, longest = (self.index(wavelength) for wavelength in MODEL_GLASS_RANGE)
        if not shortest > longest:
            raise InvalidValueError(
                f"vd {self.vd:g} gives an index that rises with the wavelength; real glasses have 15 to 100"
            )

    def index(self, wavelength: float) -> float:
        """Refractive index at a wavelength of 360 to 1100 nm; InvalidValueError outside."""
        lam = wavelength_within(wavelength, MODEL_GLASS_RANGE, self.name or "this model glass")
        w, f, c = (chromatic_coordinate(wave) for wave in (lam, F_LINE, C_LINE))
        x = 1.0 / min(max(self.vd, _FITTED_VD[0]), _FITTED_VD[1])
        shape = w / (f - c)
        for power, (a0, a1, a2) in ((2, _SECOND), (3, _THIRD)):
            # Less its difference between F and C, which V_d fixes.
            shape += (a0 + a1 * x + a2 * x * x) * (w**power - w * (f**power - c**power) / (f - c))
        index = self.nd + (self.nd - 1.0) / self.vd * shape
        return checked_index(index, lam, self.name or f"the model glass nd={self.nd:g}, vd={self.vd:g}")


@value
class Sellmeier:
    r"""A glass by Sellmeier's formula, as in present catalogues.

    .. math:: n^2 = 1 + \sum_i \frac{B_i \lambda^2}{\lambda^2 - C_i}

    Parameters
    ----------
    b : sequence of float
        B_i, without unit.
    c : sequence of float
        C_i in square micrometres, as many as `b`.
    name : str, optional
        Description, for instance "N-BK7".
    wavelength_range : (float, float), optional
        nm; outside, `index` raises an error.

    Raises
    ------
    InvalidValueError
        If `b` and `c` differ in length, or the index is below 1 or not finite at both ends and the middle of the range.

    References
    ----------
    Schott, TIE-29 Refractive Index and Dispersion, eq. 1.3 and the catalogue's data sheets.

    Examples
    --------
    >>> import plenoptic as pl
    >>> bk7 = pl.Sellmeier((1.03961212, 0.231792344, 1.01046945),
    ...                    (0.00600069867, 0.0200179144, 103.560653), name="N-BK7")
    >>> round(bk7.index(587.5618), 5)
    1.5168
    """

    b: Sequence[float]
    c: Sequence[float]
    name: str = ""
    wavelength_range: tuple[float, float] = (365.0, 2325.0)

    def __post_init__(self) -> None:
        set_field(self, "b", checked_coefficients(self.b, "b"))
        set_field(self, "c", checked_coefficients(self.c, "c", len(self.b)))
        set_limits(self, self.wavelength_range)

    def index(self, wavelength: float) -> float:
        """Refractive index at a wavelength in nm; InvalidValueError outside `wavelength_range`."""

        def formula(w: float) -> float:
            square = w * w
            return math.sqrt(1.0 + sum(b * square / (square - c) for b, c in zip(self.b, self.c, strict=True)))

        return index_by_formula(formula, wavelength, self.wavelength_range, self.name or "this Sellmeier medium")


@value
class Schott:
    r"""A glass by the power series of catalogues until the 1990s (also called Laurent's formula).

    .. math:: n^2 = a_0 + a_1 \lambda^2 + a_2 \lambda^{-2} + a_3 \lambda^{-4} + a_4 \lambda^{-6} + a_5 \lambda^{-8}

    Parameters
    ----------
    coefficients : sequence of 6 floats
        a_0 to a_5, for wavelengths in micrometres.
    name, wavelength_range
        As of `Sellmeier`.

    Raises
    ------
    InvalidValueError
        If there are not six finite coefficients, or the index is below 1 or not finite at both ends and the middle of
        the range.

    Examples
    --------
    >>> import plenoptic as pl
    >>> bk7 = pl.optics.Schott(
    ...     (2.2718929, -1.0108077e-2, 1.0592509e-2, 2.0816965e-4, -7.6472538e-6, 4.9240991e-7), name="BK7")
    >>> round(bk7.index(587.5618), 4)
    1.5168
    """

    coefficients: Sequence[float]
    name: str = ""
    wavelength_range: tuple[float, float] = (365.0, 1014.0)

    def __post_init__(self) -> None:
        set_field(self, "coefficients", checked_coefficients(self.coefficients, "coefficients", 6))
        set_limits(self, self.wavelength_range)

    def index(self, wavelength: float) -> float:
        """Refractive index at a wavelength in nm; InvalidValueError outside `wavelength_range`."""

        def formula(w: float) -> float:
            square, powers = w * w, (0, 1, -1, -2, -3, -4)
            return math.sqrt(sum(a * square**power for a, power in zip(self.coefficients, powers, strict=True)))

        return index_by_formula(formula, wavelength, self.wavelength_range, self.name or "this Schott medium")
