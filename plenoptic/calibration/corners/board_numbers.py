"""Numbers of a checkerboard's corners, from their virtual points."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from plenoptic.calibration.corners.board_plane import TURNS, BoardPlane, fit_homography, fit_plane, invert, project
from plenoptic.calibration.corners.virtual_points import VirtualPoints
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError

_CONE = math.cos(math.radians(20.0))
"""Cosine of the largest angle between an edge and the direction of the next corner."""
_OFF = 0.2
"""Largest distance of a corner from its place in the lattice, over that of its neighbours."""
_MIN_POINTS = 6


def number_points(
    points: VirtualPoints,
    shape: tuple[int, int],
    place_by_marks: Callable[[BoardPlane, NDArray[np.int64], int], NDArray[np.int64]] | None = None,
) -> tuple[NDArray[np.int64], BoardPlane]:
    """Row and column (k, 2) of virtual points on a board with corners of this shape, -1 where a point is none.

    The square at the upper left is dark. Of a board with marks, these place the corners at places of a lattice.
    Raises InvalidValueError if the points are not those of the board.
    """
    rows, place = _lattice(points) if len(points.w) else (np.zeros(0, np.int64), np.zeros((0, 2), np.int64))
    if len(rows) < _MIN_POINTS or min(np.ptp(place, axis=0)) < 1:
        raise InvalidValueError(
            f"the image shows no board: {len(points.w)} possible corners, {len(rows)} of them on one lattice; "
            "give the raw image of a checkerboard that several micro images show"
        )
    kind = _kinds(points, rows, place)
    if place_by_marks is None:
        index = _place(place, kind, fit_homography(place, points.position[rows]), shape)
    else:
        index = place_by_marks(fit_plane(points, rows, place), place, kind)
    on_board = ((index >= 0) & (index < shape)).all(axis=1)
    numbers = np.full((len(points.w), 2), -1)
    numbers[rows[on_board]] = index[on_board]
    rows, index = rows[on_board], index[on_board]
    return numbers, fit_plane(points, rows, index)


def _lattice(points: VirtualPoints) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows (m,) of the points on the largest lattice, and their places (m, 2), right-handed as (row, column)."""
    edges = np.stack([-np.sin(points.angle), np.cos(points.angle)], axis=-1)
    directions = np.concatenate([edges, -edges], axis=1)
    arm = points.position - points.position[:, None]
    distance = np.hypot(arm[..., 0], arm[..., 1])
    bright = points.angle.mean(axis=1)
    turned = np.abs(np.sin(bright[:, None] - bright)) > math.sqrt(0.5)
    cosine = np.einsum("abc,adc->adb", arm, directions) / np.maximum(distance, 1e-9)[:, None]
    length = np.where((cosine > _CONE) & turned[:, None] & (distance > 1e-6)[:, None], distance[:, None], np.inf)
    neighbour = np.where(np.isfinite(length.min(axis=2, initial=np.inf)), length.argmin(axis=2), -1)
    best: dict[int, tuple[int, int]] = {}
    visited: set[int] = set()
    for seed in np.argsort(-points.images).tolist():
        if seed not in visited:
            places = _walk(seed, neighbour, directions)
            visited |= places.keys()
            best = max(best, places, key=len)
    rows = np.array(list(best), dtype=np.int64)
    place = np.array(list(best.values()), dtype=np.int64).reshape(-1, 2)
    for _ in range(3):
        if len(rows) < _MIN_POINTS or min(np.ptp(place, axis=0)) < 1:
            break
        rows, place = _refine(points, rows, place)
    return rows, place


