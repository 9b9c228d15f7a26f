"""Gaussian optics of a camera: exit pupil, cone of light, conjugate planes, focusing, and the camera's kind.

All of it is on the axis of the camera as designed: placements of the array and the sensor do not matter.
"""

from __future__ import annotations

import enum
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from plenoptic.camera.units import metres_hint
from plenoptic.core.values import number, whole
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.analysis.best_focus import best_focus, front_focus, paraxial_focus
from plenoptic.optics.lens.gaussian.matrices import over, transfer_matrix
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points, magnification, object_position
from plenoptic.optics.lens.models import FocusCriterion, LensModel
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.microlens.aperture import Walls
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera

SAME_FOCUS = 1e-9
"""Relative difference of b and f up to which microlenses count as focused at infinity, as in `focused_at`."""
_NEAREST = 64
"""Microlenses around the axis whose neighbours count in a FREE lattice."""


class CameraKind(enum.IntEnum):
    """Kind of a camera, by the position of the image that its microlenses relay.

    Examples
    --------
    >>> import plenoptic as pl
    >>> [kind.name for kind in pl.CameraKind]
    ['CONVENTIONAL', 'PLENOPTIC_1', 'KEPLERIAN', 'GALILEAN', 'CAMERA_ARRAY']
    """

    CONVENTIONAL = 0
    """No microlenses: the main lens images onto the sensor."""
    PLENOPTIC_1 = 1
    """Microlenses focused at infinity; the main lens images onto the array (R. Ng et al. 2005)."""
    KEPLERIAN = 2
    """Focused plenoptic camera whose image lies in front of the array: real."""
    GALILEAN = 3
    """Focused plenoptic camera whose image would lie behind the array: virtual."""
    CAMERA_ARRAY = 4
    """Microlenses without a main lens (LensModel.NONE): they see the scene itself."""


def model_pupil(camera: PlenopticCamera) -> tuple[float, float]:
    """Position z of the exit pupil in the lens's axes in mm, inf for a telecentric lens, and its magnification.

    By the lens's model. The magnification is pupil over iris, negative for an inverted pupil.
    """
    lens = camera.lens
    if lens.model is LensModel.NONE:
        return 0.0, 1.0
    points = cardinal_points(lens, camera.wavelength)
    if lens.model is LensModel.THIN:
        return points.rear_principal, points.entrance_pupil_semi_diameter / lens.stop.semi_diameter
    return points.exit_pupil, points.pupil_magnification


class Cone(NamedTuple):
    """Cone of light through the iris at a point of the axis behind the lens, by Gaussian optics."""

    vergence: float
    """Inverse distance from the exit pupil to the point in 1/mm; 0 for a telecentric lens."""
    slope: float
    """Slope of the marginal ray: radius of the exit pupil over that distance; 1 / (2 slope) is the f-number."""


def paraxial_cone(lens: LensStack, z: float, wavelength: float) -> Cone:
    """Cone of light at z on the axis, by the lens's model.

    With y' = A y + B n u, n' u' = C y + D n u from the iris to the last element, and the distance t from there to z,
    the marginal rays from the rim h of the iris have the slope h / (n' B + t D). The exit pupil is at the distance
    (n' B + t D) / D.
    """
    if lens.model is LensModel.NONE:
        return Cone(1.0 / z, lens.stop.semi_diameter / z)
    if lens.model is LensModel.THIN:
        points = cardinal_points(lens, wavelength)
        distance = z - points.rear_principal
        return Cone(1.0 / distance, abs(points.entrance_pupil_semi_diameter / distance))
    last = len(lens.elements) - 1
    (_, b), (_, d) = transfer_matrix(lens, wavelength, lens.iris_index, last).tolist()
    across = float(lens.indices(wavelength)[-1]) * b + (z - float(lens.vertices[-1])) * d
    return Cone(d / across, abs(lens.stop.semi_diameter / across))


def camera_cone(camera: PlenopticCamera) -> Cone:
    """Cone of light at the array, or at the sensor without microlenses; with walls, the field of one microlens."""
    array = camera.microlenses
    if array is not None and array.walls is Walls.OPAQUE:
        # Each microlens is a separate camera, whose field ends at the walls.
        return Cone(0.0, neighbour_distance(array) / (2 * camera.microlenses_to_sensor))
    return paraxial_cone(camera.lens, camera.stop_to_microlenses, camera.wavelength)


def object_plane(lens: LensStack, z_image: float, wavelength: float) -> float:
    """Position z of the plane conjugate to z_image, by the lens's model; z_image itself with LensModel.NONE."""
    if lens.model is LensModel.NONE:
        return -math.inf if math.isinf(z_image) else z_image
    if lens.model is not LensModel.THIN:
        return object_position(lens, z_image, wavelength)
    points = cardinal_points(lens, wavelength)
    return points.rear_principal - points.front_efl - over(points.efl * points.front_efl, z_image - points.rear_focus)


def image_plane(lens: LensStack, z_object: float, wavelength: float) -> float:
    """Position z of the image of the plane z_object, the inverse of `object_plane`; nan for nan."""
    without = lens.model is LensModel.NONE or math.isnan(z_object)
    return z_object if without else paraxial_focus(lens, z_object, wavelength)


def lateral_magnification(lens: LensStack, z_object: float, wavelength: float) -> float:
    """Lateral magnification of the main lens, image over object, by its model; 1 with LensModel.NONE."""
    if lens.model is LensModel.NONE:
        return 1.0
    if lens.model is not LensModel.THIN:
        return magnification(lens, z_object, wavelength)
    points = cardinal_points(lens, wavelength)
    return (points.rear_focus - paraxial_focus(lens, z_object, wavelength)) / points.efl


