"""The camera that records the ghosts of a lens: an opening at the rear of the lens, and paths of pairs behind it."""

from __future__ import annotations

import copy
import dataclasses
import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import assembly, plane_coefficients, rigid, sensor_corners
from plenoptic.camera.camera_record import radiance_scale
from plenoptic.camera.ghosts.array_reflection import ArrayReflection, Detour
from plenoptic.camera.ghosts.ghost_rays import WIDE, GhostAims, GhostRecord, fill_ghost_rays
from plenoptic.camera.psf.sensor_hits import forward_record
from plenoptic.core.color.spectra import ColourTables
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, WEIGHT
from plenoptic.core.motions.pose import Pose
from plenoptic.core.rays import RayBundle
from plenoptic.core.sampling import sobol_points
from plenoptic.core.values import Floats, value
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.ghosts.ghost_rays import covering_rays, points_on
from plenoptic.optics.lens.ghosts.ghost_settings import Ghosts
from plenoptic.optics.lens.ghosts.unfolded import ghost_stack, pair_records, pairs_of, reflecting_lens
from plenoptic.optics.lens.lens_record import LensRecord
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.placement import Placement
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.microlens.dust import BlemishSite
from plenoptic.optics.microlens.plano_convex import PlateRecord
from plenoptic.optics.microlens.plate_losses import transmission_to_rear
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
_UNSEEN = 0.3
"""Part of the opening by which discs of n lit rays are wider, times the root of n: few rays show little of a disc."""
_EVEN = 0.1
"""Part of the probability that all pairs share alike: light of a scene need not be that of the pilot."""
_BANDS = 8
"""Wavelengths at which the ghosts of a spectral camera are traced."""
_GUIDES = 1024
"""Entries of the guide table for cumulative probabilities; see `fill_waves`."""


class GhostPath(NamedTuple):
    """Unfolded stack of a pair of reflections; the first of them is `reflection`, unless that is None."""

    stack: LensStack
    reflection: ArrayReflection | None


@value
class GhostLens:
    """The lens of a camera whose ghosts are shown, and a plane behind it that reflects: z in mm on the axis of the
    lens, reflectance, and its tilt to that axis.
    """

    camera: PlenopticCamera
    ghosts: Ghosts
    sensor: tuple[float, float] | None
    placement: Placement | None = None

    def paths(self, wavelengths: tuple[float, ...]) -> list[GhostPath]:
        """Paths of all pairs at wavelengths in nm, those by a reflection behind the microlenses last."""
        camera, lens = self.camera, self.camera.lens
        last, whole = len(lens.elements) - 1, reflecting_lens(lens, self.sensor, self.placement)
        paths = [GhostPath(ghost_stack(whole, pair, last, wavelengths), None) for pair in pairs_of(whole)]
        reflections = [] if camera.microlenses is None else array_reflections(camera, self.ghosts, wavelengths)
        if reflections:
            # A mirror in the place of the array divides the stacks.
            whole = reflecting_lens(lens, (reflections[0].parts.z_plane, 1.0))
            stacks = [ghost_stack(whole, pair, last, wavelengths) for pair in pairs_of(whole) if pair[0] > last]
            paths += [GhostPath(stack, reflection) for reflection in reflections for stack in stacks]
        return paths


def path_records(
    paths: list[GhostPath], wavelength: float | Floats, array: int, *, reverse: bool
) -> list[tuple[LensRecord, Detour | None]]:
    """Compiled paths, with the detour behind the elements of each. `array` is the place of the array in stacks."""
    records: list[tuple[LensRecord, Detour | None]] = []
    for path, record in zip(
        paths, pair_records([path.stack for path in paths], wavelength, reverse=reverse), strict=True
    ):
        if path.reflection is None:
            records.append((record, None))
            continue
        count = len(record.rows)
        row, z = count - 1 - array if reverse else array, float(path.stack.vertices[array])
        records.append((_part(record, 0, row), Detour(path.reflection, z, _part(record, row + 1, count))))
    return records


def _part(record: LensRecord, begin: int, end: int) -> LensRecord:
    """Record of elements begin ... end - 1 with their losses."""
    assert record.losses is not None
    return record.part(begin, end)._replace(losses=record.losses.part(begin, end))


