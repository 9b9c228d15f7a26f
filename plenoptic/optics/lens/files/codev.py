"""Reader of CODE V sequences (.seq) that state a lens.

Statements end with a line or a semicolon and go on behind an ampersand; an exclamation mark begins a comment. Commands
are read by their first three letters. SO is the object, S a surface, SI the image, whose thickness is the distance of
the image surface from the last gap's end. The forms with a surface, such as THI S3 2.5, are read too.

- RDM Y: the first number of a surface is its radius, 0 for a plane; RDM N: its curvature. Without RDM a file is
  refused, since its numbers may be either. DIM M, C, I: lengths in mm, cm, inch.
- CON and ASP with K, A to H and J (r^4 to r^20); REFL is a mirror. A plane mirror with BEN is unfolded, with its tilt.
  Other tilts and decentres, diffractive, cylindrical and toroidal surfaces, and apertures that are not round are
  refused.
- STO: the stop, at surface 1 if it is missing. CIR: semi-diameter that limits the light; OBS and HOL obscure a disc;
  EDG does not limit it. Other semi-diameters follow from the beam of all fields, as for Zemax files.
- EPD, FNO, NA, NAO; XAN, YAN, XOB, YOB, XIM, YIM, XRI, YRI; WL in nm with REF, the number of the primary one.
- Glasses: NAME_MAKER, codes (517642, 517000.642000, 1.5168:64.17), and the file's own (PRV): Laurent's formula (LAU),
  or indices at the wavelengths of PWL, to which that formula is fitted by least squares.
- ZOO: THI, RDY, CUY, EPD, FNO, NA, NAO and fields of the position that the caller chooses, by default the first.
- Ignored, with a warning: vignetting factors, temperature, other zoom data, commands that are unknown here.

Source: CODE V Reference Manual 7.60, Optical Research Associates 1994, and files of lens makers.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from plenoptic.core.files.text_lines import name_line_in_errors, parse_number
from plenoptic.core.values import whole
from plenoptic.core.warn import warn
from plenoptic.errors import FileWarning, InvalidValueError, PrescriptionError
from plenoptic.optics.glass.catalogue import GlassCatalogue
from plenoptic.optics.glass.media import AIR, D_LINE, ConstantMedium, Medium, Schott
from plenoptic.optics.lens.elements import check_count
from plenoptic.optics.lens.files.glass_names import GlassNames
from plenoptic.optics.lens.files.zemax_folds import has_folds, unfold
from plenoptic.optics.lens.files.zemax_stack import Row, lens_of_rows
from plenoptic.optics.lens.files.zemax_system import Aperture, System
from plenoptic.optics.lens.specification import StopSize
from plenoptic.optics.lens.stack import LensStack

_UNITS = {"M": 1.0, "C": 10.0, "I": 25.4}
_APERTURES = {"EPD": "ENPD", "FNO": "FNUM", "NA": "FNUM", "NAO": "OBNA"}
_FIELDS = {"AN": 0, "OB": 1, "IM": 2, "RI": 3}
_POWERS = "ABCDEFGHJ"
_TILTS = ("XDE", "YDE", "ZDE", "ADE", "BDE", "CDE")
_ZOOMED = ("THI", "RDY", "CUY", *_APERTURES, *(axis + kind for axis in "XY" for kind in _FIELDS))
_VIGNETTING = ("VUX", "VLX", "VUY", "VLY")
_REFUSED = {
    **dict.fromkeys(("REX", "REY", "ELX", "ELY"), "apertures that are not round"),
    **dict.fromkeys(("DIF", "GRT", "HOE", "HCO"), "diffractive surfaces"),
    **dict.fromkeys(("CYL", "XTO", "YTO", "AAS", "CUX", "RDX"), "surfaces without rotational symmetry"),
    **dict.fromkeys(("SPS", "UDS", "SPL", "QBF", "QCN"), "special surfaces"),
    **dict.fromkeys(("REV", "DAR", "RET", "GLB"), "tilts and decentres"),
}
_IGNORED = frozenset(
    ("LEN", "GO", "CA", "PIM", "PIK", "DER", "CLS", "WTW", "WTF", "INI", "SLB", "POL", "CON", "ASP", "CCY", "THC")
).union(("CUM", "THM", "GLC", "KC"), (power + "C" for power in _POWERS), _REFUSED)
"""Commands for optimization, plots and other programs' labels, and of no effect on light."""
_WORST_FIT = 2e-3
"""Error of an index from which on a table of a glass counts as misprinted."""


