"""Marks in the squares of a checkerboard: which part of the board an image shows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.calibration.corners.board_plane import TURNS, BoardPlane
from plenoptic.calibration.corners.corner_fit import Windows
from plenoptic.calibration.corners.patches import Patches
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError

_BELL, _MIDDLE, _MASK = 0.12, 0.2, 0.27
"""Standard deviation of the bell that marks are compared with, half the width of the middle that micro images must
show, and radius of the disc that the fit of corners leaves out, over the edge of a square."""
_MIN_IMAGES, _MIN_SQUARES = 3, 9
"""Least micro images that show the middle of a square, and least squares that are read."""
_ON_BOARD = 0.8
"""Least share of the corners that are on the board."""
_MAX_DOUBT = 1e-8
"""Largest odds of all other placements. They are those of normal noise: of blurred parts of boards with odds from 1e-4
to 1e-2, 3 of 353 were placed wrongly, of those below 1e-8 none of 2644."""
_CHUNK = 2048
"""Squares in micro images that are read together."""


def place_by_marks(
    patches: Patches, marks: NDArray[np.bool_], plane: BoardPlane, place: NDArray[np.int64], kind: int
) -> NDArray[np.int64]:
    """Row and column (m, 2) on the board of corners at places (m, 2) of a lattice, which has this plane.

    Signals of squares, over the mean light at their corners, are a + b mark + noise with unknown a, b > 0 and variance.
    If all placements are equally likely before, their probabilities are as (1 - r^2)^(1 - n/2) with the correlation r
    of n signals and marks (Jeffreys' prior of the variance, constant ones of a and b), as has none of them with r = 0.
    Raises InvalidValueError if the odds of all but the best add up to more than 1e-8.
    """
    corners = np.stack(np.meshgrid([0, 1], [0, 1], indexing="ij"), axis=-1).reshape(-1, 2)
    squares = np.unique((place[:, None] + corners).reshape(-1, 2), axis=0)
    signal, _, images = _light(patches, plane, squares - 0.5)
    is_near = (np.abs(squares[:, None] - 0.5 - place) < 1).all(axis=2)
    _, level, shows = _light(patches, plane, place.astype(np.float64))
    signal *= is_near @ shows / np.maximum(is_near @ (shows * level), 1e-9 * level.max())
    # Squares above on the left of corners of the kind are bright; marks there are dark.
    signal *= np.where((squares.sum(axis=1) - kind) % 2 == 0, -1.0, 1.0)
    is_read = images >= _MIN_IMAGES
    squares, signal = squares[is_read], signal[is_read]
    r, placements = _placements(place, kind, squares, signal, marks)
    if len(squares) >= _MIN_SQUARES and len(r):
        best = int(np.argmax(r))
        r_wrong = np.append(np.maximum(np.delete(r, best), 0.0), 0.0)
        odds = (max(1.0 - r[best] ** 2, 0.0) / (1.0 - r_wrong**2)) ** (0.5 * len(squares) - 1.0)
        if odds.sum() < _MAX_DOUBT:
            return placements[best]
    raise InvalidValueError(
        f"the marks of {len(squares)} squares in view do not tell which part of the board the image shows; move more "
        "of it into view, nearer or better focused, and give the board that was photographed"
    )


def _placements(
    place: NDArray[np.int64], kind: int, squares: NDArray[np.int64], signal: Floats, marks: NDArray[np.bool_]
) -> tuple[Floats, list[NDArray[np.int64]]]:
    """Correlations (p,) of signals and marks in all placements of the lattice on the board, and its places there."""
    r: list[float] = []
    placements = []
    rows, columns = marks.shape
    for number, turn in enumerate(TURNS):
        corners, turned = place @ turn.T, np.rint((squares - 0.5) @ turn.T + 0.5).astype(np.int64)
        low, high = -corners.max(axis=0), (rows - 1, columns - 1) - corners.min(axis=0)
        for down in range(low[0], high[0]):
            # As in `_place`, corners whose sum is odd are of the kind.
            right = np.arange(low[1] + (low[1] + down + kind + number + 1) % 2, high[1], 2)
            row, column = corners[:, 0] + down, corners[:, 1] + right[:, None]
            is_on_board = (row >= 0) & (row < rows - 1) & (column >= 0) & (column < columns - 1)
            right = right[is_on_board.mean(axis=1) >= _ON_BOARD]
            shift = np.stack([np.full_like(right, down), right], axis=1)
            r += _correlations(_mark_values(marks, turned + shift[:, None]), signal).tolist()
            placements += [corners + each for each in shift]
    return np.array(r), placements


def without_marks(
    windows: Windows, start: Floats, steps: Floats, index: NDArray[np.int64], marks: NDArray[np.bool_]
) -> Windows:
    """Windows around corners (m, 2) of the board without the pixels of marks; steps (m, 2, 2) in pixels to the next
    row and to the next column.
    """
    offset = (windows.pixel - start[:, None]) @ np.linalg.inv(steps)
    square = np.floor(offset).astype(np.int64)
    is_near = np.hypot(*np.moveaxis(offset - square - 0.5, 2, 0)) < _MASK
    return windows._replace(
        weight=windows.weight * ~(is_near & (_mark_values(marks, index[:, None] + square + 1) == 1.0))
    )


def _light(patches: Patches, plane: BoardPlane, middle: Floats) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Light of windows as large as squares with these middles (n, 2): coefficient of a bell, mean, micro images."""
    position, w = plane.points(middle)
    steps = w[:, None, None] * plane.steps(middle)
    n, sums, images = len(middle), np.zeros((5, len(middle))), np.zeros(len(middle), dtype=np.int64)
    image, window = patches.visible(position, w)
    for first in range(0, len(image), _CHUNK):
        i, k = image[first : first + _CHUNK], window[first : first + _CHUNK]
        start = patches.centre[i] + (position[k] - patches.centre[i]) * w[k, None]
        windows = patches.windows(i, start, 0.5 * np.hypot(*steps[k].transpose(2, 0, 1)).sum(axis=1))
        offset = (windows.pixel - start[:, None]) @ np.linalg.inv(steps[k])
        far, bell = np.abs(offset).max(axis=2), np.exp(-0.5 * (offset**2).sum(axis=2) / _BELL**2)
        weight = windows.weight * (far < 0.5)
        terms = (weight, weight * bell, weight * bell**2, weight * windows.light, weight * bell * windows.light)
        sums += [np.bincount(k, term.sum(axis=1), n) for term in terms]
        images += np.bincount(k, (weight * (far < _MIDDLE)).any(axis=1), n).astype(np.int64)
    weight, bell, square, light, product = sums
    mean = light / np.maximum(weight, 1e-300)
    return (product - bell * mean) / np.maximum(square - bell**2 / np.maximum(weight, 1e-300), 1e-300), mean, images


def _mark_values(marks: NDArray[np.bool_], square: NDArray[np.int64]) -> Floats:
    """1 where squares (..., 2) have a mark, 0 where they have none, 0.5 beside the board."""
    row, column = np.moveaxis(np.clip(square, -1, marks.shape) + 1, -1, 0)
    return np.asarray(np.pad(marks.astype(np.float64), 1, constant_values=0.5)[row, column])


def _correlations(values: Floats, signal: Floats) -> Floats:
    """Correlation (p,) of signals (n,) with marks (p, n); 0 if all marks are alike."""
    mark, light = values - values.mean(axis=-1, keepdims=True), signal - signal.mean()
    size = np.sqrt((mark**2).sum(axis=-1) * (light**2).sum())
    return np.asarray(mark @ light / np.maximum(size, 1e-300))
