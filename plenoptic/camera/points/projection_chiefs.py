"""Rays from points through given places behind the lens, found by Newton's method through the real lens."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.array_axes import ArrayAxes
from plenoptic.camera.points.centres import through_centres
from plenoptic.camera.psf.sensor_hits import ForwardRecord
from plenoptic.core.rays import RayBundle
from plenoptic.optics.lens.record import LensRecord, lens_record
from plenoptic.optics.lens.trace import traced_by
from plenoptic.optics.microlens.array import ConvexSide, MicrolensArray
from plenoptic.optics.record import IDEAL

Floats = NDArray[np.float64]

CLOSE = 1e-10
"""How far from its place, in mm, an aimed ray may pass, above what the digits of the coordinates allow."""
_TRIALS = 40
_STEP = 1e-5
"""Distance of the rays that give derivatives, over the size of the entrance pupil."""


class Aim(Protocol):
    """Where rays are to pass: traced rays go in, what they miss by comes out."""

    @property
    def tables(self) -> LensRecord:
        """What rays are traced through; nothing stops them."""

    def places(self, rays: RayBundle) -> Floats:
        """(n, 2): the place of each ray."""


class ThroughArray(NamedTuple):
    """Where rays meet the array: the local place of the optical centre that they would pass undeviated."""

    tables: LensRecord
    axes: ArrayAxes
    array: MicrolensArray

    def places(self, rays: RayBundle) -> Floats:
        """In plates whose vertices face the sensor, rays are displaced on their way to them."""
        points, slopes = self.arriving(rays)
        if self.array.is_plate and self.array.convex_side is ConvexSide.SENSOR:
            return points + self.array.thickness * (self._inside(slopes) - 1.0 / self.array.index) * slopes
        return points

    def _inside(self, slopes: Floats) -> Floats:
        """Slope inside the plate over that outside."""
        tangent2 = np.sum(slopes**2, axis=1, keepdims=True)
        sine2 = tangent2 / (1.0 + tangent2)
        return np.asarray(np.sqrt((1.0 - sine2) / (self.array.index**2 - sine2)))

    def arriving(self, rays: RayBundle) -> tuple[Floats, Floats]:
        """Points (n, 2) of the front principal plane and slopes (n, 2), local."""
        back = self.axes.local_to_lens.inverse()
        origin, slopes = back.points(rays.origin), self.axes.slopes_of(rays.direction)
        return origin[:, :2] - origin[:, 2:] * slopes, slopes

    def landing(self, centres: Floats, rays: RayBundle) -> Floats:
        """Where rays through local optical centres meet the sensor, (n, 2) in its own axes."""
        _, slopes = self.arriving(rays)
        return self.axes.on_sensor(*through_centres(self.array, centres, slopes))


class ThroughIris(NamedTuple):
    """Where rays meet the plane of the iris, or of what stands for it in an ideal lens."""

    tables: LensRecord

    def places(self, rays: RayBundle) -> Floats:
        """In the lens's axes."""
        return rays.origin[:, :2]


def through_iris(tables: ForwardRecord) -> tuple[ThroughIris, Floats]:
    """The way to the iris, and its centre (2,)."""
    camera = tables.camera
    bare = lens_record(camera.lens, camera.wavelength, reverse=False, clipping=False)
    stops = (bare.rows["surface_index"] == camera.lens.iris_index) & (bare.rows["kind"] != IDEAL)
    last = int(np.flatnonzero(stops)[0])
    centre = np.zeros(2) if bare.frames is None else bare.frames[last, 9:11] * bare.frames[last, 12]
    return ThroughIris(bare.first(last + 1)), centre


def rays_from(points: Floats, aims: Floats, z: float, wavelength: float) -> RayBundle:
    """Rays from points (n, 3) on their way through places (n, 2) of the plane z, where they start."""
    through = np.column_stack([aims, np.full(len(aims), z)])
    return RayBundle(through, through - points, wavelength)


def aimed(
    aim: Aim, points: Floats, wanted: Floats, start: Floats, *, z: float, size: float, wavelength: float
) -> Floats:
    """Places (n, 2) of the plane z through which rays from points (n, 3) pass `wanted` (n, 2); nan where none does.

    Newton's method from `start` (n, 2), with steps halved until they help. `size` is that of the entrance pupil.
    """
    h = _STEP * size
    right, up = np.array([[h, 0.0], [0.0, h]])

    def missed(where: Floats, rows: NDArray[np.int64]) -> tuple[Floats, Floats]:
        """By how much (n, 2), and the derivatives (n, 2, 2)."""
        tried = np.concatenate([where, where + right, where + up])
        rays = rays_from(np.tile(points[rows], (3, 1)), tried, z, wavelength)
        here, beside, above = aim.places(traced_by(aim.tables, rays)).reshape(3, -1, 2)
        return wanted[rows] - here, np.stack([beside - here, above - here], axis=-1) / h

    limit = CLOSE + 64 * np.finfo(float).eps * (np.abs(wanted).max(axis=1, initial=0.0) + size)
    found, share = start.copy(), np.ones(len(points))
    with np.errstate(all="ignore"):
        miss, slope = missed(found, np.arange(len(points)))
        for _ in range(_TRIALS):
            off = np.hypot(*miss.T)
            open_ = np.flatnonzero(np.isfinite(off) & (off > limit) & (share > 1e-6))
            if not len(open_):
                break
            step = _solved(slope[open_], miss[open_])
            length = np.hypot(*step.T)
            step *= (share[open_] * np.minimum(1.0, 4.0 * size / length))[:, None]
            trial = found[open_] + step
            trial_miss, trial_slope = missed(trial, open_)
            better = np.hypot(*trial_miss.T) < off[open_]
            rows = open_[better]
            found[rows], miss[rows], slope[rows] = trial[better], trial_miss[better], trial_slope[better]
            share[open_] = np.where(better, 1.0, 0.25 * share[open_])
        found[~(np.hypot(*miss.T) <= limit)] = np.nan
    return found


def _solved(matrix: Floats, right: Floats) -> Floats:
    """Solutions (n, 2) of systems (n, 2, 2); not finite where they are singular."""
    a, b, c, d = matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 0], matrix[:, 1, 1]
    determinant = a * d - b * c
    return (
        np.stack([d * right[:, 0] - b * right[:, 1], a * right[:, 1] - c * right[:, 0]], axis=1) / determinant[:, None]
    )
