"""Lens files: the bundled lenses by name, and files in one of the formats that can be read or written."""

from __future__ import annotations

import difflib
import importlib.resources
import math
import os
from collections.abc import Callable, Mapping
from pathlib import Path

from plenoptic.core.files.atomic_file import write_file
from plenoptic.core.files.file_limits import TEXT, FileLimits, read_file
from plenoptic.core.values import choice, file_path, positive
from plenoptic.errors import FileError, InvalidValueError
from plenoptic.optics.glass.catalogue import GlassCatalogue
from plenoptic.optics.glass.media import Medium
from plenoptic.optics.lens.files.lens_json import json_of_lens, lens_from_json
from plenoptic.optics.lens.specification import StopSize
from plenoptic.optics.lens.stack import LensStack

_OF_PROGRAMS = (".seq", ".txt", ".zmx")
"""Endings of the files of other programs."""
_ENDINGS = ".csv, .json, .seq, .txt and .zmx"


def lens_names() -> tuple[str, ...]:
    """Names of the bundled lenses, in alphabetical order, for `load_lens`.

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
    configuration: int | None = None,
    focus: float | None = None,
    limits: FileLimits = TEXT,
) -> LensStack:
    """Load a bundled lens by name, or a lens from a file.

    Formats, by the ending of the path:

    - `.json`: the lossless format of `save_lens`.
    - `.zmx`: a sequential Zemax file; `plenoptic.optics.lens.files.zemax` describes the supported data. Its fields,
      wavelengths, object and image become the lens's `specification`. A warning names ignored data.
    - `.seq`: a CODE V sequence, and `.txt`: a descriptive table of a photographic lens in the format of the Optical
      Bench; see `plenoptic.optics.lens.files.codev` and `photographic_table`.
    - `.csv`: a table with the columns `radius;thickness;material;index;v-no;sa`, mm, one row per element from the scene
      to the sensor. An empty radius is a plane, and a plane with air on both sides is a stop: the first is the iris. An
      empty material is air. A row with index and V-number is a `ModelGlass`, one with an index only a `ConstantMedium`,
      one with neither a glass of `glass_names`. The last material is the medium of the sensor; its thickness, the
      distance to the image, is not part of the lens.

    A file without a stop gets a round one by a rule, which is noted in `source` and need not be the designer's choice.
    The stop lies in the middle of the longest air gap between two surfaces, or at the first vertex if there is none.
    Its semi-diameter is that of the widest paraxial axial beam that passes all surfaces. The beam comes from infinity,
    or from the front focus if the rear focus does not lie behind the lens, as in a microscope objective.

    Misprints are not corrected; `lens.check()` lists implausible properties.

    Parameters
    ----------
    name_or_path : str or path-like
        One of `lens_names()`, or a path that ends in `.csv`, `.json`, `.seq`, `.txt` or `.zmx`.
    glasses : mapping from name to Medium, optional
        First catalogue for the glasses that a `.seq`, `.txt` or `.zmx` file names, such as one from `load_glasses`; the
        bundled ones follow. Other formats contain their glasses.
    stop_size : StopSize, optional
        Source of the stop's size in these files: the system aperture, or the semi-diameter of the stop's surface.
        `lens.check()` reports a disagreement.
    configuration : int, optional
        Number of the configuration of such a file, from 1: the position of a zoom, or the column of variable
        distances. Default: the first, or in a `.zmx` file the one that was active when it was saved.
    focus : float, optional
        Distance in mm from the object to the first surface, for a `.txt` file with columns for several of them (d0).
        Between two columns all variable distances move linearly, to where the paraxial image of the object lies as in
        the columns. `configuration` is then the position of a zoom.
    limits : FileLimits
        Limits of the file's size: by default at most 4 MiB.

    Returns
    -------
    LensStack

    Raises
    ------
    FileError
        If the lens or file does not exist, cannot be read, or has an unknown ending.
    InvalidValueError
        If the file has no such configuration, or none for such a distance of the object.
    PrescriptionError
        If the file does not describe a valid lens; the message names the file and the line or element.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.load_lens("double-gauss-100mm-f2")
    <LensStack 'double-gauss-100mm-f2': 10 surfaces, 1 stop, 64.08 mm long>
    """
    path, stop_size = file_path(name_or_path), choice(stop_size, StopSize, "stop_size")
    name = os.fspath(name_or_path)
    if configuration is not None and path.suffix.lower() not in _OF_PROGRAMS:
        raise InvalidValueError(f"configuration is {configuration!r:.40}; only .seq, .txt and .zmx files have several")
    if focus is not None and focus != math.inf:
        focus = positive(focus, "focus", "mm")
    if focus is not None and path.suffix.lower() != ".txt":
        raise InvalidValueError(f"focus is {focus!r:.40}; only .txt files have variable distances by focus distance")
    if isinstance(name_or_path, str) and name in lens_names():
        bundled = importlib.resources.files("plenoptic.optics.lens.files") / "data" / f"{name}.json"
        return lens_from_json(bundled.read_text(encoding="utf-8"), f"{name}.json")
    ending = path.suffix.lower()
    if ending == ".csv":
        from plenoptic.optics.lens.files.lens_csv import lens_from_csv

        return lens_from_csv(_utf8(path, limits), path.name)
    if ending == ".json":
        return lens_from_json(_utf8(path, limits), path.name)
    if ending in _OF_PROGRAMS:
        from plenoptic.core.files.text_lines import decode_text

        text = decode_text(read_file(path, limits), errors="replace")
        options = {"configuration": configuration} | ({} if focus is None else {"focus": focus})
        return _reader(ending)(text, path.name, glasses=glasses, stop_size=stop_size, **options)
    if not isinstance(name_or_path, str) or path.parent != Path() or path.is_file():
        reason = "is a folder" if path.is_dir() else f"ends in {ending!r}"
        raise FileError(f"{name} {reason}; the lens files that can be read are {_ENDINGS}")
    close = difflib.get_close_matches(name, lens_names(), n=3, cutoff=0.4) or lens_names()
    raise FileError(
        f"there is no lens {name!r}; pl.lens_names() lists them, among them {', '.join(close)}; "
        f"or give the path of a file ({_ENDINGS})"
    )


def save_lens(lens: LensStack, path: str | os.PathLike[str]) -> None:
    """Write a lens as JSON, which `load_lens` reads back exactly, or as a Zemax file.

    JSON has one element per line, without defaults. A `.zmx` file, for other programs, can hold centred surfaces and
    round stops in air only. A glass that differs from the bundled one of its name becomes a model glass of the same n_d
    and V_d.

    Parameters
    ----------
    lens : LensStack
        Its media must be of this package.
    path : str or path-like
        Must end in `.json` or `.zmx`. An existing file is replaced atomically.

    Raises
    ------
    PrescriptionError
        If the format cannot hold a property of the lens.
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


def _reader(ending: str) -> Callable[..., LensStack]:
    """Reader of the files of another program."""
    if ending == ".zmx":
        from plenoptic.optics.lens.files.zemax import lens_from_zmx

        return lens_from_zmx
    if ending == ".seq":
        from plenoptic.optics.lens.files.codev import lens_from_seq

        return lens_from_seq
    from plenoptic.optics.lens.files.photographic_table import lens_from_table

    return lens_from_table


def _utf8(path: Path, limits: FileLimits) -> str:
    try:
        return read_file(path, limits).decode("utf-8-sig")
    except ValueError as error:
        raise FileError(f"cannot read {path}: {error}; give the path of a UTF-8 text file") from None
