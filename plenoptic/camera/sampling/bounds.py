"""Where light can pass the exit pupil on its way to the microlenses that matter: bounds for a whole camera."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from plenoptic.camera.assembly import Assembly, sensor_corners
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.sampling.margins import SAFETY, aberration_margins
from plenoptic.core.values import Floats, read_only
from plenoptic.optics.lens.pupil.exit_pupil import PupilBounds, outline_corners, pupil_bounds, rear_reach
from plenoptic.optics.microlens.array import MicrolensArray


class Bounds(NamedTuple):
    """What the regions that feed pixels are made of."""

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
    half_pixel = camera.sensor.pixel_pitch / np.sqrt(2)
    return _united(camera, heights, farthest, half_pixel, wavelengths)


def array_bounds(
    camera: PlenopticCamera, array: MicrolensArray, parts: Assembly, powers: Floats, wavelengths: tuple[float, ...]
) -> Bounds:
    """Outlines for all cells that matter, and how far the rays of real microlenses stray.

    A ray from the sensor at s crosses the plane of the outlines at c + ratio (c - s) + bend d for the point d of the
    cell at c, to within the margin, and passes the lens no farther from the axis than a + b |c| there.
    """
    a, b = rear_reach(camera.lens, parts.z_plane, wavelengths[0])
    pupil_distance = parts.z_plane - float(camera.lens.vertices[-1])
    corners = sensor_corners(camera, parts)
    ratio = pupil_distance / float(corners[:, 2].min())
    in_lens, tilt = parts.local_to_lens.points(corners), float(np.hypot(*parts.local_to_lens.turn[2, :2]))
    sensor = float(np.hypot(in_lens[:, 0], in_lens[:, 1]).max())
    strongest = max(abs(_bend(array, power, pupil_distance, ratio)) for power in powers)
    off_axis = _off_axis(array) * max(abs(pupil_distance * power) for power in (*powers, (1 + ratio) / pupil_distance))
    margin, aside = (1.0 + tilt) * _chromatic_margin(array, powers, wavelengths, pupil_distance), 0.0
    rounds = 2 if array.is_plate else 1
    while True:
        farthest = (1.0 + tilt) * ratio * sensor + a + strongest * array.cell_radius + margin + off_axis
        widest = 1.02 * farthest / max(1.0 + ratio - b, 0.1 * (1.0 + ratio)) + array.cell_radius + aside
        heights = parts.z_plane + tilt * (widest + np.hypot(*in_lens[:, :2].T).max()) * np.array([-1.0, 0.0, 1.0])
        bounds = _united(camera, heights, widest, array.cell_radius + aside, wavelengths)
        rounds -= 1
        if rounds == 0:
            return Bounds(bounds, margin, aside, widest)
        reach = float(bounds.reach.max()) + widest
        distance = pupil_distance / ratio
        bends = [(power, _bend(array, power, pupil_distance, ratio)) for power in powers if power > 0]
        disperses = any(array.index_at(wavelength) != array.index for wavelength in wavelengths)
        found = [
            aberration_margins(array, wavelength, power, distance, pupil_distance, bend, reach)
            for wavelength in (wavelengths if disperses else wavelengths[:1])
            for power, bend in bends
        ]
        margin, aside = (1.0 + tilt) * max(f[0] for f in found), (1.0 + tilt) * max(f[1] for f in found)


def _chromatic_margin(
    array: MicrolensArray, powers: Floats, wavelengths: tuple[float, ...], pupil_distance: float
) -> float:
    """How far ideal lenses of another power than at 587.6 nm send rays aside on the plane of the outlines, in mm."""
    if array.is_plate or not array.model.focuses:
        return 0.0
    change = max(abs(array.power_factor(wavelength) - 1.0) for wavelength in wavelengths)
    height = array.cell_radius + _off_axis(array)
    return SAFETY * abs(pupil_distance) * change * float(np.abs(powers).max()) * height


def _bend(array: MicrolensArray, power: float, pupil_distance: float, ratio: float) -> float:
    """How far a ray moves on the plane of the outlines when its point in the cell moves by 1."""
    return 1.0 + ratio - pupil_distance * power if array.model.focuses else 0.0


def _off_axis(array: MicrolensArray) -> float:
    """How far an optical axis may lie from its cell's centre, in mm."""
    if array.imperfections is None:
        return 0.0
    from plenoptic.optics.microlens.imperfections import largest_offset

    return largest_offset(array.imperfections)


def _united(
    camera: PlenopticCamera, heights: Floats, largest: float, cell_radius: float, wavelengths: tuple[float, ...]
) -> PupilBounds:
    """Outlines that hold those of planes of all heights, from the least to the greatest, and of all wavelengths."""
    low, high = float(heights.min()), float(heights.max())
    found = [
        pupil_bounds(camera.lens, z_plane=z, largest_radius=largest, cell_radius=cell_radius, wavelength=wavelength)
        for z in ((low,) if high - low <= 1e-12 * abs(high) else (low, high))
        for wavelength in wavelengths
    ]
    if len(found) == 1:
        return found[0]
    finest = max(found, key=lambda bounds: len(bounds.support))
    support = np.full_like(np.asarray(finest.support), -np.inf)
    for bounds in found:
        # An interval of the finest division lies in one or two of a coarser one.
        first = np.floor(np.arange(len(support)) * finest.step / bounds.step + 1e-9).astype(int)
        last = np.floor(np.arange(1, len(support) + 1) * finest.step / bounds.step - 1e-9).astype(int)
        for rows in (first, last):
            support = np.maximum(support, bounds.support[np.clip(rows, 0, len(bounds.support) - 1)])
    lit = np.isfinite(support[:, 0])
    outline = outline_corners(np.where(lit[:, None], support, 0.0))
    reach = np.where(lit, np.linalg.norm(outline, axis=-1).max(axis=-1), 0.0)
    return finest._replace(support=read_only(support), corners=read_only(outline), reach=read_only(reach))
