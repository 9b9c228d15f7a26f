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
    a, b = _neighbours(index, basis)
    step, move = centre[b] - centre[a], corners.pixel[b] - corners.pixel[a]
    square = (step**2).sum(axis=1)
    ratio = (step * move).sum(axis=1) / square
    across = np.abs(step[:, 0] * move[:, 1] - step[:, 1] * move[:, 0]) / np.sqrt(square)
    w = 1.0 - ratio
    likely = (across < _TOLERANCE) & (np.abs(w) > _MIN_W) & (np.abs(w) < _MAX_W)
    likely &= _same_angles(corners.angle[a], corners.angle[b])
    a, b, w, length = a[likely], b[likely], w[likely], np.sqrt(square[likely])
    best_w, best_score = _best_w(index, centre, corners.pixel, (a, b, w, length), basis, radius)
    agrees = (np.abs(w - best_w[a]) * length < _TOLERANCE) & (np.abs(w - best_w[b]) * length < 2.0 * _TOLERANCE)
    agrees &= (best_score[a] > 0) & (best_score[b] > 0)
    label = _components(n, a[agrees], b[agrees])
    return _fit_points(label, centre, corners, best_w)


def _neighbours(index: NDArray[np.int64], basis: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs of corners in different micro images that are near one another."""
    reach = int(np.ceil(_REACH)) + 1
    steps = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    length = np.hypot(*(steps @ basis).T)
    steps = steps[(length < _REACH * length[length > 0].min()) & (length > 0)]
    low, high = index.min(axis=0) - reach, index.max(axis=0) + reach
    width = high - low + 1
    key = (index[:, 0] - low[0]) * width[1] + index[:, 1] - low[1]
    order = np.argsort(key, kind="stable")
    ordered = key[order]
    first, second = [], []
    for k, l in steps.tolist():
        target = key + k * width[1] + l
        start, end = np.searchsorted(ordered, target), np.searchsorted(ordered, target, side="right")
        count = end - start
        a = np.repeat(np.arange(len(key)), count)
        number = np.arange(len(a)) - np.repeat(np.cumsum(count) - count, count)
        first.append(a)
        second.append(order[np.repeat(start, count) + number])
    return np.concatenate(first), np.concatenate(second)


def _same_angles(first: Floats, second: Floats, tolerance: float = 0.5) -> NDArray[np.bool_]:
    """True where bright quadrants lie in the same directions, up to half a turn."""
    bright = first.mean(axis=1) - second.mean(axis=1)
    return np.asarray(np.abs((bright + 0.5 * np.pi) % np.pi - 0.5 * np.pi) < tolerance)


def _best_w(
    index: NDArray[np.int64],
    centre: Floats,
    pixel: Floats,
    pairs: tuple[NDArray[np.int64], NDArray[np.int64], Floats, Floats],
    basis: Floats,
    radius: float,
) -> tuple[Floats, Floats]:
    """The w of each corner (n,), and its score: micro images that agree less those that should and do not."""
    a, b, w, length = pairs
    best_w, best_score = np.zeros(len(index)), np.full(len(index), -np.inf)
    order = np.argsort(a, kind="stable")
    bounds = np.searchsorted(a[order], np.arange(len(index) + 1))
    lenses = {tuple(each): place for each, place in zip(index.tolist(), centre, strict=True)}
    del lenses
    reach = int(np.ceil(_REACH)) + 1
    steps = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    arms = steps @ basis
    size = np.hypot(*arms.T)
    arms = arms[(size > 0) & (size < _REACH * size[size > 0].min())]
    for k in range(len(index)):
        rows = order[bounds[k] : bounds[k + 1]]
        if not len(rows):
            continue
        agree = np.abs(w[rows, None] - w[rows]) * length[rows] < _TOLERANCE
        # Each micro image counts once.
        images = index[b[rows]] - index[k]
        number = images[:, 0] * 64 + images[:, 1]
        _, inverse = np.unique(number, return_inverse=True)
        support = np.zeros((len(rows), inverse.max() + 1), dtype=bool)
        np.logical_or.at(support, (slice(None), inverse), agree)
        offset = pixel[k] - centre[k] - w[rows, None, None] * arms
        expected = (np.hypot(offset[..., 0], offset[..., 1]) < radius).sum(axis=1)
        score = (1.0 + _MISSING) * support.sum(axis=1) - _MISSING * expected
        top = int(np.argmax(score))
        best_score[k] = score[top]
        near = agree[top]
        best_w[k] = np.average(w[rows][near], weights=length[rows][near] ** 2)
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


def _fit_points(label: NDArray[np.int64], centre: Floats, corners: CornerFit, w: Floats) -> VirtualPoints:
    """Virtual points of the corners with the same label, by least squares; those of few corners are left out."""
    parts = []
    for number in np.flatnonzero(np.bincount(label) >= _MIN_IMAGES):
        rows = np.flatnonzero(label == number)
        for _ in range(3):
            c, p = centre[rows], corners.pixel[rows]
            c0, p0 = c.mean(axis=0), p.mean(axis=0)
            slope = ((c - c0) * (p - p0)).sum() / ((c - c0) ** 2).sum()
            miss = np.hypot(*(p - p0 - slope * (c - c0)).T)
            rows_kept = rows[miss < max(3.0 * np.median(miss), 0.5 * _TOLERANCE)]
            if len(rows_kept) == len(rows) or len(rows_kept) < _MIN_IMAGES:
                break
            rows = rows_kept
        angle = corners.angle[rows]
        bright = 0.5 * np.angle(np.exp(2j * angle.mean(axis=1)).mean())
        opening = 0.5 * float(np.median(np.abs((angle[:, 1] - angle[:, 0] + np.pi) % (2 * np.pi) - np.pi)))
        point = (p0 - slope * c0) / (1.0 - slope)
        parts.append((point, 1.0 - slope, len(rows), (bright - opening, bright + opening)))
    position, depth, images, angle = (np.array(part) for part in zip(*parts, strict=True)) if parts else [()] * 4
    return VirtualPoints(
        np.reshape(position, (-1, 2)), np.asarray(depth, float), np.asarray(images, int), np.reshape(angle, (-1, 2))
    )
