"""A disparity between planes: the window around a pixel is fitted to other pictures by least squares.

As B. D. Lucas and T. Kanade do (Proc. IJCAI 1981), here for all pictures at once.
"""

from __future__ import annotations

import math

from plenoptic.core.numba.jit import device
from plenoptic.lightfield.kernels.cubic import cubic_weights

_STEPS = 3
_LEAST = 0.25
"""Part of a window that must be known."""
_WORST = 0.3
"""Correlation that counts at least."""
_SAME = 1.5
"""Pixels of a window belong to the one in its middle up to this many times the reach of the refinement away."""


@device
def levels(images, sweep, m, other, d):
    """How far the sharper of two pictures is to be blurred, so that both show points of a disparity equally blurred."""
    here, there = images.bent[m] - d / sweep.pitch, images.bent[other] - d / sweep.pitch
    blurrier = sweep.opening * (there * there - here * here) / sweep.level
    last = images.blurred.shape[1] - 1
    return min(math.floor(max(blurrier, 0.0) + 0.5), last), min(math.floor(max(-blurrier, 0.0) + 0.5), last)


@device
def _reach(sweep, disparity):
    """How far the refinement goes."""
    return sweep.reach * abs(disparity) + sweep.least_reach


@device
def _displaced(images, pairs, sweep, m, j, place, d):
    """How much farther a point is seen in another picture than it should: rows, columns, and how both grow with d."""
    (y, x), other, near = place, pairs.other[j], d / sweep.pitch
    yy = math.floor(y + pairs.base[j, 0] - d * pairs.step[j, 0] + 0.5)
    xx = math.floor(x + pairs.base[j, 1] - d * pairs.step[j, 1] + 0.5)
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
def _window(images, pairs, sweep, work, m, j, place, d):
    """Comparison of a window with another picture: (count, correlation, sum of residual slope, slope^2, residual^2).

    Brightness and contrast of the other picture are fitted. The slopes stay in `work.slopes`, less their mean; nan
    where a pixel is not known.
    """
    rows, columns, radius = images.values.shape[1], images.values.shape[2], sweep.radius
    (y, x), other = place, pairs.other[j]
    sy, sx = pairs.step[j, 0], pairs.step[j, 1]
    down, right = pairs.base[j, 0] - d * sy, pairs.base[j, 1] - d * sx
    if images.shift is not None:
        more_down, more_right, by_down, by_right = _displaced(images, pairs, sweep, m, j, place, d)
        if math.isnan(more_down):
            return 0.0, 0.0, 0.0, 0.0, 0.0
        down, right, sy, sx = down + more_down, right + more_right, sy - by_down, sx - by_right
    top, left = math.floor(down), math.floor(right)
    (a0, a1, a2, a3), (e0, e1, e2, e3) = cubic_weights(down - top)
    (b0, b1, b2, b3), (f0, f1, f2, f3) = cubic_weights(right - left)
    top, left = int(top), int(left)
    n, p, q, s, pp, qq, pq, ps, qs, ss = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    mine, values, known = images.values[m], images.values[other], images.known[other]
    if images.blurred is not None:
        own, theirs = levels(images, sweep, m, other, d)
        mine, values = images.blurred[m, own], images.blurred[other, theirs]
    same, floor, slot = _SAME * _reach(sweep, work.start[y, x]), images.floor[m], 0
    for yy in range(y - radius, y + radius + 1):
        for xx in range(x - radius, x + radius + 1):
            work.slopes[slot] = math.nan
            slot += 1
            r, c = yy + top, xx + left
            if not (1 <= r < rows - 2 and 1 <= c < columns - 2):
                continue
            if not (0 <= yy < rows and 0 <= xx < columns and abs(work.start[yy, xx] - work.start[y, x]) <= same):
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
            work.slopes[slot - 1] = slope
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
    if n < _LEAST * slot:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    pp, qq, pq = pp - p * p / n, qq - q * q / n, pq - p * q / n
    ps, qs, ss = ps - p * s / n, qs - q * s / n, ss - s * s / n
    correlation = pq / math.sqrt((pp + n * floor) * (qq + n * images.floor[other]))
    gain = pq / qq if qq > 0.0 and pq > 0.0 else 0.0
    for i in range(slot):
        work.slopes[i] = gain * (work.slopes[i] - s / n)
    return n, correlation, gain * (ps - gain * qs), gain * gain * ss, pp - 2.0 * gain * pq + gain * gain * qq


@device
def refine_subpixel(images, pairs, sweep, work, m, y, x):
    """Disparity near the best plane's with the least residuals, its error, and the share of pictures that show it."""
    start, spread, share = work.start[y, x], math.inf, 0.0
    d, reach = start, _reach(sweep, start)
    for _ in range(_STEPS):
        pull, stiff, rest, counted, own = 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(work.common.size):
            work.common[i] = 0.0
        compared, seen, kept = 0, 0, 0
        for j in range(pairs.first[m], pairs.first[m + 1]):
            down, right = d * pairs.step[j, 0], d * pairs.step[j, 1]
            if down * down + right * right > sweep.farthest * sweep.farthest or compared == sweep.compared:
                continue
            compared += 1
            n, correlation, residual, slopes, left = _window(images, pairs, sweep, work, m, j, (y, x), d)
            seen += n > 0.0
            if n == 0.0 or correlation <= _WORST:
                continue
            kept += 1
            w = correlation - _WORST
            pull += w * residual
            stiff += w * slopes
            rest += w * left
            counted += w * n
            own += w * w * slopes
            for i in range(work.common.size):
                if work.slopes[i] == work.slopes[i]:
                    work.common[i] += w * work.slopes[i]
        share = kept / max(seen, 1)
        if not stiff > 0.0:
            break
        # A residual has the noise of two pixels. That of the window itself is in all comparisons.
        for i in range(work.common.size):
            own += work.common[i] * work.common[i]
        spread = math.sqrt(0.5 * max(rest, 0.0) / counted * own) / stiff
        d = min(max(d + pull / stiff, start - reach), start + reach)
    # At the end of its reach nothing was found.
    if abs(d - start) >= reach:
        spread = max(spread, reach)
    return d, spread, share
