"""Microlenses as plates: openings, and phases by which they delay light."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.psf.sensor_hits import ForwardRecord
from plenoptic.core.values import Floats
from plenoptic.optics.microlens.aperture import has_clear_gaps
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.microlens.listed import Lenslets
from plenoptic.optics.microlens.record import listed_record

Complex = NDArray[np.complex64]


class Microlenses(NamedTuple):
    """The microlenses of a camera around some light, in the sensor's axes; lengths in mm.

    Ideal ones delay light by power r^2 / 2 less than in the middle, plates by the glass of their sag, (n - 1)
    sag: thin elements, in whose principal planes light is bent without being displaced.
    """

    array: MicrolensArray
    lenses: Lenslets
    """Those whose cells the light can meet."""
    turn: Floats
    """(2, 2): from the array's axes."""
    shift: Floats
    cells: Floats
    """(n or 1, k, 3): edges of cells in the array's axes, about designed centres."""
    refractive_index: float
    """Refractive index of plates."""
    power_factor: float

    @property
    def reach(self) -> float:
        """From a lens to the farthest point of its opening."""
        return min(self.array.opening.reach, self.array.cell_radius)

    def placed(self, points: Floats) -> Floats:
        """Points (n, 2) of the array in the sensor's axes."""
        return np.asarray(points @ self.turn.T + self.shift)

    def _boxes(self, low: Floats, high: Floats) -> tuple[Floats, Floats, Floats]:
        """Parts of a box that lenses fill, from their axes: (n, 2) twice; and the axes (n, 2)."""
        axes, centres = self.placed(self.lenses.axis), self.placed(self.lenses.design)
        wide = self.array.cell_radius
        least, most = np.clip(centres - wide, low, high), np.clip(centres + wide, low, high)
        inside = (most > least).all(axis=1)
        return (least - axes)[inside], (most - axes)[inside], axes[inside]

    def _powers(self, low: Floats, high: Floats) -> Floats:
        centres = self.placed(self.lenses.design)
        wide = self.array.cell_radius
        inside = (np.clip(centres + wide, low, high) > np.clip(centres - wide, low, high)).all(axis=1)
        return np.asarray(self.lenses.power[inside] * self.power_factor)

    def bends(self, low: Floats, high: Floats) -> Floats:
        """(2,): the greatest change of direction along x and y of light in a box."""
        least, most, _ = self._boxes(low, high)
        height = np.maximum(np.abs(least), np.abs(most))
        power = np.abs(self._powers(low, high))[:, None]
        if not self.array.is_plate:
            return np.asarray((height * power).max(axis=0, initial=0.0))
        curvature = power / (self.refractive_index - 1.0)
        sine = np.minimum(height * curvature, 0.999)
        return np.asarray(((self.refractive_index - 1.0) * sine / np.sqrt(1.0 - sine**2)).max(axis=0, initial=0.0))

    def landing(self, low: Floats, high: Floats, distance: float) -> tuple[Floats, Floats]:
        """Corners (2,), (2,) of the box in which parallel light along the axis through a box lands."""
        least, most, axes = self._boxes(low, high)
        shrink = 1.0 - distance * self._powers(low, high)[:, None]
        ends = np.stack([axes + shrink * least, axes + shrink * most])
        if has_clear_gaps(self.array.aperture) or not len(axes):
            ends = np.concatenate([ends.reshape(-1, 2), [low, high]])
        ends = ends.reshape(-1, 2)
        return ends.min(axis=0), ends.max(axis=0)

    def plate(self, x: Floats, y: Floats, wavelength: float) -> Complex:
        """Factor of the array for a field at (y, x): 0 where nothing passes."""
        made, covered = np.zeros((len(y), len(x)), np.complex64), np.zeros((len(y), len(x)), np.float32)
        width = np.array([x[1] - x[0], y[1] - y[0]])
        clear = has_clear_gaps(self.array.aperture)
        design, centre, axis = (self.placed(getattr(self.lenses, name)) for name in ("design", "centre", "axis"))
        radius, opening = self.array.opening.radius, self._turned(self.array.opening.edges)
        for k in range(len(self.lenses)):
            i, j = (_between(places, m, self.array.cell_radius) for places, m in ((x, design[k, 0]), (y, design[k, 1])))
            if self.lenses.transmission[k] == 0 or i.start >= i.stop or j.start >= j.stop:
                continue
            cell = inside_edges(
                x[i] - design[k, 0], y[j] - design[k, 1], self._turned(self.cells[k % len(self.cells)]), width
            )
            lens = cell
            if self.array.aperture is not None:
                u, v = x[i] - centre[k, 0], y[j] - centre[k, 1]
                lens = np.minimum(cell, inside_edges(u, v, opening, width))
                if math.isfinite(radius):
                    away = radius - np.hypot(u, v[:, None])
                    lens = np.minimum(lens, np.clip(0.5 + away / width.mean(), 0.0, 1.0))
            delay = self._delay(self.lenses.power[k] * self.power_factor, x[i] - axis[k, 0], y[j] - axis[k, 1])
            passed = lens * np.exp((-2j * math.pi / wavelength) * delay)
            if clear:
                passed += cell - lens
            dim = math.sqrt(self.lenses.transmission[k])
            made[j, i] += dim * passed
            covered[j, i] += dim * (cell if clear else lens)
        # Where phases step within a sample, light is not lost; at corners of cells parts add up to a little more.
        np.minimum(covered, 1.0, out=covered)
        size = np.abs(made)
        np.divide(covered, size, out=covered, where=size > 0)
        return made * covered

    def _turned(self, edges: Floats) -> Floats:
        return np.column_stack([edges[:, :2] @ self.turn.T, edges[:, 2]])

    def _delay(self, power: float, x: Floats, y: Floats) -> Floats:
        """(y, x), mm: by how much a lens delays light less than in its middle."""
        r2 = x**2 + (y**2)[:, None]
        if not self.array.is_plate:
            return 0.5 * power * r2
        curvature = power / (self.array.index - 1.0) / self.power_factor
        under = np.maximum(1.0 - r2 * curvature**2, 0.0)
        return np.asarray((self.refractive_index - 1.0) * curvature * r2 / (1.0 + np.sqrt(under)))


