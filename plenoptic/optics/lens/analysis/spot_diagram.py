"""Spot diagrams and ray fans: intersections of the rays of one object point with the image plane."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.display import picture_of
from plenoptic.core.values import MAX_POINTS, Floats, read_only, result, whole
from plenoptic.core.warn import warn
from plenoptic.optics.lens.analysis.best_focus import imaged_point, working_f_number
from plenoptic.optics.lens.pupil.beam import REPLICATES, ImagedPoint, meridian, passing_light
from plenoptic.optics.lens.pupil.iris_points import INSIDE
from plenoptic.optics.lens.pupil.object_point import field_text
from plenoptic.optics.lens.stack import LensStack

AIRY = 1.2196698912665045
"""First zero of J1 over pi: radius of the Airy disc over wavelength and f-number."""


@result
class SpotDiagram:
    """Intersections of the rays of one object point with the image plane. Made by `spot_diagram`.

    Attributes
    ----------
    x, y : (m,) array
        Intersections of the transmitted rays with the image plane, mm.
    weight : (m,) array
        Fraction of the light in each ray; the sum is 1.
    colour : (m,) array
        Index in `wavelengths` of each ray.
    replicate : (m,) array
        Index of each ray's replicate, one of 32 independent samples; their differences give the errors.
    chief : (w, 2) array
        Intersection of each wavelength's chief ray with the image plane, mm; NaN if the ray is lost.
    field : (2,) array
        Object point: radians for an object at infinity, otherwise mm.
    z_object, z_image : float
        Planes in the lens frame, mm.
    wavelengths : tuple of float
        nm.
    fraction, fraction_error : float
        Fraction of the light through the iris that passes all rims and other stops, and its standard error.
    airy_radius : float
        Radius in mm of the Airy disc at the first wavelength and the paraxial working f-number on the axis; NaN if that
        is undefined.
    """

    x: Floats
    y: Floats
    weight: Floats
    colour: NDArray[np.uint8]
    replicate: NDArray[np.uint8]
    chief: Floats
    field: Floats
    z_object: float
    z_image: float
    wavelengths: tuple[float, ...]
    fraction: float
    fraction_error: float
    airy_radius: float

    @property
    def centroid(self) -> Floats:
        """Centroid (2,) of the light, mm; NaN if no light passes."""
        if not len(self.x):
            return read_only(np.full(2, np.nan))
        return read_only(np.array([self.weight @ self.x, self.weight @ self.y]))

    @property
    def rms_radius(self) -> float:
        """Root mean square distance of the light from its centroid, mm; NaN if no light passes."""
        if not len(self.x):
            return math.nan
        dx, dy = self._offsets()
        return math.sqrt(float(self.weight @ (dx * dx + dy * dy)))

    @property
    def rms_radius_error(self) -> float:
        """Standard error in mm of the sampled quantity `rms_radius`; NaN for fewer than 2 replicates."""
        dx, dy = self._offsets()
        sums = [self.weight, self.weight * dx, self.weight * dy, self.weight * (dx * dx + dy * dy)]
        light, x, y, r2 = leave_one_out_sums(sums, self.replicate)
        with np.errstate(divide="ignore", invalid="ignore"):
            return float(jackknife_error(np.sqrt(np.maximum(r2 / light - (x * x + y * y) / light**2, 0.0))))

    @property
    def geometric_radius(self) -> float:
        """Largest distance of a sampled ray from the centroid, mm: a lower bound."""
        if not len(self.x):
            return math.nan
        return float(np.hypot(*self._offsets()).max())

    def _offsets(self) -> tuple[Floats, Floats]:
        x, y = self.centroid
        return self.x - x, self.y - y

    def __repr__(self) -> str:
        return (
            f"<SpotDiagram: {len(self.x)} rays from {field_text(self.field, self.z_object)} on z = "
            f"{self.z_image:.6g} mm, RMS radius {1e3 * self.rms_radius:.4g} um>"
        )

    _repr_html_ = picture_of


def leave_one_out_sums(weights: Sequence[Floats], replicate: NDArray[np.uint8]) -> Floats:
    """Sums of each array over all replicates but one: (arrays, REPLICATES)."""
    sums = np.array([np.bincount(replicate, weights=w, minlength=REPLICATES) for w in weights])
    return np.asarray(sums.sum(axis=1, keepdims=True) - sums)


def jackknife_error(estimates: Floats) -> Floats:
    """Standard error from estimates (..., n) that each leave out one of n equal, independent parts.

    B. Efron, The Jackknife, the Bootstrap and Other Resampling Plans, SIAM 1982, equation 3.1.
    """
    n = estimates.shape[-1]
    return np.asarray(np.sqrt((n - 1) * np.var(estimates, axis=-1)))


def spot_diagram(
    lens: LensStack,
    *,
    field: Sequence[float] = (0.0, 0.0),
    z_object: float = -math.inf,
    z_image: float | None = None,
    wavelength: float | Sequence[float] = 587.6,
    rays: int = 1024,
    seed: int = 0,
) -> SpotDiagram:
    """Trace the rays from one object point that fill the iris to the image plane.

    Each ray carries the same light. Rays of an object at infinity are uniform over the cross section of the beam. Rays
    of a finite object are uniform over direction cosines, as from a Lambertian patch of the object plane. The real stop
    and the rims of all surfaces clip them.

    Parameters
    ----------
    lens : LensStack
        Rays are traced by its `model`.
    field : (2,) sequence of float, optional
        x and y of the object point: angles in radians for an object at infinity, otherwise mm.
    z_object : float, optional
        z of the object plane in the lens frame, mm; -inf for an object at infinity.
    z_image : float, optional
        z of the image plane, mm; by default the paraxial image at the first wavelength.
    wavelength : float or sequence of float, optional
        nm. Several wavelengths have equal radiance and share one diagram.
    rays : int, optional
        Rays traced for each wavelength, rounded up to a multiple of 8. About 3 % of them miss the iris by design.
    seed : int, optional
        Seed of the Owen-scrambled Sobol points.

    Returns
    -------
    SpotDiagram
        If no light passes: without rays, and with NaN for undefined values.

    Raises
    ------
    InvalidValueError
        If a number is out of range, or no image plane is given and the paraxial one is at infinity.

    Notes
    -----
    The sampling error of the RMS radius falls faster than 1 / sqrt(rays); `SpotDiagram.rms_radius_error` reports it.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2")
    >>> spot = pl.aberrations.spot_diagram(lens, field=(0, 40.0), z_object=-1000.0, rays=4096)
    >>> spot
    <SpotDiagram: ... rays from (0, 40) mm on z = 113.645 mm, RMS radius ... um>
    >>> spot.rms_radius_error < 0.01 * spot.rms_radius < spot.geometric_radius
    True
    """
    return spots_of(lens, imaged_point(lens, field, z_object, z_image, wavelength), rays, seed)


def spots_of(lens: LensStack, point: ImagedPoint, rays: int, seed: int) -> SpotDiagram:
    """Spot diagram of an object point; see `spot_diagram`."""
    light = passing_light(lens, point, rays=rays, seed=seed)
    total = float(light.weight.sum())
    if total == 0:
        unit = "rad, not degrees" if math.isinf(point.z_object) else "mm"
        warn(f"no light from the field {point.field} ({unit}) passes {lens.name or 'the lens'}; choose a smaller field")
    passing, through_iris = leave_one_out_sums([light.weight], light.replicate)[0], light.through_iris
    emitted = float(through_iris.sum())
    remaining = emitted - through_iris
    with np.errstate(divide="ignore", invalid="ignore"):
        error = float(jackknife_error(np.where(remaining > 0, passing / remaining, 0.0)))
    return SpotDiagram(
        x=light.points[:, 0],
        y=light.points[:, 1],
        weight=light.weight / total if total > 0 else light.weight,
        colour=light.colour,
        replicate=light.replicate,
        chief=light.chief,
        fraction=min(total / emitted, 1.0) if emitted > 0 else 0.0,
        fraction_error=error,
        airy_radius=AIRY * 1e-6 * point.wavelengths[0] * working_f_number(lens, point.z_object, point.wavelengths[0]),
        **point.result_fields,
    )


@result
class RayFan:
    """Transverse ray aberrations along two diameters of the iris. Made by `ray_fan`.

    Components are along the sagittal and the tangential axis of the image plane; the latter points along the field.
    They are x and y for a field along +y, and on the axis.

    Attributes
    ----------
    pupil : (n,) array
        Coordinate in the iris in units of its semi-diameter, from -1 to 1.
    tangential : (w, n, 2) array
        Sagittal and tangential aberration in mm of the tangential fan, for each wavelength: displacement on the image
        plane from the chief ray of the first wavelength. NaN for lost rays.
    sagittal : (w, n, 2) array
        Sagittal and tangential aberration in mm of the sagittal fan.
    chief : (2,) array
        x and y of the chief ray of the first wavelength on the image plane, mm.
    field, z_object, z_image, wavelengths
        As in `SpotDiagram`.
    """

    pupil: Floats
    tangential: Floats
    sagittal: Floats
    chief: Floats
    field: Floats
    z_object: float
    z_image: float
    wavelengths: tuple[float, ...]

    _repr_html_ = picture_of


def ray_fan(
    lens: LensStack,
    *,
    field: Sequence[float] = (0.0, 0.0),
    z_object: float = -math.inf,
    z_image: float | None = None,
    wavelength: float | Sequence[float] = 587.6,
    points: int = 65,
) -> RayFan:
    """Transverse aberrations along the tangential and the sagittal diameter of the iris.

    Parameters
    ----------
    lens, field, z_object, z_image, wavelength
        See `spot_diagram`. The chief ray of the first wavelength is the reference for all, so the fans include lateral
        colour.
    points : int, optional
        Rays of each fan.

    References
    ----------
    W. T. Welford, Aberrations of Optical Systems, 1986, section 7.2.

    Examples
    --------
    >>> import plenoptic as pl
    >>> fan = pl.aberrations.ray_fan(pl.load_lens("singlet-100mm-f4"), points=5)
    >>> fan.pupil
    array([-1. , -0.5,  0. ,  0.5,  1. ])
    >>> bool(fan.tangential[0, -1, 1] < 0)          # undercorrected: the marginal ray crosses the axis too early
    True
    """
    point = imaged_point(lens, field, z_object, z_image, wavelength)
    n = whole(points, "points", at_least=2, at_most=MAX_POINTS)
    pupil = np.linspace(-1.0, 1.0, n)
    along = meridian(point.field)
    # Rows of the matrix: sagittal and tangential axes of the image plane.
    axes = np.array([[along[1], -along[0]], along])
    inside = INSIDE * pupil[:, None]
    lines = np.concatenate([np.zeros((1, 2)), inside * axes[1], inside * axes[0]])
    aimed = [point.rays(lens, lines, wave) for wave in point.wavelengths]
    hits = np.array([lens.trace(rays).at_z(point.z_image)[:, :2] for rays in aimed])
    chief = hits[0, 0]
    aberration = (hits[:, 1:] - chief) @ axes.T
    return RayFan(pupil, aberration[:, :n], aberration[:, n:], chief, **point.result_fields)
