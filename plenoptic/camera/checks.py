"""Checks of the arguments scene, camera and region, and a warning of implausible cameras, without tracing a ray."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.values import whole
from plenoptic.core.warn import warn
from plenoptic.errors import ImplausibleCameraWarning, InvalidValueError
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.microlens.lattice import Lattice

if TYPE_CHECKING:
    from plenoptic.scene.scene import Scene

BLOCK = 8
"""Rows and columns of a block of pixels, over which the errors of few replicates are pooled."""
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


def check_scene_and_camera(scene: Scene | None, camera: PlenopticCamera) -> None:
    """Raise an InvalidValueError unless the arguments are a scene (or None) and a camera."""
    if scene is not None:
        from plenoptic.scene.scene import Scene

        if not isinstance(scene, Scene):
            raise InvalidValueError(f"scene is a {type(scene).__name__}; it must be a Scene")
    if not isinstance(camera, PlenopticCamera):
        raise InvalidValueError(f"camera is a {type(camera).__name__}; it must be a PlenopticCamera")


def sensor_region(shape: tuple[int, int], region: tuple[slice, slice] | None) -> tuple[int, int, int, int]:
    """First and end row, first and end column of a region, which is two slices; of the whole sensor for None."""
    if region is None:
        return 0, shape[0], 0, shape[1]
    if not (isinstance(region, tuple) and len(region) == 2 and all(isinstance(part, slice) for part in region)):
        raise InvalidValueError(f"region is {region!r}; it must be two slices, such as np.s_[0:64, 0:64]")
    bounds: list[int] = []
    for part, length, name in zip(region, shape, ("rows", "columns"), strict=True):
        try:
            first, end, step = part.indices(length)
        except TypeError as error:
            raise InvalidValueError(f"region has {name} {part}; its bounds must be whole numbers") from error
        if step != 1 or end <= first:
            raise InvalidValueError(
                f"region has {name} {part}; of the sensor's {length} {name} it must take at least one, with step 1"
            )
        bounds += [first, end]
    return bounds[0], bounds[1], bounds[2], bounds[3]


def sensor_tiles(shape: tuple[int, int], rows: int, columns: int) -> tuple[tuple[slice, slice], ...]:
    """Divide a sensor into regions between blocks of pixels; see `PlenopticCamera.tiles`."""
    cuts = []
    for length, name, n in zip(shape, ("rows", "columns"), (rows, columns), strict=True):
        blocks = -(-length // BLOCK)
        parts = whole(n, name, at_least=1)
        if parts > blocks:
            raise InvalidValueError(
                f"{name} is {parts}; the sensor has {length} {name} of pixels, in {blocks} blocks of {BLOCK} that are "
                f"not cut: give at most {blocks}"
            )
        ends = [min(blocks * i // parts * BLOCK, length) for i in range(parts + 1)]
        cuts.append([slice(first, end) for first, end in pairwise(ends)])
    return tuple((row, column) for row in cuts[0] for column in cuts[1])


def warn_if_implausible(camera: PlenopticCamera) -> None:
    """Issue one warning that names all implausible parameters; none for a camera that can be built."""
    values = "; ".join(implausible_values(camera))
    if values:
        warn(f"this camera is hardly what was meant: {values}", ImplausibleCameraWarning)


def implausible_values(camera: PlenopticCamera) -> Iterator[str]:
    """Sentences about parameters that no real camera has."""
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
