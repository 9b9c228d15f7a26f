"""Scores of a disparity map: those of the 4D Light Field Benchmark, and errors relative to the truth."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.values import Floats, frozen_array, plain_array, positive, result, whole
from plenoptic.errors import InvalidValueError

_PIXELS = (0.07, 0.03, 0.01)
_MOST_TYPES = 1024
_RELATIVE = (0.07, 0.03, 0.01)
_CLIP = 0.05
"""Bumpiness at which a pixel counts no more."""


@result
class DisparityScores:
    """Errors of a map of disparity. See `disparity_scores`, which makes it.

    Attributes
    ----------
    pixels : int
        That were compared.
    kept : float
        Their share of the pixels with truth.
    mse : float
        100 times the mean squared error, pixel^2.
    bad : (float, float, float)
        Percent of pixels whose error exceeds 0.07, 0.03 and 0.01 pixels: BadPix.
    q25 : float
        100 times the error that a quarter of the pixels do not exceed, pixels.
    relative : (float, float, float)
        Percent of pixels whose relative error exceeds 7, 3 and 1 %: Rel7, Rel3, Rel1.
    bias : float
        Median of estimate over truth, less 1.
    bumpiness : float
        100 times the mean norm of the second derivatives of the error, each pixel's at most 0.05: on planes, the score
        that the benchmark calls Planes; of the pixels whose 5 x 5 neighbours are known.
    of_types : tuple of DisparityScores
        The same of each type of microlens alone; empty where types were not given.
    """

    pixels: int
    kept: float
    mse: float
    bad: tuple[float, float, float]
    q25: float
    relative: tuple[float, float, float]
    bias: float
    bumpiness: float
    of_types: tuple[DisparityScores, ...] = ()

    def __str__(self) -> str:
        heading = f"{'':8}{'pixels':>9}{'kept %':>8}{'MSE x100':>10}"
        heading += "".join(f"{f'Bad{part:g}':>9}" for part in _PIXELS) + f"{'Q25':>9}"
        heading += "".join(f"{f'Rel{100 * part:.0f}':>8}" for part in _RELATIVE) + f"{'bias %':>9}{'bumpy':>8}"
        named = [("all", self), *((f"type {number}", scores) for number, scores in enumerate(self.of_types))]
        return "\n".join([heading, *(scores._line(name) for name, scores in named)])

    def _line(self, name: str) -> str:
        numbers = f"{name:8}{self.pixels:9d}{100 * self.kept:8.2f}{self.mse:10.4g}"
        numbers += "".join(f"{part:9.2f}" for part in self.bad) + f"{self.q25:9.3g}"
        return (
            numbers + "".join(f"{part:8.2f}" for part in self.relative) + f"{100 * self.bias:9.3f}{self.bumpiness:8.3f}"
        )


def disparity_scores(
    estimate: ArrayLike, truth: ArrayLike, *, where: ArrayLike | None = None, types: ArrayLike | None = None
) -> DisparityScores:
    """Compare a map of disparity with the truth.

    Parameters
    ----------
    estimate, truth : (H, W) array_like
        Disparity in pixels; nan where it is not known. Of another quantity, such as depth, the relative errors alone
        mean something.
    where : (H, W) array_like of bool, optional
        Which pixels count, such as those away from the border (the benchmark leaves out 15 pixels), near
        discontinuities (`disparity_edges`: there `bad[0]` is the score that the benchmark calls Discontinuities), or on
        planes. None: all.
    types : (H, W) array_like of int, optional
        The type of the microlens of each pixel, `GroundTruth.microlens_type`: scores of each type are found too; pixels
        of a negative type belong to none.

    Returns
    -------
    DisparityScores
        Of the pixels with both; nan where there are none. Relative errors are those of pixels whose truth is not 0.

    Raises
    ------
    InvalidValueError
        Where shapes differ, or an argument is impossible.

    References
    ----------
    K. Honauer et al., ACCV 2016, doi:10.1007/978-3-319-54187-7_2: MSE, BadPix, Q25, bumpiness (with the derivatives of
    its evaluation toolkit, those of H. Scharr).

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> truth = np.full((10, 10), 4.0)
    >>> scores = pl.lightfield.disparity_scores(truth + 0.05, truth)
    >>> scores.bad, scores.relative, round(scores.bias, 4)
    ((0.0, 100.0, 100.0), (0.0, 0.0, 100.0), 0.0125)
    """
    known = frozen_array(truth, name="truth", shape=("rows", "columns"))
    shape = known.shape
    found = frozen_array(estimate, name="estimate", shape=shape)
    counted = np.ones(shape, dtype=bool) if where is None else _mask(where, shape)
    kinds = None if types is None else frozen_array(types, name="types", shape=shape, dtype=np.int64)
    scores = _scores(found, known, counted)
    if kinds is None:
        return scores
    count = int(kinds.max(initial=-1)) + 1
    if count > _MOST_TYPES:
        raise InvalidValueError(f"types has {count - 1}; types are counted from 0, {_MOST_TYPES} at most")
    apart = tuple(_scores(found, known, counted & (kinds == kind)) for kind in range(count))
    return dataclasses.replace(scores, of_types=apart)


def disparity_edges(truth: ArrayLike, *, step: float = 0.05, reach: int = 2) -> NDArray[np.bool_]:
    """Pixels near discontinuities of a map of disparity.

    Parameters
    ----------
    truth : (H, W) array_like
        Disparity in pixels; unknown pixels are edges.
    step : float, optional
        Differences count that exceed it: in pixels, and as a part of the disparity.
    reach : int, optional
        Pixels along rows and columns up to which they count.

    Returns
    -------
    (H, W) array of bool

    Raises
    ------
    InvalidValueError
        Where an argument is impossible.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> truth = np.where(np.arange(8) < 4, 3.0, 5.0) * np.ones((2, 1))
    >>> pl.lightfield.disparity_edges(truth)[0].astype(int)
    array([0, 0, 1, 1, 1, 1, 0, 0])
    """
    known = frozen_array(truth, name="truth", shape=("rows", "columns"))
    least, pixels = positive(step, "step"), whole(reach, "reach", at_least=1, at_most=64)
    beside = np.pad(known, pixels, mode="edge")
    found = np.isnan(known)
    with np.errstate(invalid="ignore"):
        for axis in (0, 1):
            for shift in range(-pixels, pixels + 1):
                cut = [slice(pixels, pixels + length) for length in known.shape]
                cut[axis] = slice(pixels + shift, pixels + shift + known.shape[axis])
                off = np.abs(beside[tuple(cut)] - known)
                found |= ~(off <= np.maximum(least, least * np.abs(known)))
    return np.asarray(found)


def _bumpiness(error: Floats, both: NDArray[np.bool_]) -> float:
    """100 times the mean norm of second derivatives; nan where no neighbours are known."""
    if min(error.shape) < 5:
        return np.nan
    with np.errstate(invalid="ignore"):
        first = [_derivative(error, axis) for axis in (0, 1)]
        squares = sum(_derivative(part, axis) ** 2 for part in first for axis in (0, 1))
        norm = np.sqrt(squares)[both[2:-2, 2:-2]]
    norm = norm[np.isfinite(norm)]
    return float(100 * np.minimum(norm, _CLIP).mean()) if norm.size else np.nan


def _derivative(plane: Floats, axis: int) -> Floats:
    """Along an axis, by central differences that are weighed 3, 10, 3 across; a pixel less at each border."""
    along = np.moveaxis(plane, axis, 0)
    apart = 0.5 * (along[2:] - along[:-2])
    return np.moveaxis((3.0 * apart[:, :-2] + 10.0 * apart[:, 1:-1] + 3.0 * apart[:, 2:]) / 16.0, 0, axis)


def _mask(where: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    mask = plain_array(where, "where")
    if mask.dtype != bool or mask.shape != shape:
        raise InvalidValueError(f"where has shape {mask.shape} and type {mask.dtype}; it must be booleans {shape}")
    return mask


def _scores(found: Floats, known: Floats, counted: NDArray[np.bool_]) -> DisparityScores:
    there = counted & np.isfinite(known)
    both = there & np.isfinite(found)
    if not both.any():
        nothing = (np.nan,) * 3
        share = 0.0 if there.any() else np.nan
        return DisparityScores(0, share, np.nan, nothing, np.nan, nothing, np.nan, np.nan)
    error, true = np.abs(found[both] - known[both]), known[both]
    relative, ratio = error[true != 0] / np.abs(true[true != 0]), found[both][true != 0] / true[true != 0]
    return DisparityScores(
        pixels=int(both.sum()),
        kept=float(both.sum() / there.sum()),
        mse=float(100 * np.mean(error**2)),
        bad=_shares(error, _PIXELS),
        q25=float(100 * np.percentile(error, 25)),
        relative=_shares(relative, _RELATIVE),
        bias=float(np.median(ratio) - 1) if ratio.size else np.nan,
        bumpiness=_bumpiness(found - known, both),
    )


def _shares(error: Floats, limits: tuple[float, float, float]) -> tuple[float, float, float]:
    """Percent of errors above each limit."""
    first, second, third = (float(100 * np.mean(error > limit)) if error.size else np.nan for limit in limits)
    return first, second, third