class _Statement(NamedTuple):
    line: int
    words: list[str]

    @property
    def command(self) -> str:
        return self.words[0].upper() if re.fullmatch(r"(?i)s[0-9]{1,6}", self.words[0]) else self.words[0][:3].upper()

    def real(self, i: int) -> float:
        if i >= len(self.words):
            raise PrescriptionError(f"{self.words[0][:40]} has {len(self.words) - 1} entries; it must have {i} or more")
        return math.inf if self.words[i].upper() in ("INF", "INFINITY") else parse_number(self.words[i], self.words[0])

    def reals(self) -> list[float]:
        return [self.real(i) for i in range(1, len(self.words))]


def lens_from_seq(
    text: str,
    where: str,
    *,
    glasses: Mapping[str, Medium] | GlassCatalogue | None = None,
    stop_size: StopSize = StopSize.SYSTEM_APERTURE,
    configuration: int | None = None,
) -> LensStack:
    """Lens from the text of a CODE V sequence. `where` names the file in messages; `glasses` are looked up first."""
    statements, left_out = _at_zoom_position(list(_statements(text)), configuration, where)
    lens = _Lens(where, GlassNames.of(glasses), left_out)
    for statement in statements:
        with name_line_in_errors(where, statement.line):
            lens.read(statement)
    return lens.stack(stop_size)


def _statements(text: str) -> Iterator[_Statement]:
    """Statements of the file: quoted words lose their quotes; comments are removed."""
    words: list[str] = []
    for number, line in enumerate(re.split(r"\r\n|\r|\n", text), start=1):
        goes_on = False
        for token in re.findall(r"'[^']*'?|\"[^\"]*\"?|!.*|;|&|[^\s;!'\"&]+", line):
            goes_on = token == "&"
            if token[0] == "!":
                break
            if token == ";" and words:
                yield _Statement(number, words)
                words = []
            elif token not in ";&":
                words.append(token.strip(token[0]) if token[0] in "'\"" else token)
        if words and not goes_on:
            yield _Statement(number, words)
            words = []
    if words:
        yield _Statement(number, words)


def _at_zoom_position(
    statements: list[_Statement], configuration: int | None, where: str
) -> tuple[list[_Statement], dict[str, None]]:
    """Statements with those of a zoom position at the end, and a list of ignored data."""
    counts = ["".join(s.words[1:2]) for s in statements if s.command == "ZOO"]
    count = max((int(word) for word in counts if re.fullmatch("[0-9]{1,6}", word)), default=1)
    chosen = 1 if configuration is None else whole(configuration, "configuration", at_least=1)
    if chosen > count:
        raise InvalidValueError(f"configuration is {chosen}; {where} has {count} (ZOO)")
    left_out = dict[str, None]()
    if configuration is None and count > 1:
        left_out[f"all but the first of {count} zoom positions (ZOO; choose by configuration=)"] = None
    unzoomed, changes = [], []
    for statement in statements:
        if statement.command != "ZOO":
            unzoomed.append(statement)
        elif len(statement.words) > 2 + count - 1 and statement.words[1][:3].upper() in _ZOOMED:
            values = statement.words[-count:]
            changes.append(_Statement(statement.line, [*statement.words[1:-count], values[chosen - 1]]))
        elif len(statement.words) > 2 and not statement.words[1].upper().endswith("C"):
            left_out[f"zoom data of {statement.words[1][:8]}"] = None
    return [*unzoomed, *changes], left_out


