"""For programs of light-field microscopy: napari-LF and pyolaf (after oLaF, A. Stefanoiu et al., 2019)."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np

from plenoptic.camera.gaussian import object_plane
from plenoptic.core.files.atomic_file import write_file, write_json
from plenoptic.core.files.codes import brightest, codes
from plenoptic.core.files.images import COLOR_SPACE, LINEAR, write_codes
from plenoptic.errors import InvalidValueError
from plenoptic.export.lattice import lens_rows
from plenoptic.export.pictures import folder_at, write_readme
from plenoptic.lightfield.raw_arrays import crop_in_white_image
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points, magnification
from plenoptic.rendering.exposure import Exposure


class _Microscope(NamedTuple):
    """The camera in a microscope's words; lengths in micrometres."""

    magnification: float
    aperture: float
    """NA, in air."""
    tube: float
    """Focal length of a tube lens, at which the array lies, that has this magnification with an objective."""
    pitch: float
    focal_length: float
    to_sensor: float
    pixel: float
    wavelength: float


def napari_lf(folder: str | os.PathLike[str], shot: Exposure, white: Exposure) -> None:
    """Write a project folder of napari-LF: light field, radiometry and dark frame, and `metadata.txt`.

    Parameters
    ----------
    folder : path-like
        Folder, made if it is missing; files of the same name are replaced.
    shot, white : Exposure
        Images of the same pixels, `shot` with its camera: one focal length, a square lattice, a plane in focus.

    Raises
    ------
    InvalidValueError
        For other lattices, several focal lengths, or without a plane in focus.
    FileError
        If a file cannot be written.

    Notes
    -----
    Images are 16 bits, linear. The main lens becomes an objective with a tube lens of 200 mm; the program knows whole
    magnifications only, and README.txt states it.

    Not expressed: errors, truth, colour of points, other lattices, a main lens that is no microscope.

    Examples
    --------
    >>> import pathlib, tempfile, plenoptic as pl
    >>> camera = pl.camera.example_camera(pl.CameraKind.PLENOPTIC_1, shape=(110, 154), lattice=pl.Lattice.SQUARE)
    >>> white = pl.render_white(camera, samples=16, progress=False)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pl.export.napari_lf(folder, white, white)
    ...     sorted(path.name for path in pathlib.Path(folder).iterdir())
    ['README.txt', 'dark_frame.tif', 'light_field.tif', 'metadata.txt', 'radiometry_frame.tif']
    """
    scope, target = _microscope(shot), folder_at(folder)
    scales = _pictures(target, shot, white, ("light_field", "radiometry_frame", "dark_frame"))
    whole_number = max(1, round(scope.magnification))
    said = {
        "main": {"comments": "rendered by plenoptic"},
        "calibrate": {
            "ulens_pitch": scope.pitch,
            "pixel_size": scope.pixel,
            "ulens_focal_length": scope.focal_length,
            "ulens_focal_distance": scope.to_sensor,
            "objective_magnification": whole_number,
            "objective_na": scope.aperture,
            "tubelens_focal_length": 1e-3 * scope.tube,
            "center_wavelength": 1e3 * scope.wavelength,
            "medium_index": 1.0,
            "ulens_fill_factor": 1.0,
            "pixel_fill_factor": 1.0,
            "ulens_profile": "rect",
        },
    }
    write_json(target / "metadata.txt", said)
    write_readme(
        target,
        "napari-LF",
        "Open the folder as a project; lengths in metadata.txt are um, mm for the tube lens, nm for the wavelength.",
        "errors, truth, several focal lengths; a magnification that is no whole number: metadata.txt has the nearest "
        "one from 1, which is wrong by the factor below.",
        scales | {"magnification over that of metadata.txt": scope.magnification / whole_number},
    )


