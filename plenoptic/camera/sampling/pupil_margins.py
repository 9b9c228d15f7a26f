"""Bounds on the exit pupil, seen from the microlenses in use, and margins for rays of real microlenses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from plenoptic.camera.assembly import Assembly, sensor_corners
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.diffraction import deflection_reach
from plenoptic.camera.sampling.sampling_records import GROUP_SIDE
from plenoptic.core.values import Floats, read_only
from plenoptic.optics.lens.pupil.exit_pupil import PupilBounds, pupil_bounds, rear_reach
from plenoptic.optics.lens.pupil.outline import polygon_around
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.imperfections import largest_offset
from plenoptic.optics.microlens.microlens_record import SensorPlane, lone_lens
from plenoptic.optics.microlens.model_records import ArrayCrossing

_N_AIMS, _N_OFFSETS = 33, 49
_SAFETY = 1.25
"""Factor on margins that are computed on a grid of rays."""


class ArrayBounds(NamedTuple):
    """Bounds from which aperture regions are computed."""

    pupil: PupilBounds
    margin: float
    """Largest deviation of real rays from those of an ideal microlens, on the plane of the outlines, in mm."""
    lateral: float
    """Largest lateral displacement of rays between principal plane and curved side, in mm."""
    reach: float
    """Largest distance from the lens's axis of microlenses in use, in mm."""


def sensor_bounds(camera: PlenopticCamera, parts: Assembly, wavelengths: tuple[float, ...]) -> PupilBounds:
    """Outlines of the pupil seen from the sensor, for cameras without microlenses."""
    corners = sensor_corners(camera, parts)
    farthest = float(np.hypot(corners[:, 0], corners[:, 1]).max())
    heights = parts.z_plane + corners[:, 2]
    return _envelope(camera, heights, farthest, GROUP_SIDE * camera.sensor.pixel_pitch / np.sqrt(2), wavelengths)


def array_bounds(
    camera: PlenopticCamera, array: MicrolensArray, parts: Assembly, powers: Floats, wavelengths: tuple[float, ...]
) -> ArrayBounds:
    """Outlines of the pupil for all cells in use, and margins for the rays of real microlenses.

    A ray from the sensor at s through the point d of the cell at c crosses the plane of the outlines at
    c + ratio (c - s) + height_factor d, up to the margin, and passes the lens at most a + b |c| from the axis there.
    """
    a, b = rear_reach(camera.lens, parts.z_plane, wavelengths[0])
    pupil_distance = parts.z_plane - float(camera.lens.vertices[-1])
    corners = sensor_corners(camera, parts, deflection_reach(camera))
    ratio = pupil_distance / float(corners[:, 2].min())
    sensor_radius = float(np.hypot(*parts.local_to_lens.points(corners)[:, :2].T).max())
    tilt = float(np.hypot(*parts.local_to_lens.turn[2, :2]))
    strongest = max(abs(_ray_height_factor(array, power, pupil_distance, ratio)) for power in powers)
    decentre_margin = largest_offset(array.imperfections) * max(
        abs(pupil_distance * power) for power in (*powers, (1 + ratio) / pupil_distance)
    )
    margin, lateral = (1.0 + tilt) * _chromatic_margin(array, powers, wavelengths, pupil_distance), 0.0
    iterations = 2 if array.is_plate else 1
    while True:
        farthest = (1.0 + tilt) * ratio * sensor_radius + a + strongest * array.cell_radius + margin + decentre_margin
        widest = 1.02 * farthest / max(1.0 + ratio - b, 0.1 * (1.0 + ratio)) + array.cell_radius + lateral
        heights = parts.z_plane + tilt * (widest + sensor_radius) * np.array([-1.0, 0.0, 1.0])
        bounds = _envelope(camera, heights, widest, array.cell_radius + lateral, wavelengths)
        iterations -= 1
        if iterations == 0:
            return ArrayBounds(bounds, margin, lateral, widest)
        reach = float(bounds.reach.max()) + widest
        distance = pupil_distance / ratio
        height_factors = [
            (power, _ray_height_factor(array, power, pupil_distance, ratio)) for power in powers if power > 0
        ]
        disperses = any(array.index_at(wavelength) != array.index for wavelength in wavelengths)
        margins = [
            aberration_margins(array, wavelength, power, distance, pupil_distance, height_factor, reach)
            for wavelength in (wavelengths if disperses else wavelengths[:1])
            for power, height_factor in height_factors
        ]
        margin, lateral = (1.0 + tilt) * max(m[0] for m in margins), (1.0 + tilt) * max(m[1] for m in margins)


