"""Pictures for other programs, and the files beside them."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic import __version__
from plenoptic.core.files.atomic_file import translate_errors, write_file
from plenoptic.core.files.codes import COLOR_SPACE, codes
from plenoptic.core.files.images import LINEAR, SRGB, write_codes
from plenoptic.core.values import file_path
from plenoptic.errors import FileError, InvalidValueError


def folder_at(path: str | os.PathLike[str], *below: str) -> Path:
    """A folder, made if it is missing, with folders below it."""
    folder = file_path(path)
    with translate_errors(folder, "made"):
        for part in (folder, *(folder / name for name in below)):
            part.mkdir(exist_ok=True)
    if not folder.is_dir():
        raise FileError(f"{str(folder)!r} is no folder; choose another name")
    return folder


def check_no_others(folder: Path, pattern: str, names: Collection[str]) -> None:
    """Raise an error if a folder holds files that match a pattern and are not among the files to be written."""
    old = sorted(path.name for path in folder.glob(pattern) if path.name not in names)
    if old:
        raise FileError(
            f"the folder {str(folder)!r} holds {len(old)} views of another light field, such as {old[0]}; choose "
            "a new one, or delete them"
        )


def plain_name(name: str) -> str:
    """A name that files can have in all programs, or an error."""
    if not isinstance(name, str) or not name.replace("_", "").replace("-", "").isalnum() or not name.isascii():
        raise InvalidValueError(f"name is {name!r}; it must be of letters, digits, - and _")
    return name


def write_picture(
    path: Path, image: NDArray[np.floating[Any]], *, scale: float, bits: int = 16, encoded: bool = False
) -> None:
    """A linear image (H, W, C), divided by `scale`, as RGB codes: encoded as sRGB or linear."""
    encoded_pixels = codes(image, scale=scale, encoded=encoded, bits=bits)
    rgb = np.repeat(encoded_pixels, 3, axis=2) if encoded_pixels.shape[2] == 1 else encoded_pixels
    write_codes(path, rgb, {COLOR_SPACE: SRGB if encoded else LINEAR})


def write_readme(folder: Path, program: str, how: str, cannot: str, more: Mapping[str, Any] | None = None) -> None:
    """Write instructions for starting the program, with the limits of its knowledge."""
    lines = [f"For {program}, by plenoptic {__version__}.", "", how, "", f"What it cannot express: {cannot}"]
    lines += [f"{name}: {text}" for name, text in (more or {}).items()]
    write_file(folder / "README.txt", ("\n".join(lines) + "\n").encode("utf-8"))
