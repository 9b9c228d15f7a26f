"""Dust and scratches in a camera, which attenuate light between sensor, array and lens."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from plenoptic.camera.assembly import Assembly
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.optics.microlens.dust import Blemishes, BlemishSite, DustRecord, dust_record, plane_axes

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera

BETWEEN = (BlemishSite.SENSOR, BlemishSite.ARRAY)
"""Sites between sensor and array."""


class PlacedDust(NamedTuple):
    """Dust and scratches with the axes of their plane."""

    site: BlemishSite
    height: float | None
    """SENSOR: height in front of it in mm; None on the array; on the lens, z of the plane in mm."""
    axes: Floats | None
    """(2, 3): from the axes of rays at the plane to those of the plane; None if they are the same."""
    record: DustRecord


def placed_dust(camera: PlenopticCamera, parts: Assembly) -> tuple[PlacedDust, ...]:
    """Dust and scratches of a camera, with their planes."""
    dust, vertices = [], camera.lens.vertices
    for part in filter(len, camera.blemishes):
        axes: Floats | None = None
        height: float | None = None
        if part.site is BlemishSite.SENSOR:
            axes, height = plane_axes(*parts.sensor_to_local, height=part.height), part.height
        elif part.site is BlemishSite.ARRAY:
            turn = np.eye(3)
            turn[:2, :2] = parts.array_turn
            axes = plane_axes(turn, np.append(parts.array_origin, 0.0))
        else:
            height = float(vertices[-1] if part.site is BlemishSite.LENS_REAR else vertices[0])
        dust.append(PlacedDust(part.site, height, axes, dust_record(part)))
    return tuple(dust)


def fill_dust_at_lens(blocks: Floats, dust: tuple[PlacedDust, ...], site: BlemishSite) -> None:
    """Attenuate rays by dust on the lens: LENS_REAR on its sensor side, LENS_FRONT on its scene side."""
    for blemish in dust:
        if blemish.site is site:
            from plenoptic.optics.microlens.kernels.dust_transmission import fill_ray_transmission

            fill_ray_transmission(blocks, blemish.height, blemish.axes, blemish.record)


def check_blemishes(camera: PlenopticCamera) -> None:
    """Raise an InvalidValueError for blemishes of another type, or on a site that the camera lacks."""
    if not all(isinstance(part, Blemishes) for part in camera.blemishes):
        raise InvalidValueError(f"blemishes is {camera.blemishes!r}; it must be a tuple of Blemishes")
    clearance = (
        camera.microlenses_to_sensor if camera.microlenses else camera.z_sensor - float(camera.lens.vertices[-1])
    )
    for blemishes in camera.blemishes:
        if blemishes.site is BlemishSite.ARRAY and camera.microlenses is None:
            raise InvalidValueError("blemishes lie on the array, and the camera has none; choose another site")
        if blemishes.height >= clearance:
            raise InvalidValueError(
                f"blemishes lie {blemishes.height:g} mm in front of the sensor, and the next part is "
                f"{clearance:g} mm away; reduce their height"
            )
