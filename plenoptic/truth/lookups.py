"""Channels by table look-up: surfaces hit by rays of pixels, and their microlenses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera_record import CameraRecord
from plenoptic.core.values import Floats
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.microlens.lenslets import types_of
from plenoptic.truth.channels import PixelState
from plenoptic.truth.truth_stages import Chords, LitCells, ObjectShares, PixelStates, SurfaceHits


def fill_normal(normals: Floats, hits: SurfaceHits) -> None:
    """Fill the unit normals of the triangles in the world, towards the visible side."""
    from plenoptic.scene.geometry.kernels import interaction

    interaction.fill_normals(normals, hits.pixels, hits.hits, hits.rays, hits.scene.geometry)


def fill_object(numbers: NDArray[np.int32], hits: SurfaceHits) -> None:
    """Fill the indices of the meshes."""
    assert hits.scene.triangle_mesh is not None
    numbers[hits.pixels] = hits.scene.triangle_mesh[hits.hits.triangle]


def fill_material(numbers: NDArray[np.int32], hits: SurfaceHits) -> None:
    """Fill the indices of the materials."""
    assert hits.scene.geometry is not None
    numbers[hits.pixels] = hits.scene.geometry.triangle_material[hits.hits.triangle]


def fill_microlens(indices: NDArray[np.int32], cells: LitCells) -> None:
    """Fill the lattice indices of the microlenses; in FREE lattices (number, 0)."""
    indices[cells.lit] = cells.indices()


def fill_microlens_type(types: NDArray[np.int32], cells: LitCells) -> None:
    """Fill the types of the microlenses: rows of the array's focal lengths."""
    types[cells.lit] = types_of(cells.array, cells.indices())


def fill_state(states: NDArray[np.int32], pixels: PixelStates) -> None:
    """Fill the states of the pixels."""
    states[pixels.dark] = PixelState.DARK
    states[pixels.lit] = PixelState.EMPTY
    states[pixels.hit_pixels] = PixelState.SEEN


def fill_object_share(shares: Floats, object_shares: ObjectShares) -> None:
    """Fill the fractions of light from the pixels' objects."""
    shares[object_shares.pixels] = object_shares.fraction


def fill_chord_disparity(disparities: Floats, chords: Chords) -> None:
    """Fill the disparities by chief rays."""
    disparities[chords.pixels] = chords.disparity


def lens_numbers(camera: CameraRecord) -> NDArray[np.int64] | None:
    """Indices of the listed microlenses of a FREE array, those up to some distance along x and y, in order.

    None for other lattices.
    """
    array = camera.microlenses
    if array is None or array.lattice is not Lattice.FREE:
        return None
    assert array.centres is not None
    assert camera.array is not None and camera.array.lens_table is not None
    distance = np.abs(np.asarray(array.centres)).max(axis=1)
    return np.sort(np.argsort(distance, kind="stable")[: len(camera.array.lens_table.lenses)])
