"""The textures of glTF files."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from io import BytesIO
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from plenoptic.core.color.srgb import Encoding
from plenoptic.core.files.file_limits import check_scans
from plenoptic.core.values import Floats
from plenoptic.errors import FileError
from plenoptic.scene.files.file_materials import REPLACE, colour_of, number_or_texture, times
from plenoptic.scene.files.gltf.file import GltfFile, resource
from plenoptic.scene.materials.registry import Material
from plenoptic.scene.textures.color import Colour
from plenoptic.scene.textures.texture import Texture, TextureFilter, Wrap

if TYPE_CHECKING:
    from PIL.Image import Image

RED, GREEN, BLUE, ALPHA = range(4)
_WRAPS = {10497: Wrap.REPEAT, 33071: Wrap.CLAMP, 33648: Wrap.MIRROR}
_NEAREST = 9728
_FORMATS = ("PNG", "JPEG", "WEBP")
"""Others could start other programs: Ghostscript for EPS."""

Info = Mapping[str, Any]
"""How a material refers to a texture: by `index`, `texCoord` and extensions."""


class TexturePlacement(NamedTuple):
    """Mapping of a material's textures onto a mesh.

    `coordinates` is the number of the set of texture coordinates; offset, rotation (radians) and scale are those of
    KHR_texture_transform, in glTF's texture coordinates, v down.
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


class GltfTextures:
    """The textures of a file, each read once for all materials that use it."""

    def __init__(self, file: GltfFile) -> None:
        self.made: dict[Any, Texture] = {}
        self._file = file
        self._images: dict[int, Image] = {}

    def read(self, info: Info, encoding: Encoding, channel: int | None) -> Texture:
        """An image, or one of its channels, with the wrap and filter that the file gives it."""
        described = self._file.entry("textures", info["index"])
        sampler: Mapping[str, Any] = {}
        if "sampler" in described:
            sampler = self._file.entry("samplers", described["sampler"])
        along_u, along_v = (_WRAPS[sampler.get(axis, 10497)] for axis in ("wrapS", "wrapT"))
        between = TextureFilter.NEAREST if sampler.get("magFilter") == _NEAREST else TextureFilter.BILINEAR
        image = self._image(described)
        # Texels are float32, and copied once.
        decoded_bytes = 4 * image.width * image.height * (3 if channel is None else 1)
        self._file.reader.check(2 * decoded_bytes, "its image")
        self._file.reader.take(decoded_bytes, "its image")
        return Texture.from_image(image, encoding=encoding, channel=channel, wrap=(along_u, along_v), filter=between)

    def _image(self, described: Mapping[str, Any]) -> Image:
        import PIL.Image

        webp = described.get("extensions", {}).get("EXT_texture_webp", {})
        number = webp.get("source", described.get("source"))
        if number not in self._images:
            image, file = self._file.entry("images", number), self._file
            content = resource(image["uri"], file.reader) if "uri" in image else file.view(image.get("bufferView"))
            check_scans(bytes(content), "it")
            with warnings.catch_warnings():
                # Textures have a limit of their own.
                warnings.simplefilter("ignore", PIL.Image.DecompressionBombWarning)
                self._images[number] = PIL.Image.open(BytesIO(content), formats=_FORMATS)
        return self._images[number]


class MaterialTextures:
    """The textures of one material, and how those lie on meshes that it comes to use."""

    def __init__(self, textures: GltfTextures, name: str) -> None:
        self.name = name
        self._textures = textures
        self._made: list[tuple[Info, Texture]] = []

    def colour(self, info: Info | None, factor: Any) -> Colour | Texture:
        """A colour, or a texture in sRGB times that colour."""
        colour = colour_of(factor)
        if info is None or not np.any(colour):
            return colour
        return self._once(info, "colour", colour, lambda: times(self._read(info, Encoding.SRGB, None), colour))

    def share(self, info: Info | None, factor: float, channel: int) -> float | Texture:
        """A number, or one channel of a texture times that number; a number too where the channel is constant."""
        constant = float(factor)
        if info is None or constant == 0:
            return constant
        texture = self._once(
            info, channel, constant, lambda: times(self._read(info, Encoding.LINEAR, channel), constant)
        )
        return number_or_texture(texture)

    def normals(self, info: Info | None) -> Texture | None:
        """A map of normals, its slopes times the `scale` that the file gives for them."""
        if info is None:
            return None
        scale = float(info.get("scale", 1.0))

        def steep() -> Texture:
            texture = self._read(info, Encoding.LINEAR, None)
            if texture.texels.shape[2] == 1:
                raise FileError(f"the normal texture of material {self.name!r} is grey; it must have three channels")
            return texture if scale == 1 else _steeper(texture, scale)

        return self._once(info, "normals", scale, steep)

    def placement(self, material: Material) -> TexturePlacement:
        """The one way in which the textures of the finished material lie on meshes.

        Some turned out to be a number, or multiplied by 0. A `FileError` where there are several ways.
        """
        used = material.row().textures
        placements = set()
        for info in (info for info, texture in self._made if any(texture is one for one in used)):
            moved = info.get("extensions", {}).get("KHR_texture_transform", {})
            (x, y), (along_u, along_v) = moved.get("offset", (0.0, 0.0)), moved.get("scale", (1.0, 1.0))
            coordinates = moved.get("texCoord", info.get("texCoord", 0))
            placements.add(TexturePlacement(coordinates, (x, y), moved.get("rotation", 0.0), (along_u, along_v)))
        if len(placements) > 1:
            raise FileError(
                f"material {self.name!r} moves its textures in {len(placements)} ways, or uses several sets of uv; "
                "bake them and export again"
            )
        return placements.pop() if placements else TexturePlacement()

    def _once(self, info: Info, kind: str | int, factor: Colour, make: Callable[[], Texture]) -> Texture:
        key = (info["index"], kind, factor)
        if key not in self._textures.made:
            self._textures.made[key] = make()
        self._made.append((info, self._textures.made[key]))
        return self._textures.made[key]

    def _read(self, info: Info, encoding: Encoding, channel: int | None) -> Texture:
        try:
            return self._textures.read(info, encoding, channel)
        except Exception as error:  # Pillow raises whatever the damage leads to
            raise FileError(
                f"the texture of material {self.name!r} is missing or not an image ({error}); put it beside the file, "
                f"{REPLACE}"
            ) from None


def _steeper(texture: Texture, scale: float) -> Texture:
    """Normals whose components along the surface are multiplied by a number, at unit length again."""
    normals = (2 * texture.texels.astype(np.float64) - 1) * (scale, scale, 1)
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-9)
    return Texture(np.clip((normals + 1) / 2, 0, 1), wrap=texture.wrap, filter=texture.filter)
