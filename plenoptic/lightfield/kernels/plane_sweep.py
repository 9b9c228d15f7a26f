"""Plane sweep: disparity by matching each image with others, whose shifts are proportional to disparity.

Images are micro images or sub-aperture views; a point at p in one is seen at p + base - disparity step in another.
Planes of constant disparity are compared first, by normalised correlation in a window, averaged over the better half of
the other images. `semi_global` makes neighbouring pixels agree, and `subpixel` refines the disparity between planes.

For the sake of wide vectors, each loop runs over all pixels of an image, row after row, and writes to one array. The
margin of the masks keeps the rows apart.
"""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.numba.jit import device, kernel
from plenoptic.lightfield.kernels.cubic import cubic_weights
from plenoptic.lightfield.kernels.subpixel import blur_levels

_ZERO, _ONE = np.float32(0.0), np.float32(1.0)
_UNKNOWN = np.float32(-2.0)
"""Marks a correlation that cannot be computed."""
_WORST_COST = np.float32(2.0)
"""Cost of pixels outside the mask."""


@device
def _weighted_sum(out, values, start, spacing, weights):
    """Weighted sum of four values at a spacing; out[i] lies between start + i and the next one."""
    a, b, c, d = np.float32(weights[0]), np.float32(weights[1]), np.float32(weights[2]), np.float32(weights[3])
    first, second = values[start - spacing :], values[start:]
    third, fourth = values[start + spacing :], values[start + 2 * spacing :]
    for i in range(out.size):
        out[i] = a * first[i] + b * second[i] + c * third[i] + d * fourth[i]


@device
def _fill_shifted_mask(out, mask, start, left, columns):
    """1 where the four pixels nearest to a shifted one are valid, else 0."""
    a, b, c, d = mask[start:], mask[start + 1 :], mask[start + columns :], mask[start + columns + 1 :]
    for i in range(out.size):
        out[i] = np.float32(a[i] & b[i] & c[i] & d[i])
    for row in range(0, out.size, columns):
        outside = out[row + columns - left : row + columns] if left > 0 else out[row : row - left]
        for x in range(outside.size):
            outside[x] = _ZERO


@device
def _fill_product(out, a, b):
    for i in range(a.size):
        out[i] = a[i] * b[i]


@device
def _fill_neighbour_sums(out, values, start, spacing, radius):
    """Sum of 2 radius + 1 values at a spacing, centred at start + i."""
    middle, before, after = values[start:], values[start - spacing :], values[start + spacing :]
    if radius == 1:
        for i in range(out.size):
            out[i] = middle[i] + before[i] + after[i]
        return
    first, last = values[start - 2 * spacing :], values[start + 2 * spacing :]
    for i in range(out.size):
        out[i] = middle[i] + before[i] + after[i] + (first[i] + last[i])
    for j in range(3, radius + 1):
        before, after = values[start - j * spacing :], values[start + j * spacing :]
        for i in range(out.size):
            out[i] += before[i] + after[i]


@device
def _fill_neighbour_minima(out, values, start, spacing, radius):
    """Lowest of 2 radius + 1 values at a spacing, centred at start + i."""
    out[:] = values[start : start + out.size]
    for j in range(1, radius + 1):
        before, after = values[start - j * spacing :], values[start + j * spacing :]
        for i in range(out.size):
            lower = before[i] if before[i] < after[i] else after[i]
            out[i] = lower if lower < out[i] else out[i]


@device
def _fill_scores(score, mask, sums, noise, min_count):
    """Normalised correlation from sums over windows; variances include noise."""
    counts, firsts, seconds, first_squares, other_squares, products = sums
    first_noise, other_noise = np.float32(noise[0]), np.float32(noise[1])
    for i in range(score.size):
        n = counts[i]
        scale = _ONE / (n if n > _ONE else _ONE)
        a, b = scale * firsts[i], scale * seconds[i]
        aa, bb = scale * first_squares[i] - a * a, scale * other_squares[i] - b * b
        aa, bb = (aa if aa > _ZERO else _ZERO) + first_noise, (bb if bb > _ZERO else _ZERO) + other_noise
        correlation = (scale * products[i] - a * b) / (math.sqrt(aa) * math.sqrt(bb))
        score[i] = correlation if (n >= min_count) & (mask[i] > _ZERO) else _UNKNOWN


