"""For the PlenopticToolbox 2.0 (L. Palmieri, R. Op het Veld, R. Koch, ICIP 2018, doi:10.1109/ICIP.2018.8451051)."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from plenoptic.calibration.grid_files import VIRTUAL_DEPTHS, rxlive_text
from plenoptic.camera.points.centres import CentreMethod
from plenoptic.camera.points.micro_image_grid import MicroImageGrid
from plenoptic.core.files.atomic_file import write_file
from plenoptic.core.files.codes import white_point
from plenoptic.export.lattice import LensRows, lens_rows
from plenoptic.export.pictures import folder_at, plain_name, write_picture, write_readme
from plenoptic.rendering.exposure import Exposure

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
    table = np.column_stack([rows.lens, np.ones(len(rows.lens))])
    (*basis, origin), *_ = np.linalg.lstsq(table, rows.centre, rcond=None)
    residual = float(np.sqrt(np.mean(np.sum((table @ [*basis, origin] - rows.centre) ** 2, axis=1))))
    array, size = rows.array, shot.image.shape[:2]
    grid = MicroImageGrid(
        array.lattice, origin=origin, basis=np.array(basis), shape=size, type_pattern=array.type_pattern
    )
    text, types = rxlive_text(grid, [_sharp(rows, kind) for kind in range(len(array.focal_lengths))])
    scale = white_point(shot.image)
    write_picture(target / f"{name}.png", shot.image, scale=scale, bits=8, encoded=True)
    write_file(target / f"{name}.xml", text.encode("ascii"))
    disparity = None if shot.truth is None else shot.truth.disparity
    if disparity is not None:
        write_picture(target / f"{name}_disp.png", np.abs(disparity)[:, :, np.newaxis], scale=grid.pitch)
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
