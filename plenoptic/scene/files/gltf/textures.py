"""The textures of glTF files."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from io import BytesIO
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from plenoptic.core.color.srgb import Encoding
from plenoptic.core.values import Floats
from plenoptic.errors import FileError
from plenoptic.scene.files.file_materials import REPLACE, colour_of, number_or_texture, times
from plenoptic.scene.files.gltf.file import GltfFile
from plenoptic.scene.textures.color import Colour
from plenoptic.scene.textures.texture import Texture, TextureFilter, Wrap

if TYPE_CHECKING:
    from PIL.Image import Image

RED, GREEN, BLUE, ALPHA = range(4)
_WRAPS = {10497: Wrap.REPEAT, 33071: Wrap.CLAMP, 33648: Wrap.MIRROR}
_NEAREST = 9728

Info = Mapping[str, Any]
"""How a material refers to a texture: by `index`, `texCoord` and extensions."""


class TexturePlacement(NamedTuple):
    """How the textures of a material lie on a mesh.

    `coordinates` is the number of the set of texture coordinates; offset, rotation (radians) and scale are those of
    KHR_texture_transform, in glTF's texture coordinates, v down.

    Examples
    --------
    >>> import numpy as np
    >>> TexturePlacement(scale=(2.0, 2.0)).uv(np.array([[0.0, 0.0], [0.5, 0.5]])).tolist()
    [[0.0, 1.0], [1.0, 0.0]]
    """

    coordinates: int = 0
    offset: tuple[float, float] = (0.0, 0.0)
    rotation: float = 0.0
    scale: tuple[float, float] = (1.0, 1.0)

    def uv(self, given: Floats) -> Floats:
        """(n, 2) texture coordinates of a mesh, v up, of those in its file, v down.

        Scaled, turned, then shifted. The matrix in the text of the extension turns the other way than its words and its
        examples; programs follow those (https://github.com/KhronosGroup/glTF/issues/1563).
        """
        u, v = given[:, 0] * self.scale[0], given[:, 1] * self.scale[1]
        if self.rotation:
            cosine, sine = np.cos(self.rotation), np.sin(self.rotation)
            u, v = cosine * u + sine * v, cosine * v - sine * u
        return np.stack([u + self.offset[0], 1 - (v + self.offset[1])], axis=1)


def placement_of(infos: Iterable[Info], material: str) -> TexturePlacement:
    """The one way in which several textures of a material lie on a mesh; a `FileError` where there are several."""
    found = set()
    for info in infos:
        moved = info.get("extensions", {}).get("KHR_texture_transform", {})
        (x, y), (along_u, along_v) = moved.get("offset", (0.0, 0.0)), moved.get("scale", (1.0, 1.0))
        coordinates = moved.get("texCoord", info.get("texCoord", 0))
        found.add(TexturePlacement(coordinates, (x, y), moved.get("rotation", 0.0), (along_u, along_v)))
    if len(found) > 1:
        raise FileError(
            f"material {material!r} moves its textures in {len(found)} ways, or uses several sets of uv; "
            "bake them and export again"
        )
    return found.pop() if found else TexturePlacement()


class GltfTextures:
    """The textures of a file, each read once for all materials that use it."""

    def __init__(self, file: GltfFile) -> None:
        self._file = file
        self._images: dict[int, Image] = {}
        self._textures: dict[Any, Texture] = {}

    def colour(self, info: Info | None, factor: Any, material: str) -> Colour | Texture:
        """A colour, or a texture in sRGB times that colour."""
        colour = colour_of(factor)
        if info is None or not np.any(colour):
            return colour
        key = (info["index"], "colour", colour)
        if key not in self._textures:
            self._textures[key] = times(self._read(info, material, Encoding.SRGB, None), colour)
        return self._textures[key]

    def share(self, info: Info | None, factor: float, channel: int, material: str) -> float | Texture:
        """A number, or one channel of a texture times that number; a number too where the channel is constant."""
        if info is None or factor == 0:
            return float(factor)
        key = (info["index"], channel, float(factor))
        if key not in self._textures:
            self._textures[key] = times(self._read(info, material, Encoding.LINEAR, channel), float(factor))
        return number_or_texture(self._textures[key])

    def normals(self, info: Info | None, material: str) -> Texture | None:
        """A map of normals, its slopes times the `scale` that the file gives for them."""
        if info is None:
            return None
        scale = float(info.get("scale", 1.0))
        key = (info["index"], "normals", scale)
        if key not in self._textures:
            texture = self._read(info, material, Encoding.LINEAR, None)
            if texture.texels.shape[2] == 1:
                raise FileError(f"the normal texture of material {material!r} is grey; it must have three channels")
            self._textures[key] = texture if scale == 1 else _steeper(texture, scale)
        return self._textures[key]

    def _read(self, info: Info, material: str, encoding: Encoding, channel: int | None) -> Texture:
        described = self._file.described("textures", info["index"])
        sampler: Mapping[str, Any] = {}
        if "sampler" in described:
            sampler = self._file.described("samplers", described["sampler"])
        along_u, along_v = (_WRAPS[sampler.get(axis, 10497)] for axis in ("wrapS", "wrapT"))
        nearest = sampler.get("magFilter") == _NEAREST
        try:
            return Texture.from_image(
                self._image(described),
                encoding=encoding,
                channel=channel,
                wrap=(along_u, along_v),
                filter=TextureFilter.NEAREST if nearest else TextureFilter.BILINEAR,
            )
        except Exception as error:  # Pillow raises whatever the damage leads to
            raise FileError(
                f"the texture of material {material!r} is missing or not an image ({error}); put it beside the file, "
                f"{REPLACE}"
            ) from None

    def _image(self, described: Mapping[str, Any]) -> Image:
        import PIL.Image

        webp = described.get("extensions", {}).get("EXT_texture_webp", {})
        number = webp.get("source", described.get("source"))
        if number not in self._images:
            image = self._file.described("images", number)
            content = self._file.resource(image["uri"]) if "uri" in image else self._file.view(image["bufferView"])
            with warnings.catch_warnings():
                # Textures have a limit of their own.
                warnings.simplefilter("ignore", PIL.Image.DecompressionBombWarning)
                self._images[number] = PIL.Image.open(BytesIO(content))
        return self._images[number]


def _steeper(texture: Texture, scale: float) -> Texture:
    """Normals whose components along the surface are multiplied by a number, at unit length again."""
    normals = (2 * texture.texels.astype(np.float64) - 1) * (scale, scale, 1)
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-9)
    return Texture(np.clip((normals + 1) / 2, 0, 1), wrap=texture.wrap, filter=texture.filter)
