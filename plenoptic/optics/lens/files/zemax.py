"""Reader of sequential Zemax files (.zmx).

Text in UTF-16 with byte order mark, UTF-8 or Latin-1. Surface 0 is the object and the last one the image. Neither is
part of the lens, nor are the gaps next to them. A file that begins with SURF 1 has an object at infinity, which is its
first surface if the gap behind it is. A glass on the object is the medium around the lens. A glass before the image is
glued to the sensor: a last surface without refraction of positions, from glass to air, lies in the image.

- TYPE STANDARD, EVENASPH, ODDASPHE, XASPHERE, XOSPHERE and SZERNSAG, with CURV, CONI, PARM 1 to 8 (r^2 to r^16; r to
  r^8 of ODDASPHE), DISZ and GLAS; lengths are converted from UNIT to mm. SZERNSAG adds Noll's Zernike terms, of mean
  square 1 over the disc of the norm radius. XDAT 1 is their number, XDAT 2 the norm radius, XDAT 3, 4, ... the terms.
  Their sag at the vertex moves the surface.
- XASPHERE, XOSPHERE: XDAT 1 terms of (r / XDAT 2)^(2 i) or (r / XDAT 2)^i, XDAT 3, 4, ...; an XASPHERE without XDAT
  is an EVENASPH. Odd powers of r become an `OddPowerSag`; a term of r itself, a cone, is refused.
- TYPE BICONICX: CURV and CONI along y, PARM 1 the radius along x (0: flat) and PARM 2 the conic constant along x.
- All other types are refused, and so are tilted surfaces (SCBD), and apertures and obscurations that are not round.
- COORDBRK gives the elements that follow a `Placement`. Mirrors (GLAS MIRROR) are unfolded: plane ones are removed,
  curved ones reflect (`Mirror`). See `zemax_folds`.
- Solves and pickups have their values in the file. Of several configurations, the one active on saving is read, or the
  one that the caller chooses; see `zemax_configurations`.
- GLAS: a name is looked up in the catalogue of the caller, then in the bundled ones, those named by the file (GCAT)
  first. ___BLANK, and any name whose second entry is 1, is a model glass of n_d and V_d; V_d = 0 means no dispersion,
  and the deviation of the partial dispersion is ignored. Six digits, 517642, are n_d 1.517 and V_d 64.2. A surface at
  which the index of model glasses changes its sign is a mirror.
- The system aperture determines the size of the stop by the paraxial marginal ray. It is the entrance pupil diameter
  (ENPD), the f-number (FNUM; second number 1: working f-number) or the numerical aperture in object space (OBNA; with a
  1, half the cone angle in degrees). An aperture of the stop limits its size. If the system aperture floats by the stop
  (FLOA) or is missing, the size is DIAM, or the aperture of the surface if smaller. See `StopSize`.
- Semi-diameters: the radius of a round aperture (CLAP, FLAP) if there is one, otherwise DIAM; for the stop's surface at
  least that of the stop. If DIAM is 0 or missing, the semi-diameter is the largest height of real rays of all fields
  (XFLN, YFLN) through the rim of the paraxial entrance pupil, and at least the sum of the paraxial heights of the
  marginal ray and of the largest field's chief ray; the radius of a sphere is the limit.
- An obscuration (inner radius of CLAP or FLAP, disc of OBSC) is a `RingStop` in the plane of the vertex, in front of
  the surface.
- STOP on a surface between equal media is the iris. On a refracting surface it becomes a stop of the same size in the
  plane of the vertex, in front of it.
- Other surfaces between equal media are removed, and their gaps are added to the preceding one. Those with an aperture
  stay, planes as stops other than the iris.
- NAME and NOTE are read. The lens's `Specification` holds fields (of FTYP 0 to 3, real image heights as paraxial ones)
  and wavelengths (WAVM, WAVL, PWAV). It also holds the positions of object and image, and the curvature of the image.
- Ignored, with a warning if they are set: vignetting factors, temperature and pressure (ENVD), coatings (COAT), further
  configurations (MNUM), telecentric object space, fields of other types, other shapes of the image. All other lines are
  ignored without a warning.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

import numpy as np

from plenoptic.core.files.text_lines import name_line_in_errors, parse_number
from plenoptic.core.warn import warn
from plenoptic.errors import FileWarning, PrescriptionError
from plenoptic.optics.glass.catalogue import GlassCatalogue
from plenoptic.optics.glass.media import Medium
from plenoptic.optics.lens.elements import check_count
from plenoptic.optics.lens.files.glass_names import GlassNames, model_medium
from plenoptic.optics.lens.files.zemax_configurations import with_configuration
from plenoptic.optics.lens.files.zemax_folds import has_folds, unfold, with_mirrors_of_negative_index
from plenoptic.optics.lens.files.zemax_stack import Row, lens_of_rows
from plenoptic.optics.lens.files.zemax_system import KEYWORDS, Line, read_system
from plenoptic.optics.lens.specification import StopSize
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.surfaces.freeform_bounds import ZemaxNumbers
from plenoptic.optics.surfaces.freeform_registry import ZEMAX
from plenoptic.optics.surfaces.odd_powers import OddPowerSag

_UNITS = {"MM": 1.0, "CM": 10.0, "IN": 25.4, "M": 1000.0, "METER": 1000.0, "METERS": 1000.0}
_TERMS = 8
_BREAK = "COORDBRK"
_EXTENDED = {"XASPHERE": 2, "XOSPHERE": 1}
"""Types with XDAT: step of the powers of r from term to term."""
_ODD = "ODDASPHE"
"""The type whose PARM 1, 2, ... are of r, r^2, ...; those of other types are of r^2, r^4, ..."""
_MAX_TERMS = 240
_REFUSED = {
    **dict.fromkeys(("SQOB", "ELOB", "USOB"), "obscurations that are not round"),
    **dict.fromkeys(("USAP", "UDAD"), "user-defined apertures"),
    "SPID": "spiders",
    "SQAP": "rectangular apertures",
    "ELAP": "elliptical apertures",
}


def lens_from_zmx(
    text: str,
    where: str,
    *,
    glasses: Mapping[str, Medium] | GlassCatalogue | None = None,
    stop_size: StopSize = StopSize.SYSTEM_APERTURE,
    configuration: int | None = None,
) -> LensStack:
    """Lens from the text of a Zemax file. `where` names the file in messages, and the lens if it has no NAME; `glasses`
    are looked up first.
    """
    head, blocks, left_out, is_focused = with_configuration(*_blocks(text, where), configuration, where)
    unit = 1.0
    for line in head:
        with name_line_in_errors(where, line.number):
            if line.keyword == "MODE" and line.word(0).upper() != "SEQ":
                raise PrescriptionError(f"MODE is {line.word(0)[:40]!r}; only sequential files, MODE SEQ, can be read")
            if line.keyword == "UNIT":
                name = line.word(0)
                if name.upper() not in _UNITS:
                    raise PrescriptionError(f"UNIT is {name[:40]!r}; it must be one of {', '.join(_UNITS)}")
                unit = _UNITS[name.upper()]
    media = GlassNames.of(glasses, [maker for line in head if line.keyword == "GCAT" for maker in line.words])
    left_out += _ignored_data(blocks)
    blocks[-1] = [line for line in blocks[-1] if line.keyword in ("SURF", "STOP", "CURV", "DIAM")]
    rows, turned = with_mirrors_of_negative_index([_row(block, where, unit, media) for block in blocks], where), False
    if has_folds(rows):
        rows, turned = unfold(rows, where)
    names = [line.rest for line in head if line.keyword == "NAME" and line.rest]
    notes = [line.rest.partition(" ")[2].strip() for line in head if line.keyword == "NOTE"]
    source = "; ".join([where, *filter(None, notes)])
    system = read_system(head, where, unit)._replace(is_focused=is_focused)
    lens = lens_of_rows(rows, system, where, (names or [where.rpartition(".")[0]])[0], source, stop_size=stop_size)
    left_out = [*system.left_out, *left_out, *(["tilt and decentre of the image (COORDBRK)"] * turned)]
    if len(system.fields) and lens.specification is not None and not len(lens.specification.fields):
        left_out.append(f"fields of type {system.field_type} (FTYP)")
    if left_out:
        warn(f"{where}: left out are {', '.join(left_out)}; see lens.specification for the rest", FileWarning)
    return lens


def _ignored_data(blocks: list[list[Line]]) -> list[str]:
    """Properties of surfaces that are ignored."""
    coated = [str(i) for i, block in enumerate(blocks) for line in block if line.keyword == "COAT" and line.rest]
    ignored = [f"coatings (COAT of surface{'s' * (len(coated) > 1)} {', '.join(coated)})"] if coated else []
    shape = [line for line in blocks[-1] if (line.keyword, line.rest.upper()) != ("TYPE", "STANDARD")]
    if any(line.keyword in ("TYPE", "CONI", "PARM", "XDAT") for line in shape):
        ignored.append("the shape of the image but for its curvature")
    return ignored


def _blocks(text: str, where: str) -> tuple[list[Line], list[list[Line]]]:
    """The lines that belong to the whole system, and those of each surface."""
    head: list[Line] = []
    blocks: list[list[Line]] = []
    is_behind = False
    for number, line in enumerate(re.split(r"\r\n|\r|\n", text), start=1):
        keyword, *operands = line.split(None, 1) or [""]
        entry = Line(number, keyword.upper(), operands[0].strip() if operands else "")
        if entry.keyword == "SURF":
            with name_line_in_errors(where, number):
                due = int(blocks[-1][0].word(0)) + 1 if blocks else min(1, int(entry.word(0) == "1"))
                if entry.word(0) != str(due):
                    raise PrescriptionError(f"SURF is {entry.word(0)[:40]!r}; the next surface has number {due}")
                check_count(len(blocks))
            blocks.append([entry])
            is_behind = False
        elif entry.keyword:
            # Behind MNUM stand configurations, which belong to no surface.
            is_behind = is_behind or entry.keyword == "MNUM"
            (blocks[-1] if blocks and not is_behind and entry.keyword not in KEYWORDS else head).append(entry)
    if blocks and blocks[0][0].word(0) == "1" and not any(_is_endless(line) for line in blocks[0]):
        number = blocks[0][0].number
        blocks.insert(0, [Line(number, "SURF", "0"), Line(number, "DISZ", "INFINITY")])
    if len(blocks) < 3:
        line_number = blocks[-1][0].number if blocks else 1
        raise PrescriptionError(
            f"{where}, line {line_number}: there are {len(blocks)} surfaces (SURF); a Zemax file has at least three, "
            "the object, one of the lens, and the image"
        )
    return head, blocks


def _is_endless(line: Line) -> bool:
    return line.keyword == "DISZ" and line.rest.upper().startswith("INFINITY")


def _medium(line: Line, glasses: GlassNames) -> Medium:
    """The medium of a GLAS line."""
    if _is_model(line):
        # The sign of the index is that of the direction; see `with_mirrors_of_negative_index`.
        return model_medium(abs(line.real(3)), line.real(4, 0.0))
    return glasses.medium(line.word(0))


def _is_model(line: Line) -> bool:
    """True if a GLAS line states n_d and V_d, whatever its name."""
    return line.word(0).upper() == "___BLANK" or line.words[1:2] == ["1"]


def _row(block: list[Line], where: str, unit: float, glasses: GlassNames) -> Row:
    row = Row(number := int(block[0].word(0)), {line.keyword: line.number for line in block})
    kind, parameters, extra = "STANDARD", dict[int, float](), dict[int, float]()
    # TYPE first: it defines the meaning of PARM and XDAT.
    for line in sorted(block, key=lambda line: line.keyword != "TYPE"):
        with name_line_in_errors(where, line.number):
            if line.keyword == "TYPE":
                kind = _type(line, number)
            elif line.keyword == "PARM" and kind != "STANDARD":
                _set_parameter(parameters, line, kind)
            elif line.keyword == "XDAT" and kind in (*ZEMAX, *_EXTENDED):
                extra[int(line.real(0))] = line.real(1)
            else:
                row = _with_line(row, line, unit, glasses)
    if kind == _BREAK:
        decentre = (parameters.get(i, 0.0) * unit for i in (1, 2))
        return row._replace(turn=(*decentre, *(parameters.get(i, 0.0) for i in (3, 4, 5, 6))))
    if kind in ZEMAX:
        shape = ZemaxNumbers(row.curvature, row.conic, parameters, extra, unit)
        with name_line_in_errors(where, row.lines.get("XDAT", row.lines["SURF"])):
            freeform, offset = ZEMAX[kind].read(shape)
        row = row._replace(freeform=freeform, offset=offset)
        if ZEMAX[kind].is_whole:
            return row._replace(curvature=0.0, conic=0.0)
    with name_line_in_errors(where, row.lines.get("XDAT" if extra else "PARM", row.lines["SURF"])):
        aspheric, odd = _even_and_odd_powers(kind, parameters, extra, unit)
    return row._replace(aspheric=aspheric, freeform=row.freeform if odd is None else odd)


def _even_and_odd_powers(
    kind: str, parameters: Mapping[int, float], extra: Mapping[int, float], unit: float
) -> tuple[tuple[float, ...], OddPowerSag | None]:
    """Coefficients of r^2, r^4, ..., and the term of r^3, r^5, ..., of a surface with PARM and XDAT in units of the
    file, of `unit` mm.
    """
    if kind in _EXTENDED and extra.get(1, 0.0) != 0:
        step, terms, keyword, first = _EXTENDED[kind], _extended_terms(extra, kind), "XDAT", 3
    elif kind == "XOSPHERE" and any(parameters.values()):
        raise PrescriptionError("PARM of an XOSPHERE is not read; give its XDAT")
    else:
        step, terms, keyword, first = 1 if kind == _ODD else 2, dict(parameters), "PARM", 1
    # z and r have the same scale: a coefficient of r^p is in unit^(1 - p).
    of_power = {step * i: term * unit ** (1 - step * i) for i, term in terms.items() if term != 0}
    if 1 in of_power:
        raise PrescriptionError(
            f"{kind} has a term of r ({keyword} {first}), a cone, which has no normal at its vertex; only powers from "
            "r^2 on can be read: set it to 0"
        )
    last = max(of_power, default=0)
    odd = [of_power.get(p, 0.0) for p in range(3, last + 1, 2)]
    even = tuple(of_power.get(p, 0.0) for p in range(2, last + 1, 2))
    return even, OddPowerSag(odd) if any(odd) else None


@np.errstate(all="ignore")
def _extended_terms(extra: Mapping[int, float], kind: str) -> dict[int, float]:
    """Coefficients of the terms of an extended asphere by their number, in units of the file."""
    count, norm = extra[1], extra.get(2, 0.0)
    if not (count.is_integer() and 0 < count <= _MAX_TERMS and norm > 0 and count + 2 in extra):
        raise PrescriptionError(
            f"{kind} has {count:g} terms (XDAT 1), norm radius {norm:g} (XDAT 2) and XDAT up to {max(extra)}; it must "
            f"have 1 to {_MAX_TERMS} terms, a radius above 0, and all terms from XDAT 3 on"
        )
    powers = np.float64(norm) ** (_EXTENDED[kind] * np.arange(int(count) + 1))  # may overflow: refused by the surface
    return {i: float(a / powers[i]) for i in range(1, int(count) + 1) if (a := extra.get(i + 2, 0.0)) != 0}


def _type(line: Line, number: int) -> str:
    kind = line.word(0).upper()
    types = ("STANDARD", "EVENASPH", _ODD, _BREAK, *_EXTENDED, *ZEMAX)
    if kind not in types:
        raise PrescriptionError(
            f"surface {number} is of type {kind[:40]}; the surfaces that can be read are {', '.join(types)}"
        )
    return kind


def _set_parameter(parameters: dict[int, float], line: Line, kind: str) -> None:
    i, number = line.real(0), line.real(1)
    count = ZEMAX[kind].n_parameters if kind in ZEMAX else _TERMS
    if kind == _BREAK or i in range(1, count + 1):
        parameters[int(i)] = number
    elif number != 0:
        statement = f"PARM {line.word(0)[:40]} is {number:g}"
        raise PrescriptionError(f"{statement}; only PARM 1 to {count} of {kind} surfaces are read: set it to 0")


def _with_line(row: Row, line: Line, unit: float, glasses: GlassNames) -> Row:
    match line.keyword:
        case "CURV":
            return row._replace(curvature=line.real(0) / unit)
        case "CONI":
            return row._replace(conic=line.real(0))
        case "DISZ":
            endless = line.word(0).upper() == "INFINITY"
            return row._replace(gap=math.inf if endless else line.real(0) * unit)
        case "GLAS" if line.word(0).upper() == "MIRROR":
            return row._replace(is_mirror=True)
        case "GLAS":
            is_negative = _is_model(line) and line.real(3) < 0
            return row._replace(medium=_medium(line, glasses), is_negative=is_negative)
        case "DIAM":
            return row._replace(diameter=line.real(0) * unit)
        case "CLAP" | "FLAP":
            inner, outer = line.real(0), line.real(1)
            if inner > 0 and not inner < outer:
                raise PrescriptionError(f"{line.keyword} passes light from {inner:g} to {outer:g}, an empty range")
            return row._replace(obscured=max(row.obscured, inner * unit), aperture=outer * unit)
        case "OBSC":
            if line.real(0) != 0:
                raise PrescriptionError(
                    f"OBSC blocks light from {line.word(0)} to {line.word(1)} and none nearer to the axis; only discs "
                    "around the axis can be read: set the first number to 0, or remove the line"
                )
            return row._replace(obscured=max(row.obscured, line.real(1) * unit))
        case "STOP":
            return row._replace(is_stop=True)
        case "OBDC" if any(parse_number(word, "OBDC") != 0 for word in line.words[:2]):
            raise PrescriptionError("the aperture is decentred; only centred apertures can be read: leave it out")
        case "SCBD" if any(re.fullmatch(r".*[1-9].*", word) for word in line.words[2:]):
            raise PrescriptionError("the surface is decentred or tilted; read it centred and use lens.moved()")
        case refused if refused in _REFUSED:
            raise PrescriptionError(
                f"{refused}: {_REFUSED[refused]} cannot be read, and without them more light would pass; "
                "remove the line if this is acceptable"
            )
    return row
