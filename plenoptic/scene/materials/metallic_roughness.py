"""The material of glTF files."""

from __future__ import annotations

import dataclasses

from plenoptic.core.values import flag, set_field, value
from plenoptic.errors import InvalidValueError
from plenoptic.scene.materials.row import MaterialRow
from plenoptic.scene.textures.color import Colour, as_fraction, as_share, as_textured
from plenoptic.scene.textures.texture import Texture


@value
class MetallicRoughness:
    """The metallic-roughness material of glTF 2.0: plastic or paint at `metallic` 0, metal at 1, a mixture between.

    A rough reflecting layer (GGX of alpha = roughness^2, at least 0.001, Fresnel after Schlick with 0.04 for plastic
    and the base colour for metal) on a Lambertian base. Both sides reflect: culling the backs of triangles, as
    rasterisers do, would let light through walls. Emission and transparency are part of the material.

    Parameters
    ----------
    base : float, (float, float, float) or Texture
        Base colour, in [0, 1].
    metallic, roughness : float or Texture
        In [0, 1]; textures have one channel.
    normal_map : Texture, optional
        Three channels: normals in the frame of the texture, (n + 1) / 2, z outwards.
    emission : float, (float, float, float) or Texture
        Emitted radiance, 0 or more.
    two_sided : bool
        Whether the backs emit too.
    opacity : float or Texture
        In [0, 1], one channel: the share of paths for which the surface is there.
    cutoff : float, optional
        The surface is there where the opacity is at least this, and nowhere else. None: the share is blended.

    Raises
    ------
    InvalidValueError
        Not numbers, or textures with another number of channels.
    SceneError
        Outside [0, 1], or a negative emission.

    Notes
    -----
    Khronos, glTF 2.0 specification, appendix B. There, base and layer together can reflect more than all at grazing
    angles. Here the base is darkened by what the layer reflects on the way in and out (Cs. Kelemen and
    L. Szirmay-Kalos, Eurographics 2001), so that a white base reflects all: to 0.2 % up to 87 degrees from the normal,
    to 1 % beyond.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.MetallicRoughness((0.8, 0.1, 0.1), roughness=0.3)
    MetallicRoughness(base=(0.8, 0.1, 0.1), roughness=0.3)
    """

    base: Colour | Texture = 0.5
    metallic: float | Texture = 0.0
    roughness: float | Texture = 0.5
    _: dataclasses.KW_ONLY
    normal_map: Texture | None = None
    emission: Colour | Texture = 0.0
    two_sided: bool = False
    opacity: float | Texture = 1.0
    cutoff: float | None = None

    def __post_init__(self) -> None:
        set_field(self, "base", as_textured(self.base, "base", at_most=1.0))
        for name in ("metallic", "roughness", "opacity"):
            set_field(self, name, as_share(getattr(self, name), name))
        normals = self.normal_map
        if normals is not None and not (isinstance(normals, Texture) and normals.texels.shape[2] == 3):
            raise InvalidValueError(f"normal_map is {normals!r}; it must be a texture of 3 channels, or None")
        set_field(self, "emission", as_textured(self.emission, "emission"))
        set_field(self, "two_sided", flag(self.two_sided, "two_sided"))
        if self.cutoff is not None:
            set_field(self, "cutoff", as_fraction(self.cutoff, "cutoff"))

    def row(self) -> MaterialRow:
        """Its numbers; what it lacks keeps its default."""
        return MaterialRow(**{name: getattr(self, name) for name in self.__dataclass_fields__}, fresnel=True)
