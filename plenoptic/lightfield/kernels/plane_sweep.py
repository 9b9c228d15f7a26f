"""Plane sweep: disparity by matching each image with others, whose shifts are proportional to disparity.

Images are micro images or sub-aperture views; a point at p in one is seen at p + base - disparity step in another.
Planes of constant disparity are compared first, by normalised correlation in a window, averaged over the better half of
the other images. Semi-global matching along paths through the image makes neighbouring pixels agree (H. Hirschmueller,
IEEE Trans. PAMI 30 (2008), doi:10.1109/TPAMI.2007.1166). `subpixel` refines the disparity between planes.
"""

from __future__ import annotations

import math

from plenoptic.core.numba.jit import device, kernel
from plenoptic.lightfield.kernels.cubic import cubic_weights
from plenoptic.lightfield.kernels.subpixel import blur_levels, refine_subpixel

_UNKNOWN = -2.0
"""Marks a correlation that cannot be computed."""
_WORST_COST = 2.0
"""Cost of pixels outside the mask."""
_STEP_PENALTY, _JUMP_PENALTY = 0.03, 0.3
"""Penalty, in units of correlation, for a step to a neighbouring plane and for any larger step."""


@device
def _fill_shifted(shifted, shifted_mask, values, mask, down, right, shape):
    """Shift an image by `down` and `right` with cubic convolution; mask pixels whose four nearest are not all valid."""
    rows, columns = shape
    top, left = math.floor(down), math.floor(right)
    (a0, a1, a2, a3), _ = cubic_weights(down - top)
    (b0, b1, b2, b3), _ = cubic_weights(right - left)
    top, left = int(top), int(left)
    for y in range(rows):
        r = y + top
        inside = 1 <= r < rows - 2
        for x in range(columns):
            shifted_mask[y, x] = 0
        if not inside:
            continue
        first, last = max(0, 1 - left), min(columns, columns - 2 - left)
        for x in range(first, last):
            c = x + left
            shifted_mask[y, x] = mask[r, c] & mask[r, c + 1] & mask[r + 1, c] & mask[r + 1, c + 1]
            above = (
                b0 * values[r - 1, c - 1]
                + b1 * values[r - 1, c]
                + b2 * values[r - 1, c + 1]
                + b3 * values[r - 1, c + 2]
            )
            centre = b0 * values[r, c - 1] + b1 * values[r, c] + b2 * values[r, c + 1] + b3 * values[r, c + 2]
            below = (
                b0 * values[r + 1, c - 1]
                + b1 * values[r + 1, c]
                + b2 * values[r + 1, c + 1]
                + b3 * values[r + 1, c + 2]
            )
            far_below = (
                b0 * values[r + 2, c - 1]
                + b1 * values[r + 2, c]
                + b2 * values[r + 2, c + 1]
                + b3 * values[r + 2, c + 2]
            )
            shifted[y, x] = a0 * above + a1 * centre + a2 * below + a3 * far_below


@device
def _fill_correlation(score, values, mask, workspace, noise, other_noise, radius, shape):
    """Normalised correlation of an image and a shifted one in windows over both masks; variances include noise."""
    rows, columns = shape
    shifted, shifted_mask, sums = workspace.shifted, workspace.shifted_mask, workspace.sums
    for y in range(rows):
        for k in range(6):
            for x in range(columns):
                sums[k, y, x] = 0.0
        # Running sums along rows, then along columns: add the entering and subtract the leaving pixel.
        n, a, b, aa, bb, ab = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for x in range(-radius, columns):
            entering, leaving = x + radius, x - radius - 1
            if entering < columns and mask[y, entering] & shifted_mask[y, entering]:
                p, q = values[y, entering], shifted[y, entering]
                n += 1.0
                a += p
                b += q
                aa += p * p
                bb += q * q
                ab += p * q
            if leaving >= 0 and mask[y, leaving] & shifted_mask[y, leaving]:
                p, q = values[y, leaving], shifted[y, leaving]
                n -= 1.0
                a -= p
                b -= q
                aa -= p * p
                bb -= q * q
                ab -= p * q
            if x >= 0:
                sums[0, y, x] = n
                sums[1, y, x] = a
                sums[2, y, x] = b
                sums[3, y, x] = aa
                sums[4, y, x] = bb
                sums[5, y, x] = ab
    min_count = 0.5 * (2 * radius + 1) * (2 * radius + 1)
    for x in range(columns):
        for k in range(6):
            sums[k, rows, x] = 0.0
    for y in range(-radius, rows):
        entering, leaving = y + radius, y - radius - 1
        for k in range(6):
            if entering < rows:
                for x in range(columns):
                    sums[k, rows, x] += sums[k, entering, x]
            if leaving >= 0:
                for x in range(columns):
                    sums[k, rows, x] -= sums[k, leaving, x]
        if y >= 0:
            for x in range(columns):
                n = sums[0, rows, x]
                if n < min_count or not mask[y, x]:
                    score[y, x] = _UNKNOWN
                    continue
                a, b = sums[1, rows, x] / n, sums[2, rows, x] / n
                aa, bb = sums[3, rows, x] / n - a * a, sums[4, rows, x] / n - b * b
                ab = sums[5, rows, x] / n - a * b
                score[y, x] = ab / math.sqrt((max(aa, 0.0) + noise) * (max(bb, 0.0) + other_noise))