def array_reflections(camera: PlenopticCamera, ghosts: Ghosts, wavelengths: tuple[float, ...]) -> list[ArrayReflection]:
    """Mirrors behind the microlenses of a camera: its sensor, and faces of plates.

    Coated microlenses take light on its way to the sensor and back; on the way to the rear face and back, as much as
    along the axis: twice that of the front side and of the glass.
    """
    microlenses = camera.microlenses
    assert microlenses is not None
    faces = () if ghosts.array is None else microlenses.model.refraction.faces(microlenses)
    if ghosts.sensor is None and not faces:
        return []
    is_grey = microlenses.medium is None and microlenses.coating is None
    nm = (camera.wavelength,) if is_grey else wavelengths
    records = [forward_record(dataclasses.replace(camera, wavelength=each)) for each in nm]
    arrays, parts = tuple(record.array for record in records if record.array is not None), records[0].parts
    found = []
    if ghosts.sensor is not None:
        sensor = records[0].sensor._replace(axes=None)
        found.append(ArrayReflection(microlenses, arrays, parts, sensor, (ghosts.sensor,) * len(arrays)))
    if ghosts.array is not None:
        lossless = tuple(array._replace(model=_without_losses(array.model)) for array in arrays)
        front = (ghosts.array,) * len(arrays)
        rear = tuple(
            ghosts.array * transmission_to_rear(microlenses, each, camera.lens.rear_medium) ** 2 for each in nm
        )
        for face, light in zip(faces, (front, rear)[2 - len(faces) :], strict=True):
            found.append(ArrayReflection(microlenses, lossless, parts, face, light))
    return found


def _without_losses(model: tuple[Any, ...] | None) -> tuple[Any, ...] | None:
    return model._replace(losses=None) if isinstance(model, PlateRecord) else model


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
    """The lens of a camera with the plane of its sensor as a mirror, or that of a flat face of its microlenses."""
    microlenses, reflectance, placed, front = camera.microlenses, ghosts.sensor, camera.sensor_placement, 0.0
    if microlenses is not None:
        if ghosts.sensor is not None and not microlenses.model.focuses:
            raise InvalidValueError(
                "ghosts have a reflectance of the sensor, whose light would have to meet pinholes a second time; leave "
                "it out, or choose another model of the microlenses"
            )
        refraction = microlenses.model.refraction
        reflectance = ghosts.array if refraction.is_flat_in_front(microlenses) else None
        placed, front = camera.microlenses_placement, refraction.depths(microlenses).front
    elif ghosts.array is not None:
        raise InvalidValueError(
            "ghosts have a reflectance of the array, and the camera has no microlenses: leave it out"
        )
    if reflectance is None:
        return GhostLens(camera, ghosts, None)
    plane = rigid(camera.lens_placement, 0.0).inverse().of(rigid(placed, camera.stop_to_microlenses))
    z, tilt = plane_coefficients(plane._replace(shift=plane.points(np.array([0.0, 0.0, -front]))))
    return GhostLens(camera, ghosts, (z, reflectance), None if tilt is None else Placement(rotation=plane.turn))


def _bands(colour: ColourTables) -> tuple[Floats, NDArray[np.int64]]:
    """Wavelengths in nm at which ghosts are traced, and the index of one of them for each that paths draw.

    They are the medians of bands of equal probability.
    """
    bands = np.minimum((_BANDS * (colour.cdf - 0.5 * np.diff(colour.cdf, prepend=0.0))).astype(np.int64), _BANDS - 1)
    _, bands = np.unique(bands, return_inverse=True)
    return np.array([np.median(colour.wavelengths[bands == band]) for band in range(bands.max() + 1)]), bands


def ghost_record(ghosts: GhostLens, camera: PlenopticCamera, colour: ColourTables | None) -> GhostRecord:
    """Compile the pairs of a lens; `camera` is that of `opening_camera`, and `colour` has the wavelengths of paths."""
    paths = ghosts.paths((camera.wavelength,))
    if not paths:
        raise InvalidValueError("the lens has a single reflecting surface, and no pair throws ghosts: leave them out")
    record = _record(ghosts, paths, camera.wavelength)
    redirects = camera.microlenses is None and not _is_special(camera)
    light, slope, scale = _pilot(record, ghosts.camera.lens, camera, redirects)
    shares = light / light.sum() if light.any() else np.full(len(paths), 1.0 / len(paths))
    probability = _EVEN / len(paths) + (1.0 - _EVEN) * shares
    aims = GhostAims(redirects, slope, scale, camera.lens.stop.semi_diameter, camera.stop_to_microlenses)
    cumulative = np.append(np.cumsum(np.outer(probability, (WIDE, 1.0 - WIDE)))[:-1], 1.0)
    if colour is not None:
        at, bands = _bands(colour)
        record = _record(ghosts, ghosts.paths(tuple(at.tolist())), at)._replace(bands=bands)
    guide = np.searchsorted(cumulative, np.arange(_GUIDES) / _GUIDES, side="right")
    return record._replace(probability=probability, cumulative=cumulative, guide=guide, aims=aims)


