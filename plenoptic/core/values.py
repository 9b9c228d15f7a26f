"""Immutable values: frozen dataclasses whose arrays are read-only, comparable and picklable."""

from __future__ import annotations

import dataclasses
import enum
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.errors import FileError, InvalidValueError, PrescriptionError

if TYPE_CHECKING:
    from typing_extensions import dataclass_transform
else:

    def dataclass_transform(**_: Any) -> Callable[[Any], Any]:
        """Substitute for the decorator of Python 3.11, which type checkers know."""
        return lambda decorated: decorated


Floats = NDArray[np.float64]
AnyFloats = NDArray[np.floating[Any]]
"""Of any precision."""

T = TypeVar("T")
Kept = TypeVar("Kept")
Taken = TypeVar("Taken")
Number = TypeVar("Number", bound=np.generic)
Choice = TypeVar("Choice", bound=enum.Enum)

if TYPE_CHECKING:

    class Given(Generic[Kept, Taken]):
        """The type of a field that takes more than it keeps, as lists for an array; called, its default."""

        def __init__(self, *, default: Any) -> None: ...
        def __get__(self, instance: object, owner: Any) -> Kept: ...
        def __set__(self, instance: object, value: Taken) -> None: ...
else:
    Given = dataclasses.field

SHORTEST, LONGEST = 10.0, 1e6
"""Wavelengths in nm, from ultraviolet to far infrared; 0.55, meant as micrometres, is none."""

SMALLEST_LENGTH, LARGEST_LENGTH = 1e-15, 1e15
"""mm, from a nucleus to a light-month: products and quotients of four are finite, as are areas in float32.

Embree, in float32, drops vertices beyond 1.8e18.
"""

LARGEST_WHOLE = (1 << 63) - 1
"""Of 64 bits with a sign, as kernels count."""

MOST_PIXELS = 1 << 31
"""Of a sensor, as random numbers and files count them."""

MOST_POINTS = 1 << 24
"""Points, rays or corners that one array holds: 400 MB of their coordinates."""

_SHOWN = 9
"""Numbers that an array may have to be shown in full: those of a rotation."""


def read_only(array: NDArray[Number]) -> NDArray[Number]:
    """A read-only view of an array; the array itself stays as it is."""
    view = array.view()
    view.flags.writeable = False
    return view


def contiguous(array: NDArray[Number]) -> NDArray[Number]:
    """A read-only, C-contiguous form of an array, as kernels take it."""
    return read_only(np.ascontiguousarray(array))


def plain_array(values: ArrayLike, name: str) -> NDArray[Any]:
    """An array of booleans, whole numbers or floats, or an error that names it."""
    try:
        given = np.asarray(values)
        if given.dtype.kind == "O":  # whole numbers beyond 64 bits, fractions; None would become nan
            given = np.array([number(item, f"an item of {name}") for item in given.ravel()]).reshape(given.shape)
        if given.dtype.kind in "biuf":
            return given
        found = f"it has the type {given.dtype}"
    except ValueError as error:
        found = str(error)
    raise InvalidValueError(f"{name} is not an array of numbers: {found}")


def numbers(values: ArrayLike, name: str, *, columns: int | None = None) -> Floats:
    """Numbers in an array of any shape, or one whose rows have so many columns; an error that names it otherwise."""
    array = plain_array(values, name).astype(np.float64, copy=False)
    if columns is not None and array.shape[-1:] != (columns,):
        raise InvalidValueError(f"{name} has shape {array.shape}; it must have shape (..., {columns})")
    return array


def alike(**arrays: ArrayLike) -> tuple[Floats, ...]:
    """Several arrays of numbers, brought to one shape as NumPy does, or an error that names them."""
    given = [numbers(values, name) for name, values in arrays.items()]
    try:
        return tuple(np.broadcast_arrays(*given))
    except ValueError:
        shapes = " and ".join(f"{name} {array.shape}" for name, array in zip(arrays, given, strict=True))
        raise InvalidValueError(f"the shapes of {shapes} do not fit; give one for each, or one for all") from None


