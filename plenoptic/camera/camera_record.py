"""Record of a camera for the kernels between sensor and scene: numbers only."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import Assembly, assembly, lens_to_world
from plenoptic.camera.diffraction import DeflectionRecord, IrisRecord, deflection_record, iris_record
from plenoptic.camera.dust import PlacedDust, placed_dust
from plenoptic.camera.sampling.diffraction_kernel import DiffractionKernel, diffraction_kernel
from plenoptic.camera.sampling.region_bounds import array_bounds, bounds_reason, openings, sensor_bounds
from plenoptic.camera.sampling.sampling_records import Openings
from plenoptic.core.color.spectra import ColourTables, colour_tables
from plenoptic.core.values import Floats
from plenoptic.optics.element_record import IDEAL
from plenoptic.optics.lens.gaussian.paraxial import outer_indices
from plenoptic.optics.lens.lens_record import LensRecord, radiometric_lens_record
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.lens.transmission_fit import TransmissionFit, transmission_fit
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.microlens_record import (
    MICROLENS,
    ArrayRecord,
    ResponseRecord,
    SensorPlane,
    WellsRecord,
    array_record,
)
from plenoptic.optics.microlens.plate_losses import add_losses
from plenoptic.optics.sensor.dual_pixels import DualPixels
from plenoptic.optics.stops.stop_registry import Stop, is_convex

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.camera.ghosts.ghost_rays import GhostRecord


class PixelRecord(NamedTuple):
    """Light-sensitive area of a pixel, or its whole cell; lengths in mm."""

    width: float
    height: float
    skew: Floats | None
    """(2,): x component of its height, y component of its width; None for pixels along x and y."""

    @property
    def half(self) -> tuple[float, float]:
        """Half sides in mm of its bounding box along x and y."""
        aligned = (0.0, 0.0) if self.skew is None else self.skew
        return 0.5 * (abs(self.width) + abs(float(aligned[0]))), 0.5 * (abs(self.height) + abs(float(aligned[1])))

    def within(self, parts: Floats) -> Floats:
        """Points (n, 2) from its centre in mm, of points in units of its width and height."""
        aligned = np.zeros(2) if self.skew is None else self.skew
        return np.asarray(parts * [self.width, self.height] + parts[:, ::-1] * aligned)


class SensorRecord(NamedTuple):
    """Record of the sensor; lengths in mm."""

    rows: int
    columns: int
    pitch: float
    pixel: PixelRecord
    pixel_cell: PixelRecord
    """Cell of a pixel, including its insensitive area."""
    fill_factor: float
    """Ratio of light-sensitive area and cell."""
    plane: SensorPlane
    response: ResponseRecord | WellsRecord | None
    """None if the response of pixels is isotropic."""


class OutlinePlane(NamedTuple):
    """Plane of the outlines of the exit pupil."""

    distance: float
    """Distance from the start of rays towards the lens in mm; with a frame, z of the plane in the lens's axes."""
    frame: Floats | None
    """(12,): from the axes in which the array is traced to the lens's; None if they differ in z alone."""


class PupilRecord(NamedTuple):
    """Outlines of the exit pupil (see `PupilBounds`), and parameters of the rays to it."""

    normals: Floats
    support: Floats
    corners: Floats
    reach: Floats
    disconnected: NDArray[np.bool_]
    step: float
    z: float
    plane: OutlinePlane
    margin: float
    """Largest deviation of real rays from those of an ideal microlens, on the plane of the outlines, in mm."""
    pinhole: bool
    """True if light passes the centres of microlenses only."""


