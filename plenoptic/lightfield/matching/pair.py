"""Matching of pairs of images by dual pixels, sharp or strongly blurred."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np

from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.matching.image_stack import Matches
from plenoptic.optics.sensor.dual_pixel_sensor import wells_of
from plenoptic.readout.well_images import WellImages, after_crosstalk
from plenoptic.truth.pair_geometry import PairGeometry, pair_geometry

DEFAULT_RANGE, DEFAULT_RADIUS = (-10.0, 10.0), 8
_STEP, _GROWTH = 0.25, 0.05
"""Distance of the disparities that are compared in pixels, and over the disparity where that is more."""
_WIDENING = 0.6
"""Root mean square width of a disc by the disparity of its halves, 3 pi / 16. Where it is more, as by a table of halves
that share light, distances are less by as much: a step of the blur would bend the parabola."""
_DAMPING = 0.05
"""Added in quadrature to the norm of both transfer functions: waves that neither half shows count less."""
_BAND = 0.3
"""Frequencies that are compared, in cycles per pixel: pixels alias finer detail into those near 1/2, which moves by
other disparities."""
_TILE = 64
"""Least distance of the places on the sensor in pixels whose half discs are computed."""


def match_pair(images: WellImages, disparities: tuple[float, float], radius: int) -> tuple[Matches, Floats]:
    """Disparities and depths (H, W) of a pair, see `depth`.

    A point out of focus is a half disc in the left image and the other half in the right one. With k_L and k_R, the
    half discs of a disparity, the left image blurred by k_R equals the right one blurred by k_L. Their difference, over
    the root of |k_L|^2 + |k_R|^2 at each frequency, has the noise of the images at all disparities, so that its squares
    compare them without a preference for blur. Its least sum over a window, by a parabola, is the match; its value and
    curvature there give the standard error. Sums of squares by the half discs of several places on the sensor are
    interpolated linearly between these.
    """
    geometry, region, (rows, columns) = pair_geometry(images.camera), images.exposures[0].region, images.left.shape[:2]
    region = (0, rows, 0, columns) if region is None else region
    vignetting = geometry.asymmetry(region=region)
    lit = np.abs(vignetting) < 1.0
    vignetting = np.where(lit, vignetting, 0.0)
    left, right = images.left.mean(axis=-1) / (1.0 + vignetting), images.right.mean(axis=-1) / (1.0 - vignetting)
    widening = float(np.std((geometry.blur(1.0) - geometry.blur(0.0))[:, 0]))
    planes = _planes(*disparities, min(1.0, _WIDENING / widening))
    tiles = list(_tiles(geometry, region))
    reach = np.max([np.abs(geometry.blur(planes, node=node)).max(axis=(1, 2)) for node, *_ in tiles], axis=0)
    border = math.ceil(reach.max()) + 2
    if min(left.shape) <= 2 * radius + 1 or border >= min(left.shape):
        raise InvalidValueError(
            f"the images have {left.shape[0]} x {left.shape[1]} pixels; windows of {2 * radius + 1} and blur of "
            f"{border} need more: give a smaller window_radius or disparity_range"
        )
    padded = np.pad([left, right], ((0, 0), (border, border), (border, border)), "reflect")
    cost, noise = np.zeros((len(planes), *left.shape)), np.zeros((2, len(planes)))
    for node, rows, columns, weights in tiles:
        part = padded[:, rows.start : rows.stop + 2 * border, columns.start : columns.stop + 2 * border]
        costs, tile_noise = _costs(part, planes, geometry, node)
        cost[:, rows, columns] += weights * costs[:, border:-border, border:-border]
        noise += weights.sum() / left.size * tile_noise
    cost = np.stack([_window_sums(each, radius) for each in cost])
    matches = _minimise(cost, planes, (2 * radius + 1) ** 2 * noise)
    row, column = (np.minimum(np.arange(n), np.arange(n)[::-1]) for n in left.shape)
    margin = radius + np.interp(matches.disparity, planes, reach)
    inside = (np.minimum(row[:, None], column) >= margin) & (_window_sums(np.where(lit, 0.0, 1.0), radius) == 0)
    matches = Matches(*(np.where(inside, plane, np.nan) for plane in matches))
    return matches, geometry.depth(matches.disparity, region=region)


def _planes(low: float, high: float, fineness: float) -> Floats:
    """Disparities to compare, from beyond one end of the range to beyond the other."""
    planes = [low - _STEP]
    while planes[-1] < high + _STEP:
        planes.append(planes[-1] + fineness * max(_STEP, _GROWTH * abs(planes[-1])))
    return np.array(planes)


def _tiles(
    geometry: PairGeometry, region: tuple[int, int, int, int]
) -> Iterator[tuple[tuple[int, int], slice, slice, Floats]]:
    """Nodes of the geometry, rows and columns of a region in which their blur counts, and their weights there.

    Weights (rows, columns) are those of linear interpolation between nodes at least _TILE pixels apart. In place of a
    node where a half is dark its nearest neighbour counts.
    """
    lit = [node for node in np.ndindex(geometry.pupils.shape[:2]) if np.isfinite(geometry.blur(0.0, node=node)).all()]
    axes, intervals = [], geometry.pupils.shape[0] - 1
    for ends, side in zip((region[:2], region[2:]), geometry.camera.sensor.shape, strict=True):
        step = next((step for step in (1, 2, 3, 4) if step * side >= _TILE * intervals), 6)
        at = (np.arange(*ends) + 0.5) / side * intervals
        axes.append([(k, np.maximum(1.0 - np.abs(at - k) / step, 0.0)) for k in range(0, intervals + 1, step)])
    for (row, by_row), (column, by_column) in itertools.product(*axes):
        if by_row.any() and by_column.any():
            rows, columns = (slice(*(hat.nonzero()[0][[0, -1]] + [0, 1])) for hat in (by_row, by_column))
            _, node = min((math.dist(node, (row, column)), node) for node in lit)
            yield node, rows, columns, np.outer(by_row[rows], by_column[columns])


def _costs(pair: Floats, planes: Floats, geometry: PairGeometry, node: tuple[int, int]) -> tuple[Floats, Floats]:
    """Squared differences (planes, H, W) of the images of a pair (2, H, W), each blurred as the other is.

    They are divided by their expected value for white noise of variance 1, so that noise prefers no disparity. Also
    returns, by planes, that value and the expected product of it and of the squared derivative of the noise.
    """
    shape = pair.shape[1], pair.shape[2]
    left, right = np.fft.rfft2(pair)
    costs, noise = np.empty((len(planes), *shape)), np.zeros((2, len(planes)))
    columns = np.fft.rfftfreq(shape[1])
    band = np.hypot(np.fft.fftfreq(shape[0])[:, None], columns) <= _BAND
    fraction = np.where(columns > 0, 2.0, 1.0) / (shape[0] * shape[1])  # of a frequency and its negative
    previous = 3 * (np.zeros(band.shape),)
    for k, (disparity, images) in enumerate(zip(planes, _point_images(geometry, planes, node, shape), strict=True)):
        by_left, by_right = np.fft.rfft2(images)
        power = np.abs(by_left) ** 2 + np.abs(by_right) ** 2
        gain = band / np.sqrt(power + _DAMPING**2)
        noise[0, k] = np.sum(power * gain**2 * fraction)
        turn = np.abs(previous[0] * by_right - previous[1] * by_left) * previous[2] * gain / (disparity - planes[k - 1])
        noise[1, k] = np.sum(turn**2 * fraction)
        costs[k] = np.fft.irfft2((left * by_right - right * by_left) * gain, shape) ** 2 / noise[0, k]
        previous = by_left, by_right, gain
    return costs, noise


def _point_images(
    geometry: PairGeometry, planes: Floats, node: tuple[int, int], shape: tuple[int, int]
) -> Iterator[Floats]:
    """Images (2, H, W) of a point at the first pixel, by disparities; continued periodically, after crosstalk.

    Their sums are 1.
    """
    sensor = geometry.camera.sensor
    pixels = wells_of(sensor)
    # The division by vignetting weighs the pixels that a point reaches unevenly.
    row, column = (
        min(max(round(at * n / (nodes - 1)), 1), n - 1)
        for at, nodes, n in zip(node, geometry.pupils.shape, sensor.shape, strict=False)
    )
    before, behind = geometry.asymmetry(region=(row, row + 1, column - 1, column + 1))[0]
    slopes = (behind - before) / np.array([2.0 + before + behind, before + behind - 2.0]) * 2.0
    vignetting = 1.0 - slopes[:, None, None] * np.fft.fftfreq(shape[1], 1.0 / shape[1])
    for offsets in geometry.blur(planes, node=node):
        halves = _blur(offsets, geometry.pupils[node][:, 4:].T, shape)
        # Upper and lower wells of quads are taken to see the same.
        wells = np.broadcast_to(halves[None, ..., None], (pixels.split[0], *halves.shape, 1))
        images = after_crosstalk(wells, pixels.crosstalk, "wrap").reshape(wells.shape[:-1]).sum(axis=0) * vignetting
        yield images / images.sum(axis=(1, 2), keepdims=True)


def _blur(offsets: Floats, weights: Floats, shape: tuple[int, int]) -> Floats:
    """Images (2, H, W) of a point at the first pixel through both halves: the sums of their rays."""
    corner = np.floor(offsets).astype(np.int64)
    steps = np.arange(-1, 3)
    by_column, by_row = _cubic(np.abs((offsets - corner)[..., None] - steps)).swapaxes(0, 1)
    columns, rows = (corner[..., None] + steps).swapaxes(0, 1)
    pixels = (rows % shape[0] * shape[1])[:, :, None] + (columns % shape[1])[:, None, :]
    parts = by_row[:, :, None] * by_column[:, None, :]
    values, size = (weights[:, :, None, None] * parts).reshape(2, -1), shape[0] * shape[1]
    return np.array([np.bincount(pixels.ravel(), half, size) for half in values], dtype=float).reshape(2, *shape)


def _cubic(distance: Floats) -> Floats:
    """Cubic convolution, of third order (R. G. Keys, IEEE Trans. ASSP 29, 1153 (1981), doi:10.1109/TASSP.1981.1163711).

    For distances from 0 to 2.
    """
    near = (1.5 * distance - 2.5) * distance**2 + 1.0
    far = ((-0.5 * distance + 2.5) * distance - 4.0) * distance + 2.0
    return np.where(distance < 1.0, near, far)


def _window_sums(values: Floats, radius: int) -> Floats:
    """Sums over the windows of an image, which is mirrored at its border."""
    width, sums = 2 * radius + 1, np.pad(values, radius, "reflect")
    for _ in range(2):
        sums = np.cumsum(np.pad(sums, ((1, 0), (0, 0))), axis=0)
        sums = (sums[width:] - sums[:-width]).T
    return sums


def _minimise(cost: Floats, planes: Floats, noise: Floats) -> Matches:
    """Disparities of least cost (planes, H, W), sums over windows, with standard errors and confidences.

    `noise` (2, planes) are sums over a window, see `_costs`.
    """
    k = np.clip(cost.argmin(axis=0), 1, len(planes) - 2)
    before, minimum, behind = (np.take_along_axis(cost, (k + step)[None], axis=0)[0] for step in (-1, 0, 1))
    # From here on the expected cost of noise is subtracted: the division would bend the parabola.
    before, behind = (
        minimum + (value - minimum) * noise[0, k + step] / noise[0, k] for value, step in ((before, -1), (behind, 1))
    )
    down, up = planes[k] - planes[k - 1], planes[k + 1] - planes[k]
    with np.errstate(divide="ignore", invalid="ignore"):
        falling, rising = (minimum - before) / down, (behind - minimum) / up
        curvature = 2.0 * (rising - falling) / (down + up)
        slope = (falling * up + rising * down) / (down + up)
        shift = np.clip(-slope / curvature, -down, up)
        lowest = np.maximum(minimum + 0.5 * slope * shift, 0.0)
        # The sum S of squares of n waves has the curvature 2 / variance at its least, in units of the variance S / n.
        # Noise also moves the minimum by the product of itself and its derivative.
        variance = 2.0 * lowest / ((noise[0, k] - 1.0) * curvature)
        error = np.sqrt(variance * (1.0 + noise[1, k] * variance))
        confidence = np.clip(1.0 - lowest / np.median(cost, axis=0), 0.0, 1.0)
    is_minimum = (curvature > 0) & (minimum <= before) & (minimum <= behind)
    return Matches(*(np.where(is_minimum, plane, np.nan) for plane in (planes[k] + shift, error, confidence)))
