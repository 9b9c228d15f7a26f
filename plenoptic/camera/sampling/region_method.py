"""Openings of the elements of a lens, and the choice of the method for aperture regions, without tracing.

Openings are circles, and convex polygons around the holes of stops that are not round.
"""

from __future__ import annotations

import math

import numpy as np

from plenoptic.camera.assembly import assembly
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.gaussian import model_pupil
from plenoptic.camera.sampling.sampling_records import Openings
from plenoptic.core.values import Floats
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.pupil.exit_pupil import rear_reach
from plenoptic.optics.lens.pupil.outline import normals_of
from plenoptic.optics.lens.record import lens_record, shown_stop
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.microlens.aperture import ApertureShape, Walls, has_clear_gaps
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.microlens.microlens_record import possible_powers
from plenoptic.optics.stops.circle import CircularStop
from plenoptic.optics.stops.polygon import PolygonStop, convex_hull
from plenoptic.optics.stops.stop_registry import Stop
from plenoptic.optics.surfaces.surface import Surface

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
            edges[k], exact[k] = _edges(shown_stop(lens, float(np.ravel(wavelength)[0]))[0] if ideal else element)
        elif isinstance(element, Surface) and not ideal:
            exact[k] = element.depth is None and element.departure is None
    return Openings(
        elements=tuple(bare.part(k, k + 1) for k in range(len(bare.rows))),
        semi_diameter2=np.ascontiguousarray(semi_diameter2),
        edges=np.concatenate(edges),
        first_edge=np.cumsum([0, *map(len, edges)], dtype=np.int64),
        exact=exact,
    )


def _edges(stop: Stop) -> tuple[Floats, bool]:
    """Edges (n, 3) of a convex polygon around a hole, outward normal and distance; and True if it equals the hole.

    A round hole has no edges.
    """
    if isinstance(stop, CircularStop):
        return np.zeros((0, 3)), True
    normals, sagitta = normals_of(_SIDES), _ROUNDING * stop.semi_diameter
    exact, curved = False, isinstance(stop, PolygonStop) and np.isfinite(stop.blade_radius)
    if not curved and len(corners := convex_hull(np.asarray(stop.outline(3)))) <= _SIDES:
        sides = np.roll(corners, -1, axis=0) - corners
        normals = np.stack([sides[:, 1], -sides[:, 0]], axis=1) / np.hypot(sides[:, 0], sides[:, 1])[:, None]
        sagitta, exact = 0.0, isinstance(stop, PolygonStop)
    reach = (np.asarray(stop.outline(_POINTS)) @ normals.T).max(axis=0) + sagitta
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
    array, parts = camera.microlenses, assembly(camera)
    if any(map(len, camera.blemishes)):
        return "dust stops light"
    if not openings(camera.lens, camera.wavelength).exact.all():
        return "an opening is no circle and no polygon"
    if camera.sensitivity is not None:
        return "the noise is that of the wavelengths"
    if array is None:
        return ""
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
