"""Film: accumulation of samples while an image is rendered."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.camera.checks import BLOCK
from plenoptic.core.relative_error import brightness
from plenoptic.core.values import MAX_PIXELS, AnyFloats, Floats, checked_shape, frozen_array
from plenoptic.errors import InvalidValueError


def replicate_counts(samples: int, replicates: int) -> NDArray[np.int64]:
    """Number of samples of each replicate: equal, except that the first ones may have one more."""
    counts = np.full(replicates, samples // replicates, dtype=np.int64)
    counts[: samples % replicates] += 1
    return counts


OWN_ERRORS = 8
"""Number of replicates from which the standard error of a pixel is its own; with fewer, errors are pooled over blocks.
"""
_BLOCK_WEIGHT = 0.1
"""Weight of the block's mean in the pooled variance of independent samples: stratification reduces the variance less in
smooth pixels than in others.
"""
_STRIP = 1 << 16
"""Pixels that are finished together in float64, which bounds the memory for large images."""
_LARGEST = float(np.finfo(np.float32).max)
_EPS = np.finfo(np.float64).eps


class Film:
    """Mean, squared deviations of replicates and of samples, and sample count of every pixel.

    A replicate is the mean of the samples of one scrambling of the points. Replicates are independent and identically
    distributed, while the samples x within one are not. With replicate means m_r of n_r samples each, n = sum n_r in
    all:

    - mean = sum n_r m_r / n
    - squares = sum n_r (m_r - mean)^2, with replicates - 1 degrees of freedom
    - scatter = sum (x - mean)^2
    - standard error = sqrt(squares / (replicates - 1) / n)

    With fewer than 8 replicates and known scatter, the squared standard error is the variance of independent samples,
    scatter / (n - 1) / n, with a tenth of its block mean added, times the variance reduction by stratification. The
    reduction is the ratio of sums of both over the pixels of the same colour of a checkerboard in a block of 8 x 8,
    counted from the upper left pixel.

    Mean and the roots of squares and scatter are stored in float32, 12 bytes a pixel for each of three channels. The
    output has no higher precision, and sums that are still growing are stored elsewhere.

    Parameters
    ----------
    shape : (int, int, int)
        Rows, columns and channels.
    counts : (r,) array of int
        Samples of each replicate of a pixel, unless passed to `add`.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> film = pl.rendering.Film((1, 1, 1), counts=np.array([2, 2]))
    >>> moments = film.add(0, 0, np.array([[[[2.0], [6.0]]]]))      # sums of two replicates of two samples
    >>> film.mean[0, 0, 0], film.standard_error()[0, 0, 0]
    (np.float32(2.0), np.float32(1.0))
    """

    def __init__(self, shape: tuple[int, int, int], *, counts: ArrayLike) -> None:
        from plenoptic.core.numba.jit import processor

        rows, columns, channels = checked_shape(shape, ("rows", "columns", "channels"), at_most=3 * MAX_PIXELS)
        replicate_samples = frozen_array(counts, name="counts", shape=("replicates",), dtype=np.int64)
        self._counts = replicate_samples[replicate_samples > 0].astype(np.float64)
        self.samples = int(self._counts.sum())
        self.replicates = len(self._counts)
        self.sample_counts: NDArray[np.int32] | None = None
        """(rows, columns), after a tile was added with its counts; None while all pixels have `samples` or none."""
        self.processors: tuple[str, ...] = (processor(),)
        """Kinds of processors that rendered the parts. With several, the bits are those of no single kind."""
        self.mean: NDArray[np.float32] = np.zeros((rows, columns, channels), dtype=np.float32)
        self.between: NDArray[np.float32] | None = np.zeros_like(self.mean) if self.replicates >= 2 else None
        """Root of `squares`."""
        self.within: NDArray[np.float32] | None = None
        """Root of `scatter`, after a tile was added with its powers."""

    def add(
        self,
        row: int,
        column: int,
        sums: Floats,
        *,
        powers: Floats | None = None,
        counts: ArrayLike | None = None,
        where: NDArray[np.bool_] | None = None,
    ) -> Moments:
        """Add the sums (rows, columns, replicates, channels) of a tile at its upper left pixel.

        Parameters
        ----------
        row, column : int
        sums : (rows, columns, replicates, channels) array
        powers : (rows, columns, channels) array, optional
            Sums of the squares of the samples.
        counts : (replicates,) array of int, optional
            Samples of each replicate of these pixels, unless they are the film's.
        where : (rows, columns) array of bool, optional
            Mask of the pixels to be set; the others keep their values.

        Returns
        -------
        Moments
            Moments of all pixels of the tile, including masked ones.
        """
        height, width = sums.shape[:2]
        tile_slices = (slice(row, row + height), slice(column, column + width))
        selected = ... if where is None else where
        replicate_samples = self._counts if counts is None else np.asarray(counts, dtype=np.float64)
        tile_moments = moments(sums, replicate_samples, powers)
        self.mean[tile_slices][selected] = _as_float32(tile_moments.mean[selected])
        if self.between is not None:
            self.between[tile_slices][selected] = _as_float32(np.sqrt(tile_moments.squares[selected]))
        if tile_moments.scatter is not None:
            if self.within is None:
                self.within = np.zeros_like(self.mean)
            self.within[tile_slices][selected] = _as_float32(np.sqrt(tile_moments.scatter[selected]))
        if counts is not None:
            if self.sample_counts is None:
                self.sample_counts = np.zeros(self.mean.shape[:2], dtype=np.int32)
            self.sample_counts[tile_slices][selected] = int(replicate_samples.sum())
        return tile_moments

    def _moments(self, rows: slice) -> Moments:
        """Moments of the pixels of some rows; requires two replicates or more."""
        assert self.between is not None
        mean, squares = self.mean[rows].astype(np.float64), np.square(self.between[rows], dtype=np.float64)
        scatter = None if self.within is None else np.square(self.within[rows], dtype=np.float64)
        samples: float | NDArray[np.int32] = np.float64(self.samples)
        if self.sample_counts is not None:
            samples = self.sample_counts[rows, :, None]
        return Moments(mean, squares, scatter, samples, self.replicates)

    def merged(self, other: Film) -> Film:
        """Merge two films of different seeds, as if their independent replicates had been rendered together.

        They may come from different kinds of processors; `processors` lists them.

        Raises
        ------
        InvalidValueError
            If the shapes differ, or pixels of a film have different numbers of samples.
        """
        if self.mean.shape != other.mean.shape:
            raise InvalidValueError(f"films of shapes {self.mean.shape} and {other.mean.shape} cannot be merged")
        if self.sample_counts is not None or other.sample_counts is not None:
            raise InvalidValueError("films whose pixels have different numbers of samples cannot be merged")
        film = Film(self.mean.shape, counts=np.concatenate([self._counts, other._counts]).astype(np.int64))
        film.processors = tuple(dict.fromkeys(self.processors + other.processors))
        fraction = other.samples / film.samples
        step = other.mean.astype(np.float64) - self.mean
        film.mean = _as_float32(self.mean + fraction * step)
        weighted_step = step * np.sqrt(self.samples * fraction)
        deviations = [deviation for deviation in (self.between, other.between) if deviation is not None]
        film.between = _as_float32(_root_sum_squares(weighted_step, *deviations))
        if self.within is not None and other.within is not None:
            film.within = _as_float32(_root_sum_squares(weighted_step, self.within, other.within))
        return film

    def agreeing(self) -> NDArray[np.bool_] | None:
        """Mask (rows, columns) of pixels whose replicates are all equal; None with fewer than two replicates."""
        if self.between is None:
            return None
        mask = np.empty(self.mean.shape[:2], dtype=bool)
        for rows in self._strips():
            pixels = self._moments(rows)
            mask[rows] = agree(pixels.mean, variance(pixels)).all(axis=-1)
        return mask

    def _strips(self) -> Iterator[slice]:
        """Slices of rows that are finished together, without large temporary arrays."""
        height = max(_STRIP // self.mean.shape[1] // BLOCK, 1) * BLOCK
        for first in range(0, len(self.mean), height):
            yield slice(first, first + height)

    def standard_error(
        self, one_sample: AnyFloats | None = None, *, deflected: bool = False, out: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32] | None:
        """Standard error of the mean, (rows, columns, channels) float32; None with fewer than two replicates.

        Where all replicates agree, it is the contribution of one lit sample (see `lit_sample_contribution`), at most
        `one_sample` (rows, columns), over the number of samples: a single other sample could change the mean by that.
        With `deflected`, half the square of the contribution of one deflection (see `deflection_contribution`) is added
        to the variance, half a path as in Jeffreys' prior of rates: in dark pixels few deflections bring light.

        `out` may be `between` itself if the film is no longer needed.
        """
        if self.between is None:
            return None
        error = np.empty(self.mean.shape, dtype=np.float32) if out is None else out
        for rows in self._strips():
            pixels = self._moments(rows)
            contribution = None
            if one_sample is not None:
                of_pixels = deflection_contribution if deflected else lit_sample_contribution
                contribution = of_pixels(pixels, one_sample[rows])
            errors = error_of_mean(pixels, contribution, deflected=deflected)
            error[rows] = np.where(np.isinf(errors), errors, np.minimum(errors, _LARGEST))
        return error


def _as_float32(numbers: Floats) -> NDArray[np.float32]:
    """Convert to float32, clipped to its finite range."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.clip(numbers, -_LARGEST, _LARGEST).astype(np.float32)


