"""Import of light fields: folders of views, and images of macro-pixels."""

from __future__ import annotations

import configparser
import dataclasses
import json
import math
import os
import re
from decimal import Decimal
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.color.srgb import Encoding
from plenoptic.core.files.codes import ALPHA
from plenoptic.core.files.file_limits import DEFAULT, FileLimits, check_memory, content_errors, read_file
from plenoptic.core.files.float_maps import read_pfm
from plenoptic.core.files.images import read_header, read_linear
from plenoptic.core.values import file_path, whole
from plenoptic.core.warn import warn
from plenoptic.errors import FileError, FileWarning, InvalidValueError
from plenoptic.lightfield.depth_map import DepthMap
from plenoptic.lightfield.views import LightField

_PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr", ".ppm", ".bmp")
_MAX_VIEWS = 10_000
_COLUMN_FIRST = re.compile(r"\d{3}_\d{3}")
"""File names of JPEG Pleno: column and row of the view."""
_WHOLE, _DECIMAL = (re.compile(rf"((?:(?:^|(?<=_))-)?[0-9]+{more})") for more in ("", r"(?:\.[0-9]+)?"))
"""Numbers in file names, with a sign at the start or behind `_`."""


def read_hci(folder: str | os.PathLike[str], *, limits: FileLimits = DEFAULT) -> LightField:
    """Read the light field in a scene's folder of the HCI 4D Light Field Benchmark.

    Parameters
    ----------
    folder : path-like
        Contains `input_Cam000.png`, ... and `parameters.cfg`; pixels outside an optional `valid_mask.png` are nan.
        `gt_depth_lowres.pfm` and `gt_disp_lowres.pfm`, of the central view, become `ground_truth`.
    limits : FileLimits
        The size of each file, and of all views.

    Returns
    -------
    LightField
        Linear, without camera and standard error: `exit_pupil` contains the positions of its cameras, `z_focus` and
        `object_spacing` the plane of disparity 0, and `u`, `v` count views from the central one.

    Raises
    ------
    FileError
        If a file is missing or malformed.

    References
    ----------
    K. Honauer et al., ACCV 2016, doi:10.1007/978-3-319-54187-7_2.

    Examples
    --------
    >>> import pathlib, tempfile, plenoptic as pl
    >>> camera = pl.camera.example_camera(pl.CameraKind.PLENOPTIC_1, shape=(110, 154), lattice=pl.Lattice.SQUARE)
    >>> white = pl.render_white(camera, samples=16, progress=False)
    >>> field = pl.lightfield.decode(white, white, views=3)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pl.export.hci(folder, field)
    ...     views = pl.lightfield.read_hci(folder)
    >>> views, round(views.disparity_at(-300.0)[0], 2)  # from the entrance pupil
    (LightField(3 x 3 views of 5 x 7 x 3), 0.35)
    """
    source = file_path(folder)
    path = source / "parameters.cfg"
    parser = configparser.ConfigParser(interpolation=None)
    with content_errors(path, "cannot be understood"):
        parser.read_string(read_file(path, limits).decode("utf-8"))
        inner, outer = parser["intrinsics"], parser["extrinsics"]
        across, down = int(outer["num_cams_x"]), int(outer["num_cams_y"])
        focus, baseline = 1e3 * float(outer["focus_distance_m"]), float(outer["baseline_mm"])
        sensor, focal_length = float(inner["sensor_size_mm"]), float(inner["focal_length_mm"])
    if not (across > 0 and down > 0 and across * down <= _MAX_VIEWS and min(focus, focal_length, sensor) > 0):
        raise FileError(f"{str(path)!r} holds {across} x {down} cameras at {focus:g} mm, which cannot be")
    files = [source / f"input_Cam{number:03d}.png" for number in range(across * down)]
    views = _read_view_files(files, (down, across), limits)
    mask = source / "valid_mask.png"
    if mask.is_file() and (lit := read_linear(mask, limits=limits)).shape[:2] == views.shape[2:4]:
        views[:, :, lit.max(axis=2) == 0] = np.nan
    spacing = sensor * focus / (focal_length * max(views.shape[2:4]))
    truth = _hci_truth(source, views.shape[2:4], limits)
    return dataclasses.replace(light_field(views, baseline, -focus, spacing), ground_truth=truth)


