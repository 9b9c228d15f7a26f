"""Sampling grids of fields: density, and extent on the array and on the sensor."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.wave.beam import Beam
from plenoptic.wave.microlenses import Microlenses

MAX_SAMPLES = 1 << 26
"""Limit of the samples of a grid; three grids of 8 bytes a sample are in memory at once."""
OVERSAMPLING = 2.0
"""Density of samples over that required by geometric light."""
_MARGIN = 24.0
"""Margin around geometric light in units of wavelength / range of directions: light beyond it is some 1 %."""


class FieldGrid(NamedTuple):
    """Samples of a field on the array and, displaced, on the sensor; along x, then y."""

    spacing: Floats
    """(2,) distance between samples, mm."""
    shape: tuple[int, int]
    """Numbers of samples."""
    first: Floats
    """(2,) position of the first sample on the array, mm in the sensor's axes."""
    lit: tuple[slice, slice]
    """Samples on the array that may be lit."""
    middle: Floats
    """(2,) s of the wave that is constant on the grid before the pupil phase is applied."""
    curvature: float
    """Curvature of the pupil's waves, as in `Plane`."""
    carrier: Floats
    """(2,) direction of the wave that is constant on the grid."""
    distance: float
    """Distance to the sensor, mm."""
    shift: Floats
    """(2,) shift of the grid from the array to the sensor, mm."""
    valid: tuple[slice, slice]
    """Samples on the sensor without light that wraps around the grid's edge."""
    oversampling: float
    """Samples per period of the most oblique light, over the required two."""

    @property
    def step(self) -> Floats:
        """(2,) step of directions, in units of the wavelength in mm."""
        return np.asarray(1.0 / (self.spacing * self.shape))

    def positions(self, axis: int, samples: slice) -> Floats:
        """Positions of samples on the array along an axis, mm."""
        return np.asarray(self.first[axis] + self.spacing[axis] * np.arange(samples.start, samples.stop))

    def frequencies(self, axis: int, wavelength: float) -> Floats:
        """Differences of s, or of the direction, from the carrier's, in the order of a Fourier transform."""
        return np.asarray(wavelength * np.fft.fftfreq(self.shape[axis], self.spacing[axis]))

    def pupil_phase(self, axis: int, samples: slice, wavelength: float) -> NDArray[np.complex128]:
        """Factor of the field along an axis by the curvature of the pupil's waves."""
        offset = self.positions(axis, samples) - (self.first[axis] + 0.5 * self.spacing[axis] * self.shape[axis])
        return np.asarray(np.exp((1j * math.pi * self.curvature / wavelength) * offset**2))


def grid_for(beam: Beam, lenses: Microlenses | None, distance: float, oversampling: float) -> FieldGrid:
    """Grid that holds a point's light on the array and on the sensor."""
    low, high = lit_box(beam)
    centre, curvature = 0.5 * (low + high), beam.plane.curvature
    middle, half = 0.5 * (beam.low + beam.high), 0.5 * (beam.high - beam.low)
    carrier = middle + curvature * centre
    sensor_low, sensor_high = low, high
    shift = distance * beam.plane.slopes(carrier)
    if lenses is not None:
        slopes = beam.plane.slopes(beam.directions)
        deflections = lenses.max_deflection(low, high)
        half = np.maximum(half, np.abs(beam.directions - carrier).max(axis=0) + deflections)
        spread = np.abs(distance * slopes - shift).max(axis=0) + _MARGIN * beam.wavelength * distance / (
            2.0 * lenses.reach
        )
        sensor_low, sensor_high = lenses.sensor_box(low, high, distance)
        sensor_low, sensor_high = sensor_low - spread, sensor_high + spread
    spacing = beam.wavelength / (2.0 * oversampling * half)
    valid_half = np.maximum(centre - sensor_low, sensor_high - centre)
    # Light that is displaced by less than half the grid and wraps around its edge stays outside of the valid part.
    extent = (0.5 * (high - low) + valid_half) * (2.0 if lenses is not None else 1.0)
    samples = np.ceil(extent / spacing)
    if samples.prod() > MAX_SAMPLES:
        raise InvalidValueError(
            f"the light of the point reaches over {high[0] - low[0]:.3g} x {high[1] - low[1]:.3g} mm of the array and "
            f"needs {samples[0]:.0f} x {samples[1]:.0f} samples, {spacing[0] * 1e3:.3g} um apart; the limit is "
            f"{MAX_SAMPLES}: stop the lens down, or take a point nearer to what is in focus"
        )
    shape = (fast_length(int(samples[0])), fast_length(int(samples[1])))
    return FieldGrid(
        spacing=spacing,
        shape=shape,
        first=centre - 0.5 * spacing * shape,
        lit=_middle(shape, 0.5 * (high - low) / spacing),
        middle=middle,
        curvature=curvature,
        carrier=carrier,
        distance=distance,
        shift=shift,
        valid=_middle(shape, valid_half / spacing),
        oversampling=oversampling,
    )


def lit_box(beam: Beam) -> tuple[Floats, Floats]:
    """Corners (2,), (2,) of the lit part of the array, including a margin for diffraction."""
    margin = _MARGIN * beam.wavelength / (beam.high - beam.low)
    return beam.spot[0] - margin, beam.spot[1] + margin


def _middle(shape: tuple[int, int], half: Floats) -> tuple[slice, slice]:
    x, y = (
        slice(max(0, math.floor(n / 2 - h)), min(n, math.ceil(n / 2 + h) + 1)) for n, h in zip(shape, half, strict=True)
    )
    return x, y


def fast_length(minimum: int) -> int:
    """Smallest even number of at least `minimum` whose prime factors are 2, 3 and 5."""
    n = minimum.bit_length() + 1
    products: list[int] = [2**i * 3**j * 5**k for i in range(1, n + 1) for j in range(n) for k in range(n)]
    return min(length for length in products if length >= minimum)
