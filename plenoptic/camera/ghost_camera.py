"""The camera that records the ghosts of a lens: an opening at the rear of the lens, and paths of pairs behind it."""

from __future__ import annotations

import copy
import dataclasses
import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import assembly, sensor_corners
from plenoptic.camera.camera_record import radiance_scale
from plenoptic.camera.ghost_rays import WIDE, GhostAims, GhostRecord
from plenoptic.core.color.spectra import ColourTables
from plenoptic.core.motions.pose import Pose
from plenoptic.core.rays import RayBundle
from plenoptic.core.sampling import sobol_points
from plenoptic.core.values import Floats, value
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.ghosts.ghost_rays import covering_rays, points_on
from plenoptic.optics.lens.ghosts.ghost_settings import Ghosts
from plenoptic.optics.lens.ghosts.unfolded import ghost_stack, pairs_of, reflecting_lens
from plenoptic.optics.lens.lens_record import radiometric_lens_record
from plenoptic.optics.lens.loss_record import table_cosines
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.microlens.dust import BlemishSite
from plenoptic.optics.stops.circle import CircularStop
from plenoptic.optics.surfaces.surface import Surface

if TYPE_CHECKING:
    from plenoptic.camera.cache import PreparedCamera
    from plenoptic.camera.camera import PlenopticCamera

_WIDER = 1.02
"""Width of the opening over that needed."""
_PILOT_HEIGHTS, _PILOT_RAYS = (0.05, 0.4, 0.75), 512
"""Image heights over the half diagonal of the sensor, and rays of each, whose light gives probabilities of pairs."""
_DISC_MARGIN = 1.15
"""Radius of the disc of a pair over that of its light in the pilot."""
_EVEN = 0.1
"""Part of the probability that all pairs share alike: light of a scene need not be that of the pilot."""
_MOST_BANDS, _TABLE_BYTES = 8, 1 << 28
"""Most wavelengths at which the ghosts of a spectral camera are traced, and largest size of their tables in bytes."""
_GUIDES = 1024
"""Entries of the guide table for cumulative probabilities; see `fill_waves`."""


@value
class GhostLens:
    """A lens whose ghosts a camera shows, and the plane behind it that reflects, as z in mm and reflectance."""

    lens: LensStack
    sensor: tuple[float, float] | None


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


def ghost_lens(camera: PlenopticCamera, ghosts: Ghosts) -> GhostLens:
    """The lens of a camera with the reflectance of its sensor, or of a plane at the first vertex of its microlenses."""
    sensor, array = ghosts.sensor, ghosts.array
    if sensor is not None and camera.microlenses is not None:
        raise InvalidValueError(
            "ghosts have a reflectance of the sensor, and light is not traced back through microlenses; give that of "
            "the array, or none"
        )
    if array is not None and camera.microlenses is None:
        raise InvalidValueError(
            "ghosts have a reflectance of the array, and the camera has no microlenses: leave it out"
        )
    z, reflectance, microlenses = camera.stop_to_microlenses, sensor, camera.microlenses
    if microlenses is not None:
        z, reflectance = z - microlenses.model.refraction.depths(microlenses).front, array
    return GhostLens(camera.lens, None if reflectance is None else (z, reflectance))


