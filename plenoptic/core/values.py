"""Immutable values: frozen dataclasses whose arrays are read-only, comparable and picklable."""

from __future__ import annotations

import dataclasses
import enum
import functools
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar, cast, dataclass_transform

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.short_repr import short_repr
from plenoptic.errors import FileError, InvalidValueError, PrescriptionError

Floats = NDArray[np.float64]
AnyFloats = NDArray[np.floating[Any]]
"""Floating-point arrays of any precision."""

T = TypeVar("T")
Stored = TypeVar("Stored")
Accepted = TypeVar("Accepted")
Number = TypeVar("Number", bound=np.generic)
Choice = TypeVar("Choice", bound=enum.Enum)

if TYPE_CHECKING:

    class Given(Generic[Stored, Accepted]):
        """Type of a field that stores one type and accepts others, as lists for an array; a call sets its default."""

        def __init__(self, *, default: Any) -> None: ...
        def __get__(self, instance: object, owner: Any) -> Stored: ...
        def __set__(self, instance: object, value: Accepted) -> None: ...
else:
    Given = dataclasses.field

SHORTEST, LONGEST = 10.0, 1e6
"""Limits of wavelengths in nm, from ultraviolet to far infrared; they exclude 0.55, meant as micrometres."""

SMALLEST_LENGTH, LARGEST_LENGTH = 1e-15, 1e15
"""Limits of lengths in mm, from a nucleus to a light-month: products and quotients of four, float32 areas, are finite.

Embree, in float32, drops vertices beyond 1.8e18.
"""

LARGEST_WHOLE = (1 << 63) - 1
"""Largest signed integer of 64 bits, the type of integers in kernels."""

MAX_PIXELS = 1 << 31
"""Limit of the pixels of a sensor, from the types of random-number keys and of files."""

MAX_POINTS = 1 << 24
"""Limit of the points, rays or corners of one array: 400 MB of coordinates."""


def read_only(array: NDArray[Number]) -> NDArray[Number]:
    """A read-only view of an array; the array itself stays writable."""
    view = array.view()
    view.flags.writeable = False
    return view


def contiguous(array: NDArray[Number]) -> NDArray[Number]:
    """A read-only, C-contiguous form of an array, for kernels."""
    return read_only(np.ascontiguousarray(array))


def plain_array(values: ArrayLike, name: str) -> NDArray[Any]:
    """An array of booleans, whole numbers or floats, or an error that names it."""
    try:
        array = np.asarray(values)
        if array.dtype.kind == "O":  # whole numbers beyond 64 bits, fractions; None would become nan
            array = np.array([number(item, f"an item of {name}") for item in array.ravel()]).reshape(array.shape)
        if array.dtype.kind in "biuf":
            return array
        reason = f"it has the type {array.dtype}"
    except ValueError as error:
        reason = str(error)
    raise InvalidValueError(f"{name} is not an array of numbers: {reason}; give numbers")


def numbers(values: ArrayLike, name: str, *, columns: int | None = None) -> Floats:
    """A float64 array of any shape, or with the given number of columns; an error that names it otherwise."""
    array = plain_array(values, name).astype(np.float64, copy=False)
    if columns is not None and array.shape[-1:] != (columns,):
        raise InvalidValueError(f"{name} has shape {array.shape}; it must have shape (..., {columns})")
    return array


def broadcast(**arrays: ArrayLike) -> tuple[Floats, ...]:
    """Several arrays of numbers, broadcast to one shape, or an error that names them."""
    parts = [numbers(values, name) for name, values in arrays.items()]
    try:
        return tuple(np.broadcast_arrays(*parts))
    except ValueError:
        shapes = " and ".join(f"{name} {array.shape}" for name, array in zip(arrays, parts, strict=True))
        raise InvalidValueError(f"the shapes of {shapes} do not fit; give one for each, or one for all") from None


