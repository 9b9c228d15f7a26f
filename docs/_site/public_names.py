"""Every public name, and where it is described: an object has one page, at its shortest name."""

import inspect
from types import ModuleType
from typing import NamedTuple

import plenoptic as pl


class Place(NamedTuple):
    """A public name. `space` is "" at the top, otherwise the namespace."""

    space: str
    name: str
    found: object

    @property
    def spoken(self) -> str:
        """As users write it: pl.optics.Air."""
        return ".".join(part for part in ("pl", self.space, self.name) if part)

    @property
    def full(self) -> str:
        return "plenoptic" + self.spoken[2:]


def names_of(module: ModuleType) -> list[str]:
    """What a public module lists, or the functions and classes that it defines."""
    listed = getattr(module, "__all__", None)
    if listed is None:
        parts = [
            (name, part) for name, part in vars(module).items() if inspect.isfunction(part) or inspect.isclass(part)
        ]
        listed = [name for name, part in parts if part.__module__ == module.__name__ and name[0] != "_"]
    return sorted(listed, key=str.lower)


def spaces() -> dict[str, ModuleType]:
    return {name: found for name in names_of(pl) if inspect.ismodule(found := getattr(pl, name))}


def places() -> list[Place]:
    """All of them, also those that are public at two places; the top first."""
    below = spaces()
    top = [Place("", name, getattr(pl, name)) for name in names_of(pl) if name not in below]
    return top + [Place(space, name, getattr(part, name)) for space, part in below.items() for name in names_of(part)]


def page_of(places: list[Place]) -> dict[Place, Place]:
    """For each place the one whose page describes it."""
    first: dict[int, Place] = {}
    return {place: first.setdefault(id(place.found), place) for place in places}
