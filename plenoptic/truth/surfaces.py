"""Channels of the surfaces that pixels show."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.truth.stages import SurfaceHits


def fill_normal(normals: Floats, hits: SurfaceHits) -> None:
    """Unit normals of the triangles in the world, towards the side that is seen."""
    from plenoptic.scene.geometry.kernels import interaction

    interaction.fill_normals(normals, hits.lanes, hits.found, hits.rays, hits.scene.geometry)


def fill_object(numbers: NDArray[np.int32], hits: SurfaceHits) -> None:
    """Numbers of the meshes."""
    assert hits.scene.triangle_mesh is not None
    numbers[hits.lanes] = hits.scene.triangle_mesh[hits.found.triangle]


def fill_material(numbers: NDArray[np.int32], hits: SurfaceHits) -> None:
    """Numbers of the materials."""
    assert hits.scene.geometry is not None
    numbers[hits.lanes] = hits.scene.geometry.triangle_material[hits.found.triangle]
