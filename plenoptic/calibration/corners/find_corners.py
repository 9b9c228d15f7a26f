"""Corners of a checkerboard in the micro images or views of raw images, numbered."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.calibration.corners.board_marks import place_by_marks, without_marks
from plenoptic.calibration.corners.board_numbers import number_points
from plenoptic.calibration.corners.board_plane import BoardPlane
from plenoptic.calibration.corners.corner_fit import CornerFit, Windows, fit_corners
from plenoptic.calibration.corners.patches import UNVIGNETTED, Patches, patches_of
from plenoptic.calibration.corners.saddle_points import saddle_points
from plenoptic.calibration.corners.view_corners import (
    find_view_corners,
    is_blurred_plenoptic_1,
    is_plenoptic_1,
    light_slopes,
)
from plenoptic.calibration.corners.vignetting import cone_displacement
from plenoptic.calibration.corners.virtual_points import VirtualPoints, virtual_points
from plenoptic.calibration.micro_images import find_micro_images
from plenoptic.calibration.observations import Observations, is_in_views
from plenoptic.camera.points.micro_image_grid import MicroImageGrid
from plenoptic.core.display import picture_of
from plenoptic.core.values import Floats, Given, check_kind, value
from plenoptic.errors import InvalidValueError
from plenoptic.optics.sensor.sensor import Sensor
from plenoptic.readout.raw import RawImage
from plenoptic.rendering.exposure import Exposure
from plenoptic.scene.shapes.targets.target import Target

_SEARCH, _WINDOW, _MIN_WINDOW, _SPACING = 0.5, 0.7, 3.0, 0.8
"""Radius of windows over that of micro images, in the search and in the last fit, their least radius in pixels, and
largest one over the distance of neighbouring corners."""
_SIDES = 0.7
"""Distance along rows and columns at which pixels show a corner on all sides, over the blur's standard deviation."""
_MAX_BLUR = 0.2
"""Largest standard deviation of the blur over the distance of neighbouring corners, whose edges are in the way."""
_DISC = 0.545
"""Standard deviation of the normal distribution nearest to an edge that is blurred by a disc, over its radius."""
_NEAR, _OUTLIER = 0.2, 4.0
"""Largest distance of a corner from where its virtual point is seen, in pixels, beyond standard errors."""


@value
class BoardCorners:
    """Corners of a board in the micro images of one raw image, or in the views of an unfocused camera (1.0).

    Parameters
    ----------
    index : (n, 2) array
        Indices of the micro images, as in the `MicroImageGrid`. In views, fractional ones: the corner's position
        between the micro images.
    pixel : (n, 2) array
        Row and column of each corner. In views, those of the view's pixel in a micro image centred at the corner.
    standard_error : (n, 2) array
        Standard errors of rows and columns, by the residuals. In views, those of the position between micro images.
    point : (n,) array of int
        Row of the board's `points`.
    blur : (n,) array
        Radius in pixels of the disc that blurs edges most nearly as the image does.

    Examples
    --------
    See `find_corners`, which makes them.
    """

    index: Given[NDArray[np.int64] | Floats, ArrayLike]
    pixel: Given[Floats, ArrayLike]
    standard_error: Given[Floats, ArrayLike]
    point: Given[NDArray[np.int64], ArrayLike]
    blur: Given[Floats, ArrayLike]

    @property
    def in_views(self) -> bool:
        """True for corners in views; False for corners in micro images."""
        return is_in_views(self.index)

    _repr_html_ = picture_of

    def __len__(self) -> int:
        return len(self.point)

    def __repr__(self) -> str:
        images = "views" if self.in_views else f"{len(np.unique(self.index, axis=0))} micro images"
        return f"BoardCorners({len(self)} corners of {len(np.unique(self.point))} points in {images})"


