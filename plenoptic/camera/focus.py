"""Focusing: position of the camera back for a plane in focus."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from plenoptic.camera.gaussian import sharp_image
from plenoptic.camera.units import metres_hint
from plenoptic.core.values import number, whole
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.analysis.focus import best_focus, front_focus
from plenoptic.optics.lens.models import FocusCriterion

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera


def focused_stop_to_microlenses(
    camera: PlenopticCamera, z: float, criterion: FocusCriterion, microlens_type: int | None = None
) -> float:
    """Distance in mm from iris to array at which the plane z of the camera's frame is in focus on the axis."""
    z = number(z, "z")
    if not z < 0:
        raise InvalidValueError(f"z is {z} mm; the plane must lie in front of the camera, at z below 0")
    focus = front_focus(camera.lens, camera.wavelength)
    if z >= focus:
        raise InvalidValueError(
            f"the plane z = {z:g} mm has no real image behind the lens; it must lie beyond the front focus "
            f"at z = {focus:g} mm{metres_hint(z, focus)}"
        )
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
