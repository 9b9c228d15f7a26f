"""The package's public face: what type checkers see is what users get, and each name shows an example."""

import ast
import inspect
from pathlib import Path

import pytest

import plenoptic as pl

NAMES = sorted(set(pl.__all__))


def parts_of(module):
    """The functions and classes that a public module offers: those it lists, or the functions it defines."""
    if hasattr(module, "__all__"):
        return {name: getattr(module, name) for name in module.__all__}
    functions = inspect.getmembers(module, inspect.isfunction)
    return {name: part for name, part in functions if part.__module__ == module.__name__ and name[0] != "_"}


def test_type_checkers_see_the_same_names():
    tree = ast.parse(Path(pl.__file__).read_text(encoding="utf-8"))
    guarded = next(node for node in tree.body if isinstance(node, ast.If)).body
    declared = {
        alias.asname: f"{node.module}.{alias.name}"
        for node in guarded
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert sorted(declared) == NAMES
    for name, source in declared.items():
        found = getattr(pl, name)
        module, _, attribute = source.rpartition(".")
        if inspect.ismodule(found):
            assert found.__name__ == source
        elif inspect.isclass(found) or inspect.isfunction(found):
            assert (found.__module__, found.__name__) == (module, attribute)


def test_unknown_names_are_attribute_errors():
    with pytest.raises(AttributeError, match="no attribute 'rendr'"):
        pl.rendr  # noqa: B018
    assert set(NAMES) <= set(dir(pl))


@pytest.mark.parametrize("name", NAMES)
def test_every_public_name_has_an_example(name):
    found = getattr(pl, name)
    if inspect.ismodule(found):
        parts = list(parts_of(found).values())
    elif inspect.isclass(found) or inspect.isfunction(found):
        parts = [found]
    else:
        parts = []
    for part in parts:
        text = inspect.getdoc(part) or ""
        assert ">>>" in text or "See `" in text, f"{part.__qualname__} has no example"


def test_the_list_in_the_documents_has_every_name():
    listed = (Path(__file__).parents[1] / "docs" / "api.md").read_text(encoding="utf-8")
    functions = [
        f"{name}.{part}" for name in NAMES if inspect.ismodule(found := getattr(pl, name)) for part in parts_of(found)
    ]
    assert len(functions) > 10
    assert [name for name in NAMES + functions if f"| `pl.{name}` |" not in listed] == []
