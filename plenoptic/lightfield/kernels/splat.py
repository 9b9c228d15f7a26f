"""Scattered samples of light become a picture: at each pixel the nearest surface, by local quadratic regression.

Around a pixel, samples near one depth are fitted by a quadratic function with Gaussian weights (W. S. Cleveland and
S. J. Devlin, J. Am. Stat. Assoc. 83 (1988), doi:10.1080/01621459.1988.10478639). A sample is the mean of the picture
over its footprint, and so are the functions that are fitted: the blur of pixels and microlenses is sharpened as far as
the samples allow.
"""

from __future__ import annotations

import math

from plenoptic.core.numba.jit import device, kernel

PIXEL = 1.0 / 12.0
"""Variance of a pixel of the picture along each axis."""
WIDER, WIDENINGS = 1.5, 4
"""By what a window is widened whose samples fix no function, and how many windows are tried."""
_LAYERS = 8
"""Surfaces behind each other that are looked at."""
_REST = 0.02
"""Share of a pixel that is no longer looked for, and that must be seen at least."""


@device
def _gathered(near, splats, at, window, width):
    """Collect the samples around a pixel: numbers, weights, coverage, offsets from it; returns their number."""
    row, column = at
    rows, columns = window.shape
    cells = math.ceil(window.cut * math.sqrt(max(width * width, window.width * window.width + window.largest)))
    scale, count = -0.5 / (width * width), 0
    for i in range(max(0, row - cells), min(rows, row + cells + 1)):
        for j in range(max(0, column - cells), min(columns, column + cells + 1)):
            cell = i * columns + j
            for k in range(splats.first[cell], splats.first[cell + 1]):
                y, x = splats.place[k, 0] + (i - row), splats.place[k, 1] + (j - column)
                square = (y * y + x * x) / (window.cut * window.cut)
                covering = window.width * window.width + splats.pixel[k]
                if square < max(width * width, covering):
                    square *= window.cut * window.cut
                    near.number[count], near.down[count], near.along[count] = k, y, x
                    near.share[count] = math.exp(scale * square)
                    density = math.exp(-0.5 * square / covering) / (2.0 * math.pi * covering)
                    near.cover[count] = splats.area[k] * density
                    count += 1
    return count


@device
def _next_layer(near, count, splats, behind, depth):
    """Nearest surface behind a nearness: its position, coverage of the pixel, disparity and end."""
    nearest = -math.inf
    for j in range(count):
        e = splats.nearness[near.number[j]]
        if nearest < e < behind:
            nearest = e
    covered, mean, disparity = 0.0, 0.0, 0.0
    for j in range(count):
        k = near.number[j]
        e = splats.nearness[k]
        if nearest - depth <= e < behind:
            covered += near.cover[j]
            mean += near.cover[j] * e
            disparity += near.cover[j] * splats.disparity[k]
    if covered <= 0.0:
        return math.nan, 0.0, math.nan, nearest - depth
    return mean / covered, covered, disparity / covered, nearest - depth


@device
def _fill_terms(terms, down, along, spread, width):
    """Terms of a quadratic function at a sample: means over its footprint, whose variance is `spread`."""
    y, x, s = down / width, along / width, spread / (width * width)
    terms[0] = 1.0
    terms[1] = y
    terms[2] = x
    terms[3] = y * y + s
    terms[4] = x * x + s
    terms[5] = y * x


@device
def _solved(solution, squares, order, pivot):
    """The first row of the inverse of `squares`, by Cholesky, which it overwrites; False where a pivot is too small."""
    weight = squares[0, 0]
    for i in range(order):
        for j in range(i + 1):
            t = squares[i, j]
            for k in range(j):
                t -= squares[i, k] * squares[j, k]
            if i > j:
                squares[i, j] = t / squares[j, j]
            elif t <= pivot * weight:
                return False
            else:
                squares[i, i] = math.sqrt(t)
    for i in range(order):
        t = 1.0 if i == 0 else 0.0
        for k in range(i):
            t -= squares[i, k] * solution[k]
        solution[i] = t / squares[i, i]
    for i in range(order - 1, -1, -1):
        t = solution[i]
        for k in range(i + 1, order):
            t -= squares[k, i] * solution[k]
        solution[i] = t / squares[i, i]
    return True


