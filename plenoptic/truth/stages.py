"""Stages of the ground truth: representative rays of pixels, their hits, and the images of these by the lens.

Each stage runs when the first channel reads it.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.record import CameraRecord
from plenoptic.core.values import Floats
from plenoptic.optics.lens.record import LensRecord
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.microlens_record import ArrayRecord
from plenoptic.scene.geometry.record import Hits
from plenoptic.truth.channels import Truth
from plenoptic.truth.representative_rays import PixelRays

if TYPE_CHECKING:
    from plenoptic.scene.compile import SceneRecord
    from plenoptic.scene.geometry.accel import Intersector
    from plenoptic.truth.chords import ChordRecord

SLOPE_STEP = 1e-5
"""How much the slopes of neighbouring rays differ, and how far apart they are over the distance of the lens: errors are
of the order of its square, 1e-10, and of the rounding of coordinates over it."""

_TOGETHER = 1 << 10
"""Pixels whose neighbouring rays are traced together."""


class TruthRecord(NamedTuple):
    """Quantities for the ground truth besides camera and scene."""

    wanted: Truth
    frame: Floats | None
    """(12,) from the lens's axes to the camera's; None where they are the same."""
    unvignetted: LensRecord | None
    """The lens in reverse without stops and rims; None where images of points are not wanted."""
    axes: Floats
    """(4, 3): x, y, normal and centre of the array's front principal plane, in the lens's axes."""
    step: float
    """How far aside neighbouring rays start, in mm."""
    numbers: NDArray[np.int64] | None
    """FREE lattices: numbers of the listed lenses, row by row."""
    chords: ChordRecord | None
    """None where they are not wanted, or there are none."""


class SensorRays(NamedTuple):
    """The rays at the sensor, in the local axes of the array."""

    lanes: NDArray[np.int64]
    """(m,): the pixels that get light."""
    directions: Floats
    """(n, 3): from the pixel to where the ray passes the array's rear principal plane, mm."""
    normal: Floats
    """(3,): the sensor's, unit length, towards the array."""


class LitCells(NamedTuple):
    """The microlenses that the rays pass."""

    lit: NDArray[np.bool_]
    """(n,): pixels that get light."""
    cells: Floats
    """(lit, 3): as those of `PixelRays`."""
    array: MicrolensArray
    record: ArrayRecord
    numbers: NDArray[np.int64] | None
    """FREE lattices: numbers of the listed lenses, row by row."""

    def indices(self) -> NDArray[np.int64]:
        """(lit, 2) lattice indices; in FREE lattices (number, 0)."""
        if self.numbers is None:
            lattice = self.record.lattice
            return np.rint((self.cells[:, :2] - lattice.origin) @ lattice.inverse).astype(np.int64)
        number = self.numbers[self.cells[:, 2].astype(np.int64)]
        return np.stack([number, np.zeros_like(number)], axis=1)


class PixelStates(NamedTuple):
    """States of pixels."""

    dark: NDArray[np.bool_]
    """(n,): no light can reach them."""
    lit: NDArray[np.bool_]
    """(n,): their rays leave the lens."""
    met: NDArray[np.int64]
    """(m,): the pixels whose rays meet something."""


class ObjectShares(NamedTuple):
    """Shares of light."""

    lanes: NDArray[np.int64]
    """(m,): the pixels whose rays meet something."""
    share: Floats
    """(m,)."""


class HitPoints(NamedTuple):
    """Points where rays hit the scene."""

    lanes: NDArray[np.int64]
    """(m,): the pixels whose rays meet something."""
    points: Floats
    """(n, 3): where, in the lens's axes, for those."""
    frame: Floats | None
    """(12,) from the lens's axes to the camera's; None where they are the same."""
    rotation: Floats | None
    position: Floats | None
    """From the lens's axes to the world; None where they are the same."""


