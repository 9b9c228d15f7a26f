"""Text files of other programs or people: encodings, numbers, errors that name the line, and CSV tables."""

from __future__ import annotations

import codecs
import csv
import io
import re
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.errors import FileError, InvalidValueError, PrescriptionError


def decode_text(content: bytes, *, errors: str = "strict") -> str:
    """The text of a file in UTF-16 with or without its mark (and `errors` as for `bytes.decode`), UTF-8, or Latin-1."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16", errors)
    if b"\0" in content[:2]:
        return content.decode("utf-16-le" if content[1:2] == b"\0" else "utf-16-be", errors)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


@contextmanager
def name_line_in_errors(file: str, line: int) -> Iterator[None]:
    """Context manager that adds the file and the line to errors."""
    try:
        yield
    except InvalidValueError as error:
        raise PrescriptionError(f"{file}, line {line}: {error}") from None


def parse_number(word: str, name: str) -> float:
    """A finite number, also with Fortran's D for E; stricter than float(): no nan, underscores or decimal comma."""
    if not re.fullmatch(r"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eEdD][+-]?[0-9]+)?", word):
        raise PrescriptionError(f"{name} is {word[:40]!r}; it must be a number with a decimal point")
    number = float(word.upper().replace("D", "E"))
    if abs(number) == float("inf"):
        raise PrescriptionError(f"{name} is {word[:40]}, too large for a number; correct it")
    return number


def parse_numbers(text: bytes) -> NDArray[np.float64]:
    """All numbers of a text between blanks and line ends, nan and inf too; a FileError for anything else."""
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("error", message="string or file could not be read")
            return np.fromstring(text, sep=" ") if text.strip() else np.zeros(0)  # NumPy makes -1 of blanks
    except (DeprecationWarning, ValueError):  # older and newer versions of NumPy
        raise FileError("it holds text in place of a number; export it again") from None


def word_starts(text: bytes) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Position of each word of a text, and the number of its line."""
    letters = np.frombuffer(text, dtype=np.uint8)
    is_word = letters > 32
    starts = np.flatnonzero(is_word & ~np.concatenate([[False], is_word[:-1]])) if text else np.zeros(0, np.int64)
    return starts, np.searchsorted(np.flatnonzero(letters == 10), starts)


def csv_text(header: Sequence[str], columns: Iterable[Any]) -> str:
    """CSV table of columns, each an array; floats keep every bit."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(header)
    table.writerows(zip(*(column.tolist() for column in columns), strict=True))
    return text.getvalue()
