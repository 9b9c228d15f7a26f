"""Bounds from which aperture regions are computed, and the choice of the method for them.

Bounds are openings of the lens's elements (circles, or convex polygons around the holes of stops), outlines of the exit
pupil seen from the microlenses in use, and margins for rays of real microlenses. The method is chosen without tracing.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from plenoptic.camera.assembly import Assembly, assembly, sensor_corners
from plenoptic.camera.diffraction import deflection_border
from plenoptic.camera.gaussian import model_pupil
from plenoptic.camera.sampling.sampling_records import GROUP_SIDE, Openings
from plenoptic.core.values import Floats, read_only
from plenoptic.optics.lens.lens_record import ideal_stop_image, lens_record
from plenoptic.optics.lens.loss_record import has_losses
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.pupil.exit_pupil import PupilBounds, pupil_bounds, rear_reach
from plenoptic.optics.lens.pupil.outline import normals_of, polygon_around
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.microlens.aperture import ApertureShape, Walls, has_clear_gaps
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.imperfections import largest_offset
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.microlens.microlens_record import SensorPlane, lone_lens, possible_powers
from plenoptic.optics.microlens.model_records import ArrayCrossing
from plenoptic.optics.stops.polygon import convex_hull
from plenoptic.optics.stops.stop_registry import Stop, is_convex, stop_kind
from plenoptic.optics.surfaces.surface import Surface

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera

_N_AIMS, _N_OFFSETS = 33, 49
_SAFETY = 1.25
"""Factor on margins that are computed on a grid of rays."""
_MAX_NEAR, _MAX_NEAR_WITH_CORE = 12.0, 48.0
"""Most microlenses near a pixel on the axis for which polygons are clipped for each path, without and with unvignetted
cores. With more, clipping takes longer than its lower variance saves, and bounds on the pupil are used."""
_SIDES, _POINTS, _ROUNDING = 32, 1 << 12, 1e-5
"""Sides of a polygon around a hole, points of its outline, and the sagitta of an arc between these over its radius."""


def openings(lens: LensStack, wavelength: float | Floats) -> Openings:
    """Openings of a lens for light from the sensor, at one wavelength (nm) or an array of them."""
    semi_diameter2 = lens_record(lens, wavelength, reverse=True).rows["semi_diameter2"]
    bare = lens_record(lens, wavelength, reverse=True, clipping=False)
    ideal = lens.model in (LensModel.THIN, LensModel.PARAXIAL)
    edges, exact = [np.zeros((0, 3)) for _ in bare.rows], np.ones(len(bare.rows), dtype=np.bool_)
    for k, number in enumerate(bare.rows["surface_index"]):
        element = lens.elements[number]
        if isinstance(element, Stop) and np.isfinite(semi_diameter2[k]):
            edges[k], exact[k] = _edges(ideal_stop_image(lens, float(np.ravel(wavelength)[0]))[0] if ideal else element)
        elif isinstance(element, Surface) and not ideal:
            exact[k] = element.depth is None and element.freeform is None
    return Openings(
        elements=tuple(bare.part(k, k + 1) for k in range(len(bare.rows))),
        semi_diameter2=np.ascontiguousarray(semi_diameter2),
        edges=np.concatenate(edges),
        first_edge=np.cumsum([0, *map(len, edges)], dtype=np.int64),
        exact=exact,
    )


def _edges(stop: Stop) -> tuple[Floats, bool]:
    """Edges (n, 3) of a convex polygon around a hole, outward normal and distance; and True if it equals the hole.

    Holes within a circle that they touch all around have no edges.
    """
    kind = stop_kind(stop)
    if kind.has_round_edge:
        return np.zeros((0, 3)), kind.is_convex
    outline, corners = np.asarray(stop.outline(_POINTS)), convex_hull(np.asarray(stop.outline(3)))
    sides = np.roll(corners, -1, axis=0) - corners
    normals = np.stack([sides[:, 1], -sides[:, 0]], axis=1) / np.hypot(sides[:, 0], sides[:, 1])[:, None]
    reach = (outline @ normals.T).max(axis=0)
    is_curved = np.any(reach > (corners * normals).sum(axis=1) + 1e-9 * stop.semi_diameter)
    if is_curved or len(corners) > _SIDES:
        normals, exact = normals_of(_SIDES), False
        reach = (outline @ normals.T).max(axis=0) + _ROUNDING * stop.semi_diameter
    else:
        exact = is_convex(stop)
    return np.column_stack([normals, reach]), exact


def microlenses_near(camera: PlenopticCamera) -> float:
    """Approximate number of microlenses that illuminate a pixel on the axis, by the paraxial pupil."""
    array, parts = camera.microlenses, assembly(camera)
    if array is None:
        return 1.0
    distance = parts.z_plane - float(camera.lens.vertices[-1])
    ratio = distance / parts.distance
    strongest = float(np.abs(ray_height_factors(array, distance, ratio)).max())
    height = _pupil_reach(camera, parts.z_plane) + strongest * array.cell_radius
    search = (height + ratio * camera.sensor.pixel_pitch) / (1.0 + ratio) + array.cell_radius
    area = math.prod(array.pitches) if array.lattice is Lattice.FREE else array.cell_area
    return 1.0 + math.pi * search**2 / area


def _pupil_reach(camera: PlenopticCamera, z_plane: float) -> float:
    """Largest height in mm at which light towards the centre of the array crosses the plane of the last vertex."""
    (z, size), z_last = model_pupil(camera), float(camera.lens.vertices[-1])
    rim_radius = rear_reach(camera.lens, z_plane, camera.wavelength)[0]
    pupil_radius = (
        abs(size) * camera.lens.stop.semi_diameter * (z_plane - z_last) / (z_plane - z) if z < z_plane else math.inf
    )
    return min(pupil_radius, rim_radius) if math.isfinite(pupil_radius) else rim_radius


def ray_height_factors(array: MicrolensArray, distance: float, ratio: float) -> Floats:
    """Displacement of rays on the plane of the last vertex per displacement of their point in a cell.

    One for each of the `possible_powers`; `ratio` is the distance of that plane over that of the sensor.
    """
    powers = possible_powers(array)
    return np.asarray(1.0 + ratio - distance * powers if array.model.focuses else np.zeros_like(powers))


def bounds_reason(camera: PlenopticCamera, *, with_core: bool) -> str:
    """Reason to bound aperture regions by the pupil alone; empty if they are clipped for each point of a pixel.

    `with_core`: the unvignetted core is needed.
    """
    if camera.microlenses is not None and has_clear_gaps(camera.microlenses.aperture):
        # Half of the cell is lost for light through the gaps in any case.
        return "light passes through gaps between the openings of microlenses"
    n_near = microlenses_near(camera)
    too_many = n_near > (_MAX_NEAR_WITH_CORE if with_core else _MAX_NEAR)
    return f"{n_near:.0f} microlenses are near a pixel, and bounds on the pupil cost less" if too_many else ""


def no_core_reason(camera: PlenopticCamera) -> str:
    """Reason against an unvignetted core as control variate; empty if it is used.

    Something other than round or polygonal openings of the lens and straight sides of microlenses stops light, or the
    core contributes little to the noise.
    """
    array, parts, lens = camera.microlenses, assembly(camera), openings(camera.lens, camera.wavelength)
    if any(map(len, camera.blemishes)):
        return "dust stops light"
    if not lens.exact.all():
        return "an opening is no circle and no polygon"
    if camera.sensitivity is not None:
        return "the noise is that of the wavelengths"
    if array is None:
        is_round = np.isfinite(lens.semi_diameter2).sum() == 1 and not lens.edges.size
        is_ellipse = is_round and camera.lens.model is not LensModel.EXACT
        return "each point sees an ellipse, in which no path is lost" if is_ellipse else ""
    differs = len(array.focal_lengths) > 1 or array.imperfections is not None or array.lattice is Lattice.FREE
    if has_losses(camera.lens) and differs:
        return "the light that the lens takes is traced, and microlenses differ"
    if array.is_plate:
        return "plates displace rays before their rims stop them"
    if array.walls is Walls.OPAQUE:
        return "walls stop light"
    if array.aperture is not None and array.aperture.shape is ApertureShape.CIRCLE:
        return "round openings stop light"
    # Displacements on the pupil, over a microlens and over a pixel.
    distance = parts.z_plane - float(camera.lens.vertices[-1])
    ratio, pixel = distance / parts.distance, 0.5 * camera.sensor.pixel_pitch * max(camera.sensor.pixel_aperture)
    height = float(np.abs(ray_height_factors(array, distance, ratio)).max()) * array.cell_radius
    varies_over_pixel = array.model.focuses and height < ratio * pixel
    return "vignetting changes more over a pixel than over a microlens" if varies_over_pixel else ""


class ArrayBounds(NamedTuple):
    """Bounds from which aperture regions are computed."""

    pupil: PupilBounds
    margin: float
    """Largest deviation of real rays from those of an ideal microlens, on the plane of the outlines, in mm."""
    lateral: float
    """Largest lateral displacement of rays between principal plane and curved side, in mm."""
    reach: float
    """Largest distance from the lens's axis of microlenses in use, in mm."""


