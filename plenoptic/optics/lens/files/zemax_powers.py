"""Powers of r in the aspheres of a Zemax file: even ones as `Surface.aspheric`, odd ones as `OddPowerSag`."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from plenoptic.errors import PrescriptionError
from plenoptic.optics.surfaces.odd_powers import OddPowerSag

EXTENDED = {"XASPHERE": 2, "XOSPHERE": 1}
"""Types with XDAT: step of the powers of r from term to term."""
ODD = "ODDASPHE"
"""The type whose PARM 1, 2, ... are of r, r^2, ...; those of other types are of r^2, r^4, ..."""
_MAX_TERMS = 240


def even_and_odd_powers(
    kind: str, parameters: Mapping[int, float], extra: Mapping[int, float], unit: float
) -> tuple[tuple[float, ...], OddPowerSag | None]:
    """Coefficients of r^2, r^4, ..., and the term of r^3, r^5, ..., of a surface with PARM and XDAT in units of the
    file, of `unit` mm.
    """
    if kind in EXTENDED and extra.get(1, 0.0) != 0:
        step, terms, keyword, first = EXTENDED[kind], _extended_terms(extra, kind), "XDAT", 3
    elif kind == "XOSPHERE" and any(parameters.values()):
        raise PrescriptionError("PARM of an XOSPHERE is not read; give its XDAT")
    else:
        step, terms, keyword, first = 1 if kind == ODD else 2, dict(parameters), "PARM", 1
    # z and r have the same scale: a coefficient of r^p is in unit^(1 - p).
    of_power = {step * i: term * unit ** (1 - step * i) for i, term in terms.items() if term != 0}
    if 1 in of_power:
        raise PrescriptionError(
            f"{kind} has a term of r ({keyword} {first}), a cone, which has no normal at its vertex; only powers from "
            "r^2 on can be read: set it to 0"
        )
    last = max(of_power, default=0)
    odd = [of_power.get(p, 0.0) for p in range(3, last + 1, 2)]
    even = tuple(of_power.get(p, 0.0) for p in range(2, last + 1, 2))
    return even, OddPowerSag(odd) if any(odd) else None


@np.errstate(all="ignore")
def _extended_terms(extra: Mapping[int, float], kind: str) -> dict[int, float]:
    """Coefficients of the terms of an extended asphere by their number, in units of the file."""
    count, norm = extra[1], extra.get(2, 0.0)
    if not (count.is_integer() and 0 < count <= _MAX_TERMS and norm > 0 and count + 2 in extra):
        raise PrescriptionError(
            f"{kind} has {count:g} terms (XDAT 1), norm radius {norm:g} (XDAT 2) and XDAT up to {max(extra)}; it must "
            f"have 1 to {_MAX_TERMS} terms, a radius above 0, and all terms from XDAT 3 on"
        )
    powers = np.float64(norm) ** (EXTENDED[kind] * np.arange(int(count) + 1))  # may overflow: refused by the surface
    return {i: float(a / powers[i]) for i in range(1, int(count) + 1) if (a := extra.get(i + 2, 0.0)) != 0}
