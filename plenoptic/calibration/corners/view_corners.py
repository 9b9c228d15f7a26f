"""Corners of a board in the views of an unfocused camera (1.0), between the microlenses.

Each micro image of such a camera holds one point of the scene. The pixels at one offset q from the centres of the micro
images are a view through one part of the main lens's pupil, sampled at the microlenses. Positions x on the lattice are
in units of the root of a cell's area, along rows and columns of pixels. A corner moves by s (q' - q) from the view q to
the view q'. Light at the pixel nearest to an offset is taken to be that at the offset of a position moved by so much,
so that no light is interpolated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.calibration.corners.board_numbers import number_points
from plenoptic.calibration.corners.board_plane import BoardPlane
from plenoptic.calibration.corners.corner_fit import CornerFit, Windows, fit_corners
from plenoptic.calibration.corners.patches import Patches
from plenoptic.calibration.corners.saddle_points import saddle_points
from plenoptic.calibration.corners.virtual_points import VirtualPoints
from plenoptic.camera.points.micro_image_grid import MicroImageGrid
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.optics.microlens.lattice import rows_of

_FOCUSED, _VIRTUAL_DEPTH = 0.3, 2.5
"""Least width of the border of micro images of focused cameras (2.0) over their pitch and the reciprocal virtual depth
of the board: it is 1 where the board is in focus, and 0 in an unfocused camera (1.0). Without it, the virtual depth
below which corners are in fewer than three micro images, blurred in most cameras by more than half of one."""
_NARROW, _UNFOCUSED = 3.5, 1.1
"""Border in pixels that optics and pixels may blur in an unfocused camera, and ratio of blurs between both cameras."""
_FULL = 0.9
"""Least light of pixels in views over the brightest of their micro image in the white image."""
_WHOLE = 0.5
"""Least part of the usual number of unvignetted pixels in a micro image, and of whole ones in a view."""
_CENTRE = 1.5
"""Radius in pixels of the part of micro images whose mean is the view in which corners are sought and numbered."""
_WINDOW, _SPACING = (3.0, 8.0), 0.8
"""Least and largest radius of windows in microlenses, and radius over the distance of neighbouring corners."""
_NEAR, _OUTLIER = 0.1, 4.0
"""Largest distance of a corner from its place by all views in microlenses, beyond standard errors."""
_REACHES = (0.4, 0.7, 1.0)
"""Offsets of views, over the largest, in rounds of fits: each begins with the disparities of the one before."""


class ViewCorners(NamedTuple):
    """Corners in views, (n, ...)."""

    lattice_index: Floats
    """(n, 2): fractional."""
    offset: NDArray[np.int64]
    """(n, 2): of the view, pixels from the centres of the micro images."""
    point: NDArray[np.int64]
    standard_error: Floats
    """(n, 2): of the position in pixels, along rows and columns."""
    sigma: Floats
    """Standard deviation of the blur in pixels."""


def is_plenoptic_1(grid: MicroImageGrid, slopes: Floats) -> bool:
    """True if the border of micro images and `light_slopes` are those of an unfocused camera (1.0).

    Borders are as wide as the opening of a microlens, out of focus: the pitch over the virtual depth in focus. That is
    infinite in an unfocused camera, whatever the distance of the board.
    """
    within, between = slopes
    if grid.border is None:
        return bool(within < _VIRTUAL_DEPTH**2 * between)
    return bool(np.max(grid.border) ** 2 * within < (_FOCUSED * grid.pitch) ** 2 * between)


def is_blurred_plenoptic_1(grid: MicroImageGrid, blurs: Sequence[Floats], slopes: Sequence[Floats]) -> bool:
    """True if a narrow border of micro images is only blurred, by corners in micro images and `light_slopes` of images.

    Corners of an unfocused camera (1.0) are blurred by their virtual depth v, over a radius of half a pitch over v, and
    by all that blurs the border. Behind focused microlenses (2.0) the border is blurred by their focus, which makes
    corners sharp. With normal blur of up to 0.9 pixels, ratios of corners' blur to the former were 1.13 to 1.4 in 42
    images of unfocused cameras. In 64 of focused ones they were up to 1.0, up to 1.13 at twice their virtual depth in
    focus, and 1.06 to 1.2 behind a border of less than the blur.
    """
    if grid.border is None or np.max(grid.border) > _NARROW:
        return False
    radius = 0.5 * float(np.max(grid.border))
    # Focused microlenses would show the board.
    if not blurs:
        return True
    ratios = [
        float(np.median(blur)) / math.hypot(radius, 0.5 * grid.pitch * math.sqrt(between / within))
        for blur, (within, between) in zip(blurs, slopes, strict=True)
    ]
    return float(np.median(ratios)) > _UNFOCUSED


def light_slopes(patches: Patches, basis: Floats) -> Floats:
    """Sums of squares of the slopes of the light within micro images and from one to the next.

    The virtual depth of light that depends on c + v q, with the centre c of a micro image and the offset q in it, is
    the ratio of its slopes by q and by c.
    """
    lit = patches.weight > 0
    count = lit.sum(axis=(1, 2))
    whole = count > _WHOLE * float(np.median(count))
    if not whole.any():
        return np.zeros(2)
    index, lit, light, count = patches.lattice_index[whole], lit[whole], patches.light[whole], count[whole]
    steps = np.arange(light.shape[1])
    mean = (light * lit).sum(axis=(1, 2)) / count
    within = []
    for along in (steps[:, None], steps):
        arm = (along - ((along * lit).sum(axis=(1, 2)) / count)[:, None, None]) * lit
        within.append((arm * light).sum(axis=(1, 2)) / (arm**2).sum(axis=(1, 2)))
    row = rows_of(index, index[:, None] + np.eye(2, dtype=np.int64))
    inner = (row >= 0).all(axis=1)
    between = np.linalg.solve(basis, (mean[row[inner]] - mean[inner, None]).T)
    return np.array([np.sum(np.array(within)[:, inner] ** 2), np.sum(between**2)])


def find_view_corners(patches: Patches, basis: Floats, shape: tuple[int, int]) -> ViewCorners:
    """Corners of a board with inner corners of this shape in all views. The patches hold unvignetted pixels.

    Raises InvalidValueError if the view of the central pixels does not show the board.
    """
    views = _Views(patches._replace(weight=patches.weight * (patches.white > _FULL)), basis)
    points = _candidates(views)
    numbers, plane = number_points(points, shape)
    index = np.stack(np.divmod(np.arange(shape[0] * shape[1]), shape[1]), axis=1)
    place, _ = plane.points(index)
    on_board = numbers[:, 0] >= 0
    place[numbers[on_board] @ (shape[1], 1)] = points.position[on_board]
    return _track(views, place, plane, index)


class _Views:
    """Views that the pixels of micro images make."""

    def __init__(self, patches: Patches, basis: Floats) -> None:
        self.patches, self.unit = patches, math.sqrt(abs(float(np.linalg.det(basis))))
        self.basis = basis / self.unit
        self.inverse = np.linalg.inv(self.basis)
        self.bright = float(np.quantile(patches.light[patches.weight > 0], 0.95))
        self.first = np.rint(patches.centre).astype(np.int64)

    @property
    def offsets(self) -> NDArray[np.int64]:
        """Offsets (v, 2) at which most micro images have an unvignetted pixel."""
        reach = self.patches.light.shape[1] // 2
        steps = np.arange(-reach, reach + 1)
        q = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
        rows = np.arange(len(self.first))
        fraction = [np.mean(self.pixels(rows, offset)[1] > 0) for offset in q]
        return q[np.array(fraction) > _WHOLE]

    def pixels(self, rows: NDArray[np.int64], offset: NDArray[np.int64]) -> tuple[Floats, Floats]:
        """Light and weights of pixels nearest to offsets (..., 2) in micro images (...)."""
        local = self.first[rows] + offset - self.patches.corner[rows]
        side = self.patches.light.shape[1]
        row, column = np.moveaxis(np.clip(local, 0, side - 1), -1, 0)
        inside = ((local >= 0) & (local < side)).all(axis=-1)
        return self.patches.light[rows, row, column], self.patches.weight[rows, row, column] * inside

    def windows(self, place: Floats, offset: NDArray[np.int64], disparity: Floats, radius: Floats) -> Windows:
        """Windows of radii (n,) around positions (n, 2) in the views of offsets (n, 2), by disparities s (n,)."""
        largest = float(radius.max(initial=0.0)) + 1.0
        # Steps of a hexagonal lattice go twice as far along one axis as positions.
        reach = np.arange(-int(2.0 * largest), int(2.0 * largest) + 1)
        steps = np.stack(np.meshgrid(reach, reach, indexing="ij"), axis=-1).reshape(-1, 2)
        steps = steps[np.hypot(*(steps @ self.basis).T) < largest]
        node = np.rint(place @ self.inverse).astype(np.int64)[:, None] + steps
        row = rows_of(self.patches.lattice_index, node)
        light, weight = self.pixels(row, offset[:, None])
        position = node @ self.basis - disparity[:, None, None] * (self.first - self.patches.centre)[row]
        near = np.hypot(*np.moveaxis(position - place[:, None], 2, 0)) < radius[:, None]
        return Windows(position, light, weight * (near & (row >= 0)))

    def fit(
        self, place: Floats, angle: Floats, offset: NDArray[np.int64], disparity: Floats, radius: Floats
    ) -> tuple[CornerFit, NDArray[np.bool_]]:
        """Corners fitted in views from positions (n, 2) and normals' angles, and True for those that count."""
        corners = fit_corners(self.windows(place, offset, disparity, radius), place, angle)
        return corners, corners.is_clear(place, self.bright) & corners.is_along(angle)


