"""Depth edges in micro images: pixels with mixed light of two surfaces, and pixels with the wrong surface's depth."""

from __future__ import annotations

import math

from plenoptic.core.numba.jit import kernel
from plenoptic.lightfield.kernels.splat import exp_minus

_WIDTH = 0.6
"""Standard deviation of the averaging weights, in pixels of the picture."""
_REACH = 2
"""Radius of the averaging window, in pixels of the picture."""
_MIN_WEIGHT = 0.1
"""Minimum sum of the weights."""


@kernel
def fill_edge_mask(edge_mask, nearness, lens, blur, depth, farthest):
    """Mark the pixels (H, W) near a pixel of the same microlens at another depth, within the blur of both.

    `blur` is the radius of a point's image in pixels, `farthest` the search radius.
    """
    rows, columns = nearness.shape
    for row in range(rows):
        for column in range(columns):
            edge_mask[row, column] = 0
            if lens[row, column] < 0:
                continue
            own_nearness, own_blur = nearness[row, column], blur[row, column]
            for i in range(max(0, row - farthest), min(rows, row + farthest + 1)):
                for j in range(max(0, column - farthest), min(columns, column + farthest + 1)):
                    if lens[i, j] != lens[row, column] or not abs(nearness[i, j] - own_nearness) > depth:
                        continue
                    # Neighbours along the diagonal count, as does the width of a pixel.
                    if math.hypot(i - row, j - column) <= 1.5 + max(own_blur, blur[i, j]):
                        edge_mask[row, column] = 1


@kernel
def fill_behind(behind, nearness, lens, depth, farthest):
    """Nearness of the closest pixel of the same microlens that shows a farther surface; nan without one."""
    rows, columns = nearness.shape
    for row in range(rows):
        for column in range(columns):
            behind[row, column] = math.nan
            if lens[row, column] < 0:
                continue
            shortest = farthest + 0.5
            for i in range(max(0, row - farthest), min(rows, row + farthest + 1)):
                for j in range(max(0, column - farthest), min(columns, column + farthest + 1)):
                    if lens[i, j] == lens[row, column] and nearness[i, j] < nearness[row, column] - depth:
                        distance = math.hypot(i - row, j - column)
                        if distance < shortest:
                            shortest, behind[row, column] = distance, nearness[i, j]


@kernel
def fill_misfits(misfit, cells, depth, pixels):
    """Difference between the light of pixels (n,) and that of other microlenses at the same position and depth.

    inf without samples there. `pixels` are (position, nearness, light, lens).
    """
    positions, nearness, light, lens = pixels
    rows, columns = cells.shape
    for k in range(len(misfit)):
        row, column = round(positions[k, 0]) - cells.origin[0], round(positions[k, 1]) - cells.origin[1]
        total, mean = 0.0, 0.0
        low, high = max(0, column - _REACH), min(columns, column + _REACH + 1)
        for i in range(max(0, row - _REACH), min(rows, row + _REACH + 1)):
            # Cells of a row follow each other.
            for m in range(cells.first[i * columns + low], cells.first[i * columns + max(low, high)]):
                if cells.lens[m] == lens[k] or not abs(cells.nearness[m] - nearness[k]) <= depth:
                    continue
                down, along = cells.position[m, 0] - positions[k, 0], cells.position[m, 1] - positions[k, 1]
                weight = exp_minus(0.5 * (down * down + along * along) / (_WIDTH * _WIDTH))
                total += weight
                mean += weight * cells.light[m]
        misfit[k] = abs(light[k] - mean / total) if total > _MIN_WEIGHT else math.inf
