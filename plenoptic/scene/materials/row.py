"""What a material says of itself: the numbers by which it scatters, absorbs and emits."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from plenoptic.scene.textures.color import Colour, is_grey
from plenoptic.scene.textures.texture import Texture

Index = complex | tuple[complex, complex, complex]


class MaterialRow(NamedTuple):
    """One row of the columns that all materials of a scene are compiled into; what a material lacks keeps its default.

    Examples
    --------
    >>> import plenoptic as pl
    >>> row = pl.Conductor(0.9).row()
    >>> row.base, row.reflects, row.takes_light
    (0.9, True, False)
    """

    base: Colour | Texture = 0.0
    """The colour that it multiplies light by."""
    metallic: float | Texture = 0.0
    roughness: float | Texture = 0.0
    normal_map: Texture | None = None
    emission: Colour | Texture = 0.0
    two_sided: bool = False
    """Whether both sides emit."""
    opacity: float | Texture = 1.0
    cutoff: float | None = None
    absorption: Colour = 0.0
    """1/mm, behind the front."""
    metal_index: Index = 0.0
    """n + i k; 0 where the reflectance does not depend on the angle."""
    glass_index: tuple[float, float] = (0.0, 0.0)
    """Refractive index behind the front and before it; 0 for what is no body."""
    pane_index: float = 0.0
    """0 for what is no pane."""
    fresnel: bool = False
    """Whether it reflects by its index too, however dark its base colour is."""
    specular: bool = False
    """Whether each direction is scattered into one or two others only: mirrors, polished glass, panes."""

    @property
    def reflects(self) -> bool:
        """Whether any light that meets it is given back."""
        return self.fresnel or isinstance(self.base, Texture) or bool(np.any(self.base))

    @property
    def takes_light(self) -> bool:
        """Whether light that is drawn directly can be scattered."""
        return self.reflects and not self.specular

    @property
    def is_grey(self) -> bool:
        """Whether red, green and blue are treated alike."""
        return all(map(is_grey, (self.base, self.emission, self.absorption, self.metal_index)))

    @property
    def textures(self) -> tuple[Texture, ...]:
        """The textures that it is made of."""
        return tuple(column for column in self if isinstance(column, Texture))
