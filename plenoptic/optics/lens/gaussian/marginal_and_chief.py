"""Paraxial rays through a lens: the marginal ray and the chief ray."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from plenoptic.core.values import Floats, check_has, finite, number, result
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.gaussian.matrices import bending, end_surfaces, transfer_matrix, without_rounding

if TYPE_CHECKING:
    from plenoptic.optics.lens.stack import LensStack


@result
class ParaxialRay:
    """Paraxial ray through a lens: heights at the elements and angles between them. Made by `paraxial_ray`.

    Attributes
    ----------
    height : (n,) array
        At each element, mm.
    angle : (n + 1,) array
        Slope before the first element and behind each element, radians; positive if the height increases towards +z.
    index : (n + 1,) array
        Refractive index before the first element and behind each element.
    """

    height: Floats
    angle: Floats
    index: Floats


def paraxial_ray(lens: LensStack, *, height: float, angle: float, wavelength: float = 587.6) -> ParaxialRay:
    """Trace a paraxial ray from its height at the first element and its angle in front of it.

    Parameters
    ----------
    lens : LensStack
    height : float
        At the vertex of the first element, mm.
    angle : float
        Slope in front of the lens, radians.
    wavelength : float, optional
        nm.

    References
    ----------
    W. J. Smith, Modern Optical Engineering, 4th ed., section 3.2: y' = y + t u, n' u' = n u - y (n' - n) c.

    Examples
    --------
    >>> import plenoptic as pl
    >>> ray = pl.paraxial.paraxial_ray(pl.load_lens("double-gauss-100mm-f2"), height=1.0, angle=0.0)
    >>> round(-1.0 / float(ray.angle[-1]), 2)           # the focal length
    100.72
    """
    end_surfaces(lens)
    n = np.asarray(lens.indices(wavelength))
    y, u = finite(height, "height"), finite(angle, "angle")
    heights, angles = [], [u]
    for i, element in enumerate(lens.elements):
        heights.append(y)
        step, curvature = bending(lens, n, i)
        u = (n[i] * u - y * step * curvature) / n[i + 1]
        angles.append(u)
        y = y + element.thickness * u
    return ParaxialRay(np.array(heights), np.array(angles), n)


def _to_iris(lens: LensStack, wavelength: float) -> tuple[float, float]:
    """Heights at the iris of the rays with (height, angle) = (1, 0) and (0, 1) at the first element; 0 is exact."""
    end_surfaces(lens)
    per_height, per_reduced_angle = transfer_matrix(lens, wavelength, 0, lens.iris_index)[0].tolist()
    return per_height, per_reduced_angle * float(lens.indices(wavelength)[0])


def _distance(lens: LensStack, z_object: float) -> float:
    """Distance from the object plane to the first element in mm; inf for an object at infinity."""
    z = number(z_object, "z_object")
    distance = float(lens.vertices[0]) - z
    if not distance > 0:
        raise InvalidValueError(
            f"z_object is {z:g} mm; the object must lie in front of the first element, at z below {lens.vertices[0]:g}"
        )
    return distance


def marginal_ray(lens: LensStack, z_object: float = -math.inf, wavelength: float = 587.6) -> ParaxialRay:
    """Marginal ray: the paraxial ray from the axial object point through the rim of the iris.

    Parameters
    ----------
    lens : LensStack
    z_object : float, optional
        z of the object plane in the lens frame, mm, in front of the lens; -inf for an object at infinity.
    wavelength : float, optional
        nm.

    Returns
    -------
    ParaxialRay
        Its height at the iris is lens.stop.semi_diameter in magnitude, and it is positive at the first element.

    Raises
    ------
    InvalidValueError
        If the object lies behind the first element, or its image in the iris, where all rays of the axial point have
        height 0.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2")
    >>> ray = pl.paraxial.marginal_ray(lens, z_object=-404.0)
    >>> round(float(ray.height[lens.iris_index]), 6) == lens.stop.semi_diameter
    True
    """
    iris_a, iris_b = _to_iris(lens, wavelength)
    distance = _distance(lens, z_object)
    # At infinity the angle is 0; for a finite object, height over angle is the distance.
    height, angle = (1.0, 0.0) if math.isinf(distance) else (distance, 1.0)
    at_iris = without_rounding(height * iris_a + angle * iris_b, height * iris_a, angle * iris_b)
    if at_iris == 0:
        raise InvalidValueError(
            f"the lens images z_object = {z_object:g} mm onto its iris, so it has no marginal ray; "
            "choose another object plane"
        )
    scale = lens.stop.semi_diameter / abs(at_iris)
    return paraxial_ray(lens, height=scale * height, angle=scale * angle, wavelength=wavelength)


def chief_ray(lens: LensStack, field: float, z_object: float = -math.inf, wavelength: float = 587.6) -> ParaxialRay:
    """Chief ray: the paraxial ray from an off-axis object point through the centre of the iris.

    Parameters
    ----------
    lens, z_object, wavelength
        See `marginal_ray`.
    field : float
        Object at infinity: angle in radians between axis and ray, whose slope is the tangent of it. Finite object: its
        height in mm. An object point above the axis has a positive field and a chief ray of negative slope.

    Raises
    ------
    InvalidValueError
        If the object is not in front of the lens, the field of an object at infinity is 90 degrees or more, or the
        entrance pupil lies in the object plane.

    Examples
    --------
    >>> import math, plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2")
    >>> ray = pl.paraxial.chief_ray(lens, math.radians(10.0))
    >>> abs(float(ray.height[lens.iris_index])) < 1e-12
    True
    """
    iris_a, iris_b = _to_iris(lens, wavelength)
    distance, size = _distance(lens, z_object), finite(field, "field")
    if math.isinf(distance):
        if not abs(size) < math.pi / 2:
            raise InvalidValueError(f"field is {size:g} rad; a paraxial chief ray needs less than pi / 2")
        if iris_a == 0:
            raise InvalidValueError("the entrance pupil is at infinity; give an object plane at a finite z_object")
        angle = -math.tan(size)
        return paraxial_ray(lens, height=-angle * iris_b / iris_a, angle=angle, wavelength=wavelength)
    # At the first element y = field + angle * distance; at the iris 0.
    through = without_rounding(iris_b + distance * iris_a, iris_b, distance * iris_a)
    if through == 0:
        raise InvalidValueError(
            f"the entrance pupil lies in the object plane z_object = {z_object:g} mm; choose another plane"
        )
    angle = -size * iris_a / through
    # The height is size + angle * distance, computed without cancellation.
    return paraxial_ray(lens, height=size * iris_b / through, angle=angle, wavelength=wavelength)


def lagrange_invariant(marginal: ParaxialRay, chief: ParaxialRay) -> float:
    """Lagrange invariant H = n (u y_chief - u_chief y) in mm, which is constant through a lens.

    Parameters
    ----------
    marginal, chief : ParaxialRay
        Rays of the same lens, wavelength and object plane.

    References
    ----------
    W. T. Welford, Aberrations of Optical Systems, 1986: the Lagrange invariant.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2")
    >>> marginal, chief = pl.paraxial.marginal_ray(lens), pl.paraxial.chief_ray(lens, 0.2)
    >>> round(pl.paraxial.lagrange_invariant(marginal, chief), 4)
    5.0282
    """
    for name, ray in (("marginal", marginal), ("chief", chief)):
        check_has(ray, name, "ParaxialRay", f"pl.paraxial.{name}_ray(lens)", "index", "angle", "height")
    return float(marginal.index[0] * (marginal.angle[0] * chief.height[0] - chief.angle[0] * marginal.height[0]))
