"""Film: what accumulates while an image is rendered."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.relative_error import brightness, diagonal_sums
from plenoptic.core.values import MOST_PIXELS, AnyFloats, Floats, checked_shape, frozen_array
from plenoptic.errors import InvalidValueError


def replicate_counts(samples: int, replicates: int) -> NDArray[np.int64]:
    """How many samples each replicate gets: as equal as can be, the first ones one more."""
    counts = np.full(replicates, samples // replicates, dtype=np.int64)
    counts[: samples % replicates] += 1
    return counts


_STRIP = 256
_REACH = 2
"""Rows and columns from which it is known what one sample brings."""
_LARGEST = float(np.finfo(np.float32).max)
_ROUNDING = 16 * np.finfo(np.float64).eps


class Film:
    """Mean, sum of squared deviations and count of the replicates of every pixel.

    A replicate is the mean of the samples of one scrambling of the points, so that replicates are independent
    and identically distributed while the samples within one are not. With replicate means m_r of n_r samples
    each, n = sum n_r in all:

    - mean = sum n_r m_r / n
    - squares = sum n_r (m_r - mean)^2, with replicates - 1 degrees of freedom
    - standard error = sqrt(squares / (replicates - 1) / n)

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
    >>> mean, squares = film.add(0, 0, np.array([[[[2.0], [6.0]]]]))      # sums of two replicates of two samples
    >>> film.mean[0, 0, 0], film.standard_error()[0, 0, 0]
    (np.float64(2.0), np.float32(1.0))
    """

    def __init__(self, shape: tuple[int, int, int], *, counts: ArrayLike) -> None:
        from plenoptic.core.jit import processor

        rows, columns, channels = checked_shape(shape, ("rows", "columns", "channels"), at_most=3 * MOST_PIXELS)
        used = frozen_array(counts, name="counts", shape=("replicates",), dtype=np.int64)
        self._counts = used[used > 0].astype(np.float64)
        self.samples = int(self._counts.sum())
        self.replicates = len(self._counts)
        self.sample_counts: NDArray[np.int32] | None = None
        """(rows, columns), once a tile was put in with its counts; None while pixels have `samples` or nothing."""
        self.processors: tuple[str, ...] = (processor(),)
        """Kinds of processors on which its parts were made: the bits are those of none where there are several."""
        self.mean: Floats = np.zeros((rows, columns, channels))
        self.squares: Floats | None = np.zeros((rows, columns, channels)) if self.replicates >= 2 else None

    def add(
        self,
        row: int,
        column: int,
        sums: Floats,
        *,
        counts: ArrayLike | None = None,
        where: NDArray[np.bool_] | None = None,
    ) -> tuple[Floats, Floats]:
        """Put in the sums (rows, columns, replicates, channels) of a tile whose upper left pixel is given.

        Parameters
        ----------
        row, column : int
        sums : (rows, columns, replicates, channels) array
        counts : (replicates,) array of int, optional
            Samples of each replicate of these pixels, where it is not that of all.
        where : (rows, columns) array of bool, optional
            Pixels that are put in; the others stay as they are.

        Returns
        -------
        mean, squares : (rows, columns, channels) array
            Of all pixels of the tile, whether they are put in or not.
        """
        height, width = sums.shape[:2]
        at = (slice(row, row + height), slice(column, column + width))
        chosen = ... if where is None else where
        used = self._counts if counts is None else np.asarray(counts, dtype=np.float64)
        mean, squares = moments(sums, used)
        self.mean[at][chosen] = mean[chosen]
        if self.squares is not None:
            self.squares[at][chosen] = squares[chosen]
        if counts is not None:
            if self.sample_counts is None:
                self.sample_counts = np.zeros(self.mean.shape[:2], dtype=np.int32)
            self.sample_counts[at][chosen] = int(used.sum())
        return mean, squares

    def _divided(self, rows: slice) -> tuple[float | NDArray[np.int32], float | NDArray[np.int32]]:
        """Samples and degrees of freedom, of all pixels or (rows, columns, 1) of each."""
        if self.sample_counts is None:
            return np.float64(self.samples), np.float64(self.replicates - 1)
        each = self.sample_counts[rows, :, None]
        return each, np.minimum(each, self.replicates) - 1

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
        step = other.mean - self.mean
        both.mean = self.mean + share * step
        none = np.zeros_like(step)
        within = (none if self.squares is None else self.squares) + (none if other.squares is None else other.squares)
        both.squares = within + step * step * (self.samples * share)
        return both

    def agreeing(self) -> NDArray[np.bool_] | None:
        """(rows, columns): pixels whose replicates are all the same; None with fewer than two replicates."""
        if self.squares is None:
            return None
        found = np.empty(self.mean.shape[:2], dtype=bool)
        for rows in self._strips():
            found[rows] = agree(self.mean[rows], self.squares[rows], self._divided(rows)[0]).all(axis=-1)
        return found

    def _strips(self) -> Iterator[slice]:
        """Rows that are taken together: large images are finished piece by piece, without large temporary arrays."""
        for first in range(0, len(self.mean), _STRIP):
            yield slice(first, first + _STRIP)

    def image(self) -> NDArray[np.float32]:
        """The mean, (rows, columns, channels) float32, at most the largest of these numbers."""
        image = np.empty(self.mean.shape, dtype=np.float32)
        for rows in self._strips():
            image[rows] = np.clip(self.mean[rows], -_LARGEST, _LARGEST)
        return image

    def standard_error(self, one_sample: AnyFloats | None = None) -> NDArray[np.float32] | None:
        """Standard error of the mean, (rows, columns, channels) float32; None with fewer than two replicates.

        Where all replicates agree, it is what one sample brings (see `brought_by_one`), at most `one_sample` (rows,
        columns), over the number of samples: a single sample could have been another.
        """
        if self.squares is None:
            return None
        error = np.empty(self.mean.shape, dtype=np.float32)
        for rows in self._strips():
            most = None
            if one_sample is not None:
                wide = slice(max(rows.start - _REACH, 0), rows.stop + _REACH)
                brought = brought_by_one(self.mean[wide], self.squares[wide], *self._divided(wide), one_sample[wide])
                most = brought[rows.start - wide.start :][: len(error[rows])]
            found = spread(self.mean[rows], self.squares[rows], *self._divided(rows), most)
            error[rows] = np.where(np.isinf(found), found, np.minimum(found, _LARGEST))
        return error


def moments(sums: Floats, counts: Floats | NDArray[np.int64]) -> tuple[Floats, Floats]:
    """Mean and sum of squared deviations, (..., channels), of sums (..., replicates, channels); see `Film`."""
    counts = counts[counts > 0]  # the first ones have most
    used = sums[..., : counts.size, :]
    mean = used.sum(axis=-2) / counts.sum()
    deviation = used / counts[:, None] - mean[..., None, :]
    return mean, np.einsum("...rc,...rc,r->...c", deviation, deviation, counts)


def agree(mean: Floats, squares: Floats, samples: float | NDArray[np.int32]) -> NDArray[np.bool_]:
    """Where replicates differ by no more than rounding."""
    return np.asarray(squares <= samples * np.square(_ROUNDING * mean))


def brought_by_one(
    mean: Floats,
    squares: Floats,
    samples: float | NDArray[np.int32],
    freedom: float | NDArray[np.int32],
    one_sample: AnyFloats,
) -> Floats:
    """What one sample that brings light brings (rows, columns): as around, and at most `one_sample`.

    The mean of x weighed by light, E[x^2] / E[x], over samples x of the pixels of the same colour of a checkerboard
    that are up to two away, where x is in units of what their samples bring at most. `one_sample` where all are dark.
    """
    light = brightness(mean)
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        second = light * light + np.where(np.asarray(freedom) > 0, squares / freedom, 0.0).mean(axis=-1)
        second = np.divide(second, one_sample, out=np.zeros_like(light), where=one_sample > 0)
        for _ in range(2):
            light, second = light + diagonal_sums(light), second + diagonal_sums(second)
        return np.asarray(one_sample * np.where(light > 0, np.fmin(second / light, 1.0), 1.0))


def spread(
    mean: Floats,
    squares: Floats,
    samples: float | NDArray[np.int32],
    freedom: float | NDArray[np.int32],
    one_sample: AnyFloats | None,
) -> Floats:
    """Standard error of pixels (..., channels); see `Film.standard_error`. inf where there is no freedom."""
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.sqrt(squares / (np.float64(1.0) * freedom * samples))
        if one_sample is not None:
            floor = np.broadcast_to(one_sample[..., None] / samples, error.shape)
            error = np.where(agree(mean, squares, samples), floor, error)
    return np.where(np.asarray(freedom) > 0, error, np.inf)