class SurfaceHits(NamedTuple):
    """Surfaces that rays hit."""

    lanes: NDArray[np.int64]
    """(m,): the pixels whose rays meet something."""
    reached: Floats
    """(m,): how far along the ray, in mm."""
    found: Hits
    """Triangles and instances."""
    rays: Floats
    """(m, 6): origins and directions in the world."""
    scene: SceneRecord


class ImagePoints(NamedTuple):
    """Images of hit points by the main lens."""

    distance: Floats
    """(n,): of the image behind the array's front principal plane, mm; nan where nothing is met."""
    behind: Floats
    """(n,): of the sensor behind the array's rear principal plane at each pixel, mm."""
    pitch: float
    """Of the microlenses, the smaller one, over that of the pixels."""


class Chords(NamedTuple):
    """Disparities between chief rays."""

    lanes: NDArray[np.int64]
    """(m,): the pixels whose rays meet something."""
    disparity: Floats
    """(m,)."""


class PixelStages:
    """The stages for some pixels; each is a property that is found once."""

    def __init__(
        self,
        camera: CameraRecord,
        scene: SceneRecord | None,
        intersector: Intersector | None,
        truth: TruthRecord,
        pixels: Floats,
        rays: PixelRays,
    ) -> None:
        self._camera, self._scene, self._intersector = camera, scene, intersector
        self._truth, self._pixels, self.rays = truth, pixels, rays

    @cached_property
    def _behind(self) -> Floats:
        """(n,): how far each ray starts behind the array's rear principal plane, mm."""
        plane, starts = self._camera.sensor.plane, self.rays.starts
        return (
            np.full(len(starts), plane.distance)
            if plane.tilt is None
            else plane.distance + (starts[:, 0] * plane.tilt[0] + starts[:, 1] * plane.tilt[1])
        )

    @cached_property
    def sensor(self) -> SensorRays:
        """The rays where they start."""
        directions = np.column_stack([self.rays.aims - self.rays.starts, -self._behind])
        normal = -self._camera.parts.sensor_to_local.turn[:, 2]
        return SensorRays(np.flatnonzero(~self.rays.lost), directions, np.ascontiguousarray(normal))

    @cached_property
    def cells(self) -> LitCells:
        """Cells of the microlenses that the rays pass."""
        camera, cells = self._camera, self.rays.cells
        assert camera.microlenses is not None and camera.array is not None
        lit = np.isfinite(cells[:, 0])
        return LitCells(lit, cells[lit], camera.microlenses, camera.array, self._truth.numbers)

    @cached_property
    def hits(self) -> SurfaceHits:
        """Triangles that the rays hit, through surfaces that are transparent for most paths."""
        from plenoptic.core.kernels.bundles import fill_world_rays
        from plenoptic.scene.geometry.kernels import interaction
        from plenoptic.scene.materials.alpha_mask import no_hits, skip_transparent

        camera, scene, intersector, n = self._camera, self._scene, self._intersector, len(self._pixels)
        assert scene is not None and scene.geometry is not None and intersector is not None
        rays, lanes = np.empty((n, 6)), np.empty(n, dtype=np.int64)
        sent = fill_world_rays(rays, lanes, self.rays.blocks, n, camera.rotation, camera.position)
        rays, lanes = rays[:sent], lanes[:sent]
        hits, reached = no_hits(scene, sent), np.empty(sent)
        intersector.fill_closest(hits, rays)
        if scene.alpha is not None:
            skip_transparent(scene, intersector, rays, hits)
        interaction.fill_distances(reached, hits, rays, scene.geometry)
        if hits.travelled is not None:
            reached += hits.travelled
        is_hit = np.isfinite(reached)
        instance = None if hits.instance is None else hits.instance[is_hit]
        return SurfaceHits(
            lanes[is_hit], reached[is_hit], Hits(hits.triangle[is_hit], instance, None), rays[is_hit], scene
        )

    @cached_property
    def states(self) -> PixelStates:
        """States of the pixels."""
        rays, scene = self.rays, self._scene
        meshes = scene is not None and scene.geometry is not None
        return PixelStates(rays.dark, ~rays.lost, self.hits.lanes if meshes else np.empty(0, dtype=np.int64))

    @cached_property
    def shares(self) -> ObjectShares:
        """Shares of the light that come from the objects which the rays hit."""
        from plenoptic.truth.shares import object_shares

        hits, intersector = self.hits, self._intersector
        assert hits.scene.triangle_mesh is not None and intersector is not None
        objects = hits.scene.triangle_mesh[hits.found.triangle]
        fractions = object_shares(self._camera, hits.scene, intersector, self._pixels[hits.lanes], objects)
        return ObjectShares(hits.lanes, fractions)

    @cached_property
    def points(self) -> HitPoints:
        """The points where rays meet the scene."""
        from plenoptic.truth.kernels import depth as point_kernels

        camera, hits = self._camera, self.hits
        points = np.empty((len(self._pixels), 3))
        point_kernels.fill_hit_points(points, self.rays.blocks, hits.lanes, hits.reached)
        return HitPoints(hits.lanes, points, self._truth.frame, camera.rotation, camera.position)

    def world_points(self) -> Floats:
        """(n, 3): the same in the world; nan where nothing is met."""
        from plenoptic.truth.kernels.depth import fill_position

        positions = np.full((len(self._pixels), 3), np.nan)
        fill_position(positions, self.points)
        return positions

    @cached_property
    def images(self) -> ImagePoints:
        """Images of these points by the main lens: by eight rays around each pixel's."""
        from plenoptic.core.kernels.ray_blocks import BLOCK, RAY
        from plenoptic.optics.lens.kernels.trace import fill_traced
        from plenoptic.truth.kernels import virtual_depth

        camera, truth, pixels, rays, hit = self._camera, self._truth, self._pixels, self.rays, self.points
        assert camera.microlenses is not None and truth.unvignetted is not None
        distance = np.full(len(pixels), np.nan)
        for start in range(0, len(hit.lanes) or 1, _TOGETHER):
            lanes = hit.lanes[start : start + _TOGETHER]
            blocks = np.empty(-(-len(lanes) * virtual_depth.NEIGHBOURS // BLOCK) * RAY)
            virtual_depth.fill_neighbours(blocks, rays.before, lanes, truth.axes, truth.step, SLOPE_STEP)
            fill_traced(blocks, truth.unvignetted, None)
            virtual_depth.fill_image_distances(distance, blocks, rays.blocks, hit.points, lanes, truth.step, SLOPE_STEP)
        return ImagePoints(distance, self._behind, min(camera.microlenses.pitches) / camera.sensor.pitch)

    @cached_property
    def chords(self) -> Chords:
        """Displacements of the points' images between neighbouring microlenses."""
        from plenoptic.truth.chords import chord_disparities

        record, hit = self._truth.chords, self.points
        if record is None:
            return Chords(np.empty(0, dtype=np.int64), np.empty(0))
        lenses, entering = self.lenses[hit.lanes], self.entering(record.entrance.z)
        return Chords(hit.lanes, chord_disparities(record, hit.points[hit.lanes], lenses, entering))

    @cached_property
    def lenses(self) -> NDArray[np.int64]:
        """(n, 2): lattice indices of the pixels' microlenses; 0 where they have none."""
        lenses = np.zeros((len(self._pixels), 2), dtype=np.int64)
        lenses[self.cells.lit] = self.cells.indices()
        return lenses

    def entering(self, z: float) -> Floats:
        """(m, 2): where the rays that meet something cross a plane before the lens, in the lens's axes."""
        from plenoptic.core.kernels.ray_blocks import BLOCK

        rays = self.rays.blocks.reshape(-1, 8, BLOCK).swapaxes(1, 2).reshape(-1, 8)[self.hits.lanes]
        ahead = (z - rays[:, 2]) / rays[:, 5]
        return np.asarray(rays[:, :2] + ahead[:, np.newaxis] * rays[:, 3:5])
