"""What the kernels of matching need, as numbers, and their threads."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.parallel import run_in_order
from plenoptic.core.values import Floats

_LEAST_NOISE = 1e-3
"""Standard deviation over the mean radiance below which differences do not count as texture."""


class Images(NamedTuple):
    """Pictures of one size, (k, rows, columns)."""

    values: NDArray[np.float32]
    known: NDArray[np.uint8]
    """1 where a pixel belongs to the picture. Around them, values go on for two pixels."""
    floor: Floats
    """(k,): variance up to which differences are no texture."""
    shift: Floats | None = None
    """(k, rows, columns, 2, 2): how far beside where they should pixels show points, in rows and columns: what 1 and
    disparity / pitch multiply; nan where it is not known. None: not at all."""
    blurred: NDArray[np.float32] | None = None
    """(k, levels, rows, columns): the pictures blurred by Gaussian functions of variances in steps of `Sweep.level`;
    None where all are equally blurred."""
    bent: Floats | None = None
    """(k,): 1 - b / f of their microlenses: less disparity / pitch, the size of a point's image over the opening."""


class Pairs(NamedTuple):
    """Which are compared: picture m with `other[j]` of the rows j from first[m] to first[m + 1], nearest first."""

    first: NDArray[np.int64]
    other: NDArray[np.int64]
    base: Floats
    """(n, 2): a point p is seen at p + base - disparity step there, row and column."""
    step: Floats


class Sweep(NamedTuple):
    """How they are compared."""

    disparities: Floats
    """Of the planes, in order."""
    radius: int
    """Of windows, in pixels."""
    compared: int
    """Pictures with which one is compared at most on each plane: the nearest."""
    farthest: float
    """Pixels by which pictures are moved at most."""
    reach: float
    least_reach: float
    """How far the refinement goes from a plane, as a part of the disparity and in pixels."""
    pitch: float = 1.0
    """Of microlenses over that of pixels."""
    opening: float = 0.0
    """Variance of places in the opening of a microlens along one axis, pixel^2."""
    level: float = 1.0
    """Variance from one level of blur to the next, pixel^2."""


class Workspace(NamedTuple):
    """Room for one thread."""

    moved: NDArray[np.float32]
    there: NDArray[np.uint8]
    sums: Floats
    scores: NDArray[np.float32]
    cost: NDArray[np.float32]
    total: NDArray[np.float32]
    before: NDArray[np.float32]
    now: NDArray[np.float32]
    start: Floats
    slopes: Floats
    common: Floats


def plane_sweep(images: Images, pairs: Pairs, sweep: Sweep, threads: int) -> tuple[Floats, Floats, Floats]:
    """Disparity, its standard error by independent residuals, and the share of pictures that show it, each (k, n, n).

    Of as many pictures as `pairs` lists; nan where a pixel is not known, inf the error where nothing was matched.
    """
    from plenoptic.lightfield.kernels.plane_sweep import fill_disparities

    count = len(pairs.first) - 1
    _, rows, columns = images.values.shape
    disparity, error, share = (np.full((count, rows, columns), np.nan) for _ in range(3))
    planes, window = len(sweep.disparities), (2 * sweep.radius + 1) ** 2

    def work(first: int) -> None:
        room = Workspace(
            np.empty((rows, columns), np.float32),
            np.empty((rows, columns), np.uint8),
            np.empty((6, rows + 1, columns)),
            np.empty((sweep.compared, rows, columns), np.float32),
            np.empty((rows, columns, planes), np.float32),
            np.empty((rows, columns, planes), np.float32),
            np.empty(planes, np.float32),
            np.empty(planes, np.float32),
            np.empty((rows, columns)),
            np.empty(window),
            np.empty(window),
        )
        end = min(first + together, count)
        fill_disparities(disparity, error, share, images, pairs, sweep, room, (first, end))

    together = max(1, 1 << 14 >> (rows * columns).bit_length())
    for _ in run_in_order(work, range(0, count, together), threads=threads):
        pass
    return disparity, error, share


def texture_floor(values: Floats, variance: Floats, known: NDArray[np.bool_]) -> Floats:
    """(k,): variance up to which differences within pictures (k, rows, columns) are no texture: that of their noise."""
    count = np.maximum(known.sum(axis=(1, 2)), 1)
    mean, noise = (np.where(known, part, 0.0).sum(axis=(1, 2)) / count for part in (values, variance))
    return np.asarray(np.maximum(np.maximum(noise, (_LEAST_NOISE * mean) ** 2), 1e-30))


def extrapolate_border(values: Floats, known: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Values (k, rows, columns) that go on for two pixels around what is known, as means of neighbours; then 0."""
    found, there = np.where(known, values, 0.0), known.copy()
    for _ in range(2):
        total, count = np.zeros_like(found), np.zeros(found.shape)
        for down in (-1, 0, 1):
            for right in (-1, 0, 1):
                moved = np.roll(np.where(there, found, 0.0), (down, right), axis=(1, 2))
                total, count = total + moved, count + np.roll(there, (down, right), axis=(1, 2))
        new = ~there & (count > 0)
        found, there = np.where(new, total / np.maximum(count, 1), found), there | new
    return found.astype(np.float32)


def blurred(values: Floats, known: NDArray[np.bool_], variances: Floats) -> NDArray[np.float32]:
    """Pictures (k, rows, columns) blurred by Gaussian functions, over what is known: (k, variances, rows, columns)."""
    found = []
    for variance in variances.tolist():
        reach = math.ceil(3.0 * math.sqrt(variance))
        offsets = range(-reach, reach + 1)
        weights = np.exp(-0.5 * np.square(offsets) / max(variance, 1e-9))
        total, share = np.where(known, values, 0.0), known.astype(np.float64)
        for axis in (1, 2):
            total, share = (
                np.sum([w * np.roll(part, k, axis=axis) for w, k in zip(weights, offsets, strict=True)], axis=0)
                for part in (total, share)
            )
        found.append(extrapolate_border(total / np.maximum(share, 1e-9), known))
    return np.stack(found, axis=1)
