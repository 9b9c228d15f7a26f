"""The package's values as text and back: what an image file says about the camera that took it.

The text is JSON. Numbers, texts, True, False and None stand for themselves and a list for a tuple;
all else is an object with a single key that says what it is:

    {"float": "inf"}                                          what JSON has no number for
    {"enum": ["Lattice", "HEXAGONAL"]}                        a member of a public IntEnum
    {"array": {"dtype": "float64", "shape": [2], "values": [1.0, "nan"]}}
    {"value": ["Sensor", {"pixel_pitch": 0.01, ...}]}         a public frozen dataclass by its fields

A name is looked up among the public names of this package and of its public modules, and nowhere else: where a value
moves from one to the other, files still open. A value is made by its own constructor, so that a file can neither run
code nor describe what could not be made by hand.
"""

from __future__ import annotations

import dataclasses
import enum
import importlib
import json
import math
import pkgutil
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from plenoptic.errors import FileError, InvalidValueError

_DTYPES = (
    *("bool", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64"),
    *("float16", "float32", "float64"),
)

_RENAMED_MEMBERS = {("Caustics", "KEPT"): "INCLUDE", ("Caustics", "LEFT_OUT"): "EXCLUDE"}
"""Present names of enum members that older files contain."""


def describe(value: Any) -> str:
    """A value of this package as JSON text in ASCII; floats keep every bit. An error for what has no such form."""
    return json.dumps(described(value), allow_nan=False)


def restore(text: str) -> Any:
    """The value that `describe` wrote down; a FileError where the text names nothing public, or what cannot be."""
    try:
        return restored(json.loads(text))
    except FileError:
        raise
    except (ValueError, RecursionError) as error:
        raise _not_understood(error) from error


def restored(tree: Any) -> Any:
    """The value that `described` made a tree of."""
    try:
        return _restored(tree)
    except (ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RecursionError) as error:
        raise _not_understood(error) from error


def _not_understood(error: BaseException) -> FileError:
    return FileError(
        f"a description cannot be understood: {error}; "
        "it must come from this package in this version or a compatible one"
    )


def described_fields(value: Any, names: Iterable[str]) -> dict[str, str]:
    """Fields of a value as metadata of an image file; those that are None are left out."""
    return {f"plenoptic:{name}": describe(kept) for name in names if (kept := getattr(value, name)) is not None}


def restored_fields(metadata: Mapping[str, Any], names: Iterable[str]) -> dict[str, Any]:
    """The fields that the metadata of an image file hold."""
    return {name: restore(metadata[key]) for name in names if (key := f"plenoptic:{name}") in metadata}


def described(value: Any) -> Any:
    """A value as what JSON holds."""
    if isinstance(value, enum.IntEnum):
        _check_public(type(value))
        return {"enum": [type(value).__name__, value.name]}
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return _described_float(value) if math.isfinite(value) else {"float": str(value)}
    if isinstance(value, tuple):
        return [described(item) for item in value]
    if isinstance(value, np.ndarray) and value.dtype.name in _DTYPES:
        values = [_described_float(item) for item in value.ravel().tolist()]
        return {"array": {"dtype": value.dtype.name, "shape": list(value.shape), "values": values}}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        _check_public(type(value))
        fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value) if field.init}
        return {"value": [type(value).__name__, {name: described(item) for name, item in fields.items()}]}
    raise InvalidValueError(
        f"a {type(value).__name__} cannot be described in a file; only numbers, texts, tuples, arrays of numbers "
        "and the package's own values can"
    )


def _described_float(number: Any) -> Any:
    """A number as JSON can hold it: finite ones by their shortest exact decimals, others by name."""
    return number if math.isfinite(number) else str(number)


def _restored(tree: Any) -> Any:
    if isinstance(tree, list):
        return tuple(_restored(item) for item in tree)
    if not isinstance(tree, dict):
        return tree
    if len(tree) != 1:
        raise ValueError(f"an object has the keys {', '.join(tree)} where it must have one")
    ((kind, content),) = tree.items()
    if kind == "float":
        return float(content)
    if kind == "array":
        return _restored_array(**content)
    if kind not in ("enum", "value"):
        raise ValueError(f"{kind!r} is no kind of value")
    name, inside = content
    found = _public(name)
    if not isinstance(found, type) or (kind == "enum") != issubclass(found, enum.IntEnum):
        raise ValueError(f"{name!r} is no {kind} of this package")
    if kind == "enum":
        return found[_RENAMED_MEMBERS.get((name, inside), inside)]  # type: ignore[index]
    return found(**{field: _restored(item) for field, item in inside.items()})


def _restored_array(*, dtype: str, shape: list[int], values: list[Any]) -> np.ndarray[Any, Any]:
    if dtype not in _DTYPES:
        raise ValueError(f"{dtype!r} is no type of an array")
    return np.array(values, dtype=dtype).reshape(shape)


def _public(name: Any) -> type | None:
    """The public dataclass or IntEnum of this name, wherever it is public, or None."""
    import plenoptic

    if not isinstance(name, str) or name.startswith("_"):
        return None
    for found in (getattr(plenoptic, name, None), *_in_namespaces(name)):
        if isinstance(found, type) and found.__module__.partition(".")[0] == "plenoptic":
            return found if dataclasses.is_dataclass(found) or issubclass(found, enum.IntEnum) else None
    return None


def _in_namespaces(name: str) -> Iterator[Any]:
    """What the public modules of this package, such as `plenoptic.lightfield`, offer under a name."""
    import plenoptic

    public = set(getattr(plenoptic, "__all__", ()))
    for found in pkgutil.iter_modules(plenoptic.__path__):
        if found.name in public:
            module = importlib.import_module(f"plenoptic.{found.name}")
            if name in getattr(module, "__all__", ()):
                yield getattr(module, name)


def _check_public(kind: type) -> None:
    if _public(kind.__name__) is not kind:
        raise InvalidValueError(
            f"a {kind.__name__} cannot be described in a file: it is no public value of this package; "
            "leave it out or use one that is"
        )