def frozen_array(
    values: ArrayLike, *, name: str, shape: tuple[int | str | None, ...], dtype: Any = np.float64
) -> NDArray[Any]:
    """A read-only copy of `values`, of the given shape (None, or a name for the message: any length).

    An array that is read-only and no view of another one is taken as it is.
    """
    given = plain_array(values, name)
    frozen = not given.flags.writeable and given.flags.owndata and given.flags.c_contiguous
    with np.errstate(invalid="ignore", over="ignore"):
        array = given.astype(dtype, order="C", copy=not frozen)
    if array.dtype.kind in "iu" and array.dtype != given.dtype and not np.array_equal(given, array):
        raise InvalidValueError(f"{name} must hold whole numbers, from {np.iinfo(dtype).min} to {np.iinfo(dtype).max}")
    fits = array.ndim == len(shape) and all(
        not isinstance(want, int) or have == want for have, want in zip(array.shape, shape, strict=True)
    )
    if not fits:
        wanted = "(" + ", ".join("n" if n is None else str(n) for n in shape) + ("," if len(shape) == 1 else "") + ")"
        flat = shape[-1] == "channels" and array.ndim == len(shape) - 1
        hint = f": give {name}[..., np.newaxis], which has one channel" if flat else ""
        raise InvalidValueError(f"{name} has shape {array.shape}; it must have shape {wanted}{hint}")
    array.flags.writeable = False
    return array


def number(value: float, name: str) -> float:
    """`value` as a float, which may be infinite or nan, or an error that names it where it is no number."""
    try:
        if isinstance(value, str | bytes | bool | np.bool_):
            raise TypeError
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise InvalidValueError(f"{name} is {value!r}; it must be a number") from None


def finite(value: float, name: str) -> float:
    """`value` as a float, or an error that names it where it is not a finite number."""
    given = number(value, name)
    if not math.isfinite(given):
        raise InvalidValueError(f"{name} is {given}; it must be finite")
    return given


_TURNS = 4
"""More than that are degrees."""


def radians(value: float, name: str) -> float:
    """`value` as an angle in radians, or an error where it must be one in degrees."""
    given = finite(value, name)
    if abs(given) > _TURNS * math.tau:
        raise InvalidValueError(
            f"{name} is {given:g} rad; it must be at most {_TURNS} turns: give radians, such as math.radians({given:g})"
        )
    return given


def coefficients(values: Iterable[float], name: str, wanted: str = "a sequence of numbers") -> tuple[float, ...]:
    """Finite numbers of a prescription; an error for others, and a PrescriptionError for anything but a sequence."""
    try:
        if isinstance(values, str | bytes | Mapping | Set):
            raise TypeError
        return tuple(finite(item, f"{name}[{i}]") for i, item in enumerate(values))
    except TypeError:
        raise PrescriptionError(f"{name} is {values!r}; it must be {wanted}") from None


def wavelength_in_nm(value: float, name: str = "wavelength") -> float:
    """`value` as a float, or an error where it cannot be a wavelength in nm."""
    given = positive(value, name, "nm")
    if not SHORTEST <= given <= LONGEST:
        raise InvalidValueError(
            f"{name} is {given:g} nm; it must be from {SHORTEST:g} to {LONGEST:g} nm: wavelengths are in nanometres"
        )
    return given


def positive(value: float, name: str, unit: str = "") -> float:
    """`value` as a float, or an error that names it where it is not above zero and finite."""
    given = finite(value, name)
    if given <= 0:
        raise InvalidValueError(f"{name} is {given:g}{unit and ' ' + unit}; it must be above 0")
    return given


