"""Write a page for each public name into docs/api/, which is not kept: what numpydoc makes of its docstring."""

import enum
import inspect
from pathlib import Path

from public_names import Place, page_of, places, spaces

TOP = "What users type daily. With `import plenoptic as pl`, these are `pl.PlenopticCamera`, `pl.render` and so on."

TABLE = [".. list-table::", "   :widths: 25 75", ""]


def file_of(place: Place) -> str:
    """`coma` and `Coma` are one file where file systems do not tell small letters from capitals."""
    return place.full + ("-class" if inspect.isclass(place.found) else "")


def summary(found: object) -> str:
    described = inspect.ismodule(found) or callable(found)
    return (inspect.getdoc(found) or "").split("\n", 1)[0] if described else f"``{found!r}``"


def page(place: Place, others: list[Place]) -> str:
    found, name = place.found, place.full
    lines = [place.spoken, "=" * len(place.spoken), ""]
    if inspect.isclass(found):
        members = ["   :members:"]
        if issubclass(found, enum.Enum):
            members += ["   :undoc-members:", "   :member-order: bysource"]
        lines += [f".. autoclass:: {name}", *members]
    elif inspect.isfunction(found):
        lines += [f".. autofunction:: {name}"]
    else:
        lines += [f".. py:data:: {name}", "", f"   {summary(found)}"]
    if others:
        lines += ["", "The same as " + ", ".join(f"``{other.spoken}``" for other in others) + "."]
    return "\n".join([*lines, "", f".. minigallery:: {name}", "   :add-heading: Examples that use it", ""])


def index(title: str, about: str, listed: list[Place], pages: dict[Place, Place]) -> str:
    lines = [title, "=" * len(title), "", about, "", *TABLE]
    for place in listed:
        lines += [f"   * - :doc:`{place.spoken} <{file_of(pages[place])}>`", f"     - {summary(place.found)}"]
    own = [file_of(place) for place in listed if pages[place] is place]
    titles = [f"   {place.spoken} <{file_of(place)}>" for place in listed if pages[place] is place]
    return "\n".join([*lines, "", ".. toctree::", "   :hidden:", "", *(titles if own else []), ""])


def write_pages(folder: Path) -> None:
    """Only what changed is written, so that Sphinx reads only that again."""
    found = places()
    pages = page_of(found)
    texts = {
        file_of(place): page(place, [other for other in found if other != place and pages[other] is place])
        for place in set(pages.values())
    }
    texts["top"] = index("pl", TOP, [place for place in found if not place.space], pages)
    for name, module in spaces().items():
        about = inspect.getdoc(module) or ""
        texts[f"pl.{name}"] = index(f"pl.{name}", about, [place for place in found if place.space == name], pages)
    rows = ["   * - :doc:`pl <top>`", f"     - {TOP}"]
    for name, module in spaces().items():
        rows += [f"   * - :doc:`pl.{name} <pl.{name}>`", f"     - {summary(module)}"]
    head = ["API", "===", "", "Every public name has a page with its docstring and an example, by namespaces.", ""]
    tree = ["", ".. toctree::", "   :hidden:", "", "   pl <top>", *(f"   pl.{name}" for name in spaces()), ""]
    texts["index"] = "\n".join(
        [*head, ".. list-table::", "   :widths: 25 75", "   :class: api-names", "", *rows, *tree]
    )
    folder.mkdir(exist_ok=True)
    for old in set(folder.glob("*.rst")) - {folder / f"{name}.rst" for name in texts}:
        old.unlink()
    for name, text in texts.items():
        path = folder / f"{name}.rst"
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
