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
def _image_displacement(stack, m, j, pixel, d):
    """Displacement of a point's image relative to the pinhole model: rows, columns, and their derivatives by d."""
    (y, x), other, per_pitch = pixel, stack.other[j], d / stack.pitch
    row, column = y + stack.base[j, 0] - d * stack.step[j, 0], x + stack.base[j, 1] - d * stack.step[j, 1]
    central, values = stack.residual_displacement[m, y, x], stack.residual_displacement[other]
    more_down, more_right, by_down, by_right = 0.0, 0.0, 0.0, 0.0
    # The displacement is that at the displaced position.
    for _ in range(_ITERATIONS):
        down, right = row + more_down, column + more_right
        r, c = math.floor(down + 0.5), math.floor(right + 0.5)
        if not (0 <= r < stack.values.shape[1] and 0 <= c < stack.values.shape[2]):
            return math.nan, math.nan, math.nan, math.nan
        down, right = down - r, right - c
        by_down = _between(values, r, c, down, right, 1, 0) - central[1, 0]
        by_right = _between(values, r, c, down, right, 1, 1) - central[1, 1]
        more_down = _between(values, r, c, down, right, 0, 0) - central[0, 0] + per_pitch * by_down
        more_right = _between(values, r, c, down, right, 0, 1) - central[0, 1] + per_pitch * by_right
        if math.isnan(more_down):
            break
    return more_down, more_right, by_down / stack.pitch, by_right / stack.pitch


@device
def _model_disparity(stack, m, pixel, d):
    """Disparity of the pinhole model of a pixel whose images lie where those of disparity d do without displacement."""
    along, length, n_compared = 0.0, 0.0, 0
    for j in range(stack.first[m], stack.first[m + 1]):
        down, right = stack.step[j, 0], stack.step[j, 1]
        squares = down * down + right * right
        if d * d * squares > stack.max_shift * stack.max_shift or n_compared == stack.max_compared:
            continue
        n_compared += 1
        more_down, more_right, _, _ = _image_displacement(stack, m, j, pixel, d)
        if not math.isnan(more_down):
            along += more_down * down + more_right * right
            length += squares
    return d + along / length if length > 0.0 else d


@device
def _between(displacement, r, c, down, right, i, k):
    """A coefficient between pixels, linear in rows and columns; that of the nearest pixel where others have none."""
    rows, columns = displacement.shape[:2]
    value, step_down, step_right = displacement[r, c, i, k], 0.0, 0.0
    if down != 0.0 and 0 <= r + (1 if down > 0.0 else -1) < rows:
        step_down = abs(down) * (displacement[r + (1 if down > 0.0 else -1), c, i, k] - value)
    if right != 0.0 and 0 <= c + (1 if right > 0.0 else -1) < columns:
        step_right = abs(right) * (displacement[r, c + (1 if right > 0.0 else -1), i, k] - value)
    return value + (step_down if step_down == step_down else 0.0) + (step_right if step_right == step_right else 0.0)


@device
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]


@device
def _to_float32(weights):
    return np.float32(weights[0]), np.float32(weights[1]), np.float32(weights[2]), np.float32(weights[3])


@device
def _fill_along(along, values, first_row, first_column, weights, derivatives):
    """Interpolate along the rows of an image: values and derivatives (2, rows, columns) from a pixel on."""
    (a, b, c, d), (e, f, g, h) = weights, derivatives
    for i in range(max(0, -first_row), min(along.shape[1], values.shape[0] - first_row)):
        for k in range(max(0, 1 - first_column), min(along.shape[2], values.shape[1] - 2 - first_column)):
            row, column = first_row + i, first_column + k
            left, middle = values[row, column - 1], values[row, column]
            right, last = values[row, column + 1], values[row, column + 2]
            along[0, i, k] = a * left + b * middle + c * right + d * last
            along[1, i, k] = e * left + f * middle + g * right + h * last


