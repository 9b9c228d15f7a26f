"""For COMPOTE, PRISM and BLADE (M. Labussiere et al., IJCV 130 (2022), doi:10.1007/s11263-022-01582-z)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import Rigid, rigid
from plenoptic.camera.gaussian import CameraKind
from plenoptic.camera.points.centres import CentreMethod, microlens_centres
from plenoptic.camera.report.report import camera_report
from plenoptic.core.files.atomic_file import write_file, write_json
from plenoptic.core.files.codes import white_point
from plenoptic.core.files.text_lines import csv_text
from plenoptic.core.values import Floats
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
        Without microlenses on a lattice, or for images of a region.
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
    camera = rows.camera
    f_number = cardinal_points(camera.lens, camera.wavelength).f_number
    whites = [("white.png", f_number, white.image[cut])]
    for number, other in enumerate(other_whites):
        if other.camera is None:
            raise InvalidValueError("other_whites holds an exposure without a camera; give what render_white made")
        stopped = cardinal_points(other.camera.lens, other.camera.wavelength).f_number
        whites.append((f"white_{number + 2}.png", stopped, other.image[crop_in_white_image(shot, other)[0]]))
    for file, _, image in [(f"{name}.png", f_number, shot.image), *whites]:
        write_picture(target / file, rows.turn_image(image), scale=white_point(image), bits=8, encoded=True)
    boards = targets_of(targets)
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
    _write_camera(target, rows, f_number)
    v, u = rows.centre.T
    write_file(target / "centres.csv", csv_text(["k", "l", "u", "v"], (rows.place, rows.row, u, v)).encode("ascii"))
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


def _with_even_rows(rows: LensRows) -> LensRows:
    """A rectangle of lenses with an even number of rows, the first of which is shifted in a hexagonal lattice."""
    lens = rows.rectangle()
    if lens.hexagonal and not lens.shifted[0]:
        lens = lens.select(lens.row > 0)._replace(row=lens.row[lens.row > 0] - 1)
    return lens.select(lens.row < (lens.row.max() + 1) // 2 * 2)


def _mesh(rows: LensRows, places: Floats, columns: NDArray[np.int64], lines: NDArray[np.int64]) -> dict[str, Any]:
    """The mesh of nodes `places` (n, 2 or 3) by their numbers, with the pose of its own axes."""
    ideal = np.column_stack([columns + (0.5 * (lines % 2 == 0) if rows.hexagonal else 0.0), lines])
    height = np.sqrt(0.75) if rows.hexagonal else 1.0
    (along, down, start), *_ = np.linalg.lstsq(np.column_stack([ideal, np.ones(len(ideal))]), places, rcond=None)
    pitch = [float(np.linalg.norm(along)), float(np.linalg.norm(down) / height)]
    axes = [along / np.linalg.norm(along), down / np.linalg.norm(down)]
    axes += [np.cross(*axes)] if places.shape[1] == 3 else []
    return {
        "geometry": int(rows.hexagonal),
        "width": int(columns.max()) + 1,
        "height": int(lines.max()) + 1,
        "pitch": [pitch],
        "pose": _pose(np.column_stack(axes), start),
    }


def _write_camera(target: Path, rows: LensRows, f_number: float) -> None:
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
    last_column, last_line = rows.place.max(), rows.row.max()
    own_mesh = _mesh(rows, nodes, last_column - rows.place, last_line - rows.row)
    sensor = {"scale": pixel, "width": width, "height": height}
    common = {
        "mia": {"mesh": _mesh(rows, rows.centre[:, ::-1], rows.place, rows.row)},
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
        "mla": {"focal_lengths": list(array.focal_lengths), "mesh": own_mesh},
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
    write_json(target / "scene.js", {"checkerboards": [_board(board) for board in boards]})
    corners = calibration_points(camera, boards, scene=scene)
    lens_numbers = {tuple(pair): number for number, pair in enumerate(rows.lens.tolist())}
    lens = np.array([lens_numbers.get(tuple(pair), -1) for pair in corners.index.tolist()], np.int64)
    listed, lens = lens >= 0, lens[lens >= 0]
    row, column = corners.pixel[listed].T
    u, v = (column, row) if rows.turns == 0 else (row, camera.sensor.shape[1] - 1 - column)
    columns = rows.place[lens], rows.row[lens], u, v, corners.blur[listed], corners.point[listed], corners.frame[listed]
    header = ["k", "l", "u", "v", "rho", "cluster", "frame"]
    write_file(target / "features.csv", csv_text(header, columns).encode("ascii"))


def _board(board: Target) -> dict[str, Any]:
    """The points of a target in the world; as a grid if it is one."""
    content: dict[str, Any] = {"points": board.points.tolist()}
    if board.index is None or len(board.points) < 3:
        return content
    table = np.column_stack([board.index[:, ::-1] - board.index.min(axis=0)[::-1], np.ones(len(board.points))])
    if np.linalg.matrix_rank(table) < 3:
        return content
    (along, down, start), *_ = np.linalg.lstsq(table, board.points, rcond=None)
    side = float(np.linalg.norm(along))
    axes = [along / side, down / np.linalg.norm(down)]
    columns, lines = (np.ptp(board.index[:, ::-1], axis=0) + 1).tolist()
    pose = _pose(np.column_stack([*axes, np.cross(*axes)]), start)
    return content | {"lph": side, "x_grid": columns, "y_grid": lines, "pose": pose}