def sensor_bounds(camera: PlenopticCamera, parts: Assembly, wavelengths: tuple[float, ...]) -> PupilBounds:
    """Outlines of the pupil seen from the sensor, for cameras without microlenses."""
    corners = sensor_corners(camera, parts)
    farthest = float(np.hypot(corners[:, 0], corners[:, 1]).max())
    heights = parts.z_plane + corners[:, 2]
    return _envelope(camera, heights, farthest, GROUP_SIDE * camera.sensor.pixel_pitch / np.sqrt(2), wavelengths)


def array_bounds(
    camera: PlenopticCamera, array: MicrolensArray, parts: Assembly, wavelengths: tuple[float, ...]
) -> ArrayBounds:
    """Outlines of the pupil for all cells in use, and margins for the rays of real microlenses.

    A ray from the sensor at s through the point d of the cell at c crosses the plane of the outlines at
    c + ratio (c - s) + height_factor d, up to the margin, and passes the lens at most a + b |c| from the axis there.
    """
    a, b = rear_reach(camera.lens, parts.z_plane, wavelengths[0])
    pupil_distance = parts.z_plane - float(camera.lens.vertices[-1])
    corners = sensor_corners(camera, parts, deflection_border(camera) * camera.sensor.pixel_pitch)
    ratio = pupil_distance / float(corners[:, 2].min())
    sensor_radius = float(np.hypot(*parts.local_to_lens.points(corners)[:, :2].T).max())
    tilt = float(np.hypot(*parts.local_to_lens.turn[2, :2]))
    powers, height_factors = possible_powers(array), ray_height_factors(array, pupil_distance, ratio)
    strongest = float(np.abs(height_factors).max())
    decentre_margin = largest_offset(array.imperfections) * max(
        abs(pupil_distance * power) for power in (*powers, (1 + ratio) / pupil_distance)
    )
    margin, lateral = (1.0 + tilt) * _chromatic_margin(array, powers, wavelengths, pupil_distance), 0.0
    iterations = 2 if array.is_plate else 1
    while True:
        farthest = (1.0 + tilt) * ratio * sensor_radius + a + strongest * array.cell_radius + margin + decentre_margin
        widest = 1.02 * farthest / max(1.0 + ratio - b, 0.1 * (1.0 + ratio)) + array.cell_radius + lateral
        heights = parts.z_plane + tilt * (widest + sensor_radius) * np.array([-1.0, 0.0, 1.0])
        bounds = _envelope(camera, heights, widest, array.cell_radius + lateral, wavelengths)
        iterations -= 1
        if iterations == 0:
            return ArrayBounds(bounds, margin, lateral, widest)
        reach = float(bounds.reach.max()) + widest
        distance = pupil_distance / ratio
        disperses = any(array.index_at(wavelength) != array.index for wavelength in wavelengths)
        margins = [
            aberration_margins(array, wavelength, power, distance, pupil_distance, height_factor, reach)
            for wavelength in (wavelengths if disperses else wavelengths[:1])
            for power, height_factor in zip(powers, height_factors, strict=True)
            if power > 0
        ]
        margin, lateral = (1.0 + tilt) * max(m[0] for m in margins), (1.0 + tilt) * max(m[1] for m in margins)