@device
def _window(stack, start, work, m, j, pixel, d):
    """Comparison of a window with another image: (count, correlation, sum of residual slope, slope^2, residual^2).

    Gain and offset of the other image are fitted. `slopes` gets the slopes minus their mean; nan for invalid pixels.
    """
    (slopes, along), radius = work, stack.window_radius
    rows, columns = stack.values.shape[1], stack.values.shape[2]
    (y, x), other = pixel, stack.other[j]
    sy, sx = stack.step[j, 0], stack.step[j, 1]
    down, right = stack.base[j, 0] - d * sy, stack.base[j, 1] - d * sx
    if stack.residual_displacement is not None:
        more_down, more_right, by_down, by_right = _image_displacement(stack, m, j, pixel, d)
        if math.isnan(more_down):
            return 0.0, 0.0, 0.0, 0.0, 0.0
        down, right, sy, sx = down + more_down, right + more_right, sy - by_down, sx - by_right
    top, left = math.floor(down), math.floor(right)
    window_values, values, other_mask = stack.values[m], stack.values[other], stack.mask[other]
    if stack.coefficients is not None:
        values = stack.coefficients[other]
        (a0, a1, a2, a3), (e0, e1, e2, e3) = spline_weights(down - top)
        weights, derivatives = spline_weights(right - left)
        noise_products = spline_noise
    else:
        (a0, a1, a2, a3), (e0, e1, e2, e3) = cubic_weights(down - top)
        weights, derivatives = cubic_weights(right - left)
        noise_products = _dot
    top, left = int(top), int(left)
    # Covariance of the interpolated noise with that of the slope.
    covariance = -stack.noise_variance[other] * (
        sy * noise_products(weights, weights) * noise_products((a0, a1, a2, a3), (e0, e1, e2, e3))
        + sx * noise_products((a0, a1, a2, a3), (a0, a1, a2, a3)) * noise_products(weights, derivatives)
    )
    n, p, q, s, pp, qq, pq, ps, qs, ss = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if stack.blurred is not None:
        level, other_level = blur_levels(stack, m, other, d)
        window_values, values = stack.blurred[m, level], stack.blurred[other, other_level]
        if other_level > 0:
            covariance = 0.0  # blurred noise is as smooth halfway between pixels
    (a0, a1, a2, a3), (e0, e1, e2, e3) = _to_float32((a0, a1, a2, a3)), _to_float32((e0, e1, e2, e3))
    place = y - radius + top - 1, x - radius + left
    _fill_along(along, values, place[0], place[1], _to_float32(weights), _to_float32(derivatives))
    sy, sx = np.float32(sy), np.float32(sx)
    tolerance, noise, slot = _SAME_SURFACE * _reach(stack, start[y, x]), stack.noise_variance[m], 0
    for yy in range(y - radius, y + radius + 1):
        for xx in range(x - radius, x + radius + 1):
            slopes[0, slot] = math.nan
            slot += 1
            r, c = yy + top, xx + left
            if not (1 <= r < rows - 2 and 1 <= c < columns - 2 and 0 <= yy < rows and 0 <= xx < columns):
                continue
            valid = other_mask[r, c] & other_mask[r, c + 1] & other_mask[r + 1, c] & other_mask[r + 1, c + 1]
            if not (stack.mask[m, yy, xx] & valid and abs(start[yy, xx] - start[y, x]) <= tolerance):
                continue
            i, k = yy - y + radius, xx - x + radius
            b0, b1, b2, b3 = along[0, i, k], along[0, i + 1, k], along[0, i + 2, k], along[0, i + 3, k]
            v, vy = a0 * b0 + a1 * b1 + a2 * b2 + a3 * b3, e0 * b0 + e1 * b1 + e2 * b2 + e3 * b3
            vx = a0 * along[1, i, k] + a1 * along[1, i + 1, k] + a2 * along[1, i + 2, k] + a3 * along[1, i + 3, k]
            value, slope, v = float(window_values[yy, xx]), -float(sy * vy + sx * vx), float(v)
            slopes[0, slot - 1], slopes[1, slot - 1] = slope, v
            n += 1.0
            p += value
            q += v
            s += slope
            pp += value * value
            qq += v * v
            pq += value * v
            ps += value * slope
            qs += v * slope
            ss += slope * slope
    if n < _MIN_VALID * slot:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    pp, qq, pq = pp - p * p / n, qq - q * q / n, pq - p * q / n
    ps, qs, ss = ps - p * s / n, qs - q * s / n, ss - s * s / n
    correlation = pq / math.sqrt((pp + n * noise) * (qq + n * stack.noise_variance[other]))
    gain = pq / qq if qq > 0.0 and pq > 0.0 else 0.0
    # A change of gain that has the same effect as a shift leaves no information on the shift.
    common = qs / qq if qq > 0.0 else 0.0
    for i in range(slot):
        slopes[0, i] = gain * (slopes[0, i] - s / n - common * (slopes[1, i] - q / n))
    # Interpolation blurs noise most halfway between pixels, which attracts the fit: its share is taken off.
    gradient = gain * (ps - gain * (qs - n * covariance))
    stiffness = gain * gain * max(ss - common * qs, 0.0)
    return n, correlation, gradient, stiffness, pp - 2.0 * gain * pq + gain * gain * qq


@device
def _refine(stack, start, work, m, y, x):
    """Disparity of least residuals near the best plane, its standard error, and the fraction of agreeing images."""
    slopes, error, agreement = work[0], math.inf, 0.0
    slope_sums = slopes[2]
    swept, reach = start[y, x], _reach(stack, start[y, x])
    if stack.residual_displacement is not None:
        swept = _model_disparity(stack, m, (y, x), swept)
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
            n_valid += n > 0.0
            if n == 0.0 or correlation <= _MIN_CORRELATION:
                continue
            n_agreeing += 1
            w = correlation - _MIN_CORRELATION
            gradient_sum += w * residual
            scatter += w * w * residual * residual
            stiffness += w * slope_squares
            residual_sum += w * residual_squares
            weight_sum += w * n
            slope_variance += w * w * slope_squares
            for i in range(slope_sums.size):
                if slopes[0, i] == slopes[0, i]:
                    slope_sums[i] += w * slopes[0, i]
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
    """Fill `matches` of the images from `first` on, near disparities `start` (images, rows, columns).

    `work` are arrays (3, w w) and (2, w + 3, w) for windows of w x w pixels.
    """
    images, rows, columns = start.shape
    for i in range(images):
        for y in range(rows):
            for x in range(columns):
                if stack.mask[first + i, y, x]:
                    matches.disparity[i, y, x], matches.standard_error[i, y, x], matches.confidence[i, y, x] = _refine(
                        stack, start[i], work, first + i, y, x
                    )
