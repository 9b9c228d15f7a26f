"""Conjugate planes for a magnification, and how wide the axial beam is in them."""

from __future__ import annotations

import math

from plenoptic.core.values import finite
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.gaussian.marginal_and_chief import ParaxialRay, marginal_ray
from plenoptic.optics.lens.gaussian.matrices import end_surfaces, over, transfer_matrix, without_rounding
from plenoptic.optics.lens.stack import LensStack


def conjugates(lens: LensStack, magnification: float, wavelength: float = 587.6) -> tuple[float, float]:
    """Object and image plane for a magnification.

    Parameters
    ----------
    lens : LensStack
    magnification : float
        Height of the image over height of the object: negative for a real image of a real object; not 0.
    wavelength : float, optional
        nm.

    Returns
    -------
    z_object, z_image : float
        In the lens frame, mm. Either may be virtual.

    Raises
    ------
    InvalidValueError
        For a magnification of 0, whose object is infinitely far, or an afocal lens, whose magnification is the same
        everywhere.

    References
    ----------
    E. Hecht, Optics, 5th ed., section 5.2.3: object f / m from the front focus, image -f m from the rear one.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2")
    >>> z_object, z_image = pl.paraxial.conjugates(lens, -1.0)
    >>> round(pl.paraxial.magnification(lens, z_object), 9), round(z_image - z_object, 2)
    (-1.0, 391.97)
    """
    first, last = end_surfaces(lens)
    m = finite(magnification, "magnification")
    ((a, _), (c, d)) = transfer_matrix(lens, wavelength, first, last).tolist()
    if m == 0:
        raise InvalidValueError("magnification is 0; it must be another number: an object at -math.inf has it")
    if c == 0:
        raise InvalidValueError(
            f"the lens {lens.name!r} is afocal, so its magnification is {a:g} for all planes; "
            "choose planes with image_position"
        )
    around = float(lens.indices(wavelength)[0])
    # 1 / m = C x / n + D with the distance x before the lens, m = A + C x' / n behind it.
    before, behind = around * (1.0 / m - d) / c, around * (m - a) / c
    return float(lens.vertices[first]) - before, float(lens.vertices[last]) + behind


def numerical_apertures(lens: LensStack, z_object: float = -math.inf, wavelength: float = 587.6) -> tuple[float, float]:
    """Numerical apertures on the side of the object and on that of the image: n u of the paraxial marginal ray.

    For a lens that obeys the sine condition n u is n sin u of the exact ray, as the engraving on an objective has it.

    Parameters
    ----------
    lens, z_object, wavelength
        See `marginal_ray`, also for errors.

    Returns
    -------
    object_side, image_side : float
        Not negative. The first is 0 for an object at infinity; second times magnification is the first.

    References
    ----------
    W. J. Smith, Modern Optical Engineering, 4th ed., section 9.7.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2")
    >>> before, behind = pl.paraxial.numerical_apertures(lens, -404.0)
    >>> round(before, 4), round(behind, 4)
    (0.0605, 0.1898)
    """
    ray = marginal_ray(lens, z_object, wavelength)
    return abs(float(ray.index[0] * ray.angle[0])), abs(leaving_aperture(lens, ray, wavelength))


def leaving_aperture(lens: LensStack, marginal: ParaxialRay, wavelength: float = 587.6) -> float:
    """N' u' of a marginal ray behind the lens: negative where light converges, exactly 0 where it leaves parallel."""
    c, d = transfer_matrix(lens, wavelength, 0, len(lens.elements) - 1)[1].tolist()
    by_height, by_angle = c * float(marginal.height[0]), d * float(marginal.index[0] * marginal.angle[0])
    return without_rounding(by_height + by_angle, by_height, by_angle)


def working_f_number(lens: LensStack, z_object: float = -math.inf, wavelength: float = 587.6) -> float:
    """1 / (2 NA) on the side of the image, with the paraxial numerical aperture; see `numerical_apertures`.

    In air and from infinity it is the f-number; inf where light leaves parallel.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2")
    >>> round(pl.paraxial.working_f_number(lens), 2), round(pl.paraxial.working_f_number(lens, -404.0), 2)
    (2.03, 2.63)
    """
    return over(0.5, numerical_apertures(lens, z_object, wavelength)[1])
