"""Channels of the surfaces that pixels show."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.truth.stages import Hits


def fill_normal(normals: NDArray[np.float64], hits: Hits) -> None:
    """Unit normals of the triangles in the world, towards the side that is seen."""
    from plenoptic.scene.geometry.kernels import interaction

    scene = hits.scene
    interaction.fill_normals(
        normals,
        hits.lanes,
        hits.triangle,
        hits.instance,
        hits.rays,
        scene.vertices,
        scene.triangles,
        hits.instance_to_world,
    )


def fill_object(numbers: NDArray[np.int32], hits: Hits) -> None:
    """Numbers of the meshes."""
    assert hits.scene.triangle_mesh is not None
    numbers[hits.lanes] = hits.scene.triangle_mesh[hits.triangle]


def fill_material(numbers: NDArray[np.int32], hits: Hits) -> None:
    """Numbers of the materials."""
    assert hits.scene.triangle_material is not None
    numbers[hits.lanes] = hits.scene.triangle_material[hits.triangle]
