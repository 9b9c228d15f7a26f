"""Writing packages."""

from __future__ import annotations

import dataclasses
import hashlib
import os
import platform
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from plenoptic import __version__
from plenoptic.camera.assembly import Rigid, assembly, rigid
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.points.centres import CentreMethod, microlens_centres
from plenoptic.camera.report.report import camera_report
from plenoptic.core.files import images
from plenoptic.core.files.array_files import write_npz
from plenoptic.core.files.atomic_file import replace_file, replace_folder, temporary_folder, write_file, write_json
from plenoptic.core.files.serialization import save_value
from plenoptic.core.values import check_kind, file_path, seed_number
from plenoptic.errors import FileError, InvalidValueError
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.microlens.aperture import Walls
from plenoptic.optics.sensor.model import SensorModel, ShotNoise
from plenoptic.package.calibration import calibration_points, targets_of
from plenoptic.package.reading import CAMERA, POINTS, PROVENANCE, PROVENANCE_FORMAT, TRUTH, centre_arrays, centre_table
from plenoptic.rendering.exposure import Exposure
from plenoptic.rendering.plan.plan import plan
from plenoptic.scene.shapes.targets.target import Target
from plenoptic.truth.truth_arrays import file_comment, file_planes

if TYPE_CHECKING:
    from plenoptic.scene.scene import Scene

_WHITE_PART = 0.8
"""Part of the white level that the brightest pixels of a white image reach."""

_OF_FILES = (".json", ".exr", ".tif", ".tiff", ".png", ".npz", ".csv")


def write(
    path: str | os.PathLike[str],
    exposure: Exposure,
    white: Exposure | None = None,
    *,
    sensor: SensorModel | None = None,
    other_whites: Sequence[Exposure] = (),
    targets: Target | Sequence[Target] = (),
    scene: Scene | None = None,
    seed: int = 0,
) -> None:
    """Write a picture with its white image, truth and camera into a folder or a zip file, which `read` opens.

    docs/package.md describes the files. Programs that know nothing of this library find 16-bit images, CSV, JSON
    and NPZ files there.

    Parameters
    ----------
    path : path-like
        A new or empty folder, or one that holds a package, which is replaced; with the ending `.zip`, one file.
    exposure : Exposure
        Exposure of `render`, which names its camera.
    white : Exposure, optional
        White image of `render_white`, of the same camera.
    sensor : SensorModel, optional
        Sensor that reads the exposure out, of at least 8 bits. None: 16 bits without noise, on which the brightest
        pixel reaches 0.8 of the white level.
    other_whites : sequence of Exposure, optional
        White images at other stops; each names its camera.
    targets : Target or sequence of Target, optional
        Targets, the points of which are written as calibration points.
    scene : Scene, optional
        The rendered scene: for the plan, and for surfaces that hide calibration points.
    seed : int, optional
        Seed of the noise of raw, white (seed + 1), dark (seed + 2) and further white images.

    Raises
    ------
    InvalidValueError
        If the exposure names no camera, white images are of other cameras, or the sensor has no quantisation.
    FileError
        If the package cannot be written.

    Examples
    --------
    >>> import pathlib, tempfile, plenoptic as pl
    >>> camera = pl.camera.example_camera(shape=(64, 64))
    >>> shot = pl.render(pl.check_scene(), camera, samples=8, progress=False)
    >>> white = pl.render_white(camera, samples=8, progress=False)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pl.package.write(pathlib.Path(folder) / "shot", shot, white)
    ...     found = pl.package.read(pathlib.Path(folder) / "shot")
    >>> found.camera == camera, found.exposure == shot, found.raw.data.dtype
    (True, True, dtype('uint16'))
    """
    target, seed = file_path(path), seed_number(seed)
    camera = _checked_camera(exposure, white, other_whites)
    model = _noiseless_sensor(exposure) if sensor is None else sensor
    check_kind(model, "sensor", SensorModel, "pl.SensorModel(photon_rate=1e6)")
    zipped = target.suffix.lower() == ".zip"
    _check_replaceable(target, zipped=zipped)
    with temporary_folder() if zipped else replace_folder(target) as folder:
        _write_images(folder, exposure, white, tuple(other_whites), model, seed)
        _write_camera(folder, camera)
        if listed := targets_of(targets):
            write_file(folder / POINTS, calibration_points(camera, listed, scene=scene).to_csv().encode("ascii"))
        _write_provenance(folder, exposure, None if scene is None else str(_plan(exposure, scene, camera)).splitlines())
        if zipped:
            with replace_file(target) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
                for part in sorted(folder.iterdir()):
                    archive.write(part, part.name)


