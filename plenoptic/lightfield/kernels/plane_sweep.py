"""Disparity by matching: each picture against others, whose shift against it is proportional to disparity.

Pictures are the images of microlenses or sub-aperture views; a point at p of one is seen at p + base - disparity step
in another. Planes of constant disparity are compared first, by normalised correlation in a window and over the better
half of the other pictures; paths through the picture make neighbouring pixels agree (H. Hirschmueller, IEEE Trans.
PAMI 30 (2008), doi:10.1109/TPAMI.2007.1166). `refining` finds what lies between planes.
"""

from __future__ import annotations

import math

from plenoptic.core.numba.jit import device, kernel
from plenoptic.lightfield.kernels.cubic import cubic_weights
from plenoptic.lightfield.kernels.subpixel import levels, refine_subpixel

_UNKNOWN = -2.0
"""A correlation that cannot be had."""
_WORST_COST = 2.0
"""Of pixels that are not known."""
_SMALL, _LARGE = 0.03, 0.3
"""Correlation that a step to the next plane costs, and one to any other."""


@device
def _fill_moved(moved, there, values, known, down, right, shape):
    """What a picture shows `down` and `right` of each pixel, by cubic convolution; `there` where four are known."""
    rows, columns = shape
    top, left = math.floor(down), math.floor(right)
    (a0, a1, a2, a3), _ = cubic_weights(down - top)
    (b0, b1, b2, b3), _ = cubic_weights(right - left)
    top, left = int(top), int(left)
    for y in range(rows):
        r = y + top
        inside = 1 <= r < rows - 2
        for x in range(columns):
            there[y, x] = 0
        if not inside:
            continue
        first, last = max(0, 1 - left), min(columns, columns - 2 - left)
        for x in range(first, last):
            c = x + left
            there[y, x] = known[r, c] & known[r, c + 1] & known[r + 1, c] & known[r + 1, c + 1]
            above = (
                b0 * values[r - 1, c - 1]
                + b1 * values[r - 1, c]
                + b2 * values[r - 1, c + 1]
                + b3 * values[r - 1, c + 2]
            )
            here = b0 * values[r, c - 1] + b1 * values[r, c] + b2 * values[r, c + 1] + b3 * values[r, c + 2]
            below = (
                b0 * values[r + 1, c - 1]
                + b1 * values[r + 1, c]
                + b2 * values[r + 1, c + 1]
                + b3 * values[r + 1, c + 2]
            )
            far = (
                b0 * values[r + 2, c - 1]
                + b1 * values[r + 2, c]
                + b2 * values[r + 2, c + 1]
                + b3 * values[r + 2, c + 2]
            )
            moved[y, x] = a0 * above + a1 * here + a2 * below + a3 * far


@device
def _fill_correlation(score, values, known, work, floor, other_floor, radius, shape):
    """Normalised correlation of a picture and a moved one in windows of what both know, over variances and floors."""
    rows, columns = shape
    moved, there, sums = work.moved, work.there, work.sums
    for y in range(rows):
        for k in range(6):
            for x in range(columns):
                sums[k, y, x] = 0.0
        # Sums along the row, then along columns: each is the one before, and what comes in and goes out.
        n, a, b, aa, bb, ab = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for x in range(-radius, columns):
            into, out = x + radius, x - radius - 1
            if into < columns and known[y, into] & there[y, into]:
                p, q = values[y, into], moved[y, into]
                n += 1.0
                a += p
                b += q
                aa += p * p
                bb += q * q
                ab += p * q
            if out >= 0 and known[y, out] & there[y, out]:
                p, q = values[y, out], moved[y, out]
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
    least = 0.5 * (2 * radius + 1) * (2 * radius + 1)
    for x in range(columns):
        for k in range(6):
            sums[k, rows, x] = 0.0
    for y in range(-radius, rows):
        into, out = y + radius, y - radius - 1
        for k in range(6):
            if into < rows:
                for x in range(columns):
                    sums[k, rows, x] += sums[k, into, x]
            if out >= 0:
                for x in range(columns):
                    sums[k, rows, x] -= sums[k, out, x]
        if y >= 0:
            for x in range(columns):
                n = sums[0, rows, x]
                if n < least or not known[y, x]:
                    score[y, x] = _UNKNOWN
                    continue
                a, b = sums[1, rows, x] / n, sums[2, rows, x] / n
                aa, bb = sums[3, rows, x] / n - a * a, sums[4, rows, x] / n - b * b
                ab = sums[5, rows, x] / n - a * b
                score[y, x] = ab / math.sqrt((max(aa, 0.0) + floor) * (max(bb, 0.0) + other_floor))


@device
def _better_half(scores, count, y, x):
    """Mean of the better half of what is known of `scores`; 0 where nothing is."""
    kept = 0
    for j in range(count):
        one = scores[j, y, x]
        if one == _UNKNOWN:
            continue
        # Kept ones are in falling order at the front.
        k = kept
        while k > 0 and scores[k - 1, y, x] < one:
            scores[k, y, x] = scores[k - 1, y, x]
            k -= 1
        scores[k, y, x] = one
        kept += 1
    half = (kept + 1) // 2
    total = 0.0
    for j in range(half):
        total += scores[j, y, x]
    return total / half if half else 0.0


