"""Bounds, for a whole camera, of the exit pupil's part that light passes on its way to the microlenses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from plenoptic.camera.assembly import Assembly, sensor_corners
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.diffraction import reach_of_bends
from plenoptic.camera.sampling.record import SIDE
from plenoptic.core.values import Floats, read_only
from plenoptic.optics.lens.pupil.exit_pupil import PupilBounds, pupil_bounds, rear_reach
from plenoptic.optics.lens.pupil.outline import polygon_around
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.imperfections import largest_offset
from plenoptic.optics.microlens.microlens_record import SensorPlane, lone_lens
from plenoptic.optics.microlens.model_rules import ArrayCrossing

_AIMS, _OFFSETS = 33, 49
_SAFETY = 1.25
"""Margins found on a grid of rays are widened by this factor."""


class Bounds(NamedTuple):
    """Quantities from which aperture regions are made."""

    pupil: PupilBounds
    margin: float
    """How far a real microlens's rays stray from an ideal one's on the plane of the outlines, in mm."""
    aside: float
    """How far rays run sideways between the principal plane and the curved side, in mm."""
    reach: float
    """How far from the lens's axis microlenses matter, in mm."""


def sensor_bounds(camera: PlenopticCamera, parts: Assembly, wavelengths: tuple[float, ...]) -> PupilBounds:
    """Without microlenses: outlines as seen from the sensor itself."""
    corners = sensor_corners(camera, parts)
    farthest = float(np.hypot(corners[:, 0], corners[:, 1]).max())
    heights = parts.z_plane + corners[:, 2]
    return _union(camera, heights, farthest, SIDE * camera.sensor.pixel_pitch / np.sqrt(2), wavelengths)


def array_bounds(
    camera: PlenopticCamera, array: MicrolensArray, parts: Assembly, powers: Floats, wavelengths: tuple[float, ...]
) -> Bounds:
    """Outlines for all cells that matter, and how far the rays of real microlenses stray.

    A ray from the sensor at s crosses the plane of the outlines at c + ratio (c - s) + bend d for the point d of the
    cell at c, to within the margin, and passes the lens no farther from the axis than a + b |c| there.
    """
    a, b = rear_reach(camera.lens, parts.z_plane, wavelengths[0])
    pupil_distance = parts.z_plane - float(camera.lens.vertices[-1])
    corners = sensor_corners(camera, parts, reach_of_bends(camera))
    ratio = pupil_distance / float(corners[:, 2].min())
    sensor = float(np.hypot(*parts.local_to_lens.points(corners)[:, :2].T).max())
    tilt = float(np.hypot(*parts.local_to_lens.turn[2, :2]))
    strongest = max(abs(_bend(array, power, pupil_distance, ratio)) for power in powers)
    off_axis = largest_offset(array.imperfections) * max(
        abs(pupil_distance * power) for power in (*powers, (1 + ratio) / pupil_distance)
    )
    margin, aside = (1.0 + tilt) * _chromatic_margin(array, powers, wavelengths, pupil_distance), 0.0
    rounds = 2 if array.is_plate else 1
    while True:
        farthest = (1.0 + tilt) * ratio * sensor + a + strongest * array.cell_radius + margin + off_axis
        widest = 1.02 * farthest / max(1.0 + ratio - b, 0.1 * (1.0 + ratio)) + array.cell_radius + aside
        heights = parts.z_plane + tilt * (widest + sensor) * np.array([-1.0, 0.0, 1.0])
        bounds = _union(camera, heights, widest, array.cell_radius + aside, wavelengths)
        rounds -= 1
        if rounds == 0:
            return Bounds(bounds, margin, aside, widest)
        reach = float(bounds.reach.max()) + widest
        distance = pupil_distance / ratio
        bends = [(power, _bend(array, power, pupil_distance, ratio)) for power in powers if power > 0]
        disperses = any(array.index_at(wavelength) != array.index for wavelength in wavelengths)
        margins = [
            aberration_margins(array, wavelength, power, distance, pupil_distance, bend, reach)
            for wavelength in (wavelengths if disperses else wavelengths[:1])
            for power, bend in bends
        ]
        margin, aside = (1.0 + tilt) * max(f[0] for f in margins), (1.0 + tilt) * max(f[1] for f in margins)


