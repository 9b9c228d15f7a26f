"""For the Light Field Toolbox for MATLAB (D. G. Dansereau, O. Pizarro and S. B. Williams, CVPR 2013)."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic import __version__
from plenoptic.core.files.array_files import matlab_7_3
from plenoptic.core.files.atomic_file import write_file, write_json
from plenoptic.core.files.codes import brightest, codes
from plenoptic.core.values import Floats, check_kind
from plenoptic.errors import InvalidValueError
from plenoptic.export.lattice import LensRows, lens_rows
from plenoptic.export.pictures import folder_at, plain_name, write_picture, write_readme
from plenoptic.lightfield.decode import decode
from plenoptic.lightfield.raw_arrays import crop_in_white_image
from plenoptic.lightfield.views import LightField
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.rendering.exposure import Exposure


def lftoolbox(
    folder: str | os.PathLike[str], shot: Exposure, white: Exposure, *, name: str = "shot", views: int | None = None
) -> None:
    """Write the decoded light field of a plenoptic 1.0 camera, raw image and grid model for the Light Field Toolbox.

    Needs the package h5py.

    Parameters
    ----------
    folder, shot, white, name
        As for `plenopticam`, with the same errors.
    views : int, optional
        As in `pl.lightfield.decode`.

    Notes
    -----
    `NAME__Decoded.mat` (version 7.3, HDF5) holds `LF`, uint16 (T, S, V, U, 4) with indices [j, i, l, k, c], linear,
    whose fourth channel is the weight, 0 where no light is known; `LensletGridModel`, `LFMetadata`,
    `WhiteImageMetadata`, `DecodeOptions` and `GeneratedByInfo`. `NAME.png` and `NAME_white.png` are the pictures that
    the grid model describes: 16 bits, linear, turned so that rows of lenses run along rows of pixels. `CalInfo.json`
    has the intrinsic matrix H of the camera by Gaussian optics: [s t u v 1] = H [i j k l 1], s and t in metres in the
    entrance pupil, u and v slopes, x to the right, y down, indices from 1.

    The grid model is that from which `LFBuildHexGrid` makes lenses. The Toolbox decodes raw images of hexagonal
    lattices only, and turns offset and grid together there: where Rot is not 0, give it the offset turned back by Rot.

    Not expressed: errors, truth, focal types; distortion (the five numbers are 0).

    Examples
    --------
    >>> import pathlib, tempfile, plenoptic as pl
    >>> camera = pl.camera.example_camera(pl.CameraKind.PLENOPTIC_1, shape=(110, 154))
    >>> white = pl.render_white(camera, samples=16, progress=False)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pl.export.lftoolbox(folder, white, white, views=5)
    ...     print(pl.lightfield.read_lftoolbox(pathlib.Path(folder) / "shot__Decoded.mat"))
    ...     len(list(pathlib.Path(folder).iterdir()))
    LightField(5 x 5 views of 5 x 7 x 3)
    5
    """
    check_kind(white, "white", Exposure, "pl.render_white(camera)")
    light, name = white.image[crop_in_white_image(shot, white)[0]], plain_name(name)
    field = decode(shot, white, views=views)
    lens = lens_rows(shot, turn=True).whole(shot.image.shape[:2]).rectangle()
    target, scale = folder_at(folder), brightest(field.views)
    model = grid_model(lens)
    content: dict[str, Any] = {
        "LF": _append_weights(field.views, scale),
        "LensletGridModel": model,
        "LFMetadata": {"camera": {"makerName": "plenoptic"}, "fullCode": scale},
        "WhiteImageMetadata": {"camera": {"makerName": "plenoptic"}, "fullCode": brightest(light)},
        "DecodeOptions": {
            "LevelLimits": np.array([[0.0, 65535.0]]),
            "Precision": "single",
            "NColChans": 3.0,
            "NWeightChans": 1.0,
        },
        "GeneratedByInfo": {"mfilename": "plenoptic", "VersionStr": __version__},
    }
    write_file(target / f"{name}__Decoded.mat", matlab_7_3(content))
    write_picture(target / f"{name}.png", lens.turn_image(shot.image), scale=brightest(shot.image))
    write_picture(target / f"{name}_white.png", lens.turn_image(light), scale=brightest(light))
    matrix = intrinsics(field)
    if matrix is not None:
        calibrated = {"EstCamIntrinsicsH": matrix.tolist(), "EstCamDistortionV": [0.0] * 5, "LensletGridModel": model}
        write_json(target / "CalInfo.json", calibrated)
    write_readme(
        target,
        "the Light Field Toolbox",
        f"load('{name}__Decoded.mat'); LFDispMousePan(LF)\n"
        f"{name}.png and {name}_white.png: raw and white image, which LensletGridModel describes.",
        "errors, truth, focal types, distortion.",
        {"quarters turned, counter-clockwise": lens.turns, "full code of LF, in the units of radiance": scale},
    )


def _append_weights(views: NDArray[np.float32], scale: float) -> NDArray[np.uint16]:
    """(T, S, V, U, 4): colours and weight of views (U, V, rows, columns, C)."""
    turned = views.transpose(1, 0, 2, 3, 4)
    colours = codes(turned, scale=scale, encoded=False)
    colours = np.broadcast_to(colours, (*colours.shape[:4], 3))
    finite = np.isfinite(turned).all(axis=4, keepdims=True)
    return np.concatenate([colours, np.where(finite, 65535, 0)], axis=4).astype(np.uint16)


def grid_model(lens: LensRows) -> Mapping[str, Any]:
    """`LensletGridModel` of lenses in a rectangle, by least squares; pixels count from 1.

    A lens stands at offset + R (k HSpacing, l VSpacing), R a rotation by Rot from x towards y, which points down; every
    other row is half a spacing farther right. Without shifted rows (square lattices), the first shifted one is beyond.
    """
    along = lens.place + 0.5 * lens.shifted
    table = np.column_stack([along, lens.row, np.ones(len(along))])
    (right, down, first), *_ = np.linalg.lstsq(table, lens.centre[:, ::-1] + 1.0, rcond=None)
    across, row_pitch = float(np.hypot(*right)), float(np.hypot(*down))
    if abs(right @ down) > 0.01 * across * row_pitch:
        raise InvalidValueError("the lattice is sheared, which the grid model of this program cannot express")
    rows = int(lens.row.max()) + 1
    shifted = np.unique(lens.row[lens.shifted])
    return {
        "HSpacing": across,
        "VSpacing": row_pitch,
        "HOffset": float(first[0]),
        "VOffset": float(first[1]),
        "Rot": float(np.arctan2(right[1], right[0])),
        "Orientation": "horz",
        "FirstPosShiftRow": float(shifted[0] + 1 if shifted.size else rows + 1),
        "UMax": float(lens.place.max() + 1),
        "VMax": float(rows),
    }


def intrinsics(field: LightField) -> Floats | None:
    """The matrix H (5, 5) by Gaussian optics; None without a plane in focus and a pupil at a finite distance."""
    camera = field.camera
    assert camera is not None
    points = cardinal_points(camera.lens, camera.wavelength)
    distance = points.entrance_pupil - field.z_focus
    # A view farther right is seen from farther right; rows of views run down.
    step = float((field.pupil[-1, 0, 0] - field.pupil[0, 0, 0]) / max(len(field.u) - 1, 1))
    step *= points.entrance_pupil_semi_diameter
    matrix = np.zeros((5, 5))
    for axis, (wide, origin, sign) in enumerate(zip(field.object_spacing, field.origin, (1.0, -1.0), strict=True)):
        views = len(field.u) if axis == 0 else len(field.v)
        middle = float(sign * origin / field.spacing[axis]) + 1.0  # column or row of the axis
        matrix[axis, [axis, 4]] = step, -step * 0.5 * (views + 1)
        matrix[2 + axis, axis] = -step / distance
        matrix[2 + axis, 2 + axis] = wide / distance
        matrix[2 + axis, 4] = (step * 0.5 * (views + 1) - wide * middle) / distance
    matrix[:2] *= 1e-3
    matrix[4, 4] = 1.0
    return matrix if np.isfinite(matrix).all() else None
