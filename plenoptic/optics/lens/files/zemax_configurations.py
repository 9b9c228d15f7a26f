"""Configurations of a Zemax file: operands behind MNUM that replace numbers of surfaces and of the system.

An operand names a surface (or a field, or 0), a configuration, and the value that holds there. THIC replaces DISZ,
CRVT CURV, CONN CONI, SDIA DIAM (and FLAP), GLSS GLAS, PRAM one of PARM, APER the size of the system aperture, XFIE and
YFIE a field.

Solves and pickups follow in configurations that were not active when the file was saved:

- PZUP i s o: the thickness is s times that of surface i, plus o. CURV c 4 i s: the curvature is s times that of surface
  i.
- TCOM i t: the thicknesses of surface i and of this one add up to t. TOLE i t: those of surface i to this one do.
- MAZH 0 0 on the last surface: the image lies in the paraxial focus.

TCOM and TOLE as OpticStudio 2023 writes them. PZUP, CURV and MAZH agree with the 33, 24 and 32 values of public files
(github.com/nzhagen/LensLibrary).
"""

from __future__ import annotations

from typing import NamedTuple

from plenoptic.core.files.text_lines import name_line_in_errors, parse_number
from plenoptic.core.values import whole
from plenoptic.errors import InvalidValueError, PrescriptionError
from plenoptic.optics.lens.files.zemax_system import APERTURES, VIGNETTING_OPERANDS, Line

_OF_SURFACES = {"THIC": "DISZ", "CRVT": "CURV", "CONN": "CONI", "SDIA": "DIAM", "GLSS": "GLAS"}
_OF_FIELDS = {"XFIE": "XFLN", "YFIE": "YFLN"}
_PICKUP = "4"
_NO_SOLVE = ("0", "1")
"""Kinds of CURV without a solve: fixed, and variable in optimizations."""
_THICKNESS = ("PZUP", "TCOM", "TOLE")
_UNSOLVED = ("MAZH", "EDGE", "CHZH")


class Configured(NamedTuple):
    """A file in one configuration."""

    head: list[Line]
    """Lines of the system."""
    blocks: list[list[Line]]
    """Lines of each surface."""
    left_out: list[str]
    is_focused: bool = False
    """True if the image lies in the paraxial focus, whatever the last gap."""


def with_configuration(head: list[Line], blocks: list[list[Line]], configuration: int | None, where: str) -> Configured:
    """The lines in a configuration. None is the one that was active when the file was saved: all lines stay."""
    at = next((i for i, line in enumerate(head) if line.keyword == "MNUM"), None)
    count = 1 if at is None else int(head[at].real(0))
    active = 1 if at is None else int(head[at].real(1, 1.0))
    if configuration is None:
        left_out = [f"all but one of {count} configurations (MNUM; choose by configuration=)"]
        return Configured(head, blocks, left_out[: count > 1])
    chosen = whole(configuration, "configuration", at_least=1)
    if chosen > count:
        raise InvalidValueError(f"configuration is {chosen}; {where} has {count} (MNUM)")
    head, blocks, unknown = list(head), [list(block) for block in blocks], dict[str, None]()
    of_number, fixed = {block[0].word(0): block for block in blocks}, set[tuple[str, str]]()
    for operand in head[len(head) if at is None else at + 1 :]:
        if len(operand.words) < 3 or not operand.words[0].isdecimal() or operand.word(1) != str(chosen):
            continue
        number, _, value = operand.words[:3]
        with name_line_in_errors(where, operand.number):
            if operand.keyword in (*_OF_SURFACES, "PRAM"):
                if number not in of_number:
                    raise PrescriptionError(f"{operand.keyword} is of surface {number}, which is not in the file")
                keyword = f"PARM {operand.word(4)}" if operand.keyword == "PRAM" else _OF_SURFACES[operand.keyword]
                _replace_in_surface(of_number[number], operand, keyword, value.strip('"'))
                fixed.add((number, keyword))
            elif operand.keyword in _OF_FIELDS or operand.keyword == "APER":
                _replace_in_system(head, operand, int(number), value)
            elif operand.keyword not in ("MOFF", "LTTL") and not _is_zero(operand.keyword, value):
                unknown[operand.keyword] = None
    ignored = [f"configuration data of other kinds ({', '.join(unknown)})"] if unknown else []
    if chosen == active:
        return Configured(head, blocks, ignored)
    unsolved = _solve(blocks, fixed, where)
    if unsolved:
        ignored.append(f"solves (surfaces {', '.join(unsolved)} as in configuration {active})")
    is_focused = _has_focus_solve(blocks) and (blocks[-2][0].word(0), "DISZ") not in fixed
    return Configured(head, blocks, ignored, is_focused)


