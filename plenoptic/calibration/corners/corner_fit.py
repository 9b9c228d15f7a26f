"""Least-squares fit of blurred corners of a checkerboard, many at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats

_STEPS, _CHUNK = 12, 2048
"""Steps of the fit, and corners that are fitted together."""
_BLUR, _MOTION = 0.8, 1.5
"""Blur with which the fit starts, and the largest step from there of corners that count."""
_MAX_ERROR, _MIN_SIGNAL, _MIN_CONTRAST, _MIN_SINE = 0.2, 1.5, 0.06, 0.4
"""Of corners that count: largest standard error in pixels, least half contrast over the residuals and over the bright
light, and least sine of the angle between edges."""
_DAMPING, _MIN_DAMPING = 1e-2, 1e-6
_SIGMA = (0.05, 6.0)
"""Limits of the blur's standard deviation in pixels."""
_MAX_STEP = 1.0
"""Largest step of a corner in pixels."""
_UNKNOWNS = 7
"""Row, column, angles of the two edges' normals, logarithm of the blur, half the contrast, mean."""


class CornerFit(NamedTuple):
    """Corners in micro images, (n, ...)."""

    pixel: Floats
    """(n, 2): row and column."""
    angle: Floats
    """(n, 2): of the edges' normals, from rows to columns; the quadrants where both are positive or negative are
    bright."""
    sigma: Floats
    """Standard deviation of the blur in pixels."""
    contrast: Floats
    """Half the difference between bright and dark."""
    mean: Floats
    residual: Floats
    """Standard deviation of the residuals."""
    standard_error: Floats
    """(n, 2): of row and column, nan where the window does not fix the corner."""

    def rows(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> CornerFit:
        """Some of the corners."""
        return CornerFit(*(part[chosen] for part in self))

    def is_clear(self, start: Floats, bright: float) -> NDArray[np.bool_]:
        """True for corners near their starts (n, 2), with clear edges in light of this brightness."""
        with np.errstate(invalid="ignore"):
            return np.asarray(
                (self.standard_error.max(axis=1) < _MAX_ERROR)
                & (np.hypot(*(self.pixel - start).T) < _MOTION)
                & (self.contrast > _MIN_SIGNAL * self.residual)
                & (self.contrast > _MIN_CONTRAST * bright)
                & (np.abs(np.sin(self.angle[:, 1] - self.angle[:, 0])) > _MIN_SINE)
            )

    def is_along(self, angle: Floats) -> NDArray[np.bool_]:
        """True for corners whose bright quadrants are those of normals at angles (n, 2)."""
        return np.asarray(np.cos(self.angle.sum(axis=1) - angle.sum(axis=1)) > 0.5)


class Windows(NamedTuple):
    """Pixels around corners."""

    pixel: Floats
    """(n, m, 2)."""
    light: Floats
    """(n, m)."""
    weight: Floats
    """(n, m): 0 outside the micro image."""


def fit_corners(windows: Windows, pixel: Floats, angle: Floats) -> CornerFit:
    """Fit corners (n, 2), starting from their pixels and normals' angles (n, 2).

    Levenberg-Marquardt steps; the light is mean + contrast E1 E2, where E is an edge blurred by a normal distribution.
    Errors are those of the residuals.
    """
    parts = []
    for first in range(0, max(len(pixel), 1), _CHUNK):
        rows = slice(first, first + _CHUNK)
        parts.append(_fit(Windows(*(part[rows] for part in windows)), pixel[rows], angle[rows]))
    return CornerFit(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def _fit(windows: Windows, pixel: Floats, angle: Floats) -> CornerFit:
    n = len(pixel)
    total = np.maximum(windows.weight.sum(axis=1), 1e-12)
    mean = (windows.weight * windows.light).sum(axis=1) / total
    scatter = np.sqrt((windows.weight * (windows.light - mean[:, None]) ** 2).sum(axis=1) / total)
    values = np.column_stack([pixel, angle, np.full(n, np.log(_BLUR)), scatter, mean])
    damping, diagonal = np.full(n, _DAMPING), np.arange(_UNKNOWNS)
    residual, slope = _residual(windows, values)
    cost = (windows.weight * residual**2).sum(axis=1)
    for _ in range(_STEPS):
        weighted = slope * windows.weight[..., None]
        normal = np.einsum("nmi,nmj->nij", weighted, slope, optimize=True)
        gradient = np.einsum("nmi,nm->ni", weighted, residual)
        damped = normal.copy()
        damped[:, diagonal, diagonal] *= 1.0 + damping[:, None]
        damped[:, diagonal, diagonal] += 1e-12 * np.maximum(scatter[:, None] ** 2, 1e-300)
        step = np.linalg.solve(damped, gradient[..., None])[..., 0]
        step *= np.minimum(1.0, _MAX_STEP / np.maximum(np.abs(step[:, :5]).max(axis=1), 1e-12))[:, None]
        trial = values + step
        trial[:, 4] = np.clip(trial[:, 4], *np.log(_SIGMA))
        new_residual, new_slope = _residual(windows, trial)
        new_cost = (windows.weight * new_residual**2).sum(axis=1)
        better = new_cost <= cost
        values[better], residual[better], slope[better] = trial[better], new_residual[better], new_slope[better]
        cost = np.where(better, new_cost, cost)
        damping = np.maximum(damping * np.where(better, 0.2, 8.0), _MIN_DAMPING)
    # Weights are proportional to inverse variances.
    count = (windows.weight > 0).sum(axis=1) - _UNKNOWNS
    variance = cost / np.maximum(count, 1)
    normal = np.einsum("nmi,nmj->nij", slope * windows.weight[..., None], slope, optimize=True)
    scale = np.sqrt(np.maximum(normal[:, diagonal, diagonal], 1e-30))
    unit = normal / (scale[:, :, None] * scale[:, None]) + 1e-9 * np.eye(_UNKNOWNS)
    spread = np.linalg.inv(unit)[:, diagonal, diagonal] / scale**2
    error = np.sqrt(spread[:, :2] * variance[:, None])
    error[count < _UNKNOWNS] = np.nan
    flipped = values[:, 5] < 0
    turned = values[:, 2:4] + np.pi * np.outer(flipped, [0.0, 1.0])
    mean_weight = np.maximum(windows.weight.sum(axis=1) / np.maximum(count + _UNKNOWNS, 1), 1e-12)
    return CornerFit(
        values[:, :2], turned, np.exp(values[:, 4]), np.abs(values[:, 5]), values[:, 6],
        np.sqrt(variance / mean_weight), error,
    )  # fmt: skip


def _residual(windows: Windows, values: Floats) -> tuple[Floats, Floats]:
    """Light less the model (n, m), and derivatives of the model (n, m, 7)."""
    offset = windows.pixel - values[:, None, :2]
    sigma, contrast = np.exp(values[:, 4, None]), values[:, 5, None]
    sine, cosine = np.sin(values[:, 2:4]), np.cos(values[:, 2:4])
    edges, rates, blurs, across = [], [], [], []
    for k in (0, 1):
        t = cosine[:, k, None] * offset[..., 0] + sine[:, k, None] * offset[..., 1]
        across.append(cosine[:, k, None] * offset[..., 1] - sine[:, k, None] * offset[..., 0])
        # Means over the width of a pixel of erf(t / (sqrt 2 sigma)), by its integral.
        ends = t - 0.5, t + 0.5
        bells = [np.exp(-0.5 * (u / sigma) ** 2) for u in ends]
        steps = [_error_function(u / sigma, bell) for u, bell in zip(ends, bells, strict=True)]
        widening = np.sqrt(2.0 / np.pi) * sigma * (bells[1] - bells[0])
        edges.append(ends[1] * steps[1] - ends[0] * steps[0] + widening)
        rates.append(contrast * (steps[1] - steps[0]))
        blurs.append(contrast * widening)
    by_first, by_second = rates[0] * edges[1], rates[1] * edges[0]
    product = edges[0] * edges[1]
    slope = np.empty((*product.shape, _UNKNOWNS))
    for axis, normal in enumerate((cosine, sine)):
        slope[..., axis] = -normal[:, 0, None] * by_first - normal[:, 1, None] * by_second
    slope[..., 2], slope[..., 3] = by_first * across[0], by_second * across[1]
    slope[..., 4] = blurs[0] * edges[1] + blurs[1] * edges[0]
    slope[..., 5], slope[..., 6] = product, 1.0
    return windows.light - values[:, 6, None] - contrast * product, slope


def _error_function(t: Floats, bell: Floats) -> Floats:
    """erf(t / sqrt 2) to 3e-5, with bell = exp(-t^2 / 2); Abramowitz and Stegun 7.1.25."""
    u = 1.0 / (1.0 + 0.47047 * np.abs(t) / np.sqrt(2.0))
    return np.asarray(np.sign(t) * (1.0 - u * (0.3480242 + u * (-0.0958798 + u * 0.7478556)) * bell))
