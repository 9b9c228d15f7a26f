"""The package's own lens files: JSON with one element per line.

A file is an object with `format`, `name`, `source`, `iris` (index of the element that is the iris), and `elements`.
Defaults are omitted: `front_medium`, `rear_medium`, `model`, `specification`, `conic`, `aspheric`, `depth`, `freeform`,
`coating`, `blade_radius` and `placement` are optional. Stops are circle, polygon, star, mask or ring; the
`transmission` of a mask is a list of its rows. A medium is one of

    "air"
    "mirror"               reflecting surface; one that folds the axis is given by its fields
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
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from plenoptic.core.files.serialization import from_tree, to_tree
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
_MEDIA = ("front_medium", "rear_medium")
_VALUES = ("freeform", "coating")
"""Fields of a surface that are values of this package."""
_UNREADABLE = (FileError, ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RecursionError)
"""Errors of constructors, which validate all numbers of a file."""
_NAMED: dict[str, Medium] = {"air": AIR, "mirror": MIRROR}
_SHORT_FORMS: tuple[tuple[type[Medium], dict[str, str]], ...] = (
    (ConstantMedium, {"index": "refractive_index"}),
    (ModelGlass, {"name": "name", "nd": "nd", "vd": "vd"}),
    (Schott, {"name": "name", "schott": "coefficients", "wavelength_range": "wavelength_range"}),
)
"""Keys of media in a file, and their fields."""


def json_of_lens(lens: LensStack) -> str:
    """A lens as the text of a JSON file; floats are exact. A medium from outside this package is an error.

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
    for name in _MEDIA:
        if getattr(lens, name) != AIR:
            head[name] = _medium_to_json(getattr(lens, name), f"named as {name}")
    if lens.model is not LensModel.EXACT:
        head["model"] = lens.model.name
    if lens.specification is not None:
        head["specification"] = to_tree(lens.specification)
    rows = [json.dumps(_element_to_json(element, i)) for i, element in enumerate(lens.elements)]
    lines = [*(f"  {json.dumps(key)}: {json.dumps(item)}," for key, item in head.items()), '  "elements": [']
    return "\n".join(["{", *lines, ",\n".join(f"    {row}" for row in rows), "  ]", "}", ""])


def lens_from_json(text: str, where: str) -> LensStack:
    """Lens from the text of `json_of_lens`; errors name the file `where`, and the element or the entry."""
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise PrescriptionError(f"{where} is not JSON: {error}; correct it there") from None
    try:
        head = _fields(
            data, "the file", "format name source iris elements", f"{' '.join(_MEDIA)} ambient model specification"
        )
        both = head.get("ambient", "air")  # earlier versions had one medium on both sides
        if head["format"] != _FORMAT:
            raise PrescriptionError(f"format is {head['format']!r:.40}; it must be {_FORMAT!r}")
        for name, kind, expected in (("name", str, "text"), ("source", str, "text"), ("elements", list, "list")):
            if not isinstance(head[name], kind):
                raise PrescriptionError(f"{name} is {head[name]!r:.40}; it must be a {expected}")
        check_count(len(head["elements"]))
        return LensStack(
            [_element_from_json(row, i) for i, row in enumerate(head["elements"])],
            head["iris"],
            head["name"],
            head["source"],
            **{name: _medium_from_json(head.get(name, both)) for name in _MEDIA},
            model=_model(head.get("model", "EXACT")),
            specification=from_tree(head.get("specification")),
        )
    except _UNREADABLE as error:
        raise PrescriptionError(f"{where}: {error}") from None


def _fields(data: Any, name: str, wanted: str, allowed: str = "") -> Mapping[str, Any]:
    """Check that a JSON object has all `wanted` keys, and no others except those `allowed`."""
    keys, also = set(wanted.split()), set(allowed.split())
    if not isinstance(data, dict) or not keys <= set(data) <= keys | also:
        content = ", ".join(sorted(data)) if isinstance(data, dict) else f"{data!r:.40}"
        may = f" and may have {', '.join(sorted(also))}" if also else ""
        raise PrescriptionError(f"{name} has {content or 'nothing'}; it must have {', '.join(sorted(keys))}{may}")
    return data


def _medium_to_json(medium: Medium, where: str) -> Any:
    for name, constant in _NAMED.items():
        if medium == constant:
            return name
    for kind, keys in _SHORT_FORMS:
        if isinstance(medium, kind):
            return {key: getattr(medium, field) for key, field in keys.items()}
    if isinstance(medium, Sellmeier):
        formula = {"sellmeier": {"b": medium.b, "c": medium.c}}
        return {"name": medium.name, **formula, "wavelength_range": medium.wavelength_range}
    try:
        return to_tree(medium)
    except InvalidValueError:
        raise PrescriptionError(
            f"the medium {where} is {medium!r}, which a lens file cannot hold; "
            "use one of this package, such as ConstantMedium, ModelGlass, Sellmeier or Schott"
        ) from None