class _Lens:
    """Rows and system data of the file, filled statement by statement."""

    def __init__(self, where: str, glasses: GlassNames, left_out: dict[str, None]) -> None:
        self.where, self.glasses, self.left_out = where, glasses, left_out
        self.rows: list[Row] = []
        self.is_radius: bool | None = None
        self.unit, self.title, self.reference = 1.0, "", 1
        self.aperture: Aperture | None = None
        self.wavelengths: list[float] = []
        self.fields: dict[str, list[float]] = {}
        self.tilted: dict[int, set[str]] = {}
        self.bent: set[int] = set()
        self.has_image = self.is_private = False
        self.private: dict[str, Medium] = {}
        self.private_wavelengths: list[float] = []

    def read(self, statement: _Statement) -> None:
        command, words = statement.command, statement.words
        if self.is_private:
            self._read_private(statement)
        elif command in ("SO", "S", "SI") or re.fullmatch("S[0-9]{1,6}", command):
            self._read_surface(statement)
        elif command in _REFUSED and any(word.upper() not in ("0", "0.0") for word in words[1:] or ["1"]):
            raise PrescriptionError(f"{words[0][:40]}: {_REFUSED[command]} cannot be read")
        elif not self._read_system(statement) and not self._read_data(statement) and command not in _IGNORED:
            self.left_out[f"the command {words[0][:20]}"] = None

    def _read_system(self, statement: _Statement) -> bool:
        """Read a statement of the whole system; False if it is none."""
        command, words = statement.command, statement.words
        if command == "RDM":
            self.is_radius = words[1:2] == [] or words[1].upper() not in ("N", "NO")
        elif command == "DIM":
            if len(words) < 2 or words[1][0].upper() not in _UNITS:
                raise PrescriptionError(f"DIM is {' '.join(words[1:])[:40]!r}; it must be M (mm), C (cm) or I (inch)")
            self.unit = _UNITS[words[1][0].upper()]
        elif command == "TIT":
            self.title = " ".join(words[1:])
        elif command in _APERTURES:
            size = statement.real(1)
            size = 0.5 / size if command == "NA" and size else size * (self.unit if command == "EPD" else 1.0)
            self.aperture = Aperture(statement.line, _APERTURES[command], size, command == "NA")
        elif command == "WL":
            self.wavelengths = statement.reals()
        elif command == "REF":
            self.reference = int(min(max(statement.real(1), 0.0), 1e6))
        elif command[:1] in ("X", "Y") and command[1:] in _FIELDS:
            at = re.fullmatch(r"[Ff]([0-9]{1,6})", (words[1:] or [""])[0])
            if at is None:
                self.fields[command] = statement.reals()
            elif 0 < int(at[1]) <= len(self.fields.get(command, [])):
                self.fields[command][int(at[1]) - 1] = statement.real(2)
        elif command == "PRV":
            self.is_private = True
        elif command in _VIGNETTING:
            if any(statement.reals()):
                self.left_out["vignetting factors (VUX, VLX, VUY, VLY)"] = None
        elif command == "TEM":
            if statement.real(1) != 20:
                self.left_out[f"the temperature ({words[1]} C, TEM)"] = None
        else:
            return False
        return True

    def _read_private(self, statement: _Statement) -> None:
        """Read a statement of the catalogue of the file."""
        name, words = statement.words[0], statement.words[1:]
        if statement.command == "END":
            self.is_private = False
        elif statement.command == "PWL":
            self.private_wavelengths = statement.reals()
        elif words[:1] and words[0].upper() == "LAU":
            coefficients = [parse_number(word, name) for word in words[1:]]
            self.private[name.upper()] = Schott((coefficients + [0.0] * 6)[:6], name)
        elif words and len(words) == len(self.private_wavelengths):
            self.private[name.upper()] = _fit_dispersion(name, self.private_wavelengths, statement.reals())
        else:
            raise PrescriptionError(
                f"the glass {name[:40]!r} is neither LAU with coefficients nor one index for each wavelength of PWL; "
                "give it by glasses= and remove it from PRV"
            )

    def _read_surface(self, statement: _Statement) -> None:
        command, words = statement.command, statement.words
        if (self.is_radius is None) and statement.real(1) not in (0.0, math.inf):
            raise PrescriptionError(
                f"{words[0]} has {words[1][:40]} before RDM states if it is a radius or a curvature; add a line RDM Y "
                "(radii) or RDM N (curvatures) at the beginning"
            )
        row = Row(len(self.rows), {"SURF": statement.line}, curvature=self._curvature(statement.real(1)))
        row = row._replace(gap=statement.real(2) * self.unit)
        row = self._with_medium(row, words[3] if len(words) > 3 else "AIR")
        if command[1:].isdecimal():
            i = self._index(command)
            self.rows[i] = row._replace(number=i)
        elif (command == "SO") != (not self.rows) or self.has_image:
            raise PrescriptionError(f"{command} stands here; a lens has SO first, then S, and SI last")
        else:
            check_count(len(self.rows))
            self.rows.append(row)
            self.has_image = command == "SI"

    def _curvature(self, number: float) -> float:
        if not self.is_radius:
            return number / self.unit
        return 1.0 / (number * self.unit) if number and math.isfinite(number) else 0.0

    def _with_medium(self, row: Row, name: str) -> Row:
        if name.upper() == "REFL":
            return row._replace(is_mirror=True)
        if name.upper() == "AIR":
            return row._replace(medium=AIR)
        if name.upper() in self.private:
            return row._replace(medium=self.private[name.upper()])
        glass, _, maker = name.rpartition("_")
        return row._replace(medium=self.glasses._replace(makers=[maker] if glass else []).medium(glass or name))

    def _index(self, word: str) -> int:
        """Number of the surface that a word such as S3 names."""
        name = word.upper()[1:]
        i = 0 if name == "O" else len(self.rows) - 1 if name == "I" else int(name)
        if not 0 <= i < len(self.rows):
            raise PrescriptionError(f"{word} names a surface that the file does not have before this line")
        return i

    def _read_data(self, statement: _Statement) -> bool:
        """Read a statement of a surface, the last one unless it names another; False if it is none."""
        command, words = statement.command, statement.words
        i = len(self.rows) - 1
        if i >= 0 and len(words) > 1 and re.fullmatch(r"(?i)s([0-9]{1,6}|o|i)", words[1]):
            i, statement = self._index(words[1]), _Statement(statement.line, [words[0], *words[2:]])
            words = statement.words
        if i < 0:
            return False
        row = self.rows[i]
        if command == "STO":
            row = row._replace(is_stop=True)
        elif command == "THI":
            if words[1:2] and re.fullmatch(r"[-+.0-9].*", words[1]):  # otherwise a solve, whose value is in the file
                row = row._replace(gap=statement.real(1) * self.unit)
        elif command == "RDY":
            radius = statement.real(1) * self.unit
            row = row._replace(curvature=1.0 / radius if radius and math.isfinite(radius) else 0.0)
        elif command in ("CUY", "K"):
            number = statement.real(1)
            row = row._replace(conic=number) if command == "K" else row._replace(curvature=number / self.unit)
        elif command == "GLA":
            row = self._with_medium(row, (words[1:] or ["AIR"])[0])
        elif command in _POWERS and len(command) == 1:
            power = _POWERS.index(command) + 1
            aspheric = [*row.aspheric, *[0.0] * 10][:10]
            aspheric[power] = statement.real(1) * self.unit ** (-1 - 2 * power)
            row = row._replace(aspheric=tuple(aspheric))
        elif command == "CIR":
            row = _with_circle(row, statement, self.unit)
        elif command == "CUF":
            if statement.real(1) != 0:
                raise PrescriptionError("CUF: Fresnel surfaces cannot be read")
        elif command in (*_TILTS, "ADX", "ADY"):
            if statement.real(1) != 0:
                self.tilted.setdefault(i, set()).add(command)
        elif command == "BEN":
            self.bent.add(i)
        else:
            return False
        self.rows[i] = row
        return True

    def stack(self, stop_size: StopSize) -> LensStack:
        """The lens of all statements."""
        rows, where = self.rows, self.where
        if len(rows) < 3 or not self.has_image:
            raise PrescriptionError(
                f"{where}: a CODE V lens has an object (SO), one or more surfaces (S), and an image (SI); it has "
                f"{len(rows)} of them{'' if self.has_image else ', and no SI'}"
            )
        for i, commands in self.tilted.items():
            if not (i in self.bent and rows[i].is_mirror and rows[i].is_plane and commands <= {"ADE", "BDE", "CDE"}):
                raise PrescriptionError(
                    f"{where}, line {rows[i].lines['SURF']}: surface {i} is tilted or decentred "
                    f"({', '.join(sorted(commands))}); only plane mirrors with BEN are read so: read it centred and "
                    "use lens.moved()"
                )
        if not any(row.is_stop for row in rows):
            rows[1] = rows[1]._replace(is_stop=True)
        rows[-2] = rows[-2]._replace(gap=rows[-2].gap + rows[-1].gap)
        rows[-1] = Row(len(rows) - 1, rows[-1].lines, curvature=rows[-1].curvature)
        if has_folds(rows):
            rows, _ = unfold(rows, where)
        system = self._system()
        lens = lens_of_rows(rows, system, where, self.title or where.rpartition(".")[0], where, stop_size=stop_size)
        if self.left_out:
            warn(f"{where}: left out are {', '.join(self.left_out)}; see lens.specification for the rest", FileWarning)
        return lens

    def _system(self) -> System:
        kind = next((command[1:] for command in self.fields if any(self.fields[command])), "AN")
        columns = [self.fields.get(axis + kind, []) for axis in "XY"]
        count = max(1, *map(len, columns))
        scale = 1.0 if kind == "AN" else self.unit
        fields = scale * np.array([(column + [0.0] * count)[:count] for column in columns]).T
        waves = self.wavelengths or [D_LINE]
        if not 1 <= self.reference <= len(waves):
            raise PrescriptionError(f"{self.where}: REF is {self.reference}; WL has {len(waves)} wavelengths")
        primary = waves[self.reference - 1]
        others = [wave for i, wave in enumerate(waves, start=1) if i != self.reference]
        return System(self.aperture, fields, _FIELDS[kind], (primary, *others), ())