@device
def _fill_costs(cost, images, pairs, sweep, work, m):
    """1 - correlation of each plane, (rows, columns, planes)."""
    shape = (images.values.shape[1], images.values.shape[2])
    rows, columns = shape
    known = images.known[m]
    for k in range(sweep.disparities.size):
        d, count = sweep.disparities[k], 0
        for j in range(pairs.first[m], pairs.first[m + 1]):
            down, right = d * pairs.step[j, 0], d * pairs.step[j, 1]
            if down * down + right * right > sweep.farthest * sweep.farthest or count == sweep.compared:
                continue
            other = pairs.other[j]
            down, right = pairs.base[j, 0] - down, pairs.base[j, 1] - right
            values, seen = images.values[m], images.values[other]
            if images.blurred is not None:
                own, theirs = levels(images, sweep, m, other, d)
                values, seen = images.blurred[m, own], images.blurred[other, theirs]
            _fill_moved(work.moved, work.there, seen, images.known[other], down, right, shape)
            _fill_correlation(
                work.scores[count], values, known, work, images.floor[m], images.floor[other], sweep.radius, shape
            )
            count += 1
        for y in range(rows):
            for x in range(columns):
                cost[y, x, k] = 1.0 - _better_half(work.scores, count, y, x) if known[y, x] else _WORST_COST
    _shift_windows(cost, work.total, sweep.radius)


@device
def _shift_windows(cost, room, reach):
    """Take the lowest cost of all windows that hold a pixel: where one lies across an edge, another does not."""
    rows, columns, planes = cost.shape
    for y in range(rows):
        for x in range(columns):
            for k in range(planes):
                least = cost[y, x, k]
                for xx in range(max(0, x - reach), min(columns, x + reach + 1)):
                    least = min(least, cost[y, xx, k])
                room[y, x, k] = least
    for y in range(rows):
        for x in range(columns):
            for k in range(planes):
                least = room[y, x, k]
                for yy in range(max(0, y - reach), min(rows, y + reach + 1)):
                    least = min(least, room[yy, x, k])
                cost[y, x, k] = least


@device
def _add_paths(total, cost, before, now, row_step, column_step):
    """Add the costs of paths along one direction: steps of one plane cost less than others."""
    rows, columns, planes = cost.shape
    for line in range(columns if row_step else rows):
        for place in range(rows if row_step else columns):
            y = (place if row_step > 0 else rows - 1 - place) if row_step else line
            x = line if row_step else (place if column_step > 0 else columns - 1 - place)
            if place == 0:
                for k in range(planes):
                    now[k] = cost[y, x, k]
            else:
                least = before[0]
                for k in range(1, planes):
                    least = min(least, before[k])
                for k in range(planes):
                    best = min(before[k], least + _LARGE)
                    if k > 0:
                        best = min(best, before[k - 1] + _SMALL)
                    if k + 1 < planes:
                        best = min(best, before[k + 1] + _SMALL)
                    now[k] = cost[y, x, k] + best - least
            for k in range(planes):
                total[y, x, k] += now[k]
                before[k] = now[k]


@device
def _best_plane(total, y, x, disparities):
    """The disparity at the lowest cost, by a parabola through three planes (in its logarithm or as it is)."""
    planes, best = disparities.size, 0
    for k in range(1, planes):
        if total[y, x, k] < total[y, x, best]:
            best = k
    if best in (0, planes - 1):
        return disparities[best]
    low, here, high = total[y, x, best - 1], total[y, x, best], total[y, x, best + 1]
    bend = low - 2.0 * here + high
    t = 0.5 * (low - high) / bend if bend > 0.0 else 0.0
    beside = disparities[best + 1] if t > 0.0 else disparities[best - 1]
    return disparities[best] + abs(t) * (beside - disparities[best])


@kernel
def fill_disparities(disparity, error, share, images, pairs, sweep, work, first_and_end):
    """Disparity, its standard error and the share of pictures that show it, (pictures, rows, columns)."""
    rows, columns = images.values.shape[1], images.values.shape[2]
    planes = sweep.disparities.size
    for m in range(first_and_end[0], first_and_end[1]):
        _fill_costs(work.cost, images, pairs, sweep, work, m)
        for y in range(rows):
            for x in range(columns):
                for k in range(planes):
                    work.total[y, x, k] = 0.0
        for direction in range(4):
            down = 1 if direction == 0 else -1 if direction == 1 else 0
            right = 1 if direction == 2 else -1 if direction == 3 else 0
            _add_paths(work.total, work.cost, work.before, work.now, down, right)
        for y in range(rows):
            for x in range(columns):
                work.start[y, x] = _best_plane(work.total, y, x, sweep.disparities)
        for y in range(rows):
            for x in range(columns):
                if not images.known[m, y, x]:
                    continue
                disparity[m, y, x], error[m, y, x], share[m, y, x] = refine_subpixel(
                    images, pairs, sweep, work, m, y, x
                )