@device
def _better_half(scores, count, y, x):
    """Mean of the better half of the known scores; 0 without one."""
    n_known = 0
    for j in range(count):
        score = scores[j, y, x]
        if score == _UNKNOWN:
            continue
        # Insertion sort: known scores stand first, in falling order.
        k = n_known
        while k > 0 and scores[k - 1, y, x] < score:
            scores[k, y, x] = scores[k - 1, y, x]
            k -= 1
        scores[k, y, x] = score
        n_known += 1
    half = (n_known + 1) // 2
    total = 0.0
    for j in range(half):
        total += scores[j, y, x]
    return total / half if half else 0.0


@device
def _fill_costs(cost, images, pairs, sweep, workspace, m):
    """Cost of each plane, 1 - correlation, (rows, columns, planes)."""
    shape = (images.values.shape[1], images.values.shape[2])
    rows, columns = shape
    mask = images.mask[m]
    for k in range(sweep.disparities.size):
        d, count = sweep.disparities[k], 0
        for j in range(pairs.first[m], pairs.first[m + 1]):
            down, right = d * pairs.step[j, 0], d * pairs.step[j, 1]
            if down * down + right * right > sweep.max_shift * sweep.max_shift or count == sweep.max_compared:
                continue
            other = pairs.other[j]
            down, right = pairs.base[j, 0] - down, pairs.base[j, 1] - right
            values, other_values = images.values[m], images.values[other]
            if images.blurred is not None:
                level, other_level = blur_levels(images, sweep, m, other, d)
                values, other_values = images.blurred[m, level], images.blurred[other, other_level]
            _fill_shifted(
                workspace.shifted, workspace.shifted_mask, other_values, images.mask[other], down, right, shape
            )
            _fill_correlation(
                workspace.scores[count],
                values,
                mask,
                workspace,
                images.noise_variance[m],
                images.noise_variance[other],
                sweep.radius,
                shape,
            )
            count += 1
        for y in range(rows):
            for x in range(columns):
                cost[y, x, k] = 1.0 - _better_half(workspace.scores, count, y, x) if mask[y, x] else _WORST_COST
    _shift_windows(cost, workspace.path_cost, sweep.radius)


@device
def _shift_windows(cost, row_minimum, reach):
    """Take the lowest cost of all windows that contain a pixel, so that windows need not straddle an edge."""
    rows, columns, planes = cost.shape
    for y in range(rows):
        for x in range(columns):
            for k in range(planes):
                lowest = cost[y, x, k]
                for xx in range(max(0, x - reach), min(columns, x + reach + 1)):
                    lowest = min(lowest, cost[y, xx, k])
                row_minimum[y, x, k] = lowest
    for y in range(rows):
        for x in range(columns):
            for k in range(planes):
                lowest = row_minimum[y, x, k]
                for yy in range(max(0, y - reach), min(rows, y + reach + 1)):
                    lowest = min(lowest, row_minimum[yy, x, k])
                cost[y, x, k] = lowest


@device
def _add_paths(total, cost, previous, current, row_step, column_step):
    """Add the path costs along one direction (semi-global matching)."""
    rows, columns, planes = cost.shape
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
def fill_disparities(disparity, error, agreement, images, pairs, sweep, workspace, first_and_end):
    """Disparity, its standard error and the fraction of agreeing images, (images, rows, columns)."""
    rows, columns = images.values.shape[1], images.values.shape[2]
    planes = sweep.disparities.size
    for m in range(first_and_end[0], first_and_end[1]):
        _fill_costs(workspace.cost, images, pairs, sweep, workspace, m)
        for y in range(rows):
            for x in range(columns):
                for k in range(planes):
                    workspace.path_cost[y, x, k] = 0.0
        for direction in range(4):
            down = 1 if direction == 0 else -1 if direction == 1 else 0
            right = 1 if direction == 2 else -1 if direction == 3 else 0
            _add_paths(workspace.path_cost, workspace.cost, workspace.previous, workspace.current, down, right)
        for y in range(rows):
            for x in range(columns):
                workspace.start[y, x] = _best_plane(workspace.path_cost, y, x, sweep.disparities)
        for y in range(rows):
            for x in range(columns):
                if not images.mask[m, y, x]:
                    continue
                disparity[m, y, x], error[m, y, x], agreement[m, y, x] = refine_subpixel(
                    images, pairs, sweep, workspace, m, y, x
                )
