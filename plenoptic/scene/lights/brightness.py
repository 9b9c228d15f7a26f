"""How bright a scene is: what a path may bring that has not been sampled."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.scene.compile import SceneTables


def brightest_radiance(tables: SceneTables) -> float:
    """About the brightest radiance that a path can bring: of what emits, the world, or matt surfaces under lights.

    Parameters
    ----------
    tables : SceneTables

    Returns
    -------
    float
        Channels are averaged. Textures and maps count with their mean; point lights as seen from the middle of the
        scene.

    Examples
    --------
    >>> import plenoptic as pl
    >>> from plenoptic.scene.lights.brightness import brightest_radiance
    >>> brightest_radiance(pl.white_plane().tables())
    1.0
    """
    lights, found = tables.lights, [0.0]
    for rows in (tables.emission, tables.background):
        if rows is not None:
            found.append(float(np.atleast_2d(rows).mean(axis=1).max()))
    if tables.environment is not None:
        found.append(tables.environment.total / math.pi)
    if lights.suns is not None and lights.sun_colours is not None:
        angle = 2 * math.pi * lights.suns[:, 3]
        irradiance = lights.sun_colours.mean(axis=1) * np.where(angle > 0, angle, 1.0)
        found.append(float(irradiance.max()) / math.pi)
    if lights.point_colours is not None:
        found.append(float(lights.point_colours.mean(axis=1).max()) / (math.pi * (lights.far / 4) ** 2))
    return max(found)
