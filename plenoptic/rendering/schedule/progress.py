"""State of a render: its film, its tiles, and the pixels that go on."""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.relative_error import (
    brightness,
    expected_brightness,
    is_dominated_by_few,
    is_threshold_robust,
    lit_threshold,
    relative_error,
    relative_squares,
)
from plenoptic.core.values import Floats
from plenoptic.rendering.film import Film, Moments, replicate_counts, spread
from plenoptic.rendering.schedule.budget import MAX_SAMPLES, Budget
from plenoptic.rendering.stats import NAMED
from plenoptic.rendering.tile import Tile, TileResult


class FilmRegion(NamedTuple):
    """Position of a film on the sensor, and the unit of its numbers."""

    row: int
    column: int
    """Of the upper left pixel on the sensor."""
    fill_factor: float
    """The part of a pixel that sees light: sums are of radiance on that part."""
    radiance: float
    """About the brightest of the scene."""
    asked: tuple[slice, slice] = (slice(None), slice(None))
    """Of the film, what was asked for: errors are pooled over blocks, and those at its rim are rendered too."""


class Progress:
    """All that a render has found until now.

    The pixels of a tile are coloured like a checkerboard. Whether the pixels of one colour go on is decided by the
    standard errors of those of the other colour, which are independent of them: a pixel does not stop because it
    happened to see little, and its expectation is that of a fixed number of samples. Where nothing of the other colour
    is lit, they do not go on. The samples that a colour gets after it has stopped, because the other colour goes on and
    is to be decided upon, do not count in its image.

    Each colour is decided upon at numbers of samples of its own, which are predicted from the errors of the other.

    Lit pixels are found anew before each round of decisions: for one colour, from the samples of its pixels when the
    other one was last decided upon, so that this too is independent of decisions. Where the error of all of a
    colour rests on few pixels, light is rare, no tile knows whether it has met it, and the other colour goes on.
    """

    def __init__(
        self,
        tiles: list[Tile],
        shape: tuple[int, int, int],
        budget: Budget,
        region: FilmRegion,
        truth: dict[str, NDArray[Any]],
        codes: int,
        *,
        counted: bool,
        begin: tuple[float, float],
    ) -> None:
        """`counted`: whether pixels may have different numbers of samples; `begin`: on the clock, in processor time."""
        self.tiles, self.budget, self.region, self.truth = tiles, budget, region, truth
        replicates = budget.replicates
        self.film = Film(shape, counts=replicate_counts(budget.max_samples, replicates))
        if self.film.between is not None:
            self.film.within = np.zeros(shape, dtype=np.float32)
        if counted:
            self.film.sample_counts = np.zeros(shape[:2], dtype=np.int32)
        self.one_sample = None if self.film.between is None else np.zeros(shape[:2], dtype=np.float32)
        """What one sample brings, at most; None without standard errors."""
        self.counts = np.zeros(codes, dtype=np.int64)
        self.done = np.zeros(len(tiles), dtype=np.int64)
        """Samples of each tile."""
        self.goal = np.full((len(tiles), 2), budget.following(0), dtype=np.int64)
        """Number of samples at which it is decided whether each colour of a tile goes on."""
        self.open = np.ones((len(tiles), 2), dtype=bool)
        """Whether the pixels of each colour of a tile go on."""
        self.found = np.zeros((len(tiles), 2, 2))
        """Samples at which a colour was last decided upon, and the error of the other colour then."""
        self.seen = None if budget.target_error is None else np.zeros((2, *shape[:2]))
        """Brightness and squared standard error of pixels, while the other colour of their tile goes on."""
        self.capped = False
        """Whether some pixels ended with all their samples."""
        self.nonfinite_paths: list[tuple[int, int, int]] = []
        self.paths = self.nonfinite = self.met = 0
        self.light = self.clamped = self.seconds = self.cpu_seconds = 0.0
        self._begin = begin
        self.before = (0.0, 0.0)
        """What had passed, on the clock and in processor time, in the process before."""

    def pending(self) -> list[int]:
        """Tiles that need further samples, in order. Those that wait for a decision are not among them."""
        return [int(i) for i in np.flatnonzero(self.open.any(axis=1) & (self.done < self._next()))]

    def next_samples(self, i: int) -> int:
        """Number of samples that a tile may be given next."""
        return int(np.where(self.open[i], self.goal[i], MAX_SAMPLES).min() - self.done[i])

    def _next(self) -> NDArray[np.int64]:
        """(tiles,): samples at which a colour of each is decided upon next."""
        return np.asarray(np.where(self.open, self.goal, MAX_SAMPLES).min(axis=1))

    def goes_on(self, i: int) -> bool:
        """True if a tile may be given further samples, now or after a decision."""
        return bool(self.open[i].any())

    def take(self, i: int, result: TileResult) -> None:
        """Add the result of a batch of a tile."""
        at = self._places(i)
        first = not self.done[i]
        self.done[i] += result.batch.samples
        done, tile, counts = int(self.done[i]), result.tile, None
        where = None if self.open[i].all() else self.open[i][_colours(tile)]
        if self.film.sample_counts is None:
            assert done == self.budget.max_samples
        else:
            counts = replicate_counts(done, self.budget.replicates)
        fill_factor = self.region.fill_factor
        sums, powers = fill_factor * result.sums[..., :-1, :], fill_factor**2 * result.sums[..., -1, :]
        known = None if self.film.within is None else powers
        found = self.film.add(at[0].start, at[1].start, sums, powers=known, counts=counts, where=where)
        if (found.mean < 0).any():  # what is known of light in a white image was too much here
            np.maximum(self.film.mean[at], 0.0, out=self.film.mean[at])
        if first:
            if self.one_sample is not None and result.weights is not None:
                brought = fill_factor * self.region.radiance * result.weights
                self.one_sample[at] = np.minimum(brought, np.finfo(np.float32).max)
            for name, array in (result.truth or {}).items():
                self.truth[name][at] = array
        if self.seen is not None and done < self.budget.max_samples:
            self._look(i, found)
        self.counts += result.counts
        self.paths += result.paths
        self.nonfinite += result.nonfinite
        self.met += result.met
        self.light, self.clamped = self.light + result.light, self.clamped + result.clamped
        self.nonfinite_paths = (self.nonfinite_paths + list(result.lost_paths))[:NAMED]
        if done >= self.budget.max_samples:
            self.capped |= bool(self.open[i].any())
            self.open[i] = False

    def decide(self, affordable: float = 0.0) -> None:
        """Select the tiles that go on and their samples, once all have those of this step.

        `affordable` is how many samples of every pixel still fit into the time limit; without a target error most of
        them are the next step.
        """
        going = self.open.any(axis=1)
        if not going.any() or (self.done < self._next())[going].any():
            return
        if self.seen is None or (self.done < self.budget.enough)[going].any():
            self.goal[going] = [2 * [self.budget.within(int(done), affordable)] for done in self.done[going]]
            return
        expected = expected_brightness(*self.seen)
        colours = (np.add.outer(*map(np.arange, expected.shape)) + sum(self.region[:2])) % 2
        lit = np.zeros(expected.shape, dtype=bool)
        squares, rare = relative_squares(expected, self.seen[1]), []
        for colour in range(2):
            own = colours == colour
            lit |= own & (expected > lit_threshold(expected[own]))
            rare.append((is_dominated_by_few(squares[own & lit]), not is_threshold_robust(*self.seen[:, own])))
        for i in np.flatnonzero(going):
            self._decide(int(i), np.where(lit, squares, np.nan), rare)

    def _look(self, i: int, found: Moments) -> None:
        """Keep how bright and how good pixels are, where it is now decided upon the other colour."""
        assert self.seen is not None and self.one_sample is not None
        at, bright = self._places(i), brightness(found.mean)
        # What one sample brings is known from the pixel itself: where it is 0, the pixel is not lit.
        error = spread(found, bright)
        where = (self.open[i] & (self.goal[i] == self.done[i]))[1 - _colours(self.tiles[i])]
        self.seen[0][at][where] = bright[where]
        self.seen[1][at][where] = np.mean(np.square(error), axis=-1)[where]

    def _decide(self, i: int, squares: Floats, rare: list[tuple[bool, bool]]) -> None:
        """Close the colours of a tile whose other colour is as good as wanted; squares are nan where it is not lit.

        Not those whose other colour, all over the image, says too little: its error is that of few pixels, or it is not
        known which of them are lit.
        """
        done, here, colours = int(self.done[i]), squares[self._places(i)], _colours(self.tiles[i])
        for colour in np.flatnonzero(self.open[i] & (self.goal[i] == done)):
            others = here[(colours == 1 - colour) & ~np.isnan(here)]
            found = float(np.sqrt(np.mean(others))) if others.size else 0.0
            few, any_may_be_lit = rare[1 - colour]
            if any_may_be_lit or (few and others.size > 0):
                self.open[i, colour], found = done < self.budget.enough_of_rare, 0.0
            else:
                self.open[i, colour] = not self.budget.is_near(found)
            self.goal[i, colour] = self.budget.towards(done, found, tuple(self.found[i, colour]))
            self.found[i, colour] = done, found

    def error(self) -> float | None:
        """Relative error over lit pixels until now; None without standard errors."""
        errors = self._errors()
        return None if errors is None else relative_error(self.film.mean[self.region.asked], errors)

    def _errors(self) -> NDArray[np.float32] | None:
        """Standard errors, nan where a tile is to come; None where there are none."""
        errors = self.film.standard_error(self.one_sample)
        if errors is None or not self.done.any():
            return None
        if self.film.sample_counts is not None:
            errors[self.film.sample_counts == 0] = np.nan
        return errors[self.region.asked]  # without counts, tiles that are to come are dark

    def sample_counts(self) -> NDArray[np.int32] | None:
        """(rows, columns): samples of each pixel that are in the image; None where they are all of the budget's."""
        if self.film.sample_counts is None and (self.done < self.budget.max_samples).any():
            self.film.sample_counts = np.zeros(self.film.mean.shape[:2], dtype=np.int32)
            for i, done in enumerate(self.done):
                self.film.sample_counts[self._places(i)] = done
        return self.film.sample_counts

    def note_time(self) -> None:
        """Record the elapsed time, with that of earlier processes."""
        self.seconds = self.before[0] + time.perf_counter() - self._begin[0]
        self.cpu_seconds = self.before[1] + time.process_time() - self._begin[1]

    def _places(self, i: int) -> tuple[slice, slice]:
        tile = self.tiles[i]
        row, column = tile.row - self.region.row, tile.column - self.region.column
        return slice(row, row + tile.rows), slice(column, column + tile.columns)


def _colours(tile: Tile) -> NDArray[np.int64]:
    """(rows, columns): 0 and 1 like a checkerboard's squares, by the place on the sensor."""
    rows, columns = np.arange(tile.rows) + tile.row, np.arange(tile.columns) + tile.column
    return np.asarray(np.add.outer(rows, columns) % 2)
