"""What rays see that meet no surface."""

from __future__ import annotations

from plenoptic._values import set_field, value
from plenoptic.scene.material import Colour, as_colour


@value
class ConstantBackground:
    """A world of the same radiance in every direction.

    Parameters
    ----------
    radiance : float or (float, float, float)
        Radiance of the world in scene units, 0 or more: one number, or (red, green, blue).

    Raises
    ------
    InvalidValueError
        Not a number or three of them, or not finite.
    SceneError
        Negative.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.Scene(background=pl.ConstantBackground((0.2, 0.3, 0.5)))
    Scene(no meshes, background (0.2, 0.3, 0.5))
    """

    radiance: Colour = 1.0

    def __post_init__(self) -> None:
        set_field(self, "radiance", as_colour(self.radiance, "radiance"))
