"""Media of lens files by glass code, by name, and by index and V-number."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from plenoptic.core.values import wrong_kind
from plenoptic.errors import InvalidValueError, PrescriptionError
from plenoptic.optics.glass.bundled import bundled_glass
from plenoptic.optics.glass.catalogue import GlassCatalogue
from plenoptic.optics.glass.media import ConstantMedium, Medium, ModelGlass

_SMALLEST_CODE = 0.25
"""The first half of a code is n_d - 1 from here on, n_d - 2 below."""


def model_medium(nd: float, vd: float) -> Medium:
    """Model glass of an index and a V-number; without dispersion if the V-number is 0."""
    return ModelGlass(nd, vd) if vd != 0 and nd != 1 else ConstantMedium(nd)


def medium_of_code(name: str) -> Medium | None:
    """Model glass of a code, None for other names.

    The codes 517642, 517.642 and 517000.642000 are n_d 1.517 and V_d 64.2; 1.5168:64.17 states both numbers.
    """
    if pair := re.fullmatch(r"([0-9]\.[0-9]+):([0-9]+\.?[0-9]*)", name):
        return model_medium(float(pair[1]), float(pair[2]))
    code = re.fullmatch(r"([0-9]{3})\.?([0-9]{3})|([0-9]{3,9})\.([0-9]{3,9})", name)
    if code is None:
        return None
    first, second = code[1] or code[3], code[2] or code[4]
    fraction = float(f"0.{first}")
    return ModelGlass(fraction + (1.0 if fraction > _SMALLEST_CODE else 2.0), float(f"{second[:2]}.{second[2:]}"))


class GlassNames(NamedTuple):
    """Catalogues for the lookup of glasses by name."""

    first: Mapping[str, Medium] | GlassCatalogue
    makers: Sequence[str] = ()
    """Names of the bundled catalogues that are looked up next."""

    @classmethod
    def of(cls, glasses: Mapping[str, Medium] | GlassCatalogue | None, makers: Sequence[str] = ()) -> GlassNames:
        """Lookup that begins with the catalogue of the caller."""
        if isinstance(glasses, str) or not (glasses is None or hasattr(glasses, "__getitem__")):
            example = 'pl.optics.load_glasses("schott.agf")'
            raise wrong_kind(glasses, "glasses", "mapping from names to media", example)
        return cls({} if glasses is None else glasses, makers)

    def medium(self, name: str) -> Medium:
        """Medium of a name or a code."""
        if name in self.first:
            return self.first[name]
        if (medium := medium_of_code(name)) is not None:
            return medium
        try:
            return bundled_glass(name, self.makers)
        except PrescriptionError:
            raise
        except InvalidValueError as error:
            origin = f"; the file names the catalogues {' '.join(self.makers)[:80]}" if self.makers else ""
            unknown = str(error).partition("; pl.optics.glass_names()")[0]
            raise PrescriptionError(
                f"{unknown}{origin}: give the maker's AGF file, load_lens(path, glasses=pl.optics.load_glasses(agf))"
            ) from None
