"""Materials as columns of numbers; see `scene.materials.record`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.scene.materials.conductor import Conductor
from plenoptic.scene.materials.dielectric import Dielectric, ThinGlass
from plenoptic.scene.materials.diffuse import Lambertian, RoughDiffuse
from plenoptic.scene.materials.emissive import Emissive
from plenoptic.scene.materials.metallic_roughness import MetallicRoughness
from plenoptic.scene.materials.record import (
    CONDUCTOR,
    DIELECTRIC,
    LAMBERTIAN,
    METALLIC_ROUGHNESS,
    OREN_NAYAR,
    SMOOTH,
    THIN_DIELECTRIC,
    Alpha,
    Bsdf,
)
from plenoptic.scene.materials.registry import Material
from plenoptic.scene.textures.color import Colour, is_grey
from plenoptic.scene.textures.record import TextureColumn
from plenoptic.scene.textures.texture import Texture

_KINDS: dict[type, int] = {
    Lambertian: LAMBERTIAN,
    RoughDiffuse: OREN_NAYAR,
    Conductor: CONDUCTOR,
    Dielectric: DIELECTRIC,
    ThinGlass: THIN_DIELECTRIC,
    MetallicRoughness: METALLIC_ROUGHNESS,
    Emissive: LAMBERTIAN,
}
_ROUGHNESSES, _COSINES, _DRAWS = 41, 49, 32


def bsdf_record(materials: Sequence[Material], channels: int) -> Bsdf | None:
    """How materials scatter light; None where none does."""
    if not any(map(reflects, materials)):
        return None
    kinds = np.array([_KINDS[type(material)] for material in materials], dtype=np.int64)
    plain = bool(np.all(kinds == LAMBERTIAN))
    glass = [(m.index, m.exterior) if isinstance(m, Dielectric) else (0.0, 0.0) for m in materials]
    panes = [m.index if isinstance(m, ThinGlass) else 0.0 for m in materials]
    layered = bool(np.any(kinds == METALLIC_ROUGHNESS))
    return Bsdf(
        scatters=_fixed(np.array([*map(reflects, materials)], dtype=np.uint8)),
        takes_light=_fixed(np.array([*map(takes_light, materials)], dtype=np.uint8)),
        base_color=_fixed(color_rows([_plain(base_colour(m)) for m in materials], channels)),
        roughness=None if plain else _fixed(np.array([*map(roughness_of, materials)])),
        kind=None if plain else _fixed(kinds),
        metallic=_fixed(np.array([*map(_metallic, materials)])) if layered else None,
        # All metals share the column; those of constant reflectance have zeros there.
        metal_index=_fixed(_metal_indices(materials, channels)) if np.any(kinds == CONDUCTOR) else None,
        glass_index=_fixed(np.array(glass)) if np.any(kinds == DIELECTRIC) else None,
        pane_index=_fixed(np.array(panes)) if np.any(kinds == THIN_DIELECTRIC) else None,
        coupling=_layer_tables()[0] if layered else None,
        coupling_mean=_layer_tables()[1] if layered else None,
    )


def alpha_record(materials: Sequence[Material], texture: TextureColumn | None) -> Alpha | None:
    """For which paths materials are there; None where all are opaque."""
    opacity, cutoff = np.ones(len(materials)), np.full(len(materials), -1.0)
    for row, material in enumerate(materials):
        if isinstance(material, MetallicRoughness):
            opacity[row] = material.opacity if isinstance(material.opacity, float) else 0.0
            if material.cutoff is not None:
                cutoff[row] = material.cutoff
    return None if np.all(opacity == 1) else Alpha(_fixed(opacity), _fixed(cutoff), texture)


def color_rows(colors: Sequence[Colour], channels: int) -> NDArray[np.float64]:
    """(n, C): grey scenes keep the one value that all channels share."""
    rows = np.array([np.broadcast_to(c, 3) for c in colors], dtype=np.float64).reshape(-1, 3)
    return rows[:, :channels].copy()


def _plain(colour: Colour | Texture) -> Colour:
    return 1.0 if isinstance(colour, Texture) else colour


def _metallic(material: Material) -> float:
    metallic = material.metallic if isinstance(material, MetallicRoughness) else 0.0
    return metallic if isinstance(metallic, float) else 0.0


def _metal_indices(materials: Sequence[Material], channels: int) -> NDArray[np.float64]:
    rows = np.zeros((len(materials), channels, 2))
    for row, material in zip(rows, materials, strict=True):
        if isinstance(material, Conductor) and material.index is not None:
            index = np.broadcast_to(np.asarray(material.index, dtype=np.complex128), 3)[:channels]
            row[:, 0], row[:, 1] = index.real, index.imag
    return rows


def base_colour(material: Material) -> Colour | Texture:
    """The colour that a material multiplies light by."""
    if isinstance(material, Lambertian | RoughDiffuse):
        return material.albedo
    if isinstance(material, Conductor):
        return material.reflectance
    if isinstance(material, ThinGlass):
        return material.transmittance
    if isinstance(material, MetallicRoughness):
        return material.base
    return 1.0 if isinstance(material, Dielectric) else 0.0


def absorption_of(material: Material) -> Colour:
    """Absorption per mm behind the front of a material."""
    return material.absorption if isinstance(material, Dielectric) else 0.0


def has_grey_index(material: Material) -> bool:
    """Whether a metal's index is the same for all channels."""
    index = material.index if isinstance(material, Conductor) else None
    return not isinstance(index, tuple) or len(set(index)) == 1


