"""Object planes perpendicular to the axis, and their paraxial images by the main lens."""

from __future__ import annotations

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.gaussian import image_plane
from plenoptic.errors import InvalidValueError


def lens_front_z(camera: PlenopticCamera) -> float:
    """Axial position of the front of the lens in its own axes, mm."""
    return min(0.0, float(camera.lens.vertices[0]))


def image_distance_behind_array(camera: PlenopticCamera, z: float) -> float:
    """Distance of a plane's paraxial image behind the array, mm, negative in front of it.

    Raises InvalidValueError for a plane behind the front of the lens.
    """
    front = lens_front_z(camera)
    if not z < front:
        raise InvalidValueError(
            f"z is {z:g} mm; the plane must lie in front of the camera, beyond its lens at z = {front:g} mm"
        )
    return image_plane(camera.lens, z, camera.wavelength) - camera.stop_to_microlenses