def aberration_margins(
    array: MicrolensArray,
    wavelength: float,
    power: float,
    distance: float,
    pupil_distance: float,
    height_factor: float,
    reach: float,
) -> tuple[float, float]:
    """Largest deviation of real from ideal rays on the plane of the outlines, and on the curved side, in mm.

    Rays of one lens are aimed from a row of sensor points at a grid of points on its rear principal plane. Rays count
    if they exit the curved side inside the cell and cross the plane of the outlines within `reach` of the microlens's
    axis. A microlens is round, so that one row of sensor points represents all. Ideal rays are those at 587.6 nm.
    """
    from plenoptic.core.kernels.ray_blocks import BLOCK

    refraction = array.model.refraction
    lens = ArrayCrossing(lone_lens(array, power, wavelength), SensorPlane(distance, None), pupil_distance)
    aims = np.linspace(-1.5 * array.cell_radius, 1.5 * array.cell_radius, _N_AIMS)
    margin = lateral = 0.0
    for _ in range(4):
        # Sensor points as far from the lens's axis as valid rays can start.
        farthest = (reach + abs(height_factor) * array.cell_radius + margin) * distance / pupil_distance
        dx, dy, sx = (g.ravel() for g in np.meshgrid(aims, aims, np.linspace(0.0, farthest, _N_OFFSETS), indexing="ij"))
        fields = np.zeros((8, -(-dx.size // BLOCK) * BLOCK))
        for row, column in ((0, dx), (1, dy), (3, dx - sx), (4, dy)):
            fields[row, : dx.size] = column
        blocks = np.ascontiguousarray(fields.reshape(8, -1, BLOCK).transpose(1, 0, 2))
        refraction.to_lens(blocks.reshape(-1), None, lens, None)
        x, y, z, u, v, w, _, status = blocks.transpose(1, 0, 2).reshape(8, -1)[:, : dx.size]
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            exit_x, exit_y = refraction.exit_points(
                array, power, (dx, dy), ((dx - sx) / distance, dy / distance), (x, y)
            )
            t = -z / w
            real_x, real_y = x + t * u, y + t * v
            valid = (status == 0) & (np.hypot(exit_x, exit_y) <= array.cell_radius)
            valid &= np.hypot(real_x, real_y) <= reach
            deviation = np.hypot(
                real_x - (height_factor * dx - pupil_distance / distance * sx), real_y - height_factor * dy
            )[valid]
            displacement = np.hypot(exit_x - dx, exit_y - dy)[valid]
        if not deviation.size:
            break
        converged = deviation.max() <= 1.01 * margin
        margin, lateral = (
            max(margin, _SAFETY * float(deviation.max())),
            max(lateral, _SAFETY * float(displacement.max())),
        )
        if converged:
            break
    return margin, lateral


def _chromatic_margin(
    array: MicrolensArray, powers: Floats, wavelengths: tuple[float, ...], pupil_distance: float
) -> float:
    """Lateral colour of ideal microlenses against 587.6 nm, on the plane of the outlines, in mm."""
    if not array.model.refraction.is_thin:
        return 0.0
    change = max(abs(array.power_factor(wavelength) - 1.0) for wavelength in wavelengths)
    height = array.cell_radius + largest_offset(array.imperfections)
    return _SAFETY * abs(pupil_distance) * change * float(np.abs(powers).max()) * height


def _ray_height_factor(array: MicrolensArray, power: float, pupil_distance: float, ratio: float) -> float:
    """Displacement of a ray on the plane of the outlines per displacement of its point in the cell."""
    return 1.0 + ratio - pupil_distance * power if array.model.focuses else 0.0


def _envelope(
    camera: PlenopticCamera, heights: Floats, largest_radius: float, cell_radius: float, wavelengths: tuple[float, ...]
) -> PupilBounds:
    """Envelope of the outlines seen from planes between the least and the greatest height, at all wavelengths."""
    low, high = float(heights.min()), float(heights.max())
    all_bounds = [
        pupil_bounds(
            camera.lens, z_plane=z, largest_radius=largest_radius, cell_radius=cell_radius, wavelength=wavelength
        )
        for z in ((low,) if high - low <= 1e-12 * abs(high) else (low, high))
        for wavelength in wavelengths
    ]
    if len(all_bounds) == 1:
        return all_bounds[0]
    finest = max(all_bounds, key=lambda bounds: len(bounds.support))
    support = np.full_like(np.asarray(finest.support), -np.inf)
    parted = np.zeros(len(support), dtype=np.bool_)
    for bounds in all_bounds:
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
