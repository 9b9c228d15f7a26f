"""Corners of boards in views, in the files of the Light Field Toolbox (`NAME__CheckerCorners.mat`).

A view pixel (k, l) of the Toolbox, counted from 1, is at (k - 1) / scale microlenses to the right of the first one and
l - 1 rows below it, and a view (i, j) at an offset from the centres of the micro images, both along the rows of
microlenses. Raw images whose rows of microlenses run along columns are turned by a quarter counter-clockwise, as by
`pl.export.lftoolbox`.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic import __version__
from plenoptic.calibration.corners.find_corners import BoardCorners, corners_of
from plenoptic.calibration.grid_files import toolbox_model
from plenoptic.calibration.observations import Observations
from plenoptic.camera.points.micro_image_grid import MicroImageGrid
from plenoptic.core.files.array_files import matlab_5, matlab_values
from plenoptic.core.files.atomic_file import write_file
from plenoptic.core.files.file_limits import DEFAULT, FileLimits, content_errors, read_file
from plenoptic.core.values import Floats, check_kind, file_path, length_in_mm
from plenoptic.errors import FileError, InvalidValueError
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.sensor.sensor import Sensor
from plenoptic.scene.shapes.targets.target import Target

_SQUARE_PIXELS = 2.0 / math.sqrt(3.0)
"""Pixels of views per microlens of a row of a hexagonal array."""
_SAME_STEPS, _SAME_PLACE = 0.02, 0.3
"""Largest difference of the grid model from a grid, in steps of the lattice and in pitches."""
_OFF_VIEW = 0.1
"""Largest distance in pixels of a view of turned pixels from one of the file."""
_NUMBERS = ("HSpacing", "VSpacing", "HOffset", "VOffset", "Rot", "FirstPosShiftRow", "VMax")
_LARGEST = 1e6
"""Largest of these numbers, and of positions, in files."""
_CORNERS, _MODEL, _OPTIONS = "CheckerCorners", "LensletGridModel", "DecodeOptions"


class _ViewPixels(NamedTuple):
    """Places (x, y) of microlenses in the turned raw image, and lattice indices of a grid that they have."""

    turned_columns: int | None
    """Columns of the raw image that was turned; None for one that is as it was."""
    turn: Floats
    """(2, 2) from (x, y) along the rows of microlenses to (x, y) of the image."""
    first: Floats
    """(2,) x and y of the first pixel of the views."""
    spacing: Floats
    """(2,) distances of neighbouring pixels of views."""
    origin: Floats
    """(row, column) of a microlens near the middle of the raw image by the model."""
    node: NDArray[np.int64]
    """Its indices in the grid."""
    to_index: Floats
    """(2, 2) from rows and columns in the raw image to lattice indices."""

    def raw_vectors(self, xy: Floats) -> Floats:
        """Rows and columns in the raw image of vectors (n, 2) along the rows of microlenses."""
        x, y = (xy @ self.turn.T).T
        return np.column_stack([y, x] if self.turned_columns is None else [x, -y])

    def vectors(self, raw: Floats) -> Floats:
        """Vectors (n, 2) along the rows of microlenses of rows and columns in the raw image."""
        row, column = raw.T
        return np.column_stack([column, row] if self.turned_columns is None else [row, -column]) @ self.turn

    @property
    def corner(self) -> Floats:
        """Row and column in the raw image of the first pixel of the views."""
        x, y = self.first
        return np.array([y, x] if self.turned_columns is None else [x, self.turned_columns - 1 - y])

    def positions(self, kl: Floats) -> tuple[Floats, Floats]:
        """Lattice indices (n, 2), and rows and columns of their micro images, of pixels of views."""
        place = self.corner + self.raw_vectors((kl - 1.0) * self.spacing)
        return self.node + (place - self.origin) @ self.to_index, place

    def pixels(self, index: NDArray[Any]) -> Floats:
        """Pixels (n, 2) of views at lattice indices."""
        place = self.origin + (index - self.node) @ np.linalg.inv(self.to_index)
        return self.vectors(place - self.corner) / self.spacing + 1.0


def write_lftoolbox_corners(
    path: str | os.PathLike[str], corners: BoardCorners, grid: MicroImageGrid, board: Target
) -> None:
    """Write the corners of a board in the views of a raw image for the Light Field Toolbox.

    Parameters
    ----------
    path : path-like
        Such as `IMG_0001__CheckerCorners.mat`, one file for each raw image.
    corners : BoardCorners
        In views, by `find_corners`.
    grid : MicroImageGrid
        In which they were found.
    board : Target
        By `pl.targets.checkerboard`.

    Raises
    ------
    InvalidValueError
        If corners are in micro images, or no view has all, or the array is turned against the pixels.
    FileError
        If the file cannot be written.

    Notes
    -----
    `CheckerCorners{j, i}` holds x and y of the corners in pixels of the view, counted from 1, column by column of the
    board from the upper left; [] for views without all corners, which the Toolbox does not use. `LensletGridModel` and
    `DecodeOptions.OutputScale` say where views and their pixels are in the raw image. Errors are left out.

    Examples
    --------
    >>> import pathlib, tempfile, numpy as np, plenoptic as pl
    >>> grid = pl.calibration.MicroImageGrid(pl.Lattice.SQUARE, origin=(5.0, 5.0), basis=[(0, -10), (10, 0)],
    ...     shape=(200, 300))
    >>> board = pl.targets.checkerboard(4, 3, square=3.0)
    >>> index = np.array([(-8.25 - 3 * column, 5.5 + 3 * row) for row in range(2) for column in range(3)])
    >>> pixel = grid.centres_of(index) + [1, -2]
    >>> corners = pl.calibration.BoardCorners(index, pixel, np.full((6, 2), 0.1), np.arange(6), np.zeros(6))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "shot__CheckerCorners.mat"
    ...     pl.calibration.write_lftoolbox_corners(path, corners, grid, board)
    ...     pl.calibration.read_lftoolbox_corners([path], grid, board, pixel_pitch=0.0014)
    Observations(6 corners in 1 frame, 6 board points, 600 centres)
    """
    check_kind(corners, "corners", BoardCorners, "pl.calibration.find_corners(raw, grid, board)")
    check_kind(grid, "grid", MicroImageGrid, "pl.calibration.find_micro_images(white)")
    file, shape = file_path(path), corners_of(board)
    if not corners.in_views:
        raise InvalidValueError("corners are in micro images; the Light Field Toolbox knows those in views")
    model, scale = _model_of(grid), np.ones(4)
    if grid.lattice is Lattice.HEXAGONAL:
        scale[2:] = _SQUARE_PIXELS
    views = _view_pixels(model, scale, grid)
    offset = views.vectors(np.rint(corners.pixel - grid.centres_of(corners.index)))
    view = np.rint(offset).astype(np.int64)
    if np.abs(offset - view).max() > _OFF_VIEW:
        raise InvalidValueError(
            f"the array is turned by {math.degrees(model['Rot']):.2f} degrees against the pixels; the Light Field "
            "Toolbox knows views along rows of microlenses alone"
        )
    reach, kl, count = int(np.abs(view).max()), views.pixels(corners.index), math.prod(shape)
    cells = np.empty((2 * reach + 1, 2 * reach + 1), dtype=object)
    for i, j in np.ndindex(cells.shape):
        rows = np.flatnonzero((view == (j - reach, i - reach)).all(axis=1))
        cells[i, j] = np.zeros((0, 0))
        if len(rows) == count == len(np.unique(corners.point[rows])):
            grid_of_points = kl[rows[np.argsort(corners.point[rows])]].reshape(*shape, 2)
            cells[i, j] = _from_upper_left(grid_of_points).reshape(-1, 2)
    if not any(cell.size for cell in cells.flat):
        raise InvalidValueError(f"no view has all {count} corners of the board; photograph the whole board")
    content = {
        "GeneratedByInfo": {"mfilename": "plenoptic", "time": "", "VersionStr": __version__},
        _CORNERS: cells,
        "LFSize": np.array([*cells.shape, model["VMax"], math.ceil(model["UMax"] * scale[2]), 4.0]),
        "CamInfo": {"CamSerial": "", "CamModel": "plenoptic", "FocusStep": 0.0, "ZoomStep": 0.0},
        _MODEL: model,
        _OPTIONS: {"OutputScale": scale, "NColChans": 3.0, "NWeightChans": 1.0},
    }
    write_file(file, matlab_5(content))


def read_lftoolbox_corners(
    paths: Sequence[str | os.PathLike[str]],
    grid: MicroImageGrid,
    board: Target,
    *,
    pixel_pitch: float,
    limits: FileLimits = DEFAULT,
) -> Observations:
    """Read corners that the Light Field Toolbox found in the views of raw images, as observations for `pl.calibrate`.

    Parameters
    ----------
    paths : sequence of path-like
        Files `NAME__CheckerCorners.mat` of versions 5 and 7, one for each pose of the board.
    grid : MicroImageGrid
        Micro images of the white image of the same camera and focus, better measured ones by `find_micro_images`.
    board : Target
        By `pl.targets.checkerboard`; the Toolbox's ExpectedCheckerSize are its corners along x and y.
    pixel_pitch : float
        Distance of the raw image's pixels in mm.
    limits : FileLimits
        The size of each file.

    Returns
    -------
    Observations
        Of views with all corners. Columns of the board run as those of the raw image do most nearly.

    Raises
    ------
    InvalidValueError
        If the grid is not that of the files.
    FileError
        If a file is missing, or holds no corners.

    References
    ----------
    D. G. Dansereau, O. Pizarro, S. B. Williams, CVPR 2013, doi:10.1109/CVPR.2013.137.

    Examples
    --------
    See `write_lftoolbox_corners`.
    """
    check_kind(grid, "grid", MicroImageGrid, "pl.calibration.find_micro_images(white)")
    if isinstance(paths, (str, os.PathLike)) or not len(paths):
        raise InvalidValueError("paths is a path, or none; give a list of them, one for each pose of the board")
    files, shape = [file_path(path) for path in paths], corners_of(board)
    parts = [_read_corners(file, grid, shape, limits) for file in files]
    nodes = grid.on_sensor if grid.index is None else grid.index
    return Observations(
        index=np.concatenate([index for index, _ in parts]),
        pixel=np.concatenate([pixel for _, pixel in parts]),
        frame=np.repeat(np.arange(len(parts)), [len(index) for index, _ in parts]),
        point=np.concatenate([np.arange(len(index)) % len(board.points) for index, _ in parts]),
        board=board.points,
        centre_index=nodes,
        centre_pixel=grid.centres_of(nodes) if grid.centre is None else grid.centre,
        sensor=Sensor(shape=grid.shape, pixel_pitch=length_in_mm(pixel_pitch, "pixel_pitch")),
        lattice=grid.lattice,
    )


def _read_corners(file: Any, grid: MicroImageGrid, shape: tuple[int, int], limits: FileLimits) -> tuple[Floats, Floats]:
    """Lattice indices and pixels of all corners of the board in each view that has all."""
    with content_errors(file, "holds no corners of the Light Field Toolbox"):
        content = matlab_values(read_file(file, limits), (_CORNERS, _MODEL, _OPTIONS), limits)
        cells, model = content[_CORNERS], content[_MODEL]
        if str(model["Orientation"]) != "horz" or cells.dtype != object or cells.ndim != 2:
            raise ValueError("CheckerCorners are no cells, or rows of microlenses do not run along x")
        numbers = {name: float(np.squeeze(model[name])) for name in _NUMBERS}
        is_small = all(abs(each) < _LARGEST for each in numbers.values())
        if not (is_small and min(numbers["HSpacing"], numbers["VSpacing"]) >= 1):
            raise ValueError("its microlenses are less than a pixel apart, or too many")
        scale = np.ravel(content[_OPTIONS].get("OutputScale", np.ones(4)))
        complete = {
            view: cell.astype(np.float64)
            for view, cell in np.ndenumerate(cells)
            if cell.shape == (math.prod(shape), 2) and (np.abs(cell) < _LARGEST).all()
        }
        if not (complete and len(scale) == 4 and ((scale > 1 / _LARGEST) & (scale < _LARGEST)).all()):
            raise FileError(f"{str(file)!r} has no view with all {math.prod(shape)} corners of the board")
    views, middle = _view_pixels(numbers, scale, grid), 0.5 * (np.array(cells.shape) - 1.0)
    indices, pixels = [], []
    for view, kl in complete.items():
        index, place = views.positions(kl)
        order = _by_rows(place, shape)
        offset = views.raw_vectors((np.subtract(view, middle)[::-1] / scale[:2])[None])
        indices.append(index[order])
        pixels.append(place[order] + offset)
    return np.concatenate(indices), np.concatenate(pixels)


def _model_of(grid: MicroImageGrid) -> dict[str, Any]:
    """`LensletGridModel` of the raw image, turned if its rows of microlenses run along columns."""
    if not grid.is_along_rows:
        (row, column), (rows, columns) = grid.origin, grid.shape
        basis = np.column_stack([-grid.basis[:, 1], grid.basis[:, 0]])
        grid = MicroImageGrid(grid.lattice, origin=(columns - 1 - column, row), basis=basis, shape=(columns, rows))
    return toolbox_model(grid)


def _view_pixels(model: Mapping[str, Any], scale: Floats, grid: MicroImageGrid) -> _ViewPixels:
    """Pixels of views by a grid model, in the numbers of a grid; raise InvalidValueError if these differ."""
    h, v, x, y, angle, shifted, lines = (float(model[name]) for name in _NUMBERS)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    turned_columns = None if grid.is_along_rows else grid.shape[1]
    nothing = np.zeros((0, 2), dtype=np.int64)
    spacing = np.array([h / scale[2], v])
    views = _ViewPixels(turned_columns, turn, np.array([x, y]) - 1.0, spacing, np.zeros(2), nothing, np.eye(2))
    is_hexagonal = shifted <= lines
    steps = views.raw_vectors(np.array([[h, 0.0], [0.5 * h * is_hexagonal, v], [0.5 * h * (shifted == 1), 0.0]]))
    basis, origin, middle = steps[:2], views.corner + steps[2], 0.5 * (np.array(grid.shape) - 1.0)
    origin = origin + np.rint((middle - origin) @ np.linalg.inv(basis)) @ basis
    ratio = basis @ np.linalg.inv(grid.basis)
    node, whole = grid.indices_of(origin), np.rint(ratio)
    distance = math.dist(grid.centres_of(node), origin) / grid.pitch
    if np.abs(ratio - whole).max() > _SAME_STEPS or distance > _SAME_PLACE:
        raise InvalidValueError(
            f"the files are of another array than the grid: neighbours are {h:.4g} and {grid.pitch:.4g} pixels apart, "
            f"and microlenses {distance:.2f} pitches beside those of the grid; give the grid of their white image"
        )
    return views._replace(origin=origin, node=node, to_index=np.asarray(np.linalg.inv(basis) @ whole))


def _from_upper_left(points: Floats) -> Floats:
    """Points (rows, columns, 2) of a board in x and y, as (columns, rows, 2) from the upper left of the view."""
    along = np.abs((points[:, -1] - points[:, 0]).mean(axis=0))
    if along[0] > along[1]:
        points = points.transpose(1, 0, 2)
    right, down = (points[-1] - points[0]).mean(axis=0)[0], (points[:, -1] - points[:, 0]).mean(axis=0)[1]
    return points[:: 1 if right > 0 else -1, :: 1 if down > 0 else -1]


def _by_rows(place: Floats, shape: tuple[int, int]) -> NDArray[np.int64]:
    """Order (n,) of corners, at rows and columns (n, 2) of the raw image, by row and column of the board.

    They are listed along one side of the board after another, which side and direction first may be any.
    """
    rows, columns = shape
    trials = [np.arange(rows * columns).reshape(columns, rows).T, np.arange(rows * columns).reshape(shape)]
    if rows != columns:
        twists = [np.abs(np.diff(np.diff(place[each], axis=0), axis=1)).sum() for each in trials]
        trials = [trials[int(np.argmin(twists))]]
    rightwards = [(place[each[:, -1]] - place[each[:, 0]]).mean(axis=0)[1] for each in trials]
    best = int(np.argmax(np.abs(rightwards)))
    order = trials[best][:, :: 1 if rightwards[best] > 0 else -1]
    along, across = ((place[b] - place[a]).mean(axis=0) for a, b in (
        (order[:, 0], order[:, -1]), (order[0], order[-1]),
    ))  # fmt: skip
    # As the board shows its face, rows follow columns clockwise.
    return order[:: 1 if along[1] * across[0] - along[0] * across[1] > 0 else -1].ravel()
