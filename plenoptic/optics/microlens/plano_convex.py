"""Plano-convex microlenses of glass: exact ones, and flat ones of high index with the normals of a sphere."""

from __future__ import annotations

import enum
import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.optics.element_record import PathWorkspace
from plenoptic.optics.lens.loss_record import LossRecord
from plenoptic.optics.lens.trace import RayArrays, in_chunks
from plenoptic.optics.microlens.imperfections import extreme_factors, largest_offset
from plenoptic.optics.microlens.model_records import ArrayCrossing, Depths, LensletRows, Pair, TracedPaths, Waves

if TYPE_CHECKING:
    from plenoptic.core.rays import RayBundle
    from plenoptic.optics.microlens.array import MicrolensArray
    from plenoptic.optics.microlens.microlens_record import ArrayRecord, SensorPlane

_HIGH_INDEX = 10.0
"""Smallest index of flat plates."""


class ConvexSide(enum.IntEnum):
    """Curved side of a plano-convex microlens. See `MicrolensArray`."""

    SCENE = 0
    SENSOR = 1


class PlateRecord(NamedTuple):
    """Plano-convex lenses: a plane and a sphere of radius (index - 1) / power."""

    towards_scene: bool
    """True if the curved side faces the scene."""
    flat: bool
    """True if a plane with the normals of the sphere stands for it."""
    thickness: float
    refractive_index: float
    """At 587.6 nm: it fixes the principal planes and the curvature of the sphere."""
    indices: Floats | None
    """At the camera's wavelength, then at those sampled by paths; None if all equal that at 587.6 nm."""
    losses: LossRecord | None = None
    """Of either side and, in one row, of the glass, at these wavelengths; None without a coating."""


