"""Wavefronts: optical path differences of an object point from the reference sphere around its image."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.display import picture_of
from plenoptic.core.values import Floats, frozen_array, result, wavelength_in_nm, whole
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.analysis.best_focus import imaged_point
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.pupil.beam import ImagedPoint
from plenoptic.optics.lens.pupil.iris_points import square_grid
from plenoptic.optics.lens.pupil.object_point import field_text
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.lens.waves.pupil_rule import pupil_rule, strehl_ratios
from plenoptic.optics.lens.waves.sphere_rays import rays_to_sphere
from plenoptic.optics.lens.waves.zernike_fit import ZernikeFit, ZernikeOrder, fit_zernike, zernike

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
    rule : (k, 5) array
        Rays of two quadrature rules over the iris, from which the Strehl ratio is computed: x and y as in `pupil`, path
        difference, and their amplitudes in either rule. Without rays if `pupil` is given, or if light passes through
        several parts of a radius of the iris.
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
    rule: Floats

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

        Integrated by Gauss's rule along radii of the iris, up to the end of the light on each, and by the trapezoidal
        rule over their angles. After `without("piston", "tilt")` it is nearly that of the brightest point of the image
        plane.
        """
        if not len(self.rule):
            return float(abs(self.amplitude @ np.exp(2j * math.pi * self.opd)) ** 2)
        return float(strehl_ratios(self.rule[:, 2], self.rule[:, 3:])[0])

    @property
    def strehl_error(self) -> float:
        """Error of `strehl`: its difference from half the angles and radii, or nan if it is the sum over `pupil`."""
        return float(np.ptp(strehl_ratios(self.rule[:, 2], self.rule[:, 3:]))) if len(self.rule) else math.nan

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
        rule = self.rule.copy()
        rule[:, 2] -= _sum(coefficients, rule[:, :2])
        return dataclasses.replace(self, opd=self.opd - _sum(coefficients, self.pupil), rule=rule)

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
    <Wavefront: 3228 rays from (0, 0) rad at 587.6 nm, RMS 0.0736 waves, peak to valley 0.243, Strehl 0.807>
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
    rule = None if pupil is not None else pupil_rule(lens, point, wave)
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
        rule=np.zeros((0, 5)) if rule is None else np.column_stack([rule.pupil, rule.rays.opd, rule.amplitude]),
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
