"""What a surface does with light."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np

from plenoptic._values import finite, flag, set_field, value
from plenoptic.errors import FileError, InvalidValueError, SceneError
from plenoptic.scene.texture import Texture

Colour: TypeAlias = float | tuple[float, float, float]

_REPLACE = "put it beside the file, or replace all materials by material="


@value
class Lambertian:
    """A matt surface: it reflects a share of the light that meets it, with equal radiance in all directions.

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

    albedo: Colour | Texture = 0.5

    def __post_init__(self) -> None:
        if not isinstance(self.albedo, Texture):
            set_field(self, "albedo", as_colour(self.albedo, "albedo", at_most=1.0))
        elif (brightest := float(self.albedo.texels.max())) > 1:
            raise SceneError(f"albedo has texels up to {brightest:g}; it must be 1 or less, so scale the texture")


@value
class Emissive:
    """A surface that emits the same radiance in all directions and reflects nothing.

    Parameters
    ----------
    radiance : float or (float, float, float)
        Emitted radiance in scene units, 0 or more: one number, or (red, green, blue). 0 is a black surface.
    two_sided : bool
        Whether both sides emit. Otherwise the front emits, the side from which a triangle winds
        counter-clockwise, and the back is black.

    Raises
    ------
    InvalidValueError
        Not a number or three of them, or not finite; a `two_sided` that is not True or False.
    SceneError
        Negative.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.Emissive(10.0, two_sided=True)
    Emissive(radiance=10.0, two_sided=True)
    """

    radiance: Colour = 1.0
    two_sided: bool = False

    def __post_init__(self) -> None:
        set_field(self, "radiance", as_colour(self.radiance, "radiance"))
        set_field(self, "two_sided", flag(self.two_sided, "two_sided"))


Material: TypeAlias = Lambertian | Emissive


def as_colour(colour: Any, name: str, *, at_most: float = np.inf) -> Colour:
    """One number or (red, green, blue), each finite and within 0 and a limit, as floats."""
    try:
        shape = np.shape(colour)
    except ValueError:
        raise InvalidValueError(f"{name} is {colour!r}; it must be one number or (red, green, blue)") from None
    if shape not in ((), (3,)):
        raise InvalidValueError(f"{name} has shape {shape}; it must be one number or (red, green, blue)")
    parts = [finite(part, name) for part in ([colour] if shape == () else colour)]
    if min(parts) < 0 or max(parts) > at_most:
        limit = "0 or more" if at_most == np.inf else f"within 0 and {at_most:g}"
        raise SceneError(f"{name} is {parts[0] if shape == () else tuple(parts)}; it must be {limit}")
    return parts[0] if shape == () else (parts[0], parts[1], parts[2])


def is_grey(colour: Colour | Texture) -> bool:
    """Whether red, green and blue are the same."""
    return colour.is_grey if isinstance(colour, Texture) else len(set(np.ravel(colour).tolist())) == 1


def gltf_material(described: Mapping[str, Any], loaded: Any) -> Material:
    """The material nearest to one of a glTF file.

    The numbers come from the file's own description, since trimesh rounds colours to 8 bits; the image comes from
    the material that trimesh has loaded.
    """
    name = described.get("name", "without a name")
    emission = np.array(described.get("emissiveFactor", (0.0, 0.0, 0.0)), dtype=np.float64)
    strength = described.get("extensions", {}).get("KHR_materials_emissive_strength", {})
    emission *= strength.get("emissiveStrength", 1.0)
    if emission.any() and "emissiveTexture" not in described:
        return Emissive(tuple(emission), bool(described.get("doubleSided", False)))
    if emission.any():
        _warn_of_glow(name)
    pbr = described.get("pbrMetallicRoughness")
    if pbr is None:
        # Other models (specular-glossiness): trimesh has converted them.
        factor = getattr(loaded, "baseColorFactor", None)
        base = np.ones(3) if factor is None else np.asarray(factor)[:3] / 255
    else:
        base = np.array(pbr.get("baseColorFactor", (1.0, 1.0, 1.0))[:3], dtype=np.float64)
    image = loaded.baseColorTexture
    if pbr is not None and "baseColorTexture" in pbr:
        if image is None:
            raise FileError(f"the texture of material {name!r} is missing or not an image; {_REPLACE}")
        reference = pbr["baseColorTexture"]
        if reference.get("texCoord", 0) != 0 or "KHR_texture_transform" in reference.get("extensions", {}):
            raise FileError(f"material {name!r} moves its texture or uses a second set of uv; bake it and export again")
    return _reflecting(base, image)


def obj_material(loaded: Any, image_name: str | None) -> Material:
    """The material nearest to one of an OBJ file; `image_name` is what the file gives as its texture."""
    # trimesh rounds colours to 8 bits, and keeps the numbers of the file beside them.
    emission = np.array(loaded.kwargs.get("ke", (0.0, 0.0, 0.0)), dtype=np.float64)
    if emission.any() and "map_ke" not in loaded.kwargs:
        return Emissive(tuple(emission))
    if emission.any():
        _warn_of_glow(loaded.name)
    if image_name is not None and loaded.image is None:
        raise FileError(
            f"the texture {image_name!r} of material {loaded.name!r} is missing or not an image; {_REPLACE}"
        )
    return _reflecting(np.array(loaded.kwargs.get("kd", (1.0, 1.0, 1.0)), dtype=np.float64), loaded.image)


def _reflecting(base: Any, image: Any) -> Lambertian:
    base = np.broadcast_to(base, 3)
    if image is None:
        return Lambertian(tuple(base))
    texture = Texture.from_image(image)
    if np.all(base == 1):
        return Lambertian(texture)
    as_colour(base, "albedo", at_most=1.0)
    factor = base[:1] if is_grey(tuple(base)) else base
    return Lambertian(Texture(texture.texels * factor))


def _warn_of_glow(name: str) -> None:
    warnings.warn(
        f"material {name!r} glows by a texture, which is not rendered: its glow is left out; give it an Emissive "
        "material on a mesh of its own",
        stacklevel=2,
    )
