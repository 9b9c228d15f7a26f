"""Configurations of a Zemax file: operands behind MNUM that replace numbers of surfaces and of the system.

An operand names a surface (or a field, or 0), a configuration, and the value that holds there. THIC replaces DISZ,
CRVT CURV, CONN CONI, SDIA DIAM (and FLAP), GLSS GLAS, APER the size of the system aperture, XFIE and YFIE a field.
"""

from __future__ import annotations

from plenoptic.core.files.text_lines import name_line_in_errors, parse_number
from plenoptic.core.values import whole
from plenoptic.errors import InvalidValueError, PrescriptionError
from plenoptic.optics.lens.files.zemax_system import APERTURES, Line

_OF_SURFACES = {"THIC": "DISZ", "CRVT": "CURV", "CONN": "CONI", "SDIA": "DIAM", "GLSS": "GLAS"}
_OF_FIELDS = {"XFIE": "XFLN", "YFIE": "YFLN"}
_SOLVES = ("MAZH", "PZUP", "EDGE", "CHZH")
"""Solves of thicknesses, whose values in the file are those of the configuration active on saving."""


def with_configuration(
    head: list[Line], blocks: list[list[Line]], configuration: int | None, where: str
) -> tuple[list[Line], list[list[Line]], list[str]]:
    """Lines of the system and of the surfaces in a configuration, and the data that are ignored.

    None is the configuration that was active when the file was saved: all lines stay.
    """
    at = next((i for i, line in enumerate(head) if line.keyword == "MNUM"), None)
    count = 1 if at is None else int(head[at].real(0))
    active = 1 if at is None else int(head[at].real(1, 1.0))
    if configuration is None:
        return head, blocks, [f"all but one of {count} configurations (MNUM; choose by configuration=)"][: count > 1]
    chosen = whole(configuration, "configuration", at_least=1)
    if chosen > count:
        raise InvalidValueError(f"configuration is {chosen}; {where} has {count} (MNUM)")
    head, blocks, unknown = list(head), [list(block) for block in blocks], dict[str, None]()
    of_number = {block[0].word(0): block for block in blocks}
    for operand in head[len(head) if at is None else at + 1 :]:
        if len(operand.words) < 3 or not operand.words[0].isdecimal() or operand.word(1) != str(chosen):
            continue
        number, _, value = operand.words[:3]
        with name_line_in_errors(where, operand.number):
            if operand.keyword in _OF_SURFACES:
                if number not in of_number:
                    raise PrescriptionError(f"{operand.keyword} is of surface {number}, which is not in the file")
                _replace_in_surface(of_number[number], operand, _OF_SURFACES[operand.keyword], value.strip('"'))
            elif operand.keyword in _OF_FIELDS or operand.keyword == "APER":
                _replace_in_system(head, operand, int(number), value)
            elif operand.keyword != "MOFF":
                unknown[operand.keyword] = None
    ignored = [f"configuration data of other kinds ({', '.join(unknown)})"] if unknown else []
    solved = [block[0].word(0) for block in blocks if any(line.keyword in _SOLVES for line in block)]
    if solved and chosen != active:
        ignored.append(f"solves of thickness (surfaces {', '.join(solved)} as in configuration {active})")
    return head, blocks, ignored


def _replace_in_surface(block: list[Line], operand: Line, keyword: str, value: str) -> None:
    """Replace the line of a keyword in a surface's block; a glass without a name is air."""
    old = next((line for line in block if line.keyword == keyword), None)
    new = Line(operand.number, keyword, " ".join([value, *(old.words[1:] if old and keyword != "GLAS" else [])]))
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