class CameraRecord(NamedTuple):
    """Record of a camera; lengths in mm, in the axes in which the array is traced (see `Assembly`)."""

    sensor: SensorRecord
    array: ArrayRecord | None
    """None without microlenses."""
    pupil: PupilRecord
    lens: LensRecord
    colour: ColourTables | None
    """Wavelengths drawn by paths; None if all have the camera's."""
    dispersed: LensRecord | None
    """The lens at those wavelengths."""
    dust: tuple[PlacedDust, ...]
    parts: Assembly
    microlenses: MicrolensArray | None
    rotation: Floats | None
    """Rotation from the lens's axes to the world; None if they are the same."""
    position: Floats | None
    openings: Openings
    """Openings of the elements of the lens."""
    exact: bool
    """True if aperture regions are clipped by these openings, False if by bounds on the pupil alone."""
    elements: int
    """Lens elements, for counting lost rays."""
    convex: bool
    """True if the holes of all stops are convex."""
    deflection: DeflectionRecord | None
    """None without diffraction at microlenses."""
    diffraction_kernel: DiffractionKernel | None
    """Weights by which pixels share light; None without diffraction, or if all deflections are drawn."""
    iris: IrisRecord | None
    """None without diffraction at the iris."""
    radiance_scale: Floats | None
    """(1,) or (W,): radiance behind the lens over that in front, (n' / n)^2, at the camera's wavelength or at those
    drawn by paths. None for one medium on both sides."""
    transmission: TransmissionFit | None = None
    """Transmission of rays through a lens that is then traced without losses; None: it has none, or they are traced."""
    ghosts: GhostRecord | None = None
    """Paths through which rays are traced in place of the lens, to images of its ghosts; None: through the lens."""

    @property
    def frame(self) -> Floats | None:
        """(12,): from the axes in which the array is traced to the lens's; None if they differ in z alone."""
        return self.parts.frame

    @property
    def front(self) -> Floats:
        """(3,): the point of the lens's axis at which rays leave the lens towards the scene, in the world, in mm."""
        last = self.lens.rows[-1]
        z = float(last["z"]) + (float(last["max_depth"]) if last["kind"] == IDEAL else 0.0)
        if self.rotation is None or self.position is None:
            return np.array([0.0, 0.0, z])
        return np.asarray(self.position + z * self.rotation[:, 2])

    def lenslet_parameters(self, n: int) -> NDArray[np.void] | None:
        """Empty lenslet parameters of n paths, in whole blocks; None if all microlenses are alike."""
        return None if self.array is None or not self.array.differs else np.zeros(n, MICROLENS)


def camera_record(camera: PlenopticCamera) -> CameraRecord:
    """Compile a camera into a record, with bounds on the exit pupil by tracing."""
    lens, array, parts = camera.lens, camera.microlenses, assembly(camera)
    colour = None if camera.sensitivity is None else colour_tables(camera.sensitivity)
    wavelengths = (camera.wavelength,)
    if colour is not None:
        wavelengths = tuple(np.unique([colour.wavelengths[0], camera.wavelength, colour.wavelengths[-1]]).tolist())
    path_wavelengths = (camera.wavelength, *(() if colour is None else colour.wavelengths.tolist()))
    z_last, margin, microlens_record = float(lens.vertices[-1]), 0.0, None
    if array is None:
        bounds = sensor_bounds(camera, parts, wavelengths)
    else:
        array_limits = array_bounds(camera, array, parts, wavelengths)
        bounds, margin = array_limits.pupil, array_limits.margin
        microlens_record = array_record(
            array,
            turn=parts.array_turn,
            origin=parts.array_origin,
            reach=array_limits.reach,
            margin=array_limits.lateral,
            wavelengths=path_wavelengths,
        )
        microlens_record = add_losses(microlens_record, array, path_wavelengths, lens.rear_medium)
    plane = OutlinePlane(z_last if parts.frame is not None else parts.z_plane - z_last, parts.frame)
    pinhole = array is not None and not array.model.focuses
    world = lens_to_world(camera, parts)
    deflection, sensor = deflection_record(camera, parts, path_wavelengths), _sensor_record(camera, parts)
    kernel = None if deflection is None else diffraction_kernel(camera, sensor, parts, deflection, colour)
    return CameraRecord(
        sensor=sensor,
        array=microlens_record,
        pupil=PupilRecord(*bounds, plane, margin, pinhole),
        lens=radiometric_lens_record(lens, camera.wavelength, reverse=True),
        colour=colour,
        dispersed=None if colour is None else radiometric_lens_record(lens, colour.wavelengths, reverse=True),
        dust=placed_dust(camera, parts),
        parts=parts,
        microlenses=array,
        rotation=None if world is None else world.turn,
        position=None if world is None else world.shift,
        openings=openings(lens, camera.wavelength if colour is None else colour.wavelengths),
        exact=not bounds_reason(camera, with_core=False),
        elements=len(lens.elements),
        convex=all(is_convex(element) for element in lens.elements if isinstance(element, Stop)),
        deflection=deflection,
        diffraction_kernel=kernel,
        iris=iris_record(camera, path_wavelengths),
        radiance_scale=radiance_scale(lens, (camera.wavelength,) if colour is None else path_wavelengths[1:]),
    )


