"""Values of the package as JSON files: cameras, lenses, scenes' settings, sensor models."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from typing import Any

from plenoptic import __version__
from plenoptic.core.files.atomic_file import write_json
from plenoptic.core.files.file_limits import DEFAULT, FileLimits, read_file
from plenoptic.core.files.serialization import from_tree, to_tree
from plenoptic.core.values import file_path
from plenoptic.errors import FileError, InvalidValueError

FORMAT = "plenoptic-value-1"


def save_value(value: Any, path: str | os.PathLike[str], *, about: Mapping[str, Any] | None = None) -> None:
    """Write a camera, or any other value of the package, as JSON, from which `load_value` makes an equal one.

    The file is an object with `format`, `software`, the entries of `about`, and `value`, whose format is described in
    docs/package.md. Floats keep every bit.

    Parameters
    ----------
    value
        A camera, lens, array, sensor, sensor model, pose, render settings, or a tuple of them. Not scenes.
    path : path-like
        An existing file is replaced, as a whole or not at all.
    about : mapping, optional
        Information for readers, as JSON; it is not read back.

    Raises
    ------
    InvalidValueError
        If a part of it is not of this package.
    FileError
        If the file cannot be written.

    Examples
    --------
    >>> import pathlib, tempfile, plenoptic as pl
    >>> sensor = pl.Sensor(shape=(512, 512), pixel_pitch=0.01)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pl.package.save_value(sensor, pathlib.Path(folder) / "sensor.json")
    ...     pl.package.load_value(pathlib.Path(folder) / "sensor.json") == sensor
    True
    """
    if isinstance(value, str | os.PathLike) and not isinstance(path, str | os.PathLike):
        raise InvalidValueError(f"the value is {value!r}; give the value first and then the path")
    content = {"format": FORMAT, "software": f"plenoptic {__version__}", **(about or {}), "value": to_tree(value)}
    write_json(file_path(path), content)


def load_value(path: str | os.PathLike[str], *, limits: FileLimits = DEFAULT) -> Any:
    """Read the value that `save_value` wrote.

    Parameters
    ----------
    path : path-like
    limits : FileLimits
        Limit of the size of the file.

    Raises
    ------
    FileError
        If there is no such file, or it holds no value of this package.

    Examples
    --------
    See `save_value`.
    """
    source = file_path(path)
    try:
        content = json.loads(read_file(source, limits))
    except (ValueError, RecursionError) as error:
        raise FileError(f"{str(source)!r} is not JSON: {error}; give a file that save_value wrote") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT or "value" not in content:
        file_format = content.get("format") if isinstance(content, dict) else None
        raise FileError(f"{str(source)!r} has format {file_format!r:.40}; it must be {FORMAT!r}, with a value")
    try:
        return from_tree(content["value"])
    except FileError as error:
        raise FileError(f"{str(source)!r}: {error}") from None
