"""Saddle points of the light in micro images: where corners of a checkerboard may be."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.calibration.corners.patches import Patches
from plenoptic.core.values import Floats

_SCALE, _FILL = 1.2, 1.5
"""Standard deviations in pixels of the bells by which light is differentiated, and continued beyond micro images."""
_MIN_CURVATURE, _NOISE = 0.01, 4.0
"""Least curvature of a saddle in units of the bright light, and in medians of all."""
_SAMPLE, _CHUNK = 500, 2048
"""Micro images that give the least curvature, and those that are searched together."""


class Saddles(NamedTuple):
    """Saddle points (m, ...)."""

    image: NDArray[np.int64]
    """Row of the micro image in `Patches`."""
    pixel: Floats
    """(m, 2)."""
    angle: Floats
    """(m, 2): angles of the normals of the lines of constant light, as `CornerFit.angle`."""


def saddle_points(patches: Patches) -> Saddles:
    """Local maxima of minus the determinant of the Hessian matrix in micro images."""
    n = len(patches.lattice_index)
    sample = patches.rows(np.arange(0, n, max(1, n // _SAMPLE)))
    light = _continue(sample)
    strength = _curvatures(light)[3][sample.weight > 0]
    level = max(_MIN_CURVATURE * float(np.quantile(light, 0.95)), _NOISE * float(np.median(strength)))
    parts = [_saddles(patches.rows(np.arange(k, min(k + _CHUNK, n))), k, level) for k in range(0, n, _CHUNK)]
    return Saddles(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def _saddles(patches: Patches, first: int, level: float) -> Saddles:
    rr, cc, rc, strength = _curvatures(_continue(patches))
    middle, span = strength[:, 1:-1, 1:-1], strength.shape[1] - 2
    neighbours = [strength[:, i : i + span, j : j + span] for i in (0, 1, 2) for j in (0, 1, 2)]
    is_peak = (middle >= np.max(neighbours, axis=0)) & (middle > level) & (patches.weight[:, 1:-1, 1:-1] > 0)
    image, row, column = np.nonzero(is_peak)
    shift = []
    for before, after in ((neighbours[1], neighbours[7]), (neighbours[3], neighbours[5])):
        low, high = before[image, row, column], after[image, row, column]
        bend = np.maximum(2.0 * middle[image, row, column] - low - high, 1e-300)
        shift.append(np.clip(0.5 * (high - low) / bend, -0.5, 0.5))
    at = image, row + 1, column + 1
    pixel = (patches.corner[image] + np.stack(at[1:], axis=1)).astype(np.float64) + np.stack(shift, axis=1)
    return Saddles(image + first, pixel, _normals(rr[at], cc[at], rc[at]))


def _curvatures(light: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Second derivatives along rows, along columns and mixed, and the root of minus their determinant."""
    g0, g1, g2 = _bells(light.shape[1], _SCALE)
    rr, cc, rc = g2 @ light @ g0.T, g0 @ light @ g2.T, g1 @ light @ g1.T
    return rr, cc, rc, np.sqrt(np.maximum(rc**2 - rr * cc, 0.0))


def _normals(rr: Floats, cc: Floats, rc: Floats) -> Floats:
    """Angles (m, 2) of the normals of both lines of constant light through saddles with these second derivatives."""
    bright = 0.5 * np.arctan2(2.0 * rc, rr - cc)
    mean, half = 0.5 * (rr + cc), np.hypot(0.5 * (rr - cc), rc)
    alpha = np.arctan2(np.sqrt(np.maximum(half - mean, 0.0)), np.sqrt(np.maximum(half + mean, 0.0)))
    return np.asarray(np.stack([bright - alpha, bright + alpha], axis=1))


def _bells(size: int, scale: float) -> tuple[Floats, Floats, Floats]:
    """Matrices (size, size) that smooth by a normal distribution, and give the first and second derivative."""
    x = np.arange(size) - np.arange(size)[:, None]
    bell = np.exp(-0.5 * (x / scale) ** 2)
    bell /= bell.sum(axis=1, keepdims=True)
    return bell, bell * x / scale**2, bell * (x**2 / scale**2 - 1.0) / scale**2


def _continue(patches: Patches) -> Floats:
    """Light continued smoothly to where the weight is 0."""
    bell, inside = _bells(patches.light.shape[1], _FILL)[0], patches.weight > 0
    smooth = bell @ (patches.light * inside) @ bell.T / np.maximum(bell @ inside @ bell.T, 1e-6)
    return np.where(inside, patches.light, smooth)
