"""Lens files: the bundled lenses, this package's own JSON format, and tables as comma separated values."""

from __future__ import annotations

import dataclasses
import difflib
import importlib.resources
import json
import math
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from plenoptic.errors import FileError, InvalidValueError, PrescriptionError
from plenoptic.optics.lens import Element, LensStack
from plenoptic.optics.media import AIR, D_LINE, ConstantMedium, Medium, ModelGlass, Schott, Sellmeier
from plenoptic.optics.stops import CircularStop, PolygonStop
from plenoptic.optics.surface import Surface

_FORMAT = "plenoptic-lens-1"
_CSV_HEADER = ["radius", "thickness", "material", "index", "v-no", "sa"]
_ENDINGS = ".csv and .json"


def lens_names() -> tuple[str, ...]:
    """Names of the lenses that come with the package, in alphabetical order, for `load_lens`.

    Examples
    --------
    >>> import plenoptic as pl
    >>> "double-gauss-100mm-f2" in pl.lens_names()
    True
    """
    folder = importlib.resources.files("plenoptic.optics") / "data"
    return tuple(sorted(file.name.removesuffix(".json") for file in folder.iterdir() if file.name.endswith(".json")))


def load_lens(name_or_path: str | os.PathLike[str]) -> LensStack:
    """A lens that comes with the package, or one from a file.

    A table (`.csv`) has the columns `radius;thickness;material;index;v-no;sa`, mm, one row per element from the scene
    to the sensor. An empty radius is a plane, and a plane with air on both sides is a stop: the first is the iris. A
    row with index and V-number is a `ModelGlass`, one with an index only a `ConstantMedium`; the thickness of the last
    row, the distance to the image, is not part of the lens.

    A table that does not mark its stop gets one by a rule, which is not the designer's choice and is named in
    `source`: a round stop in the middle of the longest air gap between two surfaces (of a lens without one: at its
    first vertex), as large as the widest paraxial beam on the axis that passes all surfaces, from infinity, or from the
    front focus where the rear focus does not lie behind the lens, as in a microscope objective.

    Parameters
    ----------
    name_or_path : str or path-like
        One of `lens_names()`, or a path that ends in `.csv` or `.json` (the format that `save_lens` writes).

    Returns
    -------
    LensStack

    Raises
    ------
    FileError
        If there is no such lens or file, it cannot be read, or its ending is unknown.
    PrescriptionError
        If what stands in the file is no lens; the message names the file and the line or element.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.load_lens("double-gauss-100mm-f2")
    <LensStack 'double-gauss-100mm-f2': 10 surfaces, 1 stop, 64.08 mm long>
    """
    name = os.fspath(name_or_path)
    if isinstance(name_or_path, str) and name in lens_names():
        bundled = importlib.resources.files("plenoptic.optics") / "data" / f"{name}.json"
        return _from_json(bundled.read_text(encoding="utf-8"), f"{name}.json")
    path = Path(name)
    ending = path.suffix.lower()
    if ending not in (".csv", ".json"):
        if not isinstance(name_or_path, str) or path.parent != Path() or path.is_file():
            raise FileError(f"{name} ends in {ending!r}; the lens files that can be read are {_ENDINGS}")
        close = difflib.get_close_matches(name, lens_names(), n=3, cutoff=0.4) or lens_names()
        raise FileError(
            f"there is no lens {name!r}; pl.lens_names() lists them, among them {', '.join(close)}; "
            f"or give the path of a file ({_ENDINGS})"
        )
    text = _read(path)
    return _from_csv(text, path) if ending == ".csv" else _from_json(text, path.name)


