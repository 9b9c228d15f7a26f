"""Check for implausible parameters, as from mistaken units or swapped arguments, without tracing a ray."""

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
"""Least f-number of a lens in air, whose marginal rays arrive at a right angle (Abbe's sine condition)."""
SMALLEST = 0.5
"""Least pixel pitch in wavelengths: the resolution limit of any lens in air."""
FARTHEST = 300.0
"""Largest distance behind the lens in focal lengths, its magnification: thrice that of the strongest microscopes."""
WIDEST = 5.0
"""Largest half diagonal of a sensor over its distance from the iris: an angle of 79 degrees."""
BLURRED = 30.0
"""Largest ratio of the microlenses' focal length and their distance to the sensor: the blur in units of the opening."""


def warn_if_implausible(camera: PlenopticCamera) -> None:
    """Issue one warning that names all implausible parameters; none for a camera that can be built."""
    values = "; ".join(_implausible_values(camera))
    if values:
        warn(f"this camera is hardly what was meant: {values}", ImplausibleCameraWarning)


def _implausible_values(camera: PlenopticCamera) -> Iterator[str]:
    sensor, array, q, z = camera.sensor, camera.microlenses, camera.sensor.pixel_pitch, camera.stop_to_microlenses
    size = f"the sensor is {sensor.size[1]:.4g} x {sensor.size[0]:.4g} mm large"
    if q * 1e6 < SMALLEST * camera.wavelength:
        yield f"pixel_pitch is {q:g} mm, less than half a wavelength; give it in mm, as 0.005 for 5 micrometres"
    elif sensor.half_diagonal > WIDEST * camera.z_sensor:
        yield f"{size}, {camera.z_sensor:.4g} mm behind the iris; give pixel_pitch ({q:g}) in mm"
    if camera.lens.model is not LensModel.NONE:
        points, stop = cardinal_points(camera.lens, camera.wavelength), camera.lens.stop.semi_diameter
        f_number, distance = points.f_number, z / abs(points.efl)
        if f_number < FASTEST:
            limit = "and f/0.5 is the limit; close it"
            yield f"a stop of semi_diameter {stop:g} mm makes the lens f/{f_number:.2g}, {limit}"
        if distance > FARTHEST:
            yield f"stop_to_microlenses is {z:g} mm, {distance:.3g} focal lengths; give it in mm, or see focused_at"
    if array is None:
        return
    # A FREE microlens may have any size: its pitch is only a bound, and no comparison with nan is true.
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
