"""Configurations of a Zemax file: operands behind MNUM that replace numbers of surfaces and of the system.

An operand names a surface (or a field, or 0), a configuration, and the value that holds there. THIC replaces DISZ,
CRVT CURV, CONN CONI, SDIA DIAM (and FLAP), GLSS GLAS, PRAM one of PARM, APER the size of the system aperture, XFIE and
YFIE a field. Solves and pickups follow them; see `zemax_solves`.
"""

from __future__ import annotations

from typing import NamedTuple

from plenoptic.core.files.text_lines import name_line_in_errors, parse_number
from plenoptic.core.values import whole
from plenoptic.errors import InvalidValueError, PrescriptionError
from plenoptic.optics.lens.files.zemax_solves import has_focus_solve, solve
from plenoptic.optics.lens.files.zemax_system import APERTURES, VIGNETTING_OPERANDS, Line

_OF_SURFACES = {"THIC": "DISZ", "CRVT": "CURV", "CONN": "CONI", "SDIA": "DIAM", "GLSS": "GLAS"}
_OF_FIELDS = {"XFIE": "XFLN", "YFIE": "YFLN"}


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
    unsolved = solve(blocks, fixed, where)
    if unsolved:
        ignored.append(f"solves (surfaces {', '.join(unsolved)} as in configuration {active})")
    is_focused = has_focus_solve(blocks) and (blocks[-2][0].word(0), "DISZ") not in fixed
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
    kept = old.words[1:] if old and keyword not in ("GLAS", "CURV") else []  # a solve of the curvature ends
    new = Line(operand.number, keyword, " ".join([value, *kept]))
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
