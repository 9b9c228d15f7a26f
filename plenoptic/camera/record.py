"""A camera as the numbers that the kernels between sensor and scene read."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import Assembly, Rigid, assembly
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.diffraction import BendRecord, IrisRecord, bend_record, iris_record
from plenoptic.camera.dust import PlacedDust, placed_dust
from plenoptic.camera.sampling.bounds import array_bounds, sensor_bounds
from plenoptic.camera.sampling.choice import why_bounds
from plenoptic.camera.sampling.openings import openings
from plenoptic.camera.sampling.record import Openings
from plenoptic.camera.sampling.spread import Spread, spread_of
from plenoptic.core.color.spectra import ColourTables, colour_tables
from plenoptic.core.values import Floats
from plenoptic.optics.lens.record import LensRecord, lens_record
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.microlens_record import (
    ArrayRecord,
    ResponseRecord,
    SensorPlane,
    array_record,
    possible_powers,
)
from plenoptic.optics.stops.stop_registry import Stop, is_convex


class PixelRecord(NamedTuple):
    """The part of a pixel that sees light."""

    width: float
    height: float
    skew: Floats | None
    """(2,): how far its width leads along y, at [1], and its height along x, at [0]; None for pixels along x and y."""

    @property
    def half(self) -> tuple[float, float]:
        """Half sides in mm of the box around it along x and y."""
        along = (0.0, 0.0) if self.skew is None else self.skew
        return 0.5 * (abs(self.width) + abs(float(along[0]))), 0.5 * (abs(self.height) + abs(float(along[1])))

    def within(self, parts: Floats) -> Floats:
        """Points (n, 2) from its centre, of those in parts of its width and height."""
        along = np.zeros(2) if self.skew is None else self.skew
        return np.asarray(parts * [self.width, self.height] + parts[:, ::-1] * along)


class SensorRecord(NamedTuple):
    """Lengths in mm."""

    rows: int
    columns: int
    pitch: float
    pixel: PixelRecord
    whole: PixelRecord
    """The same with what lies between it and its neighbours."""
    fill_factor: float
    """The part of a pixel that sees light."""
    plane: SensorPlane
    response: ResponseRecord | None
    """None where pixels see all directions alike."""


class OutlinePlane(NamedTuple):
    """The plane of the outlines of the exit pupil."""

    distance: float
    """From where rays start towards the lens; with a frame, the place of the plane in the lens's axes."""
    frame: Floats | None
    """(12,): from the axes in which the array is traced to the lens's; None where they are the same but for z."""


class PupilRecord(NamedTuple):
    """Outlines of the exit pupil (see `PupilBounds`), and how light gets there."""

    normals: Floats
    support: Floats
    corners: Floats
    reach: Floats
    parted: NDArray[np.bool_]
    step: float
    z: float
    plane: OutlinePlane
    margin: float
    """How far a real microlens's rays stray from an ideal one's on the plane of the outlines, in mm."""
    pinhole: bool
    """Whether light passes the centres of microlenses only."""


class CameraRecord(NamedTuple):
    """Numbers only; lengths in mm, in the axes in which the array is traced (see `Assembly`)."""

    sensor: SensorRecord
    array: ArrayRecord | None
    """None without microlenses."""
    pupil: PupilRecord
    lens: LensRecord
    colour: ColourTables | None
    """The wavelengths that paths draw; None where all have the camera's."""
    dispersed: LensRecord | None
    """The lens at those wavelengths."""
    dust: tuple[PlacedDust, ...]
    parts: Assembly
    z_plane: float
    """Where rays start towards the lens: the front principal plane, or the last lens vertex."""
    microlenses: MicrolensArray | None
    rotation: Floats | None
    """From the lens's axes to the world; None where they are the same."""
    position: Floats | None
    openings: Openings
    """What its elements let pass."""
    exact: bool
    """Whether what feeds pixels is found through these, where paths are traced, or by bounds on the pupil alone."""
    elements: int
    """Lens elements, for counting lost rays."""
    convex: bool
    """Whether the holes of all stops are."""
    bend: BendRecord | None
    """None where light does not bend at microlenses."""
    spread: Spread | None
    """Short bends, of which light is shared between pixels; None without bends, and where all are drawn."""
    iris: IrisRecord | None
    """None where it does not bend at the iris."""

    @property
    def frame(self) -> Floats | None:
        """(12,): from the axes in which the array is traced to the lens's; None where they are the same but for z."""
        return self.parts.frame

    def own(self, n: int) -> NDArray[np.void] | None:
        """Arrays for the microlens parameters of n paths, in whole blocks; None where microlenses do not differ."""
        return None if self.array is None else self.array.own(n)