def length_in_mm(value: float, name: str) -> float:
    """`value` as a float, or an error that names it where it is no length above 0 mm that anything has."""
    given = positive(value, name, "mm")
    if not SMALLEST_LENGTH <= given <= LARGEST_LENGTH:
        raise InvalidValueError(
            f"{name} is {given:g} mm; it must be from {SMALLEST_LENGTH:g} to {LARGEST_LENGTH:g} mm: lengths are in mm"
        )
    return given


def coordinate(value: float, name: str) -> float:
    """`value` as a float, or an error that names it where it is farther from 0 mm than anything."""
    given = finite(value, name)
    if abs(given) > LARGEST_LENGTH:
        raise InvalidValueError(f"{name} is {given:g} mm; it must be within {LARGEST_LENGTH:g} mm of 0")
    return given


def positions(values: ArrayLike, *, name: str, shape: tuple[int | str | None, ...]) -> Floats:
    """A read-only copy of coordinates, of the given shape, none of them farther from 0 mm than anything."""
    array = frozen_array(values, name=name, shape=shape)
    near = np.abs(array) <= LARGEST_LENGTH
    if not near.all():
        raise InvalidValueError(
            f"{name} holds {array[~near][0]:g} mm, which is not finite or farther than {LARGEST_LENGTH:g} mm from 0"
        )
    return array


def not_negative(value: float, name: str, unit: str = "") -> float:
    """`value` as a float, or an error that names it where it is below zero or not finite."""
    given = finite(value, name)
    if given < 0:
        raise InvalidValueError(f"{name} is {given:g}{unit and ' ' + unit}; it must be at least 0")
    return given


def whole(value: int, name: str, *, at_least: int, at_most: int = LARGEST_WHOLE) -> int:
    """`value` as an int, or an error where it is no whole number, too small or too large."""
    if isinstance(value, bool | np.bool_ | np.timedelta64) or not isinstance(value, int | np.integer):
        raise InvalidValueError(f"{name} is {value!r}; it must be a whole number")
    given = int(value)
    if not at_least <= given <= at_most:
        limit = f"at least {at_least}" if given < at_least else f"at most {at_most}"
        raise InvalidValueError(f"{name} is {given}; it must be {limit}")
    return given


def checked_shape(
    shape: Any, names: tuple[str, ...], *, at_least: int = 1, at_most: int = MOST_PIXELS
) -> tuple[int, ...]:
    """`shape` as ints, one for each name, or an error where one is too small or all together are too many."""
    sides = tuple(shape) if isinstance(shape, Sequence) or (isinstance(shape, np.ndarray) and shape.ndim) else ()
    if len(sides) != len(names) or isinstance(shape, str | bytes):
        raise InvalidValueError(f"shape is {shape!r}; it must be ({', '.join(name.split()[0] for name in names)})")
    found = tuple(whole(side, name, at_least=at_least) for side, name in zip(sides, names, strict=True))
    if math.prod(found) > at_most:
        product = " x ".join(map(str, found))
        raise InvalidValueError(f"{' x '.join(names)} is {product}; it must be at most {at_most} in all")
    return found


def seed_number(value: int, name: str = "seed") -> int:
    """`value` as an int, or an error where it is no whole number from 0 to 2^64 - 1."""
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


def wrong_kind(value: object, name: str, wanted: str, such_as: str) -> InvalidValueError:
    """The error for an argument of another type than `wanted`, with a way to one that fits."""
    given = _with_article(type(value).__name__)
    return InvalidValueError(f"{name} is {given}; give {_with_article(wanted)}, such as {such_as}")


def check_kind(value: object, name: str, wanted: type, such_as: str) -> None:
    """The same error, raised where the argument is of another type."""
    if not isinstance(value, wanted):
        raise wrong_kind(value, name, wanted.__name__, such_as)


def check_has(value: object, name: str, wanted: str, such_as: str, *attributes: str) -> None:
    """The same error, raised where an attribute is missing: for code that must not import the type."""
    if not all(hasattr(value, attribute) for attribute in attributes):
        raise wrong_kind(value, name, wanted, such_as)


