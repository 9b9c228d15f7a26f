"""Stages from which channels are filled: representative rays of pixels, their hits, and the images of these.

A stage runs when the first channel reads it.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera_record import CameraRecord
from plenoptic.core.values import Floats
from plenoptic.optics.lens.record import LensRecord
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.microlens_record import ArrayRecord
from plenoptic.scene.geometry.geometry_records import Hits
from plenoptic.truth.channels import Truth
from plenoptic.truth.representative_rays import RepresentativeRays

if TYPE_CHECKING:
    from plenoptic.scene.geometry.accel import Intersector
    from plenoptic.scene.scene_record import SceneRecord
    from plenoptic.truth.chord_disparity import ChordRecord

SLOPE_STEP = 1e-5
"""Slope difference of neighbouring rays, and their separation over the distance of the lens, for finite differences.
Errors are of the order of its square, 1e-10, and of the rounding of coordinates over it."""

_CHUNK = 1 << 10
"""Pixels whose neighbouring rays are traced together."""


class TruthRecord(NamedTuple):
    """Parameters of ground truth in addition to camera and scene."""

    requested: Truth
    frame: Floats | None
    """(12,): from the lens's axes to the camera's; None if they are the same."""
    unvignetted: LensRecord | None
    """The lens in reverse without stops and rims; None if image distances are not requested."""
    axes: Floats
    """(4, 3): x, y, normal and centre of the array's front principal plane, in the lens's axes."""
    step: float
    """Separation of neighbouring rays at the array, in mm."""
    numbers: NDArray[np.int64] | None
    """FREE lattices: indices of the listed microlenses, by row; None for others."""
    chords: ChordRecord | None
    """None if chord disparity is not requested or not defined."""


class SensorRays(NamedTuple):
    """Representative rays at the sensor, in the local axes of the array."""

    pixels: NDArray[np.int64]
    """(m,): illuminated pixels."""
    directions: Floats
    """(n, 3): from the pixel to the intersection with the array's rear principal plane, mm."""
    normal: Floats
    """(3,): unit normal of the sensor, towards the array."""


class LitCells(NamedTuple):
    """Microlenses of the representative rays."""

    lit: NDArray[np.bool_]
    """(n,): True for illuminated pixels."""
    cells: Floats
    """(lit, 3): see `RepresentativeRays`."""
    array: MicrolensArray
    record: ArrayRecord
    numbers: NDArray[np.int64] | None
    """FREE lattices: indices of the listed microlenses, by row; None for others."""

    def indices(self) -> NDArray[np.int64]:
        """Lattice indices (lit, 2); in FREE lattices (number, 0)."""
        if self.numbers is None:
            lattice = self.record.lattice
            return np.rint((self.cells[:, :2] - lattice.origin) @ lattice.inverse).astype(np.int64)
        number = self.numbers[self.cells[:, 2].astype(np.int64)]
        return np.stack([number, np.zeros_like(number)], axis=1)


class PixelStates(NamedTuple):
    """Pixels by state."""

    dark: NDArray[np.bool_]
    """(n,): True if no light can reach the pixel."""
    lit: NDArray[np.bool_]
    """(n,): True if the ray leaves the lens."""
    hit_pixels: NDArray[np.int64]
    """(m,): pixels whose rays hit a surface."""


class ObjectShares(NamedTuple):
    """Fractions of light from the pixels' objects."""

    pixels: NDArray[np.int64]
    """(m,): pixels whose rays hit a surface."""
    fraction: Floats
    """(m,): fraction of the light."""


class HitPoints(NamedTuple):
    """Hit points of the representative rays."""

    pixels: NDArray[np.int64]
    """(m,): pixels whose rays hit a surface."""
    points: Floats
    """(n, 3): points in the lens's axes, defined for `pixels`."""
    frame: Floats | None
    """(12,): from the lens's axes to the camera's; None if they are the same."""
    rotation: Floats | None
    position: Floats | None
    """Rotation and position from the lens's axes to the world; None if they are the same."""


