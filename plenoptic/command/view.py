"""Open a raw image or a light field in the browser, to move about in."""

from __future__ import annotations

import argparse
import tempfile
import webbrowser
from pathlib import Path

from plenoptic.command.open_file import exposure_of, open_file
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
    from plenoptic.lightfield.views import LightField

    if options.output is not None:  # before minutes are spent
        check_folder(real_path(options.output))
        if Path(options.output).suffix.lower() not in (".html", ".htm"):
            raise FileError(f"--output is {options.output!r}; it must end in .html")
    file = open_file(options.file)
    content = file.content if isinstance(file.content, LightField) else exposure_of(file)
    if content is None:
        raise FileError(f"{options.file!r} is {file.kind}; give an image, a package or a light field to look at")
    if options.output is None:
        page = Path(tempfile.mkdtemp(prefix="plenoptic-"), f"{Path(options.file).stem}.html")
    else:
        page = Path(options.output)
    content.save_html(page)
    print(page)
    if not options.no_browser and not webbrowser.open(page.resolve().as_uri()):
        raise FileError(f"no browser could be opened; open {str(page)!r} in one")
