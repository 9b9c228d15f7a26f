"""Disparity by matching: each picture against others, whose shift against it is proportional to disparity.

Pictures are the images of microlenses or sub-aperture views; a point at p of one is seen at p + base - disparity step in
another. Planes of constant disparity are compared first, by normalised correlation in a window and over the better half
of the other pictures; paths through the picture make neighbouring pixels agree (H. Hirschmueller, IEEE Trans. PAMI 30
(2008), doi:10.1109/TPAMI.2007.1166); the best plane is refined by least squares, as B. D. Lucas and T. Kanade do (Proc.
IJCAI 1981).
"""

from __future__ import annotations

import math

from plenoptic.core.jit import device, kernel

_UNKNOWN = -2.0
"""A correlation that cannot be had."""
_WORST_COST = 2.0
"""Of pixels that are not known."""
_STEPS = 3
"""Of the refinement."""


@device
def _keys(t):
    """Weights of cubic convolution at a fraction t (R. G. Keys, 1981), and their derivatives."""
    u = 1.0 - t
    return (
        (
            -0.5 * t * u * u,
            1.0 - 2.5 * t * t + 1.5 * t * t * t,
            0.5 * t + 2.0 * t * t - 1.5 * t * t * t,
            -0.5 * t * t * u,
        ),
        (-0.5 * u * u + t * u, -5.0 * t + 4.5 * t * t, 0.5 + 4.0 * t - 4.5 * t * t, -t * u + 0.5 * t * t),
    )


