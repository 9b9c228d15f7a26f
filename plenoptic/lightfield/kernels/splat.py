"""Pictures from scattered samples: the nearest surface at each pixel, by local quadratic regression.

Around a pixel, samples near one depth are fitted by a quadratic function with Gaussian weights (W. S. Cleveland and S.
J. Devlin, J. Am. Stat. Assoc. 83 (1988), doi:10.1080/01621459.1988.10478639). A sample is the mean of the picture over
its footprint, and the fitted functions are averaged likewise: the blur of pixels and microlenses is deconvolved as far
as the samples allow.
"""

from __future__ import annotations

import math

from plenoptic.core.numba.jit import device, kernel

PIXEL = 1.0 / 12.0
"""Variance of a pixel of the picture along each axis."""
WIDER, WIDENINGS = 1.5, 4
"""Widening factor of a window whose samples do not determine the function, and the number of windows tried."""
CUT = 3.0
"""Radius of a window over its width."""
_TRANSPARENT, _OPAQUE = 0.1, 0.65
"""Sample density, relative to that of an unoccluded surface, at which a surface is invisible or fills a pixel."""
_PIVOT = 0.1
"""Minimum pivot: samples determine a function if each term varies by as much beyond the terms before it."""
_LAYERS = 8
"""Largest number of surfaces behind each other."""
_MIN_COVERAGE = 0.02
"""Remaining transparency at which the search ends, and minimum coverage of a pixel."""


@device
def exp_minus(x):
    """exp(-x) of x >= 0, without calls, so that loops are vectorised: a power series at x / 256, squared eight times.

    Relative errors are below 6e-14 up to x = 10, and 3e-9 up to 40.
    """
    t = -0.00390625 * min(x, 512.0)
    e = 1.0 + t * (1.0 + t * (1 / 2 + t * (1 / 6 + t * (1 / 24 + t * (1 / 120 + t * (1 / 720 + t * (1 / 5040)))))))
    for _ in range(8):
        e *= e
    return e


@device
def _gather(near, splats, position, lens, window, width):
    """Collect samples around a position, except those of a lens, in `Near`; return their number."""
    y_centre, x_centre = position
    row, column = math.floor(y_centre + 0.5), math.floor(x_centre + 0.5)
    rows, columns = window.shape
    cells = math.ceil(CUT * math.sqrt(max(width * width, window.width * window.width + window.max_pixel_variance)))
    count = 0
    for i in range(max(0, row - cells), min(rows, row + cells + 1)):
        for j in range(max(0, column - cells), min(columns, column + cells + 1)):
            cell = i * columns + j
            for k in range(splats.first[cell], splats.first[cell + 1]):
                if window.points is not None and splats.lens[k] == lens:
                    continue
                y, x = splats.offset[k, 0] + (i - y_centre), splats.offset[k, 1] + (j - x_centre)
                scaled_square = (y * y + x * x) / (CUT * CUT)
                covering = window.width * window.width + splats.pixel[k]
                if scaled_square < max(width * width, covering):
                    near.number[count], near.nearness[count] = k, splats.nearness[k]
                    near.down[count], near.along[count], near.spread[count] = y, x, splats.spread[k] - PIXEL
                    near.weight[count], near.cover[count] = scaled_square * (CUT * CUT), covering
                    near.fit_weight[count] = splats.area[k]
                    count += 1
    # Vectorised.
    scale = 0.5 / (width * width)
    for j in range(count):
        square, covering = near.weight[j], near.cover[j]
        near.down[j] /= width
        near.along[j] /= width
        near.spread[j] /= width * width
        near.weight[j] = exp_minus(scale * square)
        near.cover[j] = near.fit_weight[j] * (exp_minus(0.5 * square / covering) / (2.0 * math.pi * covering))
    return count


@device
def _next_layer(near, count, splats, behind, depth):
    """Nearness of the next surface behind a given one, its coverage of the pixel, its disparity and its far end."""
    nearest = -math.inf
    for j in range(count):
        e = near.nearness[j]
        if nearest < e < behind:
            nearest = e
    covered, mean, disparity = 0.0, 0.0, 0.0
    for j in range(count):
        e = near.nearness[j]
        if nearest - depth <= e < behind:
            covered += near.cover[j]
            mean += near.cover[j] * e
            disparity += near.cover[j] * splats.disparity[near.number[j]]
    if covered <= 0.0:
        return math.nan, 0.0, math.nan, nearest - depth
    return mean / covered, covered, disparity / covered, nearest - depth


@device
def _terms(y, x, s):
    """Terms of a quadratic function at a sample, but the constant 1: means over its footprint of variance s."""
    return y, x, y * y + s, x * x + s, y * x


