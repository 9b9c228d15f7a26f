"""Ray aiming from world points at targets behind the lens, by Newton's method through the real lens."""

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

AIM_TOLERANCE = 1e-10
"""Largest distance in mm of an aimed ray from its target, in addition to the rounding of coordinates."""
_TRIALS = 40
_STEP = 1e-5
"""Distance of the rays for finite differences, over the size of the entrance pupil."""


class EntranceRays(NamedTuple):
    """Entrance plane `z` of rays from points, in the lens's axes, and the records to trace them."""

    z: float
    size: float
    """Semi-diameter of the entrance pupil, in mm."""
    wavelength: float
    bare: LensRecord
    """The lens without its stops and rims."""
    lens: LensRecord
    """The lens with its stops and rims."""

    def through(self, points: Floats, entry: Floats) -> RayBundle:
        """Rays from points (n, 3) through points (n, 2) of the entrance plane."""
        start = np.column_stack([entry, np.full(len(entry), self.z)])
        return RayBundle(start, start - points, self.wavelength)


def entrance_rays(record: ForwardRecord) -> EntranceRays:
    """Compile the entrance of a camera at its wavelength."""
    camera, entrance = record.camera, record.entrance
    size = min(entrance.pupil[1], entrance.reach) if np.isfinite(entrance.pupil[1]) else entrance.reach
    bare = lens_record(camera.lens, camera.wavelength, reverse=False, clipping=False)
    return EntranceRays(entrance.z, size, camera.wavelength, bare, record.lens)


class Aim(NamedTuple):
    """Target surface of ray aiming: rays are traced through `lens`, without vignetting, to `intersections`."""

    lens: LensRecord
    intersections: Callable[[RayBundle], Floats]
    """Function from n rays to their intersections (n, 2)."""


class ThroughArray(NamedTuple):
    """Intersections of rays with the array, in local axes."""

    axes: ArrayAxes
    array: MicrolensArray

    def intersections(self, rays: RayBundle) -> Floats:
        """Optical centre (n, 2) through which each ray would pass undeviated.

        In plates whose vertices face the sensor, rays are displaced before they reach them.
        """
        slopes = self.axes.slopes_of(rays.direction)
        origin = self.axes.parts.local_to_lens.inverse().points(rays.origin)
        return self._shift_chief_rays(origin[:, :2] - origin[:, 2:] * slopes, slopes, False)

    def sensor_points(self, centres: Floats, rays: RayBundle) -> Floats:
        """Intersections (n, 2) with the sensor, in its own axes, of rays through local optical centres."""
        slopes = self.axes.slopes_of(rays.direction)
        return self.axes.on_sensor(self._shift_chief_rays(centres, slopes, True), slopes)

    def _shift_chief_rays(self, points: Floats, slopes: Floats, rear: bool) -> Floats:
        return self.array.model.refraction.shift_chief_rays(
            self.array, points, slopes, self.axes.camera.wavelength, rear
        )


def through_iris(record: ForwardRecord, bare: LensRecord) -> tuple[Aim, Floats]:
    """Aim at the plane of the iris, or at its substitute in an ideal lens; and the centre (2,) of the iris."""
    stops = (bare.rows["surface_index"] == record.camera.lens.iris_index) & (bare.rows["kind"] != IDEAL)
    last = int(np.flatnonzero(stops)[0])
    centre = np.zeros(2) if bare.frames is None else bare.frames[last, 9:11] * bare.frames[last, 12]
    return Aim(bare.part(0, last + 1), lambda rays: rays.origin[:, :2]), centre


def aim_rays(entrance: EntranceRays, aim: Aim, points: Floats, targets: Floats, start: Floats) -> Floats:
    """Entry points (n, 2) of the rays from points (n, 3) to `targets` (n, 2); nan if there is none.

    Newton's method from `start` (n, 2), with steps reduced until the residual decreases.
    """
    size = entrance.size
    h = _STEP * size
    right, up = np.array([[h, 0.0], [0.0, h]])

    def evaluate(entry: Floats, rows: NDArray[np.int64]) -> tuple[Floats, Floats]:
        """Residuals (n, 2) and Jacobians (n, 2, 2)."""
        trial_points = np.concatenate([entry, entry + right, entry + up])
        rays = entrance.through(np.tile(points[rows], (3, 1)), trial_points)
        position, position_right, position_up = aim.intersections(traced_by(aim.lens, rays)).reshape(3, -1, 2)
        return targets[rows] - position, np.stack([position_right - position, position_up - position], axis=-1) / h

    limit = AIM_TOLERANCE + 64 * np.finfo(float).eps * (np.abs(targets).max(axis=1, initial=0.0) + size)
    entry_points, step_fraction = start.copy(), np.ones(len(points))
    with np.errstate(all="ignore"):
        residual, jacobian = evaluate(entry_points, np.arange(len(points)))
        for _ in range(_TRIALS):
            distance = np.hypot(*residual.T)
            active = np.flatnonzero(np.isfinite(distance) & (distance > limit) & (step_fraction > 1e-6))
            if not len(active):
                break
            step = solve_2x2(jacobian[active], residual[active])
            length = np.hypot(*step.T)
            step *= (step_fraction[active] * np.minimum(1.0, 4.0 * size / length))[:, None]
            trial = entry_points[active] + step
            trial_residual, trial_jacobian = evaluate(trial, active)
            improved = np.hypot(*trial_residual.T) < distance[active]
            rows = active[improved]
            entry_points[rows], residual[rows] = trial[improved], trial_residual[improved]
            jacobian[rows] = trial_jacobian[improved]
            step_fraction[active] = np.where(improved, 1.0, 0.25 * step_fraction[active])
        entry_points[~(np.hypot(*residual.T) <= limit)] = np.nan
    return entry_points


def solve_2x2(matrix: Floats, right: Floats) -> Floats:
    """Solve linear systems (n, 2, 2) for (n, 2); not finite if they are singular."""
    a, b, c, d = matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 0], matrix[:, 1, 1]
    numerators = np.stack([d * right[:, 0] - b * right[:, 1], a * right[:, 1] - c * right[:, 0]], axis=1)
    return np.asarray(numerators / (a * d - b * c)[:, None])
