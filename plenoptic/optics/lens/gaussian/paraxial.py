"""Gaussian optics of a lens: focal length, cardinal points, pupils, conjugates, numerical apertures.

All quantities follow from the ray transfer matrix for height and reduced angle (y, n u) of a paraxial ray. Positions
are z in the lens frame: mm, z = 0 at the iris, light towards +z. The scene is in a medium of index n,
`lens.front_medium`, the sensor in one of index n', `lens.rear_medium`. Aspheres have their vertex curvature. Decentred
and tilted elements count as centred. `lens.model` has no effect.
"""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

import numpy as np

from plenoptic.core.values import Floats, finite, value
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.gaussian.marginal_and_chief import ParaxialRay, marginal_ray
from plenoptic.optics.lens.gaussian.matrices import end_surfaces, over, position, transfer_matrix, without_rounding

if TYPE_CHECKING:
    from plenoptic.optics.lens.stack import LensStack

_LONGEST = len("entrance_pupil_semi_diameter")
_UNITS = {"pupil_magnification": "", "f_number": "", "power": " 1/mm"}


@value
class CardinalPoints:
    """Cardinal points of a lens at one wavelength. Made by `cardinal_points`.

    Attributes
    ----------
    efl : float
        Effective focal length f' in the rear medium, mm, from the rear principal plane to the rear focus: positive for
        a converging lens, inf for an afocal one. In media of index n and n' it is n' / `power`.
    front_efl : float
        Focal length f in the front medium, mm, from the front focus to the front principal plane: n / `power`.
    power : float
        Power in 1/mm: n' / f' = n / f; 0 for an afocal lens. Its inverse is the focal length in air of some programs.
    bfl, ffl : float
        Back and front focal length, mm: z of the rear focus minus z of the last surface, and z of the front focus
        minus z of the first surface. A camera lens mostly has bfl > 0 and ffl < 0.
    front_focus, rear_focus : float
        z of the focal points, mm. An afocal lens has -inf and inf.
    front_principal, rear_principal : float
        z of the principal planes, mm. An afocal lens has -inf and inf.
    front_nodal, rear_nodal : float
        z of the nodal points, mm: a ray towards the front one leaves from the rear one in its own direction. With one
        medium on both sides they are the principal points.
    entrance_pupil, exit_pupil : float
        z of the images of the iris through the elements before and behind it, mm; inf for a telecentric lens.
    entrance_pupil_semi_diameter, exit_pupil_semi_diameter : float
        Paraxial semi-diameters of these images, mm, regardless of other stops and rims.
    pupil_magnification : float
        Exit pupil over *iris* (not over entrance pupil); negative if the exit pupil is inverted.
    f_number : float
        Absolute `efl` over the diameter of the entrance pupil: for an object at infinity.
    wavelength : float
        nm.
    """

    efl: float
    front_efl: float
    power: float
    bfl: float
    ffl: float
    front_focus: float
    rear_focus: float
    front_principal: float
    rear_principal: float
    front_nodal: float
    rear_nodal: float
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
                unit = _UNITS.get(field.name, " mm")
                lines.append(f"  {field.name:<{_LONGEST}} {getattr(self, field.name):>12.6g}{unit}")
        return "\n".join(lines)


def system_matrix(lens: LensStack, wavelength: float = 587.6) -> Floats:
    """Ray transfer matrix [[A, B], [C, D]] from the vertex of the first surface to that of the last.

    It maps (height in mm, angle in radians) of a paraxial ray in front of the lens to those behind it. C is -1 / efl,
    and the determinant is n / n', the ratio of the indices in front and behind. Entries within rounding error of 0 are
    exactly 0.

    Parameters
    ----------
    lens, wavelength
        See `cardinal_points`.

    References
    ----------
    E. Hecht, Optics, 5th ed., section 6.2.1 (with height first here).

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> round(float(np.linalg.det(pl.paraxial.system_matrix(pl.load_lens("double-gauss-100mm-f2")))), 12)
    1.0
    """
    first, last = end_surfaces(lens)
    front_index, rear_index = outer_indices(lens, wavelength)
    ((a, b), (c, d)) = transfer_matrix(lens, wavelength, first, last).tolist()
    return np.array([[a, b * front_index], [c / rear_index, d * (front_index / rear_index)]])


def outer_indices(lens: LensStack, wavelength: float) -> tuple[float, float]:
    """Refractive indices in front of the lens and behind it."""
    indices = lens.indices(wavelength)
    return float(indices[0]), float(indices[-1])