def frozen_array(
    values: ArrayLike, *, name: str, shape: tuple[int | str | None, ...], dtype: Any = np.float64
) -> NDArray[Any]:
    """A read-only copy of `values` of a required shape; None, or a name for the message, is any length.

    An array of that type and shape that is read-only and owns its data is not copied.
    """
    raw = plain_array(values, name)
    is_frozen = not raw.flags.writeable and raw.flags.owndata and raw.flags.c_contiguous
    with np.errstate(invalid="ignore", over="ignore"):
        array = raw.astype(dtype, order="C", copy=not is_frozen)
    if array.dtype.kind in "iu" and array.dtype != raw.dtype and not np.array_equal(raw, array):
        raise InvalidValueError(f"{name} must hold whole numbers, from {np.iinfo(dtype).min} to {np.iinfo(dtype).max}")
    fits = array.ndim == len(shape) and all(
        not isinstance(required, int) or side == required for side, required in zip(array.shape, shape, strict=True)
    )
    if not fits:
        sides = "(" + ", ".join("n" if n is None else str(n) for n in shape) + ("," if len(shape) == 1 else "") + ")"
        flat = shape[-1] == "channels" and array.ndim == len(shape) - 1
        hint = f": give {name}[..., np.newaxis], which has one channel" if flat else ""
        raise InvalidValueError(f"{name} has shape {array.shape}; it must have shape {sides}{hint}")
    array.flags.writeable = False
    return array


def number(value: float, name: str) -> float:
    """`value` as a float, which may be infinite or nan; an error that names it if it is no number."""
    try:
        if isinstance(value, str | bytes | bool | np.bool_):
            raise TypeError
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise InvalidValueError(f"{name} is {value!r}; it must be a number") from None


def finite(value: float, name: str) -> float:
    """`value` as a finite float, or an error that names it."""
    checked = number(value, name)
    if not math.isfinite(checked):
        raise InvalidValueError(f"{name} is {checked}; it must be finite")
    return checked


_TURNS = 4
"""Angles of more turns are taken for degrees."""


def radians(value: float, name: str) -> float:
    """`value` as an angle in radians, or an error if its size suggests degrees."""
    angle = finite(value, name)
    if abs(angle) > _TURNS * math.tau:
        raise InvalidValueError(
            f"{name} is {angle:g} rad; it must be at most {_TURNS} turns: give radians, such as math.radians({angle:g})"
        )
    return angle


def coefficients(values: Iterable[float], name: str, expected: str = "a sequence of numbers") -> tuple[float, ...]:
    """Finite coefficients of a prescription, or an error; a PrescriptionError if `values` is no sequence."""
    try:
        if isinstance(values, str | bytes | Mapping | Set):
            raise TypeError
        return tuple(finite(item, f"{name}[{i}]") for i, item in enumerate(values))
    except TypeError:
        raise PrescriptionError(f"{name} is {values!r}; it must be {expected}") from None


def wavelength_in_nm(value: float, name: str = "wavelength") -> float:
    """`value` as a float, or an error if it is no plausible wavelength in nm."""
    nm = positive(value, name, "nm")
    if not SHORTEST <= nm <= LONGEST:
        raise InvalidValueError(
            f"{name} is {nm:g} nm; it must be from {SHORTEST:g} to {LONGEST:g} nm: wavelengths are in nanometres"
        )
    return nm


def positive(value: float, name: str, unit: str = "") -> float:
    """`value` as a float, or an error that names it if it is not above zero and finite."""
    checked = finite(value, name)
    if checked <= 0:
        raise InvalidValueError(f"{name} is {checked:g}{unit and ' ' + unit}; it must be above 0")
    return checked


def length_in_mm(value: float, name: str) -> float:
    """`value` as a float, or an error that names it if it is no plausible length above 0 in mm."""
    length = positive(value, name, "mm")
    if not SMALLEST_LENGTH <= length <= LARGEST_LENGTH:
        raise InvalidValueError(
            f"{name} is {length:g} mm; it must be from {SMALLEST_LENGTH:g} to {LARGEST_LENGTH:g} mm: lengths are in mm"
        )
    return length


def coordinate(value: float, name: str) -> float:
    """`value` as a float, or an error that names it if it is no plausible coordinate in mm."""
    checked = finite(value, name)
    if abs(checked) > LARGEST_LENGTH:
        raise InvalidValueError(f"{name} is {checked:g} mm; it must be within {LARGEST_LENGTH:g} mm of 0")
    return checked


