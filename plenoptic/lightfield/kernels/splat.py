"""Scattered samples of light become a picture: at each pixel what is nearest, by local quadratic regression.

Around a pixel, samples near one depth are fitted by a quadratic function with Gaussian weights (W. S. Cleveland and S. J.
Devlin, J. Am. Stat. Assoc. 83 (1988) 596). A sample is the mean of the picture over its footprint, and so are the
functions that are fitted: what pixels and microlenses blur is sharpened as far as the samples allow.
"""

from __future__ import annotations

import math

from plenoptic.core.jit import device, kernel

WIDER, WIDENINGS = 2.0, 3
"""By what a window that shows too little is widened, and how many windows are tried."""
_LAYERS = 8
"""Surfaces behind each other that are looked at."""
_REST = 0.02
"""Share of a pixel that is no longer looked for."""
_PIVOT = 0.02
"""A fit is of lower order where what is left of a term, after those before it, is less than this part of the weight."""


@device
def _gathered(near, splats, row, column, window, width):
    """Collect the samples around a pixel: number, weight, and how far down and along they lie; how many there are."""
    number, share, down, along = near
    rows, columns = window.shape
    reach = window.cut * width
    cells = int(math.ceil(reach))
    scale, count = -0.5 / (width * width), 0
    for i in range(max(0, row - cells), min(rows, row + cells + 1)):
        for j in range(max(0, column - cells), min(columns, column + cells + 1)):
            cell = i * columns + j
            for k in range(splats.first[cell], splats.first[cell + 1]):
                y, x = splats.place[k, 0] + (i - row), splats.place[k, 1] + (j - column)
                square = y * y + x * x
                if square < reach * reach:
                    number[count], share[count], down[count], along[count] = k, math.exp(scale * square), y, x
                    count += 1
    return count


@device
def _next_layer(near, count, splats, behind, depth):
    """Where the nearest surface behind a nearness lies, how much it covers (times 2 pi width^2), its disparity and end."""
    number, share, _, _ = near
    nearest = -math.inf
    for j in range(count):
        e = splats.nearness[number[j]]
        if nearest < e < behind:
            nearest = e
    covered, mean, disparity = 0.0, 0.0, 0.0
    for j in range(count):
        k = number[j]
        e = splats.nearness[k]
        if nearest - depth <= e < behind:
            part = share[j] * splats.area[k]
            covered += part
            mean += part * e
            disparity += part * splats.disparity[k]
    if covered <= 0.0:
        return math.nan, 0.0, math.nan, nearest
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
def _fitted(solution, squares, order):
    """The first row of the inverse of `squares`, by Cholesky, which it overwrites; False where it is near singular."""
    weight = squares[0, 0]
    for i in range(order):
        for j in range(i + 1):
            t = squares[i, j]
            for k in range(j):
                t -= squares[i, k] * squares[j, k]
            if i > j:
                squares[i, j] = t / squares[j, j]
            elif t <= _PIVOT * weight:
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
def _fill_fit(fit, near, count, splats, middle, window, width):
    """Find the function that turns samples near a depth into weights; how many terms it has, 0 where none is found."""
    solution, squares, terms = fit
    number, share, down, along = near
    order = window.terms
    while order > 0:
        squares[:] = 0.0
        for j in range(count):
            k = number[j]
            if abs(splats.nearness[k] - middle) > window.depth:
                continue
            weight = share[j] * splats.weight[k]
            _fill_terms(terms, down[j], along[j], splats.spread[k] - window.pixel, width)
            for p in range(order):
                for q in range(p + 1):
                    squares[p, q] += weight * terms[p] * terms[q]
        if squares[0, 0] > 0.0 and _fitted(solution, squares, order):
            return order
        # From a quadratic function to a linear one, to a constant.
        order = order // 2 if order > 1 else 0
    return 0


@device
def _add_layer(canvas, at, part, fit, order, near, count, splats, middle, window, width):
    """Add a part of what a fit says of a surface to a pixel."""
    solution, _, terms = fit
    number, share, down, along = near
    row, column = at
    for j in range(count):
        k = number[j]
        if abs(splats.nearness[k] - middle) > window.depth:
            continue
        _fill_terms(terms, down[j], along[j], splats.spread[k] - window.pixel, width)
        weight = 0.0
        for p in range(order):
            weight += solution[p] * terms[p]
        weight *= part * share[j] * splats.weight[k]
        for channel in range(canvas.picture.shape[2]):
            canvas.picture[row, column, channel] += weight * splats.radiance[k, channel]
            if splats.variance is not None:
                canvas.variance[row, column, channel] += weight * weight * splats.variance[k, channel]


@device
def _shown(canvas, at, fit, near, count, splats, window, width):
    """Add surfaces to a pixel, the nearest first, until nothing shines through; the share of it that they cover."""
    row, column = at
    left, behind, most = 1.0, math.inf, 0.0
    scale = 1.0 / (2.0 * math.pi * width * width)
    for _ in range(_LAYERS):
        middle, covered, disparity, behind = _next_layer(near, count, splats, behind, window.depth)
        if covered == 0.0:
            break
        part = left * min(1.0, (covered * scale - window.none) / (window.full - window.none))
        if part <= 0.0:
            continue
        order = _fill_fit(fit, near, count, splats, middle, window, width)
        if order == 0:
            continue
        _add_layer(canvas, at, part, fit, order, near, count, splats, middle, window, width)
        left -= part
        if part > most:
            most = part
            canvas.disparity[row, column], canvas.coverage[row, column] = disparity, covered * scale
        if left < _REST:
            break
    return 1.0 - left


@kernel
def fill_view(canvas, splats, window, near, fit, part):
    """Fill the rows `part` = (first, end) of a canvas; what shows nothing stays nan."""
    for row in range(part[0], part[1]):
        for column in range(canvas.picture.shape[1]):
            width, shown = window.width, 0.0
            for _ in range(WIDENINGS):
                canvas.picture[row, column] = 0.0
                if splats.variance is not None:
                    canvas.variance[row, column] = 0.0
                count = _gathered(near, splats, row, column, window, width)
                shown = _shown(canvas, (row, column), fit, near, count, splats, window, width)
                if shown >= window.least:
                    break
                width *= WIDER
            if shown < window.least:
                shown = math.nan
                canvas.disparity[row, column] = math.nan
                canvas.coverage[row, column] = 0.0
            canvas.picture[row, column] /= shown
            if splats.variance is not None:
                canvas.variance[row, column] /= shown * shown
