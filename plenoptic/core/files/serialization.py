"""The package's values as text and back: JSON files of values, and the description of the camera in an image file.

The text is JSON. Numbers, texts, True, False and None stand for themselves and a list for a tuple;
everything else is an object with a single key that names its kind:

    {"float": "inf"}                                          infinity and nan, which JSON lacks
    {"enum": ["Lattice", "HEXAGONAL"]}                        a member of a public IntEnum
    {"array": {"dtype": "float64", "shape": [2], "values": [1.0, "nan"]}}
    {"value": ["Sensor", {"pixel_pitch": 0.01, ...}]}         a public frozen dataclass by its fields

Names are looked up only among the public names of this package and of its public modules, so that files still open
after a value has moved from one module to another. A value is made by its own constructor: a file can neither run
code nor describe an invalid value.
"""

from __future__ import annotations

import dataclasses
import enum
import functools
import importlib
import json
import math
import os
import pkgutil
from collections.abc import Iterable, Iterator, Mapping
from types import ModuleType
from typing import Any

import numpy as np

from plenoptic import __version__
from plenoptic.core.files.atomic_file import write_json
from plenoptic.core.files.file_limits import DEFAULT, FileLimits, content_errors, read_file
from plenoptic.core.values import file_path
from plenoptic.errors import FileError, InvalidValueError

FORMAT = "plenoptic-value-1"
"""Format of the files of `save_value`."""

_DTYPES = (
    *("bool", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64"),
    *("float16", "float32", "float64"),
)

_RENAMED_MEMBERS = {("Caustics", "KEPT"): "INCLUDE", ("Caustics", "LEFT_OUT"): "EXCLUDE"}
_RENAMED_FIELDS = {("Surface", "departure"): ("freeform",), ("LensStack", "ambient"): ("front_medium", "rear_medium")}
"""Present names of enum members, and of fields, that older files contain."""


def describe(value: Any) -> str:
    """A value of this package as JSON text in ASCII; floats keep every bit. An error for unsupported types."""
    return json.dumps(to_tree(value), allow_nan=False)


def restore(text: str) -> Any:
    """The value of a text made by `describe`; FileError for a name that is not public or an invalid value."""
    try:
        return from_tree(json.loads(text))
    except (FileError, Warning):
        raise
    except Exception as error:
        raise _unreadable(error) from error


def from_tree(tree: Any) -> Any:
    """The value of a tree made by `to_tree`."""
    try:
        return _from_tree(tree)
    except (FileError, Warning):
        raise
    except Exception as error:  # of NumPy and of any constructor
        raise _unreadable(error) from error


def _unreadable(error: BaseException) -> FileError:
    return FileError(
        f"a description cannot be understood: {error}; "
        "it must come from this package in this version or a compatible one"
    )


def fields_to_metadata(value: Any, names: Iterable[str]) -> dict[str, str]:
    """Fields of a value as metadata of an image file; fields that are None are omitted."""
    return {f"plenoptic:{name}": describe(item) for name in names if (item := getattr(value, name)) is not None}


def fields_from_metadata(metadata: Mapping[str, Any], names: Iterable[str]) -> dict[str, Any]:
    """Fields of a value from the metadata of an image file."""
    return {name: restore(metadata[key]) for name in names if (key := f"plenoptic:{name}") in metadata}


def to_tree(value: Any) -> Any:
    """A value as a tree of JSON's types."""
    if isinstance(value, enum.IntEnum):
        _check_public(type(value))
        return {"enum": [type(value).__name__, value.name]}
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else {"float": str(value)}
    if isinstance(value, tuple):
        return [to_tree(item) for item in value]
    if isinstance(value, np.ndarray) and value.dtype.name in _DTYPES:
        values = [item if math.isfinite(item) else str(item) for item in value.ravel().tolist()]
        return {"array": {"dtype": value.dtype.name, "shape": list(value.shape), "values": values}}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        _check_public(type(value))
        fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value) if field.init}
        return {"value": [type(value).__name__, {name: to_tree(item) for name, item in fields.items()}]}
    raise InvalidValueError(
        f"a {type(value).__name__} cannot be described in a file; only numbers, texts, tuples, arrays of numbers "
        "and the package's own values can"
    )