def find_corners(
    raw: ArrayLike | Exposure | RawImage,
    grid: MicroImageGrid,
    board: Target,
    *,
    white: ArrayLike | Exposure | RawImage | None = None,
) -> BoardCorners:
    """Find the corners of a checkerboard in a raw image, and which of the board each is.

    Nothing is known of the camera but the lattice of its micro images. Corners are found in the micro images of a
    focused camera (2.0), and in the views of an unfocused one (1.0), each of whose micro images holds one point of the
    scene.

    Parameters
    ----------
    raw : (H, W), (H, W, 1) or (H, W, 3) array_like, Exposure or RawImage
        Raw image that shows the whole board, each of its corners in several micro images or views. Of a marked board,
        in micro images, 4 x 4 squares suffice.
    grid : MicroImageGrid
        By `find_micro_images`, of the same camera and focus.
    board : Target
        By `pl.targets.checkerboard` or `pl.targets.marked_checkerboard`; its place does not matter.
    white : as raw, optional
        White image, by which the raw image is divided. Without it only the inner part of micro images is used.

    Returns
    -------
    BoardCorners

    Raises
    ------
    InvalidValueError
        If the image shows no board, another one, or only a part of it whose corners may be several ones; if the
        odds of other parts of a marked board are above 1e-8.

    Notes
    -----
    Candidates are saddle points of the light. A model of the corner is fitted to the pixels around: the product of two
    edges, averaged over pixels and blurred by a normal distribution (7 unknowns). The images of a corner in micro
    images centred at c are at c + (x - c) w; the w at which most neighbouring micro images show it joins them to a
    virtual point x. These are numbered from neighbour to neighbour along the edges; a homography takes the board to
    them, and the virtual depth 1 / w is linear in x. Then the model is fitted again in every micro image that should
    show a corner, without the pixels of marks.

    Marks are read in all micro images together: the coefficient of a bell in the middle of each square, over the mean
    light around. With n squares whose signals have the correlation r with the marks, placements of the lattice on the
    board have probabilities proportional to (1 - r^2)^(1 - n/2), for unknown levels and noise.

    A checkerboard with an odd number of squares along one side and an even one along the other looks different after
    half a turn. If it does not, the turn is chosen with which columns run as those of the raw image do most nearly:
    turn such a board by less than 90 degrees between images. A mirrored raw image is that of a mirrored camera, and is
    not refused; that of a marked board is. Errors are those of the residuals; with blur over half of a micro image,
    true ones are up to twice as large.

    In views, light of the pixels at one offset from the centres of the micro images is taken at the microlenses, where
    the same model is fitted to it. The board is numbered in the view of the centres; the others begin with its corners
    and their disparities. The camera is unfocused if the border of micro images in the white image is narrower than 0.3
    pitches over the mean virtual depth, which is the ratio of the slopes of the light within and between micro images:
    it is 1 pitch over the virtual depth in focus. Where no border shows, the camera is unfocused if the mean virtual
    depth is below 2.5. If its views show no board, as of small squares, micro images are searched. Behind a border of
    less than 3.5 pixels, which may be blur alone, the camera is unfocused if corners in micro images are not sharper.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera(shape=(256, 256))
    >>> board = pl.targets.checkerboard(5, 4, square=1.5, margin=3.0)
    >>> white = pl.render_white(camera, samples=16, progress=False)
    >>> scene = pl.Scene([*board.translated(z=-404).meshes], background=1.0)
    >>> raw = pl.render(scene, camera, samples=64, progress=False)
    >>> grid = pl.calibration.find_micro_images(white)
    >>> corners = pl.calibration.find_corners(raw, grid, board, white=white)
    >>> len(corners) > 150, sorted(set(corners.point.tolist())) == list(range(12))
    (True, True)
    """
    frames, errors = _find_frames([raw], grid, board, white)
    for error in errors.values():
        raise error
    return frames[0]


def _find_frames(
    raws: Sequence[Any], grid: MicroImageGrid, board: Target, white: Any
) -> tuple[list[BoardCorners], dict[int, InvalidValueError]]:
    """Corners of images, all in micro images or all in views, and errors of those that show none, by their numbers."""
    check_kind(grid, "grid", MicroImageGrid, "pl.calibration.find_micro_images(white)")
    shape = corners_of(board)
    slopes = [light_slopes(patches_of(raw, white, grid)[1], grid.basis) for raw in raws]

    def search(in_views: bool) -> tuple[list[BoardCorners], dict[int, InvalidValueError]]:
        frames: list[BoardCorners] = []
        errors: dict[int, InvalidValueError] = {}
        for number, raw in enumerate(raws):
            try:
                frames.append(_corners_in(*patches_of(raw, white, grid), grid, board, shape, in_views))
            except InvalidValueError as error:
                errors[number] = error
        return frames, errors

    is_unfocused = is_plenoptic_1(grid, np.sum(slopes, axis=0))
    frames, errors = search(is_unfocused)
    if is_unfocused:
        # Squares may be too small for views.
        is_other = not frames
    else:
        of_frames = [slope for number, slope in enumerate(slopes) if number not in errors]
        is_other = is_blurred_plenoptic_1(grid, [frame.blur for frame in frames], of_frames)
    others, other_errors = search(not is_unfocused) if is_other else ([], {})
    return (others, other_errors) if others else (frames, errors)


