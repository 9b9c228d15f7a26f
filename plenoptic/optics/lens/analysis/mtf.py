"""Geometric point-spread function and modulation transfer function.

Both neglect diffraction. Where the geometric MTF comes near `diffraction_mtf` or exceeds it, the true MTF is lower than
either; `wave_mtf` computes it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.display import picture_of
from plenoptic.core.values import (
    MAX_POINTS,
    Floats,
    checked_shape,
    frozen_array,
    length_in_mm,
    number,
    numbers,
    positive,
    result,
    wavelength_in_nm,
)
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.analysis.best_focus import imaged_point, working_f_number
from plenoptic.optics.lens.analysis.spot_diagram import SpotDiagram, jackknife_error, leave_one_out_sums, spots_of
from plenoptic.optics.lens.pupil.beam import REPLICATES, ImagedPoint, meridian
from plenoptic.optics.lens.stack import LensStack

_SPREAD = 1.25
"""Default half width of a picture over the geometric radius of the spot."""
_SMALLEST_PICTURE = 1e-6
"""Smallest default half width in mm, for a perfect image of radius 0."""


@result
class PointSpread:
    """Geometric point-spread function as a picture. Made by `point_spread`.

    Attributes
    ----------
    image : (rows, columns) array
        Fraction of the transmitted light on each pixel; row 0 is at the largest y, column 0 at the smallest x. The sum
        of `image` and `outside` is 1.
    standard_error : (rows, columns) array
        Standard error of `image`.
    outside : float
        Fraction of the light outside the picture.
    pixel_size : float
        mm.
    centre : (2,) array
        x and y of the centre of the picture on the image plane, mm.
    field, z_object, z_image, wavelengths
        As in `SpotDiagram`.
    """

    image: Floats
    standard_error: Floats
    outside: float
    pixel_size: float
    centre: Floats
    field: Floats
    z_object: float
    z_image: float
    wavelengths: tuple[float, ...]

    _repr_html_ = picture_of


def point_spread(  # noqa: PLR0913
    lens: LensStack,
    *,
    field: Sequence[float] = (0.0, 0.0),
    z_object: float = -math.inf,
    z_image: float | None = None,
    wavelength: float | Sequence[float] = 587.6,
    shape: tuple[int, int] = (64, 64),
    pixel_size: float | None = None,
    centre: Sequence[float] | None = None,
    rays: int = 1 << 17,
    seed: int = 0,
) -> PointSpread:
    """Geometric point-spread function: light of a spot diagram on each pixel. Diffraction is not included.

    Parameters
    ----------
    lens, field, z_object, z_image, wavelength, rays, seed
        See `spot_diagram`.
    shape : (int, int), optional
        Rows and columns.
    pixel_size : float, optional
        mm. By default the picture is 2.5 times the geometric radius wide, so that no light falls outside.
    centre : (2,) sequence of float, optional
        Centre of the picture on the image plane, mm; by default the centroid of the light.

    Raises
    ------
    InvalidValueError
        If no light passes, or a number is out of range.

    Examples
    --------
    >>> import plenoptic as pl
    >>> spread = pl.aberrations.point_spread(pl.load_lens("singlet-100mm-f4"), field=(0, 0.05), pixel_size=0.01)
    >>> spread.image.shape, 0 < spread.outside < 1, round(float(spread.image.sum()) + spread.outside, 12)
    ((64, 64), True, 1.0)
    """
    rows, columns = checked_shape(shape, ("rows", "columns"), at_most=4 * MAX_POINTS // REPLICATES)
    point = imaged_point(lens, field, z_object, z_image, wavelength)
    spot = _lit_spots(lens, point, rays, seed)
    if pixel_size is None:
        size = max(2.0 * _SPREAD * spot.geometric_radius, _SMALLEST_PICTURE) / min(rows, columns)
    else:
        size = length_in_mm(pixel_size, "pixel_size")
    middle = spot.centroid if centre is None else frozen_array(centre, name="centre", shape=(2,))
    counted = _count(spot, middle, size, rows, columns)
    image = counted.sum(axis=0)
    return PointSpread(
        image=image,
        # Each replicate is an estimate of image / REPLICATES.
        standard_error=np.std(counted, axis=0, ddof=1) * math.sqrt(REPLICATES),
        outside=max(1.0 - float(image.sum()), 0.0),
        pixel_size=size,
        centre=np.array(middle),
        **point.result_fields,
    )


def _lit_spots(lens: LensStack, point: ImagedPoint, rays: int, seed: int) -> SpotDiagram:
    """Spot diagram of an object point; an error if no light passes the lens."""
    spot = spots_of(lens, point, rays, seed)
    if not len(spot.x):
        raise InvalidValueError(
            f"no ray from the field {point.field} passes the lens; give a smaller field, or more rays"
        )
    return spot


def _count(spot: SpotDiagram, centre: Floats, size: float, rows: int, columns: int) -> Floats:
    """Light on each pixel from each replicate, (REPLICATES, rows, columns)."""
    column = np.floor((spot.x - centre[0]) / size + 0.5 * columns)
    row = np.floor((centre[1] - spot.y) / size + 0.5 * rows)
    inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    pixel = (spot.replicate[inside].astype(np.float64) * rows + row[inside]) * columns + column[inside]
    n = REPLICATES * rows * columns
    light = np.bincount(pixel.astype(np.intp), weights=spot.weight[inside], minlength=n)
    return np.asarray(light.reshape(REPLICATES, rows, columns))


@result
class Mtf:
    """Geometric modulation transfer function of one object point. Made by `mtf`.

    Attributes
    ----------
    frequencies : (k,) array
        Cycles per mm on the image plane.
    tangential, sagittal : (k,) array
        Modulus of the transfer function for patterns that vary along the field (y on the axis), and across it.
    tangential_error, sagittal_error : (k,) array
        Standard errors of `tangential` and `sagittal`. A modulus not above its error is biased upwards.
    diffraction : (k,) array
        For comparison: the diffraction limit on the axis, at the first wavelength and the paraxial working f-number.
        `tangential` and `sagittal` do not include it.
    field, z_object, z_image, wavelengths
        As in `SpotDiagram`.
    """

    frequencies: Floats
    tangential: Floats
    sagittal: Floats
    tangential_error: Floats
    sagittal_error: Floats
    diffraction: Floats
    field: Floats
    z_object: float
    z_image: float
    wavelengths: tuple[float, ...]

    _repr_html_ = picture_of


def mtf(
    lens: LensStack,
    frequencies: ArrayLike,
    *,
    field: Sequence[float] = (0.0, 0.0),
    z_object: float = -math.inf,
    z_image: float | None = None,
    wavelength: float | Sequence[float] = 587.6,
    rays: int = 1 << 14,
    seed: int = 0,
) -> Mtf:
    """Geometric MTF: modulus of the Fourier transform of a spot diagram. Diffraction is not included.

    Parameters
    ----------
    lens, field, z_object, z_image, wavelength, rays, seed
        See `spot_diagram`.
    frequencies : (k,) array
        Cycles per mm on the image plane, at least 0.

    Raises
    ------
    InvalidValueError
        If no light passes, or a number is out of range.

    Notes
    -----
    ``|sum_i w_i exp(-2 pi i nu s_i)|`` with the light w_i of the rays and their positions s_i along one direction.

    References
    ----------
    W. J. Smith, Modern Optical Engineering, 4th ed., chapter on image evaluation; G. D. Boreman, Modulation Transfer
    Function in Optical and Electro-Optical Systems, SPIE 2001, chapter 1.

    Examples
    --------
    >>> import plenoptic as pl
    >>> contrast = pl.aberrations.mtf(pl.load_lens("double-gauss-100mm-f2"), [0, 10, 20], field=(0, 0.1))
    >>> contrast.tangential.round(2).tolist()
    [1.0, 0.6, 0.5]
    """
    checked = checked_frequencies(frequencies)
    point = imaged_point(lens, field, z_object, z_image, wavelength)
    spot, reference = _lit_spots(lens, point, rays, seed), point.wavelengths[0]
    (x, y), (x0, y0) = meridian(point.field), spot.centroid
    dx, dy = spot.x - x0, spot.y - y0
    tangential, tangential_error = _modulus(spot, x * dx + y * dy, checked)
    sagittal, sagittal_error = _modulus(spot, y * dx - x * dy, checked)
    f_number, diffraction = working_f_number(lens, point.z_object, reference), np.full(len(checked), np.nan)
    if math.isfinite(f_number):
        diffraction = diffraction_mtf(checked, f_number=f_number, wavelength=reference)
    errors = tangential_error, sagittal_error
    return Mtf(checked, tangential, sagittal, *errors, diffraction, **point.result_fields)


def checked_frequencies(frequencies: ArrayLike) -> Floats:
    """Check that frequencies (k,) are finite and not negative."""
    checked = frozen_array(np.atleast_1d(numbers(frequencies, "frequencies")), name="frequencies", shape=("k",))  # type: ignore[arg-type]
    if not (np.isfinite(checked) & (checked >= 0)).all():
        raise InvalidValueError("frequencies holds a number that is below 0 or not finite; give cycles per mm")
    return checked


def _modulus(spot: SpotDiagram, position: Floats, frequencies: Floats) -> tuple[Floats, Floats]:
    """Modulus (k,) for patterns along one direction, and its standard error."""
    modulus, error = np.empty(len(frequencies)), np.empty(len(frequencies))
    for i, frequency in enumerate(frequencies):
        phase = (2.0 * math.pi * frequency) * position
        real, imaginary = spot.weight * np.cos(phase), spot.weight * np.sin(phase)
        modulus[i] = math.hypot(real.sum(), imaginary.sum()) / spot.weight.sum()
        re, im, light = leave_one_out_sums([real, imaginary, spot.weight], spot.replicate)
        with np.errstate(divide="ignore", invalid="ignore"):
            error[i] = jackknife_error(np.hypot(re, im) / light)
    return np.minimum(modulus, 1.0), error


def diffraction_mtf(frequencies: ArrayLike, *, f_number: float, wavelength: float = 587.6) -> Floats:
    """Diffraction-limited MTF of an aberration-free lens with a round, uniformly filled pupil.

    Parameters
    ----------
    frequencies : (k,) array
        Cycles per mm on the image plane.
    f_number : float
        Working f-number: 1 over twice the sine of the marginal angle in the image.
    wavelength : float, optional
        nm.

    Returns
    -------
    ndarray
        (k,): (2 / pi) (arccos s - s sqrt(1 - s^2)) with s = frequency x wavelength x f_number, and 0 from s = 1 on.

    References
    ----------
    J. W. Goodman, Introduction to Fourier Optics, 3rd ed., section 6.3.2, equation 6-32.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.aberrations.diffraction_mtf([0.0, 250.0, 500.0], f_number=4.0, wavelength=500.0).round(4).tolist()
    [1.0, 0.391, 0.0]
    """
    stop = positive(number(f_number, "f_number"), "f_number")
    s = np.abs(checked_frequencies(frequencies)) * (stop * wavelength_in_nm(wavelength) * 1e-6)
    s = np.minimum(s, 1.0)
    return np.asarray((2.0 / math.pi) * (np.arccos(s) - s * np.sqrt(1.0 - s * s)))
