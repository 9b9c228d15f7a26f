"""Corners in views in the files of the Light Field Toolbox: what is written is read again, and calibrates."""

import numpy as np
import pytest
from calibration_helpers import NOMINAL, SENSOR, P, parameters_1_0, simulated_views
from test_grid_files import HEXAGONAL, SQUARE, a_grid

import plenoptic as pl
from plenoptic.core.files.array_files import matlab_5, matlab_values
from plenoptic.core.files.file_limits import DEFAULT
from plenoptic.errors import FileError, InvalidValueError

BOARD = pl.targets.checkerboard(5, 4, square=3.0)
read, write = pl.calibration.read_lftoolbox_corners, pl.calibration.write_lftoolbox_corners


def corners_in_views(grid, degrees=10.0, disparity=0.3, radius=2):
    """A board of 15 pixels a square, turned, whose corners move from view to view."""
    angle = np.radians(degrees)
    x, y = 1.6 * grid.pitch * BOARD.points[:, :2].T
    middle = 0.5 * np.array(grid.shape)
    place = middle + np.column_stack([-np.sin(angle) * x - np.cos(angle) * y, np.cos(angle) * x - np.sin(angle) * y])
    reach = np.arange(-radius, radius + 1)
    view, point = (each.ravel() for each in np.indices((len(reach) ** 2, len(place))))
    offset = np.stack(np.meshgrid(reach, reach, indexing="ij"), axis=-1).reshape(-1, 2)[view]
    index = (place[point] + disparity * offset - grid.origin) @ np.linalg.inv(grid.basis)
    n = len(point)
    return pl.calibration.BoardCorners(index, grid.centres_of(index) + offset, np.ones((n, 2)), point, np.zeros(n))


def sorted_rows(corners, grid):
    """Points, pixels and indices (n, 5) by point and view."""
    view = (2.0 * (corners.pixel - grid.centres_of(corners.index))).round()
    rows = np.column_stack([corners.point, corners.pixel, corners.index])
    return rows[np.lexsort((*view.T, corners.point))]


def test_written_corners_are_read_again(tmp_path):
    """Of arrays along rows and columns, in any numbering of the lattice."""
    path = tmp_path / "a__CheckerCorners.mat"
    for lattice, degrees, turn in (
        (HEXAGONAL, 0.2, 10.0), (HEXAGONAL, 30.0, 10.0), (HEXAGONAL, 90.0, -40.0), (HEXAGONAL, -120.0, 44.0),
        (SQUARE, 0.0, 80.0), (SQUARE, 90.0, -10.0),
    ):  # fmt: skip
        grid = a_grid(lattice, degrees, (9.0, 9.0))
        corners = corners_in_views(grid, turn)
        write(path, corners, grid, BOARD)
        observations = read([path, path], grid, BOARD, pixel_pitch=0.0014)
        assert observations.frames.tolist() == [0, 1] and observations.in_views
        # Views of an array that is turned by 0.2 degrees are off by 0.01 pixels.
        np.testing.assert_allclose(
            sorted_rows(observations, grid)[::2],
            sorted_rows(corners, grid),
            rtol=0,
            atol=0.011,
            err_msg=f"{lattice} {degrees}",
        )
        np.testing.assert_allclose(grid.centres_of(observations.centre_index), observations.centre_pixel)


