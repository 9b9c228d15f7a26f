"""The material of glTF files."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import cache

import numpy as np

from plenoptic.core.values import Floats, checked_field, flag, read_only, value
from plenoptic.errors import InvalidValueError
from plenoptic.scene.materials.material_records import COUPLING_COSINES, MaterialRow
from plenoptic.scene.textures.color import Colour, as_fraction, as_share, as_texture_or_colour
from plenoptic.scene.textures.texture import Texture

_ROUGHNESSES, _DRAWS = 41, 32
"""Of the table of the layer: rows, and the root of the draws for each number."""


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
        In [0, 1], one channel: the fraction of paths for which the surface is opaque.
    cutoff : float, optional
        The surface is opaque where the opacity is at least this, transparent elsewhere. None: the fraction is blended.
    clearcoat : float or Texture
        In [0, 1], one channel: how much of the surface has a clear coat of index 1.5, as of varnish. 0: none.
    clearcoat_roughness : float or Texture
        In [0, 1], one channel: of the coat, as `roughness`.

    Raises
    ------
    InvalidValueError
        Not numbers, or textures with another number of channels.
    SceneError
        Outside [0, 1], or a negative emission.

    Notes
    -----
    Khronos, glTF 2.0 specification, appendix B. There, base and layer together can reflect more than all at grazing
    angles. Here the base is darkened by the layer's reflections on the way in and out (Cs. Kelemen and
    L. Szirmay-Kalos, Eurographics 2001), so that a white base reflects all: to 0.2 % up to 87 degrees from the normal,
    to 1 % beyond.

    The coat is the extension KHR_materials_clearcoat: a layer as the one below, whose normals it shares, with Fresnel's
    reflectance after Schlick and without colour or refraction. The parts below it receive and send light through the
    coat: the matt base as it does through its own layer, so that white stays white to 1 %, and that layer or metal by
    the smaller of the transmissions of both directions. So no light is made, and light that goes to and fro between
    coat and metal is lost: up to 6 % of it where rough metal lies under a polished coat.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.MetallicRoughness((0.8, 0.1, 0.1), roughness=0.3)
    MetallicRoughness(base=(0.8, 0.1, 0.1), roughness=0.3)
    """

    base: Colour | Texture = checked_field(as_texture_or_colour, default=0.5, at_most=1.0)
    metallic: float | Texture = checked_field(as_share, default=0.0)
    roughness: float | Texture = checked_field(as_share, default=0.5)
    _: dataclasses.KW_ONLY
    normal_map: Texture | None = None
    emission: Colour | Texture = checked_field(as_texture_or_colour, default=0.0)
    two_sided: bool = checked_field(flag, default=False)
    opacity: float | Texture = checked_field(as_share, default=1.0)
    cutoff: float | None = checked_field(as_fraction, default=None)
    clearcoat: float | Texture = checked_field(as_share, default=0.0)
    clearcoat_roughness: float | Texture = checked_field(as_share, default=0.0)

    def __post_init__(self) -> None:
        normals = self.normal_map
        if normals is not None and not (isinstance(normals, Texture) and normals.texels.shape[2] == 3):
            raise InvalidValueError(f"normal_map is {normals!r}; it must be a texture of 3 channels, or None")

    def row(self) -> MaterialRow:
        """Row of the material's numbers; missing ones keep their default."""
        coated = self.clearcoat != 0
        return MaterialRow(
            self.base,
            self.metallic,
            self.roughness,
            self.normal_map,
            self.emission,
            self.two_sided,
            self.opacity,
            self.cutoff,
            fresnel=True,
            clearcoat=self.clearcoat if coated else None,
            clearcoat_roughness=self.clearcoat_roughness if coated else None,
            tables=coated_tables if coated else layer_tables,
        )


@cache
def coated_tables() -> Mapping[str, Floats]:
    """Tables of the layer, with a column more for each roughness of a coat: means of the light that passes both.

    Products of functions that are linear between nodes of the root of the cosine, r, times 4 r^3 dr: three points are
    exact.
    """
    layer = layer_tables()["coupling"]
    passed, r = layer[:, :COUPLING_COSINES], np.linspace(0, 1, COUPLING_COSINES)
    both = np.zeros((len(layer), len(layer)))
    for x, weight in zip(*np.polynomial.legendre.leggauss(3), strict=True):
        t = 0.5 * (1 + x)
        middle = passed[:, :-1] + t * np.diff(passed, axis=1)
        both += (middle * (2 * weight * np.diff(r) * (r[:-1] + t * np.diff(r)) ** 3)) @ middle.T
    return {"coupling": read_only(np.column_stack([layer, both]))}


@cache
def layer_tables() -> Mapping[str, Floats]:
    """Transmission of the layer of a METALLIC_ROUGHNESS material of reflectance 0.04, with its means in a last column.

    The layer's directional albedo is the mean of F G2 / G1 over normals drawn by visibility, here at the midpoints of
    a grid of random numbers, as in `microfacets.visible_normal`.
    """
    # The root of the roughness, whose square is alpha, in equal steps: rows change fastest near polish.
    alpha = np.maximum(np.linspace(0, 1, _ROUGHNESSES) ** 4, 1e-3)[:, None, None]
    z = np.maximum(np.linspace(0, 1, COUPLING_COSINES) ** 2, 1e-6)[None, :, None]
    middle = (np.arange(_DRAWS) + 0.5) / _DRAWS
    u, v = (part.ravel() for part in np.meshgrid(0.5 * middle, middle))
    x = np.sqrt(1 - z * z)
    albedo = np.stack([_layer_albedo(row, x[0], z[0], u, v) for row in alpha])
    passed = np.clip(1 - albedo, 0, 1)
    # Exact for functions linear in the root of the cosine between nodes: mean of c over 2 mu dmu = 4 r^3 dr.
    r = np.linspace(0, 1, COUPLING_COSINES)
    low, high = r[:-1], r[1:]
    whole, moment = high**4 - low**4, 0.8 * (high**5 - low**5)
    slope = np.diff(passed, axis=1) / (high - low)
    mean = (passed[:, :-1] * whole + slope * (moment - low * whole)).sum(axis=1)
    return {"coupling": read_only(np.column_stack([passed, mean]))}


def _layer_albedo(alpha: Floats, x: Floats, z: Floats, u: Floats, v: Floats) -> Floats:
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
    visible = np.where(iz > 0, (1 + hidden_o) / (1 + hidden_o + hidden_i), 0.0)
    return np.asarray((fresnel * visible).mean(axis=-1))
