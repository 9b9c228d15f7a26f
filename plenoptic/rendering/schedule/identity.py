"""Identity of a render, in texts that can be compared with those of another run."""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from plenoptic import __version__
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.color.spectra import colour_tables
from plenoptic.core.files.digest import MARK, digest
from plenoptic.errors import InvalidValueError

if TYPE_CHECKING:
    from plenoptic.scene.compile import SceneRecord


def identity(scene: SceneRecord | None, camera: PlenopticCamera, **facts: Any) -> dict[str, str]:
    """Identity of a render, in texts, or digests of long ones: images of equal identity may be added.

    It has the version of this package, the fields of the camera and of values among the facts one by one, and facts:
    numbers, texts, enums and tuples of them. Media of other origin than this package count by their indices at the
    wavelengths of the camera. The same in every process; an InvalidValueError for values that cannot be distinguished.
    """
    found = {"plenoptic": __version__, "scene": _text(scene)}
    for name, fact in {"camera": camera, **facts}.items():
        parts = dataclasses.fields(fact) if dataclasses.is_dataclass(fact) else ()
        for part in parts:
            found[f"{name}.{part.name}"] = _text(getattr(fact, part.name), _by_index(camera))
        if not parts:
            found[name] = _text(fact)
    return found


def differences(theirs: Mapping[str, str], ours: Mapping[str, str]) -> Iterator[str]:
    """Differences of their identity from ours, in words: seed 1, not 2."""
    for name in {**ours, **theirs}:
        one, other = theirs.get(name), ours.get(name)
        if one == other:
            continue
        if one is None or other is None:
            yield f"no {name}" if one is None else f"{name} {one}"
        elif one.startswith(MARK) or other.startswith(MARK):
            yield f"another {name}"
        else:
            yield f"{name} {one}, not {other}"


def _text(fact: Any, convert: Callable[[Any], Any] | None = None) -> str:
    """A fact as a short text, or as a digest where it is long."""
    if isinstance(fact, np.generic):
        fact = fact.item()
    if isinstance(fact, enum.Flag):  # one by one: what a name such as ALL joins may grow
        return "|".join(str(flag.name) for flag in type(fact) if flag.value.bit_count() == 1 and flag in fact) or "NONE"
    if isinstance(fact, enum.Enum):
        return fact.name
    if fact is None or isinstance(fact, bool | int | float | str):
        return str(fact)
    if type(fact) is tuple and len(fact) <= 8 and all(item is None or isinstance(item, int | float) for item in fact):
        return f"({', '.join(map(_text, fact))})"
    return digest(fact, convert=convert)


def _by_index(camera: PlenopticCamera) -> Callable[[Any], Any]:
    """Description of a medium from outside the package: its indices, as kernels use them."""

    def seen(medium: Any) -> Any:
        if not callable(getattr(medium, "index", None)):
            raise InvalidValueError(
                f"a {type(medium).__name__} cannot be told from another one in a later run; "
                "take a medium of this package, or leave out checkpoint="
            )
        waves = [camera.wavelength]
        if camera.sensitivity is not None:
            waves += colour_tables(camera.sensitivity).wavelengths.tolist()
        return type(medium).__qualname__, *(float(medium.index(wave)) for wave in waves)

    return seen
