"""Openings of the elements of a lens: circles, and convex polygons around the holes of stops that are not round."""

from __future__ import annotations

import numpy as np

from plenoptic.camera.sampling.sampling_records import Openings
from plenoptic.core.values import Floats
from plenoptic.optics.lens.lens_record import lens_record, shown_stop
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.pupil.outline import normals_of
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.stops.circle import CircularStop
from plenoptic.optics.stops.polygon import PolygonStop, convex_hull
from plenoptic.optics.stops.stop_registry import Stop
from plenoptic.optics.surfaces.surface import Surface

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
