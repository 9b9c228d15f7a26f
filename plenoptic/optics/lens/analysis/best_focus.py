"""Best focus of a lens."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.display import picture_of
from plenoptic.core.values import Floats, check_kind, choice, finite, frozen_array, result
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.gaussian import paraxial
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points, image_position
from plenoptic.optics.lens.models import FocusCriterion, LensModel
from plenoptic.optics.lens.pupil.beam import ImagedPoint, checked_point, checked_wavelengths, passing_light
from plenoptic.optics.lens.pupil.object_point import field_text
from plenoptic.optics.lens.stack import LensStack

_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
_SEARCH_STEPS = 80
"""Golden sections: 0.618^80 is 2e-17 of the first interval."""
_REPLICATES = 8
"""Fewer replicates than for standard errors, which best focus does not need: fewer sets of points are more even."""


def _require_image(lens: LensStack) -> None:
    check_kind(lens, "lens", LensStack, "camera.lens")
    if lens.model is LensModel.NONE:
        raise InvalidValueError(
            "the lens has the model LensModel.NONE, which refracts no ray, so there is no image plane; "
            "use LensModel.THIN, PARAXIAL or EXACT"
        )


def front_focus(lens: LensStack, wavelength: float = 587.6) -> float:
    """Position z in mm of the front focus by the lens's model; objects in front of it have a real image."""
    _require_image(lens)
    points = cardinal_points(lens, wavelength)
    return points.rear_principal - points.front_efl if lens.model is LensModel.THIN else points.front_focus


def paraxial_focus(lens: LensStack, z_object: float, wavelength: float = 587.6) -> float:
    """Position z in mm of the Gaussian image of a plane by the lens's model; see `image_position`.

    THIN has both principal planes at the rear principal point; PARAXIAL and EXACT image by the cardinal points.
    LensModel.NONE raises an InvalidValueError.
    """
    _require_image(lens)
    if lens.model is not LensModel.THIN:
        return image_position(lens, z_object, wavelength)
    points = cardinal_points(lens, wavelength)
    if math.isinf(z_object):
        return points.rear_focus
    distance = points.rear_principal - z_object
    if distance == points.front_efl:
        return math.inf
    # Newton's form of the imaging equation, without a difference of reciprocals.
    return points.rear_focus + points.efl * points.front_efl / (distance - points.front_efl)


def imaged_point(
    lens: LensStack, field: Sequence[float], z_object: float, z_image: float | None, wavelength: float | Sequence[float]
) -> ImagedPoint:
    """An object point, wavelengths and image plane, by default the paraxial one of the first wavelength; or an error.

    Parameters are those of `spot_diagram`.
    """
    point, z = checked_point(lens, field, z_object)
    wavelengths = checked_wavelengths(wavelength)
    plane = paraxial_focus(lens, z, wavelengths[0]) if z_image is None else finite(z_image, "z_image")
    if not math.isfinite(plane):
        raise InvalidValueError(f"the object at z = {z:g} mm has its paraxial image at infinity; give z_image, in mm")
    return ImagedPoint(point, z, plane, wavelengths)


def working_f_number(lens: LensStack, z_object: float = -math.inf, wavelength: float = 587.6) -> float:
    """Working f-number: 1 / (2 NA'), with the paraxial numerical aperture NA' on axis in image space, by the lens's
    model.

    NaN for LensModel.NONE and for lenses without a focal length.
    """
    points = cardinal_points(lens, wavelength)
    if lens.model is LensModel.NONE or not math.isfinite(points.efl):
        return math.nan
    if lens.model is LensModel.THIN:
        # THIN has its iris in the plane of the lens, with the size of the entrance pupil.
        reach = abs(paraxial_focus(lens, z_object, wavelength) - points.rear_principal)
        return reach / (2.0 * points.entrance_pupil_semi_diameter * float(lens.indices(wavelength)[-1]))
    try:
        f_number = paraxial.working_f_number(lens, z_object, wavelength)
    except InvalidValueError:
        return math.nan
    return f_number if math.isfinite(f_number) else math.nan


