"""Gaussian optics of a lens: focal length, cardinal points, pupils and conjugates.

Everything follows from the matrix that takes height and reduced angle (y, n u) of a paraxial ray from one element to
another. Positions are z in the lens frame: mm, z = 0 at the iris, light towards +z. Scene and sensor are in air, so the
nodal points are the principal points.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from plenoptic._values import number, value, wrong_kind
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens import LensStack
from plenoptic.optics.surface import Surface

_EPS = float(np.finfo(np.float64).eps)

_LONGEST = len("entrance_pupil_semi_diameter")


@value
class CardinalPoints:
    """What Gaussian optics knows of a lens at one wavelength; made by `cardinal_points`.

    Attributes
    ----------
    efl : float
        Effective focal length, mm, positive for a lens that collects; inf for an afocal one.
    bfl, ffl : float
        Back and front focal length, mm: z of the rear focus minus z of the last surface, and z of the front focus
        minus z of the first surface. A camera lens mostly has bfl > 0 and ffl < 0.
    front_focus, rear_focus : float
        z of the focal points, mm. An afocal lens has -inf and inf.
    front_principal, rear_principal : float
        z of the principal planes, mm, which are the nodal planes too. An afocal lens has -inf and inf.
    entrance_pupil, exit_pupil : float
        z of the images of the iris through what stands before and behind it, mm; inf for a telecentric lens.
    entrance_pupil_semi_diameter, exit_pupil_semi_diameter : float
        Size of these images, mm. Other stops and the edges of the surfaces have no part in it.
    pupil_magnification : float
        Exit pupil over *iris* (not over entrance pupil); negative if the exit pupil stands upside down.
    f_number : float
        Absolute focal length over the diameter of the entrance pupil: for an object at infinity.
    wavelength : float
        nm.

    Examples
    --------
    >>> import plenoptic as pl
    >>> points = pl.paraxial.cardinal_points(pl.load_lens("double-gauss-100mm-f2"))
    >>> round(points.rear_focus - points.rear_principal, 2), round(points.pupil_magnification, 3)
    (100.72, 1.552)
    """

    efl: float
    bfl: float
    ffl: float
    front_focus: float
    rear_focus: float
    front_principal: float
    rear_principal: float
    entrance_pupil: float
    exit_pupil: float
    entrance_pupil_semi_diameter: float
    exit_pupil_semi_diameter: float
    pupil_magnification: float
    f_number: float
    wavelength: float

    def __repr__(self) -> str:
        lines = [f"CardinalPoints at {self.wavelength:g} nm"]
        for field in dataclasses.fields(self):
            if field.name != "wavelength":
                unit = "" if field.name in ("pupil_magnification", "f_number") else " mm"
                lines.append(f"  {field.name:<{_LONGEST}} {getattr(self, field.name):>12.6g}{unit}")
        return "\n".join(lines)


def _without_rounding(total: float, *terms: float, steps: int = 4) -> float:
    """`total`, or exactly 0 where it is no more than what rounding leaves of the terms it was summed from."""
    return 0.0 if abs(total) <= 2 * steps * _EPS * sum(map(abs, terms)) else total


def _over(numerator: float, denominator: float) -> float:
    return numerator / denominator if denominator != 0 else math.inf


def _matrix(lens: LensStack, wavelength: float, first: int, last: int) -> NDArray[np.float64]:
    """From before element `first` to behind element `last`; what is zero but for rounding is zero."""
    n = lens.indices(wavelength)
    matrix, magnitude = np.eye(2), np.eye(2)
    for i in range(first, last + 1):
        element = lens.elements[i]
        curvature = element.curvature if isinstance(element, Surface) else 0.0
        gap = element.thickness if i < last else 0.0
        refraction = np.array([[1.0, 0.0], [(n[i] - n[i + 1]) * curvature, 1.0]])
        transfer = np.array([[1.0, gap / n[i + 1]], [0.0, 1.0]])
        step = transfer @ refraction
        matrix, magnitude = step @ matrix, np.abs(transfer) @ np.abs(refraction) @ magnitude
    steps = 4 * (last - first + 1)
    cleaned = [
        _without_rounding(entry, size, steps=steps)
        for entry, size in zip(matrix.ravel().tolist(), magnitude.ravel().tolist(), strict=True)
    ]
    return np.array(cleaned).reshape(2, 2)


def _end_surfaces(lens: LensStack) -> tuple[int, int]:
    if not isinstance(lens, LensStack):
        raise wrong_kind(lens, "lens", "LensStack", "camera.lens")
    surfaces = [i for i, element in enumerate(lens.elements) if isinstance(element, Surface)]
    return surfaces[0], surfaces[-1]


def system_matrix(lens: LensStack, wavelength: float = 587.6) -> NDArray[np.float64]:
    """The matrix [[A, B], [C, D]] from the vertex of the first surface to that of the last.

    It takes (height in mm, angle in radians) of a paraxial ray in front of the lens to those behind it. Since there
    is air on both sides, its determinant is 1 and C is -1 / efl.

    Parameters
    ----------
    lens : LensStack
    wavelength : float, optional
        nm.

    Returns
    -------
    ndarray
        (2, 2); entries that are zero but for rounding are exactly 0.

    References
    ----------
    E. Hecht, Optics, 5th ed., section 6.2.1 (with height first here).

    Examples
    --------
    >>> import plenoptic as pl
    >>> import numpy as np
    >>> matrix = pl.paraxial.system_matrix(pl.load_lens("double-gauss-100mm-f2"))
    >>> round(float(np.linalg.det(matrix)), 12)
    1.0
    """
    return _matrix(lens, wavelength, *_end_surfaces(lens))


def cardinal_points(lens: LensStack, wavelength: float = 587.6) -> CardinalPoints:
    """Focal length, focal points, principal planes, pupils and f-number of a lens.

    Parameters
    ----------
    lens : LensStack
    wavelength : float, optional
        nm.

    Returns
    -------
    CardinalPoints

    Raises
    ------
    InvalidValueError
        If a medium of the lens is not defined at that wavelength.

    References
    ----------
    W. J. Smith, Modern Optical Engineering, 4th ed., chapters 2 and 9.

    Examples
    --------
    >>> import plenoptic as pl
    >>> round(pl.paraxial.cardinal_points(pl.load_lens("double-gauss-100mm-f2"), wavelength=587.6).efl, 2)
    100.72
    """
    first, last = _end_surfaces(lens)
    z = lens.vertices
    ((a, _), (c, d)) = system_matrix(lens, wavelength).tolist()
    focal = c != 0
    efl = -1.0 / c if focal else math.inf
    bfl, ffl = (-a / c, d / c) if focal else (math.inf, -math.inf)
    front_focus, rear_focus = float(z[first]) + ffl, float(z[last]) + bfl

    # The iris, at z = 0, seen through what stands before it and behind it.
    front = _matrix(lens, wavelength, 0, lens.iris_index)
    rear = _matrix(lens, wavelength, lens.iris_index, len(z) - 1)
    entrance_pupil = float(z[0]) + _over(float(front[0, 1]), float(front[0, 0]))
    exit_pupil = float(z[-1]) + _over(-float(rear[0, 1]), float(rear[1, 1]))
    magnification = _over(1.0, float(rear[1, 1]))
    semi_diameter = lens.stop.semi_diameter
    entrance_semi_diameter = abs(_over(semi_diameter, float(front[0, 0])))
    return CardinalPoints(
        efl=efl,
        bfl=bfl,
        ffl=ffl,
        front_focus=front_focus,
        rear_focus=rear_focus,
        front_principal=front_focus + efl if focal else -math.inf,
        rear_principal=rear_focus - efl if focal else math.inf,
        entrance_pupil=entrance_pupil,
        exit_pupil=exit_pupil,
        entrance_pupil_semi_diameter=entrance_semi_diameter,
        exit_pupil_semi_diameter=abs(magnification) * semi_diameter,
        pupil_magnification=magnification,
        f_number=abs(efl) / (2 * entrance_semi_diameter) if focal else math.inf,
        wavelength=float(wavelength),
    )


def _position(z: float, name: str) -> float:
    position = number(z, name)
    if math.isnan(position):
        raise InvalidValueError(f"{name} is nan; it must be a position in mm, math.inf for infinitely far away")
    return position


def image_position(lens: LensStack, z_object: float, wavelength: float = 587.6) -> float:
    """Where the lens images a plane: z in mm, in the lens frame.

    Parameters
    ----------
    lens : LensStack
    z_object : float
        z of the object plane, mm; negative in front of the iris, -inf for the horizon. A plane behind the first
        surface is a virtual object.
    wavelength : float, optional
        nm.

    Returns
    -------
    float
        z of the image plane; inf where the rays leave parallel. In front of the last surface it is virtual.

    Examples
    --------
    >>> import plenoptic as pl
    >>> round(pl.paraxial.image_position(pl.load_lens("double-gauss-100mm-f2"), -404.0), 3)
    134.624
    """
    first, last = _end_surfaces(lens)
    ((a, b), (c, d)) = system_matrix(lens, wavelength).tolist()
    z_last, distance = float(lens.vertices[last]), float(lens.vertices[first]) - _position(z_object, "z_object")
    if math.isinf(distance):
        return z_last + _over(-a, c)
    return z_last + _over(-(a * distance + b), _without_rounding(c * distance + d, c * distance, d))


def object_position(lens: LensStack, z_image: float, wavelength: float = 587.6) -> float:
    """Which plane the lens images to z_image: z in mm, in the lens frame; the inverse of `image_position`.

    Parameters
    ----------
    lens : LensStack
    z_image : float
        z of the image plane, mm; inf where the rays leave parallel.
    wavelength : float, optional
        nm.

    Returns
    -------
    float
        z of the object plane; -inf for the horizon.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2")
    >>> round(pl.paraxial.object_position(lens, pl.paraxial.image_position(lens, -404.0)), 9)
    -404.0
    """
    first, last = _end_surfaces(lens)
    ((a, b), (c, d)) = system_matrix(lens, wavelength).tolist()
    z_first, distance = float(lens.vertices[first]), _position(z_image, "z_image") - float(lens.vertices[last])
    if math.isinf(distance):
        return z_first - _over(-d, c)
    return z_first - _over(-(b + distance * d), _without_rounding(a + distance * c, a, distance * c))


def magnification(lens: LensStack, z_object: float, wavelength: float = 587.6) -> float:
    """Height of the image over height of the object, negative for an image that stands upside down.

    Parameters
    ----------
    lens : LensStack
    z_object : float
        z of the object plane, mm, in the lens frame; -inf for the horizon.
    wavelength : float, optional
        nm.

    Returns
    -------
    float
        0 for an object infinitely far from a lens that has a focal length, inf for one in its front focus.

    Examples
    --------
    >>> import plenoptic as pl
    >>> round(pl.paraxial.magnification(pl.load_lens("double-gauss-100mm-f2"), -404.0), 4)
    -0.3187
    """
    first, _ = _end_surfaces(lens)
    c, d = system_matrix(lens, wavelength)[1].tolist()
    distance = float(lens.vertices[first]) - _position(z_object, "z_object")
    if math.isinf(distance):
        return 0.0 if c != 0 else 1.0 / d
    return _over(1.0, _without_rounding(c * distance + d, c * distance, d))
