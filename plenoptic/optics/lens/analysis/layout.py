"""Lens layout: cross section of a lens with fans of rays, as a lens design program draws it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats, finite, whole
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.analysis.field_aberrations import checked_fields, field_curvature
from plenoptic.optics.lens.analysis.illumination import largest_field
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points, image_position
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.pupil.iris_points import INSIDE, fan
from plenoptic.optics.lens.pupil.ray_aiming import aimed_rays
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.lens.trace import trace_part

_MOST_RAYS = 10_000
"""Points of a ray fan for each field of a drawing."""
_LEAD = 0.35
"""Drawn length of the rays in front of the lens, over the length of the lens."""

_LEAD_OF_ALL = 0.15
"""Drawn length of the rays in front of the lens, over the distance from its first vertex to the image, for short
lenses."""

_SHARP, _OPEN, _TRIED = 0.05, 1.0 / 3.0, 25
"""Selection of drawn fields among 25: both foci lie within 5 % of the focal length of the image plane, and a third of
the diameter of the iris is unvignetted."""


class LensLayout(NamedTuple):
    """Rays through a lens, for a figure."""

    paths: list[Floats]
    """(n_rays, n_points, 3) for each field: points x, y, z in mm; a path ends before its first nan."""
    labels: list[str]
    """Names of the fields."""
    z_image: float | None
    """Image plane, mm; None without one."""


def ray_paths(lens: LensStack, rays: RayBundle, *, z_end: float) -> Floats:
    """Points of n rays at the k elements of a lens, traced as LensModel.EXACT: (n, k + 2, 3).

    They are the origins in front of the lens, the intersections with the elements, and the points in the plane z_end
    behind it. The path of a clipped ray ends on the element that clips it. The path of a ray lost by another cause ends
    one element earlier. Later points are nan.
    """
    elements = len(lens.elements)
    lost_at = lens.with_model(LensModel.EXACT).trace(rays).lost_at
    bundle, points = rays, [rays.origin]
    for k in range(elements):
        bundle = trace_part(lens, bundle, k, k, clipping=False)
        points.append(bundle.origin)
    points.append(bundle.at_z(z_end))
    paths = np.stack(points, axis=1)
    beyond = np.arange(elements + 2)[None] > lost_at[:, None] + 1
    paths[beyond & (lost_at >= 0)[:, None]] = np.nan
    return paths


def layout_fields(lens: LensStack, *, z_object: float = -math.inf, wavelength: float = 587.6) -> Floats:
    """Three fields for a figure: the axis, 0.7 of the largest usable field, and that field.

    In a usable field, both foci lie within 5 % of the focal length of the image plane. A third of the diameter of the
    iris along y is unvignetted. The foci are not tested for a decentred lens, or for one without an image. Parameters
    and units are those of `distortion`.
    """
    exact = lens.with_model(LensModel.EXACT)
    tried = largest_field(exact, z_object=z_object, wavelength=wavelength) * np.linspace(0.0, 1.0, _TRIED)
    pupil, good = INSIDE * fan(9), np.empty(_TRIED, dtype=bool)
    for i, field in enumerate(tried.tolist()):
        rays = aimed_rays(exact, field=(0.0, field), pupil=pupil, z_object=z_object, wavelength=wavelength)
        good[i] = np.mean(exact.trace(rays).status == 0) >= _OPEN
    try:
        curvature = field_curvature(exact, tried, z_object=z_object, wavelength=wavelength)
        depth = _SHARP * abs(cardinal_points(lens, wavelength).efl)
        good &= (np.abs(curvature.sagittal) <= depth) & (np.abs(curvature.tangential) <= depth)
    except InvalidValueError:
        pass  # There is no image plane, or the foci are undefined.
    last = _TRIED - 1 if good.all() else int(np.argmin(good)) - 1
    return float(tried[max(last, 1)]) * np.array([0.0, 0.7, 1.0])


def _start_rays(rays: RayBundle, first: Floats, lead: float, *, parallel: bool) -> RayBundle:
    """Rays that start at most `lead` mm before their first point on the lens; parallel rays start on a common
    wavefront.
    """
    before = np.einsum("ij,ij->i", first - rays.origin, rays.direction)
    if parallel:
        ahead = np.full_like(before, np.nanmin(before, initial=np.inf) - lead)
    else:
        ahead = np.maximum(before - lead, 0.0)
    origin = rays.at(np.where(np.isfinite(ahead), ahead, 0.0))
    return RayBundle(origin, rays.direction, rays.wavelength, status=rays.status)


def lens_layout(
    lens: LensStack,
    *,
    fields: ArrayLike | None = None,
    z_object: float | None = None,
    rays: int = 7,
    wavelength: float = 587.6,
    z_image: float | None = None,
) -> LensLayout:
    """Trace a fan of real rays for each field; see `LensStack.layout`."""
    (first_vertex, last_vertex), z = lens.vertices[[0, -1]].tolist(), z_object
    if z is None:
        points = cardinal_points(lens, wavelength)
        from_focus = points.rear_focus <= last_vertex and points.front_focus < first_vertex
        z = points.front_focus if from_focus else -math.inf
    parallel = z == -math.inf
    chosen = layout_fields(lens, z_object=z, wavelength=wavelength) if fields is None else fields
    radii = checked_fields(lens, chosen, z)
    pupil = INSIDE * fan(whole(rays, "rays", at_least=2, at_most=_MOST_RAYS))
    plane = None if z_image is None else finite(z_image, "z_image")
    if plane is None:
        image = image_position(lens, z, wavelength)
        plane = image if last_vertex < image < math.inf else None
    z_end = last_vertex + max(lens.length, 1.0) if plane is None else plane
    exact, paths = lens.with_model(LensModel.EXACT), []
    for field in radii.tolist():
        aimed = aimed_rays(exact, field=(0.0, field), pupil=pupil, z_object=z, wavelength=wavelength)
        first = trace_part(lens, aimed, 0, 0, clipping=False).origin
        lead = max(_LEAD * lens.length, _LEAD_OF_ALL * (z_end - first_vertex))
        started = _start_rays(aimed, first, lead, parallel=parallel)
        polylines = ray_paths(exact, started, z_end=z_end)
        # Rays that miss the lens are not drawn.
        paths.append(polylines[np.isfinite(polylines[:, 2, 2])])
    labels = [f"{math.degrees(field):.3g}°" if parallel else f"{field:.3g} mm" for field in radii.tolist()]
    return LensLayout(paths, labels, plane)