def _is_zero(keyword: str, value: str) -> bool:
    """True for vignetting factors of 0."""
    return keyword in VIGNETTING_OPERANDS and parse_number(value, keyword) == 0


def _replace_in_surface(block: list[Line], operand: Line, keyword: str, value: str) -> None:
    """Replace the line of a keyword in a surface's block; a glass without a name is air."""
    if keyword.startswith("PARM"):
        keyword, entry = keyword.split()
        block[:] = [line for line in block if line.keyword != keyword or line.word(0) != entry]
        block.append(Line(operand.number, keyword, f"{entry} {value}"))
        return
    old = next((line for line in block if line.keyword == keyword), None)
    parameters = old.words[1:] if old and keyword not in ("GLAS", "CURV") else []  # a solve of the curvature ends
    new = Line(operand.number, keyword, " ".join([value, *parameters]))
    block[:] = [line for line in block if line.keyword != keyword]
    if value:
        block.append(new)
    if keyword == "DIAM":
        # A floating aperture is as large as the surface.
        block[:] = [line._replace(rest=f"0 {value} 0") if line.keyword == "FLAP" else line for line in block]


def _replace_in_system(head: list[Line], operand: Line, number: int, value: str) -> None:
    keywords = APERTURES if operand.keyword == "APER" else (_OF_FIELDS[operand.keyword],)
    entry = 0 if operand.keyword == "APER" else number - 1
    parse_number(value, operand.keyword)
    for i, line in enumerate(head):
        if line.keyword in keywords and 0 <= entry < len(line.words):
            words = [*line.words[:entry], value, *line.words[entry + 1 :]]
            head[i] = Line(operand.number, line.keyword, " ".join(words))


def _solve(blocks: list[list[Line]], fixed: set[tuple[str, str]], where: str) -> list[str]:
    """Set the solved numbers in the blocks of the surfaces, in their order, and return the numbers of surfaces with
    solves that are not computed. `fixed` has the (number, keyword) that the configuration states itself.
    """
    unsolved = []
    for block in blocks:
        number, is_focused = block[0].word(0), block is blocks[-2] and _has_focus_solve(blocks)
        for i, line in enumerate(block):
            with name_line_in_errors(where, line.number):
                if line.keyword in _THICKNESS and (number, "DISZ") not in fixed:
                    _set(block, "DISZ", _thickness(blocks, number, line))
                elif line.keyword == "CURV" and (number, "CURV") not in fixed and line.words[1:2] == [_PICKUP]:
                    curvature = line.real(3) * _value(blocks, _source(line, 2, number), "CURV")
                    block[i] = Line(line.number, "CURV", repr(curvature))
                elif line.keyword == "CURV":
                    unsolved += [number] * (line.words[1:2] != [] and line.words[1] not in _NO_SOLVE)
                elif line.keyword in _UNSOLVED and (number, "DISZ") not in fixed and not is_focused:
                    unsolved.append(number)
    return unsolved


def _has_focus_solve(blocks: list[list[Line]]) -> bool:
    """True if the last gap ends in the paraxial focus, in air."""
    last = blocks[-2]
    solves = [line.words[:2] for line in last if line.keyword == "MAZH"]
    return solves == [["0", "0"]] and not any(line.keyword == "GLAS" and line.rest != "MIRROR" for line in last)


def _thickness(blocks: list[list[Line]], number: str, line: Line) -> float:
    source = _source(line, 0, number)
    if line.keyword == "PZUP":
        return line.real(1) * _value(blocks, source, "DISZ") + line.real(2, 0.0)
    between = range(source, int(number) if line.keyword == "TOLE" else source + 1)
    return line.real(1) - sum(_value(blocks, i, "DISZ") for i in between)


def _source(line: Line, i: int, number: str) -> int:
    """Number of the surface that a solve refers to; it precedes the solved one."""
    source = line.real(i)
    if not (source.is_integer() and 0 <= source < int(number)):
        raise PrescriptionError(f"{line.keyword} of surface {number} refers to {source:g}; it must be a surface before")
    return int(source)


def _value(blocks: list[list[Line]], number: int, keyword: str) -> float:
    block = next(block for block in blocks if block[0].word(0) == str(number))
    return next((parse_number(line.word(0), keyword) for line in block if line.keyword == keyword), 0.0)


def _set(block: list[Line], keyword: str, value: float) -> None:
    at = next((i for i, line in enumerate(block) if line.keyword == keyword), len(block))
    block[at : at + 1] = [Line(block[0].number, keyword, repr(value))]