@device
def _fill_used(near, count, fit, splats, window, middle, width):
    """Find weights that make samples near a depth the value of a function at the pixel; how many terms it has.

    0 where they do not fix it. In the widest window, a function of fewer terms does.
    """
    solution, squares, terms = fit
    order, last = window.terms, width > 0.99 * window.width * WIDER ** (WIDENINGS - 1)
    while order > 0:
        squares[:] = 0.0
        for j in range(count):
            k = near.number[j]
            near.used[j] = 0.0
            if abs(splats.nearness[k] - middle) > window.depth:
                continue
            near.used[j] = near.share[j] * splats.weight[k]
            _fill_terms(terms, near.down[j], near.along[j], splats.spread[k] - PIXEL, width)
            for p in range(order):
                for q in range(p + 1):
                    squares[p, q] += near.used[j] * terms[p] * terms[q]
        if squares[0, 0] > 0.0 and _solved(solution, squares, order, window.pivot):
            break
        # From a quadratic function to a linear one, to a constant.
        order = order // 2 if last and order > 1 else 0
    for j in range(count):
        k = near.number[j]
        if near.used[j] > 0.0 and order > 0:
            _fill_terms(terms, near.down[j], near.along[j], splats.spread[k] - PIXEL, width)
            value = 0.0
            for p in range(order):
                value += solution[p] * terms[p]
            near.used[j] *= value
    return order


@device
def _add_surface(canvas, at, part, near, count, splats):
    """Add part of the samples of a surface to a pixel."""
    row, column = at
    for j in range(count):
        k, weight = near.number[j], part * near.used[j]
        if weight == 0.0:
            continue
        for channel in range(canvas.picture.shape[2]):
            canvas.picture[row, column, channel] += weight * splats.radiance[k, channel]
            if splats.variance is not None:
                canvas.variance[row, column, channel] += weight * weight * splats.variance[k, channel]


@device
def _shown(canvas, at, near, count, fit, splats, window, width):
    """Add surfaces to a pixel, the nearest first, until nothing shines through; the share of it that they cover.

    nan where the samples of one fix no function.
    """
    row, column = at
    left, behind, most = 1.0, math.inf, 0.0
    canvas.picture[row, column] = 0.0
    if splats.variance is not None:
        canvas.variance[row, column] = 0.0
    for _ in range(_LAYERS):
        middle, covered, disparity, behind = _next_layer(near, count, splats, behind, window.depth)
        if covered == 0.0:
            break
        part = left * min(1.0, (covered - window.none) / (window.full - window.none))
        if part <= 0.0:
            continue
        if _fill_used(near, count, fit, splats, window, middle, width) == 0:
            return math.nan
        _add_surface(canvas, at, part, near, count, splats)
        left -= part
        if part > most:
            most = part
            canvas.disparity[row, column], canvas.coverage[row, column] = disparity, covered
        if left < _REST:
            break
    return 1.0 - left


@kernel
def fill_view(canvas, splats, window, near, fit, part):
    """Fill the rows `part` = (first, end) of a canvas; nan where nothing is seen."""
    for row in range(part[0], part[1]):
        for column in range(canvas.picture.shape[1]):
            width, shown = window.width, math.nan
            for _ in range(WIDENINGS):
                count = _gathered(near, splats, (row, column), window, width)
                shown = _shown(canvas, (row, column), near, count, fit, splats, window, width)
                if not math.isnan(shown):
                    break
                width *= WIDER
            if not shown > _REST:
                shown = math.nan
                canvas.disparity[row, column], canvas.coverage[row, column] = math.nan, 0.0
            canvas.picture[row, column] /= shown
            if splats.variance is not None:
                canvas.variance[row, column] /= shown * shown
