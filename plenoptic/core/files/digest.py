"""SHA-256 of values, by which cameras and scenes are told apart in all processes."""

from __future__ import annotations

import dataclasses
import enum
import hashlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.errors import InvalidValueError

MARK = "sha256:"
"""Prefix of all digests."""


def digest(value: Any, *, convert: Callable[[Any], Any] | None = None) -> str:
    """Text that is equal for values of the same bits, and different for all others.

    Values are None, numbers, texts, arrays of numbers, members of enums, tuples, and frozen dataclasses of this package
    of these; `convert` makes one of these of any other object. Unlike `hash` the digest is the same in every process,
    and unlike pickles it does not depend on shared parts. It is stricter than `==`: 0.0 and -0.0 differ, and so do
    float32 and float64.
    """
    sha = hashlib.sha256()
    _feed(sha, value, convert)
    return MARK + sha.hexdigest()


def little_endian(array: NDArray[Any]) -> NDArray[Any]:
    """The same numbers in C order and with the low byte first, as in files and digests."""
    return np.asarray(array, dtype=array.dtype.newbyteorder("<"), order="C")


def bytes_of(array: NDArray[Any]) -> memoryview:
    """The bytes of an array in C order, in the same memory."""
    return array.reshape(-1).view(np.uint8).data


def _feed(sha: Any, value: Any, convert: Callable[[Any], Any] | None) -> None:
    if isinstance(value, np.generic):
        value = value.item()
    kind = type(value)
    if isinstance(value, enum.Enum):
        _put(sha, "enum", kind.__qualname__, repr(value.value))
    elif value is None or isinstance(value, bool | int | float | complex | str):
        _put(sha, kind.__name__, repr(value))
    elif isinstance(value, np.ndarray) and value.dtype.kind in "biufcV":
        plain = little_endian(value)
        _put(sha, "array", repr(plain.dtype.descr) if plain.dtype.names else plain.dtype.str, repr(value.shape))
        sha.update(bytes_of(plain))
    elif isinstance(value, tuple):
        # Names of the fields belong to the digest: a renamed field makes another table.
        _put(sha, "tuple", kind.__qualname__, repr(getattr(value, "_fields", len(value))))
        for item in value:
            _feed(sha, item, convert)
    elif dataclasses.is_dataclass(value) and kind.__module__.partition(".")[0] == "plenoptic":
        fields = [field.name for field in dataclasses.fields(value) if field.init]
        _put(sha, "value", kind.__qualname__, repr(fields))
        for name in fields:
            _feed(sha, getattr(value, name), convert)
    elif convert is not None:
        _feed(sha, convert(value), None)
    else:
        raise InvalidValueError(
            f"a {kind.__name__} has no digest; only numbers, texts, tuples, arrays of numbers and the package's own "
            "values have"
        )


def _put(sha: Any, *texts: str) -> None:
    """Feed texts, each after its length, so that different sequences never have the same bytes."""
    for text in texts:
        encoded = text.encode("utf-8", "surrogatepass")
        sha.update(len(encoded).to_bytes(8, "little"))
        sha.update(encoded)
