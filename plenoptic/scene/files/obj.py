"""The materials of OBJ files (MTL)."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from plenoptic.core.color.srgb import Encoding
from plenoptic.core.files.file_limits import FileReader
from plenoptic.core.files.text_lines import decode_text
from plenoptic.core.warn import warn
from plenoptic.errors import FileError, FileWarning, PlenopticError
from plenoptic.scene.files.file_materials import REPLACE, colour_of, dark_or_not, file_texture, number_or_texture, times
from plenoptic.scene.materials.conductor import Conductor
from plenoptic.scene.materials.dielectric import Dielectric, ThinGlass
from plenoptic.scene.materials.diffuse import Lambertian
from plenoptic.scene.materials.emissive import Emissive
from plenoptic.scene.materials.metallic_roughness import MetallicRoughness
from plenoptic.scene.materials.registry import Material
from plenoptic.scene.textures.color import Colour
from plenoptic.scene.textures.texture import Texture, Wrap

Said = Mapping[str, str]
"""Properties of a material in a file: keywords in lower case, and their values."""

_REFLECTING, _PANES, _BODIES = (3, 5, 8), (4, 9), (6, 7)
_PBR = ("pr", "pm", "map_pr", "map_pm")
_ALPHA = 3
_NONE = ("", "none", "(null)")
"""Names by which programs say that faces have no material."""


def read_mtl(text: str) -> dict[str, dict[str, str]]:
    """The materials that a file describes, by their names."""
    materials: dict[str, dict[str, str]] = {}
    material: dict[str, str] = {}
    for line in text.splitlines():
        keyword, _, said = line.split("#")[0].strip().replace("\t", " ").partition(" ")
        if keyword.lower() == "newmtl":
            material = materials[" ".join(said.split())] = {}
        elif keyword:
            material[keyword.lower()] = said.strip()
    return materials


def obj_materials(
    file_name: str, libraries: Iterable[str], labels: Iterable[str], reader: FileReader
) -> Mapping[str, Material]:
    """The materials of an OBJ file, by their labels, that its libraries describe; a warning if some are missing."""
    described: dict[str, dict[str, str]] = {}
    missing = []
    for library_name in dict.fromkeys(libraries):
        # A name may hold spaces, and a line several names.
        names = library_name.split()
        for name in [library_name] if len(names) < 2 or os.path.isfile(reader.resolve(library_name)) else names:
            library = reader.resolve(name)
            if os.path.lexists(library):
                described |= read_mtl(decode_text(reader.read(library)))
            else:
                missing.append(name)
    lacking = [label for label in labels if label not in described and label.lower() not in _NONE]
    if missing:
        warn(
            f"{file_name}: its material file {missing[0]!r} is missing, and the surfaces of its materials are grey; "
            f"put it beside the file, {REPLACE}",
            FileWarning,
        )
    elif lacking:
        other_cases = [name for name in described if name.lower() == lacking[0].lower()]
        warn(
            f"{file_name}: its material {lacking[0]!r} is in none of its material files, and its surfaces are grey"
            f"{f', though they have {other_cases[0]!r}' if other_cases else ''}; correct the name, {REPLACE}",
            FileWarning,
        )
    return {name: obj_material(name, described[name], reader) for name in labels if name in described}


def obj_material(name: str, said: Said, reader: FileReader) -> Material:
    """Material of this package nearest to one of an OBJ file.

    The first row that fits counts. alpha is sqrt(2 / (Ns + 2)), the width of the GGX distribution that is nearest to
    Blinn's with the exponent Ns. Colours times images; images of colours are sRGB, those of single numbers linear.

    ============================================================  ====================================================
    in the file                                                   becomes
    ============================================================  ====================================================
    illum 6 or 7, and d < 1 or Tf > 0                             `Dielectric` of index Ni (1.5), polished
    illum 4 or 9, and Tf > 0                                      `ThinGlass` of index Ni, transmittance Tf
    Pr, Pm, map_Pr or map_Pm                                      `MetallicRoughness` of these; roughness sqrt(alpha)
                                                                  where there is no Pr
    Ke or map_Ke, no Kd or a black one                            `Emissive`
    Ks > 0, illum 2 or more or missing, Kd 0, opaque              `Conductor` of reflectance Ks and alpha
    Ks > 0, illum 3, 5 or 8                                       `MetallicRoughness`, metallic Ks / (Kd + Ks), base
                                                                  Kd (Kd + Ks) / Kd, at most 1, roughness sqrt(alpha)
    Ks > 0, illum 2 or more or missing                            `MetallicRoughness` of base Kd, roughness sqrt(alpha):
                                                                  its layer reflects 4 %, whatever Ks is
    d < 1, map_d, Ke, map_Ke or norm                              `MetallicRoughness` of base Kd, roughness 1
    all others                                                    `Lambertian` of albedo Kd (1)
    ============================================================  ====================================================

    d or 1 - Tr, times map_d, is the opacity of all `MetallicRoughness`, Ke times map_Ke their emission, norm their map
    of normals. map_d is the alpha of its image, or its grey where that has none. Ka, bump and others are left out.

    `said` is the result of `read_mtl` for it; its images are found by `reader`. A `FileError` for an invalid number and
    for an image that is missing, damaged or has options other than -clamp, a `SceneError` for numbers out of range.

    References
    ----------
    Wavefront, "MTL material format", Object Files version 4.2 (1995), appendix B; B. Walter et al., EGSR 2007,
    doi:10.2312/EGWR/EGSR07/195-206, section 6.3 (alpha and exponent).
    """
    read = _Reader(name, said, reader)
    illum = int(read.number("illum", 2.0))
    opacity, filtered, index = read.opacity(), read.colour("tf", 0.0), read.number("ni", 1.5)
    if illum in _BODIES and (np.any(filtered) or opacity != 1):
        return Dielectric(index)
    if illum in _PANES and np.any(filtered):
        return ThinGlass(index, filtered)
    emission = dark_or_not(read.colour_map("ke", read.colour("ke", 1.0 if "map_ke" in said else 0.0)))
    common: dict[str, Any] = {"normal_map": read.normals(), "emission": emission, "opacity": opacity}
    if any(keyword in said for keyword in _PBR):
        base = read.colour_map("kd", read.colour("kd", 1.0))
        return MetallicRoughness(base, read.share("pm", 0.0), read.share("pr", math.sqrt(read.alpha())), **common)
    if emission != 0.0 and not np.any(read.colour("kd", 1.0 if "map_kd" in said else 0.0)):
        return Emissive(emission)
    return _reflecting(read, illum, common)


def _reflecting(read: _Reader, illum: int, rest: Mapping[str, Any]) -> Material:
    """Rows of the table for surfaces that reflect by Kd and Ks; `rest` holds other numbers of `MetallicRoughness`."""
    diffuse, glossy = read.colour("kd", 1.0), read.colour("ks", 0.0)
    plain = rest == {"normal_map": None, "emission": 0.0, "opacity": 1.0}
    if not np.any(glossy) or illum < 2:
        base = read.colour_map("kd", diffuse)
        return Lambertian(base) if plain else MetallicRoughness(base, 0.0, 1.0, **rest)
    if plain and not np.any(diffuse):
        return Conductor(glossy, read.alpha())
    metallic = 0.0
    if illum in _REFLECTING and np.any(diffuse):
        scattered, mirrored = float(np.mean(diffuse)), float(np.mean(glossy))
        whole = np.broadcast_to(diffuse, 3) * ((scattered + mirrored) / scattered)
        diffuse, metallic = colour_of(np.minimum(whole, 1.0)), mirrored / (scattered + mirrored)
    return MetallicRoughness(read.colour_map("kd", diffuse), metallic, math.sqrt(read.alpha()), **rest)


class _Reader:
    """The numbers and images of one material."""

    def __init__(self, name: str, said: Said, reader: FileReader) -> None:
        self._name, self._said, self._reader = name, said, reader

    def colour(self, keyword: str, default: float) -> Colour:
        """One number or three."""
        if keyword not in self._said:
            return default
        try:
            parts = [float(word) for word in self._said[keyword].split()]
        except ValueError:
            parts = []
        if len(parts) not in (1, 3):
            raise FileError(
                f"its material file says {keyword.capitalize()} {self._said[keyword]} of {self._name!r}; that must be "
                f"one number or three, so correct it, {REPLACE}"
            )
        return colour_of(np.broadcast_to(parts, 3))

    def number(self, keyword: str, default: float) -> float:
        """One number; the mean of several."""
        return float(np.mean(self.colour(keyword, default)))

    def alpha(self) -> float:
        """The width of the GGX distribution for the exponent Ns."""
        return math.sqrt(2 / (self.number("ns", 0.0) + 2))

    def colour_map(self, keyword: str, colour: Colour) -> Colour | Texture:
        """A colour times the image of it."""
        image = self.image(f"map_{keyword}", Encoding.SRGB) if np.any(colour) else None
        return colour if image is None else times(image, colour)

    def share(self, keyword: str, default: float) -> float | Texture:
        """A number times the image of it."""
        image = self.image(f"map_{keyword}", Encoding.LINEAR, 0)
        number = self.number(keyword, default if image is None else 1.0)
        return number if image is None else number_or_texture(times(image, number))

    def normals(self) -> Texture | None:
        """The map of normals."""
        return self.image("norm", Encoding.LINEAR)

    def opacity(self) -> float | Texture:
        """1 for opaque surfaces."""
        number = self.number("d", 1 - self.number("tr", 0.0))
        image = self.image("map_d", Encoding.LINEAR, _ALPHA)
        if image is None or number == 0:
            return number
        if image.texels.min() == 1 and self._said["map_d"] != self._said.get("map_kd"):
            image = self.image("map_d", Encoding.LINEAR, 0)
            assert image is not None
        return number_or_texture(times(image, number))

    def image(self, keyword: str, encoding: Encoding, channel: int | None = None) -> Texture | None:
        """An image, or one channel of it; None where the file has none."""
        if keyword not in self._said:
            return None
        words, wrap = self._said[keyword].split(), Wrap.REPEAT
        path = self._said[keyword]
        if words[:1] == ["-clamp"]:
            wrap = Wrap.CLAMP if words[1:2] == ["on"] else Wrap.REPEAT
            path = " ".join(words[2:])
        if path.startswith("-") or not path:
            raise FileError(f"the image {path!r} of material {self._name!r} has options; bake them, {REPLACE}")
        try:
            return file_texture(self._reader, path, encoding=encoding, channel=channel, wrap=wrap)
        except PlenopticError as error:
            raise FileError(
                f"the texture {path!r} of material {self._name!r} is missing or not an image ({error}); put it beside "
                f"the file, {REPLACE}"
            ) from None
