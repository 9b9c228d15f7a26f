"""Rays of points, and which of them pass given places behind the lens: Newton's method through the real lens."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import ArrayAxes
from plenoptic.camera.psf.sensor_hits import ForwardRecord
from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats
from plenoptic.optics.element_record import IDEAL
from plenoptic.optics.lens.record import LensRecord, lens_record
from plenoptic.optics.lens.trace import traced_by
from plenoptic.optics.microlens.array import MicrolensArray

CLOSE = 1e-10
"""How far from its place, in mm, an aimed ray may pass, above what the digits of the coordinates allow."""
_TRIALS = 40
_STEP = 1e-5
"""Distance of the rays that give derivatives, over the size of the entrance pupil."""


class EntranceRays(NamedTuple):
    """Rays of points in front of the lens: they start on the plane `z`, in the lens's axes."""

    z: float
    size: float
    """Semi-diameter of what light enters through, in mm."""
    wavelength: float
    bare: LensRecord
    """The lens without its stops and rims."""
    lens: LensRecord
    """The lens with them."""

    def through(self, points: Floats, places: Floats) -> RayBundle:
        """Rays of points (n, 3) through places (n, 2) of the plane."""
        start = np.column_stack([places, np.full(len(places), self.z)])
        return RayBundle(start, start - points, self.wavelength)


def entrance_rays(tables: ForwardRecord) -> EntranceRays:
    """The rays of a camera's own wavelength."""
    camera, entrance = tables.camera, tables.entrance
    size = min(entrance.pupil[1], entrance.reach) if np.isfinite(entrance.pupil[1]) else entrance.reach
    bare = lens_record(camera.lens, camera.wavelength, reverse=False, clipping=False)
    return EntranceRays(entrance.z, size, camera.wavelength, bare, tables.lens)


class Aim(NamedTuple):
    """Target points of rays, which are traced through an unobstructed `lens` and then pass `places`."""

    lens: LensRecord
    places: Callable[[RayBundle], Floats]
    """From n rays to (n, 2)."""


class ThroughArray(NamedTuple):
    """Intersections of rays with the array, in local axes."""

    axes: ArrayAxes
    array: MicrolensArray

    def places(self, rays: RayBundle) -> Floats:
        """The optical centre (n, 2) that each ray would pass undeviated.

        In plates whose vertices face the sensor, rays are displaced on their way to them.
        """
        slopes = self.axes.slopes_of(rays.direction)
        origin = self.axes.parts.local_to_lens.inverse().points(rays.origin)
        return self._displace(origin[:, :2] - origin[:, 2:] * slopes, slopes, False)

    def sensor_points(self, centres: Floats, rays: RayBundle) -> Floats:
        """Intersections with the sensor, (n, 2) in its own axes, of rays through local optical centres."""
        slopes = self.axes.slopes_of(rays.direction)
        return self.axes.on_sensor(self._displace(centres, slopes, True), slopes)

    def _displace(self, points: Floats, slopes: Floats, rear: bool) -> Floats:
        return self.array.model.rules.displaced(self.array, points, slopes, self.axes.camera.wavelength, rear)


def through_iris(tables: ForwardRecord, bare: LensRecord) -> tuple[Aim, Floats]:
    """Elements up to the plane of the iris, or of its substitute in an ideal lens, and its centre (2,)."""
    stops = (bare.rows["surface_index"] == tables.camera.lens.iris_index) & (bare.rows["kind"] != IDEAL)
    last = int(np.flatnonzero(stops)[0])
    centre = np.zeros(2) if bare.frames is None else bare.frames[last, 9:11] * bare.frames[last, 12]
    return Aim(bare.part(0, last + 1), lambda rays: rays.origin[:, :2]), centre


def aimed(entrance: EntranceRays, aim: Aim, points: Floats, wanted: Floats, start: Floats) -> Floats:
    """Places (n, 2) of the entrance through which rays of points (n, 3) pass `wanted` (n, 2); nan where none does.

    Newton's method from `start` (n, 2), with steps halved until they help.
    """
    size = entrance.size
    h = _STEP * size
    right, up = np.array([[h, 0.0], [0.0, h]])

    def missed(where: Floats, rows: NDArray[np.int64]) -> tuple[Floats, Floats]:
        """By how much (n, 2), and the derivatives (n, 2, 2)."""
        tried = np.concatenate([where, where + right, where + up])
        rays = entrance.through(np.tile(points[rows], (3, 1)), tried)
        landed, landed_right, above = aim.places(traced_by(aim.lens, rays)).reshape(3, -1, 2)
        return wanted[rows] - landed, np.stack([landed_right - landed, above - landed], axis=-1) / h

    limit = CLOSE + 64 * np.finfo(float).eps * (np.abs(wanted).max(axis=1, initial=0.0) + size)
    aims, damping = start.copy(), np.ones(len(points))
    with np.errstate(all="ignore"):
        miss, slope = missed(aims, np.arange(len(points)))
        for _ in range(_TRIALS):
            off = np.hypot(*miss.T)
            open_ = np.flatnonzero(np.isfinite(off) & (off > limit) & (damping > 1e-6))
            if not len(open_):
                break
            step = solved(slope[open_], miss[open_])
            length = np.hypot(*step.T)
            step *= (damping[open_] * np.minimum(1.0, 4.0 * size / length))[:, None]
            trial = aims[open_] + step
            trial_miss, trial_slope = missed(trial, open_)
            better = np.hypot(*trial_miss.T) < off[open_]
            rows = open_[better]
            aims[rows], miss[rows], slope[rows] = trial[better], trial_miss[better], trial_slope[better]
            damping[open_] = np.where(better, 1.0, 0.25 * damping[open_])
        aims[~(np.hypot(*miss.T) <= limit)] = np.nan
    return aims


def solved(matrix: Floats, right: Floats) -> Floats:
    """Solutions (n, 2) of systems (n, 2, 2); not finite where they are singular."""
    a, b, c, d = matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 0], matrix[:, 1, 1]
    crossed = np.stack([d * right[:, 0] - b * right[:, 1], a * right[:, 1] - c * right[:, 0]], axis=1)
    return np.asarray(crossed / (a * d - b * c)[:, None])