def reflects(material: Material) -> bool:
    """Whether a material gives back any light that meets it."""
    colour = base_colour(material)
    if isinstance(material, ThinGlass | MetallicRoughness):
        return True
    return isinstance(colour, Texture) or bool(np.any(colour))


def roughness_of(material: Material) -> float:
    """The number by which a material is rough; 0 where a texture says so."""
    if isinstance(material, Conductor | Dielectric):
        return material.alpha
    if isinstance(material, RoughDiffuse | MetallicRoughness):
        return material.roughness if isinstance(material.roughness, float) else 0.0
    return 0.0


def takes_light(material: Material) -> bool:
    """Whether light that is drawn directly can be scattered by a material: not by mirrors and polished glass."""
    if isinstance(material, Conductor | Dielectric):
        return material.alpha >= SMOOTH
    return not isinstance(material, ThinGlass) and reflects(material)


def all_grey(materials: Sequence[Material]) -> bool:
    """Whether no material treats red, green and blue differently."""
    return all(is_grey(base_colour(m)) and is_grey(absorption_of(m)) and has_grey_index(m) for m in materials)


@cache
def _layer_tables() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What passes the layer of the METALLIC_ROUGHNESS kind of reflectance 0.04, and its means.

    The layer's directional albedo is the mean of F G2 / G1 over normals drawn by visibility, here at the midpoints of
    a grid of random numbers, as in `microfacets.visible_normal`.
    """
    # The root of the roughness, whose square is alpha, in equal steps: rows change fastest near polish.
    alpha = np.maximum(np.linspace(0, 1, _ROUGHNESSES) ** 4, 1e-3)[:, None, None]
    z = np.maximum(np.linspace(0, 1, _COSINES) ** 2, 1e-6)[None, :, None]
    middle = (np.arange(_DRAWS) + 0.5) / _DRAWS
    u, v = (part.ravel() for part in np.meshgrid(0.5 * middle, middle))
    x = np.sqrt(1 - z * z)
    albedo = np.stack([_layer_albedo(row, x[0], z[0], u, v) for row in alpha])
    passed = np.clip(1 - albedo, 0, 1)
    # Exact for what is linear in the root of the cosine between nodes: mean of c over 2 mu dmu = 4 r^3 dr.
    r = np.linspace(0, 1, _COSINES)
    low, high = r[:-1], r[1:]
    whole, moment = high**4 - low**4, 0.8 * (high**5 - low**5)
    slope = np.diff(passed, axis=1) / (high - low)
    mean = (passed[:, :-1] * whole + slope * (moment - low * whole)).sum(axis=1)
    return _fixed(passed), _fixed(mean)


def _layer_albedo(
    alpha: NDArray[np.float64],
    x: NDArray[np.float64],
    z: NDArray[np.float64],
    u: NDArray[np.float64],
    v: NDArray[np.float64],
) -> NDArray[np.float64]:
    """(cosines,): directional albedo of one roughness."""
    length = np.hypot(alpha * x, z)
    sx, sz = alpha * x / length, z / length
    cap = (1 - v) * (1 + sz) - sz
    radius = np.sqrt(np.maximum(0, 1 - cap * cap))
    hx, hy, hz = alpha * (radius * np.cos(2 * np.pi * u) + sx), alpha * radius * np.sin(2 * np.pi * u), cap + sz
    norm = np.sqrt(hx * hx + hy * hy + hz * hz)
    hx, hy, hz = hx / norm, hy / norm, hz / norm
    cosine = np.clip(x * hx + z * hz, 0, 1)
    ix, iy, iz = 2 * cosine * hx - x, 2 * cosine * hy, 2 * cosine * hz - z
    hidden_o = 0.5 * (np.sqrt(1 + alpha**2 * x * x / (z * z)) - 1)
    with np.errstate(divide="ignore", over="ignore"):
        hidden_i = 0.5 * (np.sqrt(1 + alpha**2 * (ix * ix + iy * iy) / (iz * iz)) - 1)
    fresnel = 0.04 + 0.96 * (1 - cosine) ** 5
    seen = np.where(iz > 0, (1 + hidden_o) / (1 + hidden_o + hidden_i), 0.0)
    return np.asarray((fresnel * seen).mean(axis=-1))


def _fixed(array: NDArray[Any]) -> NDArray[Any]:
    array = np.ascontiguousarray(array)
    array.flags.writeable = False
    return array
