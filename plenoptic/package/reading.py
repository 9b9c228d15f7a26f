"""Reading packages."""

from __future__ import annotations

import dataclasses
import hashlib
import io
import json
import os
import re
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.files.atomic_file import translate_errors, write_file
from plenoptic.core.files.file_limits import DEFAULT, FileLimits, allowed_memory, check_file, read_file
from plenoptic.core.files.value_files import load_value
from plenoptic.core.values import file_path
from plenoptic.errors import FileError, InvalidValueError
from plenoptic.package.calibration import CalibrationPoints
from plenoptic.package.contents import CAMERA, POINTS, PROVENANCE, PROVENANCE_FORMAT, TRUTH, Package, centres_from
from plenoptic.readout.raw import RawImage
from plenoptic.rendering.exposure import Exposure
from plenoptic.truth.channels import CHANNELS, GroundTruth

_NAME = re.compile(r"[a-z0-9_.-]+\.(exr|tif|json|npz|csv)")
"""How files of a package are named: nothing else is looked at."""
_MOST_FILES = 200


def read(path: str | os.PathLike[str], *, limits: FileLimits = DEFAULT) -> Package:
    """Open a package that `write` wrote.

    Parameters
    ----------
    path : path-like
        The folder, or the zip file.
    limits : FileLimits
        The size of each file, and of each image.

    Returns
    -------
    Package
        Everything as written, to the last bit.

    Raises
    ------
    FileError
        Where there is no package, a file is missing, or its hash is not the one noted: it has been changed.

    Examples
    --------
    See `write`.
    """
    source = file_path(path)
    if source.is_dir():
        return _read(source, limits)
    check_file(source, limits)
    with _unpack(source, limits) as folder:
        return _read(folder, limits)


@contextmanager
def _unpack(source: Path, limits: FileLimits) -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="plenoptic-") as folder, translate_errors(source, "read"):
        try:
            with zipfile.ZipFile(source) as archive:
                entries = [entry for entry in archive.infolist() if _NAME.fullmatch(entry.filename)][:_MOST_FILES]
                room = allowed_memory(source.stat().st_size, limits)
                for entry in entries:
                    with archive.open(entry) as packed:
                        content = packed.read(min(limits.file_size, room) + 1)
                    room -= len(content)
                    if len(content) > limits.file_size or room < 0:
                        raise FileError(
                            f"{str(source)!r} holds {entry.filename} and more than may be unpacked; if you trust it, "
                            "give limits=pl.images.FileLimits(file_size=..., memory=...)"
                        )
                    write_file(Path(folder, entry.filename), content)
        except (zipfile.BadZipFile, RuntimeError, NotImplementedError, EOFError) as error:
            raise FileError(f"{str(source)!r} is no zip file of a package: {error}") from None
        yield Path(folder)


def _read(folder: Path, limits: FileLimits) -> Package:
    provenance = _provenance(folder, limits)
    files = provenance["files"]
    for name, noted in files.items():
        if hashlib.sha256(read_file(folder / name, limits)).hexdigest() != noted:
            raise FileError(f"{str(folder / name)!r} has been changed since it was written; restore it from its origin")
    camera = load_value(folder / CAMERA, limits=limits)
    if not isinstance(camera, PlenopticCamera):
        raise FileError(f"{str(folder / CAMERA)!r} holds a {type(camera).__name__}; it must hold a camera")
    exposure = Exposure.load(folder / "raw.exr", limits=limits)
    if TRUTH in files:
        exposure = dataclasses.replace(exposure, truth=_truth(folder / TRUTH, limits))
    whites = {name.removesuffix(".exr") for name in files if name.startswith("white") and name.endswith(".exr")}
    pairs = {name: _pair(folder, name, limits) for name in sorted(whites)}
    raw, dark = (_raw(folder / name, camera, limits) for name in ("raw.tif", "dark.tif"))
    white, white_raw = pairs.pop("white", (None, None))
    centres = centres_from(_arrays(folder / "centres.npz", limits)) if "centres.npz" in files else MappingProxyType({})
    points = read_file(folder / POINTS, limits).decode("latin-1") if POINTS in files else None
    return Package(
        exposure=exposure,
        raw=raw,
        camera=camera,
        white=white,
        white_raw=white_raw,
        other_whites=tuple(pairs.values()),
        dark=dark,
        centres=centres,
        points=None if points is None else CalibrationPoints.from_csv(points),
        provenance=MappingProxyType(provenance),
    )


def _provenance(folder: Path, limits: FileLimits) -> dict[str, Any]:
    path = folder / PROVENANCE
    if not path.is_file():
        raise FileError(f"{str(folder)!r} is no package: it holds no {PROVENANCE}; give the folder that write made")
    try:
        provenance = json.loads(read_file(path, limits))
    except (ValueError, RecursionError) as error:
        raise FileError(f"{str(path)!r} is not JSON: {error}; {str(folder)!r} is no package") from None
    if not isinstance(provenance, dict) or provenance.get("format") != PROVENANCE_FORMAT:
        raise FileError(f"{str(path)!r} has another format than {PROVENANCE_FORMAT!r}; perhaps a later version's")
    files = provenance.get("files")
    if not isinstance(files, dict) or len(files) > _MOST_FILES or not all(map(_NAME.fullmatch, files)):
        raise FileError(f"{str(path)!r} must list the files of the package")
    if missing := {"raw.exr", "raw.tif", "dark.tif", CAMERA} - set(files):
        raise FileError(f"{str(path)!r} lists no {', '.join(sorted(missing))}; a package has them")
    return provenance


def _pair(folder: Path, name: str, limits: FileLimits) -> tuple[Exposure, RawImage]:
    exposure = Exposure.load(folder / f"{name}.exr", limits=limits)
    return exposure, _raw(folder / f"{name}.tif", exposure.camera, limits)


def _raw(path: Path, camera: PlenopticCamera | None, limits: FileLimits) -> RawImage:
    return dataclasses.replace(RawImage.load(path, limits=limits), camera=camera)


def _truth(path: Path, limits: FileLimits) -> GroundTruth:
    arrays = {name: array for name, array in _arrays(path, limits).items() if name in CHANNELS}
    try:
        return GroundTruth(**arrays)
    except InvalidValueError as error:
        raise FileError(f"{str(path)!r} holds no possible ground truth: {error}") from None


def _arrays(path: Path, limits: FileLimits) -> Mapping[str, NDArray[Any]]:
    """The arrays of an NPZ file, which may claim to be of any size."""
    content = read_file(path, limits)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            memory = sum(entry.file_size for entry in archive.infolist())
        if memory > allowed_memory(len(content), limits):
            raise ValueError(f"it would take {memory} bytes; give limits=pl.images.FileLimits(memory={memory})")
        with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except (ValueError, OSError, EOFError, MemoryError, KeyError, zipfile.BadZipFile, RuntimeError) as error:
        raise FileError(f"{str(path)!r} cannot be read: {error}; restore it from its origin") from None
