"""Film: what accumulates while an image is rendered."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.errors import InvalidValueError


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
        Samples of each replicate of a pixel.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> film = pl.Film((1, 1, 1), counts=np.array([2, 2]))
    >>> film.add(0, 0, np.array([[[[2.0], [6.0]]]]))      # sums of two replicates of two samples
    >>> film.mean[0, 0, 0], film.standard_error()[0, 0, 0]
    (np.float64(2.0), np.float32(1.0))
    """

    def __init__(self, shape: tuple[int, int, int], *, counts: NDArray[np.int64]) -> None:
        used = np.asarray(counts)
        self._counts = used[used > 0].astype(np.float64)
        self.samples = int(self._counts.sum())
        self.replicates = len(self._counts)
        self.mean: NDArray[np.float64] = np.zeros(shape)
        self.squares: NDArray[np.float64] | None = np.zeros(shape) if self.replicates >= 2 else None
        self._freedom = self.replicates - 1

    def add(self, row: int, column: int, sums: NDArray[np.float64]) -> None:
        """Put in the sums (rows, columns, replicates, channels) of a tile whose upper left pixel is given."""
        height, width = sums.shape[:2]
        at = (slice(row, row + height), slice(column, column + width))
        mean = sums[:, :, : self.replicates].sum(axis=2) / self.samples
        self.mean[at] = mean
        if self.squares is not None:
            deviation = sums[:, :, : self.replicates] / self._counts[:, None] - mean[:, :, None]
            self.squares[at] = np.einsum("hwrc,hwrc,r->hwc", deviation, deviation, self._counts)

    def merged(self, other: Film) -> Film:
        """Both films as one, as if their independent replicates had been rendered together (other seeds).

        Raises
        ------
        InvalidValueError
            Where the shapes differ.
        """
        if self.mean.shape != other.mean.shape:
            raise InvalidValueError(f"films of shapes {self.mean.shape} and {other.mean.shape} cannot be merged")
        both = Film(self.mean.shape, counts=np.concatenate([self._counts, other._counts]).astype(np.int64))
        share = other.samples / both.samples
        step = other.mean - self.mean
        both.mean = self.mean + share * step
        none = np.zeros_like(step)
        within = (none if self.squares is None else self.squares) + (none if other.squares is None else other.squares)
        both.squares = within + step * step * (self.samples * share)
        return both

    def image(self) -> NDArray[np.float32]:
        """The mean, (rows, columns, channels) float32."""
        return self.mean.astype(np.float32)

    def standard_error(self) -> NDArray[np.float32] | None:
        """Standard error of the mean, (rows, columns, channels) float32; None with fewer than two replicates."""
        if self.squares is None:
            return None
        return np.sqrt(self.squares / (self._freedom * self.samples)).astype(np.float32)
