"""For COMPOTE, PRISM and BLADE (M. Labussiere et al., IJCV 130 (2022), doi:10.1007/s11263-022-01582-z)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.calibration.calibration_result import Calibration
from plenoptic.calibration.compote_files import CENTRE_COLUMNS, COLUMNS, FEATURE_COLUMNS, ROWS, SQUARE, mesh_numbers
from plenoptic.calibration.fitting.geometry import Parameter, project_centres
from plenoptic.calibration.observations import Observations
from plenoptic.calibration.twin import object_origin
from plenoptic.camera.assembly import Rigid, rigid
from plenoptic.camera.gaussian import CameraKind
from plenoptic.camera.points.centres import CentreMethod, microlens_centres
from plenoptic.camera.report.report import camera_report
from plenoptic.core.files.atomic_file import write_file, write_json
from plenoptic.core.files.codes import white_point
from plenoptic.core.files.text_lines import csv_text
from plenoptic.core.values import Floats, check_kind
from plenoptic.errors import InvalidValueError
from plenoptic.export.lattice import LensRows, lens_rows
from plenoptic.export.pictures import folder_at, plain_name, write_picture, write_readme
from plenoptic.lightfield.raw_arrays import crop_in_white_image
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.models import LensModel
from plenoptic.package.calibration import calibration_points, targets_of
from plenoptic.rendering.exposure import Exposure
from plenoptic.scene.shapes.targets.target import Target

if TYPE_CHECKING:
    from plenoptic.scene.scene import Scene

_MODES = {CameraKind.PLENOPTIC_1: 0, CameraKind.KEPLERIAN: 1, CameraKind.GALILEAN: 2}
_TURNED = (np.diag([1.0, -1.0, -1.0]), np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]))
"""From the camera's axes to those of the program, whose z runs towards the scene: for a picture as it is, and for one
that is turned by a quarter."""


def compote(  # noqa: PLR0913
    folder: str | os.PathLike[str],
    shot: Exposure,
    white: Exposure,
    *,
    other_whites: Sequence[Exposure] = (),
    targets: Target | Sequence[Target] = (),
    scene: Scene | None = None,
    name: str = "shot",
) -> None:
    """Write images, camera, poses and observations for COMPOTE, and for PRISM and BLADE, which read the same files.

    Parameters
    ----------
    folder : path-like
        Folder, made if it is missing; files of the same name are replaced.
    shot, white : Exposure
        Images of the whole sensor, `shot` with its camera.
    other_whites : sequence of Exposure, optional
        White images at other stops, of which its pre-calibration wants one at least; each names its camera.
    targets : Target or sequence of Target, optional
        Targets in the world, one for each frame; their points, traced through the real lens, are the observations.
    scene : Scene, optional
        Scene that may hide points.
    name : str, optional
        Name of the picture.

    Raises
    ------
    InvalidValueError
        Without microlenses on a lattice, for images of a region, or for targets in another medium than the sensor's.
    FileError
        If a file cannot be written.

    Notes
    -----
    The camera is the thin lens of the same focal length: object distances count from the front principal plane, image
    distances from the rear one. Deviations of the real lens stay in the observations: their distance from this
    model is its error. Lenses of a rectangle with an even number of rows are written, of which every first row is
    shifted by half a pitch to the right.

    Not expressed: thick lenses, stops but the iris, microlenses out of place one by one, errors and truth.
    params.js is left out, since its pre-calibration finds it in the white images.

    Examples
    --------
    >>> import pathlib, tempfile, plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=5.0))
    >>> camera = pl.PlenopticCamera(lens=lens, microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    ...     sensor=pl.Sensor(shape=(110, 154), pixel_pitch=0.01), stop_to_microlenses=123.3, microlenses_to_sensor=1.6)
    >>> white = pl.render_white(camera, samples=4, progress=False)
    >>> board = pl.targets.checkerboard(3, 3, square=1.0).translated(z=-404)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pl.export.compote(folder, white, white, targets=board)
    ...     names = sorted(path.name for path in pathlib.Path(folder).iterdir())
    >>> names[:5], names[5:]
    (['README.txt', 'camera.js', 'centres.csv', 'features.csv', 'images.js'],
     ['intrinsics.js', 'poses.js', 'scene.js', 'shot.png', 'white.png'])
    """
    cut, _ = crop_in_white_image(shot, white)
    target, name = folder_at(folder), plain_name(name)
    if shot.region is not None:
        raise InvalidValueError("the images are of a region; render the whole sensor")
    rows = _with_even_rows(lens_rows(shot, turn=True))
    camera, boards = rows.camera, targets_of(targets)
    points = cardinal_points(camera.lens, camera.wavelength)
    if boards and points.efl != points.front_efl:
        raise InvalidValueError(
            f"targets stand in a medium of {points.front_efl / points.efl:.4g} times the rear index, and the "
            "program's camera has one medium on both sides: leave targets out"
        )
    f_number = points.f_number
    whites = [("white.png", f_number, white.image[cut])]
    for number, other in enumerate(other_whites):
        if other.camera is None:
            raise InvalidValueError("other_whites holds an exposure without a camera; give what render_white made")
        stopped = cardinal_points(other.camera.lens, other.camera.wavelength).f_number
        whites.append((f"white_{number + 2}.png", stopped, other.image[crop_in_white_image(shot, other)[0]]))
    for file, _, image in [(f"{name}.png", f_number, shot.image), *whites]:
        write_picture(target / file, rows.turn_image(image), scale=white_point(image), bits=8, encoded=True)
    frame_facts = {"path": f"{name}.png", "fnumber": f_number}
    listed = [{"path": file, "fnumber": stopped} for file, stopped, _ in whites]
    write_json(
        target / "images.js",
        {
            "meta": {"debayered": "true", "format": "8", "rgb": "true"},
            "whites": listed,
            "checkerboards": [frame_facts | {"frame": frame} for frame in range(len(boards))],
            "mask": listed[0],
            "images": [frame_facts | {"frame": 0}],
        },
    )
    _write_camera(target, rows, f_number, ROWS if rows.hexagonal else SQUARE)
    v, u = rows.centre.T
    write_file(target / "centres.csv", csv_text(CENTRE_COLUMNS, (rows.place, rows.row, u, v)).encode("ascii"))
    if boards:
        _write_boards(target, rows, boards, scene)
    turned = ", and so do width and height in camera.js" if rows.turns else ""
    stops = "" if other_whites else "   (it wants white images at several stops: give other_whites)"
    observed = "-f features.csv -s scene.js" if boards else "-s SCENE   (no targets were given)"
    write_readme(
        target,
        "COMPOTE, PRISM and BLADE",
        f"1. precalibrate finds params.js: -i images.js -c camera.js{stops}\n"
        f"2. calibrate -i images.js -c camera.js -p params.js {observed}\n"
        "3. compare: its model of this camera and poses (intrinsics.js, poses.js, scene.js) is what calibration should "
        f"find.\nImages have been turned by {90 * rows.turns} degrees counter-clockwise{turned}.",
        "thick lenses, further stops, single microlenses out of place, errors, truth.",
    )


def compote_calibration(folder: str | os.PathLike[str], calibration: Calibration, observations: Observations) -> None:
    """Write a calibration and its observations for COMPOTE.

    Parameters
    ----------
    folder : path-like
        Folder, made if it is missing; files of the same name are replaced.
    calibration : Calibration
    observations : Observations
        The observations it was made from. Their pixels stay as they are.

    Raises
    ------
    InvalidValueError
        If the observations are others.
    FileError
        If a file cannot be written.

    Notes
    -----
    camera.js and intrinsics.js are the camera, as `compote` writes it, features.csv and centres.csv the observations,
    which `pl.calibration.read_compote` reads, scene.js the board as fitted, poses.js the camera before it in each
    frame. Numbers of microlenses begin in another place.

    Not expressed: errors, an exit pupil outside the rear principal plane, distortion.

    Examples
    --------
    >>> import pathlib, tempfile, plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(5.0))
    >>> camera = pl.PlenopticCamera(lens=lens.with_model(pl.LensModel.THIN), microlenses=pl.MicrolensArray(0.4, (2.0,)),
    ...     sensor=pl.Sensor(shape=(350, 400), pixel_pitch=0.02), stop_to_microlenses=156.0, microlenses_to_sensor=3.0)
    >>> design = pl.targets.checkerboard(6, 5, square=3.0)
    >>> axes = (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)
    >>> boards = [design.rotated_deg(axis, 25).translated(z=-380) for axis in axes]
    >>> corners, centres = pl.package.calibration_points(camera, boards), pl.microlens_centres(camera)
    >>> observations = pl.calibration.Observations(corners.index, corners.pixel, corners.frame, corners.point,
    ...     design.points, centres.index, centres.pixel, camera.sensor)
    >>> calibration = pl.calibrate(observations, start=pl.calibration.NominalCamera(100.0, 8.0), board=0.0)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pl.export.compote_calibration(folder, calibration, observations)
    ...     files = [pathlib.Path(folder) / name for name in ("intrinsics.js", "features.csv", "centres.csv")]
    ...     pl.calibration.read_compote(*files, board_columns=5, square=3.0)
    Observations(... corners in 4 frames, 20 board points, ... centres)
    """
    check_kind(calibration, "calibration", Calibration, "pl.calibrate(observations, start=...)")
    check_kind(observations, "observations", Observations, "pl.calibration.Observations(...)")
    corners, centres = calibration.corner_residual, calibration.centre_residual
    if (corners.shape, centres.shape) != (observations.pixel.shape, observations.centre_pixel.shape):
        raise InvalidValueError("the observations are not those of the calibration; give the ones it was made from")
    if observations.in_views:
        raise InvalidValueError(
            "the corners lie in views of an unfocused camera; COMPOTE has them in micro images only"
        )
    target, camera = folder_at(folder), calibration.camera
    grid = (observations.centre_index - np.array(calibration.layout.pivot)) @ calibration.layout.basis
    fitted, _ = project_centres(calibration.values, grid, camera.sensor.pixel_pitch)
    offset = camera.sensor.pixel_pitch * float(np.median(np.abs(fitted - observations.centre_pixel - centres)))
    if offset > 0.25 * calibration[Parameter.PITCH]:
        raise InvalidValueError(
            "the observations number microlenses otherwise than those of the first focus setting, as the calibration "
            "does; give observations with its lattice indices"
        )
    geometry, corner_number, number = mesh_numbers(observations)
    index, kind = observations.centre_index, np.zeros(len(number), np.int64)
    k, l = number.T  # noqa: E741
    rows = LensRows(camera, 0, index, kind, observations.centre_pixel, l, k, kind > 0, 0.0, (1.0, 1.0))
    _write_camera(target, rows, calibration.layout.f_number, geometry)
    front = np.array([0.0, 0.0, object_origin(camera)])
    # From the program's axes of the camera to the board.
    poses = [
        {"frame": frame, "pose": _pose((_TURNED[0] @ turn).T, (front - shift) @ turn)}
        for frame, turn, shift in zip(observations.frames.tolist(), calibration.turn, calibration.shift, strict=True)
    ]
    write_json(target / "poses.js", {"poses": poses})
    write_json(target / "scene.js", {"checkerboards": [_board(calibration.board, _grid_index(observations.board))]})
    blur = np.zeros(len(corner_number)) if observations.blur is None else observations.blur
    v, u = observations.pixel.T
    columns = *corner_number.T, u, v, blur, observations.point, observations.frame
    write_file(target / "features.csv", csv_text(FEATURE_COLUMNS, columns).encode("ascii"))
    v, u = observations.centre_pixel.T
    write_file(target / "centres.csv", csv_text(CENTRE_COLUMNS, (*number.T, u, v)).encode("ascii"))


def _with_even_rows(rows: LensRows) -> LensRows:
    """A rectangle of lenses with an even number of rows, the first of which is shifted in a hexagonal lattice."""
    lens = rows.rectangle()
    if lens.hexagonal and not lens.shifted[0]:
        lens = lens.select(lens.row > 0)._replace(row=lens.row[lens.row > 0] - 1)
    return lens.select(lens.row < (lens.row.max() + 1) // 2 * 2)


def _mesh(geometry: int, size: tuple[int, int], places: Floats, number: NDArray[np.int64]) -> dict[str, Any]:
    """The mesh of nodes `places` (n, 2 or 3) by their numbers (n, 2), with the pose of its own axes."""
    column, line = number.T
    height = np.sqrt(0.75)
    ideal = {
        SQUARE: number,
        ROWS: np.column_stack([column + 0.5 * (line % 2 == 0), height * line]),
        COLUMNS: np.column_stack([height * column, line - 0.5 * (column % 2)]),
    }[geometry]
    (along, down, start), *_ = np.linalg.lstsq(np.column_stack([ideal, np.ones(len(ideal))]), places, rcond=None)
    pitch = [float(np.linalg.norm(along)), float(np.linalg.norm(down))]
    axes = [along / pitch[0], down / pitch[1]]
    axes += [np.cross(*axes)] if places.shape[1] == 3 else []
    return {
        "geometry": geometry,
        "width": size[0],
        "height": size[1],
        "pitch": [pitch],
        "pose": _pose(np.column_stack(axes), start),
    }


def _write_camera(target: Path, rows: LensRows, f_number: float, geometry: int) -> None:
    camera, turn = rows.camera, _TURNED[rows.turns]
    array, points = rows.array, cardinal_points(camera.lens, camera.wavelength)
    rear, report = points.rear_principal, camera_report(camera)
    focus = report.array_plane
    height, width = camera.sensor.shape if rows.turns == 0 else camera.sensor.shape[::-1]

    def in_compote_axes(place: Rigid, on_part: Floats) -> Floats:
        return np.asarray((place.points(on_part) - [0.0, 0.0, rear]) @ turn.T)

    # The last pixel is the origin of the sensor, and numbers of lenses of the array run against those of their images.
    sensor_place = rigid(camera.sensor_placement, camera.z_sensor)
    corners = np.array([[width - 1.0, height - 1.0], [width - 2.0, height - 1.0], [width - 1.0, height - 2.0]])
    u, v = corners.T
    row, column = (v, u) if rows.turns == 0 else (u, camera.sensor.shape[1] - 1 - v)
    flat = np.column_stack([camera.sensor.centre_of(row, column), np.zeros(3)])  # type: ignore[arg-type]
    origin, right, above = in_compote_axes(sensor_place, flat)
    pixel = camera.sensor.pixel_pitch
    axes = [(right - origin) / pixel, (above - origin) / pixel]
    turned = np.column_stack([*axes, np.cross(*axes)])
    lenses = microlens_centres(camera, CentreMethod.ORTHOGONAL, margin=10 * max(array.pitches))
    lens_numbers = {tuple(pair): number for number, pair in enumerate(lenses.index.tolist())}
    centres = lenses.on_array[[lens_numbers[tuple(pair)] for pair in rows.lens.tolist()]]
    nodes = in_compote_axes(
        rigid(camera.microlenses_placement, camera.stop_to_microlenses), np.pad(centres, ((0, 0), (0, 1)))
    )
    # An even number of lines that are shifted by turns, so that they are so from the other side too.
    number = np.column_stack([rows.place, rows.row])
    last = number.max(axis=0) | [geometry == COLUMNS, geometry == ROWS]
    size = int(last[0]) + 1, int(last[1]) + 1
    sensor = {"scale": pixel, "width": width, "height": height}
    common = {
        "mia": {"mesh": _mesh(geometry, size, rows.centre[:, ::-1], number)},
        "dist_focus": abs(focus) if focus is not None and np.isfinite(focus) else 0.0,
        "I": len(array.focal_lengths),
        "mode": _MODES.get(report.kind, 2),
    }
    write_json(
        target / "camera.js", common | {"sensor": sensor, "main_lens": {"aperture": f_number, "f": abs(points.efl)}}
    )
    undistorted = {"radial": [0.0] * 3, "tangential": [0.0] * 2, "depth": [0.0] * 3, "model": 0}
    intrinsics = {
        "D": camera.stop_to_microlenses - rear,
        "d": camera.microlenses_to_sensor,
        "distortions": undistorted,
        "distortions_inverse": undistorted,
        "main_lens": {
            "aperture": f_number,
            "diameter": 2 * points.entrance_pupil_semi_diameter,
            "f": abs(points.efl),
            "pose": _pose(np.eye(3), np.zeros(3)),
        },
        "mla": {"focal_lengths": list(array.focal_lengths), "mesh": _mesh(geometry, size, nodes, last - number)},
        "sensor": sensor | {"pose": _pose(turned, origin)},
    }
    write_json(target / "intrinsics.js", common | intrinsics)


def _pose(rotation: Floats, translation: Floats) -> dict[str, Any]:
    return {"rotation": rotation.tolist(), "translation": [translation.tolist()]}


def _write_boards(target: Path, rows: LensRows, boards: tuple[Target, ...], scene: Scene | None) -> None:
    camera, turn = rows.camera, _TURNED[rows.turns]
    points = cardinal_points(camera.lens, camera.wavelength)
    is_thin = camera.lens.model is LensModel.THIN
    front = np.array([0.0, 0.0, points.rear_principal if is_thin else points.front_principal])
    # From the program's axes of the camera to the world.
    rotation, place = turn.T, front
    if camera.pose is not None:
        place = camera.pose.to_world(front)
        rotation = np.column_stack([camera.pose.to_world(front + axis) - place for axis in turn])
    pose = _pose(np.asarray(rotation), np.asarray(place))
    write_json(target / "poses.js", {"poses": [{"frame": frame, "pose": pose} for frame in range(len(boards))]})
    write_json(target / "scene.js", {"checkerboards": [_board(board.points, board.index) for board in boards]})
    corners = calibration_points(camera, boards, scene=scene)
    lens_numbers = {tuple(pair): number for number, pair in enumerate(rows.lens.tolist())}
    lens = np.array([lens_numbers.get(tuple(pair), -1) for pair in corners.index.tolist()], np.int64)
    listed, lens = lens >= 0, lens[lens >= 0]
    row, column = corners.pixel[listed].T
    u, v = (column, row) if rows.turns == 0 else (row, camera.sensor.shape[1] - 1 - column)
    columns = rows.place[lens], rows.row[lens], u, v, corners.blur[listed], corners.point[listed], corners.frame[listed]
    write_file(target / "features.csv", csv_text(FEATURE_COLUMNS, columns).encode("ascii"))


def _grid_index(points: Floats) -> NDArray[np.int64] | None:
    """Rows and columns of points that form a grid and are listed row by row; None if they do not."""
    away = np.linalg.norm(points - points[0], axis=1)
    columns = int(np.argmin(np.abs(away[1:] - np.arange(1, len(points)) * away[1 % len(away)]) < 1e-6 * away.max())) + 1
    number = np.arange(len(points))
    index = np.column_stack([number // columns, number % columns])
    table = np.column_stack([index, np.ones(len(points))])
    fit = table @ np.linalg.lstsq(table, points, rcond=None)[0]
    return index if np.abs(fit - points).max() < 1e-6 * away.max() else None


def _board(points: Floats, index: NDArray[np.int64] | None) -> dict[str, Any]:
    """Points of a board in the world, and if their numbers (row, column) are given, the grid that they form."""
    content: dict[str, Any] = {"points": points.tolist()}
    if index is None or len(points) < 3:
        return content
    table = np.column_stack([index[:, ::-1] - index.min(axis=0)[::-1], np.ones(len(points))])
    if np.linalg.matrix_rank(table) < 3:
        return content
    (along, down, start), *_ = np.linalg.lstsq(table, points, rcond=None)
    side = float(np.linalg.norm(along))
    axes = [along / side, down / np.linalg.norm(down)]
    columns, lines = (np.ptp(index[:, ::-1], axis=0) + 1).tolist()
    pose = _pose(np.column_stack([*axes, np.cross(*axes)]), start)
    return content | {"lph": side, "x_grid": columns, "y_grid": lines, "pose": pose}
