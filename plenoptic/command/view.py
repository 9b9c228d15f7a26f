"""Open a raw image or a light field in the browser, to move about in."""

from __future__ import annotations

import argparse
import tempfile
import webbrowser
from pathlib import Path
from typing import Any

from plenoptic.command.files import exposure_of, opened
from plenoptic.core.files.atomic_file import check_folder, real_path
from plenoptic.errors import FileError


def fill_parser(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    text = "image (EXR, TIFF, PNG, zarr), package (folder, zip) or folder of a light field"
    parser.add_argument("file", metavar="FILE", help=text)
    parser.add_argument("--output", metavar="HTML", help="the file to write; otherwise one in a temporary folder")
    parser.add_argument("--no-browser", action="store_true", help="write the file only, and print its name")


def run(options: argparse.Namespace) -> None:
    """Write the page and open it."""
    chosen = None if options.output is None else _page_path(options.output)  # before minutes are spent
    seen = _viewable(options.file)
    target = (
        Path(tempfile.mkdtemp(prefix="plenoptic-"), f"{Path(options.file).stem}.html") if chosen is None else chosen
    )
    seen.save_html(target)
    print(target)
    if not options.no_browser and not webbrowser.open(target.resolve().as_uri()):
        raise FileError(f"no browser could be opened; open {str(target)!r} in one")


def _page_path(output: str) -> Path:
    """Path of the page, or an error."""
    check_folder(real_path(output))
    if Path(output).suffix.lower() not in (".html", ".htm"):
        raise FileError(f"--output is {output!r}; it must end in .html")
    return Path(output)


def _viewable(name: str) -> Any:
    """The exposure or light field of a file."""
    from plenoptic.lightfield.views import LightField

    found = opened(name)
    content = found.content if isinstance(found.content, LightField) else exposure_of(found)
    if content is None:
        raise FileError(f"{name!r} is {found.kind}; give an image, a package or a light field to look at")
    return content
