"""Virtual points: images of one corner in several micro images, brought together without knowledge of the camera.

The image of a point in the micro image centred at c is p = c + (x - c) w, where x is the virtual point, projected onto
the array along the axis, and w the reciprocal virtual depth, positive behind the array (Galilean), negative in front.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.calibration.corners.corner_fit import CornerFit
from plenoptic.core.values import Floats

_REACH = 2.7
"""Largest distance of micro images that are compared, in pitches: two rings, which hold all types of microlenses."""
_TOLERANCE = 0.35
"""Largest deviation of corresponding corners from a common virtual point, in pixels."""
_MIN_W, _MAX_W = 0.02, 0.95
"""Range of the size of w."""
_MISSING = 0.4
"""Cost of a micro image that should show a corner, and does not, in units of one that does."""
_MIN_IMAGES = 3
"""Least corners of a virtual point."""
_REJECTIONS = 3
_MAX_SINE = 0.5
"""Sine of the largest angle between the bright quadrants of images of one corner."""


class _Pairs(NamedTuple):
    """Pairs of corners in neighbouring micro images, (m,)."""

    first: NDArray[np.int64]
    second: NDArray[np.int64]
    w: Floats
    length: Floats
    """Distance of the micro images' centres in pixels."""


class VirtualPoints(NamedTuple):
    """Virtual points (k, ...)."""

    position: Floats
    """(k, 2): row and column in pixels."""
    w: Floats
    """Reciprocal virtual depth."""
    images: NDArray[np.int64]
    """Number of micro images that show it."""
    angle: Floats
    """(k, 2): angles of the edges' normals, modulo pi and in any order; between them on the way to greater angles is
    a bright quadrant."""


def virtual_points(
    index: NDArray[np.int64], centre: Floats, corners: CornerFit, basis: Floats, radius: float
) -> VirtualPoints:
    """Virtual points of corners in micro images with these indices and centres (n, 2), one for each corner.

    For each corner, the w is taken with which most of the neighbouring micro images show it where they should. Corners
    that agree mutually have one virtual point.
    """
    n = len(index)
    reach = int(np.ceil(_REACH)) + 1
    steps = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    length = np.hypot(*(steps @ basis).T)
    steps = steps[(length < _REACH * length[length > 0].min()) & (length > 0)]
    pairs = _pairs(index, centre, corners, steps)
    w, score = _best_w(index, corners.pixel - centre, pairs, steps @ basis, radius)
    a, b, w_pair, length = pairs
    agrees = (np.abs(w_pair - w[a]) * length < _TOLERANCE) & (np.abs(w_pair - w[b]) * length < 2.0 * _TOLERANCE)
    agrees &= (score[a] > 0) & (score[b] > 0)
    return _fit_points(_components(n, a[agrees], b[agrees]), centre, corners)


def _pairs(index: NDArray[np.int64], centre: Floats, corners: CornerFit, steps: NDArray[np.int64]) -> _Pairs:
    """Pairs of corners that may be images of one point."""
    if not len(index):
        return _Pairs(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0), np.zeros(0))
    low = index.min(axis=0) - np.abs(steps).max()
    width = int(np.ptp(index[:, 1])) + 2 * int(np.abs(steps).max()) + 1
    key = (index - low) @ (width, 1)
    order = np.argsort(key, kind="stable")
    first, second = [], []
    for step in (steps @ (width, 1)).tolist():
        start, end = (np.searchsorted(key[order], key + step, side=side) for side in ("left", "right"))
        a = np.repeat(np.arange(len(key)), end - start)
        first.append(a)
        second.append(order[np.arange(len(a)) - np.repeat(np.cumsum(end - start) - end, end - start)])
    a, b = np.concatenate(first), np.concatenate(second)
    step, move = centre[b] - centre[a], corners.pixel[b] - corners.pixel[a]
    length = np.hypot(*step.T)
    w = 1.0 - (step * move).sum(axis=1) / length**2
    across = np.abs(step[:, 0] * move[:, 1] - step[:, 1] * move[:, 0]) / length
    bright = corners.angle.mean(axis=1)
    likely = (across < _TOLERANCE) & (np.abs(w) > _MIN_W) & (np.abs(w) < _MAX_W)
    likely &= np.abs(np.sin(bright[a] - bright[b])) < _MAX_SINE
    return _Pairs(a[likely], b[likely], w[likely], length[likely])