def _bands(stacks: list[LensStack], colour: ColourTables) -> tuple[Floats, NDArray[np.int64]]:
    """Wavelengths in nm at which ghosts are traced, and the index of one of them for each that paths draw.

    They are the medians of bands of equal probability, as many as tables of reflectances find room for.
    """
    size = sum(len(stack.elements) for stack in stacks) * table_cosines().nbytes
    count = min(max(_TABLE_BYTES // size, 1), _MOST_BANDS)
    bands = np.minimum((count * (colour.cdf - 0.5 * np.diff(colour.cdf, prepend=0.0))).astype(np.int64), count - 1)
    _, bands = np.unique(bands, return_inverse=True)
    return np.array([np.median(colour.wavelengths[bands == band]) for band in range(bands.max() + 1)]), bands


def ghost_record(ghosts: GhostLens, camera: PlenopticCamera, colour: ColourTables | None) -> GhostRecord:
    """Compile the pairs of a lens; `camera` is that of `opening_camera`, and `colour` has the wavelengths of paths."""
    lens, last = reflecting_lens(ghosts.lens, ghosts.sensor), len(ghosts.lens.elements) - 1
    pairs, vertices = pairs_of(lens), ghosts.lens.vertices
    if not pairs:
        raise InvalidValueError("the lens has a single reflecting surface, and no pair throws ghosts: leave them out")
    stacks = [ghost_stack(lens, pair, last, (camera.wavelength,)) for pair in pairs]
    light, slope, scale = np.array([_pilot(stack, camera) for stack in stacks]).T
    shares = light / light.sum() if light.any() else np.full(len(stacks), 1.0 / len(stacks))
    probability = _EVEN / len(stacks) + (1.0 - _EVEN) * shares
    aims, draws = None, probability
    if camera.microlenses is None and not _is_special(camera):
        aims = GhostAims(slope, scale, camera.lens.stop.semi_diameter, camera.stop_to_microlenses)
        draws = np.outer(probability, (WIDE, 1.0 - WIDE)).ravel()
    cumulative = np.append(np.cumsum(draws)[:-1], 1.0)
    at: float | Floats = camera.wavelength
    bands = None
    if colour is not None:
        at, bands = _bands(stacks, colour)
        stacks = [ghost_stack(lens, pair, last, tuple(at.tolist())) for pair in pairs]
    rear = np.array([stack.vertices[-1] for stack in stacks])
    front = np.array([stack.vertices[0] for stack in stacks]) - vertices[0] + vertices[-1]
    return GhostRecord(
        tuple(radiometric_lens_record(stack, at, reverse=True) for stack in stacks),
        np.column_stack([rear, front]),
        probability,
        cumulative,
        np.searchsorted(cumulative, np.arange(_GUIDES) / _GUIDES, side="right"),
        max(len(stack.elements) for stack in stacks),
        bands,
        aims,
    )


def ghost_camera(prepared: PreparedCamera, ghosts: GhostLens, camera: PlenopticCamera) -> PreparedCamera:
    """Compiled camera of the ghosts of a lens; `prepared` is the compiled camera of `opening_camera`."""
    record = prepared.record
    paths = ghost_record(ghosts, camera, record.colour)
    nm = (camera.wavelength,) if record.colour is None else tuple(record.colour.wavelengths.tolist())
    scale = radiance_scale(ghosts.lens, nm)
    ghost_images = copy.copy(prepared)
    ghost_images.record = record._replace(ghosts=paths, elements=paths.elements, radiance_scale=scale)
    return ghost_images


def _is_special(camera: PlenopticCamera) -> bool:
    """True if the weights of rays to the opening depend on more than the cosine of their angle."""
    parts = camera.lens_placement, camera.sensor_placement, camera.sensor.angular_response
    return bool(camera.blemishes) or any(part is not None for part in parts)


def _pilot(stack: LensStack, camera: PlenopticCamera) -> tuple[float, float, float]:
    """Light of a uniform scene at some image points along a stack, and slope and scale of its disc; see `GhostAims`."""
    uniform, z_last = sobol_points(_PILOT_RAYS)[:, :2], float(stack.vertices[-1])
    offsets = np.array(_PILOT_HEIGHTS) * camera.sensor.half_diagonal / math.sqrt(2.0)
    beams = [
        covering_rays(
            stack.elements[-1],
            z_last,
            np.array([offset, offset, z_last + camera.stop_to_microlenses]),
            uniform,
            camera.wavelength,
        )
        for offset in offsets
    ]
    origin, direction = (np.concatenate([getattr(b, name) for b in beams]) for name in ("origin", "direction"))
    rays = RayBundle(origin, direction, camera.wavelength)
    weight = stack.trace_reverse(rays).weight
    at, offset_of = rays.at_z(z_last)[weight > 0, :2], np.repeat(offsets, _PILOT_RAYS)[weight > 0]
    if not len(at):
        return 0.0, 0.0, 1.0
    slope = float(offset_of @ at.mean(axis=1) / (offset_of @ offset_of))
    reach = np.hypot(*(at - slope * offset_of[:, None]).T).max()
    return float(weight.sum()), slope, min(_DISC_MARGIN * float(reach) / camera.lens.stop.semi_diameter, 1.0)
