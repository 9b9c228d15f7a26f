"""Lattices of micro images in files of other programs."""

from __future__ import annotations

import math
import os
from xml.etree import ElementTree

import numpy as np

from plenoptic.camera.points.micro_image_grid import MicroImageGrid
from plenoptic.core.files.atomic_file import translate_errors
from plenoptic.core.files.file_limits import TEXT, check_file
from plenoptic.core.values import checked_shape, file_path
from plenoptic.errors import FileError
from plenoptic.optics.microlens.lattice import Lattice

_TYPES = 3


def read_grid(path: str | os.PathLike[str], shape: tuple[int, int]) -> MicroImageGrid:
    """Read the lattice of micro images in RxLive's calibration file (XML), as the PlenopticToolbox 2.0 reads it.

    Parameters
    ----------
    path : path-like
        XML file of the form `RayCalibData`, as `pl.export.plenoptic_toolbox` writes it too.
    shape : (int, int)
        Rows and columns of the image, about whose middle the file counts.

    Returns
    -------
    MicroImageGrid
        Hexagonal. k counts along rows of lenses, l 60 degrees farther, both from the lens that the file calls central.
        There are three types, as the format has them, of which some may be alike.

    Raises
    ------
    FileError
        If the file is missing or damaged, or describes no lattice.

    References
    ----------
    L. Palmieri, R. Op het Veld, R. Koch, ICIP 2018, doi:10.1109/ICIP.2018.8451051.

    Examples
    --------
    >>> import pathlib, tempfile, numpy as np, plenoptic as pl
    >>> shot = pl.Exposure(np.ones((512, 512, 1)), camera=pl.camera.example_camera())
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pl.export.plenoptic_toolbox(folder, shot)
    ...     pl.calibration.read_grid(pathlib.Path(folder) / "shot.xml", shape=(512, 512))
    MicroImageGrid(HEXAGONAL, pitch 21.987 pixels along columns, rotation 0.00 degrees, 3 types, 512 x 512 pixels)
    """
    file, (rows, columns) = file_path(path), checked_shape(shape, ("rows", "columns"))
    check_file(file, TEXT)
    with translate_errors(file, "read"):
        content = file.read_bytes()
    try:
        if b"<!" in content.replace(b"<!--", b""):
            raise ValueError("it declares a document type, which these files do not have")
        root = ElementTree.fromstring(content)
        (x, y), along, across = (_pair(root, name) for name in ("offset", "lens_base_x", "lens_base_y"))
        diameter, rotation = (float(_text(root, name)) for name in ("diameter", "rotation"))
        types = sorted(int(lens.attrib["id"]) for lens in root.iterfind("lens_type"))
        if not (diameter > 0 and all(map(math.isfinite, (x, y, diameter, rotation, *along, *across)))):
            raise ValueError("its lenses have no size or no position")
        if types != list(range(_TYPES)):
            raise ValueError(f"it has the lens types {types}; the format has 0, 1 and 2")
    except (ElementTree.ParseError, ValueError, KeyError) as error:
        raise FileError(f"{str(file)!r} holds no lattice of micro images: {error}") from error
    # y goes up in the file, and rows down.
    turn = diameter * np.array([[-math.sin(rotation), math.cos(rotation)], [-math.cos(rotation), -math.sin(rotation)]])
    k, l = np.indices((_TYPES, _TYPES))
    return MicroImageGrid(
        Lattice.HEXAGONAL,
        origin=(0.5 * (rows - 1) - y, 0.5 * (columns - 1) + x),
        basis=np.array([along, across]) @ turn,
        shape=(rows, columns),
        type_pattern=(l - k) % _TYPES,
    )


def _text(element: ElementTree.Element, name: str) -> str:
    text = element.findtext(name)
    if text is None:
        raise ValueError(f"it has no {name}")
    return text


def _pair(root: ElementTree.Element, name: str) -> tuple[float, float]:
    return float(_text(root, f"{name}/x")), float(_text(root, f"{name}/y"))
