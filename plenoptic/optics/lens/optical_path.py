"""Optical path lengths of rays through a lens."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats, check_kind, positions
from plenoptic.errors import InvalidValueError
from plenoptic.optics.element_record import PathWorkspace
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points, outer_indices
from plenoptic.optics.lens.lens_record import lens_record
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.lens.trace import RayArrays, in_chunks, trace_record

_TOLERANCE = 1e-9
"""Largest distance of a ray from its object point, over their distance along the ray."""


def optical_path(
    lens: LensStack, rays: RayBundle, *, reverse: bool = False, point: ArrayLike | None = None
) -> tuple[RayBundle, Floats]:
    """Trace a bundle as `LensStack.trace` does, with the optical path length of each ray.

    Parameters
    ----------
    lens : LensStack
    rays : RayBundle
        In front of the lens, or with `reverse` behind it.
    reverse : bool, optional
        Towards the scene.
    point : (3,) array, optional
        For the ideal models THIN and PARAXIAL, which have no surfaces: object point of all rays in the lens frame, mm.
        All paths from it to its image are equal, and defined up to a constant.

    Returns
    -------
    rays : RayBundle
        Rays of `LensStack.trace`, with origins on the last element.
    path : (n,) array
        Optical path length from the origins of `rays` to those points, mm; negative for origins behind the lens; nan
        for lost rays.

    Raises
    ------
    InvalidValueError
        For an ideal lens without a point, or rays that do not come from it.

    Notes
    -----
    The rounding error is about eps times the path: 2e-10 waves for a path of 1 m. Differences from the
    chief ray cancel the common path, not its rounding error. Rays of a distant object should start on a wavefront near
    the lens, as in `aiming`.

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
            raise InvalidValueError("point is for ideal lenses only; leave it out")
        return paths_of_part(lens, rays, 0, len(lens.elements) - 1, reverse=reverse)
    if point is None:
        raise InvalidValueError(
            f"an ideal lens ({lens.model.name}) makes all paths from a point to its image equal, "
            "and defines no path of a single ray; give the point from which the rays come, or use LensModel.EXACT"
        )
    return _ideal(lens, rays, positions(point, name="point", shape=(3,)), reverse=reverse)


def _ideal(lens: LensStack, rays: RayBundle, point: Floats, *, reverse: bool) -> tuple[RayBundle, Floats]:
    """Paths of an ideal lens: from the point to its image, all equal that of the ray through the principal points."""
    behind = trace_record(lens_record(lens, rays.wavelength, reverse=reverse), rays)
    indices = outer_indices(lens, rays.wavelength)
    check_from(rays, point, np.abs(lens.vertices).max() + 1.0)
    if lens.model is LensModel.NONE:
        return behind, indices[0] * ((behind.origin - rays.origin) * rays.direction).sum(axis=1)
    points, direction = cardinal_points(lens, rays.wavelength), -1.0 if reverse else 1.0
    rear = points.rear_principal
    front = rear if lens.model is LensModel.THIN else points.front_principal
    arrives, leaves = (rear, front) if reverse else (front, rear)
    focal_length = points.efl if reverse else points.front_efl
    if direction * (arrives - point[2]) == focal_length:
        raise InvalidValueError(f"the point is in the focal plane, z = {point[2]:g} mm, and has no image; move it")
    planes = IdealPlanes(np.array([0.0, 0.0, arrives]), np.array([0.0, 0.0, leaves]), 1.0 / focal_length, direction)
    return behind, paths_to_image(rays, behind, point, planes, indices[::-1] if reverse else indices)


class IdealPlanes(NamedTuple):
    """Principal planes of aberration-free lenses along z: one lens, or one for each ray."""

    front: Floats
    """(3,) or (n, 3), mm: the first principal point in the direction of travel."""
    rear: Floats
    """(3,) or (n, 3), mm: the second principal point in the direction of travel."""
    power: float | Floats
    """Inverse of the focal length before the lens in 1/mm; a number or (n,)."""
    direction: float
    """Direction of travel along z: 1 or -1."""


def paths_to_image(
    rays: RayBundle, behind: RayBundle, point: Floats, lenses: IdealPlanes, indices: tuple[float, float] = (1.0, 1.0)
) -> Floats:
    """Paths (n,) of rays from a point, mm; up to its image all equal the path through the principal points.

    `indices` are those of the media before and behind the lens.
    """
    before, after = indices
    away = point - lenses.front
    distance = -lenses.direction * away[..., 2]
    scale = 1.0 / (1.0 - distance * lenses.power)
    image_distance = -(after / before) * distance * scale
    image = np.stack([scale * away[..., 0], scale * away[..., 1], lenses.direction * image_distance], axis=-1)
    lengths = np.copysign(np.linalg.norm(away, axis=-1), distance)
    whole = before * lengths + after * np.copysign(np.linalg.norm(image, axis=-1), image_distance)
    between = lenses.direction * (lenses.rear - lenses.front)[..., 2]
    left = ((image + lenses.rear - behind.origin) * behind.direction).sum(axis=1)
    start = ((rays.origin - point) * rays.direction).sum(axis=1)
    return np.asarray(whole + before * between - after * left - before * start)


def check_from(rays: RayBundle, point: Floats, extent: float) -> None:
    """Refuse rays that miss a point by more than a rounding error of their distance from it, or of the extent."""
    along = ((rays.origin - point) * rays.direction).sum(axis=1)
    miss = np.linalg.norm(rays.origin - point - along[:, None] * rays.direction, axis=1)
    far = np.linalg.norm(rays.origin - point, axis=1)
    if np.any(miss > _TOLERANCE * np.maximum(far, extent)):
        raise InvalidValueError(f"a ray misses the point {point.tolist()} by {miss.max():.3g} mm; all must pass it")


def paths_of_part(
    lens: LensStack, rays: RayBundle, first: int, last: int, *, reverse: bool = False, clipping: bool = True
) -> tuple[RayBundle, Floats]:
    """Trace as `trace.trace_part`, with optical path lengths."""
    from plenoptic.core.kernels.ray_blocks import BLOCK
    from plenoptic.optics.lens.kernels.trace import fill_paths

    record = lens_record(lens, rays.wavelength, reverse=reverse, first=first, last=last, clipping=clipping).completed
    index = lens.indices(rays.wavelength)[first : last + 2]
    index, lengths = np.ascontiguousarray(index[:0:-1] if reverse else index[:-1]), np.empty(len(rays))

    def fill(out: RayArrays, given: RayArrays, begin: int, end: int) -> None:
        workspace = PathWorkspace(index, np.empty((6, BLOCK)), np.empty(BLOCK))
        fill_paths(out, lengths, given, record, workspace, begin, end)

    return in_chunks(fill, rays), lengths
