"""Pencils: the rays from one object point that fill the real iris.

A few rays are aimed at the edge of the iris. In object space they outline the pupil seen from this point: as positions
across the beam for an object at infinity, otherwise as direction cosines. The outline is widened and sampled uniformly;
the real stop and rims clip the rays. Nothing is interpolated: the outline is a sampling region only.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.rays import RayBundle
from plenoptic.core.sampling import sobol_points
from plenoptic.core.values import MAX_POINTS, Floats, check_kind, finite, number, seed_number, wavelength_in_nm, whole
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.pupil.outline import normals_of, polygon_around
from plenoptic.optics.lens.pupil.ray_aiming import aimed_rays
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.lens.trace import trace_part

REPLICATES = 32
"""Number of independent scramblings of the sampling points, for error estimates. With 8, errors of all fields and
wavelengths are right on average, and one in a hundred states a fifth of its true value."""

_RIM = 64
"""Rays aimed at the edge of the iris."""
_SIDES = 48
"""Sides of the polygon around them; around a circle it is 0.14 % larger than the circle."""
_MARGIN = 0.01
"""Widening of the sampled region over the outline."""
_MOST_WAVELENGTHS = 256
_GROWTH, _MOST_GROWTHS = 1.2, 16
_PARTS_OF_IRIS = (1.0, 0.9, 0.7, 0.5, 0.3, 0.1)


class Pencil(NamedTuple):
    """Rays from one object point, before and behind the lens, in consecutive replicates of equal size."""

    entering: RayBundle
    leaving: RayBundle
    """Rays behind the lens, including lost ones; see `RayBundle`."""
    chief: RayBundle
    """Chief ray behind the lens."""
    extent: float
    """Size of the uniformly sampled region: mm^2 across the beam, or projected solid angle in sr for a finite
    object."""


class _Launch(NamedTuple):
    """Parametrisation of rays by two coordinates: offsets across the beam (object at infinity), or two direction
    cosines.
    """

    origin: Floats
    across: Floats | None
    """(2, 3) unit vectors across the beam; None for a finite object."""
    direction: Floats
    wavelength: float

    def rays(self, coordinates: Floats) -> RayBundle:
        n = len(coordinates)
        if self.across is not None:
            direction = np.broadcast_to(self.direction, (n, 3))
            return RayBundle(self.origin + coordinates @ self.across, direction, self.wavelength)
        along = np.empty((n, 3))
        along[:, :2] = coordinates
        with np.errstate(invalid="ignore"):  # l^2 + m^2 > 1 gives NaN, a ray that no lens passes
            along[:, 2] = np.sqrt(1.0 - np.einsum("ij,ij->i", coordinates, coordinates))
        return RayBundle(np.broadcast_to(self.origin, (n, 3)), along, self.wavelength)

    def coordinates(self, rays: RayBundle) -> Floats:
        if self.across is not None:
            return np.asarray((rays.origin - self.origin) @ self.across.T)
        return np.asarray(rays.direction[:, :2])


class ImagedPoint(NamedTuple):
    """Object point, image plane and wavelengths of an analysis."""

    field: tuple[float, float]
    """x and y: angles in radians for an object at infinity, otherwise mm."""
    z_object: float
    z_image: float
    """Object and image plane: z in the lens frame, mm."""
    wavelengths: tuple[float, ...]
    """In nm."""

    @property
    def result_fields(self) -> dict[str, Any]:
        """Attributes common to the results of analyses."""
        return self._asdict() | {"field": np.array(self.field)}

    def rays(self, lens: LensStack, pupil: Floats, wavelength: float) -> RayBundle:
        """Rays of the point in front of the lens, aimed at points (n, 2) of the iris; see `aimed_rays`."""
        return aimed_rays(lens, field=self.field, pupil=pupil, z_object=self.z_object, wavelength=wavelength)


def checked_point(lens: LensStack, field: Sequence[float], z_object: float) -> tuple[tuple[float, float], float]:
    """Check an object point; returns field and z of the object as floats."""
    check_kind(lens, "lens", LensStack, "camera.lens")
    try:
        x, y = (0.0, field) if np.ndim(field) == 0 else field  # type: ignore[misc]
    except (TypeError, ValueError):
        raise InvalidValueError(f"field is {field!r}; it must be a pair (x, y), such as (0, 0.1), or y alone") from None
    z = number(z_object, "z_object")
    if math.isnan(z) or z == math.inf:
        raise InvalidValueError(f"z_object is {z}; it must be a position in mm, -math.inf for an object at infinity")
    return (finite(x, "field x"), finite(y, "field y")), z  # type: ignore[arg-type]


def checked_wavelengths(wavelength: float | Sequence[float]) -> tuple[float, ...]:
    """Check one or several wavelengths; returns a tuple in nm."""
    several = isinstance(wavelength, Sequence) or (isinstance(wavelength, np.ndarray) and wavelength.ndim > 0)
    values: list[Any] = list(wavelength) if several else [wavelength]  # type: ignore[arg-type]
    if not values:
        raise InvalidValueError("wavelength is an empty sequence; give at least one, in nm")
    return tuple(wavelength_in_nm(w) for w in values)


def meridian(field: Sequence[float] | Floats) -> Floats:
    """Unit vector (2,) in the image plane along the tangential plane: towards the field, y on the axis."""
    x, y = (float(component) for component in field)
    length = math.hypot(x, y)
    return np.array([x / length, y / length]) if length > 0 else np.array([0.0, 1.0])


def pencil(
    lens: LensStack, point: ImagedPoint, wavelength: float, *, rays: int, seed: int, replicates: int
) -> Pencil | None:
    """Pencil of at least `rays` rays (a multiple of `replicates`) from one object point; None if no ray reaches the
    iris.

    Each ray carries the same light. Rays of an object at infinity are uniform over the cross section of the beam; rays
    of a finite object are uniform over the direction cosines, as from a Lambertian patch of the object plane.
    """
    rim = np.asarray(lens.stop.outline(_RIM)) / lens.stop.semi_diameter
    chief = point.rays(lens, np.zeros((1, 2)), wavelength)
    if chief.status[0] != 0:
        return None
    for part in _PARTS_OF_IRIS:
        aimed = point.rays(lens, part * rim, wavelength)
        if np.count_nonzero(aimed.status == 0) >= _RIM // 2:
            break
        # Few rays reach the edge of the iris: start further inside, and let the region grow.
    aimed = aimed.selected(aimed.status == 0)
    if len(aimed) < 3:
        return None
    launch = _launch(aimed, finite_object=math.isfinite(point.z_object))
    corners = _grow_polygon(lens, launch, _outline(launch.coordinates(aimed)))
    each = -(-rays // replicates)
    uniform = np.concatenate([sobol_points(each, seed=seed, replicate=k)[:, :2] for k in range(replicates)])
    points, extent = _sample_polygon(corners, uniform)
    entering = launch.rays(points)
    return Pencil(entering, lens.trace(entering), lens.trace(chief), extent)


class PassingLight(NamedTuple):
    """Transmitted light of one object point: one row for each of m rays; without arguments no light."""

    points: Floats = np.empty((0, 2))
    """(m, 2) intersections with the image plane: x and y in mm."""
    slopes: Floats = np.empty((0, 2))
    """(m, 2) slopes dx/dz and dy/dz."""
    weight: Floats = np.empty(0)
    """(m,) relative light, reduced by grey masks."""
    colour: NDArray[np.uint8] = np.empty(0, np.uint8)
    """(m,) index of the wavelength."""
    replicate: NDArray[np.uint8] = np.empty(0, np.uint8)
    """(m,) index of the replicate."""
    through_iris: Floats = np.zeros(REPLICATES)
    """(replicates,) light through the iris if nothing else clips or attenuates it."""
    chief: Floats = np.full((1, 2), np.nan)
    """(wavelengths, 2) intersections of the chief rays with the image plane in mm; NaN for lost rays."""
    emitted: int = 0
    """Number of traced rays."""


def passing_light(
    lens: LensStack, point: ImagedPoint, *, rays: int, seed: int, replicates: int = REPLICATES
) -> PassingLight:
    """Transmitted light of an object point on the image plane, of equal radiance at each wavelength."""
    if len(point.wavelengths) > _MOST_WAVELENGTHS:
        raise InvalidValueError(f"wavelength has {len(point.wavelengths)} entries; give at most {_MOST_WAVELENGTHS}")
    count, start = whole(rays, "rays", at_least=1, at_most=MAX_POINTS), seed_number(seed)
    parts = []
    for colour, wavelength in enumerate(point.wavelengths):
        beam = pencil(lens, point, wavelength, rays=count, seed=start, replicates=replicates)
        dark = PassingLight(through_iris=np.zeros(replicates))
        parts.append(dark if beam is None else _passing_part(lens, beam, point.z_image, colour, replicates))
    rows = ("points", "slopes", "weight", "colour", "replicate", "chief")
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in rows}
    through_iris = np.array([part.through_iris for part in parts]).sum(axis=0)
    return PassingLight(**joined, through_iris=through_iris, emitted=sum(part.emitted for part in parts))


def _passing_part(lens: LensStack, beam: Pencil, z_image: float, colour: int, replicates: int) -> PassingLight:
    out, passes = beam.leaving, np.flatnonzero(beam.leaving.status == 0)
    direction, origin = out.direction[passes], out.origin[passes]
    slopes = direction[:, :2] / direction[:, 2:]
    each = beam.extent / len(out)
    replicate = np.repeat(np.arange(replicates, dtype=np.uint8), len(out) // replicates)
    through_iris = np.bincount(replicate, weights=each * light_at_iris(lens, beam), minlength=replicates)
    return PassingLight(
        points=origin[:, :2] + (z_image - origin[:, 2:]) * slopes,
        slopes=slopes,
        weight=each * out.weight[passes],
        colour=np.full(len(passes), colour, np.uint8),
        replicate=replicate[passes],
        through_iris=np.asarray(through_iris, dtype=np.float64),
        chief=beam.chief.at_z(z_image)[:, :2],
        emitted=len(out),
    )


def light_at_iris(lens: LensStack, beam: Pencil) -> Floats:
    """Transmission of each ray of a pencil by the iris alone, (n,).

    Rays lost behind the iris have passed it. Rays lost in front of it are traced again to the iris, without clipping by
    other rims and stops; if the iris is a mask, so are all rays except those lost at it.
    """
    if lens.model in (LensModel.THIN, LensModel.PARAXIAL):  # these models have no other stop
        return beam.leaving.weight
    iris, lost_at = lens.iris_index, beam.leaving.lost_at
    passes = beam.leaving.status == 0
    light = np.where(passes | (lost_at > iris), 1.0, 0.0)
    grey = lens.stop.row().cells is not None
    unknown = np.flatnonzero(passes | (lost_at != iris) if grey else ~passes & (lost_at < iris))
    if len(unknown):
        again = beam.entering.selected(unknown)
        if iris > 0 and lens.model is LensModel.EXACT:
            again = trace_part(lens, again, 0, iris - 1, clipping=False)
        light[unknown] = trace_part(lens, again, iris, iris).weight
    return light


def _launch(aimed: RayBundle, *, finite_object: bool) -> _Launch:
    direction = np.asarray(aimed.direction[0])
    if finite_object:
        return _Launch(np.asarray(aimed.origin[0]), None, direction, aimed.wavelength)
    # Two unit vectors perpendicular to the beam; x first, unless the beam runs along x.
    aside = np.array([1.0, 0.0, 0.0]) if abs(direction[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    first = aside - (aside @ direction) * direction
    first /= math.sqrt(first @ first)
    across = np.stack([first, np.cross(direction, first)])
    return _Launch(aimed.origin.mean(axis=0), across, direction, aimed.wavelength)


def _outline(points: Floats) -> Floats:
    """Corners (_SIDES, 2) of a convex polygon around points (n, 2), tight also around an ellipse."""
    centre = points.mean(axis=0)
    offsets = points - centre
    covariance = offsets.T @ offsets / len(points)
    # In units of their standard deviations along two axes, the points lie near a circle.
    spread = np.linalg.cholesky(covariance + 1e-12 * np.trace(covariance) * np.eye(2))
    round_points = np.linalg.solve(spread, offsets.T).T
    support = (1.0 + _MARGIN) * (round_points @ normals_of(_SIDES).T).max(axis=0)
    return np.asarray(centre + polygon_around(support) @ spread.T)


def _grow_polygon(lens: LensStack, launch: _Launch, corners: Floats) -> Floats:
    """Enlarge a polygon until no ray from its edge passes the lens."""
    edge = np.concatenate([corners, 0.5 * (corners + np.roll(corners, -1, axis=0))])
    centre, size = corners.mean(axis=0), 1.0
    for _ in range(_MOST_GROWTHS):
        if np.all(lens.trace(launch.rays(centre + size * (edge - centre))).status != 0):
            break
        size *= _GROWTH
    return np.asarray(centre + size * (corners - centre))


def _sample_polygon(corners: Floats, uniform: Floats) -> tuple[Floats, float]:
    """Map points (n, 2) of the unit square uniformly to a polygon; returns points (n, 2) and the polygon's area."""
    centre = corners.mean(axis=0)
    first = corners - centre
    second = np.roll(first, -1, axis=0)
    ends = np.cumsum(0.5 * (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]))
    area = float(ends[-1])
    target_area = uniform[:, 0] * area
    triangle = np.minimum(np.searchsorted(ends, target_area, side="right"), len(corners) - 1)
    starts = np.concatenate([[0.0], ends[:-1]])
    # The first number samples a triangle by area, its remainder the direction in it; the second number samples the
    # distance.
    turned = (target_area - starts[triangle]) / (ends - starts)[triangle]
    points = first[triangle] + turned[:, None] * (second - first)[triangle]
    points *= np.sqrt(uniform[:, 1])[:, None]
    return points + centre, area
