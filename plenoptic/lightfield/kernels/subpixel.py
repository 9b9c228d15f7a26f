"""Sub-pixel disparity: least-squares fit of the window around a pixel to other images.

After B. D. Lucas and T. Kanade (Proc. IJCAI 1981), for all images simultaneously.
"""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.numba.jit import device, kernel
from plenoptic.lightfield.kernels.cubic import cubic_weights, spline_noise, spline_weights

_STEPS, _ITERATIONS = 3, 3
_SMALL_STEP = 0.5
"""Step over standard error below which it is the last: a further one would be some tenth of it."""
_MIN_VALID = 0.25
"""Minimum fraction of valid pixels in a window."""
_MIN_CORRELATION = 0.3
"""Correlation below which an image does not count."""
_SAME_SURFACE = 1.5
"""Window pixels belong to the surface of the central one if their disparities differ by up to this many search ranges.
"""


@device
def blur_levels(stack, m, other, d):
    """Blur levels of two images that give points of a disparity the same blur in both."""
    blur, other_blur = stack.defocus[m] - d / stack.pitch, stack.defocus[other] - d / stack.pitch
    excess = stack.blur_variance * (other_blur * other_blur - blur * blur)
    highest = stack.blurred.shape[1] - 1
    return min(math.floor(max(excess, 0.0) + 0.5), highest), min(math.floor(max(-excess, 0.0) + 0.5), highest)


@device
def _reach(stack, disparity):
    """Search range of the refinement around a disparity, pixels."""
    return stack.reach[0] * abs(disparity) + stack.reach[1]


@device
def _image_displacement(stack, shape, moved, m, j, pixel, d):
    """Displacement of a point's image relative to the pinhole model: rows, columns, and their derivatives by d.

    `moved` has an estimate of the displacement in image j, and gets the result: the displacement is that at the
    displaced position.
    """
    (rows, columns), (y, x), per_pitch = shape, pixel, d / stack.pitch
    central, values = stack.residual_displacement[m, y * columns + x], stack.residual_displacement[stack.other[j]]
    down = y + stack.base[j, 0] - d * stack.step[j, 0] + moved[0]
    right = x + stack.base[j, 1] - d * stack.step[j, 1] + moved[1]
    r, c = math.floor(down + 0.5), math.floor(right + 0.5)
    # Pixels on the border have no displacement.
    if not (1 <= r < rows - 1 and 1 <= c < columns - 1):
        moved[0], moved[1] = 0.0, 0.0
        return math.nan, math.nan, math.nan, math.nan
    down, right = down - r, right - c
    nearest = np.uint64(r * columns + c)
    next_row = np.uint64(nearest + columns if down > 0.0 else nearest - columns)
    next_column = np.uint64(nearest + 1 if right > 0.0 else nearest - 1)
    a, b, c = values[nearest], values[next_row], values[next_column]
    down, right = abs(down), abs(right)
    by_down = _between(a[2], b[2], c[2], down, right) - central[2]
    by_right = _between(a[3], b[3], c[3], down, right) - central[3]
    more_down = _between(a[0], b[0], c[0], down, right) - central[0] + per_pitch * by_down
    more_right = _between(a[1], b[1], c[1], down, right) - central[1] + per_pitch * by_right
    is_finite = more_down == more_down
    moved[0], moved[1] = more_down if is_finite else 0.0, more_right if is_finite else 0.0
    return more_down, more_right, by_down / stack.pitch, by_right / stack.pitch


@device
def _between(value, next_row, next_column, down, right):
    """A value between pixels, linear in rows and columns; that of the nearest pixel where others have none."""
    step_down, step_right = down * (next_row - value), right * (next_column - value)
    return value + (step_down if step_down == step_down else 0.0) + (step_right if step_right == step_right else 0.0)