@device
def _solve(solution, squares, order):
    """First row of the inverse of `squares`, by Cholesky in place; False if a pivot is too small."""
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
def _fill_squares(squares, near, count, splats, window, middle):
    """Weighted sums of products of the terms of a quadratic function over samples near a depth, and their weights."""
    # In variables, which stay in registers.
    s00 = s10 = s11 = s20 = s21 = s22 = s30 = s31 = s32 = s33 = s40 = s41 = s42 = s43 = s44 = 0.0
    s50 = s51 = s52 = s53 = s54 = s55 = 0.0
    for j in range(count):
        near.fit_weight[j] = 0.0
        if abs(near.nearness[j] - middle) > window.depth:
            continue
        w = near.weight[j] * splats.weight[near.number[j]]
        near.fit_weight[j] = w
        a, b, c, d, e = _terms(near.down[j], near.along[j], near.spread[j])
        wa, wb, wc, wd, we = w * a, w * b, w * c, w * d, w * e
        s00, s10, s20, s30, s40, s50 = s00 + w, s10 + wa, s20 + wb, s30 + wc, s40 + wd, s50 + we
        s11, s21, s31, s41, s51 = s11 + wa * a, s21 + wb * a, s31 + wc * a, s41 + wd * a, s51 + we * a
        s22, s32, s42, s52 = s22 + wb * b, s32 + wc * b, s42 + wd * b, s52 + we * b
        s33, s43, s53 = s33 + wc * c, s43 + wd * c, s53 + we * c
        s44, s54, s55 = s44 + wd * d, s54 + we * d, s55 + we * e
    sums = s00, s10, s11, s20, s21, s22, s30, s31, s32, s33, s40, s41, s42, s43, s44, s50, s51, s52, s53, s54, s55
    for p in range(6):
        for q in range(p + 1):
            squares[p, q] = sums[p * (p + 1) // 2 + q]


@device
def _fit_weights(near, count, fit, splats, window, middle, width):
    """Weights that turn samples near a depth into the fitted value at the pixel; return the number of terms.

    Returns 0 if the samples do not determine the function. In the widest window, a function of fewer terms is fitted.
    """
    solution, squares = fit
    order, widest = window.terms, width > 0.99 * window.width * WIDER ** (WIDENINGS - 1)
    while order > 0:
        _fill_squares(squares, near, count, splats, window, middle)
        if squares[0, 0] > 0.0 and _solve(solution, squares, order):
            break
        # From a quadratic function to a linear one, to a constant.
        order = order // 2 if widest and order > 1 else 0
    for j in range(count):
        if near.fit_weight[j] > 0.0 and order > 0:
            a, b, c, d, e = _terms(near.down[j], near.along[j], near.spread[j])
            value = solution[0]
            if order > 1:
                value += solution[1] * a
                value += solution[2] * b
            if order > 3:
                value += solution[3] * c
                value += solution[4] * d
                value += solution[5] * e
            near.fit_weight[j] *= value
    return order


@device
def _add_surface(canvas, at, visible, near, count, splats):
    """Add a surface to a pixel, weighted by its visible fraction."""
    row, column = at
    for j in range(count):
        k, weight = near.number[j], visible * near.fit_weight[j]
        if weight == 0.0:
            continue
        for channel in range(canvas.picture.shape[2]):
            canvas.picture[row, column, channel] += weight * splats.radiance[k, channel]
            if splats.variance is not None:
                canvas.variance[row, column, channel] += weight * weight * splats.variance[k, channel]


@device
def _composite(canvas, at, near, count, fit, splats, window, width):
    """Composite surfaces in a pixel from front to back until it is opaque; return its coverage.

    Returns nan if the samples of a surface do not determine the function.
    """
    row, column = at
    transparency, behind, largest = 1.0, math.inf, 0.0
    canvas.picture[row, column] = 0.0
    if splats.variance is not None:
        canvas.variance[row, column] = 0.0
    for _ in range(_LAYERS):
        middle, covered, disparity, behind = _next_layer(near, count, splats, behind, window.depth)
        if covered == 0.0:
            break
        visible = transparency * min(1.0, (covered - _TRANSPARENT) / (_OPAQUE - _TRANSPARENT))
        if visible <= 0.0:
            continue
        if _fit_weights(near, count, fit, splats, window, middle, width) == 0:
            return math.nan
        _add_surface(canvas, at, visible, near, count, splats)
        transparency -= visible
        if visible > largest:
            largest = visible
            canvas.disparity[row, column], canvas.coverage[row, column] = disparity, covered
        if transparency < _MIN_COVERAGE:
            break
    return 1.0 - transparency


@kernel
def fill_view(canvas, splats, window, near, fit, part):
    """Fill the rows `part` = (first, end) of a canvas; nan where no surface is visible."""
    for row in range(part[0], part[1]):
        for column in range(canvas.picture.shape[1]):
            width, coverage, position, lens = window.width, math.nan, (float(row), float(column)), -1
            if window.points is not None:
                position, lens = (window.points[row, column, 0], window.points[row, column, 1]), row
            for _ in range(WIDENINGS):
                count = _gather(near, splats, position, lens, window, width)
                coverage = _composite(canvas, (row, column), near, count, fit, splats, window, width)
                if not math.isnan(coverage):
                    break
                width *= WIDER
            if not coverage > _MIN_COVERAGE:
                coverage = math.nan
                canvas.disparity[row, column], canvas.coverage[row, column] = math.nan, 0.0
            canvas.picture[row, column] /= coverage
            if splats.variance is not None:
                canvas.variance[row, column] /= coverage * coverage
