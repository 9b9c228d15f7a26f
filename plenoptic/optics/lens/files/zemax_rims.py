"""Heights of the real beam on elements without semi-diameters in a Zemax file."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.values import Floats
from plenoptic.optics.lens.analysis.few_rays import few_unclipped_rays
from plenoptic.optics.lens.stack import LensStack

_AZIMUTHS = 16
"""Rays of each field through the rim of the entrance pupil."""


def ray_heights(
    lens: LensStack, slopes: Floats, pupil: float, pupil_radius: float, distance: float, wavelength: float
) -> Floats:
    """Largest distance from the axis in mm of real rays on each element, (k,); 0 where none arrives.

    The rays of each field pass the centre and the rim of the paraxial entrance pupil; rims and stops do not clip them.

    Parameters
    ----------
    lens : LensStack
        With any semi-diameters.
    slopes : (n, 2) array
        Slopes of the chief rays in front of the lens.
    pupil, pupil_radius : float
        Distance of the entrance pupil behind the first element, and its radius, mm.
    distance : float
        From the object to the first element in mm; inf for a far object.
    wavelength : float
        nm.
    """
    azimuths = 2.0 * math.pi * np.arange(_AZIMUTHS) / _AZIMUTHS
    rim = pupil_radius * np.vstack([np.zeros(2), np.column_stack([np.cos(azimuths), np.sin(azimuths)])])
    first = float(lens.vertices[0])
    points = np.column_stack([rim, np.full(len(rim), first + pupil)])
    origins, directions = [], []
    for slope in slopes:
        direction = np.tile([*slope, 1.0], (len(points), 1))
        if math.isfinite(distance):
            source = np.array([*(-slope * (distance + pupil)), first - distance])
            direction = (points - source) * math.copysign(1.0, distance + pupil)
        # From the plane of the first vertex; rays are lines.
        origins.append(points - pupil * direction / direction[:, 2:])
        directions.append(direction)
    on_elements = few_unclipped_rays(lens, np.concatenate(origins), np.concatenate(directions), wavelength)[:, 1:]
    heights = np.hypot(on_elements[..., 0], on_elements[..., 1])
    return np.asarray(np.where(np.isfinite(heights), heights, 0.0).max(axis=0))
