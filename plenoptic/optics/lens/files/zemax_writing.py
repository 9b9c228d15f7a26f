"""Lenses as sequential Zemax files, for other programs."""

from __future__ import annotations

import codecs
import math

from plenoptic.core.warn import warn
from plenoptic.errors import FileWarning, InvalidValueError, PrescriptionError
from plenoptic.optics.glass.absorption import AbsorbingGlass
from plenoptic.optics.glass.bundled import glass
from plenoptic.optics.glass.media import AIR, C_LINE, D_LINE, F_LINE, Medium, ModelGlass, abbe_number
from plenoptic.optics.lens.elements import Element
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.stops.circle import CircularStop
from plenoptic.optics.surfaces.mirror import Mirror
from plenoptic.optics.surfaces.surface import Surface

_TERMS = 8


def zmx_of_lens(lens: LensStack) -> bytes:
    """A lens as the content of a Zemax file: UTF-16 with its mark, lines that end in CR LF, millimetres.

    Each surface has its semi-diameter as a fixed aperture (FLAP), which clips rays as in this package. The system
    aperture floats by the stop (FLOA). The image lies in the rear focus at 587.6 nm. A medium with the indices of the
    bundled glass of its name, to 1e-6 at the lines F, d and C, is written by name. Any other is written as a model
    glass of its n_d and V_d.
    """
    points = cardinal_points(lens)
    last = float(lens.vertices[-1])
    to_image = points.rear_focus - last if math.isfinite(points.rear_focus) else 0.0
    lines = ["MODE SEQ", f"NAME {_one_line(lens.name)}", f"NOTE 0 {_one_line(lens.source)}", "UNIT MM X W X CM MR CPMM"]
    lines += ["FLOA", "FTYP 0 0 1 3 0 0 0", "XFLN 0.0", "YFLN 0.0"]
    lines += [f"WAVM {i} {wave / 1e3!r} 1" for i, wave in enumerate((F_LINE, D_LINE, C_LINE), start=1)]
    lines += ["PWAV 2", "SURF 0", "  TYPE STANDARD", "  CURV 0.0", "  DISZ INFINITY"]
    lines += [f"  {line}" for line in _glass_lines(lens.front_medium, -1)]
    for i, element in enumerate(lens.elements):
        gap = element.thickness if i < len(lens.elements) - 1 else to_image
        lines.append(f"SURF {i + 1}")
        lines += [f"  {line}" for line in _element_lines(element, i, is_iris=i == lens.iris_index)]
        if isinstance(element, CircularStop):
            # A stop inside a glass has this glass on both sides.
            lines += [f"  {line}" for line in _glass_lines(lens.gap_media[i + 1], i)]
        lines.append(f"  DISZ {gap!r}")
    lines += [f"SURF {len(lens.elements) + 1}", "  TYPE STANDARD", "  CURV 0.0", "  DISZ 0.0"]
    return codecs.BOM_UTF16_LE + "".join(f"{line}\r\n" for line in lines).encode("utf-16-le", errors="replace")


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _element_lines(element: Element, i: int, *, is_iris: bool) -> list[str]:
    if element.placement is not None:
        raise PrescriptionError(f"element {i} is decentred or tilted, which cannot be written as .zmx; use .json")
    size = [f"DIAM {element.semi_diameter!r} 1 0 0 1", f"FLAP 0 {element.semi_diameter!r} 0"]
    if isinstance(element, CircularStop):
        return [*(["STOP"] if is_iris else []), "TYPE STANDARD", "CURV 0.0", *size]
    if not isinstance(element, Surface):
        raise PrescriptionError(f"element {i} is {element!r}; only round stops can be written as .zmx: use .json")
    refused = {
        "is a mirror": isinstance(element.medium, Mirror),
        "goes beyond its equator": element.depth is not None,
        f"has more than {_TERMS} coefficients": len(element.aspheric) > _TERMS,
        "has a freeform term": element.freeform is not None,
        "has a coating": element.coating is not None,
    }
    for reason, is_so in refused.items():
        if is_so:
            raise PrescriptionError(f"element {i} {reason}, which cannot be written as .zmx; use .json")
    lines = [f"TYPE {'EVENASPH' if element.aspheric else 'STANDARD'}", f"CURV {element.curvature!r}"]
    lines += [f"CONI {element.conic!r}"] if element.conic != 0 else []
    lines += [f"PARM {k} {a!r}" for k, a in enumerate(element.aspheric, start=1)]
    return [*lines, *_glass_lines(element.medium, i), *size]


def _glass_lines(medium: Medium, i: int) -> list[str]:
    if medium == AIR:
        return []
    if isinstance(medium, AbsorbingGlass):
        warn(f"the absorption of the medium behind element {i} is left out of the .zmx; use .json", FileWarning)
    try:
        nd, vd = float(medium.index(D_LINE)), float(abbe_number(medium))
    except InvalidValueError as error:
        raise PrescriptionError(f"the medium behind element {i} has no n_d and V_d: {error}") from None
    vd = 0.0 if math.isinf(vd) else vd
    if vd < 0:
        raise PrescriptionError(
            f"the index of the medium behind element {i} rises with the wavelength, which cannot be written as .zmx; "
            "use .json"
        )
    name = getattr(medium, "name", "")
    if name and " " not in name and not isinstance(medium, ModelGlass) and _in_bundled_catalogue(name, medium):
        return [f"GLAS {name} 0 0 {nd:.5f} {vd:.2f}"]
    if isinstance(medium, ModelGlass):
        nd, vd = medium.nd, medium.vd
    return [f"GLAS ___BLANK 1 0 {nd!r} {vd!r} 0 0 0 0 0"]


def _in_bundled_catalogue(name: str, medium: Medium) -> bool:
    try:
        bundled = glass(name)
        return all(abs(bundled.index(line) - medium.index(line)) < 1e-6 for line in (D_LINE, F_LINE, C_LINE))
    except InvalidValueError:
        return False
