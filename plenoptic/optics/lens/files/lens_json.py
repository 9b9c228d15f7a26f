"""The package's own lens files: JSON with one element per line.

A file is an object with `format`, `name`, `source`, `iris` (index of the element that is the iris), and `elements`.
Defaults are left out, so `ambient`, `model`, `specification`, `conic`, `aspheric`, `depth`, `departure`,
`blade_radius` and `placement` stand only where they say something. Stops are circle, polygon, star, mask or ring; the
`transmission` of a mask is a list of its rows. A medium is one of

    "air"
    "mirror"                                       of a surface that reflects; one that folds the axis by its fields
    {"index": 1.5}
    {"name": "BAF10", "nd": 1.67, "vd": 47.1}
    {"name": "N-BK7", "sellmeier": {"b": [...], "c": [...]}, "wavelength_range": [300.0, 2500.0]}
    {"name": "BK7", "schott": [...], "wavelength_range": [365.0, 1014.0]}
    {"value": ["DispersionFormula", {...}]}       any other public medium, by its fields
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from plenoptic.core.files.serialization import describe, restore
from plenoptic.errors import FileError, InvalidValueError, PrescriptionError
from plenoptic.optics.glass.media import AIR, ConstantMedium, Medium, ModelGlass, Schott, Sellmeier
from plenoptic.optics.lens.elements import Element, check_count
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.placement import Placement
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.stops.stop_registry import STOPS, Stop
from plenoptic.optics.surfaces.mirror import MIRROR
from plenoptic.optics.surfaces.surface import Surface

_FORMAT = "plenoptic-lens-1"


def json_of_lens(lens: LensStack) -> str:
    """A lens as the text of a JSON file; floats keep every bit. An error where a medium is none of this package's.

    Examples
    --------
    >>> import plenoptic as pl
    >>> from plenoptic.optics.lens.files.lens_json import json_of_lens
    >>> print(json_of_lens(pl.LensStack([pl.CircularStop(5.0), pl.Surface(20.0, semi_diameter=6.0)], name="nothing")))
    {
      "format": "plenoptic-lens-1",
      "name": "nothing",
      "source": "",
      "iris": 0,
      "elements": [
        {"stop": "circle", "thickness": 0.0, "semi_diameter": 5.0},
        {"radius": 20.0, "thickness": 0.0, "semi_diameter": 6.0, "medium": "air"}
      ]
    }
    <BLANKLINE>
    """
    head: dict[str, Any] = {"format": _FORMAT, "name": lens.name, "source": lens.source, "iris": lens.iris_index}
    if lens.ambient != AIR:
        head["ambient"] = _medium_to_json(lens.ambient, "around the lens")
    if lens.model is not LensModel.EXACT:
        head["model"] = lens.model.name
    if lens.specification is not None:
        head["specification"] = json.loads(describe(lens.specification))
    rows = [json.dumps(_element_to_json(element, i)) for i, element in enumerate(lens.elements)]
    lines = [*(f"  {json.dumps(key)}: {json.dumps(item)}," for key, item in head.items()), '  "elements": [']
    return "\n".join(["{", *lines, ",\n".join(f"    {row}" for row in rows), "  ]", "}", ""])


def lens_from_json(text: str, where: str) -> LensStack:
    """The lens that `json_of_lens` wrote down; errors name the file `where`, and the element or the entry."""
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise PrescriptionError(f"{where} is not JSON: {error}; correct it there") from None
    try:
        head = _fields(data, "the file", "format name source iris elements", "ambient model specification")
        if head["format"] != _FORMAT:
            raise PrescriptionError(f"format is {head['format']!r:.40}; it must be {_FORMAT!r}")
        rows, elements = _list(head["elements"], "elements"), []
        check_count(len(rows))
        for i, row in enumerate(rows):
            try:
                elements.append(_element_from_json(row))
            except InvalidValueError as error:
                raise PrescriptionError(f"element {i}: {error}") from None
        return LensStack(
            elements,
            head["iris"],
            _text(head["name"], "name"),
            _text(head["source"], "source"),
            ambient=_medium_from_json(head.get("ambient", "air")),
            model=_model(head.get("model", "EXACT")),
            specification=_value(head.get("specification"), "specification"),
        )
    except (InvalidValueError, RecursionError) as error:
        raise PrescriptionError(f"{where}: {error}") from None


# ---- what is checked of JSON ----


def _number(data: Any, name: str) -> float:
    if isinstance(data, bool) or not isinstance(data, int | float):
        raise PrescriptionError(f"{name} is {data!r:.40}; it must be a number")
    try:
        return float(data)
    except OverflowError:
        raise PrescriptionError(f"{name} is too large for a number; correct it") from None


def _list(data: Any, name: str, of: str = "") -> list[Any]:
    if not isinstance(data, list):
        raise PrescriptionError(f"{name} is {data!r:.40}; it must be a list{of}")
    return data


def _numbers(data: Any, name: str) -> tuple[float, ...]:
    return tuple(_number(item, name) for item in _list(data, name, " of numbers"))


def _rows(data: Any, name: str) -> list[tuple[float, ...]]:
    return [_numbers(row, name) for row in _list(data, name, " of lists of numbers")]


def _text(data: Any, name: str) -> str:
    if not isinstance(data, str):
        raise PrescriptionError(f"{name} is {data!r:.40}; it must be a text")
    return data


def _fields(data: Any, name: str, wanted: str, allowed: str = "") -> Mapping[str, Any]:
    keys, also = set(wanted.split()), set(allowed.split())
    if not isinstance(data, dict) or not keys <= set(data) <= keys | also:
        content = ", ".join(sorted(data)) if isinstance(data, dict) else f"{data!r:.40}"
        may = f" and may have {', '.join(sorted(also))}" if also else ""
        raise PrescriptionError(f"{name} has {content or 'nothing'}; it must have {', '.join(sorted(keys))}{may}")
    return data


# ---- media ----

_NAMED: dict[str, Medium] = {"air": AIR, "mirror": MIRROR}


def _medium_to_json(medium: Medium, where: str) -> Any:
    for name, constant in _NAMED.items():
        if medium == constant:
            return name
    if isinstance(medium, ConstantMedium):
        return {"index": medium.refractive_index}
    if isinstance(medium, ModelGlass):
        return {"name": medium.name, "nd": medium.nd, "vd": medium.vd}
    if isinstance(medium, Sellmeier):
        formula = {"sellmeier": {"b": medium.b, "c": medium.c}}
        return {"name": medium.name, **formula, "wavelength_range": medium.wavelength_range}
    if isinstance(medium, Schott):
        return {"name": medium.name, "schott": medium.coefficients, "wavelength_range": medium.wavelength_range}
    try:
        return json.loads(describe(medium))
    except InvalidValueError:
        raise PrescriptionError(
            f"the medium {where} is {medium!r}, which has no place in a lens file; "
            "use one of this package, such as ConstantMedium, ModelGlass, Sellmeier or Schott"
        ) from None


def _medium_from_json(data: Any) -> Medium:
    if isinstance(data, str) and data in _NAMED:
        return _NAMED[data]
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
        coefficients, limits = _numbers(glass["schott"], "schott"), _pair(glass["wavelength_range"])
        return Schott(coefficients, _text(glass["name"], "name"), limits)
    if "nd" in kinds:
        glass = _fields(data, "medium", "name nd vd")
        return ModelGlass(_number(glass["nd"], "nd"), _number(glass["vd"], "vd"), _text(glass["name"], "name"))
    if kinds == {"value"}:
        medium = _value(data, "medium")
        if not isinstance(medium, Medium):
            raise PrescriptionError(f"medium is a {type(medium).__name__}; it must have a refractive index")
        return medium
    raise PrescriptionError(
        f'medium is {data!r:.40}; it must be "air" or "mirror", or have index, nd and vd, sellmeier, or schott'
    )


def _value(data: Any, name: str) -> Any:
    """Any public value of the package."""
    try:
        return restore(json.dumps(data))
    except (FileError, ArithmeticError, IndexError) as error:
        raise PrescriptionError(f"{name}: {error}") from None


def _pair(data: Any) -> tuple[float, float]:
    limits = _numbers(data, "wavelength_range")
    if len(limits) != 2:
        raise PrescriptionError(f"wavelength_range has {len(limits)} numbers; it must have 2")
    return limits[0], limits[1]


def _model(data: Any) -> LensModel:
    names = [model.name for model in LensModel]
    if data not in names:
        raise PrescriptionError(f"model is {data!r:.40}; it must be {' or '.join(names)}")
    return LensModel[data]


def _placement(data: Any, name: str) -> Placement:
    fields = _fields(data, name, "shift rotation")
    return Placement(_numbers(fields["shift"], "shift"), _rows(fields["rotation"], "rotation"))


# ---- elements ----

_SIZE = ("thickness", "semi_diameter")
_OF_ALL = (*_SIZE, "placement")
_READERS: dict[str, Callable[[Any, str], Any]] = {"float": _number, "int": lambda data, name: data, "ArrayLike": _rows}
"""How the fields of a stop are read, by their types."""
_OPTIONAL: dict[str, Callable[[Any, str], Any]] = {
    "conic": _number,
    "aspheric": _numbers,
    "depth": _number,
    "departure": _value,
    "placement": _placement,
}
"""Fields of a surface that may be left out, and how they are read."""


def _element_to_json(element: Element, i: int) -> dict[str, Any]:
    size = {"thickness": element.thickness, "semi_diameter": element.semi_diameter}
    row: dict[str, Any]
    if isinstance(element, Surface):
        radius = None if math.isinf(element.radius) else element.radius
        row = {"radius": radius, **size, "medium": _medium_to_json(element.medium, f"behind element {i}")}
        members = {name: getattr(element, name) for name in ("conic", "aspheric", "depth")}
        row |= {name: item for name, item in members.items() if item not in (0.0, (), None)}
        row |= {"departure": json.loads(describe(element.departure))} if element.departure is not None else {}
    else:
        row = _stop_to_json(element, size)
    if element.placement is not None:
        # frozen_array keeps both as arrays.
        shift, rotation = element.placement.shift, element.placement.rotation
        row["placement"] = {"shift": shift.tolist(), "rotation": rotation.tolist()}  # type: ignore[union-attr]
    return row


def _own_fields(stop: type[Stop]) -> Iterator[dataclasses.Field[Any]]:
    """The fields that not all stops have."""
    return (field for field in dataclasses.fields(stop) if field.name not in _OF_ALL)


def _stop_to_json(stop: Stop, size: dict[str, float]) -> dict[str, Any]:
    name = next(name for name, kind in STOPS.items() if isinstance(stop, kind))
    row: dict[str, Any] = {"stop": name, **size}
    for field in _own_fields(type(stop)):
        content = getattr(stop, field.name)
        if isinstance(content, np.ndarray):
            # Black and white, as most masks are, takes 3 letters a cell.
            content = [[int(cell) if cell in (0, 1) else cell for cell in line] for line in content.tolist()]
        if not (field.kw_only and content == field.default):
            row[field.name] = content
    return row


def _stop_from_json(data: Mapping[str, Any]) -> Stop:
    name = data["stop"]
    if not (isinstance(name, str) and name in STOPS):
        first, *middle, last = (f'"{kind}"' for kind in STOPS)
        raise PrescriptionError(f"stop is {name!r:.40}; it must be {', '.join([first, *middle])} or {last}")
    fields = {field.name: field for field in _own_fields(STOPS[name])}
    required = [name for name, field in fields.items() if not field.kw_only]
    row = _fields(
        data, "it", " ".join(["stop", *_SIZE, *required]), " ".join(["placement", *(set(fields) - set(required))])
    )
    arguments: dict[str, Any] = {name: _number(row[name], name) for name in _SIZE}
    arguments |= {name: _READERS[str(fields[name].type)](row[name], name) for name in fields if name in row}
    return STOPS[name](**arguments, placement=_placement(row["placement"], "placement") if "placement" in row else None)


def _element_from_json(data: Any) -> Element:
    if isinstance(data, dict) and "stop" in data:
        return _stop_from_json(data)
    row = _fields(data, "it", "radius thickness semi_diameter medium", " ".join(_OPTIONAL))
    radius = math.inf if row["radius"] is None else _number(row["radius"], "radius")
    thickness, semi_diameter = (_number(row[name], name) for name in _SIZE)
    options = {name: read(row[name], name) for name, read in _OPTIONAL.items() if name in row}
    return Surface(radius, thickness, _medium_from_json(row["medium"]), semi_diameter=semi_diameter, **options)
