"""Edges of depth in the images of microlenses: which pixels mix two surfaces, and which have the wrong one's depth."""

from __future__ import annotations

import math

from plenoptic.core.numba.jit import kernel

_WIDTH = 0.6
"""Standard deviation of the weights with which samples are averaged, in pixels of the picture."""
_REACH = 2
"""Pixels of the picture up to which they are."""
_SEEN = 0.1
"""Weight that they have together at least."""


@kernel
def fill_mixed(mixed, nearness, lens, blur, depth, farthest):
    """Write 1 where a pixel (H, W) has a neighbour of its microlens at another depth, within the blur of both.

    `blur` is the radius of the image of a point in pixels, `farthest` the distance up to which is looked.
    """
    rows, columns = nearness.shape
    for row in range(rows):
        for column in range(columns):
            mixed[row, column] = 0
            if lens[row, column] < 0:
                continue
            here, spread = nearness[row, column], blur[row, column]
            for i in range(max(0, row - farthest), min(rows, row + farthest + 1)):
                for j in range(max(0, column - farthest), min(columns, column + farthest + 1)):
                    if lens[i, j] != lens[row, column] or not abs(nearness[i, j] - here) > depth:
                        continue
                    # Neighbours along the diagonal count, as does the width of a pixel.
                    if math.hypot(i - row, j - column) <= 1.5 + max(spread, blur[i, j]):
                        mixed[row, column] = 1


@kernel
def fill_behind(behind, nearness, lens, depth, farthest):
    """The nearness of the nearest pixel of the same microlens that shows a surface farther away; nan without one."""
    rows, columns = nearness.shape
    for row in range(rows):
        for column in range(columns):
            behind[row, column] = math.nan
            if lens[row, column] < 0:
                continue
            least = farthest + 0.5
            for i in range(max(0, row - farthest), min(rows, row + farthest + 1)):
                for j in range(max(0, column - farthest), min(columns, column + farthest + 1)):
                    if lens[i, j] == lens[row, column] and nearness[i, j] < nearness[row, column] - depth:
                        apart = math.hypot(i - row, j - column)
                        if apart < least:
                            least, behind[row, column] = apart, nearness[i, j]


@kernel
def fill_misfits(misfit, cells, depth, pixels):
    """Write the difference of the light of pixels (n,) from that of other microlenses at the same position and depth.

    inf where these have no samples there. `pixels` are (place, nearness, light, lens).
    """
    places, wanted, light, lens = pixels
    rows, columns = cells.shape
    for k in range(len(misfit)):
        row, column = round(places[k, 0]) - cells.origin[0], round(places[k, 1]) - cells.origin[1]
        total, mean = 0.0, 0.0
        for i in range(max(0, row - _REACH), min(rows, row + _REACH + 1)):
            for j in range(max(0, column - _REACH), min(columns, column + _REACH + 1)):
                for n in range(cells.first[i * columns + j], cells.first[i * columns + j + 1]):
                    m = cells.number[n]
                    if cells.lens[m] == lens[k] or not abs(cells.nearness[m] - wanted[k]) <= depth:
                        continue
                    down, along = cells.place[m, 0] - places[k, 0], cells.place[m, 1] - places[k, 1]
                    weight = math.exp(-0.5 * (down * down + along * along) / (_WIDTH * _WIDTH))
                    total += weight
                    mean += weight * cells.light[m]
        misfit[k] = abs(light[k] - mean / total) if total > _SEEN else math.inf
