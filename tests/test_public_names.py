"""The package's public face: at most 90 names at the top, the rest in namespaces, and each name shows an example."""

import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import plenoptic as pl

SPACES = {name: found for name in pl.__all__ if inspect.ismodule(found := getattr(pl, name))}
PACKAGE = Path(pl.__file__).parent


def names_of(module):
    """What a public module lists, or the functions and classes that it defines."""
    if hasattr(module, "__all__"):
        return list(module.__all__)
    parts = [(name, part) for name, part in vars(module).items() if inspect.isfunction(part) or inspect.isclass(part)]
    return [name for name, part in parts if part.__module__ == module.__name__ and name[0] != "_"]


NAMES = sorted(
    [("pl", name) for name in pl.__all__ if name not in SPACES]
    + [(space, name) for space, module in SPACES.items() for name in names_of(module)]
)


def found_at(space, name):
    return getattr(pl if space == "pl" else SPACES[space], name)


def test_the_top_is_what_users_type_daily():
    assert len(pl.__all__) <= 90
    assert set(pl.__all__) <= set(dir(pl))


def test_unknown_names_are_attribute_errors():
    with pytest.raises(AttributeError, match="rendr"):
        pl.rendr  # noqa: B018


@pytest.mark.parametrize("space", sorted(SPACES))
def test_namespaces_work_in_all_forms_of_import(space):
    # In a process of its own: what is loaded already would hide what is missing.
    name = names_of(SPACES[space])[0]
    ways = (
        f"import plenoptic.{space} as found",
        f"from plenoptic import {space} as found",
        f"import plenoptic\nfound = plenoptic.{space}",
        f"import importlib\nfound = importlib.import_module('plenoptic.{space}')",
    )
    same = "".join(f"{way}\nplaces.append(found.{name})\n" for way in ways)
    code = f"places = []\n{same}from plenoptic.{space} import {name}\nassert all(place is {name} for place in places)"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    "folder", sorted({path.parent for path in PACKAGE.rglob("__init__.pyi")}), ids=lambda f: f.name
)
def test_no_name_is_that_of_a_file_beside_it(folder):
    """`from plenoptic.camera.pose import Pose` would otherwise put the module in the name's place."""
    space = pl if folder == PACKAGE else SPACES[folder.name]
    files = {path.stem for path in folder.iterdir() if path.stem != "__init__"} - set(SPACES)
    assert not files & {name for name in names_of(space) if not inspect.ismodule(getattr(space, name))}


@pytest.mark.parametrize(("space", "name"), NAMES)
def test_every_public_name_has_an_example(space, name):
    found = found_at(space, name)
    if inspect.isclass(found) or inspect.isfunction(found):
        text = inspect.getdoc(found) or ""
        assert ">>>" in text or "See `" in text, f"{found.__qualname__} has no example"


def test_the_list_in_the_documents_has_every_name():
    listed = (Path(__file__).parents[1] / "docs" / "api.md").read_text(encoding="utf-8")
    places = [f"pl.{name}" if space == "pl" else f"pl.{space}.{name}" for space, name in NAMES]
    assert len(places) > 200
    assert [place for place in places if f"| `{place}` |" not in listed] == []
