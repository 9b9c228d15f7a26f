"""Observations from the files of COMPOTE (M. Labussiere et al., IJCV 130 (2022), doi:10.1007/s11263-022-01582-z)."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.calibration.observations import Observations
from plenoptic.core.values import Floats, length_in_mm, whole
from plenoptic.errors import FileError
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.sensor.sensor import Sensor

FEATURE_COLUMNS, CENTRE_COLUMNS = ("k", "l", "u", "v", "rho", "cluster", "frame"), ("k", "l", "u", "v")
SQUARE, ROWS, COLUMNS = 0, 1, 2
"""Geometries of a mesh: orthogonal, hexagonal with rows or with columns of neighbours."""


def read_compote(
    camera: str | os.PathLike[str],
    corners: str | os.PathLike[str],
    centres: str | os.PathLike[str],
    *,
    board_columns: int,
    square: float,
) -> Observations:
    """Read the observations of COMPOTE: corners of checkerboards and centres of micro images.

    Parameters
    ----------
    camera : path-like
        File camera.js or intrinsics.js: geometry of the lattice, size and pitch of the pixels.
    corners : path-like
        Table k, l, u, v, rho, cluster, frame. Corners without a cluster (negative numbers) are left out.
    centres : path-like
        Table k, l, u, v.
    board_columns : int
        Corners along a row of the board: corner c has the column c mod board_columns.
    square : float
        Distance of neighbouring corners in mm.

    Returns
    -------
    Observations
        COMPOTE counts corners of the board up to a flip. Columns of the board run along x; y is chosen so that the
        board shows its face.

    Raises
    ------
    FileError
        If a file is missing or holds something else.

    Examples
    --------
    >>> import json, pathlib, tempfile, plenoptic as pl
    >>> camera = {"mia": {"mesh": {"geometry": 1}}, "sensor": {"scale": 0.01, "width": 90, "height": 60}}
    >>> texts = {"camera.js": json.dumps(camera), "centres.csv": "k,l,u,v" + chr(10) + "1,2,30,40",
    ...     "corners.csv": "k,l,u,v,rho,cluster,frame" + chr(10) + "1,2,30.5,41.0,-1.5,1,0"}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     for name, text in texts.items():
    ...         _ = pathlib.Path(folder, name).write_text(text)
    ...     files = [pathlib.Path(folder, name) for name in ("camera.js", "corners.csv", "centres.csv")]
    ...     pl.calibration.read_compote(*files, board_columns=9, square=10.0)
    Observations(1 corner in 1 frame, 2 board points, 1 centre)
    """
    columns, spacing = whole(board_columns, "board_columns", at_least=2), length_in_mm(square, "square")
    geometry, sensor = _read_camera(Path(camera))
    table, middle = _read_table(Path(corners), FEATURE_COLUMNS), _read_table(Path(centres), CENTRE_COLUMNS)
    table = table[table[:, 5] >= 0]
    point, frame = table[:, 5].astype(np.int64), table[:, 6].astype(np.int64)
    cells = np.arange(point.max(initial=-1) + 1)
    grid = np.column_stack([cells % columns, cells // columns]).astype(np.float64)
    grid[:, 1] *= _upward(grid[point], table[:, 2:4], frame)
    return Observations(
        index=_lattice_index(table[:, :2], geometry),
        pixel=table[:, 3:1:-1],
        frame=frame,
        point=point,
        board=np.pad(spacing * grid, ((0, 0), (0, 1))),
        centre_index=_lattice_index(middle[:, :2], geometry),
        centre_pixel=middle[:, 3:1:-1],
        sensor=sensor,
        lattice=Lattice.SQUARE if geometry == SQUARE else Lattice.HEXAGONAL,
        blur=table[:, 4],
    )


def _read_camera(path: Path) -> tuple[int, Sensor]:
    try:
        content: Any = json.loads(path.read_text(encoding="utf-8"))
        mesh, sensor = content["mia"]["mesh"], content["sensor"]
        shape = int(sensor["height"]), int(sensor["width"])
        geometry = int(mesh["geometry"])
        if geometry not in (SQUARE, ROWS, COLUMNS):
            raise ValueError(f"the geometry of the mesh is {geometry}")
        return geometry, Sensor(shape=shape, pixel_pitch=float(sensor["scale"]))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise FileError(f"{path} is no camera of COMPOTE: {error!r}; give its camera.js or intrinsics.js") from None


def _read_table(path: Path, header: tuple[str, ...]) -> Floats:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
        if (first := lines[0].replace(" ", "") if lines else "") != ",".join(header):
            raise ValueError(f"the heading is {first[:80]!r}")
        return np.loadtxt(lines[1:], delimiter=",", ndmin=2).reshape(-1, len(header))
    except (OSError, ValueError) as error:
        raise FileError(f"{path} is no table {', '.join(header)} of COMPOTE: {error}") from None


def _lattice_index(places: Floats, geometry: int) -> NDArray[np.int64]:
    """Lattice indices (n, 2) of places k along a row and l of the row, as `MicrolensArray` counts them.

    Pixel columns run against the sensor's x axis, rows along its y axis. The second vector of a hexagonal lattice lies
    60 degrees counter-clockwise from the first.
    """
    k, l = places.astype(np.int64).T  # noqa: E741
    if geometry == ROWS:  # even rows are half a pitch farther right
        return np.column_stack([l, k - (l + 1) // 2])
    if geometry == COLUMNS:  # odd columns are half a pitch farther up
        return np.column_stack([-k, l + k // 2])
    return np.column_stack([-k, l])


def mesh_numbers(observations: Observations) -> tuple[int, NDArray[np.int64], NDArray[np.int64]]:
    """Geometry of the mesh of micro images, and numbers k, l of those of corners (n, 2) and of centres (m, 2)."""
    centre, uv = observations.centre_index, observations.centre_pixel[:, ::-1]
    table = np.column_stack([centre, np.ones(len(centre))])
    step = complex(*np.linalg.lstsq(table, uv, rcond=None)[0][1])
    index = np.concatenate([observations.index, centre])
    is_hexagonal = observations.lattice is Lattice.HEXAGONAL
    # Neighbours (0, 1) lie to the right in ROWS, otherwise below: turn the indices by a symmetry until they do.
    symmetry = 6 if is_hexagonal else 4
    turns = np.angle(step / np.array([1.0, 1j])) * symmetry / (2.0 * np.pi)
    geometry = ROWS if is_hexagonal and abs(turns[0] - np.rint(turns[0])) < 0.25 else COLUMNS
    for _ in range(int(-np.rint(turns[geometry - 1])) % symmetry):
        index = np.column_stack([-index[:, 1], index[:, 1] * is_hexagonal + index[:, 0]])
    i, j = index.T
    if geometry == ROWS:
        number = np.column_stack([j + (i + 1) // 2, i])
    else:
        number = np.column_stack([-i, j + (i + 1) // 2 * is_hexagonal])
    low = number.min(axis=0)
    low[2 - geometry] -= low[2 - geometry] % 2
    number -= low
    return geometry if is_hexagonal else SQUARE, number[: len(observations.index)], number[len(observations.index) :]


def _upward(grid: Floats, uv: Floats, frame: NDArray[np.int64]) -> float:
    """Direction of y along which rows of the board are counted if it shows its face: +1 or -1."""
    area = 0.0
    for number in np.unique(frame):
        rows = frame == number
        steps = np.linalg.lstsq(np.column_stack([grid[rows], np.ones(rows.sum())]), uv[rows], rcond=None)[0][:2]
        area += float(np.linalg.det(steps))
    return 1.0 if area < 0 else -1.0
