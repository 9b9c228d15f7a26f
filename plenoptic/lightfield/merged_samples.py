"""Views of a plenoptic 1.0 camera from the samples of all its views, each at the disparity of the surface it shows."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.parallel import thread_count
from plenoptic.core.values import Floats
from plenoptic.lightfield.focused.splats import OVERSHOOT, Grid, Splats, sort_splats, splat_picture
from plenoptic.lightfield.raw_arrays import corners
from plenoptic.lightfield.view_model import ViewModel

_PIXEL = 1.0 / 12.0
"""Variance of a pixel along each axis."""
_WIDTH = 0.15
"""Least standard deviation of the windows' weights, in pixels of a view; wider ones blur waves of two pixels."""
_MAP_AREA = 0.25
"""Area of a pixel of the disparity map, in units that make its windows 0.6 pixels wide."""
_MIN_COVERAGE = 0.5
"""Minimum coverage by the disparity map of a position where its surface is visible."""
_MIXED_WEIGHT = 0.05
"""Weight of samples with light of two surfaces."""


class LensReadings(NamedTuple):
    """Views (U, V) at n microlenses, read at `offsets` (2, views) along columns and rows from their centres."""

    radiance: Floats
    """(U, V, n, C)."""
    variance: Floats
    centres: Floats
    """(n, 2): row and column of the raw image."""
    offsets: Floats

    def footprint(self, u: int, v: int) -> Floats:
        """Variance (2, n) of the pixels that are read for a view, along columns and rows, in pixels."""
        fraction = (self.centres[:, ::-1].T + self.offsets[[0, 1], [u, v], None]) % 1.0
        # Of a pixel, and of two of them with the weights 1 - t and t.
        return np.asarray(1.0 / 12.0 + fraction * (1.0 - fraction))

    def aperture_blur(self, u: int, v: int) -> tuple[Floats, Floats]:
        """Excess (n, C) of a view over the radiance at its point of the pupil, and the variance of that.

        A view is a mean over some pixels of the micro image: half their variance times the second derivative, from the
        neighbouring views; 0 without them.
        """
        blur, variance = np.zeros((2, *self.radiance.shape[2:]))
        for axis, spread in enumerate(self.footprint(u, v)):
            views, errors = (np.moveaxis(plane, axis, 0)[:, (v, u)[axis]] for plane in (self.radiance, self.variance))
            middle = min(max((u, v)[axis], 1), len(views) - 2)
            if len(views) > 2:
                half = 0.5 * spread[:, None] / (self.offsets[axis, 1] - self.offsets[axis, 0]) ** 2
                second = views[middle - 1] - 2.0 * views[middle] + views[middle + 1]
                blur += half * np.nan_to_num(second)
                error = errors[middle - 1] + 4.0 * errors[middle] + errors[middle + 1]
                variance += half**2 * np.nan_to_num(error)
        return blur, variance


class MergedView(NamedTuple):
    """View (rows, columns, C) from the samples of all views, its variance by noise, and its prediction of lenses.

    The variance is infinite beside depth edges.
    """

    picture: Floats
    variance: Floats
    at_lenses: Floats
    """(n, C): radiance at the microlenses, from the samples of the other ones."""
    lens_variance: Floats


