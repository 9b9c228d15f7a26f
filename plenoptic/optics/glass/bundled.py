"""Glasses by name: the bundled catalogues of makers."""

from __future__ import annotations

import difflib
import functools
import importlib.resources
from collections.abc import Sequence

from plenoptic.errors import InvalidValueError
from plenoptic.optics.glass.catalogue import GlassCatalogue, glass_key, glasses_from_agf
from plenoptic.optics.glass.media import Medium

MAKERS = ("SCHOTT", "OHARA", "HOYA", "HIKARI", "CDGM", "SUMITA")
"""Order in which names without a maker are looked up, after the names of old lens tables."""

_ALSO_CALLED = {
    **dict.fromkeys(("FSILICA", "FUSEDSILICA", "SIO2"), "SILICA"),
    **dict.fromkeys(("ZNSBROAD", "CLEARTRAN"), "ZNS"),
    **{"ACRYLIC": "PMMA", "POLYCARBONATE": "POLYCARB", "POLYSTYRENE": "POLYSTYR", "TOPAS": "COC"},
    **{"H2O": "WATER", "GE": "GERMANIUM", "SI": "SILICON", "AL2O3": "SAPPHIRE", "LAFN21": "LAF21"},
}
"""Synonyms, as `glass_key` has them, and the names of the same glasses in the tables; LaFN21 is printed as LaF21 is."""

_OTHERS = "OTHERS"
"""Table of old names, crystals and plastics, in which no maker has to be named."""


def glass(name: str) -> Medium:
    """A glass by its catalogue name, with or without the maker: "N-BK7", "SCHOTT N-BK7".

    The catalogues of Schott, Ohara, Hoya, Nikon-Hikari, CDGM and Sumita are bundled, some 1600 glasses, and also
    fused silica, water, the usual plastics, crystals, infrared media and adhesives, and the glasses of old lens
    tables; F_SILICA and ACRYLIC of Zemax are SILICA (I. H. Malitson, J. Opt. Soc. Am. 55, 1205 (1965)) and PMMA. A
    name without a maker is looked up in the latter tables first, then in the makers' catalogues in this order: BAF2
    is barium fluoride. CDGM's names without a hyphen (BAF2, F3, ZF2) need the maker, because they are other glasses
    elsewhere. The coefficients are the makers' (refractiveindex.info, CC0) and come with their range of
    wavelengths; `pl.optics.bundled_glasses("SCHOTT").entry("N-BK7").source` states their origin. Glasses without
    published coefficients are a `ModelGlass`, and their source begins with MODEL. Indices are relative to air at 20
    deg C.

    Parameters
    ----------
    name : str
        Case, '-', '_' and spaces are ignored, but N-BK7 and BK7 are two glasses.

    Raises
    ------
    InvalidValueError
        If there is none of that name; the message lists similar names.

    Examples
    --------
    >>> import plenoptic as pl
    >>> round(pl.glass("N-SF11").index(587.5618), 5)
    1.78472
    >>> pl.glass("SCHOTT SF11") == pl.glass("SF11"), pl.glass("HIKARI SF11") == pl.glass("SF11")
    (True, False)
    >>> pl.glass("S-FPL51").name
    'S-FPL51'
    """
    return bundled_glass(name, ())


def bundled_glass(name: str, first: Sequence[str]) -> Medium:
    """The glass of that name; one without a maker is looked up in the catalogues `first`, if they are bundled.

    These have the maker in their names, as files have them: NIKON-HIKARI, CDGM-ZEMAX201904.
    """
    if not isinstance(name, str):
        raise InvalidValueError(f"the name of a glass is {name!r:.40}; it must be a text, such as 'N-BK7'")
    name = _ALSO_CALLED.get(glass_key(name), name)
    key = glass_key(name)
    makers = [maker for maker in MAKERS if key.startswith(maker) and key != maker]
    for maker in makers:
        if key.removeprefix(maker) in bundled_glasses(maker):
            return bundled_glasses(maker)[key.removeprefix(maker)]
    preferred = [maker for file in first for maker in MAKERS if maker in file.upper().replace("NIKON", "HIKARI")]
    for maker in dict.fromkeys((*preferred, _OTHERS, *MAKERS)):
        if key in bundled_glasses(maker) and (maker in preferred or _is_unambiguous(key, maker)):
            return bundled_glasses(maker)[name]
    raise InvalidValueError(
        f"there is no glass {name[:40]!r} in the bundled catalogues{_similar_names(name)}; pl.optics.glass_names() "
        "lists all, pl.optics.load_glasses(path)[name] takes it from a maker's AGF file"
    )


def _similar_names(name: str) -> str:
    """Names similar to one that is missing, as the end of a sentence."""
    similar: dict[str, str] = {}
    for maker in (_OTHERS, *MAKERS):
        for candidate in bundled_glasses(maker).close_to(name):
            key = glass_key(candidate)
            similar.setdefault(key, candidate if _is_unambiguous(key, maker) else f"{maker} {candidate}")
    nearest = [similar[key] for key in difflib.get_close_matches(glass_key(name)[:40], similar, n=4, cutoff=0.5)]
    return f"; near to it are {', '.join(nearest)}" if nearest else ""


def _is_unambiguous(key: str, maker: str) -> bool:
    """True if the name alone means the glass of that maker: CDGM's F3 and ZF2 are other glasses in lens tables."""
    return maker != "CDGM" or "-" in bundled_glasses(maker).entry(key).name


def glass_names() -> tuple[str, ...]:
    """Names of the bundled glasses, in alphabetical order, for `glass`.

    A glass whose name without maker means another glass has its maker in front.

    Examples
    --------
    >>> import plenoptic as pl
    >>> names = pl.optics.glass_names()
    >>> "SF10" in names, "HIKARI SF10" in names, "N-BK7" in names, len(names) > 1500
    (True, True, True, True)
    """
    names: dict[str, str] = {}
    for maker in (_OTHERS, *MAKERS):
        for key, name in {glass_key(name): name for name in bundled_glasses(maker).names}.items():
            if key not in names and _is_unambiguous(key, maker):
                names[key] = name
            else:
                names[maker + key] = f"{maker} {name}"
    return tuple(sorted(names.values()))


def bundled_glasses(maker: str) -> GlassCatalogue:
    """The bundled catalogue of a maker, with its entries and their sources.

    Parameters
    ----------
    maker : str
        SCHOTT, OHARA, HOYA, HIKARI, CDGM or SUMITA; OTHERS: the table of old names, crystals and plastics.

    Returns
    -------
    GlassCatalogue

    Raises
    ------
    InvalidValueError
        If the maker is none of these.

    Examples
    --------
    >>> import plenoptic as pl
    >>> entry = pl.optics.bundled_glasses("SCHOTT").entry("N-BK7")
    >>> entry.nd, entry.vd, entry.wavelength_range
    (1.5168, 64.17, (300.0, 2500.0))
    """
    if not isinstance(maker, str) or maker not in (*MAKERS, _OTHERS):
        raise InvalidValueError(f"maker is {maker!r:.40}; it must be one of {', '.join((*MAKERS, _OTHERS))}")
    return _read(maker)


@functools.cache
def _read(maker: str) -> GlassCatalogue:
    file = importlib.resources.files("plenoptic.optics.glass") / "data" / f"{maker.lower()}.agf"
    text = file.read_text(encoding="utf-8")
    source = text.partition("\n")[0].removeprefix("CC ")
    return glasses_from_agf(text, f"the bundled catalogue {maker}", source=source)
