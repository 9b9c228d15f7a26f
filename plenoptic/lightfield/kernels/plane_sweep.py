"""Plane sweep: disparity by matching each image with others, whose shifts are proportional to disparity.

Images are micro images or sub-aperture views; a point at p in one is seen at p + base - disparity step in another.
Planes of constant disparity are compared first, by normalised correlation in a window, averaged over the better half of
the other images. `semi_global` makes neighbouring pixels agree, and `subpixel` refines the disparity between planes.
"""

from __future__ import annotations

import math

from plenoptic.core.numba.jit import device, kernel
from plenoptic.lightfield.kernels.cubic import cubic_weights, interpolate_row
from plenoptic.lightfield.kernels.subpixel import blur_levels

_UNKNOWN = -2.0
"""Marks a correlation that cannot be computed."""
_WORST_COST = 2.0
"""Cost of pixels outside the mask."""


@device
def _fill_shifted(shifted, shifted_mask, values, mask, down, right, shape):
    """Shift an image by `down` and `right` with cubic convolution; mask pixels whose four nearest are not all valid."""
    rows, columns = shape
    top, left = math.floor(down), math.floor(right)
    (a0, a1, a2, a3), _ = cubic_weights(down - top)
    weights, _ = cubic_weights(right - left)
    top, left = int(top), int(left)
    for y in range(rows):
        r = y + top
        for x in range(columns):
            shifted_mask[y, x] = 0
        if not 1 <= r < rows - 2:
            continue
        for x in range(max(0, 1 - left), min(columns, columns - 2 - left)):
            c = x + left
            shifted_mask[y, x] = mask[r, c] & mask[r, c + 1] & mask[r + 1, c] & mask[r + 1, c + 1]
            shifted[y, x] = (
                a0 * interpolate_row(values, r - 1, c, weights)
                + a1 * interpolate_row(values, r, c, weights)
                + a2 * interpolate_row(values, r + 1, c, weights)
                + a3 * interpolate_row(values, r + 2, c, weights)
            )


@device
def _fill_correlation(score, values, mask, workspace, noise, radius, shape):
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
                score[y, x] = ab / math.sqrt((max(aa, 0.0) + noise[0]) * (max(bb, 0.0) + noise[1]))


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
def _fill_plane(cost, stack, workspace, m, k):
    """Cost of plane k of an image, compared with its neighbours."""
    shape = (stack.values.shape[1], stack.values.shape[2])
    rows, columns = shape
    mask, d, count = stack.mask[m], stack.disparities[k], 0
    for j in range(stack.first[m], stack.first[m + 1]):
        down, right = d * stack.step[j, 0], d * stack.step[j, 1]
        if down * down + right * right > stack.max_shift * stack.max_shift or count == stack.max_compared:
            continue
        other = stack.other[j]
        down, right = stack.base[j, 0] - down, stack.base[j, 1] - right
        values, other_values = stack.values[m], stack.values[other]
        if stack.blurred is not None:
            level, other_level = blur_levels(stack, m, other, d)
            values, other_values = stack.blurred[m, level], stack.blurred[other, other_level]
        _fill_shifted(workspace.shifted, workspace.shifted_mask, other_values, stack.mask[other], down, right, shape)
        noise = stack.noise_variance[m], stack.noise_variance[other]
        _fill_correlation(workspace.scores[count], values, mask, workspace, noise, stack.window_radius, shape)
        count += 1
    for y in range(rows):
        for x in range(columns):
            cost[y, x, k] = 1.0 - _better_half(workspace.scores, count, y, x) if mask[y, x] else _WORST_COST


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


@kernel
def fill_costs(cost, stack, workspace, first):
    """Cost of each plane, 1 - correlation, (images, rows, columns, planes), of the images from `first` on."""
    for i in range(cost.shape[0]):
        for k in range(stack.disparities.size):
            _fill_plane(cost[i], stack, workspace, first + i, k)
        _shift_windows(cost[i], workspace.row_minimum, stack.window_radius)