def view_renderer(
    camera: PlenopticCamera,
    model: ViewModel,
    readings: LensReadings,
    position: Floats,
    disparity: Floats,
    opening: float,
) -> Callable[[tuple[int, int]], MergedView]:
    """Function that renders the merged view of an index (u, v).

    Microlenses lie at rows and columns `position` (n, 2) of a view, and their openings have a variance in pixels of a
    view along each axis. The disparity (rows, columns) is that of the central view, traced.
    """
    lit = (model.light > 0) & np.isfinite(readings.radiance).any(axis=(2, 3))
    views = [(int(u), int(v)) for u, v in np.argwhere(lit)]
    # Images of one surface differ by up to a pixel in the outermost views.
    largest = float(np.linalg.norm(model.step[lit] - model.step[model.centre], axis=-1).max(initial=0.0))
    depth, modelled = 1.0 / max(largest, 1e-9), model.traced_disparity(1).inverse(disparity)
    visible = [_visible_disparity(model, view, modelled, position, depth) for view in views]
    d, weight = np.array(visible).reshape(len(views), 2, len(position)).swapaxes(0, 1)
    centred = np.array([model.model_positions(view, position, d[k]) for k, view in enumerate(views)])
    centred = centred.reshape(*d.shape, 2)
    radiance, variance = (plane[lit].reshape(d.size, -1) for plane in (readings.radiance, readings.variance))
    d[~np.isfinite(readings.radiance[lit]).all(axis=-1)] = np.nan
    lenses_per_pixel = len(position) / math.prod(model.size)
    area = 1.0 / (lenses_per_pixel * np.maximum(np.isfinite(readings.radiance[lit][..., 0]).sum(axis=0), 1))
    # As `footprints` has it for focused cameras.
    assert camera.microlenses is not None
    focal_length = camera.microlenses.focal_lengths_at(camera.wavelength)[0]
    vergence = model.vergence + 1.0 / camera.microlenses_to_sensor - 1.0 / focal_length
    reading = np.array([readings.footprint(*view).mean(axis=0) for view in views]).reshape(d.shape)
    spread = opening * (1.0 - vergence * d / model.per_lever) ** 2 + d**2 * reading
    samples = Splats(
        first=np.empty(0, dtype=np.int64),
        offset=np.empty((0, 2)),
        nearness=d.ravel(),
        disparity=d.ravel(),
        weight=weight.ravel(),
        area=np.broadcast_to(area, d.shape).ravel(),
        pixel=np.full(d.size, 2.0 * _PIXEL),
        spread=spread.ravel(),
        radiance=radiance,
        variance=variance,
        lens=np.broadcast_to(np.arange(len(position)), d.shape).ravel(),
    )
    # With all samples on one side of a pixel, the fitted function may diverge.
    low, high = (bound(radiance, axis=0, where=np.isfinite(radiance), initial=0.0) for bound in (np.min, np.max))
    grid, threads = Grid((0, 0), model.size, 1.0), thread_count(None)

    def render(view: tuple[int, int]) -> MergedView:
        splats = _sort(samples, grid, model.seen_at(view, centred, d, position))
        pixels, lenses = (
            splat_picture(splats, grid, depth, float(np.median(area)), 6, threads, width=_WIDTH, points=points)
            for points in (None, position[:, None])
        )
        assert pixels.variance is not None and lenses.variance is not None
        picture = np.clip(pixels.picture, low, high + OVERSHOOT * (high - low))
        # Beside an edge, the disparity of samples with light of both surfaces is unknown.
        padded = np.pad(pixels.disparity, 1, mode="edge")
        windows = np.lib.stride_tricks.sliding_window_view(padded, (3, 3))
        edge = ~(np.ptp(windows, axis=(-2, -1)) <= depth)
        noise = np.where(edge[..., None], np.inf, pixels.variance)
        return MergedView(picture, noise, lenses.picture[:, 0], lenses.variance[:, 0])

    return render


def _visible_disparity(
    model: ViewModel, view: tuple[int, int], disparity: Floats, position: Floats, depth: float
) -> tuple[Floats, Floats]:
    """Disparity (n,) of the surface visible at positions (n, 2) of a view, nan if unknown, and weights of samples.

    `disparity` (rows, columns) is the model's, of the central view.
    """
    grid, d, ones = Grid((0, 0), model.size, 1.0), disparity.ravel(), np.ones(disparity.size)
    pixels = np.indices(model.size).reshape(2, -1).T.astype(np.float64)
    in_view = model.seen_at(view, model.model_positions(model.centre, pixels, d), d, pixels)
    variance = _PIXEL * ones
    central = Splats(np.empty(0, np.int64), np.empty((0, 2)), d, d, ones, ones, variance, variance, d[:, None], None)
    canvas = splat_picture(_sort(central, grid, in_view), grid, depth, _MAP_AREA, 1, thread_count(None))
    row, column, weight = corners(position, model.size)
    corner_disparity = np.where(canvas.coverage >= _MIN_COVERAGE, canvas.disparity, np.nan)[row, column]
    nearest = np.take_along_axis(corner_disparity, weight.argmax(axis=1)[:, None], axis=1)
    is_surface = np.abs(corner_disparity - nearest) <= depth
    weight = np.where(is_surface, weight, 0.0)
    with np.errstate(invalid="ignore"):
        mean = (weight * np.where(is_surface, corner_disparity, 0.0)).sum(axis=1) / weight.sum(axis=1)
    return mean, np.where(is_surface.all(axis=1), 1.0, _MIXED_WEIGHT)


def _sort(samples: Splats, grid: Grid, position: Floats) -> Splats:
    return sort_splats(grid, position[..., ::-1].reshape(-1, 2) * (-1.0, 1.0), samples)