def _record(ghosts: GhostLens, paths: list[GhostPath], wavelength: float | Floats) -> GhostRecord:
    """Compile paths, each of which is drawn with certainty."""
    vertices, array = ghosts.camera.lens.vertices, len(ghosts.camera.lens.elements)
    lenses, detours = zip(*path_records(paths, wavelength, array, reverse=True), strict=True)
    rear = np.array([path.stack.vertices[-1] for path in paths])
    front = np.array([path.stack.vertices[0] for path in paths]) - vertices[0] + vertices[-1]
    return GhostRecord(
        lenses,
        detours,
        shifts=np.column_stack([rear, front]),
        probability=np.ones(len(paths)),
        cumulative=np.ones(1),
        guide=np.zeros(1, dtype=np.int64),
        elements=max(len(path.stack.elements) for path in paths),
        bands=None,
        aims=None,
    )


def ghost_camera(prepared: PreparedCamera, ghosts: GhostLens, camera: PlenopticCamera) -> PreparedCamera:
    """Compiled camera of the ghosts of a lens; `prepared` is the compiled camera of `opening_camera`."""
    record = prepared.record
    paths = ghost_record(ghosts, camera, record.colour)
    nm = (camera.wavelength,) if record.colour is None else tuple(record.colour.wavelengths.tolist())
    scale = radiance_scale(ghosts.camera.lens, nm)
    ghost_images = copy.copy(prepared)
    ghost_images.record = record._replace(ghosts=paths, elements=paths.elements, radiance_scale=scale)
    return ghost_images


def _is_special(camera: PlenopticCamera) -> bool:
    """True if the weights of rays to the opening depend on more than the cosine of their angle."""
    parts = camera.lens_placement, camera.sensor_placement, camera.sensor.angular_response
    return bool(camera.blemishes) or any(part is not None for part in parts)


def _pilot(
    record: GhostRecord, lens: LensStack, camera: PlenopticCamera, redirects: bool
) -> tuple[Floats, Floats, Floats]:
    """Share of rays that each path needs, and slope and scale of its disc; see `GhostAims`.

    Rays from some image points to a uniform scene give them. Shares are as the deviation of light of single rays, which
    for redirected ones is as the light.
    """
    uniform = sobol_points(_PILOT_RAYS)
    offsets, pitch = np.array(_PILOT_HEIGHTS) * camera.sensor.half_diagonal / math.sqrt(2.0), 0.0
    if camera.microlenses is not None:
        pitch = max(camera.microlenses.pitches)  # over all parts of microlenses
    starts = [np.array([offset, offset, camera.stop_to_microlenses]) for offset in offsets]
    beams = [covering_rays(lens.elements[-1], 0.0, at, uniform[:, :2], camera.wavelength) for at in starts]
    origin, direction = (np.concatenate([getattr(b, name) for b in beams]) for name in ("origin", "direction"))
    origin = origin + np.column_stack(
        [np.tile(pitch * (uniform[:, 2:4] - 0.5), (len(starts), 1)), np.zeros(len(origin))]
    )
    at, columns = RayBundle(origin, direction, camera.wavelength).at_z(0.0)[:, :2], []
    rows = np.column_stack([origin, direction, np.ones(len(at)), np.zeros(len(at))])  # whole blocks
    for k in range(len(record.lenses)):
        blocks = np.ascontiguousarray(rows.reshape(-1, BLOCK, RAY // BLOCK).transpose(0, 2, 1))
        fill_ghost_rays(blocks.reshape(-1), record, np.full(len(at), k), None)
        weight = blocks[:, WEIGHT // BLOCK].ravel()
        lit, offset_of = at[weight > 0], np.repeat(offsets, _PILOT_RAYS)[weight > 0]
        if not len(lit):
            columns.append((0.0, 0.0, 1.0))
            continue
        slope = float(offset_of @ lit.mean(axis=1) / (offset_of @ offset_of))
        reach = np.hypot(*(lit - slope * offset_of[:, None]).T).max()
        scale = _DISC_MARGIN * float(reach) / camera.lens.stop.semi_diameter
        if redirects:
            columns.append((float(weight.sum()), slope, min(scale, 1.0)))
        else:
            columns.append((float(np.linalg.norm(weight)), slope, min(scale + _UNSEEN / math.sqrt(len(lit)), 1.0)))
    light, slope, scale = np.array(columns).T
    return light, slope, scale