@device
def _model_disparity(stack, shape, moved, m, pixel, d):
    """Disparity of the pinhole model of a pixel whose images lie where those of disparity d do without displacement.

    `moved` (images, 2) gets the displacements.
    """
    along, length, n_compared, first = 0.0, 0.0, 0, stack.first[m]
    moved[:] = 0.0
    for j in range(first, stack.first[m + 1]):
        down, right = stack.step[j, 0], stack.step[j, 1]
        squares = down * down + right * right
        if d * d * squares > stack.max_shift * stack.max_shift or n_compared == stack.max_compared:
            continue
        n_compared += 1
        more_down, more_right = 0.0, 0.0
        for _ in range(_ITERATIONS):
            more_down, more_right, _, _ = _image_displacement(stack, shape, moved[j - first], m, j, pixel, d)
            if math.isnan(more_down):
                break
        if not math.isnan(more_down):
            along += more_down * down + more_right * right
            length += squares
    return d + along / length if length > 0.0 else d


@device
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]


@device
def _to_float32(weights):
    return np.float32(weights[0]), np.float32(weights[1]), np.float32(weights[2]), np.float32(weights[3])


@device
def _fill_own_window(own, stack, start, m, y, x):
    """1 for the pixels (w, w) of the window that are valid and show the surface of the central one, else 0."""
    radius, swept, mask = stack.window_radius, start[y, x], stack.mask[m]
    tolerance = _SAME_SURFACE * _reach(stack, swept)
    for i in range(own.shape[0]):
        for k in range(own.shape[1]):
            yy, xx = y - radius + i, x - radius + k
            own[i, k] = mask[yy * start.shape[1] + xx] and abs(start[yy, xx] - swept) <= tolerance


@device
def _fill_valid(valid, count, along, mask, columns, width):
    """1 for pixels followed by three valid ones on the right and below, and the number of these in each window.

    A window of width x width pixels begins at a pixel of the count, which may be too large at the ends of rows.
    """
    below, right, size = mask[columns:], mask[1:], mask.size - columns - 1
    diagonal = below[1:]
    for i in range(size):
        valid[i] = mask[i] & right[i] & below[i] & diagonal[i]
    along[:], count[:] = 0, 0
    for k in range(width):
        shifted = valid[k:]
        for i in range(mask.size):
            along[i] += shifted[i]
    for k in range(width):
        shifted = along[k * columns :]
        for i in range(mask.size):
            count[i] += shifted[i]


@device
def _fill_slots(work, valid, row, column, shape):
    """Fill `slots` by the places in the window of the pixels valid in both images; return their number.

    The window begins at a row and a column of the other image, of this shape.
    """
    (rows, columns), width, n = shape, work.own.shape[0], 0
    first, end = max(0, 1 - column), min(width, columns - 2 - column)
    for i in range(max(0, 1 - row), min(width, rows - 2 - row)):
        in_window, in_other = work.own[i, first:end], valid[(row + i) * columns + column + first :]
        for k in range(in_window.size):
            work.slots[n] = i * (width + 3) + first + k
            work.places[n] = i * columns + first + k
            n += in_window[k] & in_other[k]
    return n


@device
def _fill_patch(patch, values, row, column, side, shape):
    """Copy the values (side, side) of an image (rows columns,) from a row and a column on, row after row."""
    rows, columns = shape
    first, end = max(0, -column), min(side, columns - column)
    for i in range(max(0, -row), min(side, rows - row)):
        out, line = patch[i * side + first : i * side + end], values[(row + i) * columns + column + first :]
        for k in range(out.size):
            out[k] = line[k]


@device
def _fill_weighted_sums(out, values, spacing, weights):
    """Weighted sum of four values at a spacing, the first of which is values[i]."""
    a, b, c, d = weights
    first, second, third, fourth = values, values[spacing:], values[2 * spacing :], values[3 * spacing :]
    for i in range(out.size):
        out[i] = a * first[i] + b * second[i] + c * third[i] + d * fourth[i]


@device
def _fill_slopes(slope, along, by_column, spacing, weights, derivatives, step):
    """Derivatives by disparity from values and derivatives along rows, for a step (rows, columns) of disparity."""
    (a, b, c, d), (e, f, g, h), (down, right) = weights, derivatives, step
    first, second, third, fourth = along, along[spacing:], along[2 * spacing :], along[3 * spacing :]
    one, two, three, four = by_column, by_column[spacing:], by_column[2 * spacing :], by_column[3 * spacing :]
    for i in range(slope.size):
        by_row = e * first[i] + f * second[i] + g * third[i] + h * fourth[i]
        across = a * one[i] + b * two[i] + c * three[i] + d * four[i]
        slope[i] = -(down * by_row + right * across)


