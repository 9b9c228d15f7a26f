"""A camera as the numbers that the kernels between sensor and scene read, and the stages it needs."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import Assembly, Rigid, assembly
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.sampling.bounds import array_bounds, sensor_bounds
from plenoptic.camera.sampling.margins import fill_plates
from plenoptic.core.color.spectra import ColourTables, colour_tables
from plenoptic.optics.lens.pupil.exit_pupil import PupilBounds
from plenoptic.optics.lens.record import LensRecord, lens_record
from plenoptic.optics.microlens.array import MicrolensArray, MicrolensModel
from plenoptic.optics.microlens.dust import Blemishes, BlemishSite, BlemishTables, blemish_tables, plane_axes
from plenoptic.optics.microlens.record import ArrayTables, array_tables, possible_powers
from plenoptic.optics.sensor.angular_response import AngularResponse


class PlacedBlemishes(NamedTuple):
    """Dust and scratches with the axes of their plane."""

    site: BlemishSite
    height: float
    axes: NDArray[np.float64] | None
    """(2, 3): from the axes in which rays are there to those of the plane; None where they are the same."""
    tables: BlemishTables


class CameraTables(NamedTuple):
    """Numbers only; lengths in mm, in the axes in which the array is traced (see `Assembly`)."""

    rows: int
    columns: int
    pitch: float
    parts: Assembly
    pixel_edges: NDArray[np.float64]
    """(2,): width and height of the part of a pixel that sees light."""
    pixel_skew: NDArray[np.float64] | None
    """(2,): how far its width leads along y, at [1], and its height along x, at [0]; None for pixels along x and y."""
    fill_factor: float
    """The part of a pixel that sees light."""
    response: AngularResponse | None
    """None where pixels see all directions alike."""
    blemishes: tuple[PlacedBlemishes, ...]
    distance: float
    """From the plane on which samples are aimed to the sensor along the axis."""
    lean: NDArray[np.float64] | None
    """(2,): how that distance grows with x and y; None for a sensor parallel to the array."""
    z_plane: float
    """Where rays start towards the lens: the front principal plane, or the last lens vertex."""
    gap: float
    """From there to the plane of the outlines; with a `frame`, the place of that plane in the lens's axes."""
    frame: NDArray[np.float64] | None
    """(12,): from these axes to the lens's; None where they are the same but for z."""
    bounds: PupilBounds
    slack: float
    """How far a real microlens's rays stray from an ideal one's on the plane of the outlines, in mm."""
    lens: LensRecord
    colour: ColourTables | None
    """The wavelengths that paths draw; None where all have the camera's."""
    dispersed: LensRecord | None
    """The lens at those wavelengths."""
    cells: ArrayTables | None
    """None without microlenses."""
    array: MicrolensArray | None
    rotation: NDArray[np.float64] | None
    """From the lens's axes to the world; None where they are the same."""
    position: NDArray[np.float64] | None
    elements: int
    """Lens elements, for counting lost rays."""


def camera_tables(camera: PlenopticCamera) -> CameraTables:
    """Compile a camera: tables for the kernels, with bounds on the exit pupil found by tracing."""
    lens, array, parts = camera.lens, camera.microlenses, assembly(camera)
    colour = None if camera.sensitivity is None else colour_tables(camera.sensitivity)
    wavelengths = (camera.wavelength,)
    if colour is not None:
        wavelengths = tuple(np.unique([colour.wavelengths[0], camera.wavelength, colour.wavelengths[-1]]).tolist())
    z_last, slack, cells = float(lens.vertices[-1]), 0.0, None
    if array is None:
        bounds = sensor_bounds(camera, parts, wavelengths)
    else:
        found = array_bounds(camera, array, parts, possible_powers(array), wavelengths)
        bounds, slack = found.pupil, found.slack
        cells = array_tables(
            array, turn=parts.array_turn, origin=parts.array_origin, reach=found.reach, stray=found.stray
        )
    world, sides = _lens_to_world(camera, parts), _pixel_sides(camera, parts)
    return CameraTables(
        rows=camera.sensor.shape[0],
        columns=camera.sensor.shape[1],
        pitch=camera.sensor.pixel_pitch,
        parts=parts,
        pixel_edges=np.ascontiguousarray(np.diag(sides)),
        pixel_skew=None if sides[0, 1] == sides[1, 0] == 0 else np.array([sides[0, 1], sides[1, 0]]),
        fill_factor=camera.sensor.fill_factor,
        response=camera.sensor.angular_response,
        blemishes=tuple(
            placed_blemishes(blemishes, parts, float(lens.vertices[0]), z_last)
            for blemishes in camera.blemishes
            if len(blemishes)
        ),
        distance=parts.distance,
        lean=parts.lean,
        z_plane=parts.z_plane,
        gap=z_last if parts.frame is not None else parts.z_plane - z_last,
        frame=parts.frame,
        bounds=bounds,
        slack=slack,
        lens=lens_record(lens, camera.wavelength, reverse=True),
        colour=colour,
        dispersed=None if colour is None else lens_record(lens, colour.wavelengths, reverse=True),
        cells=cells,
        array=array,
        rotation=None if world is None else world.turn,
        position=None if world is None else world.shift,
        elements=len(lens.elements),
    )


