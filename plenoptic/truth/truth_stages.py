"""Stages of ground truth, representative rays of pixels, their hits and the images of these; and channels from them.

A stage runs when the first channel reads it.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera_record import CameraRecord
from plenoptic.core.values import Floats
from plenoptic.optics.lens.lens_record import LensRecord
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.microlens.lenslets import types_of
from plenoptic.scene.geometry.geometry_records import Hits
from plenoptic.truth.channels import PixelState, Truth
from plenoptic.truth.representative_rays import RepresentativeRays, ray_fields

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
    front_index: float
    """Refractive index in front of the lens."""
    numbers: NDArray[np.int64] | None
    """FREE lattices: indices of the listed microlenses, by row; None for others."""
    chords: ChordRecord | None
    """None if chord disparity is not requested or not defined."""


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


class PixelStages:
    """Stages for some pixels, each a property that is computed once, and a method `fill_...` for each channel."""

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
        if plane.tilt is None:
            return np.full(len(starts), plane.distance)
        return np.asarray(plane.distance + (starts[:, 0] * plane.tilt[0] + starts[:, 1] * plane.tilt[1]))

    @cached_property
    def lenses(self) -> NDArray[np.int64]:
        """Lattice indices (n, 2) of the pixels' microlenses, in FREE lattices (number, 0); 0 for pixels without one."""
        lenses = np.zeros((len(self._pixels), 2), dtype=np.int64)
        lit = self._has_lens
        lenses[lit] = lattice_indices(self._camera, self.rays.cells[lit], self._truth.numbers)
        return lenses

    @property
    def _has_lens(self) -> NDArray[np.bool_]:
        return np.isfinite(self.rays.cells[:, 0])

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

    @property
    def _objects(self) -> NDArray[np.integer]:
        """Indices (m,) of the meshes that are hit."""
        assert self.hits.scene.triangle_mesh is not None
        return self.hits.scene.triangle_mesh[self.hits.hits.triangle]

    @cached_property
    def points(self) -> Floats:
        """Hit points (m, 3) in the lens's axes."""
        from plenoptic.truth.kernels.hit_points import fill_hit_points

        points = np.empty((len(self.hits.pixels), 3))
        fill_hit_points(points, self.rays.blocks, self.hits.pixels, self.hits.distance)
        return points

    @property
    def world_points(self) -> Floats:
        """Hit points (m, 3) in the world."""
        return self._in_axes(self._camera.rotation, self._camera.position)

    @property
    def _camera_points(self) -> Floats:
        """Hit points (m, 3) in the camera's frame."""
        frame = self._truth.frame
        return self.points if frame is None else self._in_axes(frame[:9].reshape(3, 3), frame[9:])

    def _in_axes(self, rotation: Floats | None, shift: Floats | None) -> Floats:
        from plenoptic.truth.kernels.hit_points import fill_in_axes

        if rotation is None:
            return self.points
        moved = np.empty_like(self.points)
        fill_in_axes(moved, self.points, rotation, shift)
        return moved

    def entering(self, z: float) -> Floats:
        """Intersections (m, 2) of rays with a hit with the plane z in front of the lens, in the lens's axes."""
        rays = ray_fields(self.rays.blocks, self.hits.pixels)
        t = (z - rays[:, 2]) / rays[:, 5]
        return np.asarray(rays[:, :2] + t[:, np.newaxis] * rays[:, 3:5])

    @cached_property
    def _image_distance(self) -> Floats:
        """Distance (n,) in mm behind the array of the main lens's images of the hit points; nan without a hit.

        From eight rays around each representative ray.
        """
        from plenoptic.core.kernels.ray_blocks import BLOCK, RAY
        from plenoptic.optics.lens.kernels.trace import fill_through_lens
        from plenoptic.truth.kernels import virtual_depth

        truth, rays, hit_pixels = self._truth, self.rays, self.hits.pixels
        assert truth.unvignetted is not None
        distance = np.full(len(self._pixels), np.nan)
        for start in range(0, len(hit_pixels) or 1, _CHUNK):
            pixels, points = hit_pixels[start : start + _CHUNK], self.points[start : start + _CHUNK]
            blocks = np.empty(-(-len(pixels) * virtual_depth.NEIGHBOURS // BLOCK) * RAY)
            virtual_depth.fill_neighbours(blocks, rays.before, pixels, truth.axes, truth.step, SLOPE_STEP)
            fill_through_lens(blocks, truth.unvignetted, None)
            virtual_depth.fill_image_distances(distance, blocks, rays.blocks, points, pixels, truth.step, SLOPE_STEP)
        return distance

    def fill_depth(self, depths: Floats) -> None:
        """Fill the depths, -z in the camera's frame, mm."""
        depths[self.hits.pixels] = -self._camera_points[:, 2]

    def fill_distance(self, distances: Floats) -> None:
        """Fill the distances from the camera's origin, mm."""
        from plenoptic.truth.kernels.hit_points import fill_norms

        norms = np.empty(len(self.hits.pixels))
        fill_norms(norms, self._camera_points)
        distances[self.hits.pixels] = norms

    def fill_optical_distance(self, distances: Floats) -> None:
        """Fill the refractive index in front of the lens times the length of the rays there, mm."""
        distances[self.hits.pixels] = self._truth.front_index * self.hits.distance

    def fill_position(self, positions: Floats) -> None:
        """Fill the positions in the world, mm."""
        positions[self.hits.pixels] = self.world_points

    def fill_normal(self, normals: Floats) -> None:
        """Fill the unit normals of the triangles in the world, towards the visible side."""
        from plenoptic.scene.geometry.kernels import interaction

        hits = self.hits
        interaction.fill_normals(normals, hits.pixels, hits.hits, hits.rays, hits.scene.geometry)

    def fill_object(self, numbers: NDArray[np.int32]) -> None:
        """Fill the indices of the meshes."""
        numbers[self.hits.pixels] = self._objects

    def fill_material(self, numbers: NDArray[np.int32]) -> None:
        """Fill the indices of the materials."""
        geometry = self.hits.scene.geometry
        assert geometry is not None
        numbers[self.hits.pixels] = geometry.triangle_material[self.hits.hits.triangle]

    def fill_transmittance(self, shares: Floats) -> None:
        """Fill the transmittances of the medium around the camera up to the hits."""
        from plenoptic.scene.materials.alpha_mask import media_at

        hits, scene = self.hits, self.hits.scene
        shares[hits.pixels] = 1.0
        if scene.absorption is None:
            return
        extinction = scene.absorption if scene.media is None else scene.media.extinction
        bodies = media_at(scene, self._intersector, self._camera.front)
        if (bodies >= 0).any():
            innermost = extinction[bodies[bodies >= 0][-1]]
            shares[hits.pixels] = np.exp(-hits.distance[:, np.newaxis] * innermost)

    def fill_microlens(self, indices: NDArray[np.int32]) -> None:
        """Fill the lattice indices of the microlenses; in FREE lattices (number, 0)."""
        indices[self._has_lens] = self.lenses[self._has_lens]

    def fill_microlens_type(self, types: NDArray[np.int32]) -> None:
        """Fill the types of the microlenses: rows of the array's focal lengths."""
        assert self._camera.microlenses is not None
        types[self._has_lens] = types_of(self._camera.microlenses, self.lenses[self._has_lens])

    def fill_virtual_depth(self, depths: Floats) -> None:
        """Fill the virtual depths: distance of the image behind the array over that of the sensor."""
        depths[:] = self._image_distance / self._sensor_distance

    def fill_disparity(self, disparities: Floats) -> None:
        """Fill the displacements in pixels of the image between neighbouring microlenses, relative to their centres."""
        assert self._camera.microlenses is not None
        pitch = min(self._camera.microlenses.pitches) / self._camera.sensor.pitch
        with np.errstate(divide="ignore"):
            disparities[:] = pitch / (self._image_distance / self._sensor_distance)

    def fill_chord_disparity(self, disparities: Floats) -> None:
        """Fill the disparities by chief rays."""
        from plenoptic.truth.chord_disparity import chord_disparities

        record, pixels = self._truth.chords, self.hits.pixels
        if record is not None:
            entering = self.entering(record.entrance.z)
            disparities[pixels] = chord_disparities(record, self.points, self.lenses[pixels], entering)

    def fill_incidence_angle(self, angles: Floats) -> None:
        """Fill the angles between rays and the sensor's normal, in radians."""
        from plenoptic.truth.kernels.hit_points import fill_incidence

        directions = np.column_stack([self.rays.aims - self.rays.starts, -self._sensor_distance])
        normal = np.ascontiguousarray(-self._camera.parts.sensor_to_local.turn[:, 2])
        fill_incidence(angles, np.flatnonzero(~self.rays.lost), directions, normal)

    def fill_state(self, states: NDArray[np.int32]) -> None:
        """Fill the states of the pixels."""
        states[self.rays.dark] = PixelState.DARK
        states[~self.rays.lost] = PixelState.EMPTY
        if self._scene is not None and self._scene.geometry is not None:
            states[self.hits.pixels] = PixelState.SEEN

    def fill_object_share(self, shares: Floats) -> None:
        """Fill the fractions of light from the pixels' objects."""
        from plenoptic.truth.object_share import object_shares

        hits, intersector = self.hits, self._intersector
        assert intersector is not None
        pixels = self._pixels[hits.pixels]
        shares[hits.pixels] = object_shares(self._camera, hits.scene, intersector, pixels, self._objects)


def lattice_indices(camera: CameraRecord, cells: Floats, numbers: NDArray[np.int64] | None) -> NDArray[np.int64]:
    """Lattice indices (m, 2) of cells (m, 3), see `RepresentativeRays`; in FREE lattices (number, 0).

    `numbers` are those of `lens_numbers`.
    """
    assert camera.array is not None
    if numbers is None:
        lattice = camera.array.lattice
        return np.rint((cells[:, :2] - lattice.origin) @ lattice.inverse).astype(np.int64)
    number = numbers[cells[:, 2].astype(np.int64)]
    return np.stack([number, np.zeros_like(number)], axis=1)


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