@device
def _window(stack, start, work, m, j, pixel, d):
    """Comparison of a window with another image: (count, correlation, sum of residual slope, slope^2, residual^2).

    Gain and offset of the other image are fitted. `work.residuals` gets the slopes minus their mean, of the slots.
    """
    radius, (y, x), other = stack.window_radius, pixel, stack.other[j]
    sy, sx = stack.step[j, 0], stack.step[j, 1]
    down, right = stack.base[j, 0] - d * sy, stack.base[j, 1] - d * sx
    if stack.residual_displacement is not None:
        more_down, more_right, by_down, by_right = _image_displacement(
            stack, start.shape, work.moved[j - stack.first[m]], m, j, pixel, d
        )
        if math.isnan(more_down):
            return 0, 0.0, 0.0, 0.0, 0.0
        down, right, sy, sx = down + more_down, right + more_right, sy - by_down, sx - by_right
    top, left = math.floor(down), math.floor(right)
    row, column = y - radius + int(top), x - radius + int(left)
    width = 2 * radius + 1
    side = width + 3
    columns, k, min_valid = start.shape[1], j - stack.first[m], _MIN_VALID * width * width
    corner = row * columns + column
    if corner >= start.size or (corner >= 0 and work.n_valid[k, corner] < min_valid):
        return 0, 0.0, 0.0, 0.0, 0.0
    n = _fill_slots(work, work.valid[k], row, column, start.shape)
    if n < min_valid:
        return 0, 0.0, 0.0, 0.0, 0.0
    window_values, values = stack.values[m], stack.values[other]
    if stack.coefficients is not None:
        values = stack.coefficients[other]
        row_weights, row_derivatives = spline_weights(down - top)
        weights, derivatives = spline_weights(right - left)
        noise_products = spline_noise
    else:
        row_weights, row_derivatives = cubic_weights(down - top)
        weights, derivatives = cubic_weights(right - left)
        noise_products = _dot
    # Covariance of the interpolated noise with that of the slope.
    covariance = -stack.noise_variance[other] * (
        sy * noise_products(weights, weights) * noise_products(row_weights, row_derivatives)
        + sx * noise_products(row_weights, row_weights) * noise_products(weights, derivatives)
    )
    if stack.blurred is not None:
        level, other_level = blur_levels(stack, m, other, d)
        window_values, values = stack.blurred[m, level], stack.blurred[other, other_level]
        if other_level > 0:
            covariance = 0.0  # blurred noise is as smooth halfway between pixels
    patch, along, by_column = work.patch, work.along, work.by_column
    v, slope, slots = work.values, work.slopes, work.slots
    row_weights, row_derivatives = _to_float32(row_weights), _to_float32(row_derivatives)
    _fill_patch(patch, values, row - 1, column - 1, side, start.shape)
    _fill_weighted_sums(along, patch, 1, _to_float32(weights))
    _fill_weighted_sums(by_column, patch, 1, _to_float32(derivatives))
    _fill_weighted_sums(v, along, side, row_weights)
    _fill_slopes(slope, along, by_column, side, row_weights, row_derivatives, (np.float32(sy), np.float32(sx)))
    p, q, s, pp, qq, pq, ps, qs, ss = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    window = window_values[(y - radius) * start.shape[1] + x - radius :]
    for k in range(n):
        slot = slots[k]
        a, b, c = window[work.places[k]], v[slot], slope[slot]
        p += a
        q += b
        s += c
        pp += a * a
        qq += b * b
        pq += a * b
        ps += a * c
        qs += b * c
        ss += c * c
    pp, qq, pq = pp - p * p / n, qq - q * q / n, pq - p * q / n
    ps, qs, ss = ps - p * s / n, qs - q * s / n, ss - s * s / n
    correlation = pq / math.sqrt((pp + n * stack.noise_variance[m]) * (qq + n * stack.noise_variance[other]))
    gain = pq / qq if qq > 0.0 and pq > 0.0 else 0.0
    # A change of gain that has the same effect as a shift leaves no information on the shift.
    common = qs / qq if qq > 0.0 else 0.0
    for k in range(n):
        work.residuals[k] = gain * (slope[slots[k]] - s / n - common * (v[slots[k]] - q / n))
    # Interpolation blurs noise most halfway between pixels, which attracts the fit: its share is taken off.
    gradient = gain * (ps - gain * (qs - n * covariance))
    stiffness = gain * gain * max(ss - common * qs, 0.0)
    return n, correlation, gradient, stiffness, pp - 2.0 * gain * pq + gain * gain * qq