def pyolaf(folder: str | os.PathLike[str], shot: Exposure, white: Exposure) -> None:
    """Write a folder of pyolaf: `example.tif`, the white image `calib.tif`, and `config.yaml`.

    Parameters
    ----------
    folder, shot, white
        As for `napari_lf`, with the same errors; with the sensor in the focal plane of the microlenses.

    Notes
    -----
    Images are 16 bits, linear, of one channel. Lengths in `config.yaml` are micrometres.

    Not expressed: errors, truth, colour, other lattices, focused (2.0) cameras, a main lens that is
    no microscope.

    Examples
    --------
    See `napari_lf`, with the same arguments.
    """
    scope = _microscope(shot)
    if not math.isclose(scope.to_sensor, scope.focal_length, rel_tol=1e-3):
        raise InvalidValueError(
            f"the sensor is {1e-3 * scope.to_sensor:g} mm behind microlenses of {1e-3 * scope.focal_length:g} mm; "
            "pyolaf's focused cameras need the distances of a tube lens, which this one does not have; use pl.package"
        )
    target = folder_at(folder)
    scales = _pictures(target, shot, white, ("example", "calib"))
    said = {
        "gridType": "reg",
        "focus": "single",
        "plenoptic": 1,
        "uLensMask": 1,
        "M": scope.magnification,
        "NA": scope.aperture,
        "ftl": scope.tube,
        "fm": scope.focal_length,
        "tube2mla": scope.tube,
        "mla2sensor": scope.to_sensor,
        "lensPitch": scope.pitch,
        "pixelPitch": scope.pixel,
        "WaveLength": scope.wavelength,
        "n": 1.0,
    }
    write_file(target / "config.yaml", "".join(f"{name}: {value}\n" for name, value in said.items()).encode("ascii"))
    instruction = (
        "config.yaml: lengths in um. calib.tif: white image; example.tif: raw image.\n"
        "Its search for lenses wants images of less than 0.7 of their distance: stop the lens of calib.tif down."
    )
    write_readme(target, "pyolaf", instruction, "errors, truth, several focal lengths.", scales)


def _pictures(target: Path, shot: Exposure, white: Exposure, names: tuple[str, ...]) -> dict[str, float]:
    """Write raw, white and dark image; returns the values of their largest codes."""
    light = white.image[crop_in_white_image(shot, white)[0]]
    pictures = dict(zip(names, (shot.image, light, np.zeros_like(light)), strict=False))
    scales = {f"full code of {name}.tif, in its units": brightest(image) for name, image in pictures.items()}
    for (name, image), scale in zip(pictures.items(), scales.values(), strict=True):
        # Of one channel: pyolaf cannot read three.
        grey = codes(image.mean(axis=2, keepdims=True), scale=scale, encoded=False)
        write_codes(target / f"{name}.tif", grey, {COLOR_SPACE: LINEAR})
    return scales


def _microscope(shot: Exposure) -> _Microscope:
    lens = lens_rows(shot, turn=False)
    camera, array = lens.camera, lens.array
    if lens.hexagonal or len(array.focal_lengths) > 1 or not math.isclose(*lens.pitch, rel_tol=1e-3):
        raise InvalidValueError(
            f"napari-LF and pyolaf know square lattices of one focal length; this camera has {array.lattice.name} and "
            f"{len(array.focal_lengths)} focal lengths; use pl.package"
        )
    z = object_plane(camera.lens, camera.stop_to_microlenses, camera.wavelength)
    points = cardinal_points(camera.lens, camera.wavelength)
    if not (math.isfinite(z) and z < points.entrance_pupil):
        raise InvalidValueError("no plane is in focus on the array, which a microscope has; see camera.focused_at")
    sine = math.sin(math.atan(points.entrance_pupil_semi_diameter / (points.entrance_pupil - z)))
    return _Microscope(
        magnification=abs(magnification(camera.lens, z, camera.wavelength)),
        aperture=sine,
        tube=200e3,
        pitch=1e3 * min(array.pitches),
        focal_length=1e3 * array.focal_lengths[0],
        to_sensor=1e3 * camera.microlenses_to_sensor,
        pixel=1e3 * camera.sensor.pixel_pitch,
        wavelength=1e-3 * camera.wavelength,
    )
