"""Reflection behind microlenses: light passes them, is reflected by the sensor or by a face of theirs, and returns."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import Assembly
from plenoptic.core.kernels.ray_blocks import BLOCK, OUTSIDE_MICROLENS, RAY
from plenoptic.core.values import Floats
from plenoptic.optics.lens.kernels.trace import fill_through_lens
from plenoptic.optics.lens.lens_record import LensRecord
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.forward_record import differs_forward
from plenoptic.optics.microlens.kernels.to_lens import fill_in_lens_axes
from plenoptic.optics.microlens.kernels.to_sensor import fill_in_array_axes
from plenoptic.optics.microlens.microlens_record import ArrayRecord, SensorPlane
from plenoptic.optics.microlens.model_records import ArrayCrossing
from plenoptic.optics.microlens.plano_convex import PlanoConvexMicrolenses


class ArrayReflection(NamedTuple):
    """A mirror behind microlenses, in the local axes of `Assembly`; lengths in mm."""

    microlenses: MicrolensArray
    arrays: tuple[ArrayRecord, ...]
    """For each wavelength, or one for all."""
    parts: Assembly
    mirror: SensorPlane | None
    """Behind the rear principal plane; None: the curved sides of the lenses."""
    reflectances: tuple[float, ...]
    """As `arrays`."""


class Detour(NamedTuple):
    """Reflection behind microlenses in the middle of an unfolded stack, and the elements that light passes then."""

    reflection: ArrayReflection
    z: float
    """z in the axes of the stack of the array's front principal plane, at its centre."""
    lens: LensRecord


def fill_detour(blocks: Floats, detour: Detour, bands: NDArray[np.int64] | None, band: int) -> None:
    """Trace rays in a stack, behind its elements before the array, to the mirror and back, and through the others.

    `bands` are columns of the record of the lens, or None; the array is that of the number `band`.
    """
    fill_reflection(blocks, detour, band)
    fill_through_lens(blocks, detour.lens, bands)


def fill_reflection(blocks: Floats, detour: Detour, band: int) -> None:
    """Trace rays of one band behind the lens to the mirror and back to the plane of the array, in place."""
    reflection, fields = detour.reflection, blocks.reshape(-1, RAY // BLOCK, BLOCK)
    direction, parts, refraction = detour.lens.direction, reflection.parts, reflection.microlenses.model.refraction
    place = min(band, len(reflection.arrays) - 1)
    array, reflectance = reflection.arrays[place], reflection.reflectances[place]
    _, _, z, l, m, n, weight, status = (fields[:, row] for row in range(RAY // BLOCK))
    # Out of the mirror image of the lens, or into it.
    z[:] = parts.z_plane + direction * (z - detour.z)
    n *= direction
    if parts.frame is not None:
        fill_in_array_axes(blocks, parts.frame)
    z_array = parts.z_plane if parts.frame is None else 0.0
    cosine = n.copy()
    if reflection.mirror is None:
        assert isinstance(refraction, PlanoConvexMicrolenses)
        refraction.reflect(blocks, ArrayCrossing(array, SensorPlane(0.0, None), z_array), differs_forward(array))
    else:
        refraction.to_sensor(blocks, ArrayCrossing(array, reflection.mirror, z_array), differs_forward(array))
        first, second = z.copy(), n.copy()
        cosine *= np.hypot(1.0, np.hypot(l, m))
        _reflect(fields, reflection.mirror)
        cosine *= n
        # Seen from behind, in the mirror image of the plane of the array, it is an array of the mirrored model.
        behind = array._replace(model=refraction.mirror_image(array.model), walls=None)
        refraction.to_sensor(blocks, ArrayCrossing(behind, SensorPlane(0.0, None), 0.0), differs_forward(array))
        if array.walls is not None:
            status[(status == 0.0) & ((z != first) | (n != second))] = OUTSIDE_MICROLENS
    n[:] = -1.0 / np.sqrt(1.0 + l * l + m * m)
    if direction < 0.0 and refraction.is_thin:
        # Weights of paths in reverse are etendue at the sensor, which ideal lenses change; see `to_sensor`.
        weight *= (cosine / -n) ** 4
    l *= -n
    m *= -n
    z[:] = 0.0
    if parts.frame is not None:
        fill_in_lens_axes(blocks, parts.frame)
        z -= parts.z_plane
    z *= -direction
    z += detour.z
    n *= -direction
    weight *= np.where(status == 0.0, reflectance, 0.0)


def _reflect(fields: Floats, mirror: SensorPlane) -> None:
    """Turn slopes at the mirror into directions behind it, in mirror images of x, y and z in the plane z = 0."""
    x, y, z, l, m, n = (fields[:, row] for row in range(6))
    z[:], n[:] = -mirror.distance, 1.0
    if mirror.tilt is not None:
        z -= mirror.tilt[0] * x + mirror.tilt[1] * y
        slope_x, slope_y = mirror.tilt
        twice = 2.0 * (1.0 - slope_x * l - slope_y * m) / (1.0 + slope_x**2 + slope_y**2)
        l += twice * slope_x
        m += twice * slope_y
        n[:] = twice - 1.0
    length = np.sqrt(l * l + m * m + n * n)
    l /= length
    m /= length
    n /= length
