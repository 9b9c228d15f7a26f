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
    Blur that is nowhere negative has the sign with which 1 / f varies least. Without blur there is one type, in focus
    at the median v.
    """
    if observations.blur is None:
        return (1.0 / (1.0 / gap + float(np.median(vergence))),)
    blur = 2.0 * observations.blur * observations.sensor.pixel_pitch / (gap * pitch)
    types = 3 if observations.lattice is Lattice.HEXAGONAL else 2
    pattern = default_pattern(types)
    kind = pattern[tuple(np.mod(observations.index, types).T)]
    power = _power(blur, 1.0 / gap + vergence)
    if len(np.unique(kind)) < types:
        return (1.0 / float(np.median(power)),)
    separate = power.copy()
    for k in range(types):
        separate[kind == k] = _power(blur[kind == k], 1.0 / gap + vergence[kind == k])
    powers = np.array([np.median(separate[kind == k]) for k in range(types)])
    scatter = _scatter(separate - powers[kind])
    if not np.diff(np.sort(powers)).min() > _SEPARATION * scatter:
        return (1.0 / float(np.median(power)),)
    return tuple((1.0 / powers).tolist())


def _power(blur: Floats, focused: Floats) -> Floats:
    """1 / f (n,) of one type of microlens, from blur (n,) in that unit and the 1 / f that would focus the corner."""
    trials = (focused + blur, focused - blur)
    if (blur < 0).any():
        return trials[0]
    return min(trials, key=lambda power: _scatter(power - np.median(power)))


def _scatter(values: Floats) -> float:
    """Standard deviation, by the median."""
    return float(np.median(np.abs(values))) / 0.6745
