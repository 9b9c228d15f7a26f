"""Solves and pickups of a Zemax file in a configuration that was not active when the file was saved.

- PZUP i s o: the thickness is s times that of surface i, plus o. CURV c 4 i s: the curvature is s times that of surface
  i.
- TCOM i t: the thicknesses of surface i and of this one add up to t. TOLE i t: those of surface i to this one do.
- MAZH 0 0 on the last surface: the image lies in the paraxial focus; see `has_focus_solve`.

TCOM and TOLE as OpticStudio 2023 writes them. PZUP, CURV and MAZH agree with the 33, 24 and 32 values of public files
(github.com/nzhagen/LensLibrary).
"""

from __future__ import annotations

from plenoptic.core.files.text_lines import name_line_in_errors, parse_number
from plenoptic.errors import PrescriptionError
from plenoptic.optics.lens.files.zemax_system import Line

_PICKUP = "4"
_NO_SOLVE = ("0", "1")
"""Kinds of CURV without a solve: fixed, and variable in optimizations."""
_THICKNESS = ("PZUP", "TCOM", "TOLE")
_UNSOLVED = ("MAZH", "EDGE", "CHZH")


def solve(blocks: list[list[Line]], fixed: set[tuple[str, str]], where: str) -> list[str]:
    """Set the solved numbers in the blocks of the surfaces, in their order, and return the numbers of surfaces with
    solves that are not computed. `fixed` has the (number, keyword) that the configuration states itself.
    """
    unsolved = []
    for block in blocks:
        number, is_focused = block[0].word(0), block is blocks[-2] and has_focus_solve(blocks)
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


def has_focus_solve(blocks: list[list[Line]]) -> bool:
    """True if the last gap ends in the paraxial focus, in the medium around the lens."""
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
