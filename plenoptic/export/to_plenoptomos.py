"""For plenoptomos (N. Vigano et al., Optics Express 26 (2018), 22574): .vox files, HDF5 with images and optics."""

from __future__ import annotations

import io
import os
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.files.atomic_file import write_file
from plenoptic.core.files.codes import brightest, codes
from plenoptic.core.files.file_limits import DEFAULT, FileLimits, content_errors, read_file
from plenoptic.core.files.hdf5_files import hdf5, read_apart, vox_arrays
from plenoptic.core.values import check_kind, file_path
from plenoptic.errors import InvalidValueError
from plenoptic.export.lattice import lens_rows
from plenoptic.lightfield.raw_arrays import crop_in_white_image
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.rendering.exposure import Exposure

_ABOUT = {"units": "counts", "axes": "tau:sigma", "mode": "raw"}
_LARGEST_ANGLE = 1e-3
"""Largest angle of the array to the sensor in radians, which the format cannot express."""


class VoxFile(NamedTuple):
    """Content of a .vox file. See `read_plenoptomos`."""

    image: NDArray[Any]
    """(rows, columns) counts, or as its `mode` says."""
    white: NDArray[Any] | None
    dark: NDArray[Any] | None
    mode: str
    """raw, micro-image or sub-aperture."""
    numbers: dict[str, Any]
    """Numbers of the camera by path (`micro_lens/f2`, `sensor/pixel_size`, ...): arrays or floats, in mm and pixels."""


def plenoptomos(path: str | os.PathLike[str], shot: Exposure, white: Exposure) -> None:
    """Write a raw image with its white image and optics as a .vox file of plenoptomos, version v0.

    Needs the package h5py.

    Parameters
    ----------
    path : path-like
        Ends in .vox.
    shot, white : Exposure
        Images of the same pixels, `shot` with its camera; microlenses lie on a square or rectangular lattice along the
        sensor.

    Raises
    ------
    InvalidValueError
        For hexagonal, free and turned lattices, or if the white image has other pixels.
    FileError
        If the file cannot be written.

    Notes
    -----
    Counts are 16 bits, linear, the mean of the channels. The corner of the array that the program needs,
    (sensor position - array position) / pixel size, rows first, is that of the first whole micro image, and
    `physical_size` of a microlens is the distance of their images, as its own calibration finds them. Structure:
    data_format.py of the program.

    Not expressed: errors, truth, colour, hexagonal or turned lattices, more than one focal length, the lens
    but for focal length and f-number.

    Examples
    --------
    >>> import pathlib, tempfile, plenoptic as pl
    >>> camera = pl.camera.example_camera(pl.CameraKind.PLENOPTIC_1, shape=(110, 154), lattice=pl.Lattice.SQUARE)
    >>> white = pl.render_white(camera, samples=16, progress=False)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pl.export.plenoptomos(pathlib.Path(folder) / "shot.vox", white, white)
    ...     found = pl.export.read_plenoptomos(pathlib.Path(folder) / "shot.vox")
    >>> found.image.shape, found.mode, round(found.numbers["micro_lens/f2"], 6)
    ((110, 154), 'raw', 2.0)
    """
    check_kind(white, "white", Exposure, "pl.render_white(camera)")
    target, light = file_path(path), white.image[crop_in_white_image(shot, white)[0]]
    if target.suffix.lower() != ".vox":
        raise InvalidValueError(f"path is {str(target)!r}; it must end in .vox")
    numbers = _numbers(shot)
    pictures = {"image": shot.image, "white": light}
    file = io.BytesIO()
    with hdf5().File(file, "w") as opened:
        opened.attrs["description"], opened.attrs["version"] = "VoxelDataFormat", "v0"
        data, camera = opened.create_group("data"), opened.create_group("instrument/camera")
        for name, picture in pictures.items():
            counts = codes(picture.mean(axis=2), scale=brightest(picture), encoded=False)
            data.create_dataset(name, data=counts, compression="gzip").attrs.update(_ABOUT)
        camera.attrs["manufacturer"] = "plenoptic"
        for name, (value, about) in numbers.items():
            camera.create_dataset(name, data=value).attrs.update(about)
        opened.create_dataset("acquisition/type", data="reflection")
        opened.create_dataset("acquisition/exposure_time", data=1.0).attrs["units"] = "s"
    write_file(target, file.getvalue())


