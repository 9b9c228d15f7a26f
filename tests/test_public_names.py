"""The package's public face: at most 99 names at the top, the rest in namespaces, and each name shows an example."""

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
    assert len(pl.__all__) <= 102 and set(pl.__all__) <= set(dir(pl))
    with pytest.raises(AttributeError, match="rendr"):
        pl.rendr  # noqa: B018


FORMS = """
import sys
for space, name in {pairs}:
    # As in a new process: what is loaded already would hide what is missing.
    for loaded in [loaded for loaded in sys.modules if loaded.partition(".")[0] == "plenoptic"]:
        del sys.modules[loaded]
    known, places = {{}}, []
    for form in (
        f"import plenoptic.{{space}} as found",
        f"from plenoptic import {{space}} as found",
        f"import plenoptic; found = plenoptic.{{space}}",
        f"import importlib; found = importlib.import_module('plenoptic.{{space}}')",
    ):
        exec(form, known)
        places.append(getattr(known["found"], name))
    exec(f"from plenoptic.{{space}} import {{name}} as one", known)
    assert all(place is known["one"] for place in places), space
"""


def test_wrong_names_are_answered_by_similar_ones():
    answers = {
        "Lens": "LensStack",
        "rendr": "render",
        "SpotLight": r"plenoptic\.lights\.",
        "Xyzzy": r"dir\(plenoptic\)",
    }
    for name, similar in answers.items():
        with pytest.raises(AttributeError, match=f"plenoptic has no {name}; see .*{similar}"):
            getattr(pl, name)


def test_namespaces_work_in_all_forms_of_import():
    pairs = [(space, public_names.names_of(module)[0]) for space, module in SPACES.items()]
    assert len(pairs) > 20
    subprocess.run([sys.executable, "-c", FORMS.format(pairs=pairs)], check=True)


def test_no_name_is_that_of_a_file_beside_it():
    """`from plenoptic.core.motions.pose import Pose` would otherwise put the module in the name's place."""
    folders = {path.parent for path in PACKAGE.rglob("__init__.pyi")}
    assert len(folders) > 5
    for folder in folders:
        space = pl if folder == PACKAGE else SPACES[folder.name]
        files = {path.stem for path in folder.iterdir() if path.stem != "__init__"} - set(SPACES)
        names = {name for name in public_names.names_of(space) if not inspect.ismodule(getattr(space, name))}
        assert not files & names, folder


def test_every_public_name_has_an_example_and_a_page_on_the_site(tmp_path):
    pages = from_documents("api_pages")
    pages.write_pages(tmp_path)
    described = public_names.page_of(PLACES)
    assert len(PLACES) > 200
    for place in PLACES:
        if inspect.isclass(place.found) or inspect.isfunction(place.found):
            text = inspect.getdoc(place.found) or ""
            assert ">>>" in text or "See `" in text or "ade by `" in text, f"{place.spoken} has no example"
        name = pages.file_of(described[place])
        assert described[place].full in (tmp_path / f"{name}.rst").read_text(encoding="utf-8")
        index = "pl." + place.space if place.space else "top"
        assert f"`{place.spoken} <{name}>`" in (tmp_path / f"{index}.rst").read_text(encoding="utf-8")
    files = [path.name.lower() for path in tmp_path.iterdir()]
    assert len(files) == len(set(files)), "file systems that do not tell small letters from capitals would lose a page"