def _checked_camera(exposure: Exposure, white: Exposure | None, others: Sequence[Exposure]) -> PlenopticCamera:
    for name, value in [("exposure", exposure), ("white", white), *(("other_whites", other) for other in others)]:
        if value is not None or name != "white":
            check_kind(value, name, Exposure, "pl.render(scene, camera)")
    camera = exposure.camera
    if camera is None:
        raise InvalidValueError("the exposure names no camera; give one that render made")
    for shot in (white, *others):
        if shot is not None and shot.white is False:
            raise InvalidValueError("a white image shows a scene; give what pl.render_white(camera) made")
    if white is not None and white.camera not in (None, camera):
        raise InvalidValueError("the white image is of another camera than the exposure; render it with the same one")
    if any(other.camera is None for other in others):
        raise InvalidValueError("other_whites holds an exposure without a camera; give what render_white made")
    return camera


def _noiseless_sensor(exposure: Exposure) -> SensorModel:
    brightest = float(np.nanmax(exposure.image, initial=0.0))
    rate = _WHITE_PART * 65535 / brightest if brightest > 0 else 1.0
    return SensorModel(rate, bits=16, shot_noise=ShotNoise.NONE)


def _white_sensor(white: Exposure, model: SensorModel) -> SensorModel:
    """The sensor with the photon rate at which the brightest pixels of a white image reach 0.8 of the white level."""
    brightest = float(np.max(white.image.max(axis=(0, 1)) * np.broadcast_to(model.electrons_per_unit, 3)))
    electrons = _WHITE_PART * (model.white_level - model.black_level) / model.gain - model.dark_electrons
    if not brightest > 0 or not electrons > 0:
        return model
    rate = tuple(np.atleast_1d(model.photon_rate) * (electrons / brightest))
    return dataclasses.replace(model, photon_rate=rate if len(rate) > 1 else rate[0])


def _write_images(
    folder: Path,
    exposure: Exposure,
    white: Exposure | None,
    others: tuple[Exposure, ...],
    model: SensorModel,
    seed: int,
) -> None:
    """Write the images as light and as raw images, and the truth."""
    light = dataclasses.replace(exposure, truth=None)
    light.save(folder / "raw.exr")
    exposure.develop(model, seed=seed).save(folder / "raw.tif")
    whites = {} if white is None else {"white": white}
    for other in others:
        whites[_white_name(other, whites)] = other
    for number, (name, image) in enumerate(whites.items()):
        image.save(folder / f"{name}.exr")
        image.develop(_white_sensor(image, model), seed=seed + 1 + number + (number > 0)).save(folder / f"{name}.tif")
    dark = dataclasses.replace(light, image=np.zeros_like(exposure.image), standard_error=None)
    dark.develop(model, seed=seed + 2).save(folder / "dark.tif")
    if exposure.truth is not None:
        note = {"plenoptic:note": file_comment(exposure.truth)}
        images.write_channels(folder / "truth.exr", file_planes(exposure.truth), note)
        write_npz(folder / TRUTH, exposure.truth.arrays())


def _write_camera(folder: Path, camera: PlenopticCamera) -> None:
    """Write the camera and the centres of its micro images."""
    save_value(camera, folder / CAMERA, about=_camera_description(camera))
    if camera.microlenses is not None:
        walls = camera.microlenses.walls is Walls.OPAQUE
        methods = [method for method in CentreMethod if not (walls and method is CentreMethod.CENTROID)]
        arrays = centre_arrays({method: microlens_centres(camera, method) for method in methods})
        write_npz(folder / "centres.npz", arrays)
        write_file(folder / "centres.csv", centre_table(arrays).encode("ascii"))


def _white_name(white: Exposure, taken: Any) -> str:
    assert white.camera is not None
    name = base = f"white_f{cardinal_points(white.camera.lens, white.camera.wavelength).f_number:.3g}"
    number = 2
    while name in taken:
        name, number = f"{base}_{number}", number + 1
    return name