def camera_record(camera: PlenopticCamera) -> CameraRecord:
    """Compile a camera: numbers for the kernels, with bounds on the exit pupil found by tracing."""
    lens, array, parts = camera.lens, camera.microlenses, assembly(camera)
    colour = None if camera.sensitivity is None else colour_tables(camera.sensitivity)
    wavelengths = (camera.wavelength,)
    if colour is not None:
        wavelengths = tuple(np.unique([colour.wavelengths[0], camera.wavelength, colour.wavelengths[-1]]).tolist())
    drawn = (camera.wavelength, *(() if colour is None else colour.wavelengths.tolist()))
    z_last, margin, compiled = float(lens.vertices[-1]), 0.0, None
    if array is None:
        bounds = sensor_bounds(camera, parts, wavelengths)
    else:
        bounds_of_array = array_bounds(camera, array, parts, possible_powers(array), wavelengths)
        bounds, margin = bounds_of_array.pupil, bounds_of_array.margin
        compiled = array_record(
            array,
            turn=parts.array_turn,
            origin=parts.array_origin,
            reach=bounds_of_array.reach,
            margin=bounds_of_array.aside,
            wavelengths=drawn,
        )
    plane = OutlinePlane(z_last if parts.frame is not None else parts.z_plane - z_last, parts.frame)
    pinhole = array is not None and not array.model.focuses
    world = world_of(camera, parts)
    bend, sensor = bend_record(camera, parts, drawn), _sensor_record(camera, parts)
    return CameraRecord(
        sensor=sensor,
        array=compiled,
        pupil=PupilRecord(*bounds, plane, margin, pinhole),
        lens=lens_record(lens, camera.wavelength, reverse=True),
        colour=colour,
        dispersed=None if colour is None else lens_record(lens, colour.wavelengths, reverse=True),
        dust=placed_dust(camera, parts),
        parts=parts,
        z_plane=parts.z_plane,
        microlenses=array,
        rotation=None if world is None else world.turn,
        position=None if world is None else world.shift,
        openings=openings(lens, camera.wavelength if colour is None else colour.wavelengths),
        exact=not why_bounds(camera, certain=False),
        elements=len(lens.elements),
        convex=all(is_convex(element) for element in lens.elements if isinstance(element, Stop)),
        bend=bend,
        spread=None if bend is None else spread_of(camera, sensor, parts, bend, colour),
        iris=iris_record(camera, drawn),
    )


def world_of(camera: PlenopticCamera, parts: Assembly) -> Rigid | None:
    """From the lens's axes to the world; None where they are the same."""
    if camera.pose is None:
        return parts.lens_to_camera
    pose = Rigid(np.asarray(camera.pose.rotation), np.asarray(camera.pose.position))
    return pose if parts.lens_to_camera is None else pose.of(parts.lens_to_camera)


def _sensor_record(camera: PlenopticCamera, parts: Assembly) -> SensorRecord:
    sensor = camera.sensor
    turn = parts.sensor_to_local.turn[:2, :2]
    return SensorRecord(
        rows=sensor.shape[0],
        columns=sensor.shape[1],
        pitch=sensor.pixel_pitch,
        pixel=_pixel_record(turn * (np.asarray(sensor.pixel_aperture) * sensor.pixel_pitch)),
        whole=_pixel_record(turn * sensor.pixel_pitch),
        fill_factor=sensor.fill_factor,
        plane=SensorPlane(parts.distance, parts.tilt),
        response=response_record(camera, parts),
    )


def _pixel_record(sides: Floats) -> PixelRecord:
    """One whose sides, in local x and y, are the columns of a matrix."""
    skew = None if sides[0, 1] == sides[1, 0] == 0 else np.array([sides[0, 1], sides[1, 0]])
    return PixelRecord(float(sides[0, 0]), float(sides[1, 1]), skew)


def response_record(camera: PlenopticCamera, parts: Assembly) -> ResponseRecord | None:
    """Angular response of the camera's pixels; None where it is the same for all directions."""
    response, placed = camera.sensor.angular_response, parts.sensor_to_local
    if response is None:
        return None
    along = np.array_equal(placed.turn, np.eye(3)) and not placed.shift[:2].any()
    frame = None if along else np.concatenate([placed.turn.ravel(), placed.shift])
    return ResponseRecord(response.well_depth, response.index, 1.0 / response.pupil_distance, response.exponent, frame)
