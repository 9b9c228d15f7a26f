"""Focal lengths of microlenses from the blur of corners."""

from __future__ import annotations

import numpy as np

from plenoptic.calibration.observations import Observations
from plenoptic.core.values import Floats
from plenoptic.optics.microlens.lattice import Lattice, default_pattern

_SEPARATION = 3.0
"""Distance between types, over the scatter within a type, from which types are told apart."""


def focal_lengths(observations: Observations, vergence: Floats, gap: float, pitch: float) -> tuple[float, ...]:
    """Focal length in mm of each type of microlens, in the order of `MicrolensArray.pattern`.

    With the inverse distance v (n,) in 1/mm from each corner's image by the main lens to the array, the distance d from
    array to sensor, and a signed radius of blur rho, 1 / f = 2 rho / (d pitch) + 1 / d + v: lenses fill their cells.
    Without blur there is one type, in focus at the median v.
    """
    if observations.blur is None or np.all(observations.blur >= 0):
        return (1.0 / (1.0 / gap + float(np.median(vergence))),)
    power = 2.0 * observations.blur * observations.sensor.pixel_pitch / (gap * pitch) + 1.0 / gap + vergence
    types = 3 if observations.lattice is Lattice.HEXAGONAL else 2
    pattern = default_pattern(types)
    kind = pattern[tuple(np.mod(observations.index, types).T)]
    if len(np.unique(kind)) < types:
        return (1.0 / float(np.median(power)),)
    powers = np.array([np.median(power[kind == k]) for k in range(types)])
    scatter = float(np.median(np.abs(power - powers[kind]))) / 0.6745
    if not np.diff(np.sort(powers)).min() > _SEPARATION * scatter:
        return (1.0 / float(np.median(power)),)
    return tuple((1.0 / powers).tolist())
