"""Wavefronts: optical path differences of an object point from the reference sphere around its image."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.display import picture_of
from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats, frozen_array, result, wavelength_in_nm, whole
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.analysis.best_focus import imaged_point
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.optical_path import paths_of_part
from plenoptic.optics.lens.pupil.beam import ImagedPoint, field_text
from plenoptic.optics.lens.pupil.iris_points import square_grid
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.lens.waves.zernike_fit import ZernikeFit, ZernikeOrder, fit_zernike, zernike

_STEP = 1e-4
"""Spacing of neighbouring rays for difference quotients, in units of the iris's semi-diameter."""
_REMOVABLE = {"piston": (1,), "tilt": (2, 3), "defocus": (4,)}


@result
class Wavefront:
    """Optical path differences of the transmitted rays of one object point. Made by `wavefront`.

    Attributes
    ----------
    pupil : (n, 2) array
        Intersections of the rays with the iris, in units of its semi-diameter.
    opd : (n,) array
        Optical path difference in waves: path of the chief ray to the reference sphere minus that of the ray. 0 for the
        chief ray, positive if the wavefront is ahead of the sphere.
    amplitude : (n,) array
        Amplitude on the reference sphere times the solid angle of the ray seen from the image point, so sums over rays
        are diffraction integrals; the sum is 1.
    toward : (n, 3) array
        Unit vectors from the image point to the intersections of the rays with the reference sphere.
    image : (3,) array
        Centre of the sphere, the intersection of the chief ray with the image plane, mm in the lens frame.
    radius : float
        Radius of the sphere, mm: distance from the image to the exit pupil along the chief ray. Negative for a pupil
        behind the image, infinite for a pupil at infinity.
    index : float
        Refractive index of the image space medium.
    field : (2,) array
        As in `spot_diagram`: radians for an object at infinity, otherwise mm.
    z_object, z_image : float
        Planes in the lens frame, mm.
    wavelength : float
        nm.
    """

    pupil: Floats
    opd: Floats
    amplitude: Floats
    toward: Floats
    image: Floats
    radius: float
    index: float
    field: Floats
    z_object: float
    z_image: float
    wavelength: float

    @property
    def rms(self) -> float:
        """Root mean square wavefront error about the mean, waves, with equal weights over the iris."""
        return float(np.std(self.opd))

    @property
    def peak_to_valley(self) -> float:
        """Largest minus smallest optical path difference, waves."""
        return float(np.ptp(self.opd))

    @property
    def strehl(self) -> float:
        """Strehl ratio: intensity at the image point over that of an aberration-free wavefront of the same amplitudes.

        After `without("piston", "tilt")` it is nearly that of the brightest point of the image plane.
        """
        return float(abs(self.amplitude @ np.exp(2j * math.pi * self.opd)) ** 2)

    def without(self, *parts: str) -> Wavefront:
        """The same wavefront minus its "piston", "tilt" or "defocus", from a joint fit of all three over the iris."""
        unknown = [part for part in parts if part not in _REMOVABLE]
        if unknown or not parts:
            raise InvalidValueError(
                f"parts are {', '.join(map(repr, parts))}; they must be among {', '.join(_REMOVABLE)}"
            )
        coefficients = self.zernike(4).coefficients.copy()
        removed = {term for part in parts for term in _REMOVABLE[part]}
        coefficients[[j for j in range(4) if j + 1 not in removed]] = 0.0
        return dataclasses.replace(self, opd=self.opd - _sum(coefficients, self.pupil))

    def zernike(self, terms: int = 37, *, order: ZernikeOrder = ZernikeOrder.NOLL) -> ZernikeFit:
        """Least-squares fit of Zernike polynomials to the optical path differences, over the circle of the iris.

        Parameters
        ----------
        terms : int, optional
            Number of terms, at least 1: at most 91 in NOLL, 37 in FRINGE order.
        order : ZernikeOrder, optional

        Raises
        ------
        InvalidValueError
            If fewer rays than terms pass the lens.
        """
        count = whole(terms, "terms", at_least=1)
        return fit_zernike(self.pupil, self.opd, np.ones(len(self.opd)), count, order)

    def point_spread(self, points: ArrayLike) -> Floats:
        """Intensity at points around the image, over that at the image point without aberrations.

        Direct Huygens summation over all rays. It is valid for strong aberrations, small f-numbers, and points off the
        image plane. The paths of neighbouring rays to the point must differ by less than half a wave.

        Parameters
        ----------
        points : (..., 3) array
            Relative to `image`, mm.

        Returns
        -------
        (...) array
        """
        positions = np.asarray(frozen_array(points, name="points", shape=(*[None] * (np.ndim(points) - 1), 3)))
        wave = 1e-6 * self.wavelength / self.index
        light = self.amplitude * np.exp(2j * math.pi * self.opd)
        values = [
            abs(huygens_sum(light, self.toward, self.radius, wave, point)) ** 2 for point in positions.reshape(-1, 3)
        ]
        return np.array(values).reshape(positions.shape[:-1])

    def __repr__(self) -> str:
        return (
            f"<Wavefront: {len(self.opd)} rays from {field_text(self.field, self.z_object)} at {self.wavelength:g} nm, "
            f"RMS {self.rms:.3g} waves, peak to valley {self.peak_to_valley:.3g}, Strehl {self.strehl:.3g}>"
        )

    _repr_html_ = picture_of


