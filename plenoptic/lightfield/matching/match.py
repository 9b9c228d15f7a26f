"""Steps of matching a stack of images: plane sweep, semi-global matching and refinement between the planes."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.parallel import run_in_order
from plenoptic.core.values import Floats, check_kind
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.matching.image_stack import ImageStack, Matches, flat, max_neighbours

Matcher: TypeAlias = Callable[[ImageStack, int, int], Matches]
"""Matches the images first to end - 1 of a stack; returns arrays (end - first, rows, columns)."""


class Workspace(NamedTuple):
    """Work arrays for the comparison of two images, whose pixels stand row after row."""

    bounds: NDArray[np.int64]
    """First and end row, first and end column of the masks of the image and of those it is compared with."""
    normalisation: NDArray[np.float32]
    """Mean of the image that is matched, and a scale."""
    mask: NDArray[np.float32]
    values: NDArray[np.float32]
    along: NDArray[np.float32]
    shifted: NDArray[np.float32]
    shifted_mask: NDArray[np.float32]
    products: NDArray[np.float32]
    column_sums: NDArray[np.float32]
    sums: NDArray[np.float32]
    score: NDArray[np.float32]
    best: NDArray[np.float32]
    """(half, pixels): the best scores of each pixel, in falling order."""
    n_known: NDArray[np.float32]


class WindowArrays(NamedTuple):
    """Work arrays for the comparison of windows of w x w pixels, in rows of w + 3."""

    own: NDArray[np.uint8]
    """(w, w): 1 for pixels of the surface of the central one."""
    slots: NDArray[np.uint64]
    """Places in rows of w + 3 of the pixels that are valid in both images."""
    places: NDArray[np.uint64]
    """Places of these pixels in rows of the image."""
    patch: NDArray[np.float32]
    """Values of the other image, a pixel before the window to two pixels behind it."""
    along: NDArray[np.float32]
    """The patch between pixels of its rows, and its derivative."""
    by_column: NDArray[np.float32]
    values: NDArray[np.float32]
    """The other image between pixels, and its derivative by disparity."""
    slopes: NDArray[np.float32]
    residuals: Floats
    """Slopes minus their mean, of the slots; and their weighted sums over images."""
    slope_sums: Floats
    moved: Floats
    """(images, 2): displacement of a point's images from the pinhole model, rows and columns."""
    valid: NDArray[np.uint8]
    """(images, pixels): 1 between four valid pixels."""
    n_valid: NDArray[np.uint16]
    """(images, pixels): number of these in the window that begins at a pixel, or more at the ends of rows."""
    valid_along: NDArray[np.uint16]
    """Numbers of these in w pixels of a row."""


def match_images(stack: ImageStack, first: int, end: int) -> Matches:
    """Match the images first to end - 1 of a stack with their neighbours: the default matcher of `depth`."""
    cost = plane_sweep(stack, first, end)
    disparity = semi_global(cost, stack.disparities)
    return refine(stack, disparity, first)


def plane_sweep(stack: ImageStack, first: int, end: int) -> NDArray[np.float32]:
    """Cost of the planes of a stack in its images first to end - 1: (end - first, rows, columns, planes).

    The cost is 1 - correlation, from 0 to 2: mean of the better half of the normalised correlations with other images,
    the best of all windows that contain the pixel. See `depth`.
    """
    from plenoptic.lightfield.kernels.plane_sweep import fill_costs

    check_kind(stack, "stack", ImageStack, "that of the matcher's call")
    (count, rows, columns), planes = stack.values.shape, len(stack.disparities)
    size, half = rows * columns, (stack.max_compared + 1) // 2
    padded = size + 2 * stack.window_radius * (columns + 1)
    shapes = 2, size, size, size + 3, size, size, (6, padded), padded, (6, size), size, (half, size), size
    bounds = np.empty((1 + max_neighbours(stack), 4), np.int64)
    work = Workspace(bounds, *(np.empty(shape, np.float32) for shape in shapes))
    images = (stack.values if stack.blurred is None else stack.blurred).reshape(count, -1, size)
    cost = np.empty((end - first, size, planes), np.float32)
    fill_costs(cost, stack, work, images, stack.mask.reshape(count, size), first)
    return cost.reshape(end - first, rows, columns, planes)