def positions(values: ArrayLike, *, name: str, shape: tuple[int | str | None, ...]) -> Floats:
    """A read-only copy of coordinates in mm, of a required shape, all of plausible size."""
    array = frozen_array(values, name=name, shape=shape)
    is_near = np.abs(array) <= LARGEST_LENGTH
    if not is_near.all():
        raise InvalidValueError(
            f"{name} holds {array[~is_near][0]:g} mm, which is not finite or farther than {LARGEST_LENGTH:g} mm from 0"
        )
    return array


def not_negative(value: float, name: str, unit: str = "") -> float:
    """`value` as a float, or an error that names it if it is below zero or not finite."""
    checked = finite(value, name)
    if checked < 0:
        raise InvalidValueError(f"{name} is {checked:g}{unit and ' ' + unit}; it must be at least 0")
    return checked


def whole(value: int, name: str, *, at_least: int, at_most: int = LARGEST_WHOLE) -> int:
    """`value` as an int, or an error if it is no whole number, too small or too large."""
    if isinstance(value, bool | np.bool_ | np.timedelta64) or not isinstance(value, int | np.integer):
        raise InvalidValueError(f"{name} is {value!r}; it must be a whole number")
    integer = int(value)
    if not at_least <= integer <= at_most:
        limit = f"at least {at_least}" if integer < at_least else f"at most {at_most}"
        raise InvalidValueError(f"{name} is {integer}; it must be {limit}")
    return integer


def checked_shape(
    shape: Any, names: tuple[str, ...], *, at_least: int = 1, at_most: int = MAX_PIXELS
) -> tuple[int, ...]:
    """`shape` as ints, one for each name, or an error if one is too small or their product too large."""
    sides = tuple(shape) if isinstance(shape, Sequence) or (isinstance(shape, np.ndarray) and shape.ndim) else ()
    if len(sides) != len(names) or isinstance(shape, str | bytes):
        raise InvalidValueError(f"shape is {shape!r}; it must be ({', '.join(name.split()[0] for name in names)})")
    checked = tuple(whole(side, name, at_least=at_least) for side, name in zip(sides, names, strict=True))
    if math.prod(checked) > at_most:
        product = " x ".join(map(str, checked))
        raise InvalidValueError(f"{' x '.join(names)} is {product}; it must be at most {at_most} in all")
    return checked


def seed_number(value: int, name: str = "seed") -> int:
    """`value` as an int, or an error if it is no whole number from 0 to 2^64 - 1."""
    return whole(value, name, at_least=0, at_most=(1 << 64) - 1)


def choice(value: Any, kind: type[Choice], name: str) -> Choice:
    """`value` as a member of an enum, or an error that lists its members."""
    try:
        # True would pass as the number 1, and a member of another enum as its number.
        if isinstance(value, bool | np.bool_) or isinstance(value, enum.Enum) > isinstance(value, kind):
            raise TypeError
        return kind(value)
    except (TypeError, ValueError):
        members = " or ".join(f"{kind.__name__}.{member.name}" for member in kind)
        raise InvalidValueError(f"{name} is {value!r}; it must be {members}") from None


def wrong_kind(value: object, name: str, expected: str, example: str) -> InvalidValueError:
    """Error for an argument that is not of the type `expected`, with an example of that type."""
    actual = _with_article(type(value).__name__)
    if expected == "Exposure" and hasattr(value, "demosaic"):
        example = f"{name}.demosaic()"
    elif expected == "Exposure" and isinstance(value, np.ndarray):
        example = f"pl.Exposure({name})"
    return InvalidValueError(f"{name} is {actual}; give {_with_article(expected)}, such as {example}")


def check_kind(value: object, name: str, expected: type, example: str) -> None:
    """Raise InvalidValueError if an argument is of another type."""
    if not isinstance(value, expected):
        raise wrong_kind(value, name, expected.__name__, example)


def check_has(value: object, name: str, expected: str, example: str, *attributes: str) -> None:
    """Raise InvalidValueError if an attribute is missing, for code that must not import the type."""
    if not all(hasattr(value, attribute) for attribute in attributes):
        raise wrong_kind(value, name, expected, example)


