"""Choice of the method for aperture regions, from the camera's parameters, without tracing."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from plenoptic.camera.assembly import assembly
from plenoptic.camera.gaussian import model_pupil
from plenoptic.camera.sampling.openings import openings
from plenoptic.optics.lens.pupil.exit_pupil import rear_reach
from plenoptic.optics.microlens.aperture import ApertureShape, Walls, has_clear_gaps
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.microlens.microlens_record import possible_powers

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera

_MAX_NEAR, _MAX_NEAR_WITH_CORE = 12.0, 48.0
"""Most microlenses near a pixel on the axis for which polygons are clipped for each path, without and with unvignetted
cores. With more, clipping takes longer than its lower variance saves, and bounds on the pupil are used."""


def microlenses_near(camera: PlenopticCamera) -> float:
    """Approximate number of microlenses that illuminate a pixel on the axis, by the paraxial pupil."""
    array, parts = camera.microlenses, assembly(camera)
    if array is None:
        return 1.0
    distance = parts.z_plane - float(camera.lens.vertices[-1])
    ratio = distance / parts.distance
    height = _pupil_reach(camera, parts.z_plane) + _ray_height_factor(array, distance, ratio) * array.cell_radius
    search = (height + ratio * camera.sensor.pixel_pitch) / (1.0 + ratio) + array.cell_radius
    area = math.prod(array.pitches) if array.lattice is Lattice.FREE else array.cell_area
    return 1.0 + math.pi * search**2 / area


def _pupil_reach(camera: PlenopticCamera, z_plane: float) -> float:
    """Largest height in mm at which light towards the centre of the array crosses the plane of the last vertex."""
    (z, size), z_last = model_pupil(camera), float(camera.lens.vertices[-1])
    rim_radius = rear_reach(camera.lens, z_plane, camera.wavelength)[0]
    pupil_radius = (
        abs(size) * camera.lens.stop.semi_diameter * (z_plane - z_last) / (z_plane - z) if z < z_plane else math.inf
    )
    return min(pupil_radius, rim_radius) if math.isfinite(pupil_radius) else rim_radius


def _ray_height_factor(array: MicrolensArray, distance: float, ratio: float) -> float:
    """Displacement of a ray on the plane of the last vertex per displacement of its point in the cell."""
    if not array.model.focuses:
        return 0.0
    return float(np.abs(1.0 + ratio - distance * possible_powers(array)).max())


def bounds_reason(camera: PlenopticCamera, *, with_core: bool) -> str:
    """Reason to bound aperture regions by the pupil alone; empty if they are clipped for each point of a pixel.

    `with_core`: the unvignetted core is needed.
    """
    if camera.microlenses is not None and has_clear_gaps(camera.microlenses.aperture):
        # Half of the cell is lost for light through the gaps in any case.
        return "light passes through gaps between the openings of microlenses"
    n_near = microlenses_near(camera)
    too_many = n_near > (_MAX_NEAR_WITH_CORE if with_core else _MAX_NEAR)
    return f"{n_near:.0f} microlenses are near a pixel, and bounds on the pupil cost less" if too_many else ""


def no_core_reason(camera: PlenopticCamera) -> str:
    """Reason against an unvignetted core as control variate; empty if it is used.

    Something other than round or polygonal openings of the lens and straight sides of microlenses stops light, or the
    core contributes little to the noise.
    """
    array, parts = camera.microlenses, assembly(camera)
    if any(map(len, camera.blemishes)):
        return "dust stops light"
    if not openings(camera.lens, camera.wavelength).exact.all():
        return "an opening is no circle and no polygon"
    if camera.sensitivity is not None:
        return "the noise is that of the wavelengths"
    if array is None:
        return ""
    if array.is_plate:
        return "plates displace rays before their rims stop them"
    if array.walls is Walls.OPAQUE:
        return "walls stop light"
    if array.aperture is not None and array.aperture.shape is ApertureShape.CIRCLE:
        return "round openings stop light"
    # Displacements on the pupil, over a microlens and over a pixel.
    distance = parts.z_plane - float(camera.lens.vertices[-1])
    ratio, pixel = distance / parts.distance, 0.5 * camera.sensor.pixel_pitch * max(camera.sensor.pixel_aperture)
    varies_over_pixel = (
        array.model.focuses and _ray_height_factor(array, distance, ratio) * array.cell_radius < ratio * pixel
    )
    return "vignetting changes more over a pixel than over a microlens" if varies_over_pixel else ""