def test_files_have_the_form_of_the_toolbox(tmp_path):
    """Corners count column by column from the upper left of a view, from 1; pixels of views are square."""
    io = pytest.importorskip("scipy.io")
    grid, path = a_grid(HEXAGONAL, 0.0, (9.0, 9.0)), tmp_path / "a__CheckerCorners.mat"
    corners = corners_in_views(grid, 190.0)
    partial = (corners.pixel - grid.centres_of(corners.index)).round().tolist()
    keep = [not (offset == [1.0, -2.0] and k % 12 == 3) for k, offset in enumerate(partial)]
    fields = ("index", "pixel", "standard_error", "point", "blur")
    corners = pl.calibration.BoardCorners(**{name: getattr(corners, name)[keep] for name in fields})
    write(path, corners, grid, BOARD)
    content = io.loadmat(path, squeeze_me=False)
    cells, model = content["CheckerCorners"], content["LensletGridModel"][0, 0]
    assert cells.shape == (5, 5) and content["LFSize"].ravel()[:2].tolist() == [5, 5]
    assert [k for k, cell in enumerate(cells.ravel()) if not cell.size] == [5 * 3 + 0], "row 1, column -2"
    x, y = cells[2, 2].reshape(4, 3, 2).T
    assert (np.diff(x, axis=1) > 4).all() and (np.diff(y, axis=0) > 4).all()
    # As the Toolbox builds its grid, whose rows are 3^0.5 / 2 of the distance along them apart.
    steps = np.hypot(np.diff(x, axis=1), np.diff(y, axis=1)), np.hypot(np.diff(x, axis=0), np.diff(y, axis=0))
    np.testing.assert_allclose(np.concatenate([each.ravel() for each in steps]), steps[0][0, 0], rtol=1e-9)
    column = float(model["HOffset"][0, 0]) + (x - 1) * float(model["HSpacing"][0, 0]) * 3**0.5 / 2
    row = float(model["VOffset"][0, 0]) + (y - 1) * float(model["VSpacing"][0, 0])
    central = (corners.pixel - grid.centres_of(corners.index)).round().any(axis=1) == 0
    expected = corners.pixel[central] + 1
    found = np.column_stack([row.ravel(), column.ravel()])
    np.testing.assert_allclose(np.sort(found, axis=0), np.sort(expected, axis=0), atol=1e-9)


