"""Patterns of points for the deconvolution of light-field microscopy, as pyolaf and napari-LF hold them."""

from __future__ import annotations

import io
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.files.array_files import write_npz
from plenoptic.core.files.atomic_file import write_file, write_json
from plenoptic.core.values import check_kind
from plenoptic.errors import InvalidValueError
from plenoptic.export.pictures import folder_at, write_readme
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
    """Give a LightFieldCalibration these patterns in place of those that it would calculate."""
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
