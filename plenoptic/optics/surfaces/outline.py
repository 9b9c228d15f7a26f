"""Sections of elements: what a drawing of a lens shows."""

from __future__ import annotations

import numpy as np

from plenoptic.core.values import Floats
from plenoptic.optics.lens.placement import Placement
from plenoptic.optics.stops.registry import Stop
from plenoptic.optics.surfaces.surface import Surface


def section(element: Surface | Stop, points: int) -> Floats:
    """Points (n, 2), z and y in mm from the vertex, on the section of an element in the plane x = 0 of its axes."""
    if isinstance(element, Surface) and element.depth is not None:
        # An ellipse by its angle, so that the part beyond the equator has points too.
        pole = abs(element.radius) / (1.0 + element.conic)
        angle = np.linspace(-1.0, 1.0, points) * np.arccos(1.0 - element.depth / pole)
        z = np.copysign(pole, element.radius) * (1.0 - np.cos(angle))
        return np.stack([z, element.equator * np.sin(angle)], axis=1)
    y = np.linspace(-element.semi_diameter, element.semi_diameter, points)
    sag = element.sag(0.0, y) if isinstance(element, Surface) else np.zeros_like(y)
    return np.stack([sag, y], axis=1)


def placed(points: Floats, z: float, placement: Placement | None) -> Floats:
    """The points of a section in the lens frame, its vertex at z."""
    if placement is not None:
        local = np.column_stack([np.zeros(len(points)), points[:, 1], points[:, 0]])
        points = (local @ np.asarray(placement.rotation).T + placement.shift)[:, :0:-1]
    return np.asarray(points + np.array([z, 0.0]))
