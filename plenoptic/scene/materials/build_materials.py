"""Materials as columns of numbers; see `scene.materials.material_records`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from plenoptic.core.values import Floats, contiguous
from plenoptic.scene.materials.material_records import EXTRA_SHARES, INSIDE, SHARES, Alpha, Bsdf, MaterialRow, Media
from plenoptic.scene.materials.medium import Medium
from plenoptic.scene.materials.registry import CONDUCTOR, DIELECTRIC, LAMBERTIAN, MATERIALS, THIN_DIELECTRIC, Material
from plenoptic.scene.textures.color import Colour
from plenoptic.scene.textures.texture import Texture
from plenoptic.scene.textures.texture_records import TextureColumn


def bsdf_record(materials: Sequence[Material], channels: int) -> Bsdf | None:
    """Compile the BSDFs of materials; None where none scatters."""
    rows = [material.row() for material in materials]
    if not any(row.reflects for row in rows):
        return None
    kinds = np.array([MATERIALS[type(material)] for material in materials], dtype=np.int64)
    colors = [1.0 if isinstance(row.base_color, Texture) else row.base_color for row in rows]
    # All metals share the column; those of constant reflectance have zeros there.
    metals = np.array([np.broadcast_to(row.metal_index, 3)[:channels] for row in rows], dtype=np.complex128)
    extra = _shares([getattr(row, name) for row in rows for name in EXTRA_SHARES])
    tables = {name: table for makes in {row.tables for row in rows} for name, table in makes().items()}
    return Bsdf(
        scatters=contiguous(np.array([row.reflects for row in rows], dtype=np.uint8)),
        takes_light=contiguous(np.array([row.takes_light for row in rows], dtype=np.uint8)),
        base_color=color_rows(colors, channels),
        kind=contiguous(kinds) if np.any(kinds != LAMBERTIAN) else None,
        metal_index=contiguous(np.stack([metals.real, metals.imag], axis=-1)) if CONDUCTOR in kinds else None,
        glass_index=contiguous(np.array([row.glass_index for row in rows])) if DIELECTRIC in kinds else None,
        pane_index=contiguous(np.array([row.pane_index for row in rows])) if THIN_DIELECTRIC in kinds else None,
        **{name: _shares([getattr(row, name) for row in rows]) for name in SHARES},
        extra_shares=None if extra is None else extra.reshape(len(rows), -1),
        **tables,
    )


def media_records(
    rows: Sequence[MaterialRow], lit: Sequence[bool], medium: Medium | None, channels: int
) -> tuple[Floats | None, Media | None]:
    """Compile absorption, None where nothing absorbs or scatters, and media, None where none scatters.

    `lit` says which materials have bodies with a light in them. The medium of the scene is the last row.
    """
    absorption, scattering = [row.absorption for row in rows], [row.scattering for row in rows]
    asymmetry, index = [row.asymmetry for row in rows], [row.glass_index[INSIDE] or 1.0 for row in rows]
    if medium is not None:
        absorption, scattering = [*absorption, medium.absorption], [*scattering, medium.scattering]
        asymmetry, index, lit = [*asymmetry, medium.phase.g], [*index, 1.0], [*lit, True]
    absorbed, scattered = color_rows(absorption, channels), color_rows(scattering, channels)
    if not np.any(scattered):
        return absorbed if np.any(absorbed) else None, None
    of_rows = contiguous(np.array(asymmetry)), contiguous(np.square(index)), contiguous(np.array(lit, dtype=np.uint8))
    return absorbed, Media(scattered, contiguous(absorbed + scattered), *of_rows)


def alpha_record(rows: Sequence[MaterialRow], texture: TextureColumn | None) -> Alpha | None:
    """Opacity of the materials; None if all are opaque."""
    opacity = _shares([row.opacity for row in rows])
    if opacity is None or np.all(opacity == 1):
        return None
    cutoff = np.array([-1.0 if row.cutoff is None else row.cutoff for row in rows])
    return Alpha(opacity, contiguous(cutoff), texture)


def color_rows(colors: Sequence[Colour], channels: int) -> Floats:
    """(n, C), read-only: grey scenes keep the one value that all channels share."""
    rows = np.array([np.broadcast_to(c, 3) for c in colors], dtype=np.float64).reshape(-1, 3)
    return contiguous(rows[:, :channels])


def _shares(shares: Sequence[float | Texture | None]) -> Floats | None:
    """Shares as numbers: 0 where a texture gives one, or a material has none; None where all have none."""
    if all(entry is None for entry in shares):
        return None
    return contiguous(np.array([entry if isinstance(entry, float) else 0.0 for entry in shares]))
