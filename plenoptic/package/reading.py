"""Contents of packages, and reading them."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import re
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.points.centres import CentreMethod, MicrolensCentres
from plenoptic.core.files.array_files import read_npz
from plenoptic.core.files.atomic_file import recover_folder, temporary_folder, translate_errors, write_file
from plenoptic.core.files.file_limits import DEFAULT, FileLimits, allowed_memory, check_file, content_errors, read_file
from plenoptic.core.files.serialization import load_value
from plenoptic.core.files.text_lines import csv_text
from plenoptic.core.values import file_path, result
from plenoptic.errors import FileError
from plenoptic.package.calibration import CalibrationPoints
from plenoptic.readout.raw import RawImage
from plenoptic.rendering.exposure import Exposure
from plenoptic.truth.channels import CHANNELS, GroundTruth

PROVENANCE, CAMERA, TRUTH, POINTS = "provenance.json", "camera.json", "truth.npz", "points.csv"
PROVENANCE_FORMAT = "plenoptic-package-1"
_NAME = re.compile(r"[a-z0-9_.-]+\.(exr|tif|json|npz|csv)")
"""How files of a package are named: nothing else is looked at."""
_MOST_FILES = 200
_TEXT_EXPANSION = 32
"""Size of a text over its packed size, at most: tables of numbers have some 3, descriptions of cameras 10."""


@result
class Package:
    """A picture of a plenoptic camera with all that belongs to it. See `write` and `read`.

    Parameters
    ----------
    exposure : Exposure
        The picture as light, with its standard error and truth.
    raw : RawImage
        The same as its sensor reads it out.
    camera : PlenopticCamera
        Camera of the picture.
    white : Exposure or None
        Its white image.
    white_raw : RawImage or None
        The same as the sensor reads it out, lit so that its brightest pixels reach 0.8 of the white level.
    other_whites : tuple of (Exposure, RawImage)
        White images at other stops; each exposure names its camera.
    dark : RawImage
        Raw image without light.
    centres : mapping from CentreMethod to MicrolensCentres
        Centres of the micro images, where they are defined; empty without microlenses.
    points : CalibrationPoints or None
        Points of calibration targets on the sensor.
    provenance : mapping
        Versions, seeds, samples, error, plan, and the SHA-256 of every file.
    """

    exposure: Exposure
    raw: RawImage
    camera: PlenopticCamera
    white: Exposure | None
    white_raw: RawImage | None
    other_whites: tuple[tuple[Exposure, RawImage], ...]
    dark: RawImage
    centres: Mapping[CentreMethod, MicrolensCentres]
    points: CalibrationPoints | None
    provenance: Mapping[str, Any]

    def __repr__(self) -> str:
        whites = (self.white is not None) + len(self.other_whites)
        parts = [
            f"{whites} white image{'s' * (whites != 1)}",
            f"{max(map(len, self.centres.values()), default=0)} microlenses",
        ]
        parts += [] if self.points is None else [repr(self.points)]
        return f"Package({self.exposure!r}, {', '.join(parts)})"


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
        If there is no package, a file is missing, or its hash is not the one noted: it has been changed.

    Examples
    --------
    See `write`.
    """
    source = file_path(path)
    with content_errors(source, "is no package that can be read"):
        recover_folder(source)
        if source.is_dir():
            return _read(source, limits)
        check_file(source, limits)
        with _unpack(source, limits) as folder:
            try:
                return _read(folder, limits)
            except FileError as error:
                # The folder is gone when the message is read.
                raise FileError(str(error).replace(repr(str(folder))[1:-1], repr(str(source))[1:-1])) from None


