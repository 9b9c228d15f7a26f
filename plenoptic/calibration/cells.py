"""Cells of a lattice of micro images, and the light in them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.calibration.white_image import WhitePlane
from plenoptic.camera.points.micro_image_grid import MicroImageGrid
from plenoptic.camera.points.window_moments import WindowMoments, window_moments
from plenoptic.core.values import Floats
from plenoptic.optics.microlens.lattice import rows_of

_BORDER = 2.0
"""Width of the borders of cells over which weights fall to 0, pixels."""
_STEP, _MAX_GAIN = 0.5, 0.9
"""Displacement of cells in pixels by which the motion of centroids is measured, and the largest motion."""


class Cell:
    """Cell of a lattice: weights of pixels, which fall from 1 to 0 at its border."""

    def __init__(self, basis: Floats) -> None:
        steps = np.array([(1, 0), (0, 1), (1, -1), (1, 1)])
        self.steps = steps[np.argsort(np.hypot(*(steps @ basis).T), kind="stable")[:3]]
        neighbours = self.steps @ basis
        lengths = np.hypot(*neighbours.T)
        self.normals, self.half = neighbours / lengths[:, None], 0.5 * lengths
        # The circle through three neighbouring centres is that around a cell.
        self.reach = int(np.ceil(lengths.prod() / (2.0 * abs(np.linalg.det(basis))) + 0.5 + 0.5 * _BORDER))
        self.pitch = float(lengths.min())

    def moments(self, plane: WhitePlane, centre: Floats, limits: Floats | None = None) -> WindowMoments:
        """Moments of the light in cells around centres (n, 2).

        `limits` (n, 3, 2) are distances of the borders from the centres, backwards and forwards along the steps to
        neighbours; None: half of the steps.
        """
        limits = np.broadcast_to(self.half[:, None], (len(centre), 3, 2)) if limits is None else limits

        def weights(part: slice, offset: Floats) -> Floats:
            weight = np.ones(offset.shape[:-1])
            for k, normal in enumerate(self.normals):
                along, (back, front) = offset @ normal, limits[part, k].T[..., None]
                weight *= np.clip(0.5 + np.minimum(back + along, front - along) / _BORDER, 0.0, 1.0)
            return weight

        return window_moments(plane.light, centre, self.reach, weights, plane.variance)

    def limits(self, grid: MicroImageGrid, index: NDArray[np.int64], centre: Floats) -> Floats:
        """Distances (n, 3, 2) of borders halfway between measured centres (n, 2), or those of the grid."""
        nodes = index[:, None, None] + np.stack([-self.steps, self.steps], axis=1)
        row = rows_of(index, nodes)
        neighbour = np.where(row[..., None] >= 0, centre[row], grid.centres_of(nodes))
        along = np.einsum("nksc,kc->nks", neighbour - centre[:, None, None], self.normals)
        return np.asarray(0.5 * along * (-1.0, 1.0))

    def gain(self, plane: WhitePlane, centre: Floats) -> float:
        """Motion of centroids with cells around centres (n, 2): 0 where their borders are dark, 1 without contrast."""
        step = _STEP * np.array([1.0, 1.0])
        back, front = (self.moments(plane, centre + sign * step).centroid for sign in (-1.0, 1.0))
        return float(np.clip(np.nanmedian((front - back).sum(axis=1)) / (4.0 * _STEP), 0.0, _MAX_GAIN))
