"""Camera rays of ghosts: from the sensor through the opening at the rear of the lens, then along the path of a pair.

The opening stands for the lens of a camera. A ray draws a pair of reflecting surfaces, and is traced through its
unfolded stack.
"""

from __future__ import annotations

import copy
import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import assembly, sensor_corners
from plenoptic.camera.cache import PreparedCamera
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.camera_record import radiance_scale
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, WEIGHT, Z
from plenoptic.core.motions.pose import Pose
from plenoptic.core.sampling import sobol_points
from plenoptic.core.values import Floats, value
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.ghosts.ghost_rays import covering_rays, points_on
from plenoptic.optics.lens.ghosts.unfolded import ghost_stack, pairs_of, reflecting_lens
from plenoptic.optics.lens.lens_record import LensRecord, radiometric_lens_record
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.microlens.dust import BlemishSite
from plenoptic.optics.stops.circle import CircularStop
from plenoptic.optics.surfaces.surface import Surface

_WIDER = 1.02
"""Width of the opening over that needed."""
_PILOT_HEIGHTS, _PILOT_RAYS = (0.05, 0.4, 0.75), 512
"""Image heights over the half diagonal of the sensor, and rays of each, whose light gives the probabilities of pairs."""
_EVEN = 0.1
"""Part of the probability that all pairs share alike: light of a scene need not be that of the pilot."""
_GUIDES = 1024
"""Entries of the guide table for cumulative probabilities; see `fill_waves`."""


@value
class GhostLens:
    """A lens whose ghosts a camera shows, and the plane behind it that reflects, as z in mm and reflectance."""

    lens: LensStack
    sensor: tuple[float, float] | None


class GhostRecord(NamedTuple):
    """Unfolded stacks of pairs of reflecting surfaces for kernels, in the reverse direction."""

    lenses: tuple[LensRecord, ...]
    shifts: Floats
    """(pairs, 2): z in the frame of the stack minus that in the frame of the opening, behind and in front, mm."""
    probability: Floats
    """(pairs,) with which a ray draws each pair."""
    cumulative: Floats
    guide: NDArray[np.int64]
    elements: int
    """Elements of the longest stack."""


def opening_camera(camera: PlenopticCamera) -> PlenopticCamera:
    """The camera with an opening at the last vertex in place of its lens, through which pass all rays to that element.

    Its frame has its origin at the opening.
    """
    lens, z_last = camera.lens, float(camera.lens.vertices[-1])
    parts, along = assembly(camera), np.array([0.0, 0.0, z_last])
    in_lens = parts.local_to_lens.points(sensor_corners(camera, parts)) - along
    height = float(np.hypot(in_lens[:, 0], in_lens[:, 1]).max())
    distance = parts.z_plane - z_last if camera.microlenses is not None else float(in_lens[:, 2].min())
    points = points_on(lens.elements[-1])
    r, sag = np.hypot(points[:, 0], points[:, 1]), np.abs(points[:, 2])
    radius = _WIDER * float((r + sag * (r + height) / np.maximum(distance - sag, 0.1 * distance)).max())
    opening = LensStack(
        [CircularStop(radius), Surface(math.inf, medium=lens.rear_medium, semi_diameter=2.0 * radius)],
        front_medium=lens.rear_medium,
        rear_medium=lens.rear_medium,
        model=LensModel.NONE,
    )
    placement, pose = camera.lens_placement, camera.pose
    if placement is not None:
        shift = np.asarray(placement.shift) + np.asarray(placement.rotation) @ along - along
        placement = dataclasses.replace(placement, shift=shift)
    pose = Pose(np.eye(3), np.zeros(3)) if pose is None else pose
    return dataclasses.replace(
        camera,
        lens=opening,
        stop_to_microlenses=camera.stop_to_microlenses - z_last,
        lens_placement=placement,
        pose=Pose(pose.rotation, np.asarray(pose.position) + np.asarray(pose.rotation) @ along),
        blemishes=tuple(dust for dust in camera.blemishes if dust.site is not BlemishSite.LENS_FRONT),
        diffraction=None,
    )


def ghost_lens(camera: PlenopticCamera, sensor: float | None, array: float | None) -> GhostLens:
    """The lens of a camera with the reflectance of its sensor, or of the flat face of its microlens array."""
    if sensor is not None and camera.microlenses is not None:
        raise InvalidValueError(
            "ghosts have a reflectance of the sensor behind microlenses, from where light is not traced back; give that "
            "of the array, or none"
        )
    if array is not None and camera.microlenses is None:
        raise InvalidValueError(
            "ghosts have a reflectance of the array, and the camera has no microlenses: leave it out"
        )
    reflectance = sensor if camera.microlenses is None else array
    plane = None if reflectance is None else (camera.stop_to_microlenses, reflectance)
    return GhostLens(camera.lens, plane)


