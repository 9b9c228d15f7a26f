"""Identity of a render as texts, comparable with those of another run."""

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
    from plenoptic.scene.scene_record import SceneRecord


def identity(scene: SceneRecord | None, camera: PlenopticCamera, **facts: Any) -> dict[str, str]:
    """Identity of a render: texts, or digests of large values. Renders of equal identity add up to the same image.

    It contains the version of this package, the fields of the camera and of values among the facts one by one, and the
    other facts: numbers, texts, enums and tuples of them. Media of other packages are represented by their indices at
    the wavelengths of the camera. It is the same in every process. Raises InvalidValueError for a value that has no
    such representation.
    """
    texts = {"plenoptic": __version__, "scene": _text(scene)}
    for name, fact in {"camera": camera, **facts}.items():
        fields = dataclasses.fields(fact) if dataclasses.is_dataclass(fact) else ()
        for field in fields:
            texts[f"{name}.{field.name}"] = _text(getattr(fact, field.name), _by_index(camera))
        if not fields:
            texts[name] = _text(fact)
    return texts


def differences(theirs: Mapping[str, str], ours: Mapping[str, str]) -> Iterator[str]:
    """Differences of another identity from ours, in words: seed 1, not 2."""
    for name in {**ours, **theirs}:
        their_text, our_text = theirs.get(name), ours.get(name)
        if their_text == our_text:
            continue
        if their_text is None or our_text is None:
            yield f"no {name}" if their_text is None else f"{name} {their_text}"
        elif their_text.startswith(MARK) or our_text.startswith(MARK):
            yield f"another {name}"
        else:
            yield f"{name} {their_text}, not {our_text}"


def _text(fact: Any, convert: Callable[[Any], Any] | None = None) -> str:
    """A fact as a short text, or as a digest if it is long."""
    if isinstance(fact, np.generic):
        fact = fact.item()
    if isinstance(fact, enum.Flag):  # one by one: a name such as ALL may cover more flags later
        return "|".join(str(flag.name) for flag in type(fact) if flag.value.bit_count() == 1 and flag in fact) or "NONE"
    if isinstance(fact, enum.Enum):
        return fact.name
    if fact is None or isinstance(fact, bool | int | float | str):
        return str(fact)
    if type(fact) is tuple and len(fact) <= 8 and all(item is None or isinstance(item, int | float) for item in fact):
        return f"({', '.join(map(_text, fact))})"
    return digest(fact, convert=convert)


def _by_index(camera: PlenopticCamera) -> Callable[[Any], Any]:
    """Function that represents a medium of another package by its indices."""

    def indices(medium: Any) -> Any:
        if not callable(getattr(medium, "index", None)):
            raise InvalidValueError(
                f"a {type(medium).__name__} cannot be told from another one in a later run; "
                "take a medium of this package, or leave out checkpoint="
            )
        wavelengths = [camera.wavelength]
        if camera.sensitivity is not None:
            wavelengths += colour_tables(camera.sensitivity).wavelengths.tolist()
        return type(medium).__qualname__, *(float(medium.index(wave)) for wave in wavelengths)

    return indices
