"""For programs of light-field microscopy: napari-LF and pyolaf (after oLaF, A. Stefanoiu et al., 2019).

Raw images, and patterns of points for deconvolution.
"""

from __future__ import annotations

import io
import math
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.gaussian import object_plane
from plenoptic.core.files.array_files import write_npz
from plenoptic.core.files.atomic_file import write_file, write_json
from plenoptic.core.files.codes import COLOR_SPACE, brightest, codes
from plenoptic.core.files.images import LINEAR, write_codes
from plenoptic.core.values import check_kind
from plenoptic.errors import InvalidValueError
from plenoptic.export.lattice import lens_rows
from plenoptic.export.pictures import folder_at, write_readme
from plenoptic.lightfield.raw_arrays import crop_in_white_image
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points, magnification
from plenoptic.rendering.exposure import Exposure
from plenoptic.wave.spread_stack import WaveSpreadStack

_LEAST = 1e-6
"""Coefficients below this part of the largest one are left out for napari-LF."""

_LOAD_PYOLAF = '''"""H as LFM_computeLFMatrixOperators of pyolaf makes it; Ht is from LFM_computeBackwardPatterns."""

import numpy as np
from scipy.sparse import csr_matrix

patterns = np.load("H.npy")
H = np.empty(patterns.shape[:3], dtype=object)
for place in np.ndindex(H.shape):
    H[place] = csr_matrix(patterns[place])
'''

_LOAD_NAPARI = '''"""The psf_db of a calibration of napari-LF: run where lflib is found, then save the calibration."""

import numpy as np
from lflib.optics import PsfDatabase


def load(calibration):
    """Give a LightFieldCalibration these patterns in place of its own."""
    found = np.load("psf_db.npz")
    c = calibration
    db = PsfDatabase(c.nu, c.nv, c.ns, c.nt, float(found["z_center"]), found["z_coords"].tolist(),
                     int(found["supersample_factor"]))
    db.x_coords, db.y_coords, db.z_coords = found["x_coords"], found["y_coords"], found["z_coords"].tolist()
    ends = found["ends"]
    for place, first, last in zip(found["places"].tolist(), np.r_[0, ends[:-1]], ends):
        db.psf_coordinates[tuple(place)] = found["coordinates"][first:last]
        db.psf_coefficients[tuple(place)] = found["coefficients"][first:last]
    db.max_coefficient = found["coefficients"].max()
    c.psf_db, c.num_z_slices, c.z_center = db, len(db.z_coords), db.z_center
    c.um_per_z_slice = float(found["um_per_z_slice"])
    c.rayspread_db_generated = True
'''


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


def pyolaf_patterns(folder: str | os.PathLike[str], stack: WaveSpreadStack) -> None:
    """Write patterns of points as pyolaf's forward operator: `H.npy`, `patterns.json` and `load_patterns.py`.

    Parameters
    ----------
    folder : path-like
        Folder, made if it is missing; files of the same name are replaced.
    stack : WaveSpreadStack
        From `pl.wave.point_spread_stack`, of a sensor of odd numbers of rows and columns, so that a pixel lies behind
        the middle of a microlens, and a pitch of as many pixels, an odd number. `across` is pyolaf's TexNnum.

    Raises
    ------
    InvalidValueError
        For another sensor or pitch.
    FileError
        If a file cannot be written.

    Notes
    -----
    H.npy is (across, across, depths, rows, columns), float32: each pattern displaced by whole pixels so that the point
    itself is in the middle, as the program does it; its sum is the part of the light behind the main lens that lands.
    Programs of this family scale each pattern to a sum of 1.

    Not expressed: errors, colour, patterns that change over the image.

    Examples
    --------
    >>> import pathlib, tempfile, plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=4.25))
    >>> camera = pl.PlenopticCamera(lens=lens, sensor=pl.Sensor(shape=(255, 255), pixel_pitch=0.01),
    ...     microlenses=pl.MicrolensArray(pitch=0.21, focal_lengths=(2.0,), lattice=pl.Lattice.SQUARE),
    ...     stop_to_microlenses=123.3, microlenses_to_sensor=2.0)
    >>> stack = pl.wave.point_spread_stack(camera, [-500.0], across=1, progress=False)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pl.export.pyolaf_patterns(folder, stack)
    ...     sorted(path.name for path in pathlib.Path(folder).iterdir())
    ['H.npy', 'README.txt', 'load_patterns.py', 'patterns.json']
    """
    pixels = _check_stack(stack)
    target = folder_at(folder)
    depths, across = stack.images.shape[:2]
    parts = _parts(stack)
    steps = np.rint(((np.arange(across) + 0.5) / across - 0.5) * pixels).astype(int)
    patterns = np.zeros((across, across, depths, *parts.shape[-2:]), np.float32)
    for depth, i, j in np.ndindex(depths, across, across):
        patterns[i, j, depth] = _displace(parts[depth, i, j], -int(steps[i]), -int(steps[j]))
    file = io.BytesIO()
    np.save(file, patterns, allow_pickle=False)
    write_file(target / "H.npy", file.getvalue())
    instruction = "load_patterns.py shows how H.npy becomes H. Lengths in patterns.json: mm."
    _write_notes(target, stack, pixels, _LOAD_PYOLAF, "pyolaf", instruction)


