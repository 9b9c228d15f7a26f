"""Semi-global matching: disparities of least cost that neighbouring pixels agree on.

H. Hirschmueller, IEEE Trans. PAMI 30 (2008), doi:10.1109/TPAMI.2007.1166.
"""

from __future__ import annotations

from plenoptic.core.numba.jit import device, kernel

_STEP_PENALTY, _JUMP_PENALTY = 0.03, 0.3
"""Penalty, in units of correlation, for a step to a neighbouring plane and for any larger step."""


@device
def _add_paths(total, cost, path_costs, row_step, column_step):
    """Add the path costs along one direction (semi-global matching)."""
    rows, columns, planes = cost.shape
    previous, current = path_costs[0], path_costs[1]
    for line in range(columns if row_step else rows):
        for position in range(rows if row_step else columns):
            y = (position if row_step > 0 else rows - 1 - position) if row_step else line
            x = line if row_step else (position if column_step > 0 else columns - 1 - position)
            if position == 0:
                for k in range(planes):
                    current[k] = cost[y, x, k]
            else:
                lowest = previous[0]
                for k in range(1, planes):
                    lowest = min(lowest, previous[k])
                for k in range(planes):
                    best = min(previous[k], lowest + _JUMP_PENALTY)
                    if k > 0:
                        best = min(best, previous[k - 1] + _STEP_PENALTY)
                    if k + 1 < planes:
                        best = min(best, previous[k + 1] + _STEP_PENALTY)
                    current[k] = cost[y, x, k] + best - lowest
            for k in range(planes):
                total[y, x, k] += current[k]
                previous[k] = current[k]


@device
def _best_plane(total, y, x, disparities):
    """Disparity at the lowest cost, refined by a parabola through three planes."""
    planes, best = disparities.size, 0
    for k in range(1, planes):
        if total[y, x, k] < total[y, x, best]:
            best = k
    if best in (0, planes - 1):
        return disparities[best]
    low, lowest, high = total[y, x, best - 1], total[y, x, best], total[y, x, best + 1]
    curvature = low - 2.0 * lowest + high
    t = 0.5 * (low - high) / curvature if curvature > 0.0 else 0.0
    neighbour = disparities[best + 1] if t > 0.0 else disparities[best - 1]
    return disparities[best] + abs(t) * (neighbour - disparities[best])


@kernel
def fill_best_disparities(disparity, cost, disparities, total, path_costs):
    """Disparity of the lowest cost along all paths, (images, rows, columns)."""
    images, rows, columns, planes = cost.shape
    for m in range(images):
        for y in range(rows):
            for x in range(columns):
                for k in range(planes):
                    total[y, x, k] = 0.0
        for direction in range(4):
            down = 1 if direction == 0 else -1 if direction == 1 else 0
            right = 1 if direction == 2 else -1 if direction == 3 else 0
            _add_paths(total, cost[m], path_costs, down, right)
        for y in range(rows):
            for x in range(columns):
                disparity[m, y, x] = _best_plane(total, y, x, disparities)
