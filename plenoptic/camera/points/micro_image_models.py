"""Fourier coefficients of a camera's micro images: of the paraxial pupil, and of the light that the lens lets through.

Frequencies (k, 2) are in cycles per row and per column of the sensor.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import array_axes
from plenoptic.camera.gaussian import model_pupil, paraxial_cone
from plenoptic.camera.points.centroids import light_integrals, moment_points
from plenoptic.core.values import Floats
from plenoptic.optics.lens.pupil.iris_points import square_grid
from plenoptic.optics.microlens.lattice import polygon_moments

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera

_ACROSS, _NODES = 48, 10
"""Points across the paraxial pupil, and on each line across the traced one."""

Complexes: TypeAlias = NDArray[np.complex128]


def to_complex(pixel: Floats) -> Complexes:
    """Rows and columns (..., 2) as x + iy (...): columns run towards -x, rows towards +y."""
    return np.asarray(-pixel[..., 1] + 1j * pixel[..., 0])


def to_pixel(z: Complexes) -> Floats:
    """The inverse of `to_complex`."""
    return np.stack([z.imag, -z.real], axis=-1)


def _opening_and_powers(camera: PlenopticCamera) -> tuple[Floats, list[tuple[float, int]]]:
    """Points of a microlens's opening from its centre (n, 2), mm, and the power and number of each type."""
    array = camera.microlenses
    assert array is not None
    if not array.model.focuses:
        return np.zeros((1, 2)), [(0.0, 1)]
    counts = np.bincount(array.type_pattern.ravel(), minlength=len(array.focal_lengths)).tolist()
    powers = [1.0 / length for length in array.focal_lengths_at(camera.wavelength)]
    return moment_points(polygon_moments(array.opening.corners[None])[2][0]), list(zip(powers, counts, strict=True))


def paraxial_coefficients(camera: PlenopticCamera, frequencies: Floats) -> Complexes:
    """Fourier coefficients (1, k) of the paraxial micro images of all types."""
    counts = np.array([[count for _, count in _opening_and_powers(camera)[1]]])
    return np.asarray(counts @ paraxial_of_types(camera, frequencies))


def paraxial_of_types(camera: PlenopticCamera, frequencies: Floats) -> Complexes:
    """Fourier coefficients (types, k) of the paraxial image of the iris, blurred by the openings of the microlenses."""
    cone, b = paraxial_cone(camera.lens, camera.stop_to_microlenses, camera.wavelength), camera.microlenses_to_sensor
    z, size = model_pupil(camera)
    upright = not math.isfinite(z) or size * (camera.stop_to_microlenses - z) > 0
    points, stop = square_grid(_ACROSS), camera.lens.stop
    light = stop.transmission_at(*(stop.semi_diameter * points.T))
    # Light from one side of the pupil falls onto the other side of the micro image.
    image = (-b if upright else b) * cone.slope * points
    offsets, powers = _opening_and_powers(camera)
    types = np.zeros((len(powers), len(frequencies)), dtype=complex)
    for row, (power, _) in zip(types, powers, strict=True):
        hits = (image[:, None] + (1.0 + b * (cone.vergence - power)) * offsets) / camera.sensor.pixel_pitch
        waves = np.exp(-2j * np.pi * (to_pixel(hits[..., 0] + 1j * hits[..., 1]) @ frequencies.T))
        row += light @ waves.sum(axis=1)
    return types


def traced_coefficients(camera: PlenopticCamera, frequencies: Floats, centre: Floats, on_array: Floats) -> Complexes:
    """Fourier coefficients (p, k) of the light through single microlenses, around their centres (p, 2) in pixels."""
    array, axes, sensor = camera.microlenses, array_axes(camera), camera.sensor
    assert array is not None

    def waves(lens: NDArray[np.int64], hit: Floats) -> Iterable[Floats]:
        for phase in 2 * np.pi * ((sensor.pixel_of(hit) - centre[lens]) @ frequencies.T).T:
            yield np.cos(phase)
            yield -np.sin(phase)

    (offsets, powers), points = _opening_and_powers(camera), axes.local(on_array)
    total: Floats = np.zeros((len(points), 2 * len(frequencies)))
    for power, count in powers:
        total += count * light_integrals(axes, array, points, power, offsets, waves, nodes=_NODES)
    return np.asarray(total[:, ::2] + 1j * total[:, 1::2])