def save_lens(lens: LensStack, path: str | os.PathLike[str]) -> None:
    """Write a lens as JSON, one element per line; `load_lens` gives back an equal one, to the last bit.

    Parameters
    ----------
    lens : LensStack
        Its media must be of this package: constant, model glass, Sellmeier or Schott.
    path : str or path-like
        Must end in `.json`. A file of that name is replaced.

    Raises
    ------
    PrescriptionError
        If a medium has no place in the format.
    FileError
        If the path has another ending or cannot be written.

    Examples
    --------
    >>> import plenoptic as pl
    >>> import tempfile, pathlib
    >>> lens = pl.load_lens("double-gauss-100mm-f2")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pl.save_lens(lens, pathlib.Path(folder) / "mine.json")
    ...     pl.load_lens(pathlib.Path(folder) / "mine.json") == lens
    True
    """
    target = Path(path)
    if target.suffix.lower() != ".json":
        raise FileError(f"{target} ends in {target.suffix!r}; lenses are saved as .json: give it that ending")
    head = {"format": _FORMAT, "name": lens.name, "source": lens.source, "iris": lens.iris_index}
    rows = [json.dumps(_element_to_json(element, i)) for i, element in enumerate(lens.elements)]
    lines = [*(f"  {json.dumps(key)}: {json.dumps(item)}," for key, item in head.items()), '  "elements": [']
    text = "\n".join(["{", *lines, ",\n".join(f"    {row}" for row in rows), "  ]", "}", ""])
    try:
        target.write_text(text, encoding="utf-8")
    except (OSError, ValueError) as error:
        raise FileError(f"cannot write {target}: {error}; choose a place that can be written") from None


def _read(path: Path) -> str:
    try:
        return path.read_bytes().decode("utf-8-sig")
    except (OSError, ValueError) as error:
        raise FileError(f"cannot read {path}: {error}; give the path of a UTF-8 text file") from None


# ---- JSON ----


def _medium_to_json(medium: Medium, element: int) -> Any:
    if medium == AIR:
        return "air"
    if isinstance(medium, ConstantMedium):
        return {"index": medium.refractive_index}
    if isinstance(medium, ModelGlass):
        return {"name": medium.name, "nd": medium.nd, "vd": medium.vd}
    if isinstance(medium, Sellmeier):
        formula = {"sellmeier": {"b": medium.b, "c": medium.c}}
        return {"name": medium.name, **formula, "wavelength_range": medium.wavelength_range}
    if isinstance(medium, Schott):
        return {"name": medium.name, "schott": medium.coefficients, "wavelength_range": medium.wavelength_range}
    raise PrescriptionError(
        f"the medium behind element {element} is {medium!r}, which has no place in a lens file; "
        "use ConstantMedium, ModelGlass, Sellmeier or Schott"
    )


def _element_to_json(element: Element, i: int) -> dict[str, Any]:
    if isinstance(element, Surface):
        radius = None if math.isinf(element.radius) else element.radius
        size = {"thickness": element.thickness, "semi_diameter": element.semi_diameter}
        return {"radius": radius, **size, "medium": _medium_to_json(element.medium, i)}
    if isinstance(element, CircularStop):
        return {"stop": "circle", "thickness": element.thickness, "semi_diameter": element.semi_diameter}
    shape = {"stop": "polygon", "thickness": element.thickness, "semi_diameter": element.semi_diameter}
    return {**shape, "blades": element.blades, "rotation": element.rotation}


def _number(data: Any, name: str) -> float:
    if isinstance(data, bool) or not isinstance(data, int | float):
        raise PrescriptionError(f"{name} is {data!r:.40}; it must be a number")
    try:
        return float(data)
    except OverflowError:
        raise PrescriptionError(f"{name} is too large for a number; correct it") from None


def _numbers(data: Any, name: str) -> tuple[float, ...]:
    if not isinstance(data, list):
        raise PrescriptionError(f"{name} is {data!r:.40}; it must be a list of numbers")
    return tuple(_number(item, name) for item in data)


def _text(data: Any, name: str) -> str:
    if not isinstance(data, str):
        raise PrescriptionError(f"{name} is {data!r:.40}; it must be a text")
    return data


def _fields(data: Any, name: str, wanted: str) -> Mapping[str, Any]:
    keys = set(wanted.split())
    if not isinstance(data, dict) or set(data) != keys:
        found = ", ".join(sorted(data)) if isinstance(data, dict) else f"{data!r:.40}"
        raise PrescriptionError(f"{name} has {found or 'nothing'}; it must have {', '.join(sorted(keys))}")
    return data


