"""Virtual image of a board's plane, and homographies."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.calibration.corners.virtual_points import VirtualPoints
from plenoptic.core.values import Floats

TURNS = [np.array(turn) for turn in ([[1, 0], [0, 1]], [[0, 1], [-1, 0]], [[-1, 0], [0, -1]], [[0, -1], [1, 0]])]
"""Quarter turns of (row, column)."""


class BoardPlane(NamedTuple):
    """Virtual image of a board's plane."""

    homography: Floats
    """(3, 3): from (row, column, 1) on the board to the virtual point's (row, column, 1), up to a factor."""
    depth: Floats
    """(3,): virtual depth, linear in (row, column, 1) of the virtual point."""

    def points(self, index: Floats | NDArray[np.int64]) -> tuple[Floats, Floats]:
        """Position (n, 2), nan beyond the horizon, and reciprocal virtual depth (n,) of corners (n, 2)."""
        position = project(self.homography, index)
        position[index @ self.homography[2, :2] + self.homography[2, 2] <= 0] = np.nan
        return position, 1.0 / (position @ self.depth[:2] + self.depth[2])

    def steps(self, index: Floats | NDArray[np.int64]) -> Floats:
        """Steps (n, 2, 2) of the position to the next row and to the next column."""
        shift = 0.5 * np.eye(2)
        return np.stack([project(self.homography, index + s) - project(self.homography, index - s) for s in shift], 1)

    def edge_angles(self, index: NDArray[np.int64]) -> Floats:
        """Angles (n, 2) of the normals of the edges through corners, with bright quadrants as `CornerFit` has them."""
        step = self.steps(index)
        angle = np.arctan2(step[..., 0], -step[..., 1])
        return np.asarray(angle + np.outer(index.sum(axis=1) % 2, [0.0, np.pi]))


def fit_plane(points: VirtualPoints, rows: NDArray[np.int64], index: NDArray[np.int64]) -> BoardPlane:
    """Plane of virtual points (rows) that are corners (m, 2)."""
    design = np.column_stack([points.position[rows], np.ones(len(rows))])
    weight = points.w[rows] ** 2 * np.sqrt(points.images[rows])
    depth = np.linalg.lstsq(design * weight[:, None], weight / points.w[rows], rcond=None)[0]
    return BoardPlane(fit_homography(index, points.position[rows]), np.asarray(depth, dtype=np.float64))


def fit_homography(index: NDArray[np.int64], position: Floats) -> Floats:
    """Homography (3, 3) from places (m, 2) to positions (m, 2), by the direct linear transform."""
    (source, a), (target, b) = (_normalise(each) for each in (np.asarray(index, dtype=np.float64), position))
    x, y = np.column_stack([source, np.ones(len(source))]), target
    zero = np.zeros_like(x)
    system = np.concatenate([np.hstack([x, zero, -y[:, :1] * x]), np.hstack([zero, x, -y[:, 1:] * x])])
    matrix = np.linalg.svd(system)[2][-1].reshape(3, 3)
    matrix = np.linalg.inv(b) @ matrix @ a
    return np.asarray(matrix * np.sign(matrix[2] @ np.append(np.mean(index, axis=0), 1.0)))


def _normalise(places: Floats) -> tuple[Floats, Floats]:
    """Places (m, 2) about their mean in units of their spread, and the matrix (3, 3) to them."""
    mean, spread = places.mean(axis=0), max(float(places.std()), 1e-12)
    matrix = np.array([[1 / spread, 0, -mean[0] / spread], [0, 1 / spread, -mean[1] / spread], [0, 0, 1]])
    return (places - mean) / spread, matrix


def invert(matrix: Floats) -> Floats:
    """Inverse homography."""
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)


def project(homography: Floats, places: Floats | NDArray[np.int64]) -> Floats:
    """Images (n, 2) of places (n, 2)."""
    image = np.column_stack([places, np.ones(len(places))]) @ homography.T
    return np.asarray(image[:, :2] / image[:, 2:])
