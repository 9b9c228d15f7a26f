"""Fields on grids: from plane waves to the array, through it, and to the pixels of the sensor."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import AnyFloats, Floats
from plenoptic.optics.sensor.sensor import Sensor
from plenoptic.wave.beam import Beam
from plenoptic.wave.grid import Grid
from plenoptic.wave.microlenses import Complex, Microlenses

_ROWS = 64
"""Of a grid, that are worked on at a time."""
_RAYS = 1 << 16
"""At a time."""
_PARTS = 4
"""Along a side: the edge of the pupil is found to this part of a step of directions."""
OUTERMOST = 0.1
"""Of directions, by whose light is estimated what lies beyond them: behind edges it falls with their square."""
_GRAZING = 0.998
"""Sine squared of waves that are still followed."""


class Pixels(NamedTuple):
    """Light on part of a sensor."""

    corner: NDArray[np.int64]
    """(2,): row and column of the first pixel."""
    light: Floats
    """(rows, columns), sr."""


class PlaneWaves(NamedTuple):
    """The light of the main lens."""

    waves: Complex
    """(y, x) amplitudes in the order of a Fourier transform. By a unitary one they become the field from the grid's
    first sample on, whose square is light over area."""
    power: float
    """Sum of squares that they would have if none were cut by the edge of the opening."""
    light: float
    """Projected solid angle, sr."""
    directions: NDArray[np.int64]
    """(2,): waves along x and y."""


def plane_waves(beam: Beam, grid: Grid) -> PlaneWaves:
    """The plane waves of a point's light."""
    made = np.zeros(grid.shape[::-1], np.complex64)
    s = [grid.middle[axis] + grid.frequencies(axis, beam.wavelength) for axis in (0, 1)]
    held = [
        np.flatnonzero((part >= low) & (part <= high)) for part, low, high in zip(s, beam.low, beam.high, strict=True)
    ]
    order = [part[np.argsort(all_s[part])] for part, all_s in zip(held, s, strict=True)]
    x, y = (all_s[part] for all_s, part in zip(s, order, strict=True))
    step = beam.wavelength * grid.step
    open_part = _opening(beam, x, y, step)
    area, number = float(step.prod()), 2.0 * math.pi / beam.wavelength
    squares = total = 0.0
    rows = max(1, _RAYS // max(len(x), 1))
    for start in range(0, len(y), rows):
        part = open_part[start : start + rows]
        there = np.flatnonzero(part)
        if not len(there):
            continue
        directions = np.column_stack([x[there % len(x)], y[start + there // len(x)]])
        light, kept = beam.light(directions)
        passes, light = part.ravel()[there], light * area
        total += float(passes @ (light * kept))
        squares += float(passes @ light) / float(grid.spacing.prod())
        phase = number * np.remainder(beam.path(directions) + directions @ grid.first, beam.wavelength)
        field = passes * np.sqrt(light / grid.spacing.prod()) * np.exp(1j * phase)
        made[order[1][start + there // len(x)], order[0][there % len(x)]] = field
    return PlaneWaves(made, squares, total, np.array([len(x), len(y)]))


def _opening(beam: Beam, x: Floats, y: Floats, step: Floats) -> Floats:
    """(y, x): the part of the light in steps of directions that passes the lens."""

    def passing(directions: Floats) -> Floats:
        parts = [beam.passing(directions[k : k + _RAYS]) for k in range(0, len(directions), _RAYS)]
        return np.concatenate([np.zeros(0), *parts])

    made = passing(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)).reshape(len(y), len(x))
    around = np.pad(made, 1)
    shifted = [around[1 + i : 1 + i + len(y), 1 + j : 1 + j + len(x)] for i in (-1, 0, 1) for j in (-1, 0, 1)]
    rows, columns = np.nonzero(np.max(shifted, axis=0) != np.min(shifted, axis=0))
    side = (np.arange(_PARTS) + 0.5) / _PARTS - 0.5
    inner = np.stack(np.meshgrid(side * step[0], side * step[1]), axis=-1).reshape(-1, 2)
    for start in range(0, len(rows), _RAYS // len(inner)):
        i, j = rows[start : start + _RAYS // len(inner)], columns[start : start + _RAYS // len(inner)]
        directions = (np.column_stack([x[j], y[i]])[:, None] + inner).reshape(-1, 2)
        made[i, j] = passing(directions).reshape(-1, len(inner)).mean(axis=1)
    return made


class Through(NamedTuple):
    """Plane waves behind the array, and sums of squares of fields."""

    waves: Complex
    met: float
    """On the part of the array that is looked at."""
    passed: float


def through_array(waves: Complex, beam: Beam, grid: Grid, lenses: Microlenses) -> Through:
    """Plane waves of the lens become those behind the array."""
    field: Complex = np.fft.ifft2(waves, norm="ortho").astype(np.complex64, copy=False)
    i, j = grid.lit
    lit: Complex = field[j, i] * lenses.plate(grid.places(0, i), grid.places(1, j), beam.wavelength)
    lit *= grid.curved(0, i, beam.wavelength).astype(np.complex64)
    lit *= grid.curved(1, j, beam.wavelength).astype(np.complex64)[:, None]
    met = power(field[j, i])
    field[...] = 0.0
    field[j, i] = lit
    found: Complex = np.fft.fft2(field, norm="ortho").astype(np.complex64, copy=False)
    return Through(found, met, power(lit))


def power(field: Complex) -> float:
    """Sum of squares."""
    return sum(float((part.real**2 + part.imag**2).sum(dtype=np.float64)) for part in field)


def outermost(waves: Complex) -> float:
    """Sum of squares of the waves of the steepest directions."""
    within = [np.abs(np.fft.fftfreq(n)) < 0.5 * (1.0 - OUTERMOST) for n in waves.shape]
    return power(waves[~within[0]]) + power(waves[:, ~within[1]][within[0]])


def to_sensor(waves: Complex, beam: Beam, grid: Grid) -> float:
    """Propagate plane waves to the sensor, in place; the sum of squares of those that must be left out.

    As the band-limited angular spectrum (K. Matsushima, T. Shimobaba, Opt. Express 17, 2009, doi
    10.1364/OE.17.019662): waves that would be displaced by more than half the grid would return from its other edge.
    """
    number, left = 2.0 * math.pi / beam.wavelength, 0.0
    x, y = (grid.carrier[axis] + grid.frequencies(axis, beam.wavelength) for axis in (0, 1))
    half = 0.5 * grid.spacing * grid.shape
    for start in range(0, len(y), _ROWS):
        rows = waves[start : start + _ROWS]
        s = np.stack(np.meshgrid(x, y[start : start + _ROWS]), axis=-1)
        known = (s**2).sum(axis=-1) < _GRAZING if not beam.plane.shears else np.ones(s.shape[:2], dtype=bool)
        s = np.where(known[..., None], s, grid.carrier)
        displaced = grid.distance * beam.plane.slopes(s) - grid.shift
        known &= (np.abs(displaced) <= half).all(axis=-1)
        path = grid.distance * beam.plane.along(s) + (s - grid.carrier) @ grid.shift
        factor = np.exp(1j * number * np.remainder(path, beam.wavelength))
        if beam.plane.shears:
            factor *= beam.plane.cosine(s) ** 2
        left += power(rows[~known])
        rows *= np.where(known, factor, 0.0).astype(np.complex64)
    return left


def on_pixels(waves: Complex, grid: Grid, sensor: Sensor) -> tuple[Pixels, float]:
    """Light on the open parts of pixels, and in all on the part of the plane that is right, sr.

    The square of the field has twice its frequencies, so that it is found at twice as many places along both axes. It
    is integrated exactly, as the sum of waves that it is.
    """
    height = grid.shape[1]
    i, j = (slice(2 * part.start, 2 * part.stop) for part in grid.seen)
    first_column, along_x = _integrals(grid, 0, -1.0, sensor)
    first_row, along_y = _integrals(grid, 1, 1.0, sensor)
    seen = np.empty((height, i.stop - i.start), np.complex64)
    for start in range(0, height, _ROWS):
        seen[start : start + _ROWS] = _doubled(waves[start : start + _ROWS], 1)[:, i]
    light, total = np.zeros((len(along_y), len(along_x))), 0.0
    for start in range(0, seen.shape[1], _ROWS):
        field = _doubled(seen[:, start : start + _ROWS], 0)[j]
        squares = field.real**2 + field.imag**2
        total += float(squares.sum(dtype=np.float64))
        light += (along_y @ squares) @ along_x[:, start : start + _ROWS].T
    # A sample stands for a quarter of the area.
    return Pixels(np.array([first_row, first_column]), np.maximum(light, 0.0)), total * float(grid.spacing.prod()) / 4.0


def _integrals(grid: Grid, axis: int, sign: float, sensor: Sensor) -> tuple[int, AnyFloats]:
    """First pixel along an axis, and (pixels, n): factors for integrals over pixels of a sum of waves.

    In mm. Pixels count with `sign` times the axis.
    """
    count, pitch, step, n = sensor.shape[1 - axis], sensor.pixel_pitch, 0.5 * grid.spacing[axis], 2 * grid.shape[axis]
    seen, origin = grid.seen[axis], grid.first[axis] + grid.shift[axis]
    ends = sign * (origin + 2.0 * step * np.array([seen.start, seen.stop])) / pitch + 0.5 * count
    first, last = max(0, math.floor(ends.min())), min(count, math.ceil(ends.max()))
    middles = sign * pitch * (np.arange(first, max(last, first)) + 0.5 - 0.5 * count)
    width, frequencies = pitch * sensor.pixel_aperture[axis], np.fft.fftfreq(n, step)
    waves = width * np.sinc(width * frequencies) * np.exp(2j * math.pi * np.outer(middles - origin, frequencies))
    return first, (np.fft.fft(waves, axis=1).real / n)[:, 2 * seen.start : 2 * seen.stop].astype(np.float32)


def _doubled(waves: Complex, axis: int) -> Complex:
    """The field along an axis at twice as many places."""
    n = waves.shape[axis]
    shape = list(waves.shape)
    shape[axis] = 2 * n
    padded = np.zeros(shape, np.complex64)
    for half in (slice(0, n // 2), slice(-(n // 2), None)):
        where = (half,) if axis == 0 else (slice(None), half)
        padded[where] = waves[where]
    return np.asarray(np.fft.ifft(padded, axis=axis, norm="ortho") * np.float32(math.sqrt(2.0)))