def excess_path(toward: Floats, radius: float, point: Floats) -> Floats:
    """(...): distance in mm of a point (3,) from points of the sphere in directions (..., 3), minus the radius."""
    x, y, z = point.tolist()
    off = (x * x + y * y + z * z) / radius - 2.0 * (toward[..., 0] * x + toward[..., 1] * y + toward[..., 2] * z)
    return np.asarray(off / (1.0 + np.sqrt(1.0 + off / radius)))


def huygens_sum(light: NDArray[np.complex128], toward: Floats, radius: float, wave: float, point: Floats) -> complex:
    """Field at a point (3,), relative to the image in mm, of amplitudes (n,) on the sphere in directions (n, 3)."""
    # Vector products through BLAS would wait for its threads.
    return complex((light * np.exp((-2j * math.pi / wave) * excess_path(toward, radius, point))).sum())


def _sum(noll: Floats, pupil: Floats) -> Floats:
    terms = [a * zernike(j, pupil[:, 0], pupil[:, 1]) for j, a in enumerate(noll, start=1) if a]
    return np.asarray(sum(terms, np.zeros(len(pupil))))


def wavefront(
    lens: LensStack,
    *,
    field: Sequence[float] = (0.0, 0.0),
    z_object: float = -math.inf,
    z_image: float | None = None,
    wavelength: float = 587.6,
    pupil: ArrayLike | None = None,
) -> Wavefront:
    """Wavefront of one object point: optical path differences from the reference sphere through the exit pupil.

    Parameters
    ----------
    lens : LensStack
        Must have LensModel.EXACT; other models have no aberrations.
    field, z_object, z_image
        As for `spot_diagram`: object point and image plane, by default the paraxial one.
    wavelength : float, optional
        nm.
    pupil : (n, 2) array, optional
        Points of the iris in units of its semi-diameter, each with the same area; None: a grid of 64 x 64. See
        `aiming`.

    Raises
    ------
    InvalidValueError
        If there is no chief ray or no image, or no ray passes the lens.

    Notes
    -----
    The centre of the reference sphere is the intersection of the chief ray with the image plane. The sphere passes
    through the intersection of the chief ray with the paraxial exit pupil. Path differences are computed without
    subtracting two long paths. The path ends at the foot of the perpendicular from the image point onto the ray. From
    there to the sphere it exceeds that of the chief ray by h^2 / (R + sqrt(R^2 - h^2)), with the distance h of the ray
    from the image point. This holds for an exit pupil at infinity too.

    W. T. Welford, Aberrations of Optical Systems, 1986, chapter 7; his W has the same sign.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=6.0))
    >>> wave = pl.aberrations.wavefront(lens)
    >>> wave
    <Wavefront: 3228 rays from (0, 0) rad at 587.6 nm, RMS 0.0736 waves, peak to valley 0.243, Strehl 0.805>
    >>> wave.without("defocus").rms < wave.rms
    True
    """
    wave = wavelength_in_nm(wavelength)
    point = aberrated_point(lens, field, z_object, z_image, wave)
    samples = square_grid(64) if pupil is None else np.asarray(frozen_array(pupil, name="pupil", shape=(None, 2)))
    to_sphere = rays_to_sphere(lens, point, wave, samples)
    passes = np.flatnonzero(np.isfinite(to_sphere.opd))
    if not len(passes):
        raise InvalidValueError(f"no ray from the field {point.field} passes the lens; give a smaller field")
    amplitude = np.sqrt(to_sphere.light * to_sphere.solid_angle)[passes]
    return Wavefront(
        pupil=samples[passes],
        opd=to_sphere.opd[passes],
        amplitude=amplitude / amplitude.sum(),
        toward=to_sphere.toward[passes],
        image=to_sphere.image,
        radius=to_sphere.radius,
        index=to_sphere.refractive_index,
        field=np.array(point.field),
        z_object=point.z_object,
        z_image=point.z_image,
        wavelength=wave,
    )