def _hci_truth(folder: Path, shape: tuple[int, ...], limits: FileLimits) -> DepthMap | None:
    """Depth and disparity of the central view in a scene's folder; None without both files."""
    maps = {}
    for name, unit in (("disp", 1.0), ("depth", 1e3)):
        path, maps[name] = folder / f"gt_{name}_lowres.pfm", np.full(shape, np.nan)
        if path.is_file():
            stored = read_pfm(path, limits=limits)
            if stored.shape != shape:
                raise FileError(f"{str(path)!r} has shape {stored.shape}, and the views {shape}; they must agree")
            maps[name] = unit * stored.astype(np.float64)
    if all(np.isnan(plane).all() for plane in maps.values()):
        return None
    return DepthMap(maps["disp"], np.zeros(shape), np.ones(shape), np.full(shape, np.nan), maps["depth"])


def read_views(
    folder: str | os.PathLike[str],
    shape: tuple[int, int],
    *,
    encoding: Encoding | None = None,
    limits: FileLimits = DEFAULT,
) -> LightField:
    """Read a light field from a folder of views, ordered by the numbers in their names, row by row from the upper left.

    The Stanford archives and most others have this form. Names of three digits, `_` and three digits are those of JPEG
    Pleno, which count columns first. If the rows are in reverse order, flip `views` of the result. If one number counts
    the views, a warning names a missing one.

    Parameters
    ----------
    folder : path-like
        Its pictures are the views; other files are ignored, and those whose names begin with a dot.
    shape : (int, int)
        Rows and columns of views, such as (17, 17).
    encoding : Encoding, optional
        As in `pl.images.read_linear`.
    limits : FileLimits
        The size of each file, and of all views.

    Returns
    -------
    LightField
        Linear, nan where alpha is 0; without camera, standard error and positions: refocus it by disparity.

    Raises
    ------
    FileError
        If the number of pictures is wrong, they differ in size, or names have the numbers of two views, or one order as
        whole numbers and another as decimals.

    Examples
    --------
    >>> import pathlib, tempfile, numpy as np, plenoptic as pl
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     for number in range(6):
    ...         view = np.full((4, 5, 3), 1000 * number, dtype=np.uint16)
    ...         pl.images.write_16bit(pathlib.Path(folder) / f"out_{number:02d}.png", view)
    ...     pl.lightfield.read_views(folder, (2, 3))
    LightField(3 x 2 views of 4 x 5 x 3)
    """
    source, (rows, columns) = file_path(folder), _view_counts(shape)
    if not source.is_dir():
        raise FileError(f"{str(source)!r} is no folder; give the one that holds the views")
    files = _in_order(
        [path for path in source.iterdir() if path.suffix.lower() in _PICTURES and not path.name.startswith(".")]
    )
    if all(_COLUMN_FIRST.fullmatch(path.stem) for path in files):
        files.sort(key=lambda path: path.stem[-3:] + path.stem[:3])
    if len(files) != rows * columns:
        raise FileError(f"{str(source)!r} holds {len(files)} pictures; {rows} x {columns} views are {rows * columns}")
    _warn_of_gap(files)
    return light_field(_read_view_files(files, (rows, columns), limits, encoding))


def _in_order(files: list[Path]) -> list[Path]:
    """Files by the text and the numbers of their names; FileError if these leave their order open."""

    def key(file: Path, number: re.Pattern[str]) -> list[Decimal | str]:
        return [Decimal(part) if k % 2 else part for k, part in enumerate(number.split(file.stem))]

    by_number, by_decimal = (sorted(files, key=lambda file: key(file, number)) for number in (_WHOLE, _DECIMAL))
    for first, second in pairwise(by_number):
        if key(first, _WHOLE) == key(second, _WHOLE):
            raise FileError(f"{str(first)!r} and {second.name!r} have the same numbers; remove one of them")
    for first, second in zip(by_number, by_decimal, strict=True):
        if first != second:
            raise FileError(
                f"{str(first)!r} and {second.name!r} have one order by whole numbers and another by decimals; rename "
                "the views, with as many digits in all of them"
            )
    return by_number


