"""Materials as columns of numbers; see `scene.materials.record`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.scene.materials.record import (
    CONDUCTOR,
    DIELECTRIC,
    LAMBERTIAN,
    METALLIC_ROUGHNESS,
    THIN_DIELECTRIC,
    Alpha,
    Bsdf,
)
from plenoptic.scene.materials.registry import MATERIALS, Material
from plenoptic.scene.materials.row import MaterialRow
from plenoptic.scene.textures.color import Colour
from plenoptic.scene.textures.record import TextureColumn
from plenoptic.scene.textures.texture import Texture

_ROUGHNESSES, _COSINES, _DRAWS = 41, 49, 32


def bsdf_record(materials: Sequence[Material], channels: int) -> Bsdf | None:
    """How materials scatter light; None where none does."""
    rows = [material.row() for material in materials]
    if not any(row.reflects for row in rows):
        return None
    kinds = np.array([MATERIALS[type(material)] for material in materials], dtype=np.int64)
    there = set(kinds.tolist())
    plain = there <= {LAMBERTIAN}
    # All metals share the column; those of constant reflectance have zeros there.
    metals = np.array([np.broadcast_to(row.metal_index, 3)[:channels] for row in rows], dtype=np.complex128)
    return Bsdf(
        scatters=_fixed(np.array([row.reflects for row in rows], dtype=np.uint8)),
        takes_light=_fixed(np.array([row.takes_light for row in rows], dtype=np.uint8)),
        base_color=_fixed(color_rows([_plain(row.base) for row in rows], channels)),
        roughness=None if plain else _fixed(_numbers([row.roughness for row in rows])),
        kind=None if plain else _fixed(kinds),
        metallic=_fixed(_numbers([row.metallic for row in rows])) if METALLIC_ROUGHNESS in there else None,
        metal_index=_fixed(np.stack([metals.real, metals.imag], axis=-1)) if CONDUCTOR in there else None,
        glass_index=_fixed(np.array([row.glass_index for row in rows])) if DIELECTRIC in there else None,
        pane_index=_fixed(np.array([row.pane_index for row in rows])) if THIN_DIELECTRIC in there else None,
        coupling=_layer_coupling() if METALLIC_ROUGHNESS in there else None,
    )


def alpha_record(rows: Sequence[MaterialRow], texture: TextureColumn | None) -> Alpha | None:
    """For which paths materials are there; None where all are opaque."""
    opacity = _numbers([row.opacity for row in rows])
    if np.all(opacity == 1):
        return None
    cutoff = np.array([-1.0 if row.cutoff is None else row.cutoff for row in rows])
    return Alpha(_fixed(opacity), _fixed(cutoff), texture)


def color_rows(colors: Sequence[Colour], channels: int) -> NDArray[np.float64]:
    """(n, C): grey scenes keep the one value that all channels share."""
    rows = np.array([np.broadcast_to(c, 3) for c in colors], dtype=np.float64).reshape(-1, 3)
    return rows[:, :channels].copy()


def _plain(color: Colour | Texture) -> Colour:
    return 1.0 if isinstance(color, Texture) else color


def _numbers(shares: Sequence[float | Texture]) -> NDArray[np.float64]:
    """(materials,): 0 where a texture gives the number."""
    return np.array([0.0 if isinstance(share, Texture) else share for share in shares])


@cache
def _layer_coupling() -> NDArray[np.float64]:
    """What passes the layer of a METALLIC_ROUGHNESS material of reflectance 0.04, with its means in the last column.

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
    return _fixed(np.column_stack([passed, mean]))


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