def aberrated_point(
    lens: LensStack, field: Sequence[float], z_object: float, z_image: float | None, wavelength: float | Sequence[float]
) -> ImagedPoint:
    """Object point as from `imaged_point`; an error if the lens is not LensModel.EXACT."""
    point = imaged_point(lens, field, z_object, z_image, wavelength)
    if lens.model is not LensModel.EXACT:
        raise InvalidValueError(
            f"the model of the lens is {lens.model.name}, which has no aberrations; use LensModel.EXACT"
        )
    return point


class SphereRays(NamedTuple):
    """Intersections with the reference sphere of rays from one object point through points of the iris; nan if lost."""

    opd: Floats
    """(n,), waves."""
    light: Floats
    """(n,): relative light per unit area of the iris."""
    solid_angle: Floats
    """(n,): solid angle per unit area of the iris, seen from the image point."""
    toward: Floats
    """(n, 3): unit vectors from the image point."""
    slopes: Floats
    """(n, 2, 2): Jacobian of x and y of `toward` by x and y of the iris."""
    middle: Floats
    """(3,): `toward` of the chief ray."""
    image: Floats
    radius: float
    refractive_index: float


def rays_to_sphere(lens: LensStack, point: ImagedPoint, wavelength: float, pupil: Floats) -> SphereRays:
    """Trace rays through points (n, 2) of the iris, each with two neighbours, to the reference sphere."""
    n, steps = len(pupil), _STEP * np.eye(2)
    points = np.concatenate([pupil, pupil + steps[0], pupil + steps[1], np.zeros((1, 2))])
    entering = point.rays(lens, points, wavelength)
    # Solid angles need the neighbours of a ray even if they are vignetted, and path differences need the chief ray even
    # if the centre of the iris is obscured.
    behind, path = paths_of_part(lens, entering, 0, len(lens.elements) - 1, clipping=False)
    if behind.status[-1] != 0:
        raise InvalidValueError(f"there is no chief ray from the field {point.field}; give a smaller field")
    chief = behind.selected(np.arange(len(points)) == 3 * n)
    image, index = chief.at_z(point.z_image)[0], float(lens.indices(wavelength)[-1])
    exit_pupil = cardinal_points(lens, wavelength).exit_pupil
    radius = math.inf if math.isinf(exit_pupil) else float((image[2] - exit_pupil) / chief.direction[0, 2])
    lengths, toward = to_sphere(behind, path, image, radius, index)
    passing = lens.trace(entering.selected(np.arange(len(points)) < n))
    finite_object = math.isfinite(point.z_object)
    light = _area(entering.direction if finite_object else entering.origin, n)
    if finite_object:
        light = light * np.abs(entering.direction[:n, 2])
    xy = toward[: 3 * n, :2].reshape(3, n, 2)
    return SphereRays(
        opd=np.where(passing.status == 0, (lengths[-1] - lengths[:n]) / (1e-6 * wavelength), np.nan),
        light=light * passing.weight,
        solid_angle=_area(toward, n),
        toward=toward[:n],
        slopes=np.stack([xy[1] - xy[0], xy[2] - xy[0]], axis=2) / _STEP,
        middle=toward[-1],
        image=image,
        radius=radius,
        refractive_index=index,
    )


def _area(vectors: Floats, n: int) -> Floats:
    """(n,): areas spanned by vectors (3 n, 3) of iris points and their two neighbours, over the squared step."""
    one, right, up = vectors[:n], vectors[n : 2 * n], vectors[2 * n : 3 * n]
    return np.asarray(np.linalg.norm(np.cross(right - one, up - one), axis=1)) / _STEP**2


def to_sphere(behind: RayBundle, path: Floats, image: Floats, radius: float, index: float) -> tuple[Floats, Floats]:
    """Optical paths (n,) to a sphere around an image point, relative to a ray through that point, and their end points.

    `path` are the optical paths to the origins of `behind`; the end points are unit vectors (n, 3) from the image.
    """
    away = behind.origin - image
    along = (away * behind.direction).sum(axis=1)
    across = away - along[:, None] * behind.direction
    h2 = (across**2).sum(axis=1)
    if math.isinf(radius):
        return path - index * along, -behind.direction
    with np.errstate(invalid="ignore"):
        more = h2 / (radius + math.copysign(1.0, radius) * np.sqrt(radius**2 - h2))
    return path - index * (along - more), (across - (radius - more)[:, None] * behind.direction) / radius
