"""Materials as columns of numbers; see `scene.materials.record`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.scene.materials.record import (
    CONDUCTOR,
    DIELECTRIC,
    EXTRA_SHARES,
    LAMBERTIAN,
    SHARES,
    THIN_DIELECTRIC,
    Alpha,
    Bsdf,
    MaterialRow,
)
from plenoptic.scene.materials.registry import MATERIALS, Material
from plenoptic.scene.textures.color import Colour
from plenoptic.scene.textures.record import TextureColumn
from plenoptic.scene.textures.texture import Texture


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
    tables = {name: table for makes in {row.tables for row in rows} for name, table in makes().items()}
    return Bsdf(
        scatters=_fixed(np.array([row.reflects for row in rows], dtype=np.uint8)),
        takes_light=_fixed(np.array([row.takes_light for row in rows], dtype=np.uint8)),
        base_color=_fixed(color_rows([_plain(row.base_color) for row in rows], channels)),
        kind=None if plain else _fixed(kinds),
        metal_index=_fixed(np.stack([metals.real, metals.imag], axis=-1)) if CONDUCTOR in there else None,
        glass_index=_fixed(np.array([row.glass_index for row in rows])) if DIELECTRIC in there else None,
        pane_index=_fixed(np.array([row.pane_index for row in rows])) if THIN_DIELECTRIC in there else None,
        **{name: _shares([getattr(row, name) for row in rows]) for name in SHARES},
        extra_shares=_extra_shares(rows),
        **tables,
    )


def alpha_record(rows: Sequence[MaterialRow], texture: TextureColumn | None) -> Alpha | None:
    """For which paths materials are there; None where all are opaque."""
    opacity = _shares([row.opacity for row in rows])
    if opacity is None or np.all(opacity == 1):
        return None
    cutoff = np.array([-1.0 if row.cutoff is None else row.cutoff for row in rows])
    return Alpha(opacity, _fixed(cutoff), texture)


def color_rows(colors: Sequence[Colour], channels: int) -> Floats:
    """(n, C): grey scenes keep the one value that all channels share."""
    rows = np.array([np.broadcast_to(c, 3) for c in colors], dtype=np.float64).reshape(-1, 3)
    return rows[:, :channels].copy()


def _plain(color: Colour | Texture) -> Colour:
    return 1.0 if isinstance(color, Texture) else color


def _shares(shares: Sequence[float | Texture | None]) -> Floats | None:
    """(materials,): 0 where a texture gives the number, or a material has none; None where all have none."""
    if all(share is None for share in shares):
        return None
    return _fixed(np.array([share if isinstance(share, float) else 0.0 for share in shares]))


def _extra_shares(rows: Sequence[MaterialRow]) -> Floats | None:
    columns = [_shares([getattr(row, name) for row in rows]) for name in EXTRA_SHARES]
    there = [np.zeros(len(rows)) if column is None else column for column in columns]
    return None if all(column is None for column in columns) else _fixed(np.stack(there, axis=1))


def _fixed(array: NDArray[Any]) -> NDArray[Any]:
    array = np.ascontiguousarray(array)
    array.flags.writeable = False
    return array