class PlanoConvexMicrolenses(NamedTuple):
    """Refraction by a sphere and a plane of glass; members as of `IdealMicrolenses`."""

    is_flat: bool
    focuses: bool = True
    is_plate: bool = True
    is_thin: bool = False

    def record(self, array: MicrolensArray, wavelengths: tuple[float, ...]) -> PlateRecord:
        """Record of a plate at the camera's wavelength and those sampled by paths."""
        indices = np.array([array.index_at(w) for w in wavelengths])
        side, flat = array.convex_side is ConvexSide.SCENE, self.is_flat
        return PlateRecord(
            side, flat, array.thickness, array.index, indices if (indices != array.index).any() else None
        )

    def check(self, array: MicrolensArray) -> None:
        """Check that spheres cover their openings, that glass is thicker than their sag, and the index high enough."""
        shortest = min(array.focal_lengths)
        if shortest < 0:
            raise InvalidValueError(
                f"focal length {shortest:g} mm: a plano-convex microlens collects light; use one above 0"
            )
        radius = shortest * extreme_factors(array.imperfections)[0] * (array.index - 1.0)
        reach = array.opening.reach + largest_offset(array.imperfections)
        if radius < reach:
            raise InvalidValueError(
                f"radius of curvature {radius:g} mm is below the corner of the opening at {reach:g} mm, "
                "imperfections included; increase the focal length or the index, or reduce the pitch or the spread"
            )
        if self.is_flat:
            if array.index < _HIGH_INDEX:
                remedy = "give index=100.0" if array.medium is None else "leave the medium out and give index=100.0"
                raise InvalidValueError(
                    f"index of the microlenses is {array.index:g}; FLAT_HIGH_INDEX stands for a nearly flat lens and "
                    f"needs at least {_HIGH_INDEX:g}: {remedy}, or choose SPHERICAL"
                )
            return
        sag = reach**2 / (radius + math.sqrt(radius**2 - reach**2))
        if sag > array.thickness:
            raise InvalidValueError(
                f"thickness {array.thickness:g} mm is below the sag {sag:g} mm at the opening's corner; increase it"
            )

    def depths(self, array: MicrolensArray) -> Depths:
        """Principal planes: one at the vertex of the curved side, the other thickness / index from the flat side."""
        inside, separation = array.thickness / array.index, array.thickness * (1.0 - 1.0 / array.index)
        towards_scene = array.convex_side is ConvexSide.SCENE
        return Depths(0.0, separation, inside) if towards_scene else Depths(inside, separation, 0.0)

    def shift_chief_rays(
        self, array: MicrolensArray, points: Floats, slopes: Floats, wavelength: float, rear: bool
    ) -> Floats:
        """Displacement on the flat side of rays through the vertex of the curved side.

        Inside, they run at the slope tan t' with sin t = n sin t': they cross the thickness by thickness tan t', and
        the principal plane lies thickness / n from the vertex, n at 587.6 nm.
        tan t' / tan t = cos t / sqrt(n^2 - sin^2 t).
        """
        if rear is not (array.convex_side is ConvexSide.SCENE):
            return points
        tangent2 = np.sum(slopes**2, axis=1, keepdims=True)
        sine2 = tangent2 / (1.0 + tangent2)
        inside = np.sqrt((1.0 - sine2) / (array.index_at(wavelength) ** 2 - sine2))
        return np.asarray(points + array.thickness * (inside - 1.0 / array.index) * slopes)

    def exit_points(self, array: MicrolensArray, power: float, aimed: Pair, slopes: Pair, leaving: Pair) -> Pair:
        """Exit points on the curved side, which is its sag away from the plane of its vertex."""
        if array.convex_side is ConvexSide.SCENE:
            return leaving
        x, y = aimed
        if not self.is_flat:
            radius = (array.index - 1.0) / power
            for _ in range(8):
                r2 = np.minimum(x**2 + y**2, radius**2)
                sag = r2 / (radius + np.sqrt(radius**2 - r2))
                x, y = aimed[0] + slopes[0] * sag, aimed[1] + slopes[1] * sag
        return x, y

    def to_lens(self, blocks: Floats, lenslets: LensletRows, crossing: ArrayCrossing, waves: Waves) -> None:
        """Turn aimed samples into rays towards the main lens."""
        from plenoptic.optics.microlens.kernels.plano_convex import fill_plano_convex

        plate, array = crossing.array.model, crossing.array
        assert isinstance(plate, PlateRecord)
        sampled = None if plate.indices is None and plate.losses is None else waves
        fill_plano_convex(blocks, lenslets, crossing.sensor, plate, array.power, array.edges, crossing.z_plane, sampled)

    def to_sensor(self, blocks: Floats, crossing: ArrayCrossing, differs: bool) -> None:
        """Trace rays behind the main lens to the sensor."""
        from plenoptic.optics.microlens.kernels.plano_convex_forward import fill_plano_convex_forward

        array, sensor, z_front = crossing
        plate = array.model
        assert isinstance(plate, PlateRecord)
        # As in `depths`.
        inside = plate.thickness / plate.refractive_index
        if plate.towards_scene:
            sensor = sensor._replace(distance=sensor.distance - inside)
        else:
            z_front -= inside
        fill_plano_convex_forward(blocks, z_front, sensor, plate, array, array if differs else None)

    def mirror_image(self, model: tuple[Any, ...] | None) -> PlateRecord:
        """Plates whose curved side faces the other way."""
        assert isinstance(model, PlateRecord)
        return model._replace(towards_scene=not model.towards_scene)

    def faces(self, array: MicrolensArray) -> tuple[SensorPlane | None, ...]:
        """Both faces, or the curved one if light meets the plane first; FLAT_HIGH_INDEX has no height."""
        if self.is_flat:
            return ()
        from plenoptic.optics.microlens.microlens_record import SensorPlane  # imports this module

        flat = SensorPlane(self.depths(array).rear, None)
        return (None, flat) if array.convex_side is ConvexSide.SCENE else (None,)

    def is_flat_in_front(self, array: MicrolensArray) -> bool:
        """True if light from the lens meets a plane first."""
        return self.is_flat or array.convex_side is ConvexSide.SENSOR

    def reflect(self, blocks: Floats, crossing: ArrayCrossing, differs: bool) -> None:
        """Trace rays behind the main lens to the curved sides, which reflect them, and back to the front principal
        plane, in the mirror image of space; on exit they are as those of `to_sensor`.
        """
        from plenoptic.optics.microlens.kernels.curved_mirror import fill_curved_reflection

        array, sensor, z_front = crossing
        plate = array.model
        assert isinstance(plate, PlateRecord)
        inside = 0.0 if plate.towards_scene else plate.thickness / plate.refractive_index
        plane = sensor._replace(distance=-inside)
        fill_curved_reflection(blocks, z_front - inside, plane, plate, array, array if differs else None)

    def trace_rays(
        self, rays: RayBundle, traced: TracedPaths, array: ArrayRecord, differs: bool, index: float
    ) -> RayBundle:
        """Trace rays through an array, and fill `traced` with their optical paths."""
        from plenoptic.core.kernels.ray_blocks import BLOCK
        from plenoptic.optics.microlens.kernels.plano_convex_forward import fill_plate_paths

        def fill(out: RayArrays, rays_in: RayArrays, first: int, end: int) -> None:
            workspace = PathWorkspace(np.array([1.0, index]), np.empty((6, BLOCK)), np.empty(BLOCK))
            fill_plate_paths(out, traced, rays_in, array, array if differs else None, workspace, first, end)

        return in_chunks(fill, rays)
