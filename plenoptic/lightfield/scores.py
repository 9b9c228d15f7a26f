"""Quality of a disparity map: errors of the 4D Light Field Benchmark, and errors relative to the truth."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.values import Floats, frozen_array, plain_array, positive, result, whole
from plenoptic.errors import InvalidValueError

_LIMITS = (0.07, 0.03, 0.01)
"""Errors that are exceeded, in pixels and relative to the disparity."""
_MAX_TYPES = 1024
_CLIP = 0.05
"""Bumpiness at which a pixel's contribution is clipped."""


@result
class DisparityScores:
    """Errors of a disparity map. See `disparity_scores`, which returns them.

    Attributes
    ----------
    pixels : int
        Number of compared pixels.
    kept : float
        Fraction of the pixels with truth that were compared.
    mse : float
        100 times the mean squared error, pixel^2.
    bad : (float, float, float)
        Percent of pixels whose error exceeds 0.07, 0.03 and 0.01 pixels: BadPix.
    q25 : float
        100 times the lower quartile of the error, pixels.
    relative : (float, float, float)
        Percent of pixels whose relative error exceeds 7, 3 and 1 %: Rel7, Rel3, Rel1.
    bias : float
        Median of estimate over truth, less 1.
    bumpiness : float
        100 times the mean norm of the second derivatives of the error, clipped at 0.05 for each pixel. On planes, the
        benchmark's score Planes. Only pixels with 5 x 5 valid neighbours count.
    of_types : tuple of DisparityScores
        Scores of each type of microlens; empty without types.
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
        bad, relative = [f"Bad{limit:g}" for limit in _LIMITS], [f"Rel{100 * limit:.0f}" for limit in _LIMITS]
        rows = [["", "pixels", "kept %", "MSE x100", *bad, "Q25", *relative, "bias %", "bumpy"]]
        for name, part in [("all", self), *((f"type {number}", part) for number, part in enumerate(self.of_types))]:
            numbers = (*part.bad, part.q25, *part.relative, 100 * part.bias, part.bumpiness)
            rows.append([name, str(part.pixels), *(f"{x:.4g}" for x in (100 * part.kept, part.mse, *numbers))])
        return "\n".join(f"{row[0]:8}" + "".join(f"{text:>9}" for text in row[1:]) for row in rows)


def disparity_scores(
    estimate: ArrayLike, truth: ArrayLike, *, where: ArrayLike | None = None, types: ArrayLike | None = None
) -> DisparityScores:
    """Compare a disparity map with the truth.

    Parameters
    ----------
    estimate, truth : (H, W) array_like
        Disparity in pixels; nan if unknown. For another quantity, such as depth, only the relative errors are
        meaningful.
    where : (H, W) array_like of bool, optional
        Mask of the compared pixels, such as those away from the border (15 pixels in the benchmark), near
        discontinuities (`disparity_edges`; `bad[0]` is then the benchmark's score Discontinuities), or on planes. None:
        all.
    types : (H, W) array_like of int, optional
        Type of the microlens of each pixel, `GroundTruth.microlens_type`, for scores of each type; pixels of a negative
        type belong to none.

    Returns
    -------
    DisparityScores
        Scores of the pixels with both estimate and truth; nan without any. Relative errors exclude pixels of truth 0.

    Raises
    ------
    InvalidValueError
        If shapes differ, or an argument is invalid.

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
    true_disparity = frozen_array(truth, name="truth", shape=("rows", "columns"))
    shape = true_disparity.shape
    estimated = frozen_array(estimate, name="estimate", shape=shape)
    mask = np.ones(shape, dtype=bool) if where is None else _mask(where, shape)
    lens_types = None if types is None else frozen_array(types, name="types", shape=shape, dtype=np.int64)
    scores = _scores(estimated, true_disparity, mask)
    if lens_types is None:
        return scores
    count = int(lens_types.max(initial=-1)) + 1
    if count > _MAX_TYPES:
        raise InvalidValueError(f"types has {count - 1}; types are counted from 0, {_MAX_TYPES} at most")
    of_types = (_scores(estimated, true_disparity, mask & (lens_types == lens_type)) for lens_type in range(count))
    return dataclasses.replace(scores, of_types=tuple(of_types))


def disparity_edges(truth: ArrayLike, *, step: float = 0.05, reach: int = 2) -> NDArray[np.bool_]:
    """Mask of the pixels near discontinuities of a disparity map.

    Parameters
    ----------
    truth : (H, W) array_like
        Disparity in pixels; unknown pixels count as edges.
    step : float, optional
        Smallest difference at a discontinuity, both in pixels and relative to the disparity.
    reach : int, optional
        Distance from a discontinuity along rows and columns, in pixels.

    Returns
    -------
    (H, W) array of bool

    Raises
    ------
    InvalidValueError
        If an argument is invalid.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> truth = np.where(np.arange(8) < 4, 3.0, 5.0) * np.ones((2, 1))
    >>> pl.lightfield.disparity_edges(truth)[0].astype(int)
    array([0, 0, 1, 1, 1, 1, 0, 0])
    """
    true_disparity = frozen_array(truth, name="truth", shape=("rows", "columns"))
    min_step, pixels = positive(step, "step"), whole(reach, "reach", at_least=1, at_most=64)
    padded = np.pad(true_disparity, pixels, mode="edge")
    edges = np.isnan(true_disparity)
    with np.errstate(invalid="ignore"):
        for axis in (0, 1):
            for shift in range(-pixels, pixels + 1):
                cut = [slice(pixels, pixels + length) for length in true_disparity.shape]
                cut[axis] = slice(pixels + shift, pixels + shift + true_disparity.shape[axis])
                difference = np.abs(padded[tuple(cut)] - true_disparity)
                edges |= ~(difference <= np.maximum(min_step, min_step * np.abs(true_disparity)))
    return np.asarray(edges)


def _bumpiness(error: Floats, both: NDArray[np.bool_]) -> float:
    """100 times the mean norm of second derivatives; nan without valid neighbours."""
    if min(error.shape) < 5:
        return np.nan
    with np.errstate(invalid="ignore"):
        first = [_derivative(error, axis) for axis in (0, 1)]
        squares = sum(_derivative(part, axis) ** 2 for part in first for axis in (0, 1))
        norm = np.sqrt(squares)[both[2:-2, 2:-2]]
    norm = norm[np.isfinite(norm)]
    return float(100 * np.minimum(norm, _CLIP).mean()) if norm.size else np.nan


def _derivative(plane: Floats, axis: int) -> Floats:
    """Central differences along an axis, weighted 3, 10, 3 across it; shorter by a pixel at each border."""
    along = np.moveaxis(plane, axis, 0)
    difference = 0.5 * (along[2:] - along[:-2])
    return np.moveaxis(
        (3.0 * difference[:, :-2] + 10.0 * difference[:, 1:-1] + 3.0 * difference[:, 2:]) / 16.0, 0, axis
    )


def _mask(where: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    mask = plain_array(where, "where")
    if mask.dtype != bool or mask.shape != shape:
        raise InvalidValueError(f"where has shape {mask.shape} and type {mask.dtype}; it must be booleans {shape}")
    return mask


def _scores(estimated: Floats, true_disparity: Floats, mask: NDArray[np.bool_]) -> DisparityScores:
    with_truth = mask & np.isfinite(true_disparity)
    both = with_truth & np.isfinite(estimated)
    if not both.any():
        no_scores = (np.nan,) * 3
        fraction = 0.0 if with_truth.any() else np.nan
        return DisparityScores(0, fraction, np.nan, no_scores, np.nan, no_scores, np.nan, np.nan)
    error, true = np.abs(estimated[both] - true_disparity[both]), true_disparity[both]
    relative, ratio = error[true != 0] / np.abs(true[true != 0]), estimated[both][true != 0] / true[true != 0]
    return DisparityScores(
        pixels=int(both.sum()),
        kept=float(both.sum() / with_truth.sum()),
        mse=float(100 * np.mean(error**2)),
        bad=_percent_above_limits(error),
        q25=float(100 * np.percentile(error, 25)),
        relative=_percent_above_limits(relative),
        bias=float(np.median(ratio) - 1) if ratio.size else np.nan,
        bumpiness=_bumpiness(estimated - true_disparity, both),
    )


def _percent_above_limits(error: Floats) -> tuple[float, float, float]:
    first, second, third = (float(100 * np.mean(error > limit)) if error.size else np.nan for limit in _LIMITS)
    return first, second, third