def semi_global(cost: NDArray[np.float32], disparities: Floats) -> Floats:
    """Disparity of least cost (n, rows, columns), interpolated between planes, made smooth by semi-global matching.

    `cost` is (n, rows, columns, planes), of planes of given disparities. Paths along four directions penalise
    differences between neighbouring pixels. See `depth`.
    """
    from plenoptic.lightfield.kernels.semi_global import fill_best_disparities

    if np.ndim(cost) != 4:
        raise InvalidValueError(
            f"cost has {np.ndim(cost)} axes; it must be (n, rows, columns, planes) of `plane_sweep`"
        )
    disparity, path_costs = np.empty(cost.shape[:3]), np.empty((2, cost.shape[3]), np.float32)
    fill_best_disparities(disparity, cost, disparities, np.empty(cost.shape[1:], np.float32), path_costs)
    return disparity


def refine(stack: ImageStack, disparity: Floats, first: int) -> Matches:
    """Refine disparities (n, rows, columns) of the images from `first` on by least squares over their windows.

    Window pixels of another depth do not count. nan outside the mask of the stack. See `depth`.
    """
    from plenoptic.lightfield.kernels.subpixel import fill_subpixel

    check_kind(stack, "stack", ImageStack, "that of the matcher's call")
    if np.ndim(disparity) != 3:
        raise InvalidValueError(f"disparity has {np.ndim(disparity)} axes; it must be (n, rows, columns)")
    matches = Matches(*(np.full(disparity.shape, np.nan) for _ in Matches._fields))
    work = _window_arrays(stack)
    fill_subpixel(matches, disparity, flat(stack), work, first)
    systematic = stack.shift_error / float(np.hypot(*stack.step.T).max(initial=1e-9))
    return matches._replace(standard_error=np.hypot(stack.error_ratio * matches.standard_error, systematic))


def _window_arrays(stack: ImageStack) -> WindowArrays:
    (_, rows, columns), width, images = stack.values.shape, 2 * stack.window_radius + 1, max_neighbours(stack)
    side, padded = width + 3, rows * columns + width * (columns + 1)
    return WindowArrays(
        own=np.zeros((width, width), np.uint8),
        slots=np.zeros(width * width + 1, np.uint64),
        places=np.zeros(width * width + 1, np.uint64),
        patch=np.zeros((side + 1) * side, np.float32),
        along=np.zeros(side * side, np.float32),
        by_column=np.zeros(side * side, np.float32),
        values=np.zeros(width * side, np.float32),
        slopes=np.zeros(width * side, np.float32),
        residuals=np.zeros(width * side),
        slope_sums=np.zeros(width * side),
        moved=np.zeros((images, 2)),
        valid=np.zeros((images, padded), np.uint8),
        n_valid=np.zeros((images, padded), np.uint16),
        valid_along=np.zeros(padded, np.uint16),
    )


def match_stack(stack: ImageStack, matcher: Matcher, threads: int) -> Matches:
    """Match all images of a stack by a matcher, in blocks that are distributed over threads."""
    count, (rows, columns) = len(stack.first) - 1, stack.values.shape[1:]
    block = max(1, 1 << 14 >> (rows * columns).bit_length())

    def match_block(first: int) -> Matches:
        end = min(first + block, count)
        matches = Matches(*matcher(stack, first, end))
        for name, plane in zip(Matches._fields, matches, strict=True):
            if np.shape(plane) != (end - first, rows, columns):
                raise InvalidValueError(
                    f"the matcher returns {name} of shape {np.shape(plane)}; it must be {(end - first, rows, columns)}"
                )
        return matches

    blocks = run_in_order(match_block, range(0, count, block), threads=threads)
    return Matches(*(np.concatenate(planes) for planes in zip(*blocks, strict=True)))
