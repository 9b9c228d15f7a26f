"""For the PlenopticToolbox 2.0 (L. Palmieri, R. Op het Veld, R. Koch, ICIP 2018, doi:10.1109/ICIP.2018.8451051)."""

from __future__ import annotations

import math
import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.calibration.grid_files import VIRTUAL_DEPTHS, rxlive_text
from plenoptic.camera.points.centres import CentreMethod
from plenoptic.core.files.atomic_file import write_file
from plenoptic.core.files.codes import white_point
from plenoptic.errors import InvalidValueError
from plenoptic.export.lattice import LensRows, lens_rows
from plenoptic.export.pictures import folder_at, plain_name, write_picture, write_readme
from plenoptic.rendering.exposure import Exposure

_TYPES = 3
_SHARPEST, _FARTHEST = VIRTUAL_DEPTHS


def plenoptic_toolbox(
    folder: str | os.PathLike[str], shot: Exposure, *, name: str = "shot", method: CentreMethod = CentreMethod.CHIEF_RAY
) -> None:
    """Write a raw image of a hexagonal array with its calibration for the PlenopticToolbox 2.0.

    Parameters
    ----------
    folder : path-like
        Folder, made if it is missing; files of the same name are replaced.
    shot : Exposure
        Exposure that names its camera. DISPARITY, if it has that, is written as a picture too, in lens diameters.
    name : str, optional
        Name of the files.
    method : CentreMethod, optional
        Definition of the centres to which the grid is fitted.

    Raises
    ------
    InvalidValueError
        If the array is not hexagonal, or its types do not repeat as the format has them.
    FileError
        If a file cannot be written.

    Notes
    -----
    Not expressed: square lattices, distortion of the grid (the fit's residual is in README.txt), errors, white
    images. One or two focal lengths are written as three types, some of which are equal. The picture is sRGB-encoded,
    8 bits; the image is not turned: the format knows the grid's rotation.

    Examples
    --------
    >>> import pathlib, tempfile, plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=4.25))
    >>> camera = pl.PlenopticCamera(lens=lens,
    ...     microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(1.7, 2.0, 2.4)),
    ...     sensor=pl.Sensor(shape=(110, 154), pixel_pitch=0.01), stop_to_microlenses=123.3, microlenses_to_sensor=1.6)
    >>> shot = pl.render(pl.check_scene(), camera, samples=4, progress=False)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pl.export.plenoptic_toolbox(folder, shot)
    ...     sorted(path.name for path in pathlib.Path(folder).iterdir())
    ['README.txt', 'shot.png', 'shot.xml']
    """
    target, name = folder_at(folder), plain_name(name)
    rows = lens_rows(shot, turn=False, method=method)
    if not rows.hexagonal:
        raise InvalidValueError("the PlenopticToolbox knows hexagonal arrays only; use another exporter")
    steps, diameter, rotation, offset, residual = _grid(rows, shot.image.shape[:2])
    types = _types(rows, steps)
    scale = white_point(shot.image)
    write_picture(target / f"{name}.png", shot.image, scale=scale, bits=8, encoded=True)
    ranges = [_sharp(rows, kind) for kind in types]
    across = complex(0.5, math.sqrt(0.75))
    text = rxlive_text(complex(*offset), diameter, rotation, across, ranges)
    write_file(target / f"{name}.xml", text.encode("ascii"))
    disparity = None if shot.truth is None else shot.truth.disparity
    if disparity is not None:
        write_picture(target / f"{name}_disp.png", np.abs(disparity)[:, :, np.newaxis], scale=diameter)
    more: dict[str, Any] = {
        "focal type of each lens_type": types,
        "root mean square distance of the centres from the grid, pixels": f"{residual:.5f}",
        "full code, in the units of the exposure": scale,
    }
    if disparity is None:
        more["no disparity"] = "render with truth=pl.Truth.DISPARITY for a picture of it"
    else:
        more[f"full code of {name}_disp.png, 16 bits"] = "a disparity of one lens diameter"
    write_readme(
        target,
        "the PlenopticToolbox 2.0",
        f"Load {name}.png; its calibration {name}.xml lies beside it, in the form of RxLive's files.",
        "square lattices, distortion of the grid, errors, white images; more than three focal lengths.",
        more,
    )


def _grid(rows: LensRows, size: tuple[int, int]) -> tuple[NDArray[np.int64], float, float, tuple[float, float], float]:
    """Steps (n, 2) from the central lens along a row and 60 degrees farther; the diameter, rotation and offset of the
    grid that fits best, and its residual. x is to the right, y up, from the middle of the image.
    """
    centre = rows.centre[:, 1] - 0.5 * (size[1] - 1) + 1j * (0.5 * (size[0] - 1) - rows.centre[:, 0])
    first = np.argmin(np.abs(centre))
    up, twice = rows.row[first] - rows.row, 2 * rows.place + rows.shifted
    right = (twice - twice[first] - up) // 2
    ideal = right + up * np.exp(1j * math.pi / 3)
    (scale, offset), *_ = np.linalg.lstsq(np.column_stack([ideal, np.ones(len(ideal))]), centre, rcond=None)
    residual = float(np.sqrt(np.mean(np.abs(scale * ideal + offset - centre) ** 2)))
    place = float(offset.real), float(offset.imag)
    return np.column_stack([right, up]), float(abs(scale)), float(np.angle(scale)), place, residual


def _types(rows: LensRows, steps: NDArray[np.int64]) -> list[int]:
    """The type of the array for each of the three of the format."""
    number = (np.mod(-steps[:, 0], _TYPES) + steps[:, 1]) % _TYPES
    types_of_lenses = [np.unique(rows.type[number == k]).tolist() for k in range(_TYPES)]
    if any(len(kinds) != 1 for kinds in types_of_lenses):
        raise InvalidValueError(
            "the focal types do not repeat every three lenses of a row, each beside both others; the format has no "
            "other pattern"
        )
    return [kinds[0] for kinds in types_of_lenses]


def _sharp(rows: LensRows, kind: int) -> tuple[float, float]:
    """Virtual depths that a type of micro images to within a pixel, between the bounds."""
    camera, array = rows.camera, rows.array
    b = camera.microlenses_to_sensor
    # A circle of confusion of 1 - b (1/f - 1/(v b)) diameters.
    focus, room = b / array.focal_lengths[kind] - 1.0, camera.sensor.pixel_pitch / max(array.pitches)
    near, far = focus + room, focus - room
    nearest = 1.0 / near if near > 0 else _FARTHEST
    farthest = 1.0 / far if far > 0 else _FARTHEST
    low, high = (min(max(end, _SHARPEST), _FARTHEST) for end in (nearest, farthest))
    return (low, high) if low < high else (_SHARPEST, _FARTHEST)