def _with_article(noun: str) -> str:
    return f"an {noun}" if noun[0] in "AEIOaeio" or noun.startswith("nd") else f"a {noun}"


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return (
            isinstance(a, np.ndarray)
            and isinstance(b, np.ndarray)
            and a.shape == b.shape
            and a.dtype == b.dtype
            and np.array_equal(a, b, equal_nan=a.dtype.kind in "fc")
        )
    return bool(a == b)


def _hashable(item: Any) -> Any:
    if not isinstance(item, np.ndarray):
        return item
    if item.dtype.kind in "fc":  # what compares equal must hash equal: both zeros, and every NaN
        item = np.where(np.isnan(item), np.nan, item) + 0.0
    return item.shape, item.tobytes()


def _short(item: Any) -> str:
    if isinstance(item, np.ndarray):
        if 1 <= item.size <= _SHOWN and item.ndim <= 2:
            return repr(item.tolist())
        return f"<{' x '.join(map(str, item.shape))} {item.dtype}>"
    return repr(item)


def _equal(self: Any, other: object) -> Any:
    fields = dataclasses.fields(self)
    if type(self) is not type(other):
        return NotImplemented
    return all(_same(getattr(self, f.name), getattr(other, f.name)) for f in fields if f.compare)


def _hash(self: Any) -> int:
    return hash((type(self), *(_hashable(getattr(self, f.name)) for f in dataclasses.fields(self) if f.compare)))


def _repr(self: Any) -> str:
    shown = []
    for field in dataclasses.fields(self):
        item = getattr(self, field.name)
        if field.repr and not (field.default is not dataclasses.MISSING and _same(item, field.default)):
            shown.append(f"{field.name}={_short(item)}")
    return f"{type(self).__name__}({', '.join(shown)})"


def _restore(self: Any, state: dict[str, Any]) -> None:
    # Pickling forgets that an array was read-only.
    for name, item in state.items():
        if isinstance(item, np.ndarray):
            item.flags.writeable = False
        object.__setattr__(self, name, item)


@dataclass_transform(frozen_default=True, field_specifiers=(dataclasses.field, Given))
def value(cls: type[T]) -> type[T]:
    """Make a class a frozen dataclass that also compares, hashes, prints and pickles with arrays in it."""
    has_own_repr = "__repr__" in cls.__dict__
    made: Any = dataclasses.dataclass(frozen=True, eq=False, repr=False)(cls)
    made.__eq__ = _equal
    made.__hash__ = _hash
    made.__setstate__ = _restore
    if not has_own_repr:
        made.__repr__ = _repr
    finished: type[T] = made
    return finished


def flag(value: bool, name: str) -> bool:
    """`value` as a bool, or an error where it is something else."""
    if not isinstance(value, bool | np.bool_):
        raise InvalidValueError(f"{name} is {value!r}; it must be True or False")
    return bool(value)


def file_path(path: Any) -> Path:
    """A path, or an error where it cannot be one."""
    if not isinstance(path, str | os.PathLike) or isinstance(os.fspath(path), bytes):
        raise FileError(f"{path!r} is not a path; give the name of a file as a text or a Path")
    return Path(path)


def set_field(instance: Any, name: str, item: Any) -> None:
    """Set a field of a frozen value from its own `__post_init__`, where it is brought into its final form."""
    object.__setattr__(instance, name, item)


def _freeze(self: Any) -> None:
    for name, item in vars(self).items():
        if isinstance(item, np.ndarray):
            set_field(self, name, read_only(item))


@dataclass_transform(frozen_default=True, field_specifiers=(dataclasses.field, Given))
def result(cls: type[T]) -> type[T]:
    """Make a class a value that only functions of the package make: its arrays become read-only, unchecked."""
    made: Any = cls
    made.__post_init__ = _freeze
    return value(cls)