def _candidates(views: _Views) -> VirtualPoints:
    """Corners, whatever they belong to, in the mean of the views nearest to the centre."""
    patches, index = views.patches, views.patches.lattice_index
    low, side = index.min(axis=0), int(np.ptp(index, axis=0).max()) + 1
    row, column = (patches.corner[:, k, None] + np.arange(patches.light.shape[1]) for k in (0, 1))
    arm = np.hypot((row - patches.centre[:, :1])[:, :, None], (column - patches.centre[:, 1:])[:, None])
    weight = patches.weight * (arm < _CENTRE)
    total = weight.sum(axis=(1, 2))
    light, lit = np.zeros((2, 1, side, side))
    light[0][tuple((index - low).T)] = (weight * patches.light).sum(axis=(1, 2)) / np.maximum(total, 1e-300)
    lit[0][tuple((index - low).T)] = total
    # The lattice's indices are an oblique image of it, which keeps saddle points.
    image = Patches(
        low[None], np.zeros((1, 2)), np.full(1, np.inf), low[None], light, lit,
        white=np.ones_like(light), kind=np.zeros(1, dtype=np.int64), border=np.zeros(1),
    )  # fmt: skip
    saddles = saddle_points(image)
    normals = np.stack([np.cos(saddles.angle), np.sin(saddles.angle)], axis=-1) @ views.inverse.T
    place, angle = saddles.pixel @ views.basis, np.arctan2(normals[..., 1], normals[..., 0])
    n = len(place)
    central, flat, radius = np.zeros((n, 2), dtype=np.int64), np.zeros(n), np.full(n, _WINDOW[0])
    corners, good = views.fit(place, angle, central, flat, radius)
    corners = corners.rows(good)
    first, second = corners.angle.T
    bright = 0.5 * np.angle(np.exp(1j * (first + second)))
    opening = 0.5 * np.abs(np.angle(np.exp(1j * (second - first))))
    ones = np.ones(len(bright))
    quadrant = np.stack([bright - opening, bright + opening], axis=1)
    return VirtualPoints(corners.pixel, ones, ones.astype(np.int64), quadrant)


