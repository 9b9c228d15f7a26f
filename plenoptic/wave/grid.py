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

MOST_SAMPLES = 1 << 26
"""Of a grid: three of them are held at once, of 8 bytes a sample."""
DENSER = 2.0
"""How much more densely fields are sampled than geometric light needs it."""
_MARGIN = 24.0
"""Around geometric light, in units of wavelength over the spread of its directions: light beyond it is some 1 %."""


class Grid(NamedTuple):
    """Samples of a field on the array and, displaced, on the sensor; along x, then y."""

    spacing: Floats
    """(2,), mm."""
    shape: tuple[int, int]
    """Samples."""
    first: Floats
    """(2,): the first sample on the array, mm in the sensor's axes."""
    lit: tuple[slice, slice]
    """The samples on the array where there is light."""
    middle: Floats
    """(2,): that s whose wave is constant on the grid before it is curved."""
    curvature: float
    """As of `Plane`."""
    carrier: Floats
    """(2,): the direction whose wave is constant on the grid."""
    distance: float
    """To the sensor, mm."""
    shift: Floats
    """(2,), mm: the grid on the sensor from that on the array."""
    seen: tuple[slice, slice]
    """The samples on the sensor that are right: others may be light that the grid's edge returned."""
    needed: float
    """Samples in a period of the light most inclined, over the two that must be."""

    @property
    def step(self) -> Floats:
        """(2,): of directions, in units of the wavelength in mm."""
        return np.asarray(1.0 / (self.spacing * self.shape))

    def places(self, axis: int, where: slice) -> Floats:
        """Positions on the array along an axis, mm."""
        return np.asarray(self.first[axis] + self.spacing[axis] * np.arange(where.start, where.stop))

    def frequencies(self, axis: int, wavelength: float) -> Floats:
        """Offsets of s, or of the direction, from the carrier's, in the order of a Fourier transform."""
        return np.asarray(wavelength * np.fft.fftfreq(self.shape[axis], self.spacing[axis]))

    def curved(self, axis: int, where: slice, wavelength: float) -> NDArray[np.complex128]:
        """Factor of a curvature along an axis of a field."""
        away = self.places(axis, where) - (self.first[axis] + 0.5 * self.spacing[axis] * self.shape[axis])
        return np.asarray(np.exp((1j * math.pi * self.curvature / wavelength) * away**2))


def grid_for(beam: Beam, lenses: Microlenses | None, distance: float, denser: float) -> Grid:
    """The grid that holds a point's light on the array and on the sensor."""
    low, high = lit_box(beam)
    centre, curvature = 0.5 * (low + high), beam.plane.curvature
    middle, half = 0.5 * (beam.low + beam.high), 0.5 * (beam.high - beam.low)
    carrier = middle + curvature * centre
    least, most = low, high
    shift = distance * beam.plane.slopes(carrier)
    if lenses is not None:
        slopes = beam.plane.slopes(beam.directions)
        bends = lenses.bends(low, high)
        half = np.maximum(half, np.abs(beam.directions - carrier).max(axis=0) + bends)
        spread = np.abs(distance * slopes - shift).max(axis=0) + _MARGIN * beam.wavelength * distance / (
            2.0 * lenses.reach
        )
        least, most = lenses.landing(low, high, distance)
        least, most = least - spread, most + spread
    spacing = beam.wavelength / (2.0 * denser * half)
    seen_half = np.maximum(centre - least, most - centre)
    # What is displaced by less than half the grid and returns from its edge stays beside what is seen.
    wanted = (0.5 * (high - low) + seen_half) * (2.0 if lenses is not None else 1.0)
    samples = np.ceil(wanted / spacing)
    if samples.prod() > MOST_SAMPLES:
        raise InvalidValueError(
            f"the light of the point reaches over {high[0] - low[0]:.3g} x {high[1] - low[1]:.3g} mm of the array and "
            f"needs {samples[0]:.0f} x {samples[1]:.0f} samples, {spacing[0] * 1e3:.3g} um apart; the limit is "
            f"{MOST_SAMPLES}: stop the lens down, or take a point nearer to what is in focus"
        )
    shape = (fast_length(int(samples[0])), fast_length(int(samples[1])))
    return Grid(
        spacing=spacing,
        shape=shape,
        first=centre - 0.5 * spacing * shape,
        lit=_middle(shape, 0.5 * (high - low) / spacing),
        middle=middle,
        curvature=curvature,
        carrier=carrier,
        distance=distance,
        shift=shift,
        seen=_middle(shape, seen_half / spacing),
        needed=denser,
    )


def lit_box(beam: Beam) -> tuple[Floats, Floats]:
    """Corners (2,), (2,) of the part of the array that a point's light reaches, with a margin for diffraction."""
    margin = _MARGIN * beam.wavelength / (beam.high - beam.low)
    return beam.spot[0] - margin, beam.spot[1] + margin


def _middle(shape: tuple[int, int], half: Floats) -> tuple[slice, slice]:
    x, y = (
        slice(max(0, math.floor(n / 2 - h)), min(n, math.ceil(n / 2 + h) + 1)) for n, h in zip(shape, half, strict=True)
    )
    return x, y


def fast_length(least: int) -> int:
    """The least even number from `least` on whose prime factors are 2, 3 and 5."""
    best = 1 << max(1, (least - 1).bit_length())
    five = 1
    while five < best:
        three = five
        while three < best:
            found = three * (1 << max(1, math.ceil(math.log2(max(least / three, 1.0)))))
            best = found if least <= found < best else best
            three *= 3
        five *= 5
    return best
