"""Catalogues of glasses, and AGF files, in which makers publish them."""

from __future__ import annotations

import dataclasses
import difflib
import math
import os
import re
from collections.abc import Iterator, Sequence
from typing import Any

from plenoptic.core.files.file_limits import TEXT, FileLimits, read_file
from plenoptic.core.files.text_lines import decode_text, name_line_in_errors, parse_number
from plenoptic.core.values import LARGEST_WHOLE, check_has, check_kind, file_path, finite, set_field, value, whole
from plenoptic.errors import FileError, InvalidValueError, PrescriptionError
from plenoptic.optics.glass.absorption import AbsorbingGlass
from plenoptic.optics.glass.dispersion import COEFFICIENT_COUNTS, DispersionFormula, Formula
from plenoptic.optics.glass.media import C_LINE, D_LINE, F_LINE, Medium, ModelGlass, Schott, Sellmeier, abbe_number

_MODEL_GLASS = 0
"""Formula number, of bundled tables only, of a glass known by n_d and V_d only."""

_MAX_DISAGREEMENT = 1e-3
"""Between the n_d of an entry and that of its formula: more than any rounding, and a sign of a misprint."""

_MAX_V_ERROR, _V_ROUNDING = 0.02, 0.5
"""Between the V_d of an entry and that of its formula, relative; V_d may be rounded to a whole number."""


@value
class GlassEntry:
    """Entry of a catalogue, not yet checked for consistency.

    Made by `load_glasses`; see `GlassCatalogue.entry`.
    """

    name: str
    formula: int
    """Number of the dispersion formula; supported ones are the members of `Formula`."""
    nd: float
    """Index at 587.5618 nm; 1 or less if the file does not state it."""
    vd: float
    """Abbe number."""
    coefficients: Sequence[float] = ()
    """Coefficients as in the file, for wavelengths in micrometres."""
    wavelength_range: Sequence[float] = ()
    """Range of wavelengths in nm; empty if the file does not state it."""
    source: str = ""
    """Comment on the glass: its source, in bundled catalogues."""
    line: int = 0
    """First line of the entry in the file."""
    transmission: Sequence[tuple[float, float, float]] = ()
    """Wavelength in nm, internal transmittance, and its thickness in mm; empty if the file does not state it."""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not isinstance(self.source, str):
            raise InvalidValueError(f"name {self.name!r:.40} and source {self.source!r:.40} must be texts")
        set_field(self, "formula", whole(self.formula, "formula", at_least=0))
        for field in ("nd", "vd"):
            set_field(self, field, finite(getattr(self, field), field))
        for field in ("coefficients", "wavelength_range"):
            set_field(self, field, tuple(finite(number, field) for number in getattr(self, field)))
        set_field(self, "transmission", tuple(tuple(map(float, row)) for row in self.transmission))