def _corners_in(
    lit: Patches, patches: Patches, grid: MicroImageGrid, board: Target, shape: tuple[int, int], in_views: bool
) -> BoardCorners:
    if in_views:
        if board.marks is not None:
            raise InvalidValueError(
                "the camera is unfocused (1.0), whose views do not tell marks; photograph a board without marks"
            )
        views = find_view_corners(patches, grid.basis, shape)
        pixel = grid.centres_of(views.lattice_index) + views.offset
        return BoardCorners(views.lattice_index, pixel, views.standard_error, views.point, views.sigma / _DISC)
    candidates, image = _candidates(lit)
    centre, radius = patches.centre[image], float(np.median(patches.radius)) * UNVIGNETTED[1]
    points = virtual_points(patches.lattice_index[image], centre, candidates, grid.basis, radius)
    by_marks = None if board.marks is None else partial(place_by_marks, patches, board.marks)
    numbers, plane = number_points(points, shape, by_marks)
    corners, image, point = _fit_all(patches, points, numbers, plane, shape, grid.pitch, board.marks)
    return BoardCorners(
        patches.lattice_index[image], corners.pixel, corners.standard_error, point, corners.sigma / _DISC
    )


def observe(
    raws: Sequence[ArrayLike | Exposure | RawImage],
    white: ArrayLike | Exposure | RawImage,
    board: Target,
    *,
    pixel_pitch: float,
) -> Observations:
    """Observations for `pl.calibrate` from raw images of a board and a white image.

    Parameters
    ----------
    raws : sequence of raw images
        One for each pose of the board, see `find_corners`: all together tell whether corners are in views.
    white : as a raw image
        See `find_micro_images`.
    board : Target
        See `find_corners`.
    pixel_pitch : float
        Distance of pixels in mm.

    Returns
    -------
    Observations

    Raises
    ------
    InvalidValueError
        If an image does not show the board, with the number of the image.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera(shape=(256, 256))
    >>> board = pl.targets.checkerboard(5, 4, square=1.5, margin=3.0)
    >>> white = pl.render_white(camera, samples=16, progress=False)
    >>> scenes = [pl.Scene([*board.translated(z=z).meshes], background=1.0) for z in (-404, -410)]
    >>> raws = [pl.render(scene, camera, samples=64, progress=False) for scene in scenes]
    >>> observations = pl.calibration.observe(raws, white, board, pixel_pitch=0.010)
    >>> observations.frames.tolist(), len(observations.board)
    ([0, 1], 12)
    """
    if isinstance(raws, (Exposure, RawImage)):
        raise InvalidValueError("raws is one raw image; give a list of them, one for each pose of the board")
    if not len(raws):
        raise InvalidValueError("raws is empty; give one raw image or more")
    grid = find_micro_images(white)
    frames, errors = _find_frames(raws, grid, board, white)
    for number, error in errors.items():
        raise InvalidValueError(f"image {number}: {error}")
    for j, k in combinations(range(len(frames)), 2):
        if np.array_equal(frames[j].pixel, frames[k].pixel):
            raise InvalidValueError(f"image {k} is the same as image {j}, which doubles its weight; give it once")
    assert grid.index is not None and grid.centre is not None
    return Observations(
        index=np.concatenate([frame.index for frame in frames]),
        pixel=np.concatenate([frame.pixel for frame in frames]),
        frame=np.repeat(np.arange(len(frames)), [len(frame) for frame in frames]),
        point=np.concatenate([frame.point for frame in frames]),
        board=board.points,
        centre_index=grid.index,
        centre_pixel=grid.centre,
        sensor=Sensor(shape=grid.shape, pixel_pitch=pixel_pitch),
        lattice=grid.lattice,
        blur=None if frames[0].in_views else np.concatenate([frame.blur for frame in frames]),
        standard_error=np.concatenate([frame.standard_error for frame in frames]),
        radius=None if grid.radius is None else float(np.median(grid.radius)),
    )


def corners_of(board: Target) -> tuple[int, int]:
    """Rows and columns of the inner corners of a checkerboard."""
    check_kind(board, "board", Target, "pl.targets.checkerboard(9, 6, square=2.0)")
    if board.index is not None and len(board.index):
        rows, columns = (board.index.max(axis=0) + 1).tolist()
        if np.array_equal(board.index, np.stack(np.divmod(np.arange(rows * columns), columns), axis=1)):
            if board.marks is not None and board.marks.shape != (rows + 1, columns + 1):
                raise InvalidValueError(
                    f"marks of board are {board.marks.shape}; it has {rows + 1} x {columns + 1} squares"
                )
            return rows, columns
    raise InvalidValueError(f"board is {board!r}, no checkerboard; give pl.targets.checkerboard(9, 6, square=2.0)")