def _numbers(shot: Exposure) -> dict[str, tuple[Any, dict[str, str]]]:
    """Numbers of the camera, by path below instrument/camera, with units and axes."""
    lens = lens_rows(shot, turn=False)
    if lens.hexagonal or abs(lens.angle) > _LARGEST_ANGLE:
        raise InvalidValueError(
            f"this format holds square and rectangular lattices along the sensor; the microlenses are "
            f"{'hexagonal' if lens.hexagonal else f'turned by {lens.angle:.3g} rad'}; use pl.package"
        )
    lens, camera = lens.whole(shot.image.shape[:2]).rectangle(), lens.camera
    array, sensor = lens.array, camera.sensor
    across, row_pitch = lens.pitch
    points = cardinal_points(camera.lens, camera.wavelength)
    corner = lens.centre.min(axis=0) + 0.5 - 0.5 * np.array([row_pitch, across])
    z, pixel = camera.stop_to_microlenses - points.rear_principal, sensor.pixel_pitch
    mm = {"units": "mm"}
    return {
        "micro_lens/size": (np.rint([row_pitch, across]).astype(np.int32), {"axes": "tau:sigma", "units": "pixels"}),
        "micro_lens/physical_size": (np.array([row_pitch, across]) * pixel, {"axes": "t:s", **mm}),
        "micro_lens/micro_image_size": (np.array([row_pitch, across]), {"axes": "tau:sigma", "units": "pixels"}),
        "micro_lens/f2": (float(array.focal_lengths[0]), mm),
        "micro_lens/aperture": (float(array.focal_lengths[0] / min(array.pitches)), {}),
        "micro_lenses_array/size": (
            np.array([lens.row.max() + 1, lens.place.max() + 1], np.int32),
            {"axes": "tau:sigma"},
        ),
        "micro_lenses_array/position": (np.array([0.0, 0.0, z]), {"axes": "x:y:z", **mm}),
        "main_lens/pixel_size": (np.full(2, pixel * z / camera.microlenses_to_sensor), {"axes": "v:u", **mm}),
        "main_lens/f1": (float(points.efl), mm),
        "main_lens/aperture": (float(points.f_number), {}),
        "sensor/size": (np.array(shot.image.shape[:2], np.int32), {"axes": "tau:sigma", "units": "pixels"}),
        "sensor/pixel_size": (np.full(2, pixel), {"axes": "tau:sigma", **mm}),
        # The program takes its first two numbers for the corner along rows and columns.
        "sensor/position": (np.array([*(corner * pixel), z + camera.microlenses_to_sensor]), {"axes": "x:y:z", **mm}),
    }


def read_plenoptomos(path: str | os.PathLike[str], *, limits: FileLimits = DEFAULT) -> VoxFile:
    """Read a .vox file of plenoptomos. Needs the package h5py.

    Parameters
    ----------
    path : path-like
    limits : FileLimits
        The size of the file.

    Returns
    -------
    VoxFile

    Raises
    ------
    FileError
        If it is no such file.

    Examples
    --------
    See `plenoptomos`.
    """
    target = file_path(path)
    content = read_file(target, limits)
    with content_errors(target, "is no .vox file"):
        found = read_apart(vox_arrays, content, limits)
    camera = "instrument/camera/"
    numbers = {name.removeprefix(camera): array for name, array in found.items() if name.startswith(camera)}
    return VoxFile(
        image=found["data/image"],
        white=found.get("data/white"),
        dark=found.get("data/dark"),
        mode=str(found["mode"]),
        numbers={name: array if array.ndim else float(array) for name, array in numbers.items()},
    )