def _between(places: Floats, middle: float, reach: float) -> slice:
    step = places[1] - places[0]
    return slice(*np.searchsorted(places, [middle - reach - step, middle + reach + step]).tolist())


def inside_edges(x: Floats, y: Floats, edges: Floats, width: Floats) -> Floats:
    """(y, x): part of the samples, of a width (2,), inside a convex polygon with edges (k, 3)."""
    made = np.ones((len(y), len(x)))
    for across, up, far in edges:
        w = abs(across) * width[0] + abs(up) * width[1]
        if w > 0:
            np.minimum(made, 0.5 + (far - across * x - up * y[:, None]) / w, out=made)
    return np.maximum(made, 0.0, out=made)


def microlenses_around(record: ForwardRecord, low: Floats, high: Floats) -> Microlenses:
    """The microlenses that light in a box of the sensor's axes can meet."""
    camera: PlenopticCamera = record.camera
    parts, array = record.array.parts, camera.microlenses
    assert array is not None
    back = parts.sensor_to_local.turn[:2, :2].T
    turn = back @ parts.array_turn
    shift = back @ (parts.array_origin - parts.sensor_to_local.shift[:2])
    corners = np.array([[a, b] for a in (low[0], high[0]) for b in (low[1], high[1])])
    there = (corners - shift) @ turn
    wide = array.cell_radius + 1e-9
    near, far = there.min(axis=0) - wide, there.max(axis=0) + wide
    lenses = array.lenses(near, far)
    cells = np.asarray(array.cell_edges)[None]
    if array.lattice is Lattice.FREE:
        reach = 1.01 * float(np.abs(array.centres).max()) + wide if array.centres is not None else wide
        listed = listed_record(array, turn=np.eye(2), origin=np.zeros(2), reach=reach, margin=0.0)
        assert listed.cells is not None
        cells = listed.cells[lenses.index[:, 0]]
    return Microlenses(
        array, lenses, turn, shift, cells, array.index_at(camera.wavelength), array.power_factor(camera.wavelength)
    )
