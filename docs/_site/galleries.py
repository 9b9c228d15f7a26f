"""Where sphinx-gallery finds the scripts: copies below build/, so that what they write stays there too."""

import shutil
from pathlib import Path

ROOT = Path(__file__).parents[2]
STAGED = ROOT / "build" / "examples"
FIRST = ("first_light.py", "data_set.py")

GALLERY = """Gallery
=======

Every example is a page to read, a script and a notebook to download. It writes its figures and data to
``output/`` and prints the numbers that they show, most of them beside what optics says.
"""

TUTORIALS = """Tutorials
=========

Each takes one kind of user from nothing to a result, as a page to read, a script and a notebook to download.
"""


def stage(name: str, source: Path, header: str) -> Path:
    """A folder of the scripts of `source`, and of what stands beside them."""
    folder = STAGED / name
    shutil.rmtree(folder, ignore_errors=True)
    if source.is_dir():
        shutil.copytree(
            source, folder, ignore=shutil.ignore_patterns("tutorials", "benchmark", "output", "__pycache__")
        )
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / "GALLERY_HEADER.rst").exists():
        (folder / "GALLERY_HEADER.rst").write_text(header, encoding="utf-8")
    return folder


def staged() -> dict[str, Path]:
    """Galleries by the folder of their pages."""
    examples = ROOT / "examples"
    return {
        "tutorials": stage("tutorials", examples / "tutorials", TUTORIALS),
        "gallery": stage("gallery", examples, GALLERY),
    }


def order(name: str) -> tuple[bool, str]:
    """What newcomers want first, first."""
    return Path(name).name not in FIRST, Path(name).name
