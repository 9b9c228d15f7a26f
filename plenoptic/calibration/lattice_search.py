"""Steps of a lattice of micro images, from the autocorrelation of an image."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.optics.microlens.lattice import Lattice

_PATCH = 768
"""Most rows and columns of the central part of the image that is compared with itself."""
_MIN_PEAK, _MIN_CORRELATION = 0.6, 0.05
"""Least height of a peak over the highest, and least correlation of the highest. Between the gaps of round micro images
that touch there are peaks of half the height."""
_MIN_SINE = 0.3
"""Sine of the angle between two steps of a lattice, above which they are different directions."""
_REACH = 0.45
"""Largest displacement over the size of the part."""
_EQUAL, _ANGLE = 0.01, 3.0
"""Relative difference of the pitches, and of angles in degrees, up to which a lattice is that of its kind."""

NO_LATTICE = "the image shows no lattice of micro images: "


def lattice_steps(plane: Floats) -> Floats:
    """Two shortest steps (2, 2) by which the centre of an image (H, W) repeats."""
    shape = np.minimum(plane.shape, _PATCH)
    first = (np.array(plane.shape) - shape) // 2
    patch = plane[first[0] : first[0] + shape[0], first[1] : first[1] + shape[1]]
    correlation = _autocorrelation(patch)
    middle, reach = np.array(correlation.shape) // 2, (_REACH * shape).astype(int)
    (top, left), (bottom, right) = middle - reach, middle + reach + 1
    correlation = correlation[top:bottom, left:right]
    peaks, heights = _peaks(correlation)
    steps = peaks - reach
    if not len(heights) or not heights.max() > _MIN_CORRELATION:
        raise InvalidValueError(f"{NO_LATTICE}it repeats nowhere; give a white image with at least some 5 x 5 of them")
    clear = heights > _MIN_PEAK * heights.max()
    steps, heights = steps[clear], heights[clear]
    order = np.argsort(np.hypot(*steps.T))
    steps, heights = steps[order], heights[order]
    basis = _shortest(steps)
    length = np.hypot(*basis.T).max()
    while length < 2.0 * np.hypot(*reach):
        orders = steps @ np.linalg.inv(basis)
        near = (np.abs(orders - np.rint(orders)).max(axis=1) < 0.2) & (np.hypot(*steps.T) < 2.0 * length)
        basis = np.linalg.lstsq(np.rint(orders[near]), steps[near], rcond=None)[0]
        length *= 2.0
    return basis


def _autocorrelation(patch: Floats) -> Floats:
    """Correlation with itself, of displacement 0 in the middle, by means over the pixels that overlap."""
    size = [2 * n for n in patch.shape]
    power = np.abs(np.fft.rfft2(patch - patch.mean(), size)) ** 2
    correlation = np.fft.fftshift(np.fft.irfft2(power, size) / power.mean())
    rows, columns = (np.maximum(1.0 - np.abs(np.arange(-n, n) / n), 0.5 / n) for n in patch.shape)
    return np.asarray(correlation / np.outer(rows, columns))


def _peaks(image: Floats) -> tuple[Floats, Floats]:
    """Positions (n, 2) of local maxima of 3 x 3 means, by parabolas, and their heights; without that in the middle."""
    for axis in (0, 1):
        image = (np.roll(image, 1, axis) + image + np.roll(image, -1, axis)) / 3.0
    middle = image[2:-2, 2:-2]
    rows, columns = image.shape
    neighbours = [image[2 + i : i + rows - 2, 2 + j : j + columns - 2] for i in (-1, 0, 1) for j in (-1, 0, 1)]
    is_peak = middle >= np.max(neighbours, axis=0)
    is_peak[middle.shape[0] // 2, middle.shape[1] // 2] = False
    row, column = np.nonzero(is_peak)
    centre = middle[row, column]
    position = np.stack([row, column], axis=1).astype(np.float64) + 2.0
    for axis, (low, high) in enumerate(((1, 7), (3, 5))):
        before, after = neighbours[low][row, column], neighbours[high][row, column]
        bend = np.maximum(2.0 * centre - before - after, 1e-12)
        position[:, axis] += np.clip(0.5 * (after - before) / bend, -0.5, 0.5)
    return position, centre


def _shortest(steps: Floats) -> Floats:
    """The shortest of steps (n, 2), sorted by length, and the shortest one in another direction."""
    first = steps[0]
    lengths = np.hypot(*first) * np.hypot(*steps.T)
    sine = np.abs(first[0] * steps[:, 1] - first[1] * steps[:, 0]) / np.maximum(lengths, 1e-9)
    if not (sine > _MIN_SINE).any():
        raise InvalidValueError(f"{NO_LATTICE}it repeats along one direction only; give a white image")
    return np.array([first, steps[np.argmax(sine > _MIN_SINE)]])


def lattice_of(basis: Floats) -> tuple[Lattice, Floats]:
    """Kind of the lattice with steps (2, 2), and its steps as `MicroImageGrid` has them.

    The first step points to smaller columns, the second to larger rows; one of the two steps of a hexagonal lattice,
    the one that does so better.
    """
    a, b = basis
    b = b - np.rint(a @ b / (a @ a)) * a
    angle = math.degrees(math.acos(min(1.0, abs(a @ b) / (np.hypot(*a) * np.hypot(*b)))))
    third = a - np.sign(a @ b) * b
    lengths = np.array([np.hypot(*step) for step in (a, b, third)])
    if angle < 75.0:
        if abs(angle - 60.0) > _ANGLE or np.ptp(lengths) > 3.0 * _EQUAL * lengths.mean():
            raise InvalidValueError(
                f"{NO_LATTICE}it repeats by steps of {lengths[0]:.4g} and {lengths[1]:.4g} pixels at {angle:.3g} "
                "degrees; lattices are hexagonal, square or rectangular"
            )
        return Lattice.HEXAGONAL, _sort_steps([a, b, third], hexagonal=True)
    if abs(angle - 90.0) > _ANGLE:
        raise InvalidValueError(f"{NO_LATTICE}it repeats by steps at {angle:.3g} degrees, neither 60 nor 90")
    is_square = abs(lengths[1] - lengths[0]) < _EQUAL * lengths[0]
    return (Lattice.SQUARE if is_square else Lattice.RECTANGULAR), _sort_steps([a, b], hexagonal=False)


def _sort_steps(steps: list[Floats], *, hexagonal: bool) -> Floats:
    both = np.array([sign * step for step in steps for sign in (1.0, -1.0)])
    k = both[both[:, 1].argmin()]
    l = both[both[:, 0].argmax() if hexagonal else np.argmax(_cross(k, both))]
    if hexagonal:
        along_rows = -k[1] / np.hypot(*k) >= l[0] / np.hypot(*l)
        fixed = k if along_rows else l
        # The neighbour 60 degrees from it, towards the other axis.
        other = both[np.argmax(both @ fixed - 1e6 * (_cross(k, both) <= 0 if along_rows else _cross(both, l) <= 0))]
        k, l = (fixed, other) if along_rows else (other, fixed)
    return np.array([k, l])


def _cross(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