def _camera_description(camera: PlenopticCamera) -> dict[str, Any]:
    """Description of a camera for other programs, beside its value."""
    parts, sensor = assembly(camera), camera.sensor
    description: dict[str, Any] = {
        "units": "mm, nm, radians; light in the scene's units",
        "axes": "of the camera: origin at the centre of the iris, x right, y up, the scene at z < 0, the sensor at "
        "z > 0; rotations take a part's own axes to the camera's",
        "pixels": "row 0, column 0 is the upper left of the upright picture; whole numbers are centres of pixels; from "
        "the sensor's centre, x = -(column + 1/2 - columns/2) pitch and y = (row + 1/2 - rows/2) pitch",
        "sensor": {"rows": sensor.shape[0], "columns": sensor.shape[1], "pixel_pitch": sensor.pixel_pitch},
        "sensor_as_built": _pose_of(rigid(camera.sensor_placement, camera.z_sensor)),
        "lens_as_built": _pose_of(rigid(camera.lens_placement, 0.0)),
        "lens_vertices": camera.lens.vertices.tolist(),
        "lens_indices": camera.lens.indices(camera.wavelength).tolist(),
        "report": str(camera_report(camera)).splitlines(),
    }
    array = camera.microlenses
    if array is not None:
        description["array_as_built"] = _pose_of(rigid(camera.microlenses_placement, camera.stop_to_microlenses))
        description["array_origin_and_turn_before_the_lens"] = [parts.array_origin.tolist(), parts.array_turn.tolist()]
        description["array"] = {
            "lattice": array.lattice.name,
            "basis": None if array.centres is not None else array.basis.tolist(),
            "pitches": list(array.pitches),
            "extent": array.extent,
            "focal_lengths": list(array.focal_lengths),
            "distance_to_sensor": camera.microlenses_to_sensor,
        }
    return description


def _pose_of(part: Rigid) -> dict[str, Any]:
    return {"rotation": part.turn.tolist(), "origin": part.shift.tolist()}


def _plan(exposure: Exposure, scene: Scene, camera: PlenopticCamera) -> Any:
    options = {} if exposure.settings is None else vars(exposure.settings)
    return plan(scene, camera, samples=exposure.samples or 1, replicates=exposure.replicates or 1, **options)


def _write_provenance(folder: Path, exposure: Exposure, plan_lines: list[str] | None) -> None:
    """Write the provenance: versions, seed, samples, error, plan, and the hash of every file."""
    files, error = {}, exposure.relative_error
    for path in sorted(folder.iterdir()):
        with open(path, "rb") as file:
            files[path.name] = hashlib.file_digest(file, "sha256").hexdigest()
    content = {
        "format": PROVENANCE_FORMAT,
        "versions": {"plenoptic": __version__, "numpy": np.__version__, "python": platform.python_version()},
        "seed": exposure.seed,
        "samples": exposure.samples,
        "replicates": exposure.replicates,
        "relative_error": error if error is not None and np.isfinite(error) else None,
        "plan": plan_lines,
        "files": files,
    }
    write_json(folder / PROVENANCE, content)


def _check_replaceable(target: Path, *, zipped: bool) -> None:
    """Raise FileError if the target is something else than a package."""
    if target.suffix.lower() in _OF_FILES:
        raise FileError(f"{str(target)!r} ends in {target.suffix}; a package is a folder, or a file that ends in .zip")
    if zipped and target.is_file():
        try:
            with zipfile.ZipFile(target) as archive:
                is_package = PROVENANCE in archive.namelist()
        except (OSError, zipfile.BadZipFile):
            is_package = False
        if not is_package:
            raise FileError(f"the file {str(target)!r} is something else than a package; choose a new name")
    elif not zipped and (target.exists() or target.is_symlink()):
        if not target.is_dir() or target.is_symlink():
            raise FileError(f"{str(target)!r} is no folder; choose another name, or one that ends in .zip")
        if not (target / PROVENANCE).is_file() and any(target.iterdir()):
            raise FileError(f"the folder {str(target)!r} holds something else than a package; choose a new one")
