"""How bright a scene is: what a path may bring that has not been sampled."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.scene.compile import SceneRecord


def brightest_radiance(record: SceneRecord) -> float:
    """About the brightest radiance that a path can bring: of what emits, the world, or matt surfaces under lights.

    Channels are averaged. Textures and maps count with their mean; point lights as seen from the middle of the scene.
    """
    lights, sky, found = record.lights, record.lights.sky, [0.0]
    for rows in (None if record.emission is None else record.emission.radiance, sky.background):
        if rows is not None:
            found.append(float(np.atleast_2d(rows).mean(axis=1).max()))
    if sky.environment is not None:
        found.append(sky.environment.total / math.pi)
    if sky.suns is not None and sky.sun_colors is not None:
        angle = 2 * math.pi * sky.suns["cap"]
        irradiance = sky.sun_colors.mean(axis=1) * np.where(angle > 0, angle, 1.0)
        found.append(float(irradiance.max()) / math.pi)
    if lights.point_colors is not None:
        found.append(float(lights.point_colors.mean(axis=1).max()) / (math.pi * (lights.far / 4) ** 2))
    return max(found)