def _warn_of_gap(files: list[Path]) -> None:
    """Warn if the names differ in one number alone, and one of its values is missing."""
    columns = zip(*(_WHOLE.findall(file.stem) for file in files), strict=False)
    varying = [[int(number) for number in column] for column in columns if len(set(column)) > 1]
    steps = np.diff(varying[0]) if len(varying) == 1 else np.ones(1)
    if 0 < steps.min() < steps.max():
        k = int(steps.argmax())
        warn(
            f"number {varying[0][k] + steps.min()} is missing after {files[k].name!r}: views behind it may be out of "
            "place; add the missing view, or number the views without a gap",
            FileWarning,
        )


def read_eslf(
    path: str | os.PathLike[str],
    shape: tuple[int, int] = (14, 14),
    *,
    encoding: Encoding | None = None,
    limits: FileLimits = DEFAULT,
) -> LightField:
    """Read a light field from an ESLF image of macro-pixels, as written by the LFToolbox and Lytro's tools.

    Parameters
    ----------
    path : path-like
        Rows of the picture are rows of views times rows of pixels, each macro-pixel holding all views of one pixel.
    shape : (int, int), optional
        Rows and columns of views.
    encoding : Encoding, optional
        As in `pl.images.read_linear`.
    limits : FileLimits
        The size of the file and of the picture.

    Returns
    -------
    LightField
        Linear, nan where alpha is 0; without camera, standard error and positions: refocus it by disparity.

    Raises
    ------
    FileError
        If it is no picture, or its size is no multiple of the number of views.

    Examples
    --------
    >>> import pathlib, tempfile, numpy as np, plenoptic as pl
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pl.images.write_16bit(pathlib.Path(folder) / "a_eslf.png", np.zeros((8, 15, 3), dtype=np.uint16))
    ...     pl.lightfield.read_eslf(pathlib.Path(folder) / "a_eslf.png", (2, 3))
    LightField(3 x 2 views of 4 x 5 x 3)
    """
    (rows, columns), image = _view_counts(shape), _read_opaque(path, limits, encoding)
    height, width, channels = image.shape
    if height % rows or width % columns:
        raise FileError(
            f"{os.fspath(path)!r} has {height} x {width} pixels; {rows} x {columns} views do not divide them"
        )
    split = image.reshape(height // rows, rows, width // columns, columns, channels)
    return light_field(np.ascontiguousarray(split.transpose(3, 1, 0, 2, 4)))


def read_lftoolbox(
    path: str | os.PathLike[str], *, intrinsics: str | os.PathLike[str] | None = None, limits: FileLimits = DEFAULT
) -> LightField:
    """Read the light field `LF` from a decoded file of the Light Field Toolbox for MATLAB.

    Files of version 7.3 need the package h5py; those of versions 5 and 7, none.

    Parameters
    ----------
    path : path-like
        Such as `IMG_0001__Decoded.mat`: `LF` has indices [j, i, l, k, c]; a fourth channel is the weight.
    intrinsics : path-like, optional
        Calibration (`CalInfo.json`), whose matrix `EstCamIntrinsicsH` gives positions in mm: `exit_pupil`, `z_focus`
        and `object_spacing`, as of `read_hci`. Distortion is not corrected.
    limits : FileLimits
        The size of the file, and of all views.

    Returns
    -------
    LightField
        Integers are divided by the largest of their type; nan where the weight is 0. Colours are taken as linear.
        Without camera and standard error, and without `intrinsics` without positions: refocus it by disparity.

    Raises
    ------
    FileError
        If it contains no such array.

    Examples
    --------
    See `pl.export.lftoolbox`.
    """
    from plenoptic.core.files.array_files import matlab_array

    target = file_path(path)
    content = read_file(target, limits)
    with content_errors(target, "holds no light field LF that can be read"):
        array = matlab_array(content, "LF", limits)
    if array.ndim == 4:
        array = array[..., np.newaxis]
    if array.ndim != 5 or array.dtype.kind not in "uf" or array.shape[4] not in (1, 3, 4):
        raise FileError(
            f"{str(target)!r} has an LF of {array.dtype.name} {array.shape}; it must be (T, S, V, U, 1, 3 or 4)"
        )
    check_memory(4 * array.size, f"the views of {str(target)!r}", len(content), limits)
    largest = float(np.iinfo(array.dtype).max) if array.dtype.kind == "u" else 1.0
    views = (array[..., :3].transpose(1, 0, 2, 3, 4) / largest).astype(np.float32)
    if array.shape[4] == 4:
        views[array[..., 3].transpose(1, 0, 2, 3) == 0] = np.nan
    views = np.ascontiguousarray(views)
    if intrinsics is None:
        return light_field(views)
    baseline, z_focus, spacing = _toolbox_geometry(file_path(intrinsics), limits)
    return dataclasses.replace(light_field(views, baseline, z_focus), object_spacing=spacing)


def _toolbox_geometry(path: Path, limits: FileLimits) -> tuple[float, float, tuple[float, float]]:
    """Distance of neighbouring cameras, z of the plane of disparity 0, and its length of a pixel along x and y, in mm.

    Rays of the index i, k are at s = h11 i + h13 k at a distance of 0, with the slope u = h31 i + h33 k.
    """
    with content_errors(path, "holds no matrix EstCamIntrinsicsH"):
        matrix = np.array(json.loads(read_file(path, limits))["EstCamIntrinsicsH"], dtype=np.float64).reshape(5, 5)
        h11, h13, h31, h33 = (np.array([matrix[r, c], matrix[r + 1, c + 1]]) for r in (0, 2) for c in (0, 2))
        if not (np.isfinite(matrix).all() and h31.all() and h33.all()):
            raise ValueError("its views have no plane of disparity 0, or no cameras")
    cameras, focus = -h13 / h33, -h11 / h31
    (baseline, distance), spacing = (h11 + cameras * h31, focus - cameras), np.abs(h13 + focus * h33)
    wide, high = (1e3 * spacing).tolist()
    return 1e3 * float(baseline.mean()), -1e3 * float(distance.mean()), (wide, high)


def _view_counts(shape: tuple[int, int]) -> tuple[int, int]:
    if not isinstance(shape, tuple | list) or len(shape) != 2:
        raise InvalidValueError(f"shape is {shape!r}; it must be (rows of views, columns of views)")
    rows, columns = (whole(number, "shape", at_least=1, at_most=_MAX_VIEWS) for number in shape)
    return rows, columns


def _read_opaque(
    path: str | os.PathLike[str], limits: FileLimits, encoding: Encoding | None = None
) -> NDArray[np.float32]:
    """Read a picture as linear values; nan where its alpha is 0."""
    image = read_linear(path, encoding=encoding, limits=limits)
    if "A" in read_header(path).names:
        image[read_linear(path, channel=ALPHA, limits=limits)[:, :, 0] == 0] = np.nan
    return image


def _read_view_files(
    files: list[Path], shape: tuple[int, int], limits: FileLimits, encoding: Encoding | None = None
) -> NDArray[np.float32]:
    """Read views (U, V, rows, columns, C) from files row by row."""
    first = _read_opaque(files[0], limits, encoding)
    size = sum(file.stat().st_size for file in files if file.is_file())
    check_memory(len(files) * first.nbytes, f"{len(files)} views like {str(files[0])!r}", size, limits)
    views = np.empty((shape[1], shape[0], *first.shape), dtype=np.float32)
    for number, file in enumerate(files):
        # The first view has warned of an unknown encoding.
        view = _read_opaque(file, limits, Encoding.SRGB if encoding is None else encoding) if number else first
        if view.shape != first.shape:
            raise FileError(
                f"{str(file)!r} has shape {view.shape}, and {str(files[0])!r} {first.shape}; they must agree"
            )
        views[number % shape[1], number // shape[1]] = view
    return views


def light_field(
    views: NDArray[np.float32], baseline: float = math.nan, z_focus: float = math.nan, spacing: float = math.nan
) -> LightField:
    """Light field of views (U, V, rows, columns, C) without camera; distances in mm as in `read_hci`."""
    u, v = (np.arange(count, dtype=np.float64) - count // 2 for count in views.shape[:2])
    camera_positions = baseline * np.stack(np.meshgrid(u, -v, indexing="ij"), axis=-1)
    unknown = np.full((*views.shape[2:4], 2), np.nan)
    return LightField(
        views=views,
        standard_error=None,
        u=u,
        v=v,
        pixel=unknown,
        on_array=unknown,
        exit_pupil=camera_positions,
        pupil=np.full(camera_positions.shape, np.nan),
        origin=np.full(2, np.nan),
        spacing=(math.nan, math.nan),
        object_spacing=(spacing, spacing),
        z_focus=z_focus,
        camera=None,
    )
