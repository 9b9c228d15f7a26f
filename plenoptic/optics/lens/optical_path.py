"""Optical path lengths of rays through a lens."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats, check_kind, positions
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.record import LensRecord, lens_record
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.lens.trace import RayArrays, in_chunks, traced_by

_TOLERANCE = 1e-9
"""Of the way from a point, by which rays may pass it."""


class PathNotes(NamedTuple):
    """What kernels need to find optical paths, and where they keep what they know of a block of rays."""

    indices: Floats
    """(n,): refractive index before each element, in the order of travel."""
    start: Floats
    """(6, block): points and directions before the element at hand."""
    length: Floats
    """(block,), mm: the path so far."""


def optical_path(
    lens: LensStack, rays: RayBundle, *, reverse: bool = False, point: ArrayLike | None = None
) -> tuple[RayBundle, Floats]:
    """Trace a bundle as `LensStack.trace` does, and tell how long the way of each ray is, times the refractive index.

    Parameters
    ----------
    lens : LensStack
    rays : RayBundle
        Before the lens, or with `reverse` behind it.
    reverse : bool, optional
        Towards the scene.
    point : (3,) array, optional
        For the ideal models THIN and PARAXIAL, which have no surfaces: the point, in the lens frame, mm, through
        which all rays come. All paths from there to its image are equal; how long is known but for a constant.

    Returns
    -------
    rays : RayBundle
        What `LensStack.trace` gives: they stand on the last element.
    path : (n,) array
        From the origins given to there, mm; negative where an origin lies behind the lens; nan for lost rays.

    Raises
    ------
    InvalidValueError
        An ideal lens without a point, or rays that do not come from it.

    Notes
    -----
    Rounding leaves some eps times the path: 2e-10 waves of a metre. What rays have in common with the chief ray
    falls out of differences; rays from far away are best begun on a wavefront near the lens, as `aiming` does.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("singlet-100mm-f4")
    >>> behind, path = pl.aberrations.optical_path(lens, pl.RayBundle([[0, 0, -10.0]], [[0, 0, 1.0]]))
    >>> glass = 5.0 * lens.indices()[2]
    >>> bool(abs(path[0] - (11.0 + glass)) < 1e-12)
    True
    """
    check_kind(rays, "rays", RayBundle, "pl.RayBundle([[0, 0, -100]], [[0, 0, 1]])")
    if lens.model is LensModel.EXACT:
        if point is not None:
            raise InvalidValueError("point is for ideal lenses, whose paths follow from it; leave it out")
        return paths_of_part(lens, rays, 0, len(lens.elements) - 1, reverse=reverse)
    if point is None:
        raise InvalidValueError(
            f"an ideal lens ({lens.model.name}) makes all paths from a point to its image equal, and says nothing of a "
            "ray by itself; give the point from which the rays come, or use LensModel.EXACT"
        )
    return _ideal(lens, rays, positions(point, name="point", shape=(3,)), reverse=reverse)


def _ideal(lens: LensStack, rays: RayBundle, point: Floats, *, reverse: bool) -> tuple[RayBundle, Floats]:
    """From the point to its image each path is as long as that of the ray through the principal points."""
    behind = traced_by(lens_record(lens, rays.wavelength, reverse=reverse), rays)
    index = float(lens.indices(rays.wavelength)[0])
    along = ((rays.origin - point) * rays.direction).sum(axis=1)
    off = np.linalg.norm(rays.origin - point - along[:, None] * rays.direction, axis=1)
    far = np.linalg.norm(rays.origin - point, axis=1)
    if np.any(off > _TOLERANCE * np.maximum(far, np.abs(lens.vertices).max() + 1.0)):
        raise InvalidValueError(f"a ray passes the point {point.tolist()} by {off.max():.3g} mm; all must come from it")
    if lens.model is LensModel.NONE:
        return behind, index * ((behind.origin - rays.origin) * rays.direction).sum(axis=1)
    front, rear, efl = _principal_planes(lens, rays.wavelength, reverse=reverse)
    direction = -1.0 if reverse else 1.0
    distance = direction * (front - point[2])
    if distance == efl:
        raise InvalidValueError(f"the point is in the focal plane, z = {point[2]:g} mm, and has no image; move it")
    image_distance = distance * efl / (distance - efl)
    scale = -image_distance / distance
    image = np.array([scale * point[0], scale * point[1], rear + direction * image_distance])
    before, after = math.hypot(point[0], point[1], distance), math.hypot(image[0], image[1], image_distance)
    whole = math.copysign(before, distance) + math.copysign(after, image_distance) + direction * (rear - front)
    left = ((image - behind.origin) * behind.direction).sum(axis=1)
    return behind, index * (whole - left - along)


def _principal_planes(lens: LensStack, wavelength: float, *, reverse: bool) -> tuple[float, float, float]:
    """Z where light arrives and where it leaves, and the focal length."""
    points = cardinal_points(lens, wavelength)
    rear = points.rear_principal
    front = rear if lens.model is LensModel.THIN else points.front_principal
    return (rear, front, points.efl) if reverse else (front, rear, points.efl)


def _exact(record: LensRecord, rays: RayBundle, indices: Floats) -> tuple[RayBundle, Floats]:
    from plenoptic.core.kernels.ray_blocks import BLOCK
    from plenoptic.optics.lens.kernels.trace import fill_paths

    lengths = np.empty(len(rays))

    def fill(out: RayArrays, given: RayArrays, first: int, end: int) -> None:
        fill_paths(out, lengths, given, record, PathNotes(indices, np.empty((6, BLOCK)), np.empty(BLOCK)), first, end)

    return in_chunks(fill, rays), lengths


def paths_of_part(
    lens: LensStack, rays: RayBundle, first: int, last: int, *, reverse: bool = False, clipping: bool = True
) -> tuple[RayBundle, Floats]:
    """As `trace.traced_part`, with optical paths."""
    record = lens_record(lens, rays.wavelength, reverse=reverse, first=first, last=last, clipping=clipping)
    index = lens.indices(rays.wavelength)[first : last + 2]
    return _exact(record.completed, rays, np.ascontiguousarray(index[:0:-1] if reverse else index[:-1]))