def ghost_record(ghosts: GhostLens, camera: PlenopticCamera, wavelengths: Floats | None) -> GhostRecord:
    """Compile the pairs of a lens; `camera` is that of `opening_camera`, `wavelengths` those that paths draw in nm."""
    lens, last = reflecting_lens(ghosts.lens, ghosts.sensor), len(ghosts.lens.elements) - 1
    nm = (camera.wavelength,) if wavelengths is None else tuple(np.unique([camera.wavelength, *wavelengths]).tolist())
    vertices = ghosts.lens.vertices
    stacks = [ghost_stack(lens, pair, last, nm) for pair in pairs_of(lens)]
    if not stacks:
        raise InvalidValueError("the lens has a single reflecting surface, and no pair throws ghosts: leave them out")
    rear = np.array([stack.vertices[-1] for stack in stacks])
    front = np.array([stack.vertices[0] for stack in stacks]) - vertices[0] + vertices[-1]
    light = np.array([_pilot_light(stack, camera) for stack in stacks])
    probability = _EVEN / len(stacks) + (1.0 - _EVEN) * light / light.sum() if light.any() else None
    if probability is None:
        probability = np.full(len(stacks), 1.0 / len(stacks))
    cumulative = np.append(np.cumsum(probability)[:-1], 1.0)
    at = camera.wavelength if wavelengths is None else wavelengths
    return GhostRecord(
        tuple(radiometric_lens_record(stack, at, reverse=True) for stack in stacks),
        np.column_stack([rear, front]),
        probability,
        cumulative,
        np.searchsorted(cumulative, np.arange(_GUIDES) / _GUIDES, side="right"),
        max(len(stack.elements) for stack in stacks),
    )


def ghost_camera(prepared: PreparedCamera, ghosts: GhostLens, camera: PlenopticCamera) -> PreparedCamera:
    """Compiled camera of the ghosts of a lens; `prepared` is the compiled camera of `opening_camera`."""
    record, of_lens = prepared.record, ghosts.lens
    wavelengths = None if record.colour is None else record.colour.wavelengths
    paths = ghost_record(ghosts, camera, wavelengths)
    scale = radiance_scale(of_lens, (camera.wavelength,) if wavelengths is None else tuple(wavelengths.tolist()))
    ghost_images = copy.copy(prepared)
    ghost_images.record = record._replace(ghosts=paths, elements=paths.elements, radiance_scale=scale)
    return ghost_images


def _pilot_light(stack: LensStack, camera: PlenopticCamera) -> float:
    """Light of a uniform scene that arrives at some image points along a stack."""
    uniform, light = sobol_points(_PILOT_RAYS)[:, :2], 0.0
    for height in _PILOT_HEIGHTS:
        offset = height * camera.sensor.half_diagonal / math.sqrt(2.0)
        point = np.array([offset, offset, float(stack.vertices[-1]) + camera.stop_to_microlenses])
        rays = covering_rays(stack.elements[-1], float(stack.vertices[-1]), point, uniform, camera.wavelength)
        light += float(stack.trace_reverse(rays).weight.sum())
    return light


def fill_ghost_rays(
    bundle: Floats, ghosts: GhostRecord, pairs: NDArray[np.int64], waves: NDArray[np.int64] | None
) -> None:
    """Trace the rays of a bundle at the opening along their pairs, in place; weights get the inverse probability."""
    from plenoptic.optics.lens.kernels.trace import fill_through_lens

    rows, trace = bundle.reshape(-1, RAY // BLOCK, BLOCK), fill_through_lens.specialize()
    for pair in np.unique(pairs).tolist():
        rays = np.flatnonzero(pairs == pair)
        whole = np.append(rays, np.full(-len(rays) % BLOCK, rays[0]))  # whole blocks
        block, place = np.divmod(whole, BLOCK)
        part = np.ascontiguousarray(rows[block, :, place].reshape(-1, BLOCK, RAY // BLOCK).transpose(0, 2, 1))
        part[:, Z // BLOCK] += ghosts.shifts[pair, 0]
        trace(part.reshape(-1), ghosts.lenses[pair], None if waves is None else waves[whole])
        part[:, Z // BLOCK] -= ghosts.shifts[pair, 1]
        part[:, WEIGHT // BLOCK] /= ghosts.probability[pair]
        rows[block[: len(rays)], :, place[: len(rays)]] = part.transpose(0, 2, 1).reshape(-1, RAY // BLOCK)[: len(rays)]