def _track(views: _Views, place: Floats, plane: BoardPlane, index: NDArray[np.int64]) -> ViewCorners:
    """Corners of the board in all views, from their places (p, 2) in the central one."""
    spacing, angles = np.hypot(*plane.steps(index).transpose(2, 0, 1)).min(axis=1), plane.edge_angles(index)
    offsets, disparity = views.offsets, np.zeros(len(place))
    distance = np.hypot(*offsets.T)
    for reach in _REACHES:
        chosen = offsets[distance <= max(1.5, reach * distance.max(initial=0.0))]
        point, view = (each.ravel() for each in np.indices((len(place), len(chosen))))
        q, s = chosen[view], disparity[point]
        radius = np.clip(_SPACING * spacing[point], *_WINDOW)
        start = place[point] + s[:, None] * q
        corners, good = views.fit(start, angles[point], q, s, radius)
        good[good] = _fit_disparities(corners.rows(good), point[good], q[good], place, disparity)
    if not good.any():
        raise InvalidValueError(
            "corners in views are blurred or too near to each other; focus better, or take a board of larger squares"
        )
    corners = corners.rows(good)
    position, error, sigma = (
        corners.pixel @ views.inverse,
        corners.standard_error * views.unit,
        corners.sigma * views.unit,
    )
    return ViewCorners(position, q[good], point[good], error, sigma)


def _fit_disparities(
    corners: CornerFit, point: NDArray[np.int64], offset: NDArray[np.int64], place: Floats, disparity: Floats
) -> NDArray[np.bool_]:
    """Update the places and disparities of points by their corners; True for corners near where these have them."""
    good = np.zeros(len(point), dtype=bool)
    for k in np.unique(point):
        rows = np.flatnonzero(point == k)
        for _ in range(3):
            q, x = offset[rows], corners.pixel[rows]
            arm = q - q.mean(axis=0)
            disparity[k] = (arm * x).sum() / max(float((arm**2).sum()), 1e-12)
            place[k] = x.mean(axis=0) - disparity[k] * q.mean(axis=0)
            miss = np.hypot(*(x - place[k] - disparity[k] * q).T)
            near = miss < _NEAR + _OUTLIER * np.hypot(*corners.standard_error[rows].T)
            if near.all() or not near.any():
                break
            rows = rows[near]
        good[rows] = True
    return good
