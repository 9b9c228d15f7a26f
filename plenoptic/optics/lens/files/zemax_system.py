"""System data of a Zemax file: aperture, fields, wavelengths, and a list of ignored data."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from plenoptic.core.files.text_lines import name_line_in_errors, parse_number
from plenoptic.core.values import Floats
from plenoptic.errors import PrescriptionError
from plenoptic.optics.glass.media import D_LINE

_ANGLE, _OBJECT_HEIGHT, _IMAGE_HEIGHT, _REAL_IMAGE_HEIGHT = range(4)
_STEEPEST = 89.0
"""Largest angle of chief rays in degrees."""
APERTURES = ("ENPD", "FNUM", "OBNA")
"""Keywords of system apertures that have a size."""
VIGNETTING_OPERANDS = ("FVDX", "FVDY", "FVCX", "FVCY", "FVAN")
"""Operands of configurations for the vignetting factors."""
_VIGNETTING = ("VDXN", "VDYN", "VCXN", "VCYN", "VANN")
_OTHERS = ("MODE", "UNIT", "NAME", "NOTE", "GCAT", "FTYP", "XFLN", "YFLN", "WAVM", "WAVL", "PWAV", "ENVD", "MNUM")
KEYWORDS = frozenset([*_OTHERS, *APERTURES, "FLOA", *_VIGNETTING])
"""Keywords that belong to the system, at any position in the file."""


class Line(NamedTuple):
    """A line of the file."""

    number: int
    keyword: str
    rest: str

    @property
    def words(self) -> list[str]:
        """Words after the keyword."""
        return self.rest.split()

    def word(self, i: int) -> str:
        """The i-th entry after the keyword; an error if there are fewer."""
        words = self.words
        if i >= len(words):
            raise PrescriptionError(f"{self.keyword} has {len(words)} entries; it must have at least {i + 1}")
        return words[i]

    def real(self, i: int, default: float | None = None) -> float:
        """The i-th entry as a finite number; the default, if any, if there are fewer entries."""
        if default is not None and i >= len(self.words):
            return default
        return parse_number(self.word(i), self.keyword)

    @property
    def reals(self) -> list[float]:
        """All entries as finite numbers."""
        return [parse_number(word, self.keyword) for word in self.words]


class Aperture(NamedTuple):
    """The system aperture."""

    line: int
    keyword: str
    size: float
    """ENPD: mm; FNUM: f-number; OBNA: numerical aperture, or degrees."""
    is_other: bool
    """True for a working f-number (FNUM) or a cone angle (OBNA)."""


class System(NamedTuple):
    """System data of a file: lengths in mm, wavelengths in nm."""

    aperture: Aperture | None
    """None if the aperture floats by the stop or is missing."""
    fields: Floats
    """(n, 2): degrees, or mm if the fields of `field_type` are heights."""
    field_type: int
    wavelengths: tuple[float, ...]
    """The primary one first."""
    left_out: tuple[str, ...]
    is_focused: bool = False
    """True if the image lies in the paraxial focus, whatever the last gap."""

    def chief_slopes(self, distance: float, pupil: float, focal_length: float) -> Floats:
        """Slopes (n, 2) of the chief rays in front of the lens, towards a pupil `pupil` mm behind the first element."""
        if self.field_type == _ANGLE:
            return np.tan(np.radians(np.clip(self.fields, -_STEEPEST, _STEEPEST)))
        if self.field_type == _OBJECT_HEIGHT and math.isfinite(distance) and distance + pupil != 0:
            return -self.fields / (distance + pupil)
        if self.field_type in (_IMAGE_HEIGHT, _REAL_IMAGE_HEIGHT) and math.isinf(distance):
            return self.fields / focal_length
        raise PrescriptionError(f"fields of type {self.field_type} do not determine the chief ray; give it")

    def object_points(self, distance: float, pupil: float, focal_length: float) -> Floats:
        """Object points (n, 2) in the units of analyses: radians for an object at infinity, otherwise mm."""
        if self.field_type == _OBJECT_HEIGHT and math.isfinite(distance):
            return self.fields
        slopes = self.chief_slopes(distance, pupil, focal_length)
        if math.isfinite(distance):
            return -slopes * (distance + pupil)
        tangent = np.hypot(*slopes.T)[:, None]
        # Rays with a positive slope come from below the axis.
        points = -slopes * np.where(tangent > 0, np.arctan(tangent) / np.where(tangent > 0, tangent, 1.0), 1.0)
        along = (self.fields == 0).any(axis=1, keepdims=True) & (self.field_type == _ANGLE)
        return np.where(along, -np.radians(self.fields), points)


def read_system(head: Iterable[Line], where: str, unit: float) -> System:
    """System data from the lines that belong to the whole system; `unit` in mm."""
    aperture: Aperture | None = None
    waves: dict[int, float] = {}
    fields: dict[str, list[float]] = {"XFLN": [], "YFLN": []}
    field_type, counts, primary, left_out = _ANGLE, (0, 0), 1, dict[str, None]()
    for line in head:
        with name_line_in_errors(where, line.number):
            match line.keyword:
                case "FLOA":
                    aperture = None
                case "ENPD" | "FNUM" | "OBNA":
                    size = line.real(0) * (unit if line.keyword == "ENPD" else 1.0)
                    aperture = Aperture(line.number, line.keyword, size, line.real(1, 0.0) != 0)
                case "FTYP":
                    field_type, counts = int(line.real(0)), (int(line.real(2, 0.0)), int(line.real(3, 0.0)))
                    if line.real(1, 0.0) != 0:
                        left_out["object space that is telecentric (FTYP)"] = None
                case "XFLN" | "YFLN":
                    fields[line.keyword] = line.reals
                case "WAVM":
                    waves[int(line.real(0))] = line.real(1) * 1e3
                case "WAVL":
                    waves.update((i, 1e3 * wave) for i, wave in enumerate(line.reals, start=1))
                case "PWAV":
                    primary = int(line.real(0))
                case keyword if keyword in _VIGNETTING and any(line.reals):
                    left_out["vignetting factors (VDXN, VDYN, VCXN, VCYN, VANN)"] = None
                case "ENVD" if (line.real(0), line.real(1, 1.0)) != (20.0, 1.0):
                    left_out[f"temperature and pressure ({line.real(0):g} C, {line.real(1, 1.0):g} atm, ENVD)"] = None
    pairs = max(map(len, fields.values()))
    pairs = min(pairs, counts[0]) if counts[0] > 0 else pairs
    columns = [(values + [0.0] * pairs)[:pairs] for values in fields.values()]
    # Files may list unused wavelengths.
    used = {i: wave for i, wave in sorted(waves.items()) if wave > 0 and (i <= counts[1] or counts[1] < 1)}
    first = waves.get(primary, 0.0)
    wavelengths = [first if first > 0 else D_LINE, *(wave for i, wave in used.items() if i != primary)]
    scale = 1.0 if field_type == _ANGLE else unit
    return System(aperture, scale * np.array(columns).T, field_type, tuple(wavelengths), tuple(left_out))
