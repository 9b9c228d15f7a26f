"""Search for the micro images of a white image, without knowledge of the camera."""

from __future__ import annotations

import contextlib
import dataclasses
import math

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from plenoptic.calibration.cells import Cell
from plenoptic.calibration.lattice_search import NO_LATTICE, lattice_of, lattice_steps
from plenoptic.calibration.micro_image_types import disc_borders, neighbour_differences, type_pattern
from plenoptic.calibration.white_image import WhitePlane, white_plane
from plenoptic.camera.points.micro_image_grid import MicroImageGrid
from plenoptic.camera.points.window_moments import WindowMoments, window_moments
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.readout.raw import RawImage
from plenoptic.rendering.exposure import Exposure

_TRIALS, _START, _STEPS = 12, 3, 4
"""Places of the lattice that are tried along each step, micro images on each side of the central one there, and steps
from the best place."""
_GROWTH, _FEWEST, _MOST_MISSED = 1.3, 9, 0.3
"""Growth of the radius in which micro images are measured, least number of them, and their largest distance in pitches
from where the lattice has them."""
_MIN_LIGHT = 0.01
"""Least light over that of bright micro images."""
_OUTLIER, _MIN_SCATTER = 5.0, 0.002
"""Largest differences in place and light from neighbours in standard deviations, and least deviation of light."""
_TOUCHING, _DEFECT = 0.02, 0.2
"""Motion of centroids with their cells from which on micro images touch, and relative difference of the light of
defects."""
_MAX_GAIN, _MAX_GAIN_WITHOUT_BLACK = 0.83, 0.68
"""Motion up to which micro images are measured: 0.81 of those that touch and are 8 pixels large. Light that is taken
for black makes it smaller, not the errors."""
_SHARED = 0.6
"""Error of centres over their scatter times that motion, of micro images that touch, in rendered white images."""
_SCENE_LIGHT, _SCENE_SHIFT = 0.12, 0.04
"""Scatter of neighbours' light, and of their distances in pitches, from which on an image shows a scene."""
_SCENE_CONTRAST = 0.2
"""Contrast within micro images from which on it does; boards have 0.5, white images with wide borders 0.1."""
_MIDDLE, _MIN_TILT = 0.4, 0.008
"""Standard deviation of the weights with which the tilt of the light in micro images is measured, over their radius,
and the scatter of the centroid that pixels alone cause."""
_DEGREES, _GAIN = (1, 2, 3, 4, 5, 6), 0.02
"""Degrees of the deviation, and the least relative decrease of the residuals for which a higher one is taken."""
_PASSES, _REWEIGHTINGS, _HUBER = 4, 6, 1.5


