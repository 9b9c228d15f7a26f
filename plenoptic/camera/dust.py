"""Dust and scratches in a camera: what dims light between sensor, array and lens."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from plenoptic.camera.assembly import Assembly
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.values import Floats
from plenoptic.optics.microlens.dust import BlemishSite, DustRecord, dust_record, plane_axes
from plenoptic.optics.microlens.record import SensorPlane


class PlacedDust(NamedTuple):
    """Dust and scratches with the axes of their plane."""

    site: BlemishSite
    height: float
    """SENSOR: in front of it; on the lens, z of the plane."""
    axes: Floats | None
    """(2, 3): from the axes in which rays are there to those of the plane; None where they are the same."""
    record: DustRecord


def placed_dust(camera: PlenopticCamera, parts: Assembly) -> tuple[PlacedDust, ...]:
    """All dust of a camera."""
    found, vertices = [], camera.lens.vertices
    for part in camera.blemishes:
        if not len(part):
            continue
        site, axes, height = part.site, None, part.height
        if site is BlemishSite.SENSOR:
            axes = plane_axes(*parts.sensor_to_local, height=height)
        elif site is BlemishSite.ARRAY:
            turn = np.eye(3)
            turn[:2, :2] = parts.array_turn
            axes = plane_axes(turn, np.append(parts.array_origin, 0.0))
        else:
            height = float(vertices[-1] if site is BlemishSite.LENS_REAR else vertices[0])
        found.append(PlacedDust(site, height, axes, dust_record(part)))
    return tuple(found)


def fill_dimmed_aims(blocks: Floats, sensor: SensorPlane, dust: tuple[PlacedDust, ...]) -> None:
    """Dust between sensor and array dims aimed samples."""
    from plenoptic.optics.microlens.kernels import dust as kernels

    for placed in dust:
        if placed.site is BlemishSite.SENSOR:
            kernels.fill_dimmed_aims(blocks, sensor, placed.height, placed.axes, placed.record)
        elif placed.site is BlemishSite.ARRAY:
            kernels.fill_dimmed_aims(blocks, sensor, None, placed.axes, placed.record)


def fill_dimmed_at_lens(blocks: Floats, dust: tuple[PlacedDust, ...], site: BlemishSite) -> None:
    """Dust on the lens: LENS_REAR before, LENS_FRONT behind the lens as seen from the sensor."""
    for placed in dust:
        if placed.site is site:
            from plenoptic.optics.microlens.kernels import dust as kernels

            kernels.fill_dimmed_rays(blocks, placed.height, placed.axes, placed.record)
