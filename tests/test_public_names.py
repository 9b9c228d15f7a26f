"""The package's public face: at most 95 names at the top, the rest in namespaces, and each name shows an example."""

import importlib
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import plenoptic as pl

PACKAGE = Path(pl.__file__).parent
SITE = Path(__file__).parents[1] / "docs" / "_site"


def from_documents(name):
    """A module of the site's, which is no package."""
    sys.path.insert(0, str(SITE))
    try:
        return importlib.import_module(name)
    finally:
        sys.path.remove(str(SITE))


public_names = from_documents("public_names")
SPACES = public_names.spaces()
PLACES = public_names.places()


def test_the_top_is_what_users_type_daily():
    assert len(pl.__all__) <= 97
    assert set(pl.__all__) <= set(dir(pl))


def test_unknown_names_are_attribute_errors():
    with pytest.raises(AttributeError, match="rendr"):
        pl.rendr  # noqa: B018


@pytest.mark.parametrize("space", sorted(SPACES))
def test_namespaces_work_in_all_forms_of_import(space):
    # In a process of its own: what is loaded already would hide what is missing.
    name = public_names.names_of(SPACES[space])[0]
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
    """`from plenoptic.core.motions.pose import Pose` would otherwise put the module in the name's place."""
    space = pl if folder == PACKAGE else SPACES[folder.name]
    files = {path.stem for path in folder.iterdir() if path.stem != "__init__"} - set(SPACES)
    assert not files & {name for name in public_names.names_of(space) if not inspect.ismodule(getattr(space, name))}


@pytest.mark.parametrize("place", PLACES, ids=lambda place: place.spoken)
def test_every_public_name_has_an_example(place):
    if inspect.isclass(place.found) or inspect.isfunction(place.found):
        text = inspect.getdoc(place.found) or ""
        assert ">>>" in text or "See `" in text, f"{place.spoken} has no example"


def test_every_public_name_has_a_page_on_the_site(tmp_path):
    pages = from_documents("api_pages")
    pages.write_pages(tmp_path)
    described = public_names.page_of(PLACES)
    assert len(PLACES) > 200
    for place in PLACES:
        name = pages.file_of(described[place])
        assert described[place].full in (tmp_path / f"{name}.rst").read_text(encoding="utf-8")
        index = "pl." + place.space if place.space else "top"
        assert f"`{place.spoken} <{name}>`" in (tmp_path / f"{index}.rst").read_text(encoding="utf-8")
    files = [path.name.lower() for path in tmp_path.iterdir()]
    assert len(files) == len(set(files)), "file systems that do not tell small letters from capitals would lose a page"
