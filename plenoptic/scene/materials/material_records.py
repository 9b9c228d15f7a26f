"""Materials as kernels read them: the row of each, and columns of all; None for properties that no material has."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.scene.textures.color import Colour, is_grey
from plenoptic.scene.textures.texture import Texture
from plenoptic.scene.textures.texture_records import TextureColumn

Index = complex | tuple[complex, complex, complex]

SMOOTH = 1e-4
"""Below this width of the distribution of normals a surface reflects as if it were perfectly smooth."""

INDEX, EXTINCTION = 0, 1
"""Columns of `Bsdf.metal_index`."""

COUPLING_COSINES = 49
"""Columns of `Bsdf.coupling` for cosines, before those for means."""

INSIDE, OUTSIDE = 0, 1
"""Columns of `Bsdf.glass_index`."""


SHARES = ("roughness", "metallic")
"""Numbers of a material within 0 and 1 that textures may give: names of fields of its row and of members of `Bsdf`."""

EXTRA_SHARES: tuple[str, ...] = ("clearcoat", "clearcoat_roughness")
"""The same, of few materials: names of fields of a row, and columns of `Bsdf.extra_shares`."""


class MaterialRow(NamedTuple):
    """One row of the columns that materials are compiled into; missing properties keep their default."""

    base_color: Colour | Texture = 0.0
    """The colour that it multiplies light by."""
    metallic: float | Texture | None = None
    roughness: float | Texture | None = None
    normal: Texture | None = None
    emission: Colour | Texture = 0.0
    two_sided: bool = False
    """Whether both sides emit."""
    opacity: float | Texture = 1.0
    cutoff: float | None = None
    absorption: Colour = 0.0
    scattering: Colour = 0.0
    asymmetry: float = 0.0
    """1/mm, behind the front."""
    metal_index: Index = 0.0
    """n + i k; 0 where the reflectance does not depend on the angle."""
    glass_index: tuple[float, float] = (0.0, 0.0)
    """Refractive index behind the front and before it; 0 if the material bounds no volume."""
    pane_index: float = 0.0
    """Refractive index of a pane; 0 for other materials."""
    fresnel: bool = False
    """True if the material also reflects by its index, however dark its base colour is."""
    clearcoat: float | Texture | None = None
    clearcoat_roughness: float | Texture | None = None
    specular: bool = False
    """True if each direction scatters into one or two others only: mirrors, polished glass, panes."""
    tables: Callable[[], Mapping[str, Floats]] = dict
    """Returns the additional members of `Bsdf` that this kind needs."""

    @property
    def reflects(self) -> bool:
        """True if the material reflects or transmits any light."""
        return self.fresnel or isinstance(self.base_color, Texture) or bool(np.any(self.base_color))

    @property
    def takes_light(self) -> bool:
        """True if light that is sampled directly can be scattered."""
        return self.reflects and not self.specular

    @property
    def fills(self) -> bool:
        """True if the body behind the surface absorbs or scatters light."""
        return bool(np.any(self.absorption) or np.any(self.scattering))

    @property
    def is_grey(self) -> bool:
        """True if red, green and blue are treated alike."""
        return all(map(is_grey, (self.base_color, self.emission, self.absorption, self.scattering, self.metal_index)))

    @property
    def textures(self) -> tuple[Texture, ...]:
        """Textures among its properties."""
        return tuple(column for column in self if isinstance(column, Texture))


class Bsdf(NamedTuple):
    """BSDFs of nm materials; C channels of the scene. All arrays are C-contiguous and read-only."""

    scatters: NDArray[np.uint8]
    """(nm,): 1 for materials that reflect."""
    takes_light: NDArray[np.uint8]
    """(nm,): 1 for materials that scatter directly sampled light; 0 for mirrors and polished glass."""
    base_color: Floats
    """(nm, C), in [0, 1]: base colours; 1 where a texture gives it."""
    kind: NDArray[np.int64] | None
    """(nm,): kind of each material. None if all are Lambertian or black."""
    metal_index: Floats | None
    """(nm, C, 2): n and k; 0 where the reflectance is constant. None where there is no metal."""
    glass_index: Floats | None
    """(nm, 2): index behind the front and before it; 0 if the material bounds no volume. None if no material does."""
    pane_index: Floats | None
    """(nm,). None where there is no pane."""
    roughness: Floats | None = None
    """(nm,), as all SHARES; 0 where a texture gives it or a material has none. None where all materials have none."""
    metallic: Floats | None = None
    extra_shares: Floats | None = None
    """(nm, EXTRA_SHARES). None where no material has any."""
    coupling: Floats | None = None
    """What passes the layer of MetallicRoughness: rows at equal steps of the root of the roughness, COUPLING_COSINES
    columns at those of the cosine; then a column with means over the cosine-weighted hemisphere. Where there are clear
    coats, a column more for each row, with the means of what passes both layers. None where none is MetallicRoughness.
    """


class Media(NamedTuple):
    """Media that scatter: a row for each material, and a last one for the medium of the scene if it has one."""

    scattering: Floats
    """(rows, C), 1/mm."""
    extinction: Floats
    """(rows, C), 1/mm: absorption and scattering."""
    asymmetry: Floats
    """(rows,): g of Henyey and Greenstein."""
    squared_index: Floats
    """(rows,): by which radiance in bodies is larger than in air; 1 for others."""
    lit: NDArray[np.uint8]
    """(rows,): 0 for media of bodies that hold no light."""


class Emission(NamedTuple):
    """Emission of nm materials."""

    radiance: Floats
    """(nm, C): emitted radiance, of textures their mean."""
    two_sided: NDArray[np.uint8]
    """(nm,): 1 where both sides emit."""
    pdf: Floats | None
    """(nm,), 1/mm^2: probability per area with which triangles are drawn as lights. None where none is drawn."""
    texture: TextureColumn | None
    """None where no texture emits."""


class Alpha(NamedTuple):
    """Opacity of nm materials."""

    opacity: Floats
    """(nm,): fraction of the paths; 0 where a texture gives it."""
    cutoff: Floats
    """(nm,): threshold of the opacity: opaque at or above it, transparent below; -1 without threshold."""
    texture: TextureColumn | None
    """None where no texture gives an opacity."""


class SurfaceMaterial(NamedTuple):
    """Material at one point, inside kernels: numbers only; None for properties that no material of a scene has."""

    kind: int | None
    """None where all materials are Lambertian."""
    roughness: float
    metallic: float
    eta: float | None
    """Index behind the surface over the index on the viewer's side; 0 if the material bounds no volume."""
    pane_index: float | None
    extra: Floats | None
    """(EXTRA_SHARES,)."""
    material: int
    wave: int
    """Number of the path's wavelength."""