def find_micro_images(white: ArrayLike | Exposure | RawImage) -> MicroImageGrid:
    """Find the micro images of a white image, and the lattice on which they lie, without knowledge of the camera.

    Parameters
    ----------
    white : (H, W), (H, W, 1) or (H, W, 3) array_like, Exposure or RawImage
        Image of a uniformly bright surface, not saturated: raw numbers, also behind a Bayer pattern, or linear light.
        Their black level is that of the `RawImage`, 0 for an `Exposure`, and the darkest pixels of an array.

    Returns
    -------
    MicroImageGrid
        With the measured micro images: those that are whole, and whose light and place are those of their neighbours,
        unlike dead microlenses and those under dust. Types are ordered by size. Pixels are those of the image, also
        of one of a region.

    Raises
    ------
    InvalidValueError
        If the image shows no lattice, or a scene, is saturated or too dark, or its micro images overlap by some
        twentieth.

    Notes
    -----
    Steps of the lattice are the peaks of the autocorrelation. From the centre of the image on, centroids are measured
    in the cells of the lattice, and the lattice is fitted to them (least squares with Huber's weights), which gives the
    cells farther out. Its smooth deviation is a polynomial of the degree beyond which centres are predicted no better
    by 2 %. Cells end halfway between centres.

    A centre is that of `microlens_centres(camera, CentreMethod.CENTROID)`: the centroid of the light, which is not that
    of the outline where vignetting or fall-off is uneven. Standard errors are those of the noise in the image; where
    micro images touch, neighbours of defects are left out, and errors contain a share of the scatter of the centres.
    If light within micro images is tilted unlike that of their neighbours, as by the texture of a wall, errors contain
    the displacements that it causes.
    Where they overlap by a tenth and more, what they share may be taken for micro images, and is not always refused.
    Which microlens is (0, 0) is arbitrary: one near the centre of the image.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera(pl.CameraKind.PLENOPTIC_1, shape=(200, 240))
    >>> grid = pl.calibration.find_micro_images(pl.render_white(camera, samples=16, progress=False))
    >>> grid
    MicroImageGrid(HEXAGONAL, pitch 22.011 pixels along columns, rotation 0.00 degrees, 83 centres, 200 x 240 pixels)
    """
    plane = white_plane(white)
    lattice, basis = lattice_of(lattice_steps(plane.light))
    cell = Cell(basis)
    origin = _first_centre(plane, basis, cell)
    for _ in range(_STEPS):
        places = origin + _around(_START) @ basis
        gain = cell.gain(plane, places)
        origin = origin + np.nanmedian(cell.moments(plane, places).centroid - places, axis=0) / (1.0 - gain)
    if gain > (_MAX_GAIN if plane.has_black else _MAX_GAIN_WITHOUT_BLACK):
        raise InvalidValueError(
            "micro images cannot be told from their borders: they overlap, or show a scene; give an image of a uniform "
            "bright surface, with the main lens's stop closed until dark gaps stand between them"
        )
    grid = MicroImageGrid(lattice, origin=origin, basis=basis, shape=plane.light.shape)
    grid = _grow(plane, grid, cell, gain)
    for _ in range(_PASSES):
        nodes = grid.on_sensor
        moments, places = cell.moments(plane, grid.centres_of(nodes)), grid.centres_of(nodes)
        is_lit = moments.light > _MIN_LIGHT * np.nanquantile(moments.light, 0.9)
        if np.count_nonzero(is_lit) < _FEWEST:
            raise InvalidValueError(f"{NO_LATTICE}fewer than {_FEWEST} whole ones are lit")
        index, places, moments = nodes[is_lit], places[is_lit], moments.rows(is_lit)
        pattern = type_pattern(index, np.stack([moments.light, moments.second], axis=1))
        grid = dataclasses.replace(grid, type_pattern=pattern)
        regular = _is_regular(grid, index, moments, gain)
        index, places, moments = index[regular], places[regular], moments.rows(regular)
        centre, error = moments.centroid, moments.error
        grid = _fit_smooth(grid, index, places + (centre - places) / (1.0 - gain), error)
    moments = cell.moments(plane, centre, cell.limits(grid, index, centre))
    is_whole = np.isfinite(moments.light)
    index, moments = index[is_whole], moments.rows(is_whole)
    centre, error = moments.centroid, moments.error
    scatter = _scatter(_differences(grid, index, centre))
    radius = np.sqrt(2.0 * np.maximum(moments.second - 1.0 / 6.0, 0.0))
    contrast = float(np.quantile(_contrasts(plane, centre, 0.5 * float(np.median(radius))), 0.75))
    if contrast > _SCENE_CONTRAST:
        raise InvalidValueError(
            f"the image is not white: light within micro images varies by {100 * contrast:.2g} %; photograph a uniform "
            "bright surface"
        )
    grid = dataclasses.replace(
        grid,
        lattice=lattice_of(grid.basis)[0],
        index=index,
        centre=centre,
        standard_error=np.hypot(
            error, math.hypot(_SHARED * gain * scatter, _texture_shift(plane, index, centre, radius))
        ),
        radius=radius,
    )
    half_light, border = disc_borders(plane.light, grid).T
    types = grid.types_of(index)
    typical = np.array([np.median(radius[types == t]) if t in types else np.nan for t in range(len(border))])
    # Second moments are those of the discs, blurred by their borders and cut at the cells.
    radius = radius * np.where(np.isfinite(half_light), half_light / typical, 1.0)[types]
    border = np.nan_to_num(border) if np.isfinite(border).any() else None
    return dataclasses.replace(grid, radius=radius, border=border)