def lens_transmission(record: CameraRecord) -> TransmissionFit | None:
    """Transmission of rays from the array, or the sensor without one, through the outlines of the exit pupil."""
    pupil, parts, lens = record.pupil, record.parts, record.lens if record.dispersed is None else record.dispersed
    if lens.losses is None:
        return None
    z_start = parts.z_plane + (parts.distance if record.array is None else 0.0)
    start = z_start, len(pupil.support) * pupil.step
    return transmission_fit(lens, start, (pupil.z, float(pupil.reach.max())))


def radiance_scale(lens: LensStack, wavelengths: tuple[float, ...]) -> Floats | None:
    """Ratio of radiances behind the lens and in front of it: L / n^2 is constant along a ray."""
    if lens.front_medium == lens.rear_medium:
        return None
    indices = np.array([outer_indices(lens, wavelength) for wavelength in wavelengths])
    return np.asarray((indices[:, 1] / indices[:, 0]) ** 2)


def _sensor_record(camera: PlenopticCamera, parts: Assembly) -> SensorRecord:
    sensor = camera.sensor
    turn = parts.sensor_to_local.turn[:2, :2]
    return SensorRecord(
        rows=sensor.shape[0],
        columns=sensor.shape[1],
        pitch=sensor.pixel_pitch,
        pixel=_pixel_record(turn * (np.asarray(sensor.pixel_aperture) * sensor.pixel_pitch)),
        pixel_cell=_pixel_record(turn * sensor.pixel_pitch),
        fill_factor=sensor.fill_factor,
        plane=SensorPlane(parts.distance, parts.tilt),
        response=response_record(camera, parts),
    )


def _pixel_record(sides: Floats) -> PixelRecord:
    """Pixel whose sides, in local x and y, are the columns of a matrix."""
    skew = None if sides[0, 1] == sides[1, 0] == 0 else np.array([sides[0, 1], sides[1, 0]])
    return PixelRecord(float(sides[0, 0]), float(sides[1, 1]), skew)


def response_record(camera: PlenopticCamera, parts: Assembly) -> ResponseRecord | WellsRecord | None:
    """Angular response of the camera's pixels; None if it is isotropic."""
    response, placement = camera.sensor.angular_response, parts.sensor_to_local
    if response is None:
        return None
    aligned = np.array_equal(placement.turn, np.eye(3)) and not placement.shift[:2].any()
    frame = None if aligned else np.concatenate([placement.turn.ravel(), placement.shift])
    if isinstance(response, DualPixels):
        table = None if response.table is None else response.table_response()
        inverse, ends = 1.0 / response.pupil_distance, (response.intervals(1), response.intervals(0))
        return WellsRecord(response.depth, inverse, *ends, table, frame)
    return ResponseRecord(response.well_depth, response.index, 1.0 / response.pupil_distance, response.exponent, frame)
