"""Microlenses as thin phase elements: openings, and delays of the wave."""

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
from plenoptic.optics.microlens.lenslets import Lenslets
from plenoptic.optics.microlens.microlens_record import lens_table_record
from plenoptic.optics.microlens.plate_losses import axial_transmission

Complex = NDArray[np.complex64]


class Microlenses(NamedTuple):
    """The microlenses of a camera near some light, in the sensor's axes; lengths in mm.

    Ideal ones delay light by power r^2 / 2 less than on the axis, plates by (n - 1) sag less: thin elements, in whose
    principal planes light is refracted without being displaced.
    """

    array: MicrolensArray
    lenses: Lenslets
    """Lenses whose cells the light can meet."""
    turn: Floats
    """(2, 2) rotation from the array's axes."""
    shift: Floats
    cells: Floats
    """(n or 1, k, 3) edges of cells in the array's axes, about design centres."""
    refractive_index: float
    """Refractive index of plates."""
    power_factor: float
    transmittance: float
    """Fraction of the light along the axis that plates with a coating transmit; 1 for others."""

    @property
    def reach(self) -> float:
        """Distance from a lens to the farthest point of its opening."""
        return min(self.array.opening.reach, self.array.cell_radius)

    def in_sensor_axes(self, points: Floats) -> Floats:
        """Points (n, 2) of the array in the sensor's axes."""
        return np.asarray(points @ self.turn.T + self.shift)

    def _boxes(self, low: Floats, high: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Corners (n, 2), (n, 2), from the lenses' axes, of the parts of a box in their cells, the axes (n, 2), and the
        powers (n, 1).
        """
        axes, centres = self.in_sensor_axes(self.lenses.axis), self.in_sensor_axes(self.lenses.design)
        radius = self.array.cell_radius
        box_low, box_high = np.clip(centres - radius, low, high), np.clip(centres + radius, low, high)
        inside = (box_high > box_low).all(axis=1)
        powers = (self.lenses.power * self.power_factor)[:, None]
        return (box_low - axes)[inside], (box_high - axes)[inside], axes[inside], powers[inside]

    def max_deflection(self, low: Floats, high: Floats) -> Floats:
        """(2,) largest change of direction along x and y of light in a box."""
        box_low, box_high, _, power = self._boxes(low, high)
        height = np.maximum(np.abs(box_low), np.abs(box_high))
        power = np.abs(power)
        if not self.array.is_plate:
            return np.asarray((height * power).max(axis=0, initial=0.0))
        curvature = power / (self.refractive_index - 1.0)
        sine = np.minimum(height * curvature, 0.999)
        return np.asarray(((self.refractive_index - 1.0) * sine / np.sqrt(1.0 - sine**2)).max(axis=0, initial=0.0))

    def sensor_box(self, low: Floats, high: Floats, distance: float) -> tuple[Floats, Floats]:
        """Corners (2,), (2,) of the bounding box on the sensor of parallel light along the axis through a box."""
        box_low, box_high, axes, power = self._boxes(low, high)
        shrink = 1.0 - distance * power
        ends = np.stack([axes + shrink * box_low, axes + shrink * box_high])
        if has_clear_gaps(self.array.aperture) or not len(axes):
            ends = np.concatenate([ends.reshape(-1, 2), [low, high]])
        ends = ends.reshape(-1, 2)
        return ends.min(axis=0), ends.max(axis=0)

    def transmission(self, x: Floats, y: Floats, wavelength: float) -> Complex:
        """Complex transmission of the array at (y, x): 0 where it is opaque."""
        total, covered = np.zeros((len(y), len(x)), np.complex64), np.zeros((len(y), len(x)), np.float32)
        width = np.array([x[1] - x[0], y[1] - y[0]])
        clear = has_clear_gaps(self.array.aperture)
        design, centre, axis = (
            self.in_sensor_axes(getattr(self.lenses, name)) for name in ("design", "centre", "axis")
        )
        radius, opening = self.array.opening.radius, self._rotate(self.array.opening.edges)
        for k in range(len(self.lenses)):
            i, j = (_between(xs, m, self.array.cell_radius) for xs, m in ((x, design[k, 0]), (y, design[k, 1])))
            if self.lenses.transmission[k] == 0 or i.start >= i.stop or j.start >= j.stop:
                continue
            cell = inside_edges(
                x[i] - design[k, 0], y[j] - design[k, 1], self._rotate(self.cells[k % len(self.cells)]), width
            )
            lens = cell
            if self.array.aperture is not None:
                u, v = x[i] - centre[k, 0], y[j] - centre[k, 1]
                lens = np.minimum(cell, inside_edges(u, v, opening, width))
                if math.isfinite(radius):
                    edge_distance = radius - np.hypot(u, v[:, None])
                    lens = np.minimum(lens, np.clip(0.5 + edge_distance / width.mean(), 0.0, 1.0))
            delay = self._delay(self.lenses.power[k] * self.power_factor, x[i] - axis[k, 0], y[j] - axis[k, 1])
            amplitude = lens * np.exp((-2j * math.pi / wavelength) * delay)
            if clear:
                amplitude += cell - lens
            dim = math.sqrt(self.lenses.transmission[k])
            total[j, i] += dim * amplitude
            covered[j, i] += dim * (cell if clear else lens)
        # Phase steps within a sample must not lose light; at corners of cells parts add up to slightly more than 1.
        np.minimum(covered, 1.0, out=covered)
        size = np.abs(total)
        np.divide(covered, size, out=covered, where=size > 0)
        return total * (covered * np.float32(math.sqrt(self.transmittance)))

    def _rotate(self, edges: Floats) -> Floats:
        return np.column_stack([edges[:, :2] @ self.turn.T, edges[:, 2]])

    def _delay(self, power: float, x: Floats, y: Floats) -> Floats:
        """(y, x) reduction of a lens's delay from its value on the axis, mm."""
        r2 = x**2 + (y**2)[:, None]
        if not self.array.is_plate:
            return 0.5 * power * r2
        curvature = power / (self.array.index - 1.0) / self.power_factor
        cosine2 = np.maximum(1.0 - r2 * curvature**2, 0.0)
        return np.asarray((self.refractive_index - 1.0) * curvature * r2 / (1.0 + np.sqrt(cosine2)))


def _between(positions: Floats, middle: float, reach: float) -> slice:
    step = positions[1] - positions[0]
    return slice(*np.searchsorted(positions, [middle - reach - step, middle + reach + step]).tolist())


def inside_edges(x: Floats, y: Floats, edges: Floats, width: Floats) -> Floats:
    """(y, x) fraction of samples of a width (2,) that lies inside a convex polygon with edges (k, 3)."""
    fraction = np.ones((len(y), len(x)))
    for normal_x, normal_y, distance in edges:
        w = abs(normal_x) * width[0] + abs(normal_y) * width[1]
        if w > 0:
            np.minimum(fraction, 0.5 + (distance - normal_x * x - normal_y * y[:, None]) / w, out=fraction)
    return np.maximum(fraction, 0.0, out=fraction)


def microlenses_around(record: ForwardRecord, low: Floats, high: Floats) -> Microlenses:
    """Microlenses that light in a box of the sensor's axes can meet."""
    camera: PlenopticCamera = record.camera
    parts, array = record.parts, camera.microlenses
    assert array is not None
    back = parts.sensor_to_local.turn[:2, :2].T
    turn = back @ parts.array_turn
    shift = back @ (parts.array_origin - parts.sensor_to_local.shift[:2])
    corners = np.array([[a, b] for a in (low[0], high[0]) for b in (low[1], high[1])])
    array_corners = (corners - shift) @ turn
    margin = array.cell_radius + 1e-9
    lenses = array.lenses(array_corners.min(axis=0) - margin, array_corners.max(axis=0) + margin)
    cells = np.asarray(array.cell_edges)[None]
    if array.lattice is Lattice.FREE:
        reach = 1.01 * float(np.abs(array.centres).max()) + margin if array.centres is not None else margin
        listed = lens_table_record(array, turn=np.eye(2), origin=np.zeros(2), reach=reach, margin=0.0)
        assert listed.cells is not None
        cells = listed.cells[lenses.index[:, 0]]
    nm = camera.wavelength
    transmittance = axial_transmission(array, nm, camera.lens.rear_medium)
    return Microlenses(
        *(array, lenses, turn, shift, cells, array.index_at(nm), array.power_factor(nm)),
        1.0 if transmittance is None else transmittance,
    )
