"""Pixels beside edges of depth, in which light of two surfaces is mixed."""

from __future__ import annotations

import math

from plenoptic.core.jit import kernel


@kernel
def fill_mixed(mixed, nearness, lens, blur, depth, farthest):
    """1 where a pixel (H, W) has one of the same microlens and another depth beside it, no farther than they are blurred.

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