@device
def _refine(stack, start, work, m, y, x):
    """Disparity of least residuals near the best plane, its standard error, and the fraction of agreeing images."""
    slope_sums, error, agreement = work.slope_sums, math.inf, 0.0
    _fill_own_window(work.own, stack, start, m, y, x)
    swept, reach = start[y, x], _reach(stack, start[y, x])
    if stack.residual_displacement is not None:
        swept = _model_disparity(stack, start.shape, work.moved, m, (y, x), swept)
    d = swept
    for _ in range(_STEPS):
        gradient_sum, stiffness, residual_sum, weight_sum, slope_variance, scatter = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(slope_sums.size):
            slope_sums[i] = 0.0
        n_compared, n_valid, n_agreeing = 0, 0, 0
        for j in range(stack.first[m], stack.first[m + 1]):
            down, right = d * stack.step[j, 0], d * stack.step[j, 1]
            if down * down + right * right > stack.max_shift * stack.max_shift or n_compared == stack.max_compared:
                continue
            n_compared += 1
            n, correlation, residual, slope_squares, residual_squares = _window(stack, start, work, m, j, (y, x), d)
            n_valid += n > 0
            if n == 0 or correlation <= _MIN_CORRELATION:
                continue
            n_agreeing += 1
            w = correlation - _MIN_CORRELATION
            gradient_sum += w * residual
            scatter += w * w * residual * residual
            stiffness += w * slope_squares
            residual_sum += w * residual_squares
            weight_sum += w * n
            slope_variance += w * w * slope_squares
            for k in range(n):
                slope_sums[work.slots[k]] += w * work.residuals[k]
        agreement = n_agreeing / max(n_valid, 1)
        if not stiffness > 0.0:
            break
        # A residual has the noise of two pixels. Gradients of views scatter by their errors beyond it, and opposite
        # views err alike.
        variance = max(residual_sum, 0.0) / weight_sum
        excess = 2.0 * max(scatter - variance * slope_variance, 0.0) if stack.coefficients is not None else 0.0
        # The noise of the window itself is common to all comparisons.
        for i in range(slope_sums.size):
            slope_variance += slope_sums[i] * slope_sums[i]
        error = math.sqrt(0.5 * variance * slope_variance + excess) / stiffness
        step = gradient_sum / stiffness
        d = min(max(d + step, swept - reach), swept + reach)
        if abs(step) < _SMALL_STEP * error:
            break
    # A disparity at the end of the search range is no solution.
    if abs(d - swept) >= reach:
        error = max(error, reach)
    return d, error, agreement


@kernel
def fill_subpixel(matches, start, stack, work, first):
    """Fill `matches` of the images from `first` on, near disparities `start` (n, rows, columns).

    Pixels of the stack's images follow each other row after row, in one axis.
    """
    count, rows, columns = start.shape
    for i in range(count):
        for j in range(stack.first[first + i], stack.first[first + i + 1]):
            k = j - stack.first[first + i]
            _fill_valid(
                work.valid[k], work.n_valid[k], work.valid_along, stack.mask[stack.other[j]], columns, work.own.shape[0]
            )
        for y in range(rows):
            for x in range(columns):
                if stack.mask[first + i, y * columns + x]:
                    matches.disparity[i, y, x], matches.standard_error[i, y, x], matches.confidence[i, y, x] = _refine(
                        stack, start[i], work, first + i, y, x
                    )