def _candidates(patches: Patches) -> tuple[CornerFit, NDArray[np.int64]]:
    """Corners, whatever they belong to, and the micro image of each."""
    saddles = saddle_points(patches)
    size = np.maximum(_SEARCH * patches.radius[saddles.image], _MIN_WINDOW)
    corners = fit_corners(patches.windows(saddles.image, saddles.pixel, size), saddles.pixel, saddles.angle)
    good = _is_corner(patches, corners, saddles.image, saddles.pixel)
    return corners.rows(good), saddles.image[good]


def _is_corner(patches: Patches, corners: CornerFit, image: NDArray[np.int64], start: Floats) -> NDArray[np.bool_]:
    bright = float(np.quantile(patches.light[patches.weight > 0], 0.95))
    # Pixels on all sides show the corner.
    reach = np.maximum(0.5, _SIDES * corners.sigma)
    inside = []
    for direction in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        pixel = np.rint(corners.pixel + np.outer(reach, direction)).astype(np.int64) - patches.corner[image]
        row, column = np.clip(pixel, 0, patches.light.shape[1] - 1).T
        inside.append(patches.weight[image, row, column] > 0)
    return np.asarray(np.all(inside, axis=0) & corners.is_clear(start, bright))


def _fit_all(
    patches: Patches,
    points: VirtualPoints,
    numbers: NDArray[np.int64],
    plane: BoardPlane,
    shape: tuple[int, int],
    pitch: float,
    marks: NDArray[np.bool_] | None,
) -> tuple[CornerFit, NDArray[np.int64], NDArray[np.int64]]:
    """Corners in all micro images that should show them; the micro image and the board's point of each."""
    index = np.stack(np.divmod(np.arange(shape[0] * shape[1]), shape[1]), axis=1)
    position, w = plane.points(index)
    angle = plane.edge_angles(index)
    on_board = numbers[:, 0] >= 0
    number = numbers[on_board] @ (shape[1], 1)
    position[number], w[number] = points.position[on_board], points.w[on_board]
    steps = plane.steps(index)
    spacing = np.abs(w) * np.hypot(*steps.transpose(2, 0, 1)).min(axis=1)
    image, point = patches.visible(position, w)
    start = patches.centre[image] + (position[point] - patches.centre[image]) * w[point, None]
    size = np.clip(_SPACING * spacing[point], _MIN_WINDOW, _WINDOW * patches.radius[image])
    windows = patches.windows(image, start, size)
    if marks is not None:
        windows = without_marks(windows, start, w[point, None, None] * steps[point], index[point], marks)
    corners = fit_corners(windows, start, angle[point])
    good = _is_corner(patches, corners, image, start)
    good &= corners.is_along(angle[point])
    good &= corners.sigma < _MAX_BLUR * spacing[point]
    if not good.any():
        raise InvalidValueError(
            "corners are blurred over more than a third of a square; focus better, or take a board of larger squares"
        )
    corners, image, point, start = corners.rows(good), image[good], point[good], start[good]
    if patches.border.any():
        blur, border, kind = corners.sigma / _DISC, patches.border[image], patches.kind[image]
        displacement = cone_displacement(blur, border, w[point], kind, pitch)
        pixel, light, weight = (part[good] for part in windows)
        pixel = pixel + displacement[:, None, None] * patches.visible_centres(image, pixel)
        corners = fit_corners(Windows(pixel, light, weight), corners.pixel, corners.angle)
        good = _is_corner(patches, corners, image, start)
        corners, image, point, start = corners.rows(good), image[good], point[good], start[good]
    good = np.zeros(len(point), dtype=bool)
    for k in np.unique(point):
        rows = np.flatnonzero(point == k)
        # What remains of the virtual point, and of its depth.
        arm, miss = patches.centre[image[rows]], corners.pixel[rows] - start[rows]
        arm = arm - arm.mean(axis=0)
        error = np.hypot(*corners.standard_error[rows].T)
        shift = np.median(miss, axis=0)
        slope = float(((miss - shift) * arm).sum() / max(float((arm**2).sum()), 1e-12)) if len(rows) > 3 else 0.0
        good[rows] = np.hypot(*(miss - shift - slope * arm).T) < _NEAR + _OUTLIER * error
    return corners.rows(good), image[good], point[good]