def cardinal_points(lens: LensStack, wavelength: float = 587.6) -> CardinalPoints:
    """Focal length, focal points, principal planes, pupils and f-number of a lens.

    Parameters
    ----------
    lens : LensStack
    wavelength : float, optional
        nm.

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
    >>> points = pl.paraxial.cardinal_points(pl.load_lens("double-gauss-100mm-f2"), wavelength=587.6)
    >>> round(points.efl, 2), round(points.rear_focus - points.rear_principal, 2), round(points.pupil_magnification, 3)
    (100.72, 100.72, 1.552)
    """
    first, last = end_surfaces(lens)
    z = lens.vertices
    ((a, _), (c, d)) = system_matrix(lens, wavelength).tolist()
    focal = c != 0
    front_index, rear_index = outer_indices(lens, wavelength)
    efl = -1.0 / c if focal else math.inf
    front_efl = efl * (front_index / rear_index)
    bfl, ffl = (-a / c, d / c) if focal else (math.inf, -math.inf)
    front_focus, rear_focus = float(z[first]) + ffl, float(z[last]) + bfl

    # Images of the iris, at z = 0, by the elements before it and behind it.
    front = transfer_matrix(lens, wavelength, 0, lens.iris_index)
    rear = transfer_matrix(lens, wavelength, lens.iris_index, len(z) - 1)
    entrance_pupil = float(z[0]) + over(front_index * float(front[0, 1]), float(front[0, 0]))
    exit_pupil = float(z[-1]) + over(-rear_index * float(rear[0, 1]), float(rear[1, 1]))
    magnification = over(1.0, float(rear[1, 1]))
    semi_diameter = lens.stop.semi_diameter
    entrance_semi_diameter = abs(over(semi_diameter, float(front[0, 0])))
    return CardinalPoints(
        efl=efl,
        front_efl=front_efl,
        power=rear_index / efl,
        bfl=bfl,
        ffl=ffl,
        front_focus=front_focus,
        rear_focus=rear_focus,
        front_principal=front_focus + front_efl if focal else -math.inf,
        rear_principal=rear_focus - efl if focal else math.inf,
        front_nodal=front_focus + efl if focal else -math.inf,
        rear_nodal=rear_focus - front_efl if focal else math.inf,
        entrance_pupil=entrance_pupil,
        exit_pupil=exit_pupil,
        entrance_pupil_semi_diameter=entrance_semi_diameter,
        exit_pupil_semi_diameter=abs(magnification) * semi_diameter,
        pupil_magnification=magnification,
        f_number=over(abs(efl), 2 * entrance_semi_diameter) if focal else math.inf,
        wavelength=float(wavelength),
    )


def _image_distance(matrix: list[list[float]], distance: float) -> float:
    """Image distance behind a system, in mm, for an object distance in front of it."""
    (a, b), (c, d) = matrix
    if math.isinf(distance):
        return over(-a, c)
    return over(-(a * distance + b), without_rounding(c * distance + d, c * distance, d))


def image_position(lens: LensStack, z_object: float, wavelength: float = 587.6) -> float:
    """Image position of an object plane: z in mm, in the lens frame.

    Parameters
    ----------
    lens, wavelength
        See `cardinal_points`.
    z_object : float
        z of the object plane, mm; negative in front of the iris, -inf at infinity. A plane behind the first surface is
        a virtual object.

    Returns
    -------
    float
        z of the image plane; inf if the emerging rays are parallel. In front of the last surface the image is virtual.

    Examples
    --------
    >>> import plenoptic as pl
    >>> round(pl.paraxial.image_position(pl.load_lens("double-gauss-100mm-f2"), -404.0), 3)
    134.624
    """
    first, last = end_surfaces(lens)
    distance = float(lens.vertices[first]) - position(z_object, "z_object")
    return float(lens.vertices[last]) + _image_distance(system_matrix(lens, wavelength).tolist(), distance)


def object_position(lens: LensStack, z_image: float, wavelength: float = 587.6) -> float:
    """Object position for an image plane: z in mm, in the lens frame; the inverse of `image_position`.

    z_image is inf for parallel emerging rays; the result is -inf for an object plane at infinity.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2")
    >>> round(pl.paraxial.object_position(lens, pl.paraxial.image_position(lens, -404.0)), 9)
    -404.0
    """
    first, last = end_surfaces(lens)
    ((a, b), (c, d)) = system_matrix(lens, wavelength).tolist()
    distance = position(z_image, "z_image") - float(lens.vertices[last])
    return float(lens.vertices[first]) - _image_distance([[d, b], [c, a]], distance)