@value
class GlassCatalogue:
    """Glasses of a catalogue file, by name; made by `load_glasses`.

    `catalogue[name]` is a medium. Lookup ignores case, '-', '_' and spaces, so that "n bk7" is N-BK7; BK7 is another
    glass. `in`, `len` and iteration, over the names, work as for a mapping.

    Examples
    --------
    >>> import plenoptic as pl
    >>> glasses = pl.optics.bundled_glasses("SCHOTT")
    >>> "n bk7" in glasses, "BK7" in glasses
    (True, False)
    """

    name: str
    """Name of the file."""
    entries: Sequence[GlassEntry]
    """Entries in the order of the file."""
    _rows: dict[str, tuple[int, ...]] = dataclasses.field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_has(self.entries, "entries", "sequence of GlassEntry", "the entries of another catalogue", "__iter__")
        set_field(self, "entries", tuple(self.entries))
        for entry in self.entries:
            check_kind(entry, "an entry", GlassEntry, "those of pl.optics.load_glasses(path).entries")
        rows: dict[str, list[int]] = {}
        for i, entry in enumerate(self.entries):
            rows.setdefault(glass_key(entry.name), []).append(i)
        set_field(self, "_rows", {key: tuple(numbers) for key, numbers in rows.items()})

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the glasses, as in the file."""
        return tuple(entry.name for entry in self.entries)

    def entry(self, name: str) -> GlassEntry:
        """Entry of a glass in the file; an InvalidValueError with similar names if it has none of that name.

        Examples
        --------
        >>> import plenoptic as pl
        >>> entry = pl.optics.bundled_glasses("SCHOTT").entry("n bk7")
        >>> entry.nd, entry.vd, entry.wavelength_range, entry.source[:6]
        (1.5168, 64.17, (300.0, 2500.0), 'Schott')
        """
        if not isinstance(name, str):
            raise InvalidValueError(f"the name of a glass is {name!r:.40}; it must be a text, such as 'N-BK7'")
        matches = [self.entries[i] for i in self._rows.get(glass_key(name), ())]
        if not matches:
            near = f"; near to it are {', '.join(close)}" if (close := self.close_to(name)) else ""
            raise InvalidValueError(f"there is no glass {name[:40]!r} in {self.name}{near}")
        # Names that differ only in '-', '_' and spaces must match exactly.
        exact = [entry for entry in matches if entry.name.upper() == name.strip().upper()] or matches
        if any(dataclasses.replace(entry, line=0) != dataclasses.replace(exact[0], line=0) for entry in exact):
            lines = " and ".join(f"{entry.name} on line {entry.line}" for entry in exact)
            raise PrescriptionError(f"{self.name}: {name[:40]!r} may be {lines}, which differ; write it as there")
        return exact[0]

    def __getitem__(self, name: str) -> Medium:
        entry = self.entry(name)
        try:
            return _medium(entry)
        except InvalidValueError as error:
            raise PrescriptionError(f"{self.name}, line {entry.line}, glass {entry.name}: {error}") from None

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and glass_key(name) in self._rows

    def __len__(self) -> int:
        return len(self.entries)

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __repr__(self) -> str:
        return f"<GlassCatalogue {self.name!r}: {len(self)} glass{'' if len(self) == 1 else 'es'}>"

    def close_to(self, name: str) -> list[str]:
        """Names similar to one that may be misspelt, the most similar first."""
        keys = difflib.get_close_matches(glass_key(name)[:40], self._rows, n=4, cutoff=0.5)
        return [self.entries[self._rows[key][0]].name for key in keys]


def load_glasses(path: str | os.PathLike[str], *, limits: FileLimits = TEXT) -> GlassCatalogue:
    """Load the glasses of an AGF file, the format of Zemax in which makers publish their catalogues.

    Lines NM (name, formula, code, n_d, V_d), CD (coefficients), LD (range), GC (comment) and IT (internal
    transmittance) are read, all others skipped: CC, and ED, TD and OD, which state expansion, dn/dT and price. A glass
    with lines IT is an `AbsorbingGlass`; lines IT that are not three numbers in range are skipped, too. There are no
    thermal terms: the index is that at the temperature of the catalogue, mostly 20 deg C, relative to air. Formulas 1
    to 13 are supported: 1 gives a `Schott`, 2, 6 and 11 a `Sellmeier`, all others a `DispersionFormula`.

    A line that begins with a number continues the one before it. Each glass is constructed on access: an invalid one
    does not affect the others. Invalid are an unknown formula, fewer coefficients than it has, and an n_d or V_d that
    differs from that of the formula by more than 0.001, or 2 % (0.5 at least). A fit that gives an index below 1 at
    some wavelengths is an error there only.

    Parameters
    ----------
    path : str or path-like
        A text file in UTF-8, in UTF-16 with its mark, or else in Latin-1.
    limits : FileLimits
        Limits of the size of the file: by default at most 4 MiB.

    Raises
    ------
    FileError
        If the file cannot be read.
    PrescriptionError
        If a line that is read cannot be understood, or there is no glass; the message names the file and the line.

    Examples
    --------
    >>> import pathlib, tempfile, plenoptic as pl
    >>> text = '''NM MY-BK7 2 517642 1.5168 64.17
    ... CD 1.03961212 6.00069867E-3 0.231792344 2.00179144E-2 1.01046945 103.560653
    ... LD 0.3 2.5'''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder) / "mine.agf"
    ...     _ = file.write_text(text)
    ...     mine = pl.optics.load_glasses(file)
    >>> mine
    <GlassCatalogue 'mine.agf': 1 glass>
    >>> round(mine["my bk7"].index(587.5618), 5)
    1.5168
    """
    file = file_path(path)
    try:
        text = decode_text(read_file(file, limits))
    except ValueError as error:
        raise FileError(f"cannot read {file}: {error}; give the path of an AGF file") from None
    return glasses_from_agf(text, file.name)


def glass_key(name: str) -> str:
    """Key of a name for lookup: upper case, without '-', '_' and spaces."""
    return re.sub(r"[-_\s]", "", name).upper()


def glasses_from_agf(text: str, file: str, *, source: str = "") -> GlassCatalogue:
    """Catalogue from the text of an AGF file; `source` is that of glasses without a comment (GC)."""
    entries: list[dict[str, Any]] = []
    keyword = ""
    for number, line in enumerate(re.split(r"\r\n|\r|\n", text), start=1):
        with name_line_in_errors(file, number):
            # A line that begins with a number continues the one before it.
            if re.match(r"\s*[+-]?\.?\d", line):
                if keyword == "CD":
                    entries[-1]["coefficients"] += _numbers(keyword, line)
                continue
            if not line.strip():
                continue
            keyword, content = (*line.split(maxsplit=1), "")[:2]
            if keyword == "NM":
                entries.append({**_name_line(content.split()), "line": number})
            elif keyword in ("CD", "LD", "GC", "IT"):
                if not entries:
                    raise PrescriptionError(f"{keyword} stands before the first NM; a glass begins with its NM line")
                _detail_line(entries[-1], keyword, content)
    if not entries:
        raise PrescriptionError(f"{file} has no line NM, so no glass; give an AGF file")
    return GlassCatalogue(file, [GlassEntry(**{"source": source, **entry}) for entry in entries])


def _name_line(words: list[str]) -> dict[str, Any]:
    if len(words) < 5:
        raise PrescriptionError(f"NM has {len(words)} words; it must have name, formula, code, n_d and V_d")
    formula = parse_number(words[1], "formula")
    if not formula.is_integer() or not 0 <= formula <= LARGEST_WHOLE:
        raise PrescriptionError(f"formula is {formula:g}; it must be a whole number, not below 0")
    nd, vd = parse_number(words[3], "n_d"), parse_number(words[4], "V_d")
    return {"name": words[0], "formula": int(formula), "nd": nd, "vd": vd}


def _detail_line(entry: dict[str, Any], keyword: str, content: str) -> None:
    if keyword == "GC":
        entry["source"] = " ".join(filter(None, (entry.get("source"), content.strip())))
        return
    if keyword == "IT":
        entry["transmission"] = (*entry.get("transmission", ()), *_transmission_rows(content))
        return
    field = "coefficients" if keyword == "CD" else "wavelength_range"
    if field in entry:
        raise PrescriptionError(f"{keyword} stands twice for {entry['name']}; remove one of them")
    numbers = _numbers(keyword, content)
    if keyword == "LD":
        if len(numbers) != 2:
            raise PrescriptionError(f"LD has {len(numbers)} numbers; it must have the shortest and longest wavelength")
        numbers = tuple(1e3 * micrometres for micrometres in numbers)
    entry[field] = numbers


def _transmission_rows(content: str) -> Iterator[tuple[float, float, float]]:
    """Row of a line IT in nm and mm; none if its numbers are not a wavelength, a transmittance and a thickness."""
    try:
        micrometres, transmittance, thickness = (parse_number(word, "IT") for word in content.split()[:3])
    except (PrescriptionError, ValueError):
        return
    if 0.0 < micrometres < math.inf and 0.0 <= transmittance <= 1.0 and 0.0 < thickness < math.inf:
        yield 1e3 * micrometres, transmittance, thickness


def _numbers(keyword: str, content: str) -> tuple[float, ...]:
    return tuple(parse_number(word, keyword) for word in content.split())


def _medium(entry: GlassEntry) -> Medium:
    medium = _dispersive_medium(entry)
    # Of several thicknesses at a wavelength, the largest states absorption best.
    rows = {wavelength: (wavelength, passed, mm) for wavelength, passed, mm in sorted(entry.transmission, key=_size)}
    return AbsorbingGlass(medium, *zip(*(rows[nm] for nm in sorted(rows)), strict=True)) if rows else medium


def _size(row: tuple[float, float, float]) -> float:
    return row[2]


def _dispersive_medium(entry: GlassEntry) -> Medium:
    if entry.formula == _MODEL_GLASS:
        return ModelGlass(entry.nd, entry.vd, entry.name)
    if entry.formula not in COEFFICIENT_COUNTS:
        raise PrescriptionError(f"formula is {entry.formula}; supported ones are 1 to {max(Formula)}")
    if not entry.coefficients or not entry.wavelength_range:
        raise PrescriptionError("it has no line CD or no line LD; give its coefficients and its range of wavelengths")
    medium = _by_formula(entry, Formula(entry.formula))
    shortest, longest = entry.wavelength_range
    if entry.nd > 1.0 and shortest <= D_LINE <= longest:  # makers of infrared glasses write 1 for none
        index = medium.index(D_LINE)
        if abs(index - entry.nd) > _MAX_DISAGREEMENT:
            raise PrescriptionError(
                f"its formula gives n_d {index:.6g} and its line NM {entry.nd:.6g}; correct its coefficients or its n_d"
            )
        if entry.vd > 0 and shortest <= F_LINE and longest >= C_LINE:
            vd = abbe_number(medium)
            if abs(entry.vd - vd) > max(_MAX_V_ERROR * vd, _V_ROUNDING):
                raise PrescriptionError(
                    f"its formula gives V_d {vd:.4g} and its line NM {entry.vd:.4g}; correct one of them"
                )
    return medium


def _by_formula(entry: GlassEntry, formula: Formula) -> Medium:
    count = COEFFICIENT_COUNTS[formula]
    numbers = entry.coefficients[:count]
    if len(numbers) < count:
        raise PrescriptionError(
            f"CD has {len(numbers)} coefficients, and formula {int(formula)} needs {count}; write 0 where one is 0"
        )
    limits: Any = entry.wavelength_range
    if formula == Formula.SCHOTT:
        return Schott(numbers, entry.name, limits)
    if formula in (Formula.SELLMEIER_1, Formula.SELLMEIER_3, Formula.SELLMEIER_5):
        terms = [(b, c) for b, c in zip(numbers[::2], numbers[1::2], strict=True) if b] or [(0.0, 0.0)]
        return Sellmeier([b for b, _ in terms], [c for _, c in terms], entry.name, limits)
    return DispersionFormula(formula, numbers, entry.name, limits)