@device
def _fill_moved(moved, there, values, known, down, right, shape):
    """What a picture shows `down` and `right` of each pixel, by cubic convolution; `there` where four are known."""
    rows, columns = shape
    top, left = math.floor(down), math.floor(right)
    (a0, a1, a2, a3), _ = _keys(down - top)
    (b0, b1, b2, b3), _ = _keys(right - left)
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
def _fill_correlation(score, values, known, moved, there, sums, floor, radius, shape):
    """Normalised correlation of a picture and a moved one in windows of what both know; `floor` is added to variances."""
    rows, columns = shape
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
                score[y, x] = ab / math.sqrt((max(aa, 0.0) + floor) * (max(bb, 0.0) + floor))


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
def _levels(images, sweep, m, other, d):
    """How far the sharper of two pictures is to be blurred, so that both show points of a disparity equally blurred."""
    here, there = images.bent[m] - d / sweep.pitch, images.bent[other] - d / sweep.pitch
    blurrier = sweep.opening * (there * there - here * here) / sweep.level
    last = images.blurred.shape[1] - 1
    return min(int(max(blurrier, 0.0) + 0.5), last), min(int(max(-blurrier, 0.0) + 0.5), last)


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
            if down * down + right * right > sweep.farthest * sweep.farthest or count == work.scores.shape[0]:
                continue
            other = pairs.other[j]
            down, right = pairs.base[j, 0] - down, pairs.base[j, 1] - right
            values, seen = images.values[m], images.values[other]
            if images.blurred is not None:
                own, theirs = _levels(images, sweep, m, other, d)
                values, seen = images.blurred[m, own], images.blurred[other, theirs]
            _fill_moved(work.moved, work.there, seen, images.known[other], down, right, shape)
            _fill_correlation(
                work.scores[count], values, known, work.moved, work.there, work.sums, sweep.floor, sweep.radius, shape
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
def _add_paths(total, cost, before, now, small, large, row_step, column_step):
    """Add the costs of paths along one direction: steps of one plane cost `small`, others `large`."""
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
                    best = min(before[k], least + large)
                    if k > 0:
                        best = min(best, before[k - 1] + small)
                    if k + 1 < planes:
                        best = min(best, before[k + 1] + small)
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


@device
def _displaced(images, pairs, sweep, m, j, y, x, d):
    """How much farther a point is seen in another picture than it should: rows, columns, and how both grow with d."""
    other, near = pairs.other[j], d / sweep.pitch
    yy = int(round(y + pairs.base[j, 0] - d * pairs.step[j, 0]))
    xx = int(round(x + pairs.base[j, 1] - d * pairs.step[j, 1]))
    if not (0 <= yy < images.values.shape[1] and 0 <= xx < images.values.shape[2]):
        return math.nan, math.nan, math.nan, math.nan
    here, there = images.shift[m, y, x], images.shift[other, yy, xx]
    down, right = there[1, 0] - here[1, 0], there[1, 1] - here[1, 1]
    return (
        there[0, 0] - here[0, 0] + near * down,
        there[0, 1] - here[0, 1] + near * right,
        down / sweep.pitch,
        right / sweep.pitch,
    )


@device
def _window(images, pairs, sweep, work, m, j, y, x, d):
    """Comparison of a window with another picture: (count, correlation, sum of residual slope, slope^2, residual^2).

    Brightness and contrast of the other picture are fitted. The slopes stay in `work.slopes`, less their mean; nan where
    a pixel is not known.
    """
    rows, columns, radius = images.values.shape[1], images.values.shape[2], sweep.radius
    other = pairs.other[j]
    sy, sx = pairs.step[j, 0], pairs.step[j, 1]
    down, right = pairs.base[j, 0] - d * sy, pairs.base[j, 1] - d * sx
    if images.shift is not None:
        more_down, more_right, by_down, by_right = _displaced(images, pairs, sweep, m, j, y, x, d)
        if not more_down == more_down:
            return 0.0, 0.0, 0.0, 0.0, 0.0
        down, right, sy, sx = down + more_down, right + more_right, sy - by_down, sx - by_right
    top, left = math.floor(down), math.floor(right)
    (a0, a1, a2, a3), (e0, e1, e2, e3) = _keys(down - top)
    (b0, b1, b2, b3), (f0, f1, f2, f3) = _keys(right - left)
    top, left = int(top), int(left)
    n, p, q, s, pp, qq, pq, ps, qs, ss = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    mine, values, known = images.values[m], images.values[other], images.known[other]
    if images.blurred is not None:
        own, theirs = _levels(images, sweep, m, other, d)
        mine, values = images.blurred[m, own], images.blurred[other, theirs]
    place = 0
    for yy in range(y - radius, y + radius + 1):
        for xx in range(x - radius, x + radius + 1):
            work.slopes[place] = math.nan
            place += 1
            r, c = yy + top, xx + left
            if not (0 <= yy < rows and 0 <= xx < columns and 1 <= r < rows - 2 and 1 <= c < columns - 2):
                continue
            if not abs(work.start[yy, xx] - work.start[y, x]) <= sweep.same * abs(work.start[y, x]):
                continue
            if not (images.known[m, yy, xx] & known[r, c] & known[r, c + 1] & known[r + 1, c] & known[r + 1, c + 1]):
                continue
            v, vy, vx = 0.0, 0.0, 0.0
            for i in range(4):
                w = a0 if i == 0 else a1 if i == 1 else a2 if i == 2 else a3
                e = e0 if i == 0 else e1 if i == 1 else e2 if i == 2 else e3
                g0, g1, g2, g3 = (
                    values[r - 1 + i, c - 1],
                    values[r - 1 + i, c],
                    values[r - 1 + i, c + 1],
                    values[r - 1 + i, c + 2],
                )
                along = b0 * g0 + b1 * g1 + b2 * g2 + b3 * g3
                v += w * along
                vy += e * along
                vx += w * (f0 * g0 + f1 * g1 + f2 * g2 + f3 * g3)
            here, slope = mine[yy, xx], -(sy * vy + sx * vx)
            work.slopes[place - 1] = slope
            n += 1.0
            p += here
            q += v
            s += slope
            pp += here * here
            qq += v * v
            pq += here * v
            ps += here * slope
            qs += v * slope
            ss += slope * slope
    if n < sweep.least * place:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    pp, qq, pq = pp - p * p / n, qq - q * q / n, pq - p * q / n
    ps, qs, ss = ps - p * s / n, qs - q * s / n, ss - s * s / n
    correlation = pq / math.sqrt((pp + n * sweep.floor) * (qq + n * sweep.floor))
    gain = pq / qq if qq > 0.0 and pq > 0.0 else 0.0
    for i in range(place):
        work.slopes[i] = gain * (work.slopes[i] - s / n)
    return n, correlation, gain * (ps - gain * qs), gain * gain * ss, pp - 2.0 * gain * pq + gain * gain * qq


@device
def _refined(images, pairs, sweep, work, m, y, x, start):
    """Disparity near `start` with the least residuals, its standard error, and the mean correlation."""
    d, spread, seen = start, math.inf, 0.0
    reach = sweep.reach * abs(start) + sweep.least_reach
    for _ in range(_STEPS):
        pull, stiff, rest, weight, counted, total, own = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(work.common.size):
            work.common[i] = 0.0
        for j in range(pairs.first[m], pairs.first[m + 1]):
            down, right = d * pairs.step[j, 0], d * pairs.step[j, 1]
            if down * down + right * right > sweep.farthest * sweep.farthest:
                continue
            n, correlation, residual, slopes, left = _window(images, pairs, sweep, work, m, j, y, x, d)
            if n == 0.0 or correlation <= sweep.worst:
                continue
            w = correlation - sweep.worst
            pull += w * residual
            stiff += w * slopes
            rest += w * left
            weight += w
            counted += w * n
            total += w * correlation
            own += w * w * slopes
            for i in range(work.common.size):
                if work.slopes[i] == work.slopes[i]:
                    work.common[i] += w * work.slopes[i]
        if not stiff > 0.0:
            break
        seen = total / weight
        # A residual has the noise of two pixels. That of the window itself is in all comparisons.
        for i in range(work.common.size):
            own += work.common[i] * work.common[i]
        spread = math.sqrt(0.5 * max(rest, 0.0) / counted * own) / stiff
        d = min(max(d + pull / stiff, start - reach), start + reach)
    return d, spread, seen


@kernel
def fill_disparities(disparity, error, score, images, pairs, sweep, work, first, end):
    """Disparity, its standard error and the correlation it is found with, (pictures, rows, columns) each."""
    rows, columns = images.values.shape[1], images.values.shape[2]
    planes = sweep.disparities.size
    for m in range(first, end):
        _fill_costs(work.cost, images, pairs, sweep, work, m)
        for y in range(rows):
            for x in range(columns):
                for k in range(planes):
                    work.total[y, x, k] = 0.0
        for direction in range(4):
            down = 1 if direction == 0 else -1 if direction == 1 else 0
            right = 1 if direction == 2 else -1 if direction == 3 else 0
            _add_paths(work.total, work.cost, work.before, work.now, sweep.small, sweep.large, down, right)
        for y in range(rows):
            for x in range(columns):
                work.start[y, x] = _best_plane(work.total, y, x, sweep.disparities)
        for y in range(rows):
            for x in range(columns):
                if not images.known[m, y, x]:
                    continue
                start = work.start[y, x]
                d, spread, seen = _refined(images, pairs, sweep, work, m, y, x, start)
                disparity[m, y, x] = d
                error[m, y, x] = spread
                score[m, y, x] = seen
