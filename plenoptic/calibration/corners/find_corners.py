"""Corners of a checkerboard in the micro images of raw images, numbered."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.calibration.corners.board_marks import without_marks
from plenoptic.calibration.corners.board_numbers import number_points
from plenoptic.calibration.corners.board_plane import BoardPlane
from plenoptic.calibration.corners.corner_fit import CornerFit, fit_corners
from plenoptic.calibration.corners.saddle_points import Patches, saddle_points
from plenoptic.calibration.corners.vignetting import border_blur, cone_displacement
from plenoptic.calibration.corners.virtual_points import VirtualPoints, virtual_points
from plenoptic.calibration.micro_images import find_micro_images
from plenoptic.calibration.observations import Observations
from plenoptic.calibration.white_image import equalise, mean_filter
from plenoptic.camera.points.micro_image_grid import MicroImageGrid
from plenoptic.core.display import picture_of
from plenoptic.core.values import Floats, Given, check_kind, plain_array, value
from plenoptic.errors import InvalidValueError
from plenoptic.optics.microlens.lattice import Lattice, default_pattern
from plenoptic.optics.sensor.sensor import Sensor
from plenoptic.readout.raw import RawImage
from plenoptic.rendering.exposure import Exposure
from plenoptic.scene.shapes.targets.target import Target

_LIT, _UNVIGNETTED = (0.5, 0.95), (0.7, 0.8)
"""Least light of pixels over that of their micro image in the white image, smooth, and, without one, largest distance
from the centre over the radius: for the search and for the last fit."""
_RIM = 1.3
"""Largest distance from the centre at which the border of a micro image is looked for, over its radius."""
_BRIGHT = 0.98
"""Quantile of the light in the window around a micro image that counts as its brightest."""
_SEARCH, _WINDOW, _MIN_WINDOW, _SPACING = 0.5, 0.7, 3.0, 0.8
"""Radius of windows over that of micro images, in the search and in the last fit, their least radius in pixels, and
largest one over the distance of neighbouring corners."""
_BLUR, _MOTION = 0.8, 1.5
"""Blur with which the fit starts, and its largest step from there in pixels."""
_MAX_ERROR, _MIN_SIGNAL, _MIN_CONTRAST, _MIN_SINE = 0.2, 1.5, 0.06, 0.4
"""Of corners that count: largest standard error in pixels, least half contrast over the residuals and over the bright
light, and least sine of the angle between edges."""
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
    """Corners of a board in the micro images of one raw image.

    Parameters
    ----------
    index : (n, 2) array of int
        Indices of the micro images, as in the `MicroImageGrid`.
    pixel : (n, 2) array
        Row and column of each corner.
    standard_error : (n, 2) array
        Standard errors of rows and columns, by the residuals.
    point : (n,) array of int
        Row of the board's `points`.
    blur : (n,) array
        Radius in pixels of the disc that blurs edges most nearly as the image does.

    Examples
    --------
    See `find_corners`, which makes them.
    """

    index: Given[NDArray[np.int64], ArrayLike]
    pixel: Given[Floats, ArrayLike]
    standard_error: Given[Floats, ArrayLike]
    point: Given[NDArray[np.int64], ArrayLike]
    blur: Given[Floats, ArrayLike]

    _repr_html_ = picture_of

    def __len__(self) -> int:
        return len(self.point)

    def __repr__(self) -> str:
        images = len(np.unique(self.index, axis=0))
        return f"BoardCorners({len(self)} corners of {len(np.unique(self.point))} points in {images} micro images)"


def find_corners(
    raw: ArrayLike | Exposure | RawImage,
    grid: MicroImageGrid,
    board: Target,
    *,
    white: ArrayLike | Exposure | RawImage | None = None,
) -> BoardCorners:
    """Find the corners of a checkerboard in the micro images of a raw image, and which of the board each is.

    Nothing is known of the camera but the lattice of its micro images.

    Parameters
    ----------
    raw : (H, W), (H, W, 1) or (H, W, 3) array_like, Exposure or RawImage
        Raw image that shows the whole board, each of its corners in several micro images. Of a marked board
        4 x 4 squares suffice.
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
    not refused; that of a marked board is. Micro images of an unfocused camera (1.0) show no corners, since each holds
    one point of the scene. Errors are those of the residuals; with blur over half of a micro image, true ones are up
    to twice as large.

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
    check_kind(grid, "grid", MicroImageGrid, "pl.calibration.find_micro_images(white)")
    shape = _corners_of(board)
    lit, patches = _patches(raw, white, grid)
    candidates, image = _candidates(lit)
    centre, radius = patches.centre[image], float(np.median(patches.radius)) * _UNVIGNETTED[1]
    points = virtual_points(patches.lattice_index[image], centre, candidates, grid.basis, radius)
    numbers, plane = number_points(points, shape, patches, board.marks)
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
        One for each pose of the board, see `find_corners`.
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
    grid = find_micro_images(white)
    frames = []
    for number, raw in enumerate(raws):
        try:
            frames.append(find_corners(raw, grid, board, white=white))
        except InvalidValueError as error:
            raise InvalidValueError(f"image {number}: {error}") from None
    if not frames:
        raise InvalidValueError("raws is empty; give one raw image or more")
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
        blur=np.concatenate([frame.blur for frame in frames]),
    )


def _corners_of(board: Target) -> tuple[int, int]:
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


