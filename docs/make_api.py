"""Write docs/api.md: every public name with the first line of its docstring, by the namespace that it is in.

Run it after adding a name.
"""

import inspect
from pathlib import Path
from types import ModuleType

import plenoptic as pl


def names_of(module: ModuleType) -> list[str]:
    """What a public module lists, or the functions that it defines."""
    listed = getattr(module, "__all__", None)
    if listed is None:
        parts = [
            (name, part) for name, part in vars(module).items() if inspect.isfunction(part) or inspect.isclass(part)
        ]
        listed = [name for name, part in parts if part.__module__ == module.__name__ and name[0] != "_"]
    return sorted(listed, key=str.lower)


def row(place: str, found: object) -> str:
    described = inspect.ismodule(found) or callable(found)
    return f"| `{place}` | {(inspect.getdoc(found) or '').split(chr(10), 1)[0] if described else f'`{found!r}`'} |"


def section(place: str, module: ModuleType) -> list[str]:
    rows = [(name, getattr(module, name)) for name in names_of(module)]
    return ["", f"## {place}", "", "| name | |", "|---|---|", *(row(f"{place}.{name}", found) for name, found in rows)]


def main() -> None:
    spaces = {name: found for name in names_of(pl) if inspect.ismodule(found := getattr(pl, name))}
    text = [
        "# Public names",
        "",
        "Written by `python docs/make_api.py`. Each has a docstring with an example: `help(pl.render)`.",
        *section("pl", pl),
    ]
    for name, module in spaces.items():
        text += section(f"pl.{name}", module)
    Path(__file__).with_name("api.md").write_text("\n".join(text) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
