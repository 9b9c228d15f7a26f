"""State of a render: its film, its tiles, and the pixels that still need samples."""

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
from plenoptic.rendering.film import Film, Moments, error_of_mean, replicate_counts
from plenoptic.rendering.schedule.budget import MAX_SAMPLES, Budget
from plenoptic.rendering.stats import NAMED
from plenoptic.rendering.tile import Tile, TileResult


class FilmRegion(NamedTuple):
    """Position of a film on the sensor, and the scale of its values."""

    row: int
    column: int
    """Upper left pixel on the sensor."""
    fill_factor: float
    """Sensitive fraction of a pixel: sums are of radiance on that part."""
    radiance: float
    """Approximate maximum radiance of the scene."""
    deflected: bool
    """True if microlenses diffract light."""
    crop: tuple[slice, slice] = (slice(None), slice(None))
    """Requested part of the film: errors are pooled over blocks, and the blocks at its rim are rendered completely."""


class Progress:
    """State of a render.

    The pixels of a tile are coloured like a checkerboard. The standard errors of the pixels of one colour decide
    whether those of the other colour, which are independent of them, get more samples. So a pixel does not stop because
    it happened to receive little light, and its expectation is that of a fixed number of samples. Pixels stop if none
    of the other colour is lit. A colour that has stopped still gets samples while the other one continues, for the
    decision on it; these do not count in its image.

    Each colour is decided upon at sample numbers of its own, predicted from the errors of the other.

    The lit pixels are determined anew before each round of decisions: for one colour, from the state of its pixels at
    the last decision on the other one, so that this, too, is independent of the decision. If the error of a whole
    colour rests on few pixels, light is rare: no tile knows whether it has sampled it, and the other colour continues.
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
        """`counted`: pixels may have different sample numbers; `begin`: wall-clock and processor time at the start."""
        self.tiles, self.budget, self.region, self.truth = tiles, budget, region, truth
        replicates = budget.replicates
        self.film = Film(shape, counts=replicate_counts(budget.max_samples, replicates))
        if self.film.between is not None:
            self.film.within = np.zeros(shape, dtype=np.float32)
        if counted:
            self.film.sample_counts = np.zeros(shape[:2], dtype=np.int32)
        self.one_sample = None if self.film.between is None else np.zeros(shape[:2], dtype=np.float32)
        """Maximum contribution of one sample; None without standard errors."""
        self.counts = np.zeros(codes, dtype=np.int64)
        self.done = np.zeros(len(tiles), dtype=np.int64)
        """Number of samples of each tile."""
        self.goal = np.full((len(tiles), 2), budget.following(0), dtype=np.int64)
        """Number of samples at which the next decision on each colour of a tile is taken."""
        self.open = np.ones((len(tiles), 2), dtype=bool)
        """True while the pixels of a colour of a tile need samples."""
        self.last_decision = np.zeros((len(tiles), 2, 2))
        """Sample number at the last decision on each colour, and the error of the other colour then."""
        self.at_decision = None if budget.target_error is None else np.zeros((2, *shape[:2]))
        """Brightness and squared standard error of pixels at the last decision on the other colour of their tile."""
        self.capped = False
        """True if some pixels ended with the maximum number of samples."""
        self.nonfinite_paths: list[tuple[int, int, int]] = []
        self.paths = self.nonfinite = self.scene_hits = 0
        self.light = self.clamped = self.seconds = self.cpu_seconds = 0.0
        self._begin = begin
        self.before = (0.0, 0.0)
        """Wall-clock and processor time spent in the previous process, s."""

    def pending(self) -> list[int]:
        """Tiles that need further samples, in order, without those that wait for a decision."""
        return [int(i) for i in np.flatnonzero(self.open.any(axis=1) & (self.done < self._next()))]

    def next_samples(self, i: int) -> int:
        """Number of samples that a tile may get next."""
        return int(np.where(self.open[i], self.goal[i], MAX_SAMPLES).min() - self.done[i])

    def _next(self) -> NDArray[np.int64]:
        """(tiles,): number of samples at the next decision on a colour of each."""
        return np.asarray(np.where(self.open, self.goal, MAX_SAMPLES).min(axis=1))

    def goes_on(self, i: int) -> bool:
        """True if a tile may get further samples, now or after a decision."""
        return bool(self.open[i].any())

    def take(self, i: int, result: TileResult) -> None:
        """Add the result of a batch of a tile."""
        at = self._slices(i)
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
        known_powers = None if self.film.within is None else powers
        tile_moments = self.film.add(at[0].start, at[1].start, sums, powers=known_powers, counts=counts, where=where)
        if (tile_moments.mean < 0).any():  # the control variate of a white image exceeded the light
            np.maximum(self.film.mean[at], 0.0, out=self.film.mean[at])
        if first:
            if self.one_sample is not None and result.weights is not None:
                contribution = fill_factor * self.region.radiance * result.weights
                self.one_sample[at] = np.minimum(contribution, np.finfo(np.float32).max)
            for name, array in (result.truth or {}).items():
                self.truth[name][at] = array
        if self.at_decision is not None and done < self.budget.max_samples:
            self._store_at_decision(i, tile_moments)
        self.counts += result.counts
        self.paths += result.paths
        self.nonfinite += result.nonfinite
        self.scene_hits += result.scene_hits
        self.light, self.clamped = self.light + result.light, self.clamped + result.clamped
        self.nonfinite_paths = (self.nonfinite_paths + list(result.lost_paths))[:NAMED]
        if done >= self.budget.max_samples:
            self.capped |= bool(self.open[i].any())
            self.open[i] = False

    def decide(self, affordable: float = 0.0) -> None:
        """Decide which tiles continue and to what number of samples, once all pending samples are done.

        `affordable` is the number of samples per pixel that still fit into the time limit; without a target error, the
        next step takes most of them.
        """
        unfinished = self.open.any(axis=1)
        if not unfinished.any() or (self.done < self._next())[unfinished].any():
            return
        if self.at_decision is None or (self.done < self.budget.enough)[unfinished].any():
            self.goal[unfinished] = [2 * [self.budget.within(int(done), affordable)] for done in self.done[unfinished]]
            return
        expected = expected_brightness(*self.at_decision)
        colour_of_pixel = (np.add.outer(*map(np.arange, expected.shape)) + sum(self.region[:2])) % 2
        lit = np.zeros(expected.shape, dtype=bool)
        squares, rare = relative_squares(expected, self.at_decision[1]), []
        for colour in range(2):
            of_colour = colour_of_pixel == colour
            lit |= of_colour & (expected > lit_threshold(expected[of_colour]))
            rare.append(
                (
                    is_dominated_by_few(squares[of_colour & lit]),
                    not (self.budget.with_core or is_threshold_robust(*self.at_decision[:, of_colour])),
                )
            )
        for i in np.flatnonzero(unfinished):
            self._decide(int(i), np.where(lit, squares, np.nan), rare)

    def _store_at_decision(self, i: int, tile_moments: Moments) -> None:
        """Store brightness and error of pixels if the other colour is due for a decision."""
        assert self.at_decision is not None and self.one_sample is not None
        at, pixel_brightness = self._slices(i), brightness(tile_moments.mean)
        # The contribution of one sample is the pixel's own brightness: where it is 0, the pixel is not lit.
        error = error_of_mean(tile_moments, pixel_brightness)
        where = (self.open[i] & (self.goal[i] == self.done[i]))[1 - _colours(self.tiles[i])]
        self.at_decision[0][at][where] = pixel_brightness[where]
        self.at_decision[1][at][where] = np.mean(np.square(error), axis=-1)[where]

    def _decide(self, i: int, squares: Floats, rare: list[tuple[bool, bool]]) -> None:
        """Close the colours of a tile whose other colour has reached the target; squares are nan for unlit pixels.

        Colours stay open if the other colour's error, over the whole image, is unreliable: it rests on few pixels, or
        the lit pixels are unknown.
        """
        done, tile_squares, colours = int(self.done[i]), squares[self._slices(i)], _colours(self.tiles[i])
        for colour in np.flatnonzero(self.open[i] & (self.goal[i] == done)):
            other_squares = tile_squares[(colours == 1 - colour) & ~np.isnan(tile_squares)]
            error = float(np.sqrt(np.mean(other_squares))) if other_squares.size else 0.0
            rests_on_few_pixels, any_may_be_lit = rare[1 - colour]
            if any_may_be_lit or (rests_on_few_pixels and other_squares.size > 0):
                self.open[i, colour], error = done < self.budget.enough_of_rare, 0.0
            else:
                self.open[i, colour] = not self.budget.is_near(error)
            self.goal[i, colour] = self.budget.towards(done, error, tuple(self.last_decision[i, colour]))
            self.last_decision[i, colour] = done, error

    def error(self) -> float | None:
        """Relative error over lit pixels so far, without tiles that have no samples; None without standard errors."""
        errors = self.film.standard_error(self.one_sample, deflected=self.region.deflected)
        if errors is None or not self.done.any():
            return None
        if self.film.sample_counts is not None:  # without counts, pending tiles are dark
            errors[self.film.sample_counts == 0] = np.nan
        return relative_error(self.film.mean[self.region.crop], errors[self.region.crop])

    def sample_counts(self) -> NDArray[np.int32] | None:
        """(rows, columns): samples of each pixel in the image; None if all have the budget's number."""
        if self.film.sample_counts is None and (self.done < self.budget.max_samples).any():
            self.film.sample_counts = np.zeros(self.film.mean.shape[:2], dtype=np.int32)
            for i, done in enumerate(self.done):
                self.film.sample_counts[self._slices(i)] = done
        return self.film.sample_counts

    def update_time(self) -> None:
        """Update the time spent, including that of the previous process."""
        self.seconds = self.before[0] + time.perf_counter() - self._begin[0]
        self.cpu_seconds = self.before[1] + time.process_time() - self._begin[1]

    def _slices(self, i: int) -> tuple[slice, slice]:
        tile = self.tiles[i]
        row, column = tile.row - self.region.row, tile.column - self.region.column
        return slice(row, row + tile.rows), slice(column, column + tile.columns)


def _colours(tile: Tile) -> NDArray[np.int64]:
    """(rows, columns): checkerboard colour 0 or 1, by the position on the sensor."""
    rows, columns = np.arange(tile.rows) + tile.row, np.arange(tile.columns) + tile.column
    return np.asarray(np.add.outer(rows, columns) % 2)