@contextmanager
def _unpack(source: Path, limits: FileLimits) -> Iterator[Path]:
    with temporary_folder() as folder, translate_errors(source, "read"):
        with zipfile.ZipFile(source) as archive:
            entries = [entry for entry in archive.infolist() if _NAME.fullmatch(entry.filename)][:_MOST_FILES]
            room = allowed_memory(source.stat().st_size, limits)
            for entry in entries:
                is_text = entry.filename.endswith((".csv", ".json"))
                limit = max(_TEXT_EXPANSION * entry.compress_size, 1 << 20) if is_text else limits.file_size
                limit = min(limit, limits.file_size, room)
                with archive.open(entry) as packed:
                    content = packed.read(limit + 1)
                room -= len(content)
                if len(content) > limit:
                    raise FileError(
                        f"{str(source)!r} holds {entry.filename} and more than may be unpacked; if you trust it, "
                        "unpack it, or give limits=pl.images.FileLimits(file_size=..., memory=...)"
                    )
                write_file(folder / entry.filename, content)
        yield folder


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
    pairs = {}
    for name in sorted(file[:-4] for file in files if file.startswith("white") and file.endswith(".exr")):
        image = Exposure.load(folder / f"{name}.exr", limits=limits)
        pairs[name] = image, _raw(folder / f"{name}.tif", image.camera, limits)
    raw, dark = (_raw(folder / name, camera, limits) for name in ("raw.tif", "dark.tif"))
    white, white_raw = pairs.pop("white", (None, None))
    centres = centres_from(read_npz(folder / "centres.npz", limits)) if "centres.npz" in files else MappingProxyType({})
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
    with content_errors(path, "is not JSON"):
        provenance = json.loads(read_file(path, limits))
    if not isinstance(provenance, dict) or provenance.get("format") != PROVENANCE_FORMAT:
        raise FileError(f"{str(path)!r} has another format than {PROVENANCE_FORMAT!r}; perhaps a later version's")
    files = provenance.get("files")
    if not isinstance(files, dict) or len(files) > _MOST_FILES or not all(map(_NAME.fullmatch, files)):
        raise FileError(f"{str(path)!r} must list the files of the package")
    if missing := {"raw.exr", "raw.tif", "dark.tif", CAMERA} - set(files):
        raise FileError(f"{str(path)!r} lists no {', '.join(sorted(missing))}; a package has them")
    return provenance


def _raw(path: Path, camera: PlenopticCamera | None, limits: FileLimits) -> RawImage:
    return dataclasses.replace(RawImage.load(path, limits=limits), camera=camera)


def _truth(path: Path, limits: FileLimits) -> GroundTruth:
    with content_errors(path, "holds no possible ground truth"):
        return GroundTruth(**{name: array for name, array in read_npz(path, limits).items() if name in CHANNELS})


def centre_arrays(centres: Mapping[CentreMethod, MicrolensCentres]) -> dict[str, Any]:
    """All centres as arrays: `index`, `type` and `on_array` of all microlenses, and pixels and mm by each method."""
    index = np.unique(np.concatenate([listed.index for listed in centres.values()]), axis=0)
    order = {tuple(pair): row for row, pair in enumerate(index.tolist())}
    arrays: dict[str, Any] = {"index": index, "type": np.zeros(len(index), dtype=np.int64)}
    arrays["on_array"] = np.full((len(index), 2), np.nan)
    for method, listed in centres.items():
        rows = [order[tuple(pair)] for pair in listed.index.tolist()]
        arrays["type"][rows], arrays["on_array"][rows] = listed.type, listed.on_array
        for name in ("position", "pixel"):
            arrays[f"{method.name.lower()}_{name}"] = places = np.full((len(index), 2), np.nan)
            places[rows] = getattr(listed, name)
    return arrays


def centres_from(arrays: Mapping[str, Any]) -> Mapping[CentreMethod, MicrolensCentres]:
    """The centres of `centre_arrays`; KeyError if an array is missing."""
    by_method = {}
    for method in CentreMethod:
        position = arrays.get(f"{method.name.lower()}_position")
        if position is not None:
            finite = np.isfinite(position).all(axis=1)
            parts = {name: arrays[name][finite] for name in ("index", "type", "on_array")}
            pixel = arrays[f"{method.name.lower()}_pixel"][finite]
            by_method[method] = MicrolensCentres(**parts, position=position[finite], pixel=pixel, method=method)
    return MappingProxyType(by_method)


def centre_table(arrays: Mapping[str, Any]) -> str:
    """CSV table of `centre_arrays`: k, l, type, and row and column by each method."""
    methods = [name.removesuffix("_pixel") for name in arrays if name.endswith("_pixel")]
    header = ["k", "l", "type", *(f"{name}_{axis}" for name in methods for axis in ("row", "column"))]
    pixels = np.concatenate([arrays[f"{name}_pixel"] for name in methods], axis=1)
    return csv_text(header, (*arrays["index"].T, arrays["type"], *pixels.T))