def _pixel_sides(camera: PlenopticCamera, parts: Assembly) -> NDArray[np.float64]:
    """(2, 2): its columns are the sides of the part of a pixel that sees light, in local x and y."""
    sides = np.asarray(camera.sensor.pixel_aperture) * camera.sensor.pixel_pitch
    return np.asarray(parts.sensor_to_local.turn[:2, :2] * sides)


def _sensor_frame(tables: Dims) -> NDArray[np.float64] | None:
    """(12,) from the sensor's axes to the local ones; None where they differ along the axis only."""
    placed = tables.parts.sensor_to_local
    if np.array_equal(placed.turn, np.eye(3)) and not placed.shift[:2].any():
        return None
    return np.concatenate([placed.turn.ravel(), placed.shift])


class Dims(Protocol):
    """What dims light besides lens and microlenses: of a camera's tables, these fields are read."""

    @property
    def parts(self) -> Assembly:
        """How the parts stand."""

    @property
    def distance(self) -> float:
        """From the array to the sensor."""

    @property
    def lean(self) -> NDArray[np.float64] | None:
        """How that grows with x and y."""

    @property
    def response(self) -> AngularResponse | None:
        """Of the pixels."""

    @property
    def blemishes(self) -> tuple[PlacedBlemishes, ...]:
        """Dust and scratches."""


def fill_before_array(blocks: NDArray[np.float64], tables: Dims) -> None:
    """What happens to aimed samples between the sensor and the array."""
    seen = tables.response
    if seen is not None:
        from plenoptic.optics.microlens.kernels import to_lens

        to_lens.fill_pixel_response(
            blocks,
            tables.distance,
            tables.lean,
            _sensor_frame(tables),
            seen.well_depth,
            seen.index,
            1.0 / seen.pupil_distance,
            seen.exponent,
        )
    if not tables.blemishes:
        return
    from plenoptic.optics.microlens.kernels import dust

    for placed in tables.blemishes:
        if placed.site is BlemishSite.SENSOR:
            dust.fill_dimmed_aims(blocks, tables.distance, tables.lean, placed.height, placed.axes, *placed.tables)
        elif placed.site is BlemishSite.ARRAY:
            dust.fill_dimmed_aims(blocks, tables.distance, tables.lean, None, placed.axes, *placed.tables)


def fill_dimmed_at_lens(blocks: NDArray[np.float64], tables: Dims, site: BlemishSite) -> None:
    """Dust on the lens: LENS_REAR before, LENS_FRONT behind the lens as seen from the sensor."""
    from plenoptic.optics.microlens.kernels import dust

    for placed in tables.blemishes:
        if placed.site is site:
            dust.fill_dimmed_rays(blocks, placed.height, placed.axes, *placed.tables)


def placed_blemishes(blemishes: Blemishes, parts: Assembly, z_first: float, z_last: float) -> PlacedBlemishes:
    """Blemishes with the axes of their plane; the height of those on the lens is their z there."""
    site, axes, height = blemishes.site, None, blemishes.height
    if site is BlemishSite.SENSOR:
        axes = plane_axes(*parts.sensor_to_local, height=height)
    elif site is BlemishSite.ARRAY:
        turn = np.eye(3)
        turn[:2, :2] = parts.array_turn
        axes = plane_axes(turn, np.append(parts.array_origin, 0.0))
    else:
        height = z_last if site is BlemishSite.LENS_REAR else z_first
    return PlacedBlemishes(site, height, axes, blemish_tables(blemishes))


def _lens_to_world(camera: PlenopticCamera, parts: Assembly) -> Rigid | None:
    """From the lens's axes to the world; None where they are the same."""
    if camera.pose is None:
        return parts.lens_to_camera
    pose = Rigid(np.asarray(camera.pose.rotation), np.asarray(camera.pose.position))
    return pose if parts.lens_to_camera is None else pose.of(parts.lens_to_camera)


def lanes_for(tables: CameraTables, n: int) -> NDArray[np.float64] | None:
    """Room for what n paths, in whole blocks, keep of their microlenses; None where these do not differ."""
    from plenoptic.optics.microlens.kernels.to_lens import LANE

    return np.zeros((n, LANE)) if tables.cells is not None and tables.cells.differs else None


def fill_through_array(blocks: NDArray[np.float64], lanes: NDArray[np.float64] | None, tables: CameraTables) -> None:
    """Aimed samples (see `to_lens`) become rays on their way to the lens, in its axes."""
    from plenoptic.optics.microlens.kernels import to_lens

    array, cells, lean = tables.array, tables.cells, tables.lean
    z_plane = tables.z_plane if tables.frame is None else 0.0
    if array is None or cells is None:
        to_lens.fill_straight(blocks, tables.distance, lean, z_plane)
        return
    power = float(cells.powers[0])
    if cells.walls and lanes is not None:
        to_lens.fill_walls(blocks, lanes, cells.cell, None if cells.listed is None else cells.listed.cells)
    if array.is_plate:
        fill_plates(blocks, array, tables.distance, lean, z_plane, power, lanes, cells)
    else:
        if lanes is not None:
            to_lens.fill_openings(blocks, lanes, cells.radius2, cells.opening)
        if array.model is MicrolensModel.PINHOLE:
            to_lens.fill_pinholes(blocks, tables.distance, lean, z_plane)
        else:
            to_lens.fill_thin(blocks, tables.distance, lean, power, lanes, z_plane)
    if tables.frame is not None:
        to_lens.fill_in_lens_axes(blocks, tables.frame)
