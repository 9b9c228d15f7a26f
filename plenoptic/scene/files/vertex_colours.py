"""Colours of vertices and faces as textures."""

from __future__ import annotations

import numpy as np

from plenoptic.core.color.srgb import srgb_to_linear
from plenoptic.core.files.file_limits import FileReader
from plenoptic.core.values import Floats
from plenoptic.core.warn import warn
from plenoptic.errors import FileWarning
from plenoptic.scene.files.file_materials import colour_of
from plenoptic.scene.files.polygons import Indices
from plenoptic.scene.materials.diffuse import Lambertian
from plenoptic.scene.textures.texture import Texture

_TRIANGLE = 200
"""Bytes of a triangle with vertices of its own: positions, normals and uv of its corners."""
_VISIBLE = 1 / 510
"""Largest error of a reflectance that is aimed at: half a code of 8 bits."""
_TEXELS = 1 << 22
"""Most texels of patches that are finer than 2 x 2, in all meshes of a file."""


class VertexColours:
    """Colours of the vertices of a file's meshes as textures."""

    def __init__(self, reader: FileReader) -> None:
        self._reader, self._fine_texels = reader, _TEXELS

    def matt(self, file_name: str, codes: Floats) -> tuple[Lambertian, tuple[Indices, Floats] | None]:
        """Matt material of the colours (m, 3 corners, 3) of triangles, codes in sRGB from 0 to 1 or to 255.

        Colours are decoded at the corners and interpolated in reflectance. Returns (3 m,) numbers of the corners'
        texels and their (3 m, 2) texture coordinates, too; None for a single colour, which needs no texture.
        """
        first, white = codes[0, 0], 255 if codes.max() > 1 else 1
        if not (codes.min() >= 0 and codes.max() <= white):  # nan, too
            warn(f"{file_name}: its colours are left out: they are not all within 0 and {white}", FileWarning)
            return Lambertian(), None
        if np.all(codes == first):
            return Lambertian(colour_of(srgb_to_linear(first / white))), None
        colours = np.asarray(srgb_to_linear(codes / white), dtype=np.float64)
        texture, texels = self.interpolation(file_name, colours)
        return Lambertian(texture), (texels, texel_uv(texture, texels))

    def interpolation(self, name: str, colours: Floats) -> tuple[Texture, Indices]:
        """Texture of the colours (m, 3 corners, 3) of triangles, within 0 and 1, and the texel of each corner.

        A triangle has a patch of (n + 1) x (n + 1) texels, in which its corners a, b, c are the centres of the first,
        of the last in the first row, and of the first in the last row. Texels are a + s (b - a) + t (c - a), so that
        bilinear interpolation is exact but for rounding; only beyond the edge b c, where s + t = 1 + 1 / n, may that be
        no reflectance. It is clipped there, which is off by a quarter of the clipped part in the middle of a cell on
        the edge. Corner a is the one for which that is least, and n the power of 2 that makes it invisible; a warning
        tells the largest error if that takes too many texels.

        Returns the texture and (3 m,) numbers of texels, row by row, for `texel_uv`.
        """
        m, each, n = len(colours), np.arange(len(colours)), 1
        apex = _excess(colours.sum(axis=1, keepdims=True) - 2 * colours).argmin(axis=1)
        a, b, c = (colours[each, (apex + k) % 3] for k in range(3))
        errors = _excess(b + c - a) / 4
        while errors.max() > _VISIBLE and m * (2 * n + 1) ** 2 <= self._fine_texels:
            n *= 2
            errors = np.maximum(_excess(b + (c - a) / n), _excess(c + (b - a) / n)) / 4
        self._fine_texels -= m * (n + 1) ** 2 if n > 1 else 0
        if errors.max() > _VISIBLE:
            warn(
                f"{name}: interpolated colours are off by up to {errors.max():.2g} in {np.sum(errors > _VISIBLE)} of "
                f"{m} triangles, whose vertices differ so much; divide these triangles",
                FileWarning,
            )
        columns = int(np.ceil(np.sqrt(m)))
        rows = -(-m // columns)
        self._reader.take(_TRIANGLE * m + 12 * rows * columns * (n + 1) ** 2, "its colours")
        s = (np.arange(n + 1) / n)[:, None]
        patches = np.zeros((rows * columns, n + 1, n + 1, 3), dtype=np.float32)
        for k in range(n + 1):  # a row of texels of all triangles
            patches[:m, k] = np.clip((a + k / n * (c - a))[:, None] + s * (b - a)[:, None], 0, 1)
        texels = (
            patches.reshape(rows, columns, n + 1, n + 1, 3).swapaxes(1, 2).reshape(rows * (n + 1), columns * (n + 1), 3)
        )
        corner = (np.arange(3) - apex[:, None]) % 3
        row, column = ((n + 1) * index[:, None] for index in np.divmod(each, columns))
        return Texture(texels), ((row + n * (corner // 2)) * texels.shape[1] + column + n * (corner % 2)).ravel()


def _excess(reflectances: Floats) -> Floats:
    """Largest part of colours (..., 3) that is below 0 or above 1."""
    return np.asarray(np.maximum(np.maximum(-reflectances, reflectances - 1).max(axis=-1), 0.0))


def texel_uv(texture: Texture, texels: Indices) -> Floats:
    """(n, 2) texture coordinates of the centres of texels, by their numbers row by row."""
    rows, columns = texture.texels.shape[:2]
    row, column = np.divmod(texels, columns)
    return np.stack([(column + 0.5) / columns, 1 - (row + 0.5) / rows], axis=1)