def _with_circle(row: Row, statement: _Statement, unit: float) -> Row:
    """Row with a round aperture or obscuration."""
    kinds = {word.upper() for word in statement.words[1:-1]}
    radius = parse_number(statement.words[-1], "CIR") * unit
    if kinds & {"OBS", "HOL"}:
        return row._replace(obscured=max(row.obscured, radius))
    return row if "EDG" in kinds else row._replace(aperture=radius)


def _fit_dispersion(name: str, wavelengths: list[float], indices: list[float]) -> Medium:
    """Medium of indices at wavelengths in nm: Laurent's formula by least squares, of as many terms as indices."""
    if not (all(1.0 <= w <= 1e6 for w in wavelengths) and all(1.0 <= index < 10.0 for index in indices)):
        raise PrescriptionError(f"PRV: {name[:40]!r} needs wavelengths in nm, and indices from 1 to 10; correct them")
    if len(indices) == 1:
        return ConstantMedium(indices[0])
    order = [0, 2, 1, 3, 4, 5][: len(indices)]  # coefficients, the most important first
    squares = (np.array(wavelengths) * 1e-3) ** 2
    terms = np.column_stack([squares**power for power in np.array([0.0, 1.0, -1.0, -2.0, -3.0, -4.0])[order]])
    coefficients = np.zeros(6)
    coefficients[order] = np.linalg.lstsq(terms, np.square(indices), rcond=None)[0]
    with np.errstate(invalid="ignore"):
        error = np.abs(np.sqrt(terms @ coefficients[order]) - indices).max()
    if not error < _WORST_FIT:
        raise PrescriptionError(
            f"the indices of {name[:40]!r} (PRV) differ by up to {error:.2g} from a smooth formula; correct them"
        )
    return Schott(coefficients.tolist(), name, (min(wavelengths), max(wavelengths)))
