"""Disparities of pixels for which matching found none, interpolated over the picture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.lightfield.focused.edges import picture_positions
from plenoptic.lightfield.focused.pixel_rays import PixelRays

_CELLS_PER_PITCH = 6
_CONTRAST, _LEAST_WEIGHT = 0.1, 1e-3
"""Relative difference of radiance at which neighbouring cells are half as tied, and the weight of any others."""
_CELL_TIE, _PASSES = 1e-3, 3
"""Tie of a pixel to its cell, and the number of times that cells of pixels are found anew."""
_CELL_TOLERANCE, _TOLERANCE, _MAX_STEPS = 1e-5, 1e-3, 2000
"""Relative residuals at which cells and pixels, which start from their cells, are solved."""


def fill_disparities(rays: PixelRays, disparity: Floats, known: NDArray[np.bool_], trust: Floats) -> Floats:
    """Disparities of the rays (n,), in pitches: those that are not known, interpolated from all that have trust.

    Without any trust, those that are known have it.

    On cells of the picture, as seen from the centre of the pupil, the sum of trust (d - measured d)^2 and of tie
    (difference of d between neighbouring cells)^2 is least; the tie falls with their difference of radiance. The same
    within each micro image, whose pixels are tied to their cells, too. Weighted least squares: Z. Farbman et al., ACM
    Trans. Graph. 27 (2008), doi:10.1145/1360612.1360666.
    """
    radiance = rays.at(rays.raw.shot) / rays.at(rays.raw.white)
    low, high = disparity[known].min(), disparity[known].max()
    trust = np.where(np.isfinite(disparity), trust if trust.any() else known, 0.0)
    measured = np.nan_to_num(disparity)
    filled = np.where(known, disparity, np.average(measured, weights=trust + 1e-30))
    lens, light = rays.on_image(rays.lens, -1), np.full(rays.raw.shot.shape, np.nan)
    light[rays.row, rays.column] = radiance
    down, across = (
        _ties(light, axis) * (np.diff(lens, axis=axis) == 0) * (np.delete(lens, 0, axis) >= 0) for axis in (0, 1)
    )
    weight = rays.on_image(trust + _CELL_TIE, 1.0)
    for _ in range(_PASSES):
        of_cells = _on_cells(rays, filled, measured, trust, radiance)
        target = rays.on_image(trust * measured + _CELL_TIE * of_cells, 0.0)
        smooth = rays.at(_least_squares(weight, target, down, across, rays.on_image(of_cells, 0.0), _TOLERANCE))
        filled = np.where(known, disparity, np.clip(smooth, low, high))
    return filled


def _on_cells(rays: PixelRays, disparity: Floats, measured: Floats, trust: Floats, radiance: Floats) -> Floats:
    """Disparities of the rays (n,) from measured ones, smooth over the cells of the picture in which they lie."""
    spacing = min(rays.array.pitches) / _CELLS_PER_PITCH
    position = np.rint(picture_positions(rays, rays.nearness(disparity), spacing)).astype(np.int64)
    position -= position.min(axis=0)
    shape = position.max(axis=0) + 1
    cell = position @ (shape[1], 1)
    weight, target, count, *light = (
        np.bincount(cell, values, minlength=int(shape.prod())).reshape(shape)
        for values in (trust, trust * measured, np.ones(len(cell)), *radiance.T)
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.stack(light, axis=-1) / count[..., None]
    start = np.full(shape, target.sum() / weight.sum())
    solution = _least_squares(weight, target, _ties(mean, 0), _ties(mean, 1), start, _CELL_TOLERANCE)
    return np.asarray(solution.ravel()[cell])


def _ties(light: Floats, axis: int) -> Floats:
    """Weights of the differences between neighbouring cells along an axis; 1 where a cell is empty."""
    difference = np.linalg.norm(np.diff(light, axis=axis), axis=-1)
    ahead, behind = (np.delete(np.linalg.norm(light, axis=-1), end, axis=axis) for end in (0, -1))
    contrast = difference / np.maximum(0.5 * (ahead + behind), 1e-30) / _CONTRAST
    return np.asarray(np.nan_to_num(np.maximum(0.5 ** np.minimum(contrast**2, 99.0), _LEAST_WEIGHT), nan=1.0))


def _least_squares(
    weight: Floats, right_side: Floats, down: Floats, across: Floats, start: Floats, tolerance: float
) -> Floats:
    """Solve weight d - div(ties grad d) = right side by conjugate gradients."""

    def apply(d: Floats) -> Floats:
        product, flow_down, flow_across = weight * d, down * np.diff(d, axis=0), across * np.diff(d, axis=1)
        product[:-1] -= flow_down
        product[1:] += flow_down
        product[:, :-1] -= flow_across
        product[:, 1:] += flow_across
        return product

    diagonal = weight.copy()
    diagonal[:-1] += down
    diagonal[1:] += down
    diagonal[:, :-1] += across
    diagonal[:, 1:] += across
    solution, residual = start, right_side - apply(start)
    scaled = direction = residual / diagonal
    square, whole = (residual * scaled).sum(), (right_side**2 / diagonal).sum()
    for _ in range(_MAX_STEPS):
        if not square > tolerance**2 * whole:
            break
        change = apply(direction)
        step = square / (direction * change).sum()
        solution, residual = solution + step * direction, residual - step * change
        scaled, last = residual / diagonal, square
        square = (residual * scaled).sum()
        direction = scaled + square / last * direction
    return solution
