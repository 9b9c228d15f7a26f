"""Inference of missing data of a prescription: position and size of the stop."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import cast

import numpy as np

from plenoptic.core.values import Floats
from plenoptic.optics.glass.media import AIR, D_LINE, Medium
from plenoptic.optics.lens.elements import Element
from plenoptic.optics.stops.circle import CircularStop
from plenoptic.optics.surfaces.mirror import Mirror, medium_behind
from plenoptic.optics.surfaces.surface import Surface


def basis_rays(
    elements: Sequence[Element], *, front_medium: Medium = AIR, wavelength: float = D_LINE
) -> tuple[Floats, Floats]:
    """Heights (n, 2) at all elements of two paraxial rays, and (2, 2) their last heights and reduced angles behind.

    At the first element they have height 1 and angle 0, and height 0 and reduced angle (angle times index) 1.
    """
    height, angle = np.array([1.0, 0.0]), np.array([0.0, 1.0])
    index, heights = front_medium.index(wavelength), []
    for element in elements:
        heights.append(height)
        if isinstance(element, Surface):
            behind = index if isinstance(element.medium, Mirror) else element.medium.index(wavelength)
            angle = angle + (index - element.signed_index(behind)) * element.vertex_curvature * height
            index = behind
        height = height + angle * (element.thickness / index)
    return np.array(heights), np.array([heights[-1], angle])


def _axial_heights(surfaces: list[Surface]) -> list[float]:
    """Heights at the surfaces of a paraxial axial ray: from infinity, or from the front focus if no image is behind."""
    heights, (last, angle) = basis_rays(surfaces)
    has_real_image = angle[0] == 0 or -last[0] / angle[0] > 0
    start = np.array([1.0, 0.0]) if has_real_image else np.array([angle[1], -angle[0]])
    return [abs(float(start @ pair)) for pair in heights]


def with_inferred_stop(surfaces: list[Surface]) -> list[Element]:
    """The surfaces, in air, with a stop in the middle of the longest air gap; the rule is in `load_lens`."""
    with np.errstate(all="ignore"):  # an overflow gives a stop that is refused
        heights = _axial_heights(surfaces)
    # A surface at which the ray height is 0 does not limit the beam.
    limits = [s.semi_diameter / height for s, height in zip(surfaces, heights, strict=True) if height > 0]
    beam = min(limits, default=math.nan)
    gaps, medium = list[float](), cast(Medium, AIR)
    for surface in surfaces[:-1]:
        medium = medium_behind(surface.medium, medium)
        gaps.append(surface.thickness if medium == AIR else -1.0)
    longest = max(gaps, default=-1.0)
    if longest < 0:
        return [CircularStop(beam * heights[0], 0.0), *surfaces]
    i = gaps.index(longest)
    in_front = dataclasses.replace(surfaces[i], thickness=longest / 2)
    stop = CircularStop(beam * (heights[i] + heights[i + 1]) / 2, longest / 2)
    return [*surfaces[:i], in_front, stop, *surfaces[i + 1 :]]