@device
def _insert(best, n_known, score, begin, n_best):
    """Insert scores into the lists of the best ones of each pixel, in falling order."""
    count = n_known[begin : begin + score.size]
    for i in range(score.size):
        count[i] += _ONE if score[i] > _UNKNOWN else _ZERO
    for k in range(n_best):
        row = best[k, begin : begin + score.size]
        for i in range(score.size):
            a, b = row[i], score[i]
            row[i] = a if a > b else b
            score[i] = b if a > b else a


@device
def _fill_better_half(cost, best, n_known, mask):
    """1 - mean of the better half of the known scores; 1 without one."""
    cost[:] = _ZERO
    for k in range(best.shape[0]):
        row, below = best[k], np.float32(2 * k)
        for i in range(mask.size):
            cost[i] += row[i] if below < n_known[i] else _ZERO
    for i in range(mask.size):
        half = np.float32(math.floor(np.float32(0.5) * (n_known[i] + _ONE)))
        cost[i] = _ONE - cost[i] / (half if half > _ZERO else _ONE) if mask[i] > _ZERO else _WORST_COST


@device
def _correlate(work, stack, begin, end, noise, columns):
    """Scores of the pixels from begin to end, whose windows `work.shifted` and `work.shifted_mask` show."""
    radius, n = stack.window_radius, end - begin
    pad, products, sums, column_sums = radius * (columns + 1), work.products, work.sums, work.column_sums
    values, mask, valid, shifted = work.values[begin:end], work.mask[begin:end], work.shifted_mask[:n], work.shifted[:n]
    for k in range(6):
        products[k, :pad] = _ZERO
        products[k, pad + n : 2 * pad + n] = _ZERO
    _fill_product(products[0, pad:], mask, valid)
    _fill_product(products[1, pad:], values, valid)
    _fill_product(products[2, pad:], shifted, mask)
    _fill_product(products[3, pad:], values, products[1, pad:])
    _fill_product(products[4, pad:], shifted, products[2, pad:])
    _fill_product(products[5, pad:], values, shifted)
    for k in range(6):
        _fill_neighbour_sums(column_sums[: n + 2 * radius], products[k], radius * columns, columns, radius)
        _fill_neighbour_sums(sums[k, :n], column_sums, radius, 1, radius)
    min_count = np.float32(0.5 * (2 * radius + 1) * (2 * radius + 1))
    _fill_scores(work.score[:n], mask, (sums[0], sums[1], sums[2], sums[3], sums[4], sums[5]), noise, min_count)


@device
def _fill_bounds(bounds, mask, columns):
    """First and end row, first and end column of the valid pixels of an image; 0 without one."""
    bounds[:] = 0
    for i in range(mask.size):
        if mask[i]:
            row, column = i // columns, i % columns
            if bounds[1] == 0:
                bounds[0], bounds[2] = row, column
            bounds[1], bounds[2], bounds[3] = row + 1, min(bounds[2], column), max(bounds[3], column + 1)


