"""Numbers of a camera that none has, as from mistaken units or swapped arguments: found without tracing a ray."""

from __future__ import annotations

import math
from collections.abc import Iterator

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.warn import warn
from plenoptic.errors import ImplausibleCameraWarning
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.microlens.lattice import Lattice

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
    oddities = "; ".join(_oddities(camera))
    if oddities:
        warn(f"this camera is hardly what was meant: {oddities}", ImplausibleCameraWarning)


def _oddities(camera: PlenopticCamera) -> Iterator[str]:
    sensor, array, q, z = camera.sensor, camera.microlenses, camera.sensor.pixel_pitch, camera.stop_to_microlenses
    size = f"the sensor is {sensor.size[1]:.4g} x {sensor.size[0]:.4g} mm large"
    if q * 1e6 < SMALLEST * camera.wavelength:
        yield f"pixel_pitch is {q:g} mm, less than half a wavelength; give it in mm, as 0.005 for 5 micrometres"
    elif sensor.half_diagonal > WIDEST * camera.z_sensor:
        yield f"{size}, {camera.z_sensor:.4g} mm behind the iris; give pixel_pitch ({q:g}) in mm"
    if camera.lens.model is not LensModel.NONE:
        points, stop = cardinal_points(camera.lens, camera.wavelength), camera.lens.stop.semi_diameter
        fast, far = points.f_number, z / abs(points.efl)
        if fast < FASTEST:
            yield f"a stop of semi_diameter {stop:g} mm makes the lens f/{fast:.2g}, and f/0.5 is the limit; close it"
        if far > FARTHEST:
            yield f"stop_to_microlenses is {z:g} mm, {far:.3g} focal lengths; give it in mm, or see focused_at"
    if array is None:
        return
    # A listed lens may be any size: its pitch is a bound, and nothing is above nan.
    b, p = camera.microlenses_to_sensor, math.nan if array.lattice is Lattice.FREE else min(array.pitches)
    if max(sensor.size) < p:
        yield f"{size}, smaller than one microlens of pitch {p:g} mm; give both in mm"
    if q > p:
        yield f"a pixel of {q:g} mm is larger than a microlens of pitch {p:g} mm; give both in mm"
    for f in array.focal_lengths if array.model.focuses else ():
        if abs(f) < FASTEST * min(p, 2 * array.opening.radius):
            yield f"microlenses of pitch {p:g} and focal length {f:g} mm are f/{abs(f) / p:.2g}; were they swapped?"
        if not 1 / BLURRED < abs(b / f) < BLURRED:
            yield f"microlenses_to_sensor is {b:g} mm and their focal length {f:g}; give both in mm, nearly the same"