def best_focus(
    lens: LensStack,
    *,
    field: Sequence[float] = (0.0, 0.0),
    z_object: float = -math.inf,
    wavelength: float | Sequence[float] = 587.6,
    criterion: FocusCriterion = FocusCriterion.RMS_SPOT,
    rays: int = 1 << 14,
    seed: int = 0,
) -> float:
    """Best focus of an object point: z in mm, in the lens frame.

    Rays behind the lens are straight, so the variance of the spot is a quadratic function of z with a closed-form
    minimum. The largest distance from the centroid is convex in z and is minimised by golden section.

    Parameters
    ----------
    lens, field, z_object, wavelength, rays, seed
        See `spot_diagram`. PARAXIAL ignores the field and takes the first wavelength.
    criterion : FocusCriterion, optional

    Returns
    -------
    float
        In front of the lens for a virtual image; inf if the emerging rays are parallel.

    Raises
    ------
    InvalidValueError
        If the lens has LensModel.NONE, or fewer than two rays pass it.

    References
    ----------
    For third-order spherical aberration the best RMS focus lies 2/3 of the way from the paraxial to the marginal focus,
    the circle of least confusion 3/4: V. N. Mahajan, Optical Imaging and Aberrations, part I, section 4.3.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("singlet-100mm-f4")
    >>> kinds = [pl.FocusCriterion.PARAXIAL, pl.FocusCriterion.RMS_SPOT, pl.FocusCriterion.GEOMETRIC_SPOT]
    >>> [round(pl.aberrations.best_focus(lens, criterion=kind), 2) for kind in kinds]
    [102.7, 101.55, 101.4]
    """
    _require_image(lens)
    kind = choice(criterion, FocusCriterion, "criterion")
    if kind is FocusCriterion.PARAXIAL:
        _, z = checked_point(lens, field, z_object)
        return paraxial_focus(lens, z, checked_wavelengths(wavelength)[0])
    beam = _beam(lens, field, z_object, wavelength, rays, seed)
    if beam.parallel:
        return math.inf
    return beam.z + (_least_radius(beam) if kind is FocusCriterion.GEOMETRIC_SPOT else beam.sharpest)


class _StraightRays(NamedTuple):
    """Rays behind the lens: heights and slopes relative to their centroid, in a plane near the image."""

    z: float
    heights: Floats
    slopes: Floats
    weight: Floats

    @property
    def spread(self) -> float:
        return float(self.weight @ np.einsum("ij,ij->i", self.slopes, self.slopes))

    @property
    def parallel(self) -> bool:
        return bool(self.spread <= (1e-12) ** 2 * self.weight.sum())

    @property
    def sharpest(self) -> float:
        """Distance behind z of the minimum of the mean square height."""
        return -float(self.weight @ np.einsum("ij,ij->i", self.heights, self.slopes)) / self.spread


def _beam(
    lens: LensStack, field: Sequence[float], z_object: float, wavelength: float | Sequence[float], rays: int, seed: int
) -> _StraightRays:
    point, z = checked_point(lens, field, z_object)
    wavelengths = checked_wavelengths(wavelength)
    guess = paraxial_focus(lens, z, wavelengths[0])
    # Near the image, heights and slopes have little correlation, so there is no cancellation.
    z_near = guess if math.isfinite(guess) else float(lens.vertices[-1])
    source = ImagedPoint(point, z, z_near, wavelengths)
    light = passing_light(lens, source, rays=rays, seed=seed, replicates=_REPLICATES)
    if not light.emitted:
        unit = "in rad, not degrees" if math.isinf(z) else "in mm"
        raise InvalidValueError(
            f"no ray from the field {field_text(point, z)} reaches the iris of {lens.name or 'the lens'}: the field is "
            f"too far from the axis; give a smaller one, {unit}"
        )
    passing = int(np.count_nonzero(light.weight))
    if passing < 2:
        raise InvalidValueError(
            f"{passing} of {light.emitted} rays from the field {field_text(point, z)} pass the lens; rims and stops "
            "clip the others, or coatings reflect all of their light: give a smaller field, or more rays"
        )
    total = light.weight.sum()
    heights = light.points - light.weight @ light.points / total
    slopes = light.slopes - light.weight @ light.slopes / total
    return _StraightRays(z_near, heights, slopes, light.weight)