def _walk(seed: int, neighbour: NDArray[np.int64], directions: Floats) -> dict[int, tuple[int, int]]:
    """Places of points that are reached from the first one by steps between mutual neighbours."""
    first, second = directions[seed, 0], directions[seed, 1]
    second = second if first[0] * second[1] > first[1] * second[0] else -second
    places, taken, queue = {seed: (0, 0)}, {(0, 0)}, [(seed, first, second)]
    while queue:
        a, *axes = queue.pop(0)
        for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):
            b = int(neighbour[a, np.argmax(directions[a] @ axes[axis]) if sign > 0 else np.argmin(
                directions[a] @ axes[axis])])  # fmt: skip
            if b < 0 or a not in neighbour[b] or b in places:
                continue
            row, column = places[a]
            place = (row + sign, column) if axis == 0 else (row, column + sign)
            if place not in taken:
                places[b] = place
                taken.add(place)
                queue.append((b, *(directions[b, np.argmax(directions[b] @ each)] for each in axes)))
    return places


def _refine(
    points: VirtualPoints, rows: NDArray[np.int64], place: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Points that are where a homography has their places, with those that the steps did not reach."""
    exact = project(invert(fit_homography(place, points.position[rows])), points.position)
    nearest = np.rint(exact)
    off = np.hypot(*(exact - nearest).T)
    low, high = place.min(axis=0) - 2, place.max(axis=0) + 2
    fits = (off < _OFF) & ((nearest >= low) & (nearest <= high)).all(axis=1)
    order = np.flatnonzero(fits)[np.argsort(off[fits], kind="stable")]
    _, first = np.unique(nearest[order], axis=0, return_index=True)
    chosen = order[np.sort(first)]
    return chosen, nearest[chosen].astype(np.int64)


def _kinds(points: VirtualPoints, rows: NDArray[np.int64], place: NDArray[np.int64]) -> int:
    """Parity of row + column of places whose bright quadrants are those above on the left and below on the right."""
    inverse = invert(fit_homography(place, points.position[rows]))
    bright = points.angle[rows].mean(axis=1)
    step = 1e-3 * np.stack([np.cos(bright), np.sin(bright)], axis=1)
    move = project(inverse, points.position[rows] + step) - project(inverse, points.position[rows] - step)
    votes = np.sign(move[:, 0] * move[:, 1]) * (1 - 2 * (place.sum(axis=1) % 2))
    return int(votes.sum() < 0)


def _place(place: NDArray[np.int64], kind: int, homography: Floats, shape: tuple[int, int]) -> NDArray[np.int64]:
    """Row and column (m, 2) on the board of the lattice's places."""
    options: list[tuple[int, float, NDArray[np.int64]]] = []
    for number, turn in enumerate(TURNS):
        turned = place @ turn.T
        low, extent = turned.min(axis=0), np.ptp(turned, axis=0) + 1
        # Bright quadrants change diagonals by a quarter turn; on the board odd corners are of this kind.
        parity = (kind + number) % 2
        starts = [range(min(0, s - e), max(0, s - e) + 1) for s, e in zip(shape, extent.tolist(), strict=True)]
        for start in ((i, j) for i in starts[0] for j in starts[1]):
            index = turned - low + start
            if (parity + int(sum(start) - low.sum())) % 2 == 1:
                inside = ((index >= 0) & (index < shape)).all(axis=1)
                down = float((turn @ invert(homography / homography[2, 2])[:2, :2])[1, 1])
                options.append((int(inside.sum()), down, index))
    count = max((option[0] for option in options), default=0)
    ties = [option for option in options if option[0] == count]
    rows, columns = shape
    symmetry = 1 if (rows + columns) % 2 else 4 if rows == columns and rows % 2 == 0 else 2
    extent = " x ".join(map(str, np.ptp(place, axis=0) + 1))
    if count < _MIN_POINTS or count < 0.8 * len(place):
        raise InvalidValueError(
            f"the image shows a lattice of {extent} corners, the board has {rows} x {columns}; give the board that was "
            "photographed"
        )
    if len(ties) > symmetry:
        raise InvalidValueError(
            f"only {extent} corners of the board's {rows} x {columns} are visible, and they may be several; "
            "move the whole board into view, or take pl.targets.marked_checkerboard"
        )
    return max(ties, key=lambda option: option[1])[2]