def aberration_margins(
    array: MicrolensArray,
    wavelength: float,
    power: float,
    distance: float,
    pupil_distance: float,
    bend: float,
    reach: float,
) -> tuple[float, float]:
    """Largest deviations of real rays from ideal ones on the plane of the outlines and on the curved side, in mm.

    Rays of one lens are aimed from a row of sensor points at a grid of points on its rear principal plane; those
    count that meet the curved side inside the cell and pass the plane of the outlines within `reach` of the lens's
    own axis. A lens is round, so one row of sensor points stands for all. Ideal rays are those at 587.6 nm.
    """
    from plenoptic.core.kernels.ray_blocks import BLOCK

    rules = array.model.rules
    lens = ArrayCrossing(lone_lens(array, power, wavelength), SensorPlane(distance, None), pupil_distance)
    aims = np.linspace(-1.5 * array.cell_radius, 1.5 * array.cell_radius, _AIMS)
    margin = aside = 0.0
    for _ in range(4):
        # Sensor points as far from the lens's axis as rays that count can come from.
        farthest = (reach + abs(bend) * array.cell_radius + margin) * distance / pupil_distance
        dx, dy, sx = (g.ravel() for g in np.meshgrid(aims, aims, np.linspace(0.0, farthest, _OFFSETS), indexing="ij"))
        fields = np.zeros((8, -(-dx.size // BLOCK) * BLOCK))
        for row, column in ((0, dx), (1, dy), (3, dx - sx), (4, dy)):
            fields[row, : dx.size] = column
        blocks = np.ascontiguousarray(fields.reshape(8, -1, BLOCK).transpose(1, 0, 2))
        rules.to_lens(blocks.reshape(-1), None, lens, None)
        x, y, z, u, v, w, _, status = blocks.transpose(1, 0, 2).reshape(8, -1)[:, : dx.size]
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            land_x, land_y = rules.exit_points(array, power, (dx, dy), ((dx - sx) / distance, dy / distance), (x, y))
            t = -z / w
            real_x, real_y = x + t * u, y + t * v
            counts = (status == 0) & (np.hypot(land_x, land_y) <= array.cell_radius)
            counts &= np.hypot(real_x, real_y) <= reach
            off = np.hypot(real_x - (bend * dx - pupil_distance / distance * sx), real_y - bend * dy)[counts]
            landing_error = np.hypot(land_x - dx, land_y - dy)[counts]
        if not off.size:
            break
        settled = off.max() <= 1.01 * margin
        margin, aside = max(margin, _SAFETY * float(off.max())), max(aside, _SAFETY * float(landing_error.max()))
        if settled:
            break
    return margin, aside


def _chromatic_margin(
    array: MicrolensArray, powers: Floats, wavelengths: tuple[float, ...], pupil_distance: float
) -> float:
    """Largest displacement, on the plane of the outlines, by an ideal lens of another power than at 587.6 nm, in mm."""
    if not array.model.rules.is_thin:
        return 0.0
    change = max(abs(array.power_factor(wavelength) - 1.0) for wavelength in wavelengths)
    height = array.cell_radius + largest_offset(array.imperfections)
    return _SAFETY * abs(pupil_distance) * change * float(np.abs(powers).max()) * height


def _bend(array: MicrolensArray, power: float, pupil_distance: float, ratio: float) -> float:
    """Displacement of a ray on the plane of the outlines per displacement of its point in the cell."""
    return 1.0 + ratio - pupil_distance * power if array.model.focuses else 0.0


def _union(
    camera: PlenopticCamera, heights: Floats, largest: float, cell_radius: float, wavelengths: tuple[float, ...]
) -> PupilBounds:
    """Outlines that hold those of planes of all heights, from the least to the greatest, and of all wavelengths."""
    low, high = float(heights.min()), float(heights.max())
    supports = [
        pupil_bounds(camera.lens, z_plane=z, largest_radius=largest, cell_radius=cell_radius, wavelength=wavelength)
        for z in ((low,) if high - low <= 1e-12 * abs(high) else (low, high))
        for wavelength in wavelengths
    ]
    if len(supports) == 1:
        return supports[0]
    finest = max(supports, key=lambda bounds: len(bounds.support))
    support = np.full_like(np.asarray(finest.support), -np.inf)
    parted = np.zeros(len(support), dtype=np.bool_)
    for bounds in supports:
        # An interval of the finest division lies in one or two of a coarser one.
        first = np.floor(np.arange(len(support)) * finest.step / bounds.step + 1e-9).astype(int)
        last = np.floor(np.arange(1, len(support) + 1) * finest.step / bounds.step - 1e-9).astype(int)
        for rows in (first, last):
            rows = np.clip(rows, 0, len(bounds.support) - 1)
            support, parted = np.maximum(support, bounds.support[rows]), parted | bounds.parted[rows]
    lit = np.isfinite(support[:, 0])
    outline = polygon_around(np.where(lit[:, None], support, 0.0))
    reach = np.where(lit, np.linalg.norm(outline, axis=-1).max(axis=-1), 0.0)
    finest = finest._replace(support=read_only(support), corners=read_only(outline))
    return finest._replace(reach=read_only(reach), parted=read_only(parted))