@result
class ThroughFocus:
    """Size of the spot in planes around the focus. Made by `through_focus`.

    Attributes
    ----------
    z : (n,) array
        Planes in the lens frame, mm.
    rms_radius, geometric_radius : (n,) array
        RMS and largest distance of the rays from their centroid in each plane, mm.
    best : float
        z of the smallest RMS radius, mm.
    field, z_object
        As in `SpotDiagram`.
    """

    z: Floats
    rms_radius: Floats
    geometric_radius: Floats
    best: float
    field: Floats
    z_object: float

    _repr_html_ = picture_of


def through_focus(
    lens: LensStack,
    z: ArrayLike | None = None,
    *,
    field: Sequence[float] = (0.0, 0.0),
    z_object: float = -math.inf,
    wavelength: float | Sequence[float] = 587.6,
    rays: int = 1 << 14,
    seed: int = 0,
) -> ThroughFocus:
    """Through-focus spot size: RMS and geometric radius in planes around the best focus.

    Parameters
    ----------
    lens, field, z_object, wavelength, rays, seed
        See `spot_diagram`.
    z : (n,) array, optional
        Planes in the lens frame, mm. Default: 101 around the best focus, up to about four times the smallest spot.

    Raises
    ------
    InvalidValueError
        As `best_focus`, and if the emerging rays are parallel.

    Examples
    --------
    >>> import plenoptic as pl
    >>> scan = pl.aberrations.through_focus(pl.load_lens("singlet-100mm-f4"))
    >>> round(scan.best, 2), round(float(scan.z[scan.rms_radius.argmin()]), 1)
    (101.55, 101.6)
    """
    _require_image(lens)
    beam = _beam(lens, field, z_object, wavelength, rays, seed)
    if beam.parallel:
        raise InvalidValueError("the emerging rays are parallel and have no focus; give another z_object")
    best = beam.z + beam.sharpest
    total = float(beam.weight.sum())
    if z is None:
        offsets = beam.heights + beam.sharpest * beam.slopes
        least_square = float(beam.weight @ np.einsum("ij,ij->i", offsets, offsets))
        reach = max(4.0 * math.sqrt(least_square / beam.spread), 1e-9 * max(abs(best), 1.0))
        z = np.linspace(best - reach, best + reach, 101)
    planes = frozen_array(np.atleast_1d(np.asarray(z, dtype=object)), name="z", shape=(None,))
    rms, geometric = np.empty(len(planes)), np.empty(len(planes))
    for i, plane in enumerate(planes - beam.z):
        offsets = beam.heights + plane * beam.slopes
        r2 = np.einsum("ij,ij->i", offsets, offsets)
        rms[i], geometric[i] = math.sqrt(float(beam.weight @ r2) / total), math.sqrt(float(r2.max()))
    point, z_point = checked_point(lens, field, z_object)
    return ThroughFocus(planes, rms, geometric, best, np.asarray(point), z_point)


def _least_radius(beam: _StraightRays) -> float:
    """Distance behind z of the minimum of the largest ray distance from the centroid, a convex function of z."""

    def radius2(z: float) -> float:
        offsets = beam.heights + z * beam.slopes
        return float(np.einsum("ij,ij->i", offsets, offsets).max())

    shift = beam.sharpest
    # Start interval around the best RMS focus: largest ray distance over RMS slope; doubled until it holds the minimum.
    reach = math.sqrt(radius2(shift) * float(beam.weight.sum()) / beam.spread)
    low, high = shift - reach, shift + reach
    while radius2(low) < radius2(shift) or radius2(high) < radius2(shift):
        reach *= 2.0
        low, high = shift - reach, shift + reach
    left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_left, at_right = radius2(left), radius2(right)
    for _ in range(_SEARCH_STEPS):
        if at_left <= at_right:
            high, right, at_right = right, left, at_left
            left = high - _GOLDEN * (high - low)
            at_left = radius2(left)
        else:
            low, left, at_left = left, right, at_right
            right = low + _GOLDEN * (high - low)
            at_right = radius2(right)
    return 0.5 * (low + high)