def _root_sum_squares(*parts: AnyFloats) -> Floats:
    return np.asarray(np.sqrt(sum(np.square(part, dtype=np.float64) for part in parts)))


class Moments(NamedTuple):
    """Mean and sums of squared deviations of pixels (..., channels); see `Film`."""

    mean: Floats
    squares: Floats
    scatter: Floats | None
    """None without sums of squares of the samples."""
    samples: float | NDArray[np.int32]
    """Number of samples: one for all pixels, or (..., 1) of each."""
    replicates: int
    """Number of replicates of a pixel with all samples."""

    @property
    def freedom(self) -> float | NDArray[np.int32]:
        """Degrees of freedom of `squares`; not positive with fewer than two samples."""
        return np.minimum(self.samples, self.replicates) - 1


def moments(sums: Floats, counts: Floats | NDArray[np.int64], powers: Floats | None = None) -> Moments:
    """Moments from sums (..., replicates, channels) and sums of squares (..., channels); see `Film.add`."""
    counts = counts[counts > 0]  # the first replicates have the most samples
    nonempty_sums, samples = sums[..., : counts.size, :], counts.sum()
    mean = nonempty_sums.sum(axis=-2) / samples
    deviation = nonempty_sums / counts[:, None] - mean[..., None, :]
    squares, scatter = np.einsum("...rc,...rc,r->...c", deviation, deviation, counts), None
    if powers is not None:
        with np.errstate(over="ignore", invalid="ignore"):
            scatter = powers - samples * mean * mean
            # Sums of n equal terms are off by n / 4 rounding errors; scatter below that counts as 0.
            scatter = np.where(scatter > (16 + samples) * _EPS * powers, scatter, 0.0)
    return Moments(mean, squares, scatter, np.float64(samples), counts.size)


