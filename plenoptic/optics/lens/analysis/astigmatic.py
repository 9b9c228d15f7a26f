"""Foci of a narrow beam around a ray: Coddington's equations along real rays.

A narrow beam has two foci: the tangential one in the plane of axis and ray, the sagittal one in the plane perpendicular
to it. In each plane the half width h across the ray and the reduced angle w are traced from surface to surface. The
focus lies at -n h / w along the ray. Collimated beams and foci on a surface need no special case.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats, check_kind
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.elements import shares_axis
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.lens.trace import trace_part
from plenoptic.optics.surfaces.mirror import Mirror
from plenoptic.optics.surfaces.surface import Surface


class Foci(NamedTuple):
    """Foci of narrow beams around rays; nan if a ray is lost. Made by `foci`."""

    ray: RayBundle
    """(n) rays behind the lens, with origins on the last element."""
    sagittal: Floats
    """(n, 3) points in mm; infinite where the emerging beam is collimated."""
    tangential: Floats
    """(n, 3) points in mm."""


def _bending(surface: Surface, at: Floats) -> tuple[Floats, Floats, Floats]:
    """Unit normals (n, 3) and the sagittal and tangential curvatures (n,) at points (n, 3) measured from the vertex."""
    x, y, z = at.T
    r2, c, k = x * x + y * y, surface.curvature, surface.conic
    if not surface.aspheric:
        # Evaluate a conic at the given z, which holds beyond its equator too.
        normal = np.column_stack([-c * x, -c * y, 1.0 - c * (1.0 + k) * z])
        size = np.sqrt(1.0 - k * c * c * r2)
        return normal / size[:, None], c / size, c / size**3
    e = np.sqrt(1.0 - (1.0 + k) * c * c * r2)
    over_r, second = c / e, c / e**3
    for i, a in enumerate(surface.aspheric):
        over_r = over_r + (2 * i + 2) * a * r2**i
        second = second + (2 * i + 2) * (2 * i + 1) * a * r2**i
    size = np.sqrt(1.0 + over_r * over_r * r2)
    normal = np.column_stack([-over_r * x, -over_r * y, np.ones_like(x)])
    return normal / size[:, None], over_r / size, second / size**3


def foci(lens: LensStack, rays: RayBundle, *, parallel: bool, reverse: bool = False) -> Foci:
    """Tangential and sagittal foci of narrow beams around meridional rays of a centred lens; rims do not clip.

    Parameters
    ----------
    lens : LensStack
    rays : RayBundle
        n rays before the lens (behind it in reverse).
    parallel : bool
        True if the beams come from infinity; otherwise they diverge from the origins of the rays.
    reverse : bool, optional
        Trace towards the scene.

    Raises
    ------
    InvalidValueError
        If an element is decentred or tilted, or the lens is not LensModel.EXACT.

    References
    ----------
    R. Kingslake and R. B. Johnson, Lens Design Fundamentals, 2nd ed., section 11.1.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2")
    >>> axis = pl.RayBundle([[0.0, 0.0, -404.0]], [[0.0, 0.0, 1.0]])
    >>> pl.aberrations.foci(lens, axis, parallel=False).sagittal.round(3).tolist()
    [[0.0, 0.0, 134.624]]
    """
    require_axis(lens, "astigmatism is")
    if lens.model is not LensModel.EXACT:
        raise InvalidValueError(
            f"the model of {lens.name!r} is {lens.model.name}, which has no aberrations; use lens.with_model(EXACT)"
        )
    order = range(len(lens.elements))
    index, sign = lens.indices(rays.wavelength), -1.0 if reverse else 1.0
    n = len(rays)
    # Rows: sagittal, tangential.
    h, w = (np.ones((2, n)), np.zeros((2, n))) if parallel else (np.zeros((2, n)), np.ones((2, n)))
    incident = rays
    for k in reversed(order) if reverse else order:
        before, after = (index[k + 1], index[k]) if reverse else (index[k], index[k + 1])
        outgoing = trace_part(lens, incident, k, k, reverse=reverse, clipping=False)
        element, vertex = lens.elements[k], np.array([0.0, 0.0, lens.vertices[k]])
        reflects = isinstance(element, Surface) and isinstance(element.medium, Mirror)
        # Points behind a mirror are reflected in its vertex plane; points in front of it stay.
        hit = (outgoing.origin - vertex) * (1.0, 1.0, -1.0) + vertex if reflects else outgoing.origin
        h = h + w / before * np.einsum("ij,ij->i", hit - incident.origin, incident.direction)
        if isinstance(element, Surface):
            in_front = outgoing if reflects and reverse else incident
            normal, *curvature = _bending(element, (outgoing.origin if in_front is outgoing else hit) - vertex)
            cos_i, cos_t = (np.abs(np.einsum("ij,ij->i", ray.direction, normal)) for ray in (in_front, outgoing))
            if reflects:
                cos_t, power = cos_i, -2.0 * after * cos_i * np.array(curvature)
            else:
                power = sign * (after * cos_t - before * cos_i) * np.array(curvature)
            # Refraction changes the width across the ray in the plane of incidence only.
            widen = np.stack([np.ones(n), cos_t / cos_i])
            h, w = h * widen, (w - power * h / np.stack([np.ones(n), cos_i**2])) / widen
        incident = outgoing
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = -index[0 if reverse else -1] * h / w
        points = incident.origin + distance[:, :, None] * incident.direction
    return Foci(incident, points[0], points[1])


def require_axis(lens: LensStack, subject: str) -> None:
    """Raise an error if the lens has no axis of symmetry, or has LensModel.NONE, so that `subject` is undefined."""
    check_kind(lens, "lens", LensStack, "camera.lens")
    off_axis = next(((i, element) for i, element in enumerate(lens.elements) if not shares_axis(element)), None)
    if off_axis is not None:
        i, element = off_axis
        placed = element.placement is not None
        fault, cause = ("is decentred or tilted", "placement") if placed else ("has a freeform term", "freeform term")
        raise InvalidValueError(
            f"element {i} of {lens.name!r} {fault}; {subject} defined for a lens with an axis only: leave out its "
            f"{cause}, or use spot diagrams"
        )
    if lens.model is LensModel.NONE:
        raise InvalidValueError(f"the model of {lens.name!r} is NONE, which forms no image; use lens.with_model(EXACT)")
