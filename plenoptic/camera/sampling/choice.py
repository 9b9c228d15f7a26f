"""Choice of the method that finds aperture regions: by the camera's numbers, without tracing."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.camera.assembly import assembly
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.model_pupil import model_pupil
from plenoptic.camera.sampling.openings import openings
from plenoptic.optics.lens.pupil.exit_pupil import rear_reach
from plenoptic.optics.microlens.aperture import ApertureShape, Walls, has_clear_gaps
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.microlens.microlens_record import possible_powers

_MANY, _MANY_CERTAIN = 12.0, 48.0
"""Microlenses near a pixel on the axis beyond which bounds on the pupil must do: polygons that are cut for each path
then take longer than they lower the variance. More where light that surely passes is looked for."""


def microlenses_near(camera: PlenopticCamera) -> float:
    """About how many microlenses see a pixel on the axis, by the paraxial pupil."""
    array, parts = camera.microlenses, assembly(camera)
    if array is None:
        return 1.0
    distance = parts.z_plane - float(camera.lens.vertices[-1])
    ratio = distance / parts.distance
    reach = _pupil_reach(camera, parts.z_plane) + _bend(array, distance, ratio) * array.cell_radius
    search = (reach + ratio * camera.sensor.pixel_pitch) / (1.0 + ratio) + array.cell_radius
    area = math.prod(array.pitches) if array.lattice is Lattice.FREE else array.cell_area
    return 1.0 + math.pi * search**2 / area


def _pupil_reach(camera: PlenopticCamera, z_plane: float) -> float:
    """Distance from the axis, in mm, at which light towards the array's middle crosses the plane of the last vertex."""
    (z, size), last = model_pupil(camera), float(camera.lens.vertices[-1])
    rim = rear_reach(camera.lens, z_plane, camera.wavelength)[0]
    pupil = abs(size) * camera.lens.stop.semi_diameter * (z_plane - last) / (z_plane - z) if z < z_plane else math.inf
    return min(pupil, rim) if math.isfinite(pupil) else rim


def _bend(array: MicrolensArray, distance: float, ratio: float) -> float:
    """Displacement of a ray on the plane of the last vertex per displacement of its point in the cell."""
    if not array.model.focuses:
        return 0.0
    return float(np.abs(1.0 + ratio - distance * possible_powers(array)).max())


def why_bounds(camera: PlenopticCamera, *, certain: bool) -> str:
    """Reason why bounds on the pupil give the aperture regions; empty where they are found by tracing to the openings.

    `certain`: whether light that surely passes is looked for.
    """
    if camera.microlenses is not None and has_clear_gaps(camera.microlenses.aperture):
        # Of light beside openings half of the cell is lost in any case.
        return "light passes beside the openings of microlenses"
    near = microlenses_near(camera)
    many = near > (_MANY_CERTAIN if certain else _MANY)
    return f"{near:.0f} microlenses are near a pixel, and bounds on the pupil cost less" if many else ""


def why_uncertain(camera: PlenopticCamera) -> str:
    """Reason why the unvignetted core is not used; empty where it is.

    Something else than round and straight openings of the lens and straight sides of microlenses stops it, or it has
    little part in the noise.
    """
    array, parts = camera.microlenses, assembly(camera)
    if any(map(len, camera.blemishes)):
        return "dust stops light"
    if not openings(camera.lens, camera.wavelength).whole.all():
        return "an opening is no circle and no polygon"
    if camera.sensitivity is not None:
        return "the noise is that of the wavelengths"
    if array is None:
        return ""
    if array.is_plate:
        return "plates move rays aside before their rims stop them"
    if array.walls is Walls.OPAQUE:
        return "walls stop light"
    if array.aperture is not None and array.aperture.shape is ApertureShape.CIRCLE:
        return "round openings stop light"
    # On the pupil, from one point of the sensor and of the array.
    distance = parts.z_plane - float(camera.lens.vertices[-1])
    ratio, pixel = distance / parts.distance, 0.5 * camera.sensor.pixel_pitch * max(camera.sensor.pixel_aperture)
    pixels = array.model.focuses and _bend(array, distance, ratio) * array.cell_radius < ratio * pixel
    return "what passes changes more over a pixel than over a microlens" if pixels else ""
