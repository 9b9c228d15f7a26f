"""Lattices of micro images in files of other programs."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree

import numpy as np

from plenoptic.camera.points.micro_image_grid import MicroImageGrid
from plenoptic.core.files.atomic_file import write_file, write_json
from plenoptic.core.files.file_limits import TEXT, content_errors, read_file
from plenoptic.core.values import check_kind, checked_shape, file_path
from plenoptic.errors import InvalidValueError
from plenoptic.optics.microlens.lattice import Lattice

_TYPES, _ALIKE_TYPE = 3, "alike"
"""Types of the XML format, and an attribute of ours, which other programs ignore: the number of a type of the same
lenses."""
VIRTUAL_DEPTHS = 2.0, 20.0
"""Range of virtual depth of a microlens type, if the camera is not known."""
_ALIKE, _SHEARED = 1e-3, 0.2
"""Relative difference of spacings below which a lattice is square, and largest shear of all rows in spacings."""


def read_grid(path: str | os.PathLike[str], shape: tuple[int, int]) -> MicroImageGrid:
    """Read the lattice of micro images in RxLive's calibration file (XML) or a grid model of the Light Field Toolbox.

    Parameters
    ----------
    path : path-like
        XML file of the form `RayCalibData`, as the PlenopticToolbox 2.0 reads and `pl.export.plenoptic_toolbox` writes
        it, or JSON file with `LensletGridModel`, such as `MOD_0001.grid.json` and `CalInfo.json`.
    shape : (int, int)
        Rows and columns of the image.

    Returns
    -------
    MicroImageGrid
        Of XML files hexagonal, with three types, or fewer if `write_grid` had fewer. Of grid models with one type; the
        micro image (0, 0) is the first of the first row.

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
    MicroImageGrid(HEXAGONAL, pitch 21.987 pixels along columns, rotation 0.00 degrees, 512 x 512 pixels)
    """
    file, (rows, columns) = file_path(path), checked_shape(shape, ("rows", "columns"))
    content = read_file(file, TEXT)
    with content_errors(file, "holds no lattice of micro images"):
        read = _toolbox_grid if content.lstrip()[:1] == b"{" else _rxlive_grid
        return read(content, (rows, columns))


def _rxlive_grid(content: bytes, shape: tuple[int, int]) -> MicroImageGrid:
    if b"<!" in content.replace(b"<!--", b""):
        raise ValueError("it declares a document type, which these files do not have")
    root = ElementTree.fromstring(content)
    (x, y), along, across = (_pair(root, name) for name in ("offset", "lens_base_x", "lens_base_y"))
    diameter, rotation = (float(_text(root, name)) for name in ("diameter", "rotation"))
    lenses = [(int(lens.attrib["id"]), lens.attrib.get(_ALIKE_TYPE)) for lens in root.iterfind("lens_type")]
    types = sorted(k for k, _ in lenses)
    if not (diameter > 0 and all(map(math.isfinite, (x, y, diameter, rotation, *along, *across)))):
        raise ValueError("its lenses have no size or no position")
    if types != list(range(_TYPES)):
        raise ValueError(f"it has the lens types {types}; the format has 0, 1 and 2")
    # y goes up in the file, and rows down.
    turn = diameter * np.array([[-math.sin(rotation), math.cos(rotation)], [-math.cos(rotation), -math.sin(rotation)]])
    k, l = np.indices((_TYPES, _TYPES))
    _, kinds = np.unique([k if first is None else int(first) for k, first in sorted(lenses)], return_inverse=True)
    return MicroImageGrid(
        Lattice.HEXAGONAL,
        origin=(0.5 * (shape[0] - 1) - y, 0.5 * (shape[1] - 1) + x),
        basis=np.array([along, across]) @ turn,
        shape=shape,
        type_pattern=kinds[(l - k) % _TYPES],
    )


def _toolbox_grid(content: bytes, shape: tuple[int, int]) -> MicroImageGrid:
    model: Any = json.loads(content)["LensletGridModel"]
    h, v, x, y, angle, shifted, lines = (
        float(model[name]) for name in ("HSpacing", "VSpacing", "HOffset", "VOffset", "Rot", "FirstPosShiftRow", "VMax")
    )
    is_hexagonal = shifted <= lines
    lattice = Lattice.SQUARE if math.isclose(h, v, rel_tol=_ALIKE) else Lattice.RECTANGULAR
    # As x, y: from a lens to the next one of its row, and half a step farther in the next row.
    turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    right, below = np.array([[h, 0.0], [0.5 * h * is_hexagonal, v]]) @ turn
    place = np.array([x, y]) - 1.0 + 0.5 * right * (shifted == 1)
    if model["Orientation"] == "horz":  # rows and columns are y and x, otherwise x and y
        right, below, place = (-right[::-1], (below - right * is_hexagonal)[::-1], place[::-1])
    return MicroImageGrid(
        Lattice.HEXAGONAL if is_hexagonal else lattice, origin=place, basis=np.array([right, below]), shape=shape
    )


def write_grid(path: str | os.PathLike[str], grid: MicroImageGrid) -> None:
    """Write the lattice of micro images for the PlenopticToolbox 2.0 (.xml) or the Light Field Toolbox (.json).

    Parameters
    ----------
    path : path-like
        Such as `shot.xml` beside `shot.png`, or `white.grid.json`.
    grid : MicroImageGrid

    Raises
    ------
    InvalidValueError
        If the format has no such lattice, or the name no such ending.
    FileError
        If the file cannot be written.

    Notes
    -----
    Smooth deviations and measured centres are left out. XML has hexagonal lattices with up to three types that
    alternate along rows; their ranges of virtual depth, which a white image does not tell, are 2 to 20. JSON is
    `LensletGridModel` with the first micro image at the upper left; it knows no types. `read_grid` reads both.

    Examples
    --------
    >>> import pathlib, tempfile, plenoptic as pl
    >>> grid = pl.calibration.MicroImageGrid(
    ...     pl.Lattice.HEXAGONAL, origin=(80.0, 100.0), basis=[(0.0, -20.0), (17.32, -10.0)], shape=(160, 200)
    ... )
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "white.grid.json"
    ...     pl.calibration.write_grid(path, grid)
    ...     pl.calibration.read_grid(path, shape=(160, 200)).pitch == grid.pitch
    True
    """
    file = file_path(path)
    check_kind(grid, "grid", MicroImageGrid, "pl.calibration.find_micro_images(white)")
    if file.suffix == ".json":
        write_json(file, {"LensletGridModel": toolbox_model(grid)})
    elif file.suffix == ".xml":
        write_file(file, rxlive_text(grid)[0].encode("ascii"))
    else:
        raise InvalidValueError(f"path is {str(file)!r}; its name must end in .xml or .json")


def rxlive_text(grid: MicroImageGrid, ranges: Sequence[tuple[float, float]] | None = None) -> tuple[str, list[int]]:
    """Calibration file of RxLive, and the type of the grid for each of its three.

    `ranges` are those of virtual depth of the grid's types.
    """
    if grid.lattice is not Lattice.HEXAGONAL:
        raise InvalidValueError(f"the lattice is {grid.lattice.name}; the PlenopticToolbox knows hexagonal arrays only")
    # Steps as x + i y, y up, the first of which is nearest to the right.
    sixth = np.array([[0, 1], [-1, 1]])
    turns = [np.linalg.matrix_power(sixth, k) for k in range(6)]
    turn = min(turns, key=lambda turn: abs(np.angle((turn @ grid.basis @ (-1j, 1.0))[0])))
    steps = turn @ grid.basis @ (-1j, 1.0)
    middle = 0.5 * (np.array(grid.shape) - 1.0)
    index = grid.indices_of(middle)
    offset = complex((grid.origin + index @ grid.basis - middle) @ (-1j, 1.0))
    number = np.array(list(np.ndindex(*np.multiply(_TYPES, grid.type_pattern.shape))))
    kinds, classes = grid.types_of(index + number @ turn), (number[:, 1] - number[:, 0]) % _TYPES
    types = [np.unique(kinds[classes == k]).tolist() for k in range(_TYPES)]
    if any(len(each) > 1 for each in types):
        raise InvalidValueError(
            "the focal types do not repeat every three lenses of a row, each beside both others; the format has no "
            "other pattern"
        )
    diameter, rotation, across = float(abs(steps[0])), float(np.angle(steps[0])), complex(steps[1] / steps[0])
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<RayCalibData version="1.0">',
        f'  <offset units="pix"><x>{offset.real!r}</x><y>{offset.imag!r}</y></offset>',
        f'  <diameter units="pix">{diameter!r}</diameter>',
        f'  <rotation units="rad">{rotation!r}</rotation>',
        '  <lens_border units="pix">0.0</lens_border>',
        '  <tcp units="virtual_depth">0.0</tcp>',
        '  <lens_base_x units="lens"><x>1.0</x><y>0.0</y></lens_base_x>',
        f'  <lens_base_y units="lens"><x>{across.real!r}</x><y>{across.imag!r}</y></lens_base_y>',
        f'  <sub_grid_base units="lens"><x>3.0</x><y>{math.sqrt(3.0)!r}</y></sub_grid_base>',
        '  <distortion type="radial"><function>constant</function><parameter count="0"></parameter>'
        '<offset units="pix"><x>0.0</x><y>0.0</y></offset></distortion>',
    ]
    for k, (x, (kind,)) in enumerate(zip((0.0, 1.0, -1.0), types, strict=True)):
        nearest, farthest = VIRTUAL_DEPTHS if ranges is None else ranges[kind]
        first = types.index([kind])
        attribute = f' {_ALIKE_TYPE}="{first}"' if first < k else ""
        lines += [
            f'  <lens_type id="{k}"{attribute}>',
            f'    <offset units="lens"><x>{x}</x><y>0.0</y></offset>',
            f'    <depth_range units="virtual_depth"><min>{nearest!r}</min><max>{farthest!r}</max></depth_range>',
            "  </lens_type>",
        ]
    return "\n".join([*lines, "</RayCalibData>", ""]), [kind for (kind,) in types]


def toolbox_model(grid: MicroImageGrid) -> dict[str, Any]:
    """`LensletGridModel`; see `pl.export.lftoolbox`."""
    is_hexagonal, order = grid.lattice is Lattice.HEXAGONAL, -1 if grid.is_along_rows else 1
    # x + i y of the image, or of the transposed one, where rows of lenses run along x.
    steps, origin = grid.basis[:, ::order] @ (1.0, 1j), complex(*grid.origin[::order])
    wide, high = grid.shape[::order]
    candidates = [steps[0], steps[1], *([steps[1] - steps[0]] * is_hexagonal)]
    right = max((s * sign for s in candidates for sign in (1, -1)), key=lambda step: step.real / abs(step))
    below = max((s * sign for s in candidates for sign in (1, -1)), key=lambda step: (step / right).imag)
    along = right / abs(right)
    down = (below / along).imag
    if abs(abs((below / right).real) - 0.5 * is_hexagonal) * high / down > _SHEARED:
        raise InvalidValueError("the lattice is sheared, which the grid model of this program cannot express")
    first = (origin + 1.0 + 1j) / along
    line = math.floor(first.imag / down)
    place = (first.real - 0.5 * abs(right) * is_hexagonal * line) % abs(right)
    is_shifted = is_hexagonal and place >= 0.5 * abs(right)
    offset = along * complex(place - 0.5 * abs(right) * is_shifted, first.imag - line * down)
    lines = math.floor((high - offset.imag) / down) + 1
    return {
        "HSpacing": float(abs(right)),
        "VSpacing": float(down),
        "HOffset": float(offset.real),
        "VOffset": float(offset.imag),
        "Rot": float(np.angle(right)),
        "Orientation": "horz" if order == -1 else "vert",
        "FirstPosShiftRow": (1 if is_shifted else 2) if is_hexagonal else lines + 1,
        "UMax": math.floor((wide - offset.real) / abs(right)) + 1,
        "VMax": lines,
    }


def _text(element: ElementTree.Element, name: str) -> str:
    text = element.findtext(name)
    if text is None:
        raise ValueError(f"it has no {name}")
    return text


def _pair(root: ElementTree.Element, name: str) -> tuple[float, float]:
    return float(_text(root, f"{name}/x")), float(_text(root, f"{name}/y"))
