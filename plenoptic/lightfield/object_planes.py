"""Planes of the scene across the axis, and where the main lens images them, by Gaussian optics."""

from __future__ import annotations

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.report.optics import image_plane
from plenoptic.errors import InvalidValueError


def lens_front_z(camera: PlenopticCamera) -> float:
    """Where the lens begins, in its axes, mm."""
    return min(0.0, float(camera.lens.vertices[0]))


def image_distance_behind_array(camera: PlenopticCamera, z: float) -> float:
    """How far behind the array the image of a plane lies, mm, negative before it; an error beyond the lens's front."""
    front = lens_front_z(camera)
    if not z < front:
        raise InvalidValueError(
            f"z is {z:g} mm; the plane must lie in front of the camera, beyond its lens at z = {front:g} mm"
        )
    return image_plane(camera.lens, z, camera.wavelength) - camera.stop_to_microlenses
