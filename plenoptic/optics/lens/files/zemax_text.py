"""Zemax files as lines: keywords, what follows them, and which surface they belong to."""

from __future__ import annotations

import re
from typing import NamedTuple

from plenoptic.core.files.text_lines import naming_line, written_number
from plenoptic.errors import PrescriptionError

_OF_THE_SYSTEM = frozenset(
    ["MODE", "UNIT", "NAME", "NOTE", "GCAT", "ENPD", "FNUM", "FTYP", "XFLN", "YFLN", "WAVM", "WAVL", "PWAV"]
)
"""Keywords that belong to no surface, wherever they stand."""


class Line(NamedTuple):
    """A line of the file."""

    number: int
    keyword: str
    rest: str

    @property
    def words(self) -> list[str]:
        """What follows the keyword."""
        return self.rest.split()

    def word(self, i: int) -> str:
        """The i-th entry behind the keyword, or an error where there are fewer."""
        words = self.words
        if i >= len(words):
            raise PrescriptionError(f"{self.keyword} has {len(words)} entries; it must have at least {i + 1}")
        return words[i]

    def real(self, i: int) -> float:
        """The i-th entry as a finite number."""
        return written_number(self.word(i), self.keyword)

    @property
    def reals(self) -> list[float]:
        """All entries as finite numbers."""
        return [written_number(word, self.keyword) for word in self.words]


def blocks_of(text: str, where: str) -> tuple[list[Line], list[list[Line]]]:
    """The lines that belong to the whole system, and those of each surface."""
    head: list[Line] = []
    blocks: list[list[Line]] = []
    for number, line in enumerate(re.split(r"\r\n|\r|\n", text), start=1):
        keyword, *rest = line.split(None, 1) or [""]
        entry = Line(number, keyword.upper(), rest[0].strip() if rest else "")
        if entry.keyword == "SURF":
            with naming_line(where, number):
                if entry.word(0) != str(len(blocks)):
                    raise PrescriptionError(
                        f"SURF is {entry.word(0)[:40]!r}; the next surface has number {len(blocks)}"
                    )
            blocks.append([entry])
        elif entry.keyword:
            (blocks[-1] if blocks and entry.keyword not in _OF_THE_SYSTEM else head).append(entry)
    if len(blocks) < 3:
        line_number = blocks[-1][0].number if blocks else 1
        raise PrescriptionError(
            f"{where}, line {line_number}: there are {len(blocks)} surfaces (SURF); a Zemax file has at least three, "
            "the object, one of the lens, and the image"
        )
    return head, blocks