@device
def _compare(work, stack, images, masks, m, j, d):
    """Compare an image with another one on a plane: `work.score`, of pixels from the returned first to the end one."""
    columns, other = stack.values.shape[2], stack.other[j]
    down, right = stack.base[j, 0] - d * stack.step[j, 0], stack.base[j, 1] - d * stack.step[j, 1]
    top, left = math.floor(down), math.floor(right)
    (first_row, end_row, first, end), shown = work.bounds[0], work.bounds[j - stack.first[m] + 1]
    if max(first, shown[2] - left) >= min(end, shown[3] - 1 - left):
        return 0, 0
    begin, end = max(first_row, shown[0] - top) * columns, min(end_row, shown[1] - 1 - top) * columns
    if begin >= end:
        return 0, 0
    level, other_level = 0, 0
    if stack.blurred is not None:
        level, other_level = blur_levels(stack, m, other, d)
    mean, scale = work.normalisation
    _fill_own(work.values, images[m, level], work.mask, mean, scale)
    start, n = begin + top * columns + left, end - begin
    _weighted_sum(work.along[: n + 3], images[other, other_level], start - 1, columns, cubic_weights(down - top)[0])
    shifted, valid = work.shifted[:n], work.shifted_mask[:n]
    _weighted_sum(shifted, work.along, 1, 1, cubic_weights(right - left)[0])
    _fill_shifted_mask(valid, masks[other], start, left, columns)
    _fill_own(shifted, shifted, valid, mean, scale)
    noise = stack.noise_variance[m] * scale * scale, stack.noise_variance[other] * scale * scale
    _correlate(work, stack, begin, end, noise, columns)
    return begin, end


@device
def _fill_own(out, values, mask, mean, scale):
    """Masked values minus a mean, times a scale."""
    for i in range(out.size):
        out[i] = (values[i] - mean) * scale * mask[i]


@device
def _normalisation(values, mask):
    """Mean of an image, and the power of two nearest to its inverse, which keep sums of squares exact in 32 bits."""
    total, count = 0.0, 1e-30
    for i in range(values.size):
        total += values[i] * mask[i]
        count += mask[i]
    mean = total / count
    _, exponent = math.frexp(mean)
    return np.float32(mean), np.float32(math.ldexp(1.0, -exponent))


@device
def _fill_plane(work, stack, images, masks, m, d):
    """Cost of a plane of an image, compared with its neighbours."""
    count, best, n_known = 0, work.best, work.n_known
    best[:] = _UNKNOWN
    n_known[:] = _ZERO
    for j in range(stack.first[m], stack.first[m + 1]):
        down, right = d * stack.step[j, 0], d * stack.step[j, 1]
        if down * down + right * right > stack.max_shift * stack.max_shift or count == stack.max_compared:
            continue
        begin, end = _compare(work, stack, images, masks, m, j, d)
        count += 1
        _insert(best, n_known, work.score[: end - begin], begin, min(count, best.shape[0]))
    radius, columns = stack.window_radius, stack.values.shape[2]
    pad, cost, n = radius * (columns + 1), work.products[0], work.mask.size
    cost[: pad + n + pad] = _WORST_COST
    _fill_better_half(cost[pad : pad + n], best, n_known, work.mask)
    # The lowest cost of all windows that contain a pixel, so that windows need not straddle an edge.
    _fill_neighbour_minima(work.column_sums[: n + 2 * radius], cost, radius * columns, columns, radius)
    _fill_neighbour_minima(work.score[:n], work.column_sums, radius, 1, radius)


@kernel
def fill_costs(cost, stack, work, images, masks, first):
    """Cost of each plane, 1 - correlation, (n, pixels, planes), of the images from `first` on.

    `images` are (k, levels, pixels), `masks` (k, pixels): flat ones of the stack.
    """
    for i in range(cost.shape[0]):
        m = first + i
        for p in range(masks.shape[1]):
            work.mask[p] = np.float32(masks[m, p])
        _fill_bounds(work.bounds[0], masks[m], stack.values.shape[2])
        for j in range(stack.first[m], stack.first[m + 1]):
            _fill_bounds(work.bounds[j - stack.first[m] + 1], masks[stack.other[j]], stack.values.shape[2])
        work.normalisation[0], work.normalisation[1] = _normalisation(images[m, 0], work.mask)
        for k in range(stack.disparities.size):
            _fill_plane(work, stack, images, masks, m, stack.disparities[k])
            for p in range(masks.shape[1]):
                cost[i, p, k] = work.score[p]