def _medium_from_json(data: Any) -> Medium:
    if data == "air":
        return AIR
    kinds = set(data) if isinstance(data, dict) else set()
    if "index" in kinds:
        return ConstantMedium(_number(_fields(data, "medium", "index")["index"], "index"))
    if "sellmeier" in kinds:
        glass = _fields(data, "medium", "name sellmeier wavelength_range")
        terms = _fields(glass["sellmeier"], "sellmeier", "b c")
        limits = _pair(glass["wavelength_range"])
        return Sellmeier(_numbers(terms["b"], "b"), _numbers(terms["c"], "c"), _text(glass["name"], "name"), limits)
    if "schott" in kinds:
        glass = _fields(data, "medium", "name schott wavelength_range")
        return Schott(
            _numbers(glass["schott"], "schott"), _text(glass["name"], "name"), _pair(glass["wavelength_range"])
        )
    if "nd" in kinds:
        glass = _fields(data, "medium", "name nd vd")
        return ModelGlass(_number(glass["nd"], "nd"), _number(glass["vd"], "vd"), _text(glass["name"], "name"))
    raise PrescriptionError(f'medium is {data!r:.40}; it must be "air" or have index, nd and vd, sellmeier, or schott')


def _pair(data: Any) -> tuple[float, float]:
    limits = _numbers(data, "wavelength_range")
    if len(limits) != 2:
        raise PrescriptionError(f"wavelength_range has {len(limits)} numbers; it must have 2")
    return limits[0], limits[1]


def _element_from_json(data: Any) -> Element:
    kind = data.get("stop") if isinstance(data, dict) else None
    wanted = {"circle": "stop thickness semi_diameter", "polygon": "stop thickness semi_diameter blades rotation"}
    if isinstance(data, dict) and "stop" in data and not (isinstance(kind, str) and kind in wanted):
        raise PrescriptionError(f'stop is {kind!r:.40}; it must be "circle" or "polygon"')
    row = _fields(data, "it", wanted[kind] if isinstance(kind, str) else "radius thickness semi_diameter medium")
    thickness = _number(row["thickness"], "thickness")
    semi_diameter = _number(row["semi_diameter"], "semi_diameter")
    if kind == "circle":
        return CircularStop(semi_diameter, thickness)
    if kind == "polygon":
        return PolygonStop(row["blades"], semi_diameter, _number(row["rotation"], "rotation"), thickness)
    radius = math.inf if row["radius"] is None else _number(row["radius"], "radius")
    return Surface(radius, thickness, _medium_from_json(row["medium"]), semi_diameter=semi_diameter)


def _from_json(text: str, where: str) -> LensStack:
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise PrescriptionError(f"{where} is not JSON: {error}; correct it there") from None
    try:
        head = _fields(data, "the file", "format name source iris elements")
        if head["format"] != _FORMAT:
            raise PrescriptionError(f"format is {head['format']!r:.40}; it must be {_FORMAT!r}")
        if not isinstance(head["elements"], list):
            raise PrescriptionError(f"elements is {head['elements']!r:.40}; it must be a list")
        elements = []
        for i, row in enumerate(head["elements"]):
            try:
                elements.append(_element_from_json(row))
            except InvalidValueError as error:
                raise PrescriptionError(f"element {i}: {error}") from None
        return LensStack(elements, head["iris"], _text(head["name"], "name"), _text(head["source"], "source"))
    except (InvalidValueError, RecursionError) as error:
        raise PrescriptionError(f"{where}: {error}") from None


# ---- tables ----