def _best_w(
    index: NDArray[np.int64], offset: Floats, pairs: _Pairs, arms: Floats, radius: float
) -> tuple[Floats, Floats]:
    """The w of each corner (n,), and its score: micro images that agree less those that should and do not."""
    best_w, best_score = np.zeros(len(index)), np.full(len(index), -np.inf)
    order = np.argsort(pairs.first, kind="stable")
    bounds = np.searchsorted(pairs.first[order], np.arange(len(index) + 1))
    for k in np.flatnonzero(np.diff(bounds)).tolist():
        rows = order[bounds[k] : bounds[k + 1]]
        w, length = pairs.w[rows], pairs.length[rows]
        agrees = np.abs(w[:, None] - w) * length < _TOLERANCE
        # Each micro image counts once.
        _, image = np.unique(index[pairs.second[rows]], axis=0, return_inverse=True)
        member = image.ravel() == np.arange(len(rows))[:, None]
        support = agrees.astype(np.float64) @ member.T > 0
        expected = (np.hypot(*np.moveaxis(offset[k] - w[:, None, None] * arms, 2, 0)) < radius).sum(axis=1)
        score = (1.0 + _MISSING) * support.sum(axis=1) - _MISSING * expected
        best = int(np.argmax(score))
        best_score[k], near = score[best], agrees[best]
        best_w[k] = np.average(w[near], weights=length[near] ** 2)
    return best_w, best_score


def _components(n: int, a: NDArray[np.int64], b: NDArray[np.int64]) -> NDArray[np.int64]:
    """Smallest number (n,) in the connected component of each of n nodes with the edges a - b."""
    label = np.arange(n)
    while True:
        lower = label.copy()
        np.minimum.at(lower, a, label[b])
        np.minimum.at(lower, b, label[a])
        lower = lower[lower]
        if (lower == label).all():
            return label
        label = lower


def _fit_points(label: NDArray[np.int64], centre: Floats, corners: CornerFit) -> VirtualPoints:
    """Virtual points of the corners with the same label, by least squares; those of few corners are left out."""
    numbers = np.flatnonzero(np.bincount(label, minlength=1) >= _MIN_IMAGES)
    position, angle = np.zeros((2, len(numbers), 2))
    w, images = np.zeros(len(numbers)), np.zeros(len(numbers), dtype=np.int64)
    for k, number in enumerate(numbers):
        rows = np.flatnonzero(label == number)
        for _ in range(_REJECTIONS):
            c, p = centre[rows], corners.pixel[rows]
            arm, move = c - c.mean(axis=0), p - p.mean(axis=0)
            w[k] = 1.0 - (arm * move).sum() / (arm**2).sum()
            miss = np.hypot(*(move - (1.0 - w[k]) * arm).T)
            near = miss < max(3.0 * float(np.median(miss)), 0.5 * _TOLERANCE)
            if near.all() or np.count_nonzero(near) < _MIN_IMAGES:
                break
            rows = rows[near]
        position[k] = (p.mean(axis=0) - (1.0 - w[k]) * c.mean(axis=0)) / w[k]
        images[k] = len(rows)
        first, second = corners.angle[rows].T
        bright = 0.5 * np.angle(np.exp(1j * (first + second)).mean())
        opening = 0.5 * float(np.median(np.abs((second - first + np.pi) % (2.0 * np.pi) - np.pi)))
        angle[k] = bright - opening, bright + opening
    return VirtualPoints(position, w, images, angle)
