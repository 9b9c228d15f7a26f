"""Surfaces that shine."""

from __future__ import annotations

from plenoptic.core.values import checked_field, flag, value
from plenoptic.scene.materials.material_records import MaterialRow
from plenoptic.scene.textures.color import Colour, as_texture_or_colour
from plenoptic.scene.textures.texture import Texture


@value
class Emissive:
    """A surface that emits the same radiance in all directions and reflects nothing.

    Parameters
    ----------
    radiance : float, (float, float, float) or Texture
        Emitted radiance in scene units, 0 (black) or more: one number, (red, green, blue), or a texture of such.
    two_sided : bool
        Whether both sides emit. Otherwise the back is black, from which a triangle winds clockwise.

    Raises
    ------
    InvalidValueError
        Not a number, three of them or a texture, or not finite; a `two_sided` that is not True or False.
    SceneError
        Negative.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.Emissive(10.0, two_sided=True)
    Emissive(radiance=10.0, two_sided=True)
    """

    radiance: Colour | Texture = checked_field(as_texture_or_colour, default=1.0)
    two_sided: bool = checked_field(flag, default=False)

    def row(self) -> MaterialRow:
        """Row of the material's numbers; missing ones keep their default."""
        return MaterialRow(emission=self.radiance, two_sided=self.two_sided)
