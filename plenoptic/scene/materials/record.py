"""Materials as kernels read them: columns of numbers, and None for what no material of a scene has."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.scene.textures.record import TextureColumn

KIND_NAMES = ("Lambertian", "rough diffuse", "metal", "glass", "panes", "metallic-roughness")
"""What a plan calls the kinds by which kernels scatter."""
LAMBERTIAN, OREN_NAYAR, CONDUCTOR, DIELECTRIC, THIN_DIELECTRIC, METALLIC_ROUGHNESS = range(6)

SMOOTH = 1e-4
"""Below this width of the distribution of normals a surface reflects as if it were perfectly smooth."""

INDEX, EXTINCTION = 0, 1
"""Columns of `Bsdf.metal_index`."""

INSIDE, OUTSIDE = 0, 1
"""Columns of `Bsdf.glass_index`."""


class Bsdf(NamedTuple):
    """How nm materials scatter light; C channels of the scene. All arrays are C-contiguous and read-only."""

    scatters: NDArray[np.uint8]
    """(nm,): 1 for materials that reflect."""
    takes_light: NDArray[np.uint8]
    """(nm,): 1 for those that scatter light drawn directly; not mirrors and polished glass."""
    base_color: NDArray[np.float64]
    """(nm, C), in [0, 1]: base colours; 1 where a texture gives it."""
    roughness: NDArray[np.float64] | None
    """(nm,); 0 where a texture gives it. None, as is the next one, where all materials are Lambertian or black."""
    kind: NDArray[np.int64] | None
    """(nm,): what they are."""
    metallic: NDArray[np.float64] | None
    """(nm,); 0 where a texture gives it. None where none is MetallicRoughness."""
    metal_index: NDArray[np.float64] | None
    """(nm, C, 2): n and k; 0 where the reflectance is constant. None where there is no metal."""
    glass_index: NDArray[np.float64] | None
    """(nm, 2): index behind the front and before it; 0 for what is no body. None where there is none."""
    pane_index: NDArray[np.float64] | None
    """(nm,). None where there is no pane."""
    coupling: NDArray[np.float64] | None
    """What passes the layer of MetallicRoughness: rows at equal steps of the root of the roughness, columns of that of
    the cosine; the last column is the mean over the cosine-weighted hemisphere. None where none is MetallicRoughness.
    """


class Emission(NamedTuple):
    """What nm materials emit."""

    radiance: NDArray[np.float64]
    """(nm, C): emitted radiance, of textures their mean."""
    two_sided: NDArray[np.uint8]
    """(nm,): 1 where both sides emit."""
    pdf: NDArray[np.float64] | None
    """(nm,), 1/mm^2: probability per area with which triangles are drawn as lights. None where none is drawn."""
    texture: TextureColumn | None
    """None where no texture emits."""


class Alpha(NamedTuple):
    """For which paths surfaces of nm materials are there."""

    opacity: NDArray[np.float64]
    """(nm,): fraction of the paths; 0 where a texture gives it."""
    cutoff: NDArray[np.float64]
    """(nm,): opacity from which on the surface is there for all paths, and for none below; -1 where there is none."""
    texture: TextureColumn | None
    """None where no texture gives an opacity."""


class Surface(NamedTuple):
    """What a material is at one point, inside kernels: numbers only, None for what no material of a scene has."""

    kind: int | None
    """None where all materials are Lambertian."""
    roughness: float
    metallic: float
    eta: float | None
    """Index behind the surface over that on the viewer's side; 0 for what is no body."""
    pane_index: float | None
    material: int
    wave: int
    """Number of the path's wavelength."""
