"""From disparity to depth through the real lens: where the rays through neighbouring microlenses meet."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import ArrayAxes
from plenoptic.core.values import Floats
from plenoptic.lightfield.lens_images import LensImages
from plenoptic.lightfield.outward_rays import chief_rays
from plenoptic.optics.microlens.array import MicrolensArray

_TOGETHER = 1 << 13
"""Pixels whose rays are traced together."""


def object_depths(
    axes: ArrayAxes,
    array: MicrolensArray,
    lenses: LensImages,
    lens: NDArray[np.int64],
    pixel: Floats,
    disparity: Floats,
    threads: int,
) -> Floats:
    """-z in the camera's frame (n,), mm: where rays of n pixels meet that show one point.

    They start where the point is seen through the pixel's microlens `lens` (n,), at `pixel` (n, 2) of the sensor, and
    through its neighbours, by disparities (n,), and pass the optical centres. The point is the one nearest to all of
    them; nan where fewer than two leave the lens, or they do not meet in front of it.
    """
    found = [
        _nearest(axes, array, lenses, lens[part], pixel[part], disparity[part], threads)
        for part in (slice(start, start + _TOGETHER) for start in range(0, len(lens), _TOGETHER))
    ]
    return np.concatenate([np.empty(0), *found])


def _nearest(
    axes: ArrayAxes,
    array: MicrolensArray,
    lenses: LensImages,
    lens: NDArray[np.int64],
    pixel: Floats,
    disparity: Floats,
    threads: int,
) -> Floats:
    n, camera = len(lens), axes.camera
    matrix, right = np.zeros((n, 3, 3)), np.zeros((n, 3))
    count = np.zeros(n)
    for other in (lens, *lenses.neighbours(lens).T):
        there = other >= 0
        moved = lenses.straight[other] - lenses.straight[lens]
        at = pixel + moved * (1.0 - disparity / lenses.pitch)[:, None]
        rays = chief_rays(axes, array, at, lenses.on_array[other], threads)
        known = there & (rays.status == 0) & np.isfinite(at).all(axis=1)
        across = np.eye(3) - rays.direction[:, :, None] * rays.direction[:, None, :]
        across[~known] = 0.0
        matrix += across
        right += np.einsum("nij,nj->ni", across, np.where(known[:, None], rays.origin, 0.0))
        count += known
    solvable = (count >= 2) & (np.abs(np.linalg.det(matrix)) > 1e-300)
    point = np.full((n, 3), np.nan)
    point[solvable] = np.linalg.solve(matrix[solvable], right[solvable][:, :, None])[:, :, 0]
    placed = axes.parts.lens_to_camera
    z = (point if placed is None else placed.points(point))[:, 2]
    front = min(0.0, float(camera.lens.vertices[0]))
    return np.where(z < front, -z, np.nan)
