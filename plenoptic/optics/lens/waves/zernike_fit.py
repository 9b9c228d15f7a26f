"""Zernike polynomials over the unit disc, in two orders, and fits of them."""

from __future__ import annotations

import enum
import math

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.display import picture_of
from plenoptic.core.values import Floats, choice, frozen_array, result, whole
from plenoptic.errors import InvalidValueError
from plenoptic.optics.surfaces.zernike import MAX_TERMS, ZernikeSag, degree_and_order

_NAMES = {
    (0, 0): "piston",
    (1, 1): "tilt x",
    (1, -1): "tilt y",
    (2, 0): "defocus",
    (2, 2): "astigmatism",
    (2, -2): "oblique astigmatism",
    (3, 1): "coma x",
    (3, -1): "coma y",
    (3, 3): "trefoil x",
    (3, -3): "trefoil y",
    (4, 0): "spherical",
    (4, 2): "secondary astigmatism",
    (4, -2): "oblique secondary astigmatism",
    (4, 4): "tetrafoil",
    (4, -4): "oblique tetrafoil",
    (5, 1): "secondary coma x",
    (5, -1): "secondary coma y",
    (6, 0): "secondary spherical",
}
_MOST_FRINGE = 37


class ZernikeOrder(enum.IntEnum):
    """Numbering and scale of Zernike polynomials.

    NOLL: by degree, with a mean square of 1 over the disc (J. Opt. Soc. Am. 66, 207, 1976). FRINGE: the first 37 of
    the University of Arizona, with a value of 1 at the rim (J. C. Wyant and K. Creath, Applied Optics and Optical
    Engineering XI, 1992, table III).

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.aberrations.ZernikeOrder(1).name
    'FRINGE'
    """

    NOLL = 0
    FRINGE = 1


@result
class ZernikeFit:
    """Wavefront as a sum of Zernike polynomials. Made by `Wavefront.zernike`.

    Attributes
    ----------
    coefficients : (n,) array
        Coefficients of terms 1, 2, ... in waves.
    order : ZernikeOrder
    residual : float
        Root mean square residual of the fit, waves.
    """

    coefficients: Floats
    order: ZernikeOrder
    residual: float

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the terms; degree n and order m for terms without a usual name."""
        places = [_place(j, self.order) for j in range(1, len(self.coefficients) + 1)]
        return tuple(_NAMES.get(place, f"n {place[0]}, m {place[1]}") for place in places)

    def __getitem__(self, term: int | str) -> float:
        """Coefficient of a term, by its number from 1 on or by its name."""
        if isinstance(term, str):
            if term not in self.names:
                raise InvalidValueError(f"{term!r} is no term of the fit; it has {', '.join(self.names)}")
            return float(self.coefficients[self.names.index(term)])
        return float(self.coefficients[whole(term, "term", at_least=1, at_most=len(self.coefficients)) - 1])

    def __repr__(self) -> str:
        rows = [
            f"  {j:>3} {a:>10.4f}  {name}"
            for j, (a, name) in enumerate(zip(self.coefficients, self.names, strict=True), start=1)
            if abs(a) >= 5e-5
        ]
        head = f"ZernikeFit, {self.order.name} order, waves; residual {self.residual:.2g} RMS"
        return "\n".join([head, *rows])

    _repr_html_ = picture_of


def zernike(term: int, x: ArrayLike, y: ArrayLike, *, order: ZernikeOrder = ZernikeOrder.NOLL) -> Floats:
    """A Zernike polynomial at points of the unit disc.

    Parameters
    ----------
    term : int
        Number of the term, from 1 on: up to 91 in NOLL, 37 in FRINGE order.
    x, y : arrays
        Coordinates, arrays of the same shape.
    order : ZernikeOrder, optional

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.aberrations.zernike(4, [0.0, 1.0], [0.0, 0.0]).round(4).tolist()
    [-1.7321, 1.7321]
    """
    kind = choice(order, ZernikeOrder, "order")
    term_count = MAX_TERMS if kind is ZernikeOrder.NOLL else _MOST_FRINGE
    n, m = _place(whole(term, "term", at_least=1, at_most=term_count), kind)
    noll = n * (n + 1) // 2 + 1
    while degree_and_order(noll) != (n, m):
        noll += 1
    one = ZernikeSag([*[0.0] * (noll - 1), 1.0], 1.0)
    values = one.sag(x, y) + one.offset
    return values if kind is ZernikeOrder.NOLL else values / math.sqrt((n + 1) * (1 if m == 0 else 2))


def _place(term: int, order: ZernikeOrder) -> tuple[int, int]:
    """Degree n and azimuthal order m of a term."""
    if order is ZernikeOrder.NOLL:
        return degree_and_order(term)
    if term == _MOST_FRINGE:  # the series formula would continue with m = 6
        return 12, 0
    # Term (1 + (n + |m|) / 2)^2 - 2 |m| + (1 if m < 0) has degree n and order m; (n + |m|) / 2 is the group.
    group = math.isqrt(term - 1)
    left = term - group * group - 1  # from |m| = group downwards, cosines before sines
    m = group - left // 2
    return 2 * group - m, -m if left % 2 and m else m


def fit_zernike(
    points: Floats, values: Floats, weight: Floats, terms: int, order: ZernikeOrder = ZernikeOrder.NOLL
) -> ZernikeFit:
    """Least-squares fit of terms 1 ... `terms` to values at points (n, 2), with weights (n,)."""
    if len(values) < terms:
        raise InvalidValueError(
            f"terms is {terms}, and {len(values)} rays pass the lens; give more points or fewer terms"
        )
    columns = np.stack([zernike(j, points[:, 0], points[:, 1], order=order) for j in range(1, terms + 1)], axis=1)
    scale = np.sqrt(weight / weight.sum())
    coefficients = np.linalg.lstsq(columns * scale[:, None], values * scale, rcond=None)[0]
    residual = math.sqrt(float((scale**2) @ (values - columns @ coefficients) ** 2))
    return ZernikeFit(frozen_array(coefficients, name="coefficients", shape=(None,)), order, residual)