def napari_lf_patterns(folder: str | os.PathLike[str], stack: WaveSpreadStack) -> None:
    """Write patterns of points as napari-LF's wave spreads: `psf_db.npz`, `patterns.json` and `load_patterns.py`.

    Parameters
    ----------
    folder, stack
        As of `pyolaf_patterns`, with the same errors. `across` is the program's supersample factor; depths are evenly
        spaced.

    Notes
    -----
    The program keeps such patterns in a calibration, as coordinates (u, v, s, t) of pixels, from the microlens in the
    middle, with coefficients. `load_patterns.py` puts them there; coefficients below 1e-6 of the largest are left out.

    Examples
    --------
    See `pyolaf_patterns`, with the same arguments.
    """
    pixels = _check_stack(stack)
    order = np.argsort(stack.z_objects)
    z = 1e3 * stack.z_objects[order]
    if len(z) > 2 and not np.allclose(np.diff(z), z[1] - z[0], rtol=1e-6):
        raise InvalidValueError("napari-LF knows depths with even steps; space z_objects evenly")
    target = folder_at(folder)
    parts, across = _parts(stack), stack.images.shape[1]
    threshold = _LEAST * float(parts.max())
    half = [(size - pixels) // 2 for size in parts.shape[-2:]]
    places, coordinates, coefficients = [], [], []
    for x, y, depth in np.ndindex(across, across, len(z)):
        part = parts[order[depth], y, x]
        rows, columns = np.nonzero(part > threshold)
        t, v = np.divmod(rows - half[0], pixels)
        s, u = np.divmod(columns - half[1], pixels)
        # Pixels of a direction one after the other, as the program reads them.
        sorted_ = np.lexsort((s, t, u, v))
        places.append((x, y, depth))
        coordinates.append(np.stack([u, v, s, t], axis=1)[sorted_].astype(np.int32))
        coefficients.append(part[rows, columns][sorted_].astype(np.float32))
    spacings = np.linalg.norm(np.diff(stack.points[order[0], 0], axis=0), axis=1)
    coords = 1e3 * (float(spacings.mean()) if across > 1 else 0.0) * (np.arange(across) - 0.5 * (across - 1))
    arrays = {
        "places": np.array(places),
        "ends": np.cumsum([len(part) for part in coefficients]),
        "coordinates": np.concatenate(coordinates),
        "coefficients": np.concatenate(coefficients),
        "x_coords": coords,
        "y_coords": coords,
        "z_coords": z - z.mean(),
        "z_center": 0.0,
        "um_per_z_slice": float(z[1] - z[0]) if len(z) > 1 else 0.0,
        "supersample_factor": across,
    }
    write_npz(target / "psf_db.npz", arrays)
    instruction = (
        "load_patterns.py gives a calibration of lflib these patterns. Lengths in psf_db.npz: um, in patterns.json: mm."
    )
    _write_notes(target, stack, pixels, _LOAD_NAPARI, "napari-LF", instruction)


def _check_stack(stack: WaveSpreadStack) -> int:
    """Pixels of a microlens, or an error if pixels do not lie behind microlenses as these programs need it."""
    check_kind(stack, "stack", WaveSpreadStack, "pl.wave.point_spread_stack(camera, z_objects, across=5)")
    array, sensor = stack.camera.microlenses, stack.camera.sensor
    assert array is not None
    pixels = [pitch / sensor.pixel_pitch for pitch in array.pitches]
    whole = round(pixels[0])
    if not np.allclose(pixels, whole, rtol=0, atol=1e-6) or whole % 2 == 0 or min(n % 2 for n in sensor.shape) == 0:
        raise InvalidValueError(
            f"microlenses are {pixels[0]:g} x {pixels[1]:g} pixels apart on a sensor of {sensor.shape[0]} x "
            f"{sensor.shape[1]}; these programs need one odd number of pixels, and odd numbers of rows and columns, "
            "with a pixel behind the middle of each microlens"
        )
    return whole


def _parts(stack: WaveSpreadStack) -> NDArray[np.float32]:
    """Images as parts of the light behind the main lens."""
    with np.errstate(invalid="ignore", divide="ignore"):
        scale = np.where(stack.light > 0, stack.camera.sensor.pixel_pitch**2 / stack.light, 0.0)
    return (stack.images * scale[..., None, None]).astype(np.float32)


def _displace(image: NDArray[np.float32], down: int, right: int) -> NDArray[np.float32]:
    """Image moved by pixels; pixels that enter are dark."""
    rows, columns = image.shape
    padded = np.pad(image, ((max(down, 0), max(-down, 0)), (max(right, 0), max(-right, 0))))
    return padded[max(-down, 0) :, max(-right, 0) :][:rows, :columns]


def _write_notes(
    target: Path, stack: WaveSpreadStack, pixels: int, script: str, program: str, instruction: str
) -> None:
    """Write a description of the patterns, a script that loads them, and instructions."""
    array, camera = stack.camera.microlenses, stack.camera
    assert array is not None
    content = {
        "z_objects": stack.z_objects.tolist(),
        "across": stack.images.shape[1],
        "pixels_of_a_microlens": pixels,
        "pixel_pitch": camera.sensor.pixel_pitch,
        "pitch": array.pitches[0],
        "wavelength_nm": camera.wavelength,
        "first_points": stack.points[:, 0, 0].tolist(),
        "error": stack.error,
    }
    write_json(target / "patterns.json", content)
    write_file(target / "load_patterns.py", script.encode("ascii"))
    write_readme(target, program, instruction, "errors, colour, patterns that change over the image.", {})
