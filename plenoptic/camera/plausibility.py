"""Numbers of a camera that none has, as from mistaken units or swapped arguments: found without tracing a ray."""

from __future__ import annotations

import math
from collections.abc import Iterator

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.warn import warn
from plenoptic.errors import ImplausibleCameraWarning
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.models import LensModel

FASTEST = 0.5
"""f-number of a lens in air whose outermost rays come in at a right angle (Abbe's sine condition): none is faster."""
SMALLEST = 0.5
"""Pixel pitch in wavelengths: half of one is what any lens in air resolves."""
FARTHEST = 300.0
"""Distance behind the lens in focal lengths, the magnification there: three times that of the strongest microscopes."""
WIDEST = 5.0
"""Half the diagonal of a sensor over its distance from the iris: the angle of 79 degrees."""
BLURRED = 30.0
"""Ratio of the microlenses' focal length and their distance to the sensor: their images are this many openings wide."""


def warn_where_implausible(camera: PlenopticCamera) -> None:
    """One warning that names all such numbers; none for cameras that can be built."""
    found = "; ".join(_oddities(camera))
    if found:
        warn(f"this camera is hardly what was meant: {found}", ImplausibleCameraWarning)


def _oddities(camera: PlenopticCamera) -> Iterator[str]:
    sensor, array, q, z = camera.sensor, camera.microlenses, camera.sensor.pixel_pitch, camera.stop_to_microlenses
    size = f"{sensor.size[1]:.4g} x {sensor.size[0]:.4g} mm"
    if q * 1e6 < SMALLEST * camera.wavelength:
        yield f"pixel_pitch is {q:g} mm, less than half a wavelength; give it in mm, as 0.005 for 5 micrometres"
    elif math.hypot(*sensor.size) / 2 > WIDEST * camera.z_sensor:
        yield (
            f"the sensor is {size} large, {camera.z_sensor:.4g} mm behind the iris; give pixel_pitch ({q:g}) in mm, "
            "as 0.005 for 5 micrometres"
        )
    yield from _lens(camera, z)
    if array is None:
        return
    b, p = camera.microlenses_to_sensor, min(array.pitches)
    if max(sensor.size) < p:
        yield f"the sensor is {size} large, smaller than one microlens of pitch {p:g} mm; give both in mm"
    if q > p:
        yield f"a pixel of {q:g} mm is larger than a microlens of pitch {p:g} mm; give both in mm"
    for f in array.focal_lengths if array.model.focuses else ():
        if abs(f) < FASTEST * min(p, 2 * array.opening.radius):
            yield (
                f"microlenses of pitch {p:g} and focal length {f:g} mm work at f/{abs(f) / p:.2g}; were they swapped? "
                "The focal length is usually 3 to 20 times the pitch"
            )
        if not 1 / BLURRED < abs(b / f) < BLURRED:
            yield (
                f"microlenses_to_sensor is {b:g} mm and their focal length {f:g} mm; give both in mm, nearly the same "
                "for sharp images"
            )


def _lens(camera: PlenopticCamera, z: float) -> Iterator[str]:
    if camera.lens.model is LensModel.NONE:
        return
    points = cardinal_points(camera.lens, camera.wavelength)
    if points.f_number < FASTEST:
        yield (
            f"a stop of semi_diameter {camera.lens.stop.semi_diameter:g} mm makes the lens of focal length "
            f"{points.efl:.4g} mm work at f/{points.f_number:.2g}, and none is faster than f/{FASTEST:g}; close it"
        )
    if z > FARTHEST * abs(points.efl):
        yield (
            f"stop_to_microlenses is {z:g} mm, {z / abs(points.efl):.3g} focal lengths of the lens; give it in mm, "
            "near the focal length, or see focused_at"
        )
