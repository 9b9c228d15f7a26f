"""Matt surfaces."""

from __future__ import annotations

from plenoptic.core.values import checked_field, value
from plenoptic.scene.materials.material_records import MaterialRow
from plenoptic.scene.textures.color import Colour, as_fraction, as_texture_or_colour
from plenoptic.scene.textures.texture import Texture


@value
class Lambertian:
    """A matt surface: it reflects a fraction of the incident light, with equal radiance in all directions.

    Both sides reflect. With albedo rho the reflected radiance is rho E / pi for the irradiance E.

    Parameters
    ----------
    albedo : float, (float, float, float) or Texture
        Reflected share, in [0, 1]: one number, (red, green, blue), or a texture of such numbers.

    Raises
    ------
    InvalidValueError
        Not a number, three of them or a texture.
    SceneError
        Outside [0, 1]: the surface would make light.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.Lambertian((0.8, 0.3, 0.2))
    Lambertian(albedo=(0.8, 0.3, 0.2))
    """

    albedo: Colour | Texture = checked_field(as_texture_or_colour, default=0.5, at_most=1.0)

    def row(self) -> MaterialRow:
        """Row of the material's numbers; missing ones keep their default."""
        return MaterialRow(self.albedo)


@value
class RoughDiffuse:
    """A matt surface of microscopic grooves, such as clay or plaster: brighter towards the light than `Lambertian`.

    The energy-preserving Oren-Nayar model (EON): Fujii's form of it, with light that is scattered several times between
    grooves given back. With albedo 1 nothing is lost at any roughness.

    Parameters
    ----------
    albedo : float, (float, float, float) or Texture
        In [0, 1]: the reflected share at roughness 0. Rough surfaces reflect a little less, and more saturated colours.
    roughness : float
        From 0 (`Lambertian`) to 1, where the slopes of the grooves have a standard deviation of about pi / 2.

    Raises
    ------
    InvalidValueError
        Not numbers.
    SceneError
        Outside [0, 1].

    Notes
    -----
    J. Portsmouth, P. Kutz and S. Hill, "EON: A practical energy-preserving rough diffuse BRDF", J. Comput. Graph. Tech.
    14(1), 116 (2025); M. Oren and S. K. Nayar, SIGGRAPH 1994, doi:10.1145/192161.192213.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.materials.RoughDiffuse(0.8, roughness=0.6)
    RoughDiffuse(albedo=0.8, roughness=0.6)
    """

    albedo: Colour | Texture = checked_field(as_texture_or_colour, default=0.5, at_most=1.0)
    roughness: float = checked_field(as_fraction, default=0.5)

    def row(self) -> MaterialRow:
        """Row of the material's numbers; missing ones keep their default."""
        return MaterialRow(self.albedo, roughness=self.roughness)
