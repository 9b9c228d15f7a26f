"""Write docs/api.md: every public name, and every function of a public module, with the first line of its docstring.

Run it after adding a name.
"""

import inspect
from pathlib import Path

import plenoptic as pl

GROUPS = (
    (
        "Rendering",
        (
            "plenoptic.rendering.render",
            "plenoptic.planning.plan",
            "plenoptic.planning.stages",
            "plenoptic.exposure",
            "plenoptic.render_stats",
            "plenoptic.rendering.truth",
            "plenoptic.film",
            "plenoptic.render_settings",
            "plenoptic.lit",
            "plenoptic.replaying",
        ),
    ),
    ("Camera", ("plenoptic.camera",)),
    ("Optics", ("plenoptic.optics", "plenoptic.rays")),
    ("Scene", ("plenoptic.scene",)),
    ("Colour", ("plenoptic.spectra", "plenoptic.sensitivities")),
    ("Sensors", ("plenoptic.sensing",)),
    ("Light fields", ("plenoptic.lightfield",)),
    ("Figures", ("plenoptic.plots",)),
    ("Studies", ("plenoptic.study",)),
    ("Modules, sampling and images", ("plenoptic.images", "plenoptic.srgb", "plenoptic.sampling")),
    ("Errors", ("plenoptic.errors",)),
)


def home(name: str) -> str:
    found = getattr(pl, name)
    if inspect.ismodule(found):
        return found.__name__
    return getattr(found, "__module__", type(found).__module__)


def lines(name: str) -> list[str]:
    """The row of a name; a module's functions follow it."""
    found = getattr(pl, name)
    if not (inspect.ismodule(found) or callable(found)):
        return [f"| `pl.{name}` | `{found!r}` |"]
    rows = [f"| `pl.{name}` | {summary(found)} |"]
    if inspect.ismodule(found):
        rows += [f"| `pl.{name}.{part}` | {summary(made)} |" for part, made in parts_of(found)]
    return rows


def parts_of(module: object) -> list[tuple[str, object]]:
    """What a module lists as its own, or the functions that it defines."""
    listed = getattr(module, "__all__", None)
    if listed is not None:
        return [(part, getattr(module, part)) for part in sorted(listed, key=str.lower)]
    parts = inspect.getmembers(module, inspect.isfunction)
    return [(part, made) for part, made in parts if made.__module__ == module.__name__ and not part.startswith("_")]


def summary(found: object) -> str:
    return (inspect.getdoc(found) or "").split("\n", 1)[0]


def main() -> None:
    names = sorted(pl.__all__, key=str.lower)
    text = [
        "# Public names",
        "",
        "Written by `python docs/make_api.py`. Each has a docstring with an example: `help(pl.render)`.",
    ]
    for title, modules in GROUPS:
        text += ["", f"## {title}", "", "| name | |", "|---|---|"]
        text += [row for name in names if home(name).startswith(modules) for row in lines(name)]
    Path(__file__).with_name("api.md").write_text("\n".join(text) + "\n", encoding="utf-8")
    left = [name for name in names if not any(home(name).startswith(modules) for _, modules in GROUPS)]
    assert not left, left


if __name__ == "__main__":
    main()