def _around(steps: int) -> NDArray[np.int64]:
    """Indices (n, 2) of the micro images up to some steps from the first."""
    return np.stack(np.meshgrid(*[np.arange(-steps, steps + 1)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)


def _contrasts(plane: WhitePlane, centre: Floats, radius: float) -> Floats:
    """Standard deviation (n,) of the light around centres, less that of noise, over the mean."""
    light, variance = (np.pad(each, math.ceil(radius) + 1, mode="edge") for each in plane[:2])
    steps = _around(math.ceil(radius))
    pixel = np.rint(centre).astype(np.int64)[:, None] + steps
    inside = np.linalg.norm(pixel - centre[:, None], axis=2) <= radius
    values, noise = (each[tuple(np.moveaxis(pixel + math.ceil(radius) + 1, -1, 0))] for each in (light, variance))
    mean = np.mean(values, axis=1, where=inside)
    excess = np.var(values, axis=1, where=inside) - np.mean(noise, axis=1, where=inside)
    return np.asarray(np.sqrt(np.maximum(excess, 0.0)) / mean)


def _texture_shift(plane: WhitePlane, index: NDArray[np.int64], centre: Floats, radius: Floats) -> float:
    """Scatter of centroids by the texture of a surface, which tilts the light of micro images unlike their neighbours'.

    Light with the relative slope g moves the centroid of a disc by g r^2 / 4, and one with normal weights by g s^2.
    """
    r = float(np.median(radius))
    s = _MIDDLE * r

    def weights(_: slice, offset: Floats) -> Floats:
        return np.asarray(np.exp(-0.5 * (offset**2).sum(axis=-1) / s**2))

    moments = window_moments(plane.light, centre, math.ceil(r), weights, plane.variance)
    tilt = _scatter(neighbour_differences(index, moments.centroid - centre))
    return math.sqrt(max(tilt**2 - float(np.median(moments.error**2)) - _MIN_TILT**2, 0.0)) * r**2 / (4.0 * s**2)


def _first_centre(plane: WhitePlane, basis: Floats, cell: Cell) -> Floats:
    """Place of a micro image near the centre of the image: there light is nearest to the centres of cells."""
    middle = 0.5 * (np.array(plane.light.shape) - 1.0)
    steps = _around(_START)
    trials = np.stack(np.meshgrid(*[np.arange(_TRIALS) / _TRIALS] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    places = middle + trials @ basis
    nodes = (places[:, None] + steps @ basis).reshape(-1, 2)
    moments = cell.moments(plane, nodes)
    about_node = moments.second + ((moments.centroid - nodes) ** 2).sum(axis=1)
    total, light = (
        np.nansum((x * moments.light).reshape(len(trials), -1), axis=1) for x in (about_node, np.ones(len(nodes)))
    )
    with np.errstate(invalid="ignore"):
        spread = total / light
    if np.isnan(spread).all():
        raise InvalidValueError(f"{NO_LATTICE}its centre is dark; give a white image")
    return np.asarray(places[np.nanargmin(spread)])


def _grow(plane: WhitePlane, grid: MicroImageGrid, cell: Cell, gain: float) -> MicroImageGrid:
    """Fit a lattice to micro images farther and farther from its origin."""
    middle, inner, outer = grid.origin, 0.0, (_START + 0.5) * cell.pitch
    reach = np.hypot(*np.maximum(middle, np.array(grid.shape) - middle))
    index, rows = np.zeros((0, 2), dtype=np.int64), np.zeros((0, 5))
    while True:
        nodes = grid.on_sensor
        predicted = grid.centres_of(nodes)
        distance = np.hypot(*(predicted - middle).T)
        is_new = (distance >= inner) & (distance < outer)
        moments = cell.moments(plane, predicted[is_new])
        step = (moments.centroid - predicted[is_new]) / (1.0 - gain)
        centre, is_near = predicted[is_new] + step, np.hypot(*step.T) < _MOST_MISSED * cell.pitch
        measured = np.column_stack([moments.light, centre, moments.error])
        index, rows = np.concatenate([index, nodes[is_new][is_near]]), np.concatenate([rows, measured[is_near]])
        is_lit = rows[:, 0] > _MIN_LIGHT * np.quantile(rows[:, 0], 0.9) if len(rows) else np.zeros(0, dtype=bool)
        count = np.count_nonzero(is_lit)
        if count < _FEWEST:
            raise InvalidValueError(f"{NO_LATTICE}its centre has no {_FEWEST} lit micro images; give a white image")
        degrees = (1, 3) if count > 10 * _FEWEST else (1,)
        grid = _fit_smooth(grid, index[is_lit], rows[is_lit, 1:3], rows[is_lit, 3:], degrees)
        if outer > reach:
            return grid
        inner, outer = outer, _GROWTH * outer


def _is_regular(
    grid: MicroImageGrid, index: NDArray[np.int64], moments: WindowMoments, gain: float
) -> NDArray[np.bool_]:
    """True for micro images with the light and place of their neighbours; raise InvalidValueError for a scene."""
    types = grid.types_of(index)
    typical = np.array([np.median(moments.light[types == t]) for t in range(types.max() + 1)])[types]
    light = np.log(np.maximum(moments.light / typical, _MIN_LIGHT))
    light = neighbour_differences(index, light[:, None])[:, 0]
    offset = _differences(grid, index, moments.centroid)
    distance, scatter, light_scatter = np.hypot(*offset.T), _scatter(offset), _scatter(light)
    if light_scatter > _SCENE_LIGHT or scatter > _SCENE_SHIFT * grid.pitch:
        raise InvalidValueError(
            f"the image is not white: neighbouring micro images differ by {100 * light_scatter:.2g} % in light, and "
            f"their centroids from a lattice by {scatter:.2g} pixels; photograph a uniform bright surface"
        )
    largest = np.hypot(scatter * math.sqrt(2.0), np.hypot(*moments.error.T))
    regular = (distance < _OUTLIER * largest) & (np.abs(light) < _OUTLIER * max(light_scatter, _MIN_SCATTER))
    if gain > _TOUCHING:
        # Micro images that touch lose light to dark neighbours, and get that of missing microlenses.
        low = index.min(axis=0) - 1
        defective = np.zeros(index.max(axis=0) - low + 2, dtype=bool)
        defective[tuple((index - low)[np.abs(light) > _DEFECT].T)] = True
        neighbours = (index - low)[:, None] + _around(1)
        regular &= ~defective[neighbours[..., 0], neighbours[..., 1]].any(axis=1)
    return np.asarray(regular)


def _differences(grid: MicroImageGrid, index: NDArray[np.int64], centre: Floats) -> Floats:
    """Displacements (n, 2) of centres from a grid, less those of their neighbours."""
    return neighbour_differences(index, centre - grid.centres_of(index))


def _scatter(values: Floats) -> float:
    """Standard deviation, by the median."""
    return float(np.median(np.abs(values))) / 0.6745


def _fit_smooth(
    grid: MicroImageGrid, index: NDArray[np.int64], centre: Floats, error: Floats, degrees: tuple[int, ...] = _DEGREES
) -> MicroImageGrid:
    """Fit a lattice, and the deviation of the lowest degree that the centres ask for."""
    counts, fits = {degree: (degree + 1) * (degree + 2) // 2 for degree in degrees}, []
    for degree, count in counts.items():
        if 2 * count < len(index) or degree == 1:
            # High degrees bend steeply, which grids refuse, where few centres hold them.
            with contextlib.suppress(InvalidValueError):
                fits.append((_fit(grid, index, centre, error, degree), count))
    best = fits[0]
    for fit in fits[1:]:
        if _prediction_error(fit, len(index)) < (1.0 - _GAIN) * _prediction_error(best, len(index)):
            best = fit
    return best[0][0]


def _prediction_error(fit: tuple[tuple[MicroImageGrid, float], int], count: int) -> float:
    """Error with which a fit of some terms to `count` centres predicts others (H. Akaike's final prediction error)."""
    return fit[0][1] * math.sqrt((count + fit[1]) / (count - fit[1]))


def _fit(
    grid: MicroImageGrid, index: NDArray[np.int64], centre: Floats, error: Floats, degree: int
) -> tuple[MicroImageGrid, float]:
    """Fit a lattice with a deviation of a degree to centres (n, 2); also the RMS residual, outliers cut.

    By least squares with Huber's weights. The deviation is free of constants and linear functions.
    """
    y, x = grid.sensor_fractions(grid.origin + index @ grid.basis).T
    scale = np.maximum(np.abs(index).max(axis=0), 1)
    i, j = np.indices((degree + 1, degree + 1))
    is_free = (i + j > 1) & (i + j <= degree)
    products = chebyshev.chebvander2d(y, x, [degree, degree])[:, is_free.ravel()]
    design, weight = np.column_stack([np.ones(len(index)), index / scale, products]), np.ones(len(index))
    for _ in range(_REWEIGHTINGS):
        weighted = design * weight[:, None] ** 2
        solution = np.linalg.lstsq(design.T @ weighted, weighted.T @ centre, rcond=None)[0]
        distance = np.hypot(*(centre - design @ solution).T)
        scatter = max(float(np.median(distance)) / 1.1774, 1e-9)
        # Of noise, and of other deviations.
        sigma = np.sqrt(scatter**2 + 0.5 * (error**2).sum(axis=1))
        weight = np.sqrt(np.minimum(_HUBER / np.maximum(distance / sigma, 1e-9), 1.0)) / sigma
    clipped = float(np.sqrt(np.mean(np.minimum(distance, 4.0 * scatter) ** 2)))
    series = np.zeros((degree + 1, degree + 1, 2))
    series[is_free] = solution[3:]
    deviation = series if degree > 1 else None
    fitted = dataclasses.replace(grid, origin=solution[0], basis=solution[1:3] / scale[:, None], deviation=deviation)
    return fitted, clipped
