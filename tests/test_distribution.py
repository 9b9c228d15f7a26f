"""What is uploaded is whole: the source archive makes the wheel, and the wheel holds every file of the package."""

import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]

EVERYTHING = """
import pathlib, plenoptic as pl, sys
assert pathlib.Path(pl.__file__).is_relative_to(sys.argv[1]), pl.__file__
for name in pl.lens_names():
    pl.load_lens(name)
for name in pl.__all__:
    getattr(pl, name)
pl.glass("N-BK7")
"""


@pytest.mark.slow
def test_the_source_archive_makes_a_wheel_that_works_from_an_empty_folder(tmp_path):
    pytest.importorskip("build", reason='needs the extra "dev"')
    subprocess.run([sys.executable, "-m", "build", "--outdir", tmp_path, ROOT], check=True, capture_output=True)
    (archive,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(archive) as packed:
        names = {name.split("/", 1)[-1] for name in packed.getnames()}
    assert {"LICENSE", "README.md", "pyproject.toml", "plenoptic/py.typed"} <= names

    (wheel,) = tmp_path.glob("*.whl")
    package = ROOT / "plenoptic"
    there = {f"plenoptic/{path.relative_to(package).as_posix()}" for path in package.rglob("*") if path.is_file()}
    there = {path for path in there if "__pycache__" not in path.split("/")}
    packed = {name for name in zipfile.ZipFile(wheel).namelist() if name.startswith("plenoptic/")}
    assert packed == there and wheel.name.startswith(PROJECT["name"].replace("-", "_"))

    place, empty = tmp_path / "installed", tmp_path / "empty"
    empty.mkdir()
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", place, wheel]
    subprocess.run(command, check=True)
    subprocess.run([sys.executable, "-c", EVERYTHING, place], check=True, cwd=empty, env={"PYTHONPATH": str(place)})


def test_the_citation_is_of_this_version():
    cited = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    version = (ROOT / "plenoptic" / "__init__.py").read_text(encoding="utf-8").split('__version__ = "')[1].split('"')[0]
    assert f"version: {version}\n" in cited
    assert f"license: {PROJECT['license']}\n" in cited
    assert f"  version: {version}\n" in (ROOT / "recipe" / "recipe.yaml").read_text(encoding="utf-8")


def test_the_recipe_asks_for_what_the_package_asks_for():
    """Of conda-forge: the same packages and bounds, under its names."""
    recipe = (ROOT / "recipe" / "recipe.yaml").read_text(encoding="utf-8")
    renamed = {"lazy_loader": "lazy-loader", "OpenImageIO": "py-openimageio"}
    for asked in PROJECT["dependencies"]:
        name, _, bound = asked.partition(">=")
        assert f"- {renamed.get(name, name)} >={bound}\n" in recipe, asked
    assert f'python_min: "{PROJECT["requires-python"].removeprefix(">=")}"\n' in recipe


@pytest.mark.slow
def test_the_recipe_is_valid():
    """By conda's own builder, without asking a channel."""
    builder = pytest.importorskip("rattler_build", reason='needs the extra "dev"')
    recipe = builder.Stage0Recipe.from_file(ROOT / "recipe" / "recipe.yaml")
    (variant,) = recipe.render()
    assert variant.recipe.package.name == PROJECT["name"]