def _medium_from_json(data: Any) -> Medium:
    if isinstance(data, str) and data in _NAMED:
        return _NAMED[data]
    keys = set(data) if isinstance(data, dict) else set()
    for kind, fields in _SHORT_FORMS:
        if keys == set(fields):
            return kind(**{field: data[key] for key, field in fields.items()})
    if "sellmeier" in keys:
        glass = _fields(data, "medium", "name sellmeier wavelength_range")
        terms = _fields(glass["sellmeier"], "sellmeier", "b c")
        return Sellmeier(terms["b"], terms["c"], glass["name"], glass["wavelength_range"])
    if keys == {"value"}:
        medium = from_tree(data)
        if not isinstance(medium, Medium):
            raise PrescriptionError(f"medium is a {type(medium).__name__}; it must have a refractive index")
        return medium
    raise PrescriptionError(
        f'medium is {data!r:.40}; it must be "air" or "mirror", or have index, nd and vd, sellmeier, or schott'
    )


def _model(name: Any) -> LensModel:
    names = [model.name for model in LensModel]
    if name not in names:
        raise PrescriptionError(f"model is {name!r:.40}; it must be {' or '.join(names)}")
    return LensModel[name]


def _element_to_json(element: Element, i: int) -> dict[str, Any]:
    size = {"thickness": element.thickness, "semi_diameter": element.semi_diameter}
    row: dict[str, Any]
    if isinstance(element, Surface):
        radius = None if math.isinf(element.radius) else element.radius
        row = {"radius": radius, **size, "medium": _medium_to_json(element.medium, f"behind element {i}")}
        members = {name: getattr(element, name) for name in ("conic", "aspheric", "depth")}
        row |= {name: item for name, item in members.items() if item not in (0.0, (), None)}
        values = {name: getattr(element, name) for name in _VALUES}
        row |= {name: to_tree(item) for name, item in values.items() if item is not None}
    else:
        row = _stop_to_json(element, size)
    if element.placement is not None:
        shift, rotation = element.placement.shift, element.placement.rotation
        row["placement"] = {"shift": shift.tolist(), "rotation": rotation.tolist()}
    return row


def _own_fields(stop: type[Stop]) -> Iterator[dataclasses.Field[Any]]:
    """Fields of a stop that are not common to all stops."""
    common = ("thickness", "semi_diameter", "placement")
    return (field for field in dataclasses.fields(stop) if field.name not in common)


def _stop_to_json(stop: Stop, size: dict[str, float]) -> dict[str, Any]:
    name = next(name for name, kind in STOPS.items() if kind.stop is type(stop))
    row: dict[str, Any] = {"stop": name, **size}
    for field in _own_fields(type(stop)):
        content = getattr(stop, field.name)
        if isinstance(content, np.ndarray):
            # Cells of 0 and 1, as in most masks, take 3 characters each.
            content = [[int(cell) if cell in (0, 1) else cell for cell in line] for line in content.tolist()]
        if not (field.kw_only and content == field.default):
            row[field.name] = content
    return row


def _element_from_json(data: Any, i: int) -> Element:
    try:
        row = _element_fields(data)
        if "placement" in row:
            row["placement"] = Placement(**_fields(row["placement"], "placement", "shift rotation"))
        if "stop" in row:
            return STOPS[row.pop("stop")].stop(**row)
        row["radius"] = math.inf if row["radius"] is None else row["radius"]
        row["medium"] = _medium_from_json(row["medium"])
        row |= {name: from_tree(row[name]) for name in _VALUES if name in row}
        return Surface(**row)
    except _UNREADABLE as error:
        raise PrescriptionError(f"element {i}: {error}") from None


def _element_fields(data: Any) -> dict[str, Any]:
    """Copy of an element's JSON object, checked for the keys of its kind."""
    if not (isinstance(data, dict) and "stop" in data):
        keys = "radius thickness semi_diameter medium"
        if isinstance(data, dict) and "departure" in data:  # the former name
            data = {"freeform" if name == "departure" else name: field for name, field in data.items()}
        return dict(_fields(data, "it", keys, "conic aspheric depth freeform coating placement"))
    name = data["stop"]
    if not (isinstance(name, str) and name in STOPS):
        first, *middle, last = (f'"{kind}"' for kind in STOPS)
        raise PrescriptionError(f"stop is {name!r:.40}; it must be {', '.join([first, *middle])} or {last}")
    fields = list(_own_fields(STOPS[name].stop))
    required = " ".join(field.name for field in fields if not field.kw_only)
    optional = " ".join(field.name for field in fields if field.kw_only)
    return dict(_fields(data, "it", f"stop thickness semi_diameter {required}", f"placement {optional}"))