def _with_article(noun: str) -> str:
    return f"an {noun}" if noun[0] in "AEIOaeio" or noun.startswith("nd") else f"a {noun}"


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind in "fc")
    return not isinstance(a, np.ndarray) and not isinstance(b, np.ndarray) and bool(a == b)


def _hashable(item: Any) -> Any:
    if not isinstance(item, np.ndarray):
        return item
    if item.dtype.kind in "fc":  # equal values must have equal hashes: both zeros, and every nan
        item = np.where(np.isnan(item), np.nan, item) + 0.0
    return item.shape, item.tobytes()


def _equal(self: Any, other: object) -> Any:
    fields = dataclasses.fields(self)
    if type(self) is not type(other):
        return NotImplemented
    return all(_same(getattr(self, f.name), getattr(other, f.name)) for f in fields if f.compare)


def _hash(self: Any) -> int:
    return hash((type(self), *(_hashable(getattr(self, f.name)) for f in dataclasses.fields(self) if f.compare)))


def _repr(self: Any) -> str:
    entries = []
    for field in dataclasses.fields(self):
        item = getattr(self, field.name)
        if field.repr and not (field.default is not dataclasses.MISSING and _same(item, field.default)):
            entries.append(f"{field.name}={short_repr(item)}")
    return f"{type(self).__name__}({', '.join(entries)})"


def _restore(self: Any, state: dict[str, Any]) -> None:
    # Pickling forgets that an array was read-only.
    for name, item in state.items():
        if isinstance(item, np.ndarray):
            item.flags.writeable = False
        object.__setattr__(self, name, item)


def checked_field(check: Callable[..., Any], *, default: Any = dataclasses.MISSING, **limits: Any) -> Any:
    """A field that holds check(value, name=field, **limits), from before `__post_init__`; a None by default stays."""
    return dataclasses.field(default=default, metadata={"check": functools.partial(check, **limits)})


@dataclass_transform(frozen_default=True, field_specifiers=(dataclasses.field, Given, checked_field))
def value(cls: type[T]) -> type[T]:
    """Make a class a frozen dataclass that also compares, hashes, prints and pickles with arrays in it."""
    has_repr, made = "__repr__" in cls.__dict__, cls.__dict__.get("__post_init__")
    if any(isinstance(item, dataclasses.Field) and "check" in item.metadata for item in vars(cls).values()):

        def post_init(self: Any) -> None:
            for field in dataclasses.fields(self):
                item = getattr(self, field.name)
                if "check" in field.metadata and not (item is None and field.default is None):
                    set_field(self, field.name, field.metadata["check"](item, name=field.name))
            if made is not None:
                made(self)

        cls.__post_init__ = post_init  # type: ignore[attr-defined]
    decorated: Any = dataclasses.dataclass(frozen=True, eq=False, repr=False)(cls)
    decorated.__eq__ = _equal
    decorated.__hash__ = _hash
    decorated.__setstate__ = _restore
    if not has_repr:
        decorated.__repr__ = _repr
    return cast("type[T]", decorated)


def flag(value: bool, name: str) -> bool:
    """`value` as a bool, or an error if it is something else."""
    if not isinstance(value, bool | np.bool_):
        raise InvalidValueError(f"{name} is {value!r}; it must be True or False")
    return bool(value)


def file_path(path: Any) -> Path:
    """A path, or an error if it cannot be one."""
    if not isinstance(path, str | os.PathLike) or isinstance(os.fspath(path), bytes):
        raise FileError(f"{path!r} is not a path; give the name of a file as a text or a Path")
    return Path(path)


def set_field(instance: Any, name: str, item: Any) -> None:
    """Set a field of a frozen value in its own `__post_init__`, for conversion to its stored form."""
    object.__setattr__(instance, name, item)


def _freeze(self: Any) -> None:
    for name, item in vars(self).items():
        if isinstance(item, np.ndarray):
            set_field(self, name, read_only(item))


@dataclass_transform(frozen_default=True, field_specifiers=(dataclasses.field, Given))
def result(cls: type[T]) -> type[T]:
    """Make a class a value that only functions of the package construct: its arrays become read-only, unchecked."""
    cls.__post_init__ = _freeze  # type: ignore[attr-defined]
    return value(cls)
