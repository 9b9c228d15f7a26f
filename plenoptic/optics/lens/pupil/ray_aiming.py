"""Ray aiming: rays from one object point through points of the real iris.

Pupil aberrations make a ray that is aimed at the paraxial entrance pupil miss its point of the iris: by far in wide
angle lenses, and altogether in fisheyes. Here rays are solved from the iris outwards (see `search`). Each solution is
traced inwards again and compared with its point of the iris.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.rays import RayBundle, RayStatus
from plenoptic.core.values import Floats, check_kind, finite, frozen_array
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points, magnification
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.pupil.object_point import checked_aim, checked_pair, directions_of
from plenoptic.optics.lens.pupil.search import SOLVED, Half, aimed_angles, half_of, outermost, points_of, traced_through
from plenoptic.optics.lens.stack import LensStack

_EPS = float(np.finfo(np.float64).eps)

_ON_THE_IRIS = 1e-9
"""Tolerance in mm of an aimed ray at its point of the iris, in addition to the rounding error of its origin."""

_CLEARANCE = 1.0
"""Distance in mm of the wavefront of a point at infinity in front of the lens."""


def _wavefront(lens: LensStack, towards: Floats, points: Floats) -> float:
    """Distance in mm along `towards` (3,) of a plane in front of the whole lens and all finite `points`."""
    across = math.hypot(towards[0], towards[1])
    reach = [float(np.nanmax(points @ towards, initial=-math.inf))]
    for element, profile in zip(lens.elements, lens.profiles(9), strict=True):
        aside = 0.0 if element.placement is None else float(np.hypot(*element.placement.shift[:2]))
        reach.append(float(np.max((np.abs(profile[:, 1]) + aside) * across + profile[:, 0] * towards[2])))
    return max(reach) + _CLEARANCE


def _exact_rays(lens: LensStack, half: Half, pupil: Floats) -> RayBundle:
    angles, miss = aimed_angles(half, lens, pupil)
    targets = points_of(lens, pupil)
    first, _ = outermost(half, targets, angles)
    if half.aim.size == 2:
        towards = directions_of(half.aim[None], half.sign)[0]
        back = _wavefront(lens, towards, first[np.isfinite(miss)]) - first @ towards
        origin = first + back[:, None] * towards
        direction = np.broadcast_to(-towards, origin.shape)
    else:
        origin = np.broadcast_to(half.aim, first.shape)
        direction = RayBundle(origin, first - origin, half.wavelength).direction
    arrived, _ = traced_through(half.inwards, origin, direction, half.wavelength)
    allowed = _ON_THE_IRIS + 1e2 * _EPS * np.abs(origin[np.isfinite(origin)]).max(initial=0.0)
    with np.errstate(invalid="ignore"):
        miss_at_iris = np.linalg.norm(arrived - targets, axis=1)
        lost = ~((miss <= SOLVED) & (miss_at_iris <= allowed))
    return _bundle(origin, direction, half.wavelength, lost)


def _bundle(origin: Floats, direction: Floats, wavelength: float, lost: NDArray[np.bool_]) -> RayBundle:
    status = np.where(lost, np.uint8(RayStatus.MISSED), np.uint8(0))
    void = np.where(lost, np.nan, 0.0)[:, None]
    return RayBundle(origin + void, direction + void, wavelength, status=status)


def _pupil_plane(lens: LensStack, wavelength: float, *, scene: bool) -> tuple[float, float]:
    """Position z in mm and signed magnification of the pupil of an ideal model of the lens."""
    if lens.model is LensModel.NONE:
        return 0.0, 1.0
    points = cardinal_points(lens, wavelength)
    size = points.entrance_pupil_semi_diameter / lens.stop.semi_diameter
    if lens.model is LensModel.THIN:
        return points.rear_principal, size
    z = points.entrance_pupil if scene else points.exit_pupil
    if not math.isfinite(z):
        raise InvalidValueError(
            f"the {'entrance' if scene else 'exit'} pupil of {lens.name!r} is at infinity, so its ideal "
            "model has no points to aim at; use LensModel.EXACT"
        )
    if not scene:
        return z, points.pupil_magnification
    if not math.isfinite(points.exit_pupil):
        return z, size
    return z, points.pupil_magnification / magnification(lens, z, wavelength)


def _ideal_rays(lens: LensStack, wavelength: float, pupil: Floats, aim: Floats, *, scene: bool) -> RayBundle:
    """Rays aimed at the pupil of an ideal model of the lens."""
    z, scale = _pupil_plane(lens, wavelength, scene=scene)
    points = np.column_stack([scale * lens.stop.semi_diameter * pupil, np.full(len(pupil), z)])
    if lens.model is LensModel.NONE:
        points = points_of(lens, pupil)
    sign, none_lost = -1.0 if scene else 1.0, np.zeros(len(points), dtype=bool)
    if aim.size == 3:
        # The direction is inwards, even if the pupil lies farther out than the object.
        direction = (points - aim) * np.where(sign * (points[:, 2:] - aim[2]) > 0, -1.0, 1.0)
        return _bundle(np.broadcast_to(aim, points.shape), direction, wavelength, none_lost)
    towards = directions_of(aim[None], sign)[0]
    back = _wavefront(lens, towards, points) - points @ towards
    return _bundle(points + back[:, None] * towards, np.broadcast_to(-towards, points.shape), wavelength, none_lost)


def _aim_rays(
    lens: LensStack, pair: Floats, z: float, pupil: ArrayLike, wavelength: float, *, scene: bool
) -> RayBundle:
    check_kind(lens, "lens", LensStack, "camera.lens")
    points = frozen_array(pupil, name="pupil", shape=(None, 2))
    if not np.isfinite(points).all():
        raise InvalidValueError("pupil holds a number that is not finite; give points of the iris")
    aim, at = checked_aim(lens, pair, z, scene=scene), finite(wavelength, "wavelength")
    if lens.model is not LensModel.EXACT:
        return _ideal_rays(lens, at, points, aim, scene=scene)
    return _exact_rays(lens, half_of(lens, at, aim, scene=scene), points)


def aimed_rays(
    lens: LensStack,
    *,
    field: Sequence[float] | Floats,
    pupil: ArrayLike,
    z_object: float = -math.inf,
    wavelength: float = 587.6,
) -> RayBundle:
    """Rays from one object point that pass the real iris at given points.

    Semi-diameters and other stops do not clip these rays; `LensStack.trace` clips them.

    Parameters
    ----------
    lens : LensStack
        Centred or not. For models other than LensModel.EXACT, rays are aimed at the pupil of the model.
    field : (2,) sequence of float
        Object at infinity: angles x and y in rad. Its direction from the lens has the angle hypot(x, y) from -z and the
        azimuth atan2(y, x). Rays of a positive y travel downwards; 90 degrees and more are possible. Finite object: its
        x and y in mm.
    pupil : (n, 2) array
        Points of the iris, x and y in units of its semi-diameter; see `hexapolar`, `square_grid` and `fan`. A ray aimed
        at the rim itself may be clipped there by rounding: for the marginal ray take 1 - 1e-9.
    z_object : float, optional
        z of the object in the lens frame, mm, in front of the first vertex; -inf for an object at infinity.
    wavelength : float, optional
        nm.

    Returns
    -------
    RayBundle
        n rays in front of the lens. Origins lie at the object point or, at infinity, on a wavefront: a plane
        perpendicular to the rays, in front of the whole lens. If no ray passes a point of the iris, its status is
        MISSED.

    Raises
    ------
    InvalidValueError
        If the object is not in front of the lens, an angle is not below pi, or a number is not finite.

    Examples
    --------
    >>> import math, plenoptic as pl
    >>> lens = pl.load_lens("fisheye-100mm-f8")
    >>> rays = pl.aiming.aimed_rays(lens, field=(0.0, math.radians(85.0)), pupil=[[0.0, 0.0], [0.0, 0.5]])
    >>> rays.direction.round(4).tolist()
    [[0.0, -0.9962, 0.0872], [0.0, -0.9962, 0.0872]]
    >>> lens.trace(rays).status.tolist()
    [0, 0]
    """
    return _aim_rays(lens, checked_pair(field, "field"), z_object, pupil, wavelength, scene=True)


def aimed_rays_reverse(
    lens: LensStack,
    *,
    image_point: Sequence[float] | Floats,
    z_image: float,
    pupil: ArrayLike,
    wavelength: float = 587.6,
) -> RayBundle:
    """Rays from one point behind the lens, towards the scene, that pass the real iris at given points.

    They start behind the lens, for `LensStack.trace_reverse`; otherwise see `aimed_rays`.

    Parameters
    ----------
    lens : LensStack
    image_point : (2,) sequence of float
        x and y in mm; for a point at infinity, angles against +z as in `aimed_rays`.
    z_image : float
        z of the point in the lens frame, mm, behind the last vertex; inf at infinity.
    pupil, wavelength
        See `aimed_rays`.

    Raises
    ------
    InvalidValueError
        If the point is not behind the lens or a number is not finite.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2")
    >>> rays = pl.aiming.aimed_rays_reverse(lens, image_point=(0, 20), z_image=130.0, pupil=[[0, 0]])
    >>> bool(rays.direction[0, 2] < 0), lens.trace_reverse(rays).status.tolist()
    (True, [0])
    """
    return _aim_rays(lens, checked_pair(image_point, "image_point"), z_image, pupil, wavelength, scene=False)


def chief_ray(
    lens: LensStack, *, field: Sequence[float] | Floats, z_object: float = -math.inf, wavelength: float = 587.6
) -> RayBundle:
    """Chief ray: the ray from an object point through the centre of the iris; parameters are those of `aimed_rays`.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.aiming.chief_ray(pl.load_lens("double-gauss-100mm-f2"), field=(0.0, 0.3))
    RayBundle(1 ray, 1 OK, 587.6 nm)
    """
    return aimed_rays(lens, field=field, pupil=np.zeros((1, 2)), z_object=z_object, wavelength=wavelength)


def entrance_pupil_of(
    lens: LensStack, field: Sequence[float] | Floats, *, z_object: float = -math.inf, wavelength: float = 587.6
) -> float:
    """Entrance pupil of one field: the point of the axis nearest to the chief ray in object space.

    z in the lens frame, mm; nan if there is no chief ray. On the axis it is the paraxial entrance pupil. Parameters are
    those of `aimed_rays`.

    Examples
    --------
    >>> import math, plenoptic as pl
    >>> lens = pl.load_lens("fisheye-100mm-f8")
    >>> [round(pl.aiming.entrance_pupil_of(lens, (0.0, math.radians(angle)))) for angle in (0, 40, 80)]
    [-238, -251, -302]
    """
    pair = checked_pair(field, "field")
    if not pair.any():
        return cardinal_points(lens, wavelength).entrance_pupil
    ray = chief_ray(lens, field=pair, z_object=z_object, wavelength=wavelength)
    (x, y, z), (l, m, n) = ray.origin[0].tolist(), ray.direction[0].tolist()
    across = l * l + m * m
    return z - n * (x * l + y * m) / across if across != 0 else math.inf
