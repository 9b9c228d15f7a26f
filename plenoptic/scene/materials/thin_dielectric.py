"""Panes that light passes straight on."""

from __future__ import annotations

from plenoptic.core.values import set_field, value
from plenoptic.scene.materials.record import MaterialRow
from plenoptic.scene.textures.color import Colour, as_colour, as_index


@value
class ThinGlass:
    """A pane without thickness: it reflects, and lets the rest pass straight on.

    Reflections to and fro inside the pane are counted, all of them: with Fresnel's reflectance R of one surface it
    reflects 2 R / (1 + R).

    Parameters
    ----------
    index : float
        Refractive index of the pane, above 0.
    transmittance : float or (float, float, float)
        In [0, 1]: share of what is not reflected that passes.

    Raises
    ------
    InvalidValueError
        Not numbers.
    SceneError
        An index that is not above 0, a transmittance outside [0, 1].

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.materials.ThinGlass(transmittance=(0.9, 1.0, 0.9))
    ThinGlass(transmittance=(0.9, 1.0, 0.9))
    """

    index: float = 1.5
    transmittance: Colour = 1.0

    def __post_init__(self) -> None:
        set_field(self, "index", as_index(self.index))
        set_field(self, "transmittance", as_colour(self.transmittance, "transmittance", at_most=1.0))

    def row(self) -> MaterialRow:
        """Its numbers; what it lacks keeps its default."""
        return MaterialRow(self.transmittance, roughness=0.0, pane_index=self.index, fresnel=True, specular=True)