def _light(image: Any, name: str, shape: tuple[int, int]) -> Floats:
    """Light above black (H, W)."""
    black: float | None = None
    if isinstance(image, Exposure):
        data, black = image.image, 0.0
    elif isinstance(image, RawImage):
        data, black = image.data, image.black_level
    else:
        data = plain_array(image, name)
    if data.shape[:2] != shape or data.ndim not in (2, 3) or data.shape[2:] not in ((), (1,), (3,)):
        raise InvalidValueError(f"{name} has shape {data.shape}; the micro images are those of {shape[0]} x {shape[1]}")
    plane = data.astype(np.float64).reshape(*shape, -1).mean(axis=2)
    if not np.isfinite(plane).all():
        raise InvalidValueError(f"{name} holds values that are not finite; correct them")
    return np.asarray(plane - (np.percentile(plane, 0.1) if black is None else black))


def _patches(raw: Any, white: Any, grid: MicroImageGrid) -> tuple[Patches, Patches]:
    """Micro images with their lit pixels, and with those that are not vignetted."""
    light = _light(raw, "raw", grid.shape)
    gain = np.ones(grid.shape)
    if white is None:
        equalise(light)
    else:
        gain = _light(white, "white", grid.shape)
        light = light / np.maximum(gain, 1e-3 * np.percentile(gain, 99))
        equalise(gain)
    index = grid.on_sensor
    (kind, radius), centre = _kinds(grid, index), grid.centres_of(index)
    reach = int(np.ceil(radius.max() + 1.0))
    corner = np.rint(centre).astype(np.int64) - reach
    row, column = (corner[:, k, None] + np.arange(2 * reach + 1) for k in (0, 1))
    distance = np.hypot(row[:, :, None] - centre[:, 0, None, None], column[:, None] - centre[:, 1, None, None])
    at = np.clip(row, 0, grid.shape[0] - 1)[:, :, None], np.clip(column, 0, grid.shape[1] - 1)[:, None]
    on_sensor = ((row >= 0) & (row < grid.shape[0]))[:, :, None] & ((column >= 0) & (column < grid.shape[1]))[:, None]
    weight = gain[at] * on_sensor
    smooth = mean_filter(np.pad(gain, 1, mode="edge"))[at]
    bright = np.maximum(np.quantile(smooth.reshape(len(smooth), -1), _BRIGHT, axis=1), 1e-300)[:, None, None]
    lit, unvignetted = (
        weight * ((smooth > least * bright) & (distance < (part if white is None else 1.1) * radius[:, None, None]))
        for least, part in (_LIT, _UNVIGNETTED)
    )
    visible, border = gain[at] / bright, np.zeros(len(index))
    if white is not None:
        border = border_blur(visible * (distance < _RIM * radius[:, None, None]))
        border = np.array([np.median(border[kind == k]) for k in range(int(kind.max()) + 1)])[kind]
    patches = Patches(index, centre, radius, corner, light[at], lit, visible, kind, border)
    return patches, patches._replace(weight=unvignetted)


def _kinds(grid: MicroImageGrid, index: NDArray[np.int64]) -> tuple[NDArray[np.int64], Floats]:
    """Type (n,) of micro images, also where images of types are alike, and the median radius of the type."""
    pattern = grid.type_pattern
    if not pattern.max():
        pattern = default_pattern(3 if grid.lattice is Lattice.HEXAGONAL else 2)
    kind = pattern[tuple(np.mod(index, pattern.shape).T)]
    if grid.radius is None or grid.index is None:
        return kind, np.full(len(index), 0.42 * grid.pitch)
    measured = pattern[tuple(np.mod(grid.index, pattern.shape).T)]
    return kind, np.array([np.median(grid.radius[measured == k]) for k in range(int(pattern.max()) + 1)])[kind]


def _candidates(patches: Patches) -> tuple[CornerFit, NDArray[np.int64]]:
    """Corners, whatever they belong to, and the micro image of each."""
    saddles = saddle_points(patches)
    size = np.maximum(_SEARCH * patches.radius[saddles.image], _MIN_WINDOW)
    corners = fit_corners(patches.windows(saddles.image, saddles.pixel, size), saddles.pixel, saddles.angle, _BLUR)
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
    with np.errstate(invalid="ignore"):
        return np.asarray(
            np.all(inside, axis=0)
            & (corners.standard_error.max(axis=1) < _MAX_ERROR)
            & (np.hypot(*(corners.pixel - start).T) < _MOTION)
            & (corners.contrast > _MIN_SIGNAL * corners.residual)
            & (corners.contrast > _MIN_CONTRAST * bright)
            & (np.abs(np.sin(corners.angle[:, 1] - corners.angle[:, 0])) > _MIN_SINE)
        )


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
    corners = fit_corners(windows, start, angle[point], _BLUR)
    good = _is_corner(patches, corners, image, start)
    good &= np.cos(corners.angle.sum(axis=1) - angle[point].sum(axis=1)) > 0.5
    good &= corners.sigma < _MAX_BLUR * spacing[point]
    if not good.any():
        raise InvalidValueError(
            "corners are blurred over more than a third of a square; focus better, or take a board of larger squares"
        )
    corners, image, point, start, size = corners.rows(good), image[good], point[good], start[good], size[good]
    if patches.border.any():
        displacement = cone_displacement(
            corners.sigma / _DISC, patches.border[image], w[point], patches.kind[image], pitch
        )
        windows = patches.windows(image, corners.pixel, size, displacement)
        corners = fit_corners(windows, corners.pixel, corners.angle, _BLUR)
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
