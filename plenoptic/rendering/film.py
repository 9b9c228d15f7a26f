"""Film: sums that accumulate while an image is rendered."""

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
    """Samples of each replicate: as equal as possible, the first ones one more."""
    counts = np.full(replicates, samples // replicates, dtype=np.int64)
    counts[: samples % replicates] += 1
    return counts


OWN_ERRORS = 8
"""Replicates from which on the error of a pixel is its own; with fewer, what they say is pooled over blocks."""
_SHARED = 0.1
"""Of what is pooled over a block, the part that is the same for all of its pixels: even points save less in smooth
pixels than in others, which have more to save."""
_STRIP = 1 << 16
"""Pixels that are finished together, in float64: large images take no more memory for that than small ones."""
_LARGEST = float(np.finfo(np.float32).max)
_EPS = np.finfo(np.float64).eps


class Film:
    """Mean, squared deviations of replicates and of samples, and their count, of every pixel.

    A replicate is the mean of the samples of one scrambling of the points, so that replicates are independent
    and identically distributed while the samples x within one are not. With replicate means m_r of n_r samples
    each, n = sum n_r in all:

    - mean = sum n_r m_r / n
    - squares = sum n_r (m_r - mean)^2, with replicates - 1 degrees of freedom
    - scatter = sum (x - mean)^2
    - standard error = sqrt(squares / (replicates - 1) / n)

    With fewer than 8 replicates and known scatter, the squared standard error is that of independent samples,
    scatter / (n - 1) / n, with a tenth of its mean beside it, times the factor of even points: the sums of both go
    over the pixels of the same colour of a checkerboard in a block of 8 x 8, counted from the upper left pixel.

    Mean and the roots of squares and scatter are kept in float32, 12 bytes a pixel of each and three channels: numbers
    that leave the film are no finer, and sums of which more is to be made are kept elsewhere.

    Parameters
    ----------
    shape : (int, int, int)
        Rows, columns and channels.
    counts : (r,) array of int
        Samples of each replicate of a pixel, unless `add` says otherwise.

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
        used = frozen_array(counts, name="counts", shape=("replicates",), dtype=np.int64)
        self._counts = used[used > 0].astype(np.float64)
        self.samples = int(self._counts.sum())
        self.replicates = len(self._counts)
        self.sample_counts: NDArray[np.int32] | None = None
        """(rows, columns), once a tile was put in with its counts; None while pixels have `samples` or nothing."""
        self.processors: tuple[str, ...] = (processor(),)
        """Kinds of processors on which its parts were made: the bits are those of none where there are several."""
        self.mean: NDArray[np.float32] = np.zeros((rows, columns, channels), dtype=np.float32)
        self.between: NDArray[np.float32] | None = np.zeros_like(self.mean) if self.replicates >= 2 else None
        """The root of `squares`."""
        self.within: NDArray[np.float32] | None = None
        """The root of `scatter`, once a tile was put in with its powers."""

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
        """Put in the sums (rows, columns, replicates, channels) of a tile whose upper left pixel is given.

        Parameters
        ----------
        row, column : int
        sums : (rows, columns, replicates, channels) array
        powers : (rows, columns, channels) array, optional
            Sums of the squares of the samples.
        counts : (replicates,) array of int, optional
            Samples of each replicate of these pixels, where it is not that of all.
        where : (rows, columns) array of bool, optional
            Pixels that are put in; the others stay as they are.

        Returns
        -------
        Moments
            Of all pixels of the tile, whether they are put in or not.
        """
        height, width = sums.shape[:2]
        at = (slice(row, row + height), slice(column, column + width))
        chosen = ... if where is None else where
        used = self._counts if counts is None else np.asarray(counts, dtype=np.float64)
        found = moments(sums, used, powers)
        self.mean[at][chosen] = _kept(found.mean[chosen])
        if self.between is not None:
            self.between[at][chosen] = _kept(np.sqrt(found.squares[chosen]))
        if found.scatter is not None:
            if self.within is None:
                self.within = np.zeros_like(self.mean)
            self.within[at][chosen] = _kept(np.sqrt(found.scatter[chosen]))
        if counts is not None:
            if self.sample_counts is None:
                self.sample_counts = np.zeros(self.mean.shape[:2], dtype=np.int32)
            self.sample_counts[at][chosen] = int(used.sum())
        return found

    def _moments(self, rows: slice) -> Moments:
        """Moments of all pixels of some rows; needs two replicates or more."""
        assert self.between is not None
        mean, squares = self.mean[rows].astype(np.float64), np.square(self.between[rows], dtype=np.float64)
        scatter = None if self.within is None else np.square(self.within[rows], dtype=np.float64)
        samples: float | NDArray[np.int32] = np.float64(self.samples)
        if self.sample_counts is not None:
            samples = self.sample_counts[rows, :, None]
        return Moments(mean, squares, scatter, samples, self.replicates)

    def merged(self, other: Film) -> Film:
        """Both films as one, as if their independent replicates had been rendered together (other seeds).

        They may come from different kinds of processors, which `processors` then names.

        Raises
        ------
        InvalidValueError
            Where the shapes differ, or pixels of a film have different numbers of samples.
        """
        if self.mean.shape != other.mean.shape:
            raise InvalidValueError(f"films of shapes {self.mean.shape} and {other.mean.shape} cannot be merged")
        if self.sample_counts is not None or other.sample_counts is not None:
            raise InvalidValueError("films whose pixels have different numbers of samples cannot be merged")
        both = Film(self.mean.shape, counts=np.concatenate([self._counts, other._counts]).astype(np.int64))
        both.processors = tuple(dict.fromkeys(self.processors + other.processors))
        share = other.samples / both.samples
        step = other.mean.astype(np.float64) - self.mean
        both.mean = _kept(self.mean + share * step)
        apart = step * np.sqrt(self.samples * share)
        parts = [part for part in (self.between, other.between) if part is not None]
        both.between = _kept(_root_sum_squares(apart, *parts))
        if self.within is not None and other.within is not None:
            both.within = _kept(_root_sum_squares(apart, self.within, other.within))
        return both

    def agreeing(self) -> NDArray[np.bool_] | None:
        """(rows, columns): pixels whose replicates are all the same; None with fewer than two replicates."""
        if self.between is None:
            return None
        found = np.empty(self.mean.shape[:2], dtype=bool)
        for rows in self._strips():
            known = self._moments(rows)
            found[rows] = agree(known.mean, variance(known)).all(axis=-1)
        return found

    def _strips(self) -> Iterator[slice]:
        """Rows that are taken together: large images are finished piece by piece, without large temporary arrays."""
        height = max(_STRIP // self.mean.shape[1] // BLOCK, 1) * BLOCK
        for first in range(0, len(self.mean), height):
            yield slice(first, first + height)

    def standard_error(
        self, one_sample: AnyFloats | None = None, *, out: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32] | None:
        """Standard error of the mean, (rows, columns, channels) float32; None with fewer than two replicates.

        Where all replicates agree, it is the contribution of one sample (see `brought_by_one`), at most `one_sample`
        (rows, columns), over the number of samples: a single sample could have been another.

        `out` may be `between` itself, if the film is no longer needed.
        """
        if self.between is None:
            return None
        error = np.empty(self.mean.shape, dtype=np.float32) if out is None else out
        for rows in self._strips():
            known = self._moments(rows)
            found = spread(known, None if one_sample is None else brought_by_one(known, one_sample[rows]))
            error[rows] = np.where(np.isinf(found), found, np.minimum(found, _LARGEST))
        return error


def _kept(numbers: Floats) -> NDArray[np.float32]:
    """Convert to float32, clipped to its largest number."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.clip(numbers, -_LARGEST, _LARGEST).astype(np.float32)


def _root_sum_squares(*parts: AnyFloats) -> Floats:
    return np.asarray(np.sqrt(sum(np.square(part, dtype=np.float64) for part in parts)))


class Moments(NamedTuple):
    """Mean and sums of squared deviations of pixels (..., channels); see `Film`."""

    mean: Floats
    squares: Floats
    scatter: Floats | None
    """None where squares of samples are not known."""
    samples: float | NDArray[np.int32]
    """Of all pixels, or (..., 1) of each."""
    replicates: int
    """Of pixels that have as many samples."""

    @property
    def freedom(self) -> float | NDArray[np.int32]:
        """Degrees of freedom of `squares`; not above 0 where there are fewer than two samples."""
        return np.minimum(self.samples, self.replicates) - 1


def moments(sums: Floats, counts: Floats | NDArray[np.int64], powers: Floats | None = None) -> Moments:
    """Moments of sums (..., replicates, channels) and sums of squares (..., channels); see `Film.add`."""
    counts = counts[counts > 0]  # the first ones have most
    used, samples = sums[..., : counts.size, :], counts.sum()
    mean = used.sum(axis=-2) / samples
    deviation = used / counts[:, None] - mean[..., None, :]
    squares, scatter = np.einsum("...rc,...rc,r->...c", deviation, deviation, counts), None
    if powers is not None:
        with np.errstate(over="ignore", invalid="ignore"):
            scatter = powers - samples * mean * mean
            # Sums of n equal terms are off by n / 4 of a rounding error; what is below that agrees.
            scatter = np.where(scatter > (16 + samples) * _EPS * powers, scatter, 0.0)
    return Moments(mean, squares, scatter, np.float64(samples), counts.size)


def variance(known: Moments) -> Floats:
    """Squared standard error of pixels (rows, columns, channels); see `Film`. inf where there is no freedom."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        own = known.squares / (np.float64(1.0) * known.freedom * known.samples)
        own = np.where(np.asarray(known.freedom) > 0, own, np.inf)
        if known.scatter is None or known.replicates >= OWN_ERRORS:
            return own
        single = known.scatter / (np.float64(1.0) * (known.samples - 1) * known.samples)
        counted = np.isfinite(own) & np.isfinite(single)
        parts = np.where(counted, own, 0.0), np.where(counted, single, 0.0), counted & (single > 0)
        between, within, count = (block_sums(part.sum(axis=-1, dtype=np.float64)) for part in parts)
        alike = np.where(single > 0, (within / count)[..., None], 0.0)
        pooled = (single + _SHARED * alike) / (1.0 + _SHARED) * (between / within)[..., None]
        return np.where(counted & np.isfinite(pooled), pooled, own)


def in_whole_blocks(region: tuple[int, int, int, int], shape: tuple[int, int]) -> tuple[int, int, int, int]:
    """The first and end row and column of the blocks of a sensor that a region has a part of."""
    first_row, end_row, first_column, end_column = region
    ends = [min(-(-end // BLOCK) * BLOCK, most) for end, most in zip((end_row, end_column), shape, strict=True)]
    return first_row // BLOCK * BLOCK, ends[0], first_column // BLOCK * BLOCK, ends[1]


def block_sums(values: Floats) -> Floats:
    """Sum over each pixel's block of 8 x 8, of the pixels of its colour on a checkerboard (rows, columns)."""
    rows, columns = values.shape
    high, wide = -(-rows // BLOCK), -(-columns // BLOCK)
    padded = np.zeros((high * BLOCK, wide * BLOCK))
    padded[:rows, :columns] = values
    squares = padded.reshape(high, BLOCK // 2, 2, wide, BLOCK // 2, 2)
    four = squares.sum(axis=(1, 4))
    squares[:] = (four + four[:, ::-1, :, ::-1])[:, None, :, :, None, :]
    return padded[:rows, :columns]


def agree(mean: Floats, squared_error: Floats) -> NDArray[np.bool_]:
    """True where samples or their replicates agree to rounding."""
    return np.asarray(squared_error <= np.square(16 * _EPS * mean))


def brought_by_one(known: Moments, one_sample: AnyFloats) -> Floats:
    """Contribution of one bright sample (rows, columns), from the surroundings; at most `one_sample`.

    The mean of x weighed by light, E[x^2] / E[x], over samples x of the pixels of the same colour of a checkerboard in
    its block, where x is in units of their largest contribution. `one_sample` where all are dark.
    """
    light = brightness(known.mean)
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        each = known.squares / known.freedom if known.scatter is None else known.scatter / known.samples
        second = light * light + np.where(np.asarray(known.freedom) > 0, each, 0.0).mean(axis=-1)
        second = np.divide(second, one_sample, out=np.zeros_like(light), where=one_sample > 0)
        light, second = block_sums(light), block_sums(second)
        return np.asarray(one_sample * np.where(light > 0, np.fmin(second / light, 1.0), 1.0))


def spread(known: Moments, one_sample: AnyFloats | None) -> Floats:
    """Standard error of pixels (rows, columns, channels); see `Film.standard_error`. inf where there is no freedom."""
    squared = variance(known)
    if one_sample is None:
        return np.sqrt(squared)
    with np.errstate(divide="ignore", invalid="ignore"):
        floor = one_sample[..., None] / known.samples
    return np.where(agree(known.mean, squared), floor, np.sqrt(squared))
