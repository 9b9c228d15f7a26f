"""Openings of a lens's elements: circles, and convex polygons around the holes of stops that are not round."""

from __future__ import annotations

import numpy as np

from plenoptic.camera.sampling.record import Openings
from plenoptic.core.values import Floats
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.pupil.outline import normals_of
from plenoptic.optics.lens.record import lens_record, shown_stop
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.stops.circle import CircularStop
from plenoptic.optics.stops.polygon import PolygonStop, convex_hull
from plenoptic.optics.stops.stop_registry import Stop
from plenoptic.optics.surfaces.surface import Surface

_SIDES, _POINTS, _ROUNDING = 32, 1 << 12, 1e-5
"""Sides of a polygon around a hole, points of its outline, and how far an arc rises between these, in its radius."""


def openings(lens: LensStack, wavelength: float | Floats) -> Openings:
    """The openings of a lens for light from the sensor, at one wavelength (nm) or an array of them."""
    ends = lens_record(lens, wavelength, reverse=True).rows["semi_diameter2"]
    bare = lens_record(lens, wavelength, reverse=True, clipping=False)
    ideal = lens.model in (LensModel.THIN, LensModel.PARAXIAL)
    edges, whole = [np.zeros((0, 3)) for _ in bare.rows], np.ones(len(bare.rows), dtype=np.bool_)
    for k, number in enumerate(bare.rows["surface_index"]):
        element = lens.elements[number]
        if isinstance(element, Stop) and np.isfinite(ends[k]):
            edges[k], whole[k] = _edges(shown_stop(lens, float(np.ravel(wavelength)[0]))[0] if ideal else element)
        elif isinstance(element, Surface) and not ideal:
            whole[k] = element.depth is None and element.departure is None
    return Openings(
        elements=tuple(bare.part(k, k + 1) for k in range(len(bare.rows))),
        semi_diameter2=np.ascontiguousarray(ends),
        edges=np.concatenate(edges),
        first_edge=np.cumsum([0, *map(len, edges)], dtype=np.int64),
        whole=whole,
    )


def _edges(stop: Stop) -> tuple[Floats, bool]:
    """Edges (n, 3) of a convex polygon around a hole: outward normal and distance; and whether that is the hole.

    A round hole has none.
    """
    if isinstance(stop, CircularStop):
        return np.zeros((0, 3)), True
    normals, ease = normals_of(_SIDES), _ROUNDING * stop.semi_diameter
    whole, curved = False, isinstance(stop, PolygonStop) and np.isfinite(stop.blade_radius)
    if not curved and len(corners := convex_hull(np.asarray(stop.outline(3)))) <= _SIDES:
        along = np.roll(corners, -1, axis=0) - corners
        normals = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.hypot(along[:, 0], along[:, 1])[:, None]
        ease, whole = 0.0, isinstance(stop, PolygonStop)
    reach = (np.asarray(stop.outline(_POINTS)) @ normals.T).max(axis=0) + ease
    return np.column_stack([normals, reach]), whole