def magnification(lens: LensStack, z_object: float, wavelength: float = 587.6) -> float:
    """Lateral magnification: image height over object height, negative for an inverted image.

    Parameters
    ----------
    lens, z_object, wavelength
        See `image_position`.

    Returns
    -------
    float
        0 for an object at infinity and a lens with a focal length; inf for an object in the front focus.

    Examples
    --------
    >>> import plenoptic as pl
    >>> round(pl.paraxial.magnification(pl.load_lens("double-gauss-100mm-f2"), -404.0), 4)
    -0.3187
    """
    first, _ = end_surfaces(lens)
    c, d = system_matrix(lens, wavelength)[1].tolist()
    front_index, rear_index = outer_indices(lens, wavelength)
    determinant = front_index / rear_index
    distance = float(lens.vertices[first]) - position(z_object, "z_object")
    if math.isinf(distance):
        return 0.0 if c != 0 else determinant / d
    return over(determinant, without_rounding(c * distance + d, c * distance, d))


def conjugates(lens: LensStack, magnification: float, wavelength: float = 587.6) -> tuple[float, float]:
    """Conjugate planes: object and image plane for a lateral magnification.

    Parameters
    ----------
    lens, wavelength
        See `cardinal_points`.
    magnification : float
        Height of the image over height of the object: negative for a real image of a real object; not 0.

    Returns
    -------
    z_object, z_image : float
        In the lens frame, mm. Either may be virtual.

    Raises
    ------
    InvalidValueError
        For a magnification of 0, whose object is at infinity, or an afocal lens, whose magnification is constant.

    References
    ----------
    E. Hecht, Optics, 5th ed., section 5.2.3: object f / m from the front focus, image -f' m from the rear one.

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
    front_index, rear_index = outer_indices(lens, wavelength)
    # 1 / m = C x / n + D with the distance x before the lens, m = A + C x' / n' behind it.
    before, behind = front_index * (1.0 / m - d) / c, rear_index * (m - a) / c
    return float(lens.vertices[first]) - before, float(lens.vertices[last]) + behind


def numerical_apertures(lens: LensStack, z_object: float = -math.inf, wavelength: float = 587.6) -> tuple[float, float]:
    """Numerical apertures in object space and in image space: n u of the paraxial marginal ray.

    For a lens that fulfils the sine condition, n u is n sin u of the real ray, the value engraved on an objective.

    Parameters
    ----------
    lens, z_object, wavelength
        See `marginal_ray`, also for its errors.

    Returns
    -------
    object_side, image_side : float
        Not negative. `object_side` is 0 for an object at infinity; it is `image_side` times the absolute magnification.

    References
    ----------
    W. J. Smith, Modern Optical Engineering, 4th ed., section 9.7.

    Examples
    --------
    >>> import plenoptic as pl
    >>> before, behind = pl.paraxial.numerical_apertures(pl.load_lens("double-gauss-100mm-f2"), -404.0)
    >>> round(before, 4), round(behind, 4)
    (0.0605, 0.1898)
    """
    ray = marginal_ray(lens, z_object, wavelength)
    return abs(float(ray.index[0] * ray.angle[0])), abs(image_side_aperture(lens, ray, wavelength))


def image_side_aperture(lens: LensStack, marginal: ParaxialRay, wavelength: float = 587.6) -> float:
    """Product n' u' of a marginal ray behind the lens: negative for converging light, exactly 0 if it is collimated."""
    c, d = transfer_matrix(lens, wavelength, 0, len(lens.elements) - 1)[1].tolist()
    by_height, by_angle = c * float(marginal.height[0]), d * float(marginal.index[0] * marginal.angle[0])
    return without_rounding(by_height + by_angle, by_height, by_angle)


def working_f_number(lens: LensStack, z_object: float = -math.inf, wavelength: float = 587.6) -> float:
    """Working f-number 1 / (2 NA'), with the paraxial numerical aperture NA' in image space; see `numerical_apertures`.

    For a sensor in air and an object at infinity it is the f-number; inf if the emerging light is collimated.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2")
    >>> round(pl.paraxial.working_f_number(lens), 2), round(pl.paraxial.working_f_number(lens, -404.0), 2)
    (2.03, 2.63)
    """
    return over(0.5, numerical_apertures(lens, z_object, wavelength)[1])