def _cell(text: str, name: str) -> float:
    # Stricter than float(): no nan, no underscores, no decimal comma.
    if not re.fullmatch(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?", text):
        raise PrescriptionError(f"{name} is {text[:40]!r}; it must be a number with a decimal point")
    return float(text)


def _medium_from_cells(material: str, index: str, abbe: str) -> Medium:
    if material.lower() == "air":
        if index or abbe:
            raise PrescriptionError(f"air has index {index[:40]!r} and V-number {abbe[:40]!r}; leave both empty")
        return AIR
    if not index:
        raise PrescriptionError(f"material {material[:40]!r} has no index; give it, or write air")
    number = _cell(index, "index")
    return ModelGlass(number, _cell(abbe, "v-no"), material) if abbe else ConstantMedium(number)


def _element_from_cells(line: str, *, before: Medium, last: bool) -> Element:
    cells = [cell.strip() for cell in line.split(";")]
    if len(cells) != len(_CSV_HEADER):
        raise PrescriptionError(f"there are {len(cells)} cells; there must be {len(_CSV_HEADER)}, with ; between them")
    radius, thickness, material, index, abbe, semi_diameter = cells
    gap = _cell(thickness, "thickness")
    medium = _medium_from_cells(material, index, abbe)
    if last and medium != AIR:
        raise PrescriptionError(f"the last material is {material[:40]!r}; the sensor is in air: it must be air")
    size, gap = _cell(semi_diameter, "sa"), 0.0 if last else gap
    if not radius and before == medium == AIR:
        return CircularStop(size, gap)
    return Surface(_cell(radius, "radius") if radius else math.inf, gap, medium, semi_diameter=size)


def _from_csv(text: str, path: Path) -> LensStack:
    rows = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    header = [cell.strip().lower() for cell in rows[0][1].split(";")] if rows else []
    if header != _CSV_HEADER:
        first = rows[0][0] if rows else 1
        raise PrescriptionError(f"{path.name}, line {first}: the first line must be {';'.join(_CSV_HEADER)}")
    elements: list[Element] = []
    before: Medium = AIR
    for number, line in rows[1:]:
        try:
            element = _element_from_cells(line, before=before, last=number == rows[-1][0])
        except InvalidValueError as error:
            raise PrescriptionError(f"{path.name}, line {number}: {error}") from None
        before = element.medium if isinstance(element, Surface) else before
        elements.append(element)
    surfaces = [element for element in elements if isinstance(element, Surface)]
    try:
        if surfaces and len(surfaces) == len(elements):
            return LensStack(_with_inferred_stop(surfaces), None, path.stem, f"{path.name}; stop placed by rule")
        return LensStack(elements, None, path.stem, path.name)
    except InvalidValueError as error:
        raise PrescriptionError(f"{path.name}, line {rows[-1][0]}: {error}") from None


def _axial_heights(surfaces: list[Surface]) -> list[float]:
    """Heights at the surfaces of a paraxial axial ray: from infinity, or from the front focus if no image is behind."""
    # Two basis rays at once, (height, angle) = (1, 0) and (0, 1).
    height, angle, index = np.array([1.0, 0.0]), np.array([0.0, 1.0]), 1.0
    heights = []
    for surface in surfaces:
        heights.append(height)
        behind = surface.medium.index(D_LINE)
        angle = angle + (index - behind) * surface.curvature * height
        height, index = height + angle * (surface.thickness / behind), behind
    has_real_image = angle[0] == 0 or -height[0] / angle[0] > 0
    start = np.array([1.0, 0.0]) if has_real_image else np.array([angle[1], -angle[0]])
    return [abs(float(start @ pair)) for pair in heights]


def _with_inferred_stop(surfaces: list[Surface]) -> list[Element]:
    """A stop in the middle of the longest air gap, as wide as the widest axial beam; the rule is in `load_lens`."""
    with np.errstate(all="ignore"):  # what overflows ends as a stop that is refused
        heights = _axial_heights(surfaces)
    # A surface that the ray crosses on the axis limits nothing.
    limits = [s.semi_diameter / height for s, height in zip(surfaces, heights, strict=True) if height > 0]
    beam = min(limits, default=math.nan)
    gaps = [surface.thickness if surface.medium == AIR else -1.0 for surface in surfaces[:-1]]
    longest = max(gaps, default=-1.0)
    if longest < 0:
        return [CircularStop(beam * heights[0], 0.0), *surfaces]
    i = gaps.index(longest)
    in_front = dataclasses.replace(surfaces[i], thickness=longest / 2)
    stop = CircularStop(beam * (heights[i] + heights[i + 1]) / 2, longest / 2)
    return [*surfaces[:i], in_front, stop, *surfaces[i + 1 :]]
