"""Channels that are looked up: of the surfaces that pixels show, and of the microlenses through which they see."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.record import CameraRecord
from plenoptic.core.values import Floats
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.microlens.lenslets import types_of
from plenoptic.truth.channels import PixelState
from plenoptic.truth.stages import Chords, LitCells, ObjectShares, PixelStates, SurfaceHits


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


def fill_microlens(indices: NDArray[np.int32], cells: LitCells) -> None:
    """Lattice indices, in FREE lattices (number, 0)."""
    indices[cells.lit] = cells.indices()


def fill_microlens_type(types: NDArray[np.int32], cells: LitCells) -> None:
    """Rows of the array's focal lengths."""
    types[cells.lit] = types_of(cells.array, cells.indices())


def fill_state(states: NDArray[np.int32], pixels: PixelStates) -> None:
    """Write the states of the pixels."""
    states[pixels.dark] = PixelState.DARK
    states[pixels.lit] = PixelState.EMPTY
    states[pixels.met] = PixelState.SEEN


def fill_object_share(shares: Floats, found: ObjectShares) -> None:
    """Shares of the light."""
    shares[found.lanes] = found.share


def fill_chord_disparity(disparities: Floats, chords: Chords) -> None:
    """Slopes between chief rays."""
    disparities[chords.lanes] = chords.disparity


def listed_numbers(camera: CameraRecord) -> NDArray[np.int64] | None:
    """Numbers of the lenses of a FREE array that are listed: those up to some distance along x and y, in order.

    None for other arrays.
    """
    array = camera.microlenses
    if array is None or array.lattice is not Lattice.FREE:
        return None
    assert array.centres is not None
    assert camera.array is not None and camera.array.lens_table is not None
    farther = np.abs(np.asarray(array.centres)).max(axis=1)
    return np.sort(np.argsort(farther, kind="stable")[: len(camera.array.lens_table.lenses)])
