"""Lens files: the bundled lenses by name, and files in one of the formats that can be read or written."""

from __future__ import annotations

import difflib
import importlib.resources
import os
from collections.abc import Mapping
from pathlib import Path

from plenoptic.core.files.atomic_file import write_file
from plenoptic.core.files.file_limits import TEXT, FileLimits, read_file
from plenoptic.core.values import choice, file_path
from plenoptic.errors import FileError
from plenoptic.optics.glass.catalogue import GlassCatalogue
from plenoptic.optics.glass.media import Medium
from plenoptic.optics.lens.files.lens_json import json_of_lens, lens_from_json
from plenoptic.optics.lens.specification import StopSize
from plenoptic.optics.lens.stack import LensStack

_ENDINGS = ".csv, .json and .zmx"


def lens_names() -> tuple[str, ...]:
    """Names of the lenses that come with the package, in alphabetical order, for `load_lens`.

    Examples
    --------
    >>> import plenoptic as pl
    >>> "double-gauss-100mm-f2" in pl.lens_names()
    True
    """
    folder = importlib.resources.files("plenoptic.optics.lens.files") / "data"
    return tuple(sorted(file.name.removesuffix(".json") for file in folder.iterdir() if file.name.endswith(".json")))


def load_lens(
    name_or_path: str | os.PathLike[str],
    *,
    glasses: Mapping[str, Medium] | GlassCatalogue | None = None,
    stop_size: StopSize = StopSize.SYSTEM_APERTURE,
    limits: FileLimits = TEXT,
) -> LensStack:
    """A lens that comes with the package, or one from a file.

    Formats, by the ending of the path:

    - `.json`: the format of `save_lens`; nothing is lost.
    - `.zmx`: a sequential Zemax file; `plenoptic.optics.lens.files.zemax` describes how it is read. Its
      fields, wavelengths, object and image are the lens's `specification`; ignored data are named in a warning.
    - `.csv`: a table with the columns `radius;thickness;material;index;v-no;sa`, mm, one row per element from the scene
      to the sensor. An empty radius is a plane, and a plane with air on both sides is a stop: the first is the iris. An
      empty material is air. A row with index and V-number is a `ModelGlass`, one with an index only a `ConstantMedium`,
      one with neither one of `glass_names`; the thickness of the last row, the distance to the image, is not part of
      the lens.

    A file that does not mark its stop gets one by a rule, which is not the designer's choice and is named in
    `source`: a round stop in the middle of the longest air gap between two surfaces (of a lens without one: at its
    first vertex), as large as the widest paraxial beam on the axis that passes all surfaces, from infinity, or from the
    front focus where the rear focus does not lie behind the lens, as in a microscope objective.

    Files are read as they are printed. `lens.check()` lists implausible properties.

    Parameters
    ----------
    name_or_path : str or path-like
        One of `lens_names()`, or a path that ends in `.csv`, `.json` or `.zmx`.
    glasses : mapping from name to Medium, optional
        Where the glasses that a `.zmx` file names are looked up first, such as a catalogue from `load_glasses`; then
        among the bundled ones. Other formats bring their glasses along.
    stop_size : StopSize, optional
        Source of the size in a `.zmx` file: its system aperture, or the semi-diameter of the stop's surface.
        `lens.check()` says where the two disagree.
    limits : FileLimits
        The size of the file: by default at most 4 MiB.

    Returns
    -------
    LensStack

    Raises
    ------
    FileError
        If there is no such lens or file, it cannot be read, or its ending is unknown.
    PrescriptionError
        If the content of the file is no lens; the message names the file and the line or element.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.load_lens("double-gauss-100mm-f2")
    <LensStack 'double-gauss-100mm-f2': 10 surfaces, 1 stop, 64.08 mm long>
    """
    path, stop_size = file_path(name_or_path), choice(stop_size, StopSize, "stop_size")
    name = os.fspath(name_or_path)
    if isinstance(name_or_path, str) and name in lens_names():
        bundled = importlib.resources.files("plenoptic.optics.lens.files") / "data" / f"{name}.json"
        return lens_from_json(bundled.read_text(encoding="utf-8"), f"{name}.json")
    ending = path.suffix.lower()
    if ending == ".csv":
        from plenoptic.optics.lens.files.lens_csv import lens_from_csv

        return lens_from_csv(_utf8(path, limits), path.name)
    if ending == ".json":
        return lens_from_json(_utf8(path, limits), path.name)
    if ending == ".zmx":
        from plenoptic.core.files.text_lines import decode_text
        from plenoptic.optics.lens.files.zemax import lens_from_zmx

        text = decode_text(read_file(path, limits), errors="replace")
        return lens_from_zmx(text, path.name, glasses=glasses, stop_size=stop_size)
    if not isinstance(name_or_path, str) or path.parent != Path() or path.is_file():
        what = "is a folder" if path.is_dir() else f"ends in {ending!r}"
        raise FileError(f"{name} {what}; the lens files that can be read are {_ENDINGS}")
    close = difflib.get_close_matches(name, lens_names(), n=3, cutoff=0.4) or lens_names()
    raise FileError(
        f"there is no lens {name!r}; pl.lens_names() lists them, among them {', '.join(close)}; "
        f"or give the path of a file ({_ENDINGS})"
    )


def save_lens(lens: LensStack, path: str | os.PathLike[str]) -> None:
    """Write a lens as JSON, from which `load_lens` gives back an equal one to the last bit, or as a Zemax file.

    JSON has one element per line, without defaults. A `.zmx` file, for other programs, holds less: centred
    surfaces and round stops in air. A glass that is not the bundled one of its name becomes a model glass of the same
    n_d and V_d.

    Parameters
    ----------
    lens : LensStack
        Its media must be of this package.
    path : str or path-like
        Must end in `.json` or `.zmx`. A file of that name is replaced, as a whole or not at all.

    Raises
    ------
    PrescriptionError
        If something has no place in the format.
    FileError
        If the path has another ending or cannot be written.

    Examples
    --------
    >>> import pathlib, tempfile, plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pl.save_lens(lens, pathlib.Path(folder) / "mine.json")
    ...     pl.load_lens(pathlib.Path(folder) / "mine.json") == lens
    True
    """
    target = file_path(path)
    ending = target.suffix.lower()
    if ending == ".json":
        content = json_of_lens(lens).encode("utf-8")
    elif ending == ".zmx":
        from plenoptic.optics.lens.files.zemax_writing import zmx_of_lens

        content = zmx_of_lens(lens)
    else:
        raise FileError(f"{target} ends in {target.suffix!r}; lenses are saved as .json or .zmx: give it that ending")
    write_file(target, content)


def _utf8(path: Path, limits: FileLimits) -> str:
    try:
        return read_file(path, limits).decode("utf-8-sig")
    except ValueError as error:
        raise FileError(f"cannot read {path}: {error}; give the path of a UTF-8 text file") from None