def _from_tree(tree: Any) -> Any:
    if isinstance(tree, list):
        return tuple(_from_tree(item) for item in tree)
    if not isinstance(tree, dict):
        return tree
    if len(tree) != 1:
        raise ValueError(f"an object has the keys {', '.join(tree)} where it must have one")
    ((kind, content),) = tree.items()
    if kind == "float":
        return float(content)
    if kind == "array":
        return _array_from_tree(**content)
    if kind not in ("enum", "value"):
        raise ValueError(f"{kind!r} is no kind of value")
    name, argument = content
    cls = _public(name)
    if not isinstance(cls, type) or (kind == "enum") != issubclass(cls, enum.IntEnum):
        raise ValueError(f"{name!r} is no {kind} of this package")
    if kind == "enum":
        return cls[_RENAMED_MEMBERS.get((name, argument), argument)]  # type: ignore[index]
    arguments = {
        present: _from_tree(item)
        for field, item in argument.items()
        for present in _RENAMED_FIELDS.get((name, field), (field,))
    }
    fields = {field.name: field for field in dataclasses.fields(cls) if field.init}
    if unknown := sorted(arguments.keys() - fields):
        raise ValueError(f"a {name} has no {', '.join(unknown)[:200]}; it has {', '.join(fields)}")
    needed = [field.name for field in fields.values() if field.default is field.default_factory is dataclasses.MISSING]
    if absent := [field for field in needed if field not in arguments]:
        raise ValueError(f"a {name} is described without {', '.join(absent)}")
    return cls(**arguments)


def _array_from_tree(*, dtype: str, shape: list[int], values: list[Any]) -> np.ndarray[Any, Any]:
    if dtype not in _DTYPES:
        raise ValueError(f"{dtype!r} is no type of an array")
    return np.array(values, dtype=dtype).reshape(shape)


def _package() -> ModuleType:
    """The package, whose public names can be read: imported by name, since most of them stand above this room."""
    return importlib.import_module("plenoptic")


def _public(name: Any) -> type | None:
    """The public dataclass or IntEnum of this name in any public module; None if there is none."""
    if not isinstance(name, str) or name.startswith("_"):
        return None
    for cls in (getattr(_package(), name, None), *_in_namespaces(name)):
        if isinstance(cls, type) and cls.__module__.partition(".")[0] == "plenoptic":
            return cls if dataclasses.is_dataclass(cls) or issubclass(cls, enum.IntEnum) else None
    return None


def _in_namespaces(name: str) -> Iterator[Any]:
    """Objects of this name in the public modules of this package, such as `plenoptic.lightfield`."""
    for module in _public_modules():
        if name in getattr(module, "__all__", ()):
            yield getattr(module, name)


@functools.cache
def _public_modules() -> tuple[ModuleType, ...]:
    """Public modules of this package; the search on the disk is slow."""
    public = set(getattr(_package(), "__all__", ()))
    names = [info.name for info in pkgutil.iter_modules(_package().__path__) if info.name in public]
    return tuple(importlib.import_module(f"plenoptic.{name}") for name in names)


def _check_public(kind: type) -> None:
    if _public(kind.__name__) is not kind:
        raise InvalidValueError(
            f"a {kind.__name__} cannot be described in a file: it is no public value of this package; "
            "leave it out or use one that is"
        )


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
        If a part of it is not of this package, or `about` is not JSON.
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
    entries = {} if about is None else about
    try:
        if not isinstance(entries, Mapping) or not all(isinstance(name, str) for name in entries):
            raise TypeError("its names must be texts")
        json.dumps(dict(entries), allow_nan=False)
    except (TypeError, ValueError, RecursionError) as error:
        raise InvalidValueError(
            f"about is {about!r:.80}; it must be a mapping of names to what JSON can hold, such as texts: {error}"
        ) from None
    content = {"format": FORMAT, "software": f"plenoptic {__version__}", **entries, "value": to_tree(value)}
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
    with content_errors(source, "is not JSON"):
        content = json.loads(read_file(source, limits))
    if not isinstance(content, dict) or content.get("format") != FORMAT or "value" not in content:
        file_format = content.get("format") if isinstance(content, dict) else None
        raise FileError(f"{str(source)!r} has format {file_format!r:.40}; it must be {FORMAT!r}, with a value")
    with content_errors(source, "holds no possible value"):
        return from_tree(content["value"])