def test_files_of_matlab_are_read(tmp_path):
    """Order of points by MATLAB's detector may be any; views are scaled; version 7 is compressed."""
    io = pytest.importorskip("scipy.io")
    grid, path = a_grid(HEXAGONAL, 0.0, (9.0, 9.0)), tmp_path / "a__CheckerCorners.mat"
    corners = corners_in_views(grid)
    write(path, corners, grid, BOARD)
    names = ("CheckerCorners", "LensletGridModel", "DecodeOptions")
    content = matlab_values(path.read_bytes(), names, DEFAULT)
    scaled, order = {**content}, np.random.default_rng(0)
    for cell in np.ndindex(5, 5):
        points = content["CheckerCorners"][cell].reshape(4, 3, 2)
        trial = order.integers(4)
        points = points[:: 1 - 2 * (trial // 2), :: 1 - 2 * (trial // 2)]
        points = points if trial % 2 else points[::-1].transpose(1, 0, 2)
        scaled["CheckerCorners"][cell] = points.reshape(-1, 2)
    # Half a pixel of the raw image from view to view.
    scaled["DecodeOptions"]["OutputScale"] = np.array([2.0, 2.0, 2 / 3**0.5, 2 / 3**0.5])
    io.savemat(path, scaled, do_compression=True)
    observations = read([path], grid, BOARD, pixel_pitch=0.0014)
    offset = corners.pixel - grid.centres_of(corners.index)
    half = pl.calibration.BoardCorners(
        corners.index, corners.pixel - 0.5 * offset, corners.standard_error, corners.point, corners.blur
    )
    np.testing.assert_allclose(sorted_rows(observations, grid), sorted_rows(half, grid), rtol=0, atol=1e-9)


def test_corners_of_a_known_camera_calibrate(tmp_path):
    """By the formulas of the camera, written, read, and calibrated to its intrinsics."""
    values = parameters_1_0(TURN=np.radians(30.05), TILT_X=0.0, TILT_Y=0.0)
    rng, boards = np.random.default_rng(3), []
    for k, axis in enumerate(((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (1, 1, 0))):
        boards.append(BOARD.rotated_deg(axis, 28).translated(*rng.uniform(-2, 2, 2), -320.0 - 20 * k).points)
    exact = simulated_views(values, boards, BOARD.points, radius=3.2)
    table = np.column_stack([np.ones(len(exact.centre_index)), exact.centre_index])
    origin, *steps = np.linalg.lstsq(table, exact.centre_pixel, rcond=None)[0]
    grid = pl.calibration.MicroImageGrid(
        HEXAGONAL, origin=origin, basis=steps, shape=SENSOR.shape, index=exact.centre_index,
        centre=exact.centre_pixel + 0.005 * rng.standard_normal(exact.centre_pixel.shape),
    )  # fmt: skip
    paths = [tmp_path / f"{k}__CheckerCorners.mat" for k in range(len(boards))]
    for k, path in enumerate(paths):
        rows = exact.frame == k
        error = 0.003 * rng.standard_normal((rows.sum(), 2))
        index, offset = exact.index[rows], exact.pixel[rows] - grid.centres_of(exact.index[rows])
        pixel = grid.centres_of(index + error) + offset
        corners = pl.calibration.BoardCorners(index + error, pixel, error, exact.point[rows], error[:, 0])
        write(path, corners, grid, BOARD)
    calibration = pl.calibrate(read(paths, grid, BOARD, pixel_pitch=SENSOR.pixel_pitch), start=NOMINAL, board=0.0)
    for p in (P.FOCAL_LENGTH, P.LENS_TO_ARRAY, P.ARRAY_TO_SENSOR, P.PITCH):
        assert abs(calibration[p] - values[p]) < 4 * calibration.standard_error(p), p.name
    assert calibration.standard_error(P.FOCAL_LENGTH) < 1.0


def test_what_the_files_cannot_hold_is_refused(tmp_path):
    grid, path = a_grid(HEXAGONAL, 0.0, (9.0, 9.0)), tmp_path / "a.mat"
    corners = corners_in_views(grid)
    in_micro_images = pl.calibration.BoardCorners(
        np.rint(corners.index), corners.pixel, corners.standard_error, corners.point, corners.blur
    )
    turned = a_grid(HEXAGONAL, 8.0, (9.0, 9.0))
    for args, reason in (
        ((in_micro_images, grid, BOARD), "in micro images"),
        ((corners, grid, pl.targets.checkerboard(6, 5, square=3.0)), "no view has all 20"),
        ((corners, grid, pl.targets.siemens_star(20.0, 36)), "no checkerboard"),
        ((corners_in_views(turned), turned, BOARD), "turned by -8.00 degrees"),
    ):
        with pytest.raises(InvalidValueError, match=reason):
            write(path, *args)
    write(path, corners, grid, BOARD)
    for other, reason in ((a_grid(HEXAGONAL, 0.0, (9.5, 9.5)), "9 and 9.5 pixels apart"), (turned, "another array")):
        with pytest.raises(InvalidValueError, match=reason):
            read([path], other, BOARD, pixel_pitch=0.0014)
    with pytest.raises(InvalidValueError, match="give a list"):
        read(path, grid, BOARD, pixel_pitch=0.0014)
    for content, reason in (
        (b"nothing", "it is no .mat file of version 5 or 7"),
        (matlab_5({"CheckerCorners": np.ones((2, 2))}), "it has no"),
        (path.read_bytes()[:400], "holds no corners"),
        (path.read_bytes().replace(b"h\0o\0r\0z\0", b"v\0e\0r\0t\0"), "do not run along x"),
    ):
        path.with_suffix(".bad").write_bytes(content)
        with pytest.raises(FileError, match=reason):
            read([path.with_suffix(".bad")], grid, BOARD, pixel_pitch=0.0014)
    with pytest.raises(FileError, match="no view with all 20"):
        read([path], grid, pl.targets.checkerboard(6, 5, square=3.0), pixel_pitch=0.0014)