def kind_of(camera: PlenopticCamera, focal_length: float | None) -> CameraKind:
    """Kind of a camera through its microlenses of one focal length; None: without microlenses."""
    if focal_length is None:
        return CameraKind.CONVENTIONAL
    if camera.lens.model is LensModel.NONE:
        return CameraKind.CAMERA_ARRAY
    image = sharp_image(camera, focal_length)
    if image == 0:
        return CameraKind.PLENOPTIC_1
    return CameraKind.GALILEAN if image > 0 else CameraKind.KEPLERIAN


def sharp_image(camera: PlenopticCamera, focal_length: float | None) -> float:
    """Distance s in mm behind the array of the plane in focus of the microlenses.

    -inf for a camera array focused at infinity.
    """
    if focal_length is None:
        return 0.0
    b = camera.microlenses_to_sensor
    if math.isclose(b, focal_length, rel_tol=SAME_FOCUS):
        return -math.inf if camera.lens.model is LensModel.NONE else 0.0
    return b * focal_length / (focal_length - b)


def plane_of_focus(camera: PlenopticCamera, focal_length: float | None) -> float:
    """Position z of the plane in focus through microlenses of a focal length; nan if there is none."""
    return plane_in_front(camera, camera.stop_to_microlenses + sharp_image(camera, focal_length))


def plane_in_front(camera: PlenopticCamera, z_image: float) -> float:
    """Object plane of an image; nan if it does not lie in front of the lens."""
    z = object_plane(camera.lens, z_image, camera.wavelength)
    if camera.lens.model is not LensModel.NONE and is_at_horizon(camera, z):
        return -math.inf
    return z if z < float(camera.lens.vertices[0]) else math.nan


def is_at_horizon(camera: PlenopticCamera, z: float) -> bool:
    """True if the images of a plane and of infinity are equal up to rounding."""
    image, horizon = (image_plane(camera.lens, x, camera.wavelength) for x in (z, -math.inf))
    return abs(image - horizon) <= SAME_FOCUS * abs(horizon)


def neighbour_distance(array: MicrolensArray) -> float:
    """Distance between nearest microlenses in mm; of a FREE lattice, the median around the axis."""
    if array.centres is None:
        return min(array.pitches)
    centres = np.asarray(array.centres)
    if len(centres) < 2:
        return min(array.pitches)
    chosen = np.argsort(np.hypot(*centres.T), kind="stable")[:_NEAREST]
    nearest = [np.partition(np.hypot(*(centres - centres[k]).T), 1)[1] for k in chosen.tolist()]
    return float(np.median(nearest))


def cell_area(array: MicrolensArray) -> float:
    """Area per microlens in mm^2; of a FREE lattice, that of a square one with the distance of neighbours."""
    return neighbour_distance(array) ** 2 if array.lattice is Lattice.FREE else array.cell_area


def opening_width(array: MicrolensArray) -> float:
    """Least width of a microlens's opening in mm; 0 for pinholes."""
    if not array.model.focuses:
        return 0.0
    opening = array.opening
    if math.isfinite(opening.radius):
        return 2.0 * opening.radius
    width = 2.0 * float(opening.edges[:, 2].min())
    return min(width, neighbour_distance(array)) if array.lattice is Lattice.FREE else width


def check_real_image(lens: LensStack, z: float, wavelength: float, name: str = "z") -> None:
    """Raise an InvalidValueError if the plane z in mm has no real image behind the lens."""
    if not z < 0:
        raise InvalidValueError(f"{name} is {z:g} mm; the plane must lie in front of the camera, at z below 0")
    if lens.model is not LensModel.NONE and z >= (focus := front_focus(lens, wavelength)):
        raise InvalidValueError(
            f"the plane {name} = {z:g} mm has no real image behind the lens; it must lie beyond the front focus "
            f"at z = {focus:g} mm{metres_hint(z, focus)}"
        )


def focused_stop_to_microlenses(
    camera: PlenopticCamera, z: float, criterion: FocusCriterion, microlens_type: int | None = None
) -> float:
    """Distance in mm from iris to array at which the plane z of the camera's frame is in focus on the axis."""
    check_real_image(camera.lens, number(z, "z"), camera.wavelength)
    image = best_focus(camera.lens, z_object=z, wavelength=camera.wavelength, criterion=criterion)
    if not math.isfinite(image):
        raise InvalidValueError(
            f"the plane z = {z:g} mm has its image at infinity; choose another plane or a lens with a focal length"
        )
    return image - sharp_image(camera, _focal_length(camera, microlens_type))


def _focal_length(camera: PlenopticCamera, microlens_type: int | None) -> float | None:
    """Focal length in mm of the microlenses of a type, which is required if types differ; None without microlenses."""
    if camera.microlenses is None:
        return None
    focal_lengths = camera.microlenses.focal_lengths_at(camera.wavelength)
    if microlens_type is None:
        if len(set(focal_lengths)) > 1:
            raise InvalidValueError(
                f"the microlenses have the focal lengths {focal_lengths} mm, which see different planes sharply; name "
                f"one by microlens_type, 0 to {len(focal_lengths) - 1}"
            )
        return focal_lengths[0]
    if whole(microlens_type, "microlens_type", at_least=0) >= len(focal_lengths):
        raise InvalidValueError(
            f"microlens_type is {microlens_type}; the microlenses have {len(focal_lengths)} types, counted from 0"
        )
    return focal_lengths[microlens_type]
