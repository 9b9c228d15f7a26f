"""Fields on grids: propagation of plane waves to the array, through it, and to the pixels of the sensor."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import AnyFloats, Floats
from plenoptic.optics.sensor.sensor import Sensor
from plenoptic.wave.beam import Beam
from plenoptic.wave.grid import FieldGrid
from plenoptic.wave.microlenses import Complex, Microlenses

_ROWS = 64
"""Rows of a grid that are processed at a time."""
_RAYS = 1 << 16
"""Rays that are traced at a time."""
_PARTS = 4
"""Subdivisions along a side of a step of directions, for the edge of the pupil."""
OUTERMOST = 0.1
"""Fraction of directions whose light predicts that of steeper ones: behind edges it falls with their square."""
_GRAZING = 0.998
"""Largest sine squared of waves that are propagated."""


class PixelLight(NamedTuple):
    """Light on part of a sensor."""

    corner: NDArray[np.int64]
    """(2,) row and column of the first pixel."""
    light: Floats
    """(rows, columns) projected solid angle, sr."""


class PlaneWaves(NamedTuple):
    """Plane waves of the light behind the main lens."""

    waves: Complex
    """(y, x) amplitudes in the order of a Fourier transform. A unitary transform gives the field from the grid's
    first sample on, whose square is light over area."""
    power: float
    """Sum of squares of the continuous pupil, before its edge is sampled."""
    light: float
    """Projected solid angle, sr."""
    directions: NDArray[np.int64]
    """(2,) number of waves along x and y."""


def plane_waves(beam: Beam, grid: FieldGrid) -> PlaneWaves:
    """Plane waves of a point's light."""
    amplitudes = np.zeros(grid.shape[::-1], np.complex64)
    s = [grid.middle[axis] + grid.frequencies(axis, beam.wavelength) for axis in (0, 1)]
    inside = [
        np.flatnonzero((part >= low) & (part <= high)) for part, low, high in zip(s, beam.low, beam.high, strict=True)
    ]
    order = [part[np.argsort(all_s[part])] for part, all_s in zip(inside, s, strict=True)]
    x, y = (all_s[part] for all_s, part in zip(s, order, strict=True))
    step = beam.wavelength * grid.step
    transmission = _pupil_transmission(beam, x, y, step)
    area, number = float(step.prod()), 2.0 * math.pi / beam.wavelength
    squares = total = 0.0
    rows = max(1, _RAYS // max(len(x), 1))
    for start in range(0, len(y), rows):
        part = transmission[start : start + rows]
        lit = np.flatnonzero(part)
        if not len(lit):
            continue
        directions = np.column_stack([x[lit % len(x)], y[start + lit // len(x)]])
        light, invariant = beam.light(directions)
        passes, light = part.ravel()[lit], light * area
        total += float(passes @ (light * invariant))
        squares += float(passes @ light) / float(grid.spacing.prod())
        phase = number * np.remainder(beam.path(directions) + directions @ grid.first, beam.wavelength)
        field = passes * np.sqrt(light / grid.spacing.prod()) * np.exp(1j * phase)
        amplitudes[order[1][start + lit // len(x)], order[0][lit % len(x)]] = field
    return PlaneWaves(amplitudes, squares, total, np.array([len(x), len(y)]))


def _pupil_transmission(beam: Beam, x: Floats, y: Floats, step: Floats) -> Floats:
    """(y, x) fraction of the light in steps of directions that passes the lens."""

    def trace(directions: Floats) -> Floats:
        parts = [beam.transmission(directions[k : k + _RAYS]) for k in range(0, len(directions), _RAYS)]
        return np.concatenate([np.zeros(0), *parts])

    transmission = trace(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)).reshape(len(y), len(x))
    padded = np.pad(transmission, 1)
    shifted = [padded[1 + i : 1 + i + len(y), 1 + j : 1 + j + len(x)] for i in (-1, 0, 1) for j in (-1, 0, 1)]
    rows, columns = np.nonzero(np.max(shifted, axis=0) != np.min(shifted, axis=0))
    side = (np.arange(_PARTS) + 0.5) / _PARTS - 0.5
    inner = np.stack(np.meshgrid(side * step[0], side * step[1]), axis=-1).reshape(-1, 2)
    for start in range(0, len(rows), _RAYS // len(inner)):
        i, j = rows[start : start + _RAYS // len(inner)], columns[start : start + _RAYS // len(inner)]
        directions = (np.column_stack([x[j], y[i]])[:, None] + inner).reshape(-1, 2)
        transmission[i, j] = trace(directions).reshape(-1, len(inner)).mean(axis=1)
    return transmission


class ArrayField(NamedTuple):
    """Plane waves behind the array, and sums of squares of fields."""

    waves: Complex
    incident: float
    """Before the sampled part of the array."""
    transmitted: float
    """Behind it."""


def through_array(waves: Complex, beam: Beam, grid: FieldGrid, lenses: Microlenses) -> ArrayField:
    """Transmit plane waves of the lens through the array."""
    field: Complex = np.fft.ifft2(waves, norm="ortho").astype(np.complex64, copy=False)
    i, j = grid.lit
    lit: Complex = field[j, i] * lenses.transmission(grid.positions(0, i), grid.positions(1, j), beam.wavelength)
    lit *= grid.pupil_phase(0, i, beam.wavelength).astype(np.complex64)
    lit *= grid.pupil_phase(1, j, beam.wavelength).astype(np.complex64)[:, None]
    incident = power(field[j, i])
    field[...] = 0.0
    field[j, i] = lit
    behind: Complex = np.fft.fft2(field, norm="ortho").astype(np.complex64, copy=False)
    return ArrayField(behind, incident, power(lit))


def power(field: Complex) -> float:
    """Sum of squares of a field."""
    return sum(float((part.real**2 + part.imag**2).sum(dtype=np.float64)) for part in field)


def outermost_power(waves: Complex) -> float:
    """Sum of squares of the waves of the steepest directions."""
    within = [np.abs(np.fft.fftfreq(n)) < 0.5 * (1.0 - OUTERMOST) for n in waves.shape]
    return power(waves[~within[0]]) + power(waves[:, ~within[1]][within[0]])


def to_sensor(waves: Complex, beam: Beam, grid: FieldGrid) -> float:
    """Propagate plane waves to the sensor, in place; return the sum of squares of omitted waves.

    Band-limited angular spectrum (K. Matsushima, T. Shimobaba, Opt. Express 17, 2009, doi 10.1364/OE.17.019662): waves
    that would be displaced by more than half the grid are omitted, since they would wrap around its edge.
    """
    number, omitted = 2.0 * math.pi / beam.wavelength, 0.0
    x, y = (grid.carrier[axis] + grid.frequencies(axis, beam.wavelength) for axis in (0, 1))
    half = 0.5 * grid.spacing * grid.shape
    for start in range(0, len(y), _ROWS):
        rows = waves[start : start + _ROWS]
        s = np.stack(np.meshgrid(x, y[start : start + _ROWS]), axis=-1)
        valid = (s**2).sum(axis=-1) < _GRAZING if not beam.plane.shears else np.ones(s.shape[:2], dtype=bool)
        s = np.where(valid[..., None], s, grid.carrier)
        displacement = grid.distance * beam.plane.slopes(s) - grid.shift
        valid &= (np.abs(displacement) <= half).all(axis=-1)
        path = grid.distance * beam.plane.along(s) + (s - grid.carrier) @ grid.shift
        factor = np.exp(1j * number * np.remainder(path, beam.wavelength))
        if beam.plane.shears:
            factor *= beam.plane.cosine(s) ** 2
        omitted += power(rows[~valid])
        rows *= np.where(valid, factor, 0.0).astype(np.complex64)
    return omitted


def on_pixels(waves: Complex, grid: FieldGrid, sensor: Sensor) -> tuple[PixelLight, float]:
    """Light on the apertures of pixels, and total light on the valid part of the plane, sr.

    The square of the field has twice its frequencies, so that it is sampled at twice as many points along both axes. It
    is integrated exactly, as a sum of waves.
    """
    height = grid.shape[1]
    i, j = (slice(2 * part.start, 2 * part.stop) for part in grid.valid)
    first_column, along_x = _pixel_integrals(grid, 0, -1.0, sensor)
    first_row, along_y = _pixel_integrals(grid, 1, 1.0, sensor)
    columns = np.empty((height, i.stop - i.start), np.complex64)
    for start in range(0, height, _ROWS):
        columns[start : start + _ROWS] = _upsample(waves[start : start + _ROWS], 1)[:, i]
    light, total = np.zeros((len(along_y), len(along_x))), 0.0
    for start in range(0, columns.shape[1], _ROWS):
        field = _upsample(columns[:, start : start + _ROWS], 0)[j]
        squares = field.real**2 + field.imag**2
        total += float(squares.sum(dtype=np.float64))
        light += (along_y @ squares) @ along_x[:, start : start + _ROWS].T
    # Each sample represents a quarter of a grid cell.
    pixels = PixelLight(np.array([first_row, first_column]), np.maximum(light, 0.0))
    return pixels, total * float(grid.spacing.prod()) / 4.0


def _pixel_integrals(grid: FieldGrid, axis: int, sign: float, sensor: Sensor) -> tuple[int, AnyFloats]:
    """First pixel along an axis, and weights (pixels, n) of samples in the exact integrals of waves over pixels, in mm.

    Pixel numbers ascend along `sign` times the axis.
    """
    count, pitch, step, n = sensor.shape[1 - axis], sensor.pixel_pitch, 0.5 * grid.spacing[axis], 2 * grid.shape[axis]
    valid, origin = grid.valid[axis], grid.first[axis] + grid.shift[axis]
    ends = sign * (origin + 2.0 * step * np.array([valid.start, valid.stop])) / pitch + 0.5 * count
    first, last = max(0, math.floor(ends.min())), min(count, math.ceil(ends.max()))
    middles = sign * pitch * (np.arange(first, max(last, first)) + 0.5 - 0.5 * count)
    width, frequencies = pitch * sensor.pixel_aperture[axis], np.fft.fftfreq(n, step)
    waves = width * np.sinc(width * frequencies) * np.exp(2j * math.pi * np.outer(middles - origin, frequencies))
    return first, (np.fft.fft(waves, axis=1).real / n)[:, 2 * valid.start : 2 * valid.stop].astype(np.float32)


def _upsample(waves: Complex, axis: int) -> Complex:
    """Field along an axis at twice as many points."""
    n = waves.shape[axis]
    shape = list(waves.shape)
    shape[axis] = 2 * n
    padded = np.zeros(shape, np.complex64)
    for half in (slice(0, n // 2), slice(-(n // 2), None)):
        index = (half,) if axis == 0 else (slice(None), half)
        padded[index] = waves[index]
    return np.asarray(np.fft.ifft(padded, axis=axis, norm="ortho") * np.float32(math.sqrt(2.0)))