def variance(pixels: Moments, *, deflected: bool = False) -> Floats:
    """Squared standard error of pixels (rows, columns, channels); see `Film`. inf without degrees of freedom.

    With `deflected`, pixels above and below the mean brightness of a block are also pooled apart, and the larger
    variance is taken: stratification reduces that of light from near and far in different ways.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        between_replicates = pixels.squares / (np.float64(1.0) * pixels.freedom * pixels.samples)
        between_replicates = np.where(np.asarray(pixels.freedom) > 0, between_replicates, np.inf)
        if pixels.scatter is None or pixels.replicates >= OWN_ERRORS:
            return between_replicates
        independent = pixels.scatter / (np.float64(1.0) * (pixels.samples - 1) * pixels.samples)
        finite = np.isfinite(between_replicates) & np.isfinite(independent)
        sums = np.where(finite, between_replicates, 0.0), np.where(finite, independent, 0.0), finite & (independent > 0)
        planes = [plane.sum(axis=-1, dtype=np.float64) for plane in sums]
        between, within, count = map(block_sums, planes)
        block_mean, reduction = np.where(independent > 0, (within / count)[..., None], 0.0), between / within
        if deflected:
            light = brightness(pixels.mean)
            bright = light > block_sums(light) / block_sums(np.ones(light.shape))
            ratios = [block_sums(planes[0] * part) / block_sums(planes[1] * part) for part in (bright, ~bright)]
            reduction = np.fmax(reduction, np.where(bright, *ratios))
        pooled = (independent + _BLOCK_WEIGHT * block_mean) / (1.0 + _BLOCK_WEIGHT) * reduction[..., None]
        return np.where(finite & np.isfinite(pooled), pooled, between_replicates)


def pools_errors(replicates: int, *, deflected: bool) -> bool:
    """True if the standard error of a pixel is estimated from its block."""
    return replicates >= 2 and (deflected or replicates < OWN_ERRORS)


def in_whole_blocks(region: tuple[int, int, int, int], shape: tuple[int, int]) -> tuple[int, int, int, int]:
    """Extend a region to the whole blocks of the sensor that it overlaps: first and end row and column."""
    first_row, end_row, first_column, end_column = region
    ends = [min(-(-end // BLOCK) * BLOCK, limit) for end, limit in zip((end_row, end_column), shape, strict=True)]
    return first_row // BLOCK * BLOCK, ends[0], first_column // BLOCK * BLOCK, ends[1]


def block_sums(values: Floats) -> Floats:
    """Sum at each pixel (rows, columns) over the pixels of its checkerboard colour in its block of 8 x 8."""
    rows, columns = values.shape
    high, wide = -(-rows // BLOCK), -(-columns // BLOCK)
    padded = np.zeros((high * BLOCK, wide * BLOCK))
    padded[:rows, :columns] = values
    squares = padded.reshape(high, BLOCK // 2, 2, wide, BLOCK // 2, 2)
    two_by_two = squares.sum(axis=(1, 4))
    squares[:] = (two_by_two + two_by_two[:, ::-1, :, ::-1])[:, None, :, :, None, :]
    return padded[:rows, :columns]


def agree(mean: Floats, squared_error: Floats) -> NDArray[np.bool_]:
    """True where samples or their replicates differ by no more than rounding."""
    return np.asarray(squared_error <= np.square(16 * _EPS * mean))


def lit_sample_contribution(pixels: Moments, one_sample: AnyFloats) -> Floats:
    """Mean contribution (rows, columns) of a sample that carries light, estimated from the block; at most `one_sample`.

    It is the mean of x weighted by light, E[x^2] / E[x], over samples x of the pixels of the same colour of a
    checkerboard in the block, with x relative to their `one_sample`. It is `one_sample` if all are dark.
    """
    light = brightness(pixels.mean)
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        sample_variance = pixels.squares / pixels.freedom if pixels.scatter is None else pixels.scatter / pixels.samples
        second_moment = light * light + np.where(np.asarray(pixels.freedom) > 0, sample_variance, 0.0).mean(axis=-1)
        second_moment = np.divide(second_moment, one_sample, out=np.zeros_like(light), where=one_sample > 0)
        light, second_moment = block_sums(light), block_sums(second_moment)
        return np.asarray(one_sample * np.where(light > 0, np.fmin(second_moment / light, 1.0), 1.0))


def deflection_contribution(pixels: Moments, one_sample: AnyFloats) -> Floats:
    """Mean contribution (rows, columns) of a deflection that brings light, from the block; at most `one_sample`.

    It is the mean over the lit pixels of the same colour of a checkerboard in the block of the index of dispersion of
    their samples, variance over mean: for rare light the contribution of one path. It is `one_sample` if all are dark.
    """
    light = brightness(pixels.mean)
    lit = light > 0
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        sample_variance = pixels.squares / pixels.freedom if pixels.scatter is None else pixels.scatter / pixels.samples
        dispersion = np.where(lit & np.isfinite(light), sample_variance.mean(axis=-1) / light, 0.0)
        mean_dispersion = block_sums(dispersion) / block_sums(lit.astype(np.float64))
        return np.asarray(np.fmin(mean_dispersion, one_sample))


def error_of_mean(pixels: Moments, one_sample: AnyFloats | None, *, deflected: bool = False) -> Floats:
    """Standard error of pixels (rows, columns, channels); see `Film.standard_error`. inf without degrees of freedom."""
    squared = variance(pixels, deflected=deflected)
    if one_sample is None:
        return np.sqrt(squared)
    with np.errstate(divide="ignore", invalid="ignore"):
        floor = one_sample[..., None] / pixels.samples
    if deflected:
        return np.sqrt(squared + 0.5 * floor**2)
    return np.where(agree(pixels.mean, squared), floor, np.sqrt(squared))