class SurfaceHits(NamedTuple):
    """Surface hits of the representative rays."""

    pixels: NDArray[np.int64]
    """(m,): pixels whose rays hit a surface."""
    distance: Floats
    """(m,): distance along the ray, in mm."""
    hits: Hits
    """Triangles and instances."""
    rays: Floats
    """(m, 6): origins and directions in the world."""
    scene: SceneRecord


class ImagePoints(NamedTuple):
    """Images of the hit points by the main lens."""

    distance: Floats
    """(n,): distance of the image behind the array's front principal plane, mm; nan without a hit."""
    sensor_distance: Floats
    """(n,): distance of the sensor behind the array's rear principal plane at each pixel, mm."""
    pitch: float
    """Smaller pitch of the microlenses over that of the pixels."""


class Chords(NamedTuple):
    """Disparities by chief rays."""

    pixels: NDArray[np.int64]
    """(m,): pixels whose rays hit a surface."""
    disparity: Floats
    """(m,): pixels."""


class PixelStages:
    """Stages for some pixels; each is a property that is computed once."""

    def __init__(
        self,
        camera: CameraRecord,
        scene: SceneRecord | None,
        intersector: Intersector | None,
        truth: TruthRecord,
        pixels: Floats,
        rays: RepresentativeRays,
    ) -> None:
        self._camera, self._scene, self._intersector = camera, scene, intersector
        self._truth, self._pixels, self.rays = truth, pixels, rays

    @cached_property
    def _sensor_distance(self) -> Floats:
        """Distance (n,) of each ray's start behind the array's rear principal plane, mm."""
        plane, starts = self._camera.sensor.plane, self.rays.starts
        return (
            np.full(len(starts), plane.distance)
            if plane.tilt is None
            else plane.distance + (starts[:, 0] * plane.tilt[0] + starts[:, 1] * plane.tilt[1])
        )

    @cached_property
    def sensor(self) -> SensorRays:
        """Representative rays at the sensor."""
        directions = np.column_stack([self.rays.aims - self.rays.starts, -self._sensor_distance])
        normal = -self._camera.parts.sensor_to_local.turn[:, 2]
        return SensorRays(np.flatnonzero(~self.rays.lost), directions, np.ascontiguousarray(normal))

    @cached_property
    def cells(self) -> LitCells:
        """Microlenses of the representative rays."""
        camera, cells = self._camera, self.rays.cells
        assert camera.microlenses is not None and camera.array is not None
        lit = np.isfinite(cells[:, 0])
        return LitCells(lit, cells[lit], camera.microlenses, camera.array, self._truth.numbers)

    @cached_property
    def hits(self) -> SurfaceHits:
        """Closest hits of the representative rays; transparent (alpha-masked) hits are skipped."""
        from plenoptic.core.kernels.bundles import fill_world_rays
        from plenoptic.scene.geometry.kernels import interaction
        from plenoptic.scene.materials.alpha_mask import no_hits, skip_transparent

        camera, scene, intersector, n = self._camera, self._scene, self._intersector, len(self._pixels)
        assert scene is not None and scene.geometry is not None and intersector is not None
        rays, pixels = np.empty((n, 6)), np.empty(n, dtype=np.int64)
        n_rays = fill_world_rays(rays, pixels, self.rays.blocks, n, camera.rotation, camera.position)
        rays, pixels = rays[:n_rays], pixels[:n_rays]
        hits, distance = no_hits(scene, n_rays), np.empty(n_rays)
        intersector.fill_closest(hits, rays)
        if scene.alpha is not None:
            skip_transparent(scene, intersector, rays, hits)
        interaction.fill_distances(distance, hits, rays, scene.geometry)
        if hits.travelled is not None:
            distance += hits.travelled
        is_hit = np.isfinite(distance)
        instance = None if hits.instance is None else hits.instance[is_hit]
        hits = Hits(hits.triangle[is_hit], instance, None)
        return SurfaceHits(pixels[is_hit], distance[is_hit], hits, rays[is_hit], scene)

    @cached_property
    def states(self) -> PixelStates:
        """Pixels by state."""
        rays, scene = self.rays, self._scene
        meshes = scene is not None and scene.geometry is not None
        return PixelStates(rays.dark, ~rays.lost, self.hits.pixels if meshes else np.empty(0, dtype=np.int64))

    @cached_property
    def object_shares(self) -> ObjectShares:
        """Fractions of the light that come from the objects hit by the representative rays."""
        from plenoptic.truth.object_share import object_shares

        hits, intersector = self.hits, self._intersector
        assert hits.scene.triangle_mesh is not None and intersector is not None
        objects = hits.scene.triangle_mesh[hits.hits.triangle]
        fraction = object_shares(self._camera, hits.scene, intersector, self._pixels[hits.pixels], objects)
        return ObjectShares(hits.pixels, fraction)

    @cached_property
    def points(self) -> HitPoints:
        """Hit points of the representative rays."""
        from plenoptic.truth.kernels import depth as point_kernels

        camera, hits = self._camera, self.hits
        points = np.empty((len(self._pixels), 3))
        point_kernels.fill_hit_points(points, self.rays.blocks, hits.pixels, hits.distance)
        return HitPoints(hits.pixels, points, self._truth.frame, camera.rotation, camera.position)

    def world_points(self) -> Floats:
        """Hit points (n, 3) in the world; nan without a hit."""
        from plenoptic.truth.kernels.depth import fill_position

        positions = np.full((len(self._pixels), 3), np.nan)
        fill_position(positions, self.points)
        return positions

    @cached_property
    def images(self) -> ImagePoints:
        """Images of the hit points by the main lens, from eight rays around each representative ray."""
        from plenoptic.core.kernels.ray_blocks import BLOCK, RAY
        from plenoptic.optics.lens.kernels.trace import fill_traced
        from plenoptic.truth.kernels import virtual_depth

        camera, truth, rays, hit_points = self._camera, self._truth, self.rays, self.points
        assert camera.microlenses is not None and truth.unvignetted is not None
        distance = np.full(len(self._pixels), np.nan)
        for start in range(0, len(hit_points.pixels) or 1, _CHUNK):
            pixels = hit_points.pixels[start : start + _CHUNK]
            blocks = np.empty(-(-len(pixels) * virtual_depth.NEIGHBOURS // BLOCK) * RAY)
            virtual_depth.fill_neighbours(blocks, rays.before, pixels, truth.axes, truth.step, SLOPE_STEP)
            fill_traced(blocks, truth.unvignetted, None)
            arguments = rays.blocks, hit_points.points, pixels, truth.step, SLOPE_STEP
            virtual_depth.fill_image_distances(distance, blocks, *arguments)
        return ImagePoints(distance, self._sensor_distance, min(camera.microlenses.pitches) / camera.sensor.pitch)

    @cached_property
    def chords(self) -> Chords:
        """Disparities of the hit points between neighbouring microlenses, by chief rays."""
        from plenoptic.truth.chord_disparity import chord_disparities

        record, hit_points = self._truth.chords, self.points
        if record is None:
            return Chords(np.empty(0, dtype=np.int64), np.empty(0))
        lenses, entering = self.lenses[hit_points.pixels], self.entering(record.entrance.z)
        return Chords(
            hit_points.pixels, chord_disparities(record, hit_points.points[hit_points.pixels], lenses, entering)
        )

    @cached_property
    def lenses(self) -> NDArray[np.int64]:
        """Lattice indices (n, 2) of the pixels' microlenses; 0 for pixels without one."""
        lenses = np.zeros((len(self._pixels), 2), dtype=np.int64)
        lenses[self.cells.lit] = self.cells.indices()
        return lenses

    def entering(self, z: float) -> Floats:
        """Intersections (m, 2) of rays with a hit with the plane z in front of the lens, in the lens's axes."""
        from plenoptic.core.kernels.ray_blocks import BLOCK

        rays = self.rays.blocks.reshape(-1, 8, BLOCK).swapaxes(1, 2).reshape(-1, 8)[self.hits.pixels]
        t = (z - rays[:, 2]) / rays[:, 5]
        return np.asarray(rays[:, :2] + t[:, np.newaxis] * rays[:, 3:5])