def aberration_margins(
    array: MicrolensArray,
    wavelength: float,
    power: float,
    distance: float,
    pupil_distance: float,
    height_factor: float,
    reach: float,
) -> tuple[float, float]:
    """Largest deviation of real from ideal rays on the plane of the outlines, and on the curved side, in mm.

    Rays of one lens are aimed from a row of sensor points at a grid of points on its rear principal plane. Rays count
    if they exit the curved side inside the cell and cross the plane of the outlines within `reach` of the microlens's
    axis. A microlens is round, so that one row of sensor points represents all. Ideal rays are those at 587.6 nm.
    """
    from plenoptic.core.kernels.ray_blocks import BLOCK

    refraction = array.model.refraction
    lens = ArrayCrossing(lone_lens(array, power, wavelength), SensorPlane(distance, None), pupil_distance)
    aims = np.linspace(-1.5 * array.cell_radius, 1.5 * array.cell_radius, _N_AIMS)
    margin = lateral = 0.0
    for _ in range(4):
        # Sensor points as far from the lens's axis as valid rays can start.
        farthest = (reach + abs(height_factor) * array.cell_radius + margin) * distance / pupil_distance
        dx, dy, sx = (g.ravel() for g in np.meshgrid(aims, aims, np.linspace(0.0, farthest, _N_OFFSETS), indexing="ij"))
        fields = np.zeros((8, -(-dx.size // BLOCK) * BLOCK))
        for row, column in ((0, dx), (1, dy), (3, dx - sx), (4, dy)):
            fields[row, : dx.size] = column
        blocks = np.ascontiguousarray(fields.reshape(8, -1, BLOCK).transpose(1, 0, 2))
        refraction.to_lens(blocks.reshape(-1), None, lens, None)
        x, y, z, u, v, w, _, status = blocks.transpose(1, 0, 2).reshape(8, -1)[:, : dx.size]
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            exit_x, exit_y = refraction.exit_points(
                array, power, (dx, dy), ((dx - sx) / distance, dy / distance), (x, y)
            )
            t = -z / w
            real_x, real_y = x + t * u, y + t * v
            valid = (status == 0) & (np.hypot(exit_x, exit_y) <= array.cell_radius)
            valid &= np.hypot(real_x, real_y) <= reach
            deviation = np.hypot(
                real_x - (height_factor * dx - pupil_distance / distance * sx), real_y - height_factor * dy
            )[valid]
            displacement = np.hypot(exit_x - dx, exit_y - dy)[valid]
        if not deviation.size:
            break
        converged = deviation.max() <= 1.01 * margin
        margin = max(margin, _SAFETY * float(deviation.max()))
        lateral = max(lateral, _SAFETY * float(displacement.max()))
        if converged:
            break
    return margin, lateral


def _chromatic_margin(
    array: MicrolensArray, powers: Floats, wavelengths: tuple[float, ...], pupil_distance: float
) -> float:
    """Lateral colour of ideal microlenses against 587.6 nm, on the plane of the outlines, in mm."""
    if not array.model.refraction.is_thin:
        return 0.0
    change = max(abs(array.power_factor(wavelength) - 1.0) for wavelength in wavelengths)
    height = array.cell_radius + largest_offset(array.imperfections)
    return _SAFETY * abs(pupil_distance) * change * float(np.abs(powers).max()) * height


def _envelope(
    camera: PlenopticCamera, heights: Floats, largest_radius: float, cell_radius: float, wavelengths: tuple[float, ...]
) -> PupilBounds:
    """Envelope of the outlines seen from planes between the least and the greatest height, at all wavelengths."""
    low, high = float(heights.min()), float(heights.max())
    all_bounds = [
        pupil_bounds(
            camera.lens, z_plane=z, largest_radius=largest_radius, cell_radius=cell_radius, wavelength=wavelength
        )
        for z in ((low,) if high - low <= 1e-12 * abs(high) else (low, high))
        for wavelength in wavelengths
    ]
    if len(all_bounds) == 1:
        return all_bounds[0]
    finest = max(all_bounds, key=lambda bounds: len(bounds.support))
    support = np.full_like(np.asarray(finest.support), -np.inf)
    parted = np.zeros(len(support), dtype=np.bool_)
    for bounds in all_bounds:
        # An interval of the finest division lies in one or two of a coarser one.
        first = np.floor(np.arange(len(support)) * finest.step / bounds.step + 1e-9).astype(int)
        last = np.floor(np.arange(1, len(support) + 1) * finest.step / bounds.step - 1e-9).astype(int)
        for rows in (first, last):
            rows = np.clip(rows, 0, len(bounds.support) - 1)
            support, parted = np.maximum(support, bounds.support[rows]), parted | bounds.parted[rows]
    lit = np.isfinite(support[:, 0])
    outline = polygon_around(np.where(lit[:, None], support, 0.0))
    reach = np.where(lit, np.linalg.norm(outline, axis=-1).max(axis=-1), 0.0)
    finest = finest._replace(support=read_only(support), corners=read_only(outline))
    return finest._replace(reach=read_only(reach), parted=read_only(parted))
