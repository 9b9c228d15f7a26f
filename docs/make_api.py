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
            "plenoptic.rendering.plan.plan",
            "plenoptic.rendering.plan.stages",
            "plenoptic.rendering.exposure",
            "plenoptic.rendering.stats",
            "plenoptic.truth",
            "plenoptic.rendering.film",
            "plenoptic.rendering.settings",
            "plenoptic.core.relative_error",
            "plenoptic.replaying",
        ),
    ),
    ("Camera", ("plenoptic.camera",)),
    ("Optics", ("plenoptic.optics", "plenoptic.core.rays")),
    ("Scene", ("plenoptic.scene",)),
    ("Colour", ("plenoptic.core.color.spectra", "plenoptic.core.color.sensitivities")),
    (
        "Sensors",
        (
            "plenoptic.optics.sensor",
            "plenoptic.readout",
        ),
    ),
    ("Light fields", ("plenoptic.lightfield",)),
    ("Figures", ("plenoptic.plots",)),
    ("Studies", ("plenoptic.study",)),
    (
        "Modules, sampling and images",
        ("plenoptic.core.files.images", "plenoptic.core.color.srgb", "plenoptic.core.sampling"),
    ),
    ("Errors", ("plenoptic.errors",)),
)


def home(name: str) -> str:
    found = getattr(pl, name)
    if inspect.ismodule(found):
        return found.__name__
    return getattr(found, "__module__", type(found).__module__)


def group_of(name: str) -> str:
    """The group that names the innermost package around a name."""
    found = [(len(module), title) for title, modules in GROUPS for module in modules if home(name).startswith(module)]
    return max(found)[1]


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
    group = {name: group_of(name) for name in names}
    text = [
        "# Public names",
        "",
        "Written by `python docs/make_api.py`. Each has a docstring with an example: `help(pl.render)`.",
    ]
    for title, _ in GROUPS:
        text += ["", f"## {title}", "", "| name | |", "|---|---|"]
        text += [row for name in names if group[name] == title for row in lines(name)]
    Path(__file__).with_name("api.md").write_text("\n".join(text) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
