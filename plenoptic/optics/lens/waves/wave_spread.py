"""Point-spread functions with diffraction: by Fourier transform, or by direct Huygens summation."""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.display import picture_of
from plenoptic.core.values import Floats, checked_shape, choice, coefficients, length_in_mm, result, whole
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.placement import rotation_about_axes
from plenoptic.optics.lens.pupil.beam import ImagedPoint
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.lens.waves.even_field import EvenField, checked_shares, even_field
from plenoptic.optics.lens.waves.pupil_rule import pupil_rule, strehl_ratios
from plenoptic.optics.lens.waves.wavefront import aberrated_point, excess_path, huygens_sum

MOST_PIXELS, MOST_GRID = 1 << 20, 512
FAR_ENOUGH = 5e-3
"""Largest phase error of a Fourier transform in the picture's corners, in radians: 1 % of the perfect peak at most."""


class SpreadMethod(enum.IntEnum):
    """Method for the field of an object point in its image.

    FOURIER: the field is the Fourier transform of that in the pupil, for a picture small against its distance from it.
    Two matrix products compute it (R. Soummer et al., Opt. Express 15, 15935, 2007). HUYGENS: sum of spherical waves
    from all points of the reference sphere, with exact distances.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.aberrations.SpreadMethod(0).name
    'FOURIER'
    """

    FOURIER = 0
    HUYGENS = 1


@result
class WaveSpread:
    """Point-spread function with diffraction and aberrations as a picture. Made by `wave_spread`.

    Attributes
    ----------
    image : (rows, columns) array
        Fraction of the light on each pixel, by the field at its centre; row 0 is at the largest y, column 0 at the
        smallest x.
    outside : float
        Fraction of the light outside the picture.
    perfect : float
        Value of the pixel at the image point without aberrations.
    strehl, strehl_error : float
        Strehl ratio: intensity at `centre` over that without aberrations, as `Wavefront.strehl` of each wavelength, and
        its error. The brightest pixel, which may lie elsewhere, is image.max() / perfect.
    method : SpreadMethod
    pixel_size : float
        mm.
    centre : (3,) array
        Centre of the picture: intersection of the first wavelength's chief ray with the image plane, mm, lens frame.
    tilt : (float, float)
        Tilt of the picture about x and y, radians.
    field, z_object, z_image, wavelengths
        As in `SpotDiagram`.
    """

    image: Floats
    outside: float
    perfect: float
    strehl: float
    strehl_error: float
    method: SpreadMethod
    pixel_size: float
    centre: Floats
    tilt: tuple[float, float]
    field: Floats
    z_object: float
    z_image: float
    wavelengths: tuple[float, ...]

    def __repr__(self) -> str:
        rows, columns = self.image.shape
        return (
            f"<WaveSpread: {rows} x {columns} pixels of {1e3 * self.pixel_size:.4g} um by {self.method.name}, Strehl "
            f"{self.strehl:.3g}, {100 * self.outside:.2g} % outside>"
        )

    _repr_html_ = picture_of


def wave_spread(  # noqa: PLR0913
    lens: LensStack,
    *,
    field: Sequence[float] = (0.0, 0.0),
    z_object: float = -math.inf,
    z_image: float | None = None,
    tilt: Sequence[float] = (0.0, 0.0),
    wavelength: float | Sequence[float] = 587.6,
    weights: ArrayLike | None = None,
    shape: tuple[int, int] = (65, 65),
    pixel_size: float | None = None,
    grid: int = 128,
    method: SpreadMethod | None = None,
) -> WaveSpread:
    """Point-spread function of an object point, with diffraction at the exit pupil and aberrations.

    Parameters
    ----------
    lens : LensStack
        Must have LensModel.EXACT.
    field, z_object, z_image
        As for `spot_diagram`.
    tilt : (float, float), optional
        Tilt of the image plane about x and y, radians, with the pivot at the chief ray.
    wavelength : float or sequence of float, optional
        nm. Images of several wavelengths add up, with lateral and axial colour.
    weights : (w,) array, optional
        Weight of each wavelength; equal by default.
    shape : (int, int), optional
        Rows and columns; odd numbers put the centre of a pixel on the image point.
    pixel_size : float, optional
        mm; by default half the finest period of a fringe, the Nyquist limit of the intensity.
    grid : int, optional
        Points across the pupil, at most 512.
    method : SpreadMethod, optional
        None: FOURIER for an untilted plane if its phase error is below 5e-3 radians everywhere, which changes the
        result by at most 1 % of `perfect`. Otherwise HUYGENS, which takes seconds.

    Raises
    ------
    InvalidValueError
        As for `wavefront`. Also for aliasing, if the paths from neighbouring grid points to a corner of the picture
        differ by half a wave or more. Also for FOURIER with a tilted plane, or a number out of range.

    Notes
    -----
    The field on the reference sphere is that of `wave_mtf`. The light on a pixel is ``|U|^2 dx dy``. By
    Parseval's theorem, the total light is wavelength^2 times the sum of squares over direction cosines in the plane.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=6.0))
    >>> pl.aberrations.wave_spread(lens)
    <WaveSpread: 65 x 65 pixels of 1.711 um by FOURIER, Strehl 0.807, 1.1 % outside>
    """
    point = aberrated_point(lens, field, z_object, z_image, wavelength)
    shares = checked_shares(weights, point.wavelengths)
    rows, columns = checked_shape(shape, ("rows", "columns"), at_most=MOST_PIXELS)
    count = whole(grid, "grid", at_least=8, at_most=MOST_GRID)
    turned = coefficients(tilt, "tilt", "two angles in radians, about x and y")
    if len(turned) != 2:
        raise InvalidValueError(f"tilt is {tilt!r}; it must be two angles in radians, about x and y")
    chosen = None if method is None else choice(method, SpreadMethod, "method")
    turn = rotation_about_axes((*turned, 0.0))
    fields = [even_field(lens, point, wave, count, np.eye(2)) for wave in point.wavelengths]
    if pixel_size is None:
        size = min(one_field.wave / (2.0 * _width(one_field)) for one_field in fields)
    else:
        size = length_in_mm(pixel_size, "pixel_size")
    x, y = size * (np.arange(columns) - 0.5 * (columns - 1)), -size * (np.arange(rows) - 0.5 * (rows - 1))
    places = np.stack([*np.meshgrid(x, y), np.zeros((rows, columns))], axis=-1) @ turn.T + fields[0].image
    corners = places[[0, 0, -1, -1], [0, -1, 0, -1]]
    for one_field in fields:
        _check_sampling(one_field, corners - one_field.image)
    if chosen is None:
        near = not any(turned) and all(
            _fourier_phase_error(one_field, corners - one_field.image) <= FAR_ENOUGH for one_field in fields
        )
        chosen = SpreadMethod.FOURIER if near else SpreadMethod.HUYGENS
    elif chosen is SpreadMethod.FOURIER and any(turned):
        raise InvalidValueError("FOURIER needs an untilted image plane; leave out tilt or method")
    image, perfect, ratios = np.zeros((rows, columns)), 0.0, np.zeros(2)
    for one_field, weight_of_field, wave in zip(fields, shares, point.wavelengths, strict=True):
        scale = weight_of_field * size**2 / _whole_light(one_field, turn[:, 2])
        light = _fourier if chosen is SpreadMethod.FOURIER else _huygens
        image += scale * np.abs(light(one_field, places - one_field.image)) ** 2
        largest = scale * float(np.abs(one_field.values).sum()) ** 2
        perfect += largest
        ratios += largest * _strehl_ratios(lens, point, one_field, wave, fields[0].image - one_field.image)
    return WaveSpread(
        image=image,
        outside=max(1.0 - float(image.sum()), 0.0),
        perfect=perfect,
        strehl=float(ratios[0] / perfect),
        strehl_error=float(np.ptp(ratios) / perfect),
        method=chosen,
        pixel_size=size,
        centre=np.array(fields[0].image),
        tilt=(turned[0], turned[1]),
        **point.result_fields,
    )


def _strehl_ratios(lens: LensStack, point: ImagedPoint, field: EvenField, wavelength: float, at: Floats) -> Floats:
    """Strehl ratios (2,) at a point (3,) from the image, by a rule and a coarser one; nan for the latter without them.

    Without rules, for light in several parts of the iris, the first is that of the grid.
    """
    rule = pupil_rule(lens, point, wavelength)
    if rule is None:
        lit = np.isfinite(field.opd)
        light = field.values[lit] / np.abs(field.values[lit]).sum()
        return np.array([abs(huygens_sum(light, field.toward[lit], field.radius, field.wave, at)) ** 2, math.nan])
    excess = excess_path(rule.rays.toward, rule.rays.radius, at) / field.wave
    return strehl_ratios(np.where(rule.amplitude.any(axis=1), rule.rays.opd - excess, 0.0), rule.amplitude)


def _width(found: EvenField) -> float:
    """Width of the pupil in direction cosines."""
    lit = np.isfinite(found.opd)
    return found.step * max(int(np.ptp(np.flatnonzero(lit.any(axis=k)))) + 1 for k in (0, 1))


def _whole_light(found: EvenField, normal: Floats) -> float:
    """Total light on a plane, in the unit of the sum over pixels, over the square of the grid's step."""
    lit = np.isfinite(found.opd)
    toward = found.toward[lit]
    cosines = np.abs(toward[:, 2] / (toward @ normal))
    return float(np.abs(found.values[lit]) ** 2 @ cosines) * (found.wave / found.step) ** 2


def _check_sampling(found: EvenField, corners: Floats) -> None:
    """Refuse grids with path differences above half a wave between neighbours, seen from the corners (4, 3)."""
    largest = 0.0
    for corner in corners:
        phase = found.opd - excess_path(found.toward, found.radius, corner) / found.wave
        largest = max(largest, *(float(np.nanmax(np.abs(np.diff(phase, axis=k)))) for k in (0, 1)))
    if largest >= 0.5:
        n, first = len(found.side), "give a smaller picture"
        needed = math.floor(2.0 * largest * n) + 1
        raise InvalidValueError(
            f"paths from neighbouring grid points to the picture's corner differ by {largest:.2g} waves; the "
            "limit is a half; " + (f"{first}, or grid={needed}" if needed <= MOST_GRID else first)
        )


def _fourier_phase_error(found: EvenField, corners: Floats) -> float:
    """Largest phase error of a Fourier transform at corners (4, 3), in radians."""
    n, lit = len(found.side), np.isfinite(found.opd)
    axes = [np.broadcast_to(side, (n, n))[lit] for side in (found.side[:, None], found.side)]
    phase_errors = [
        excess_path(found.toward[lit], found.radius, corner) + axes[0] * corner[0] + axes[1] * corner[1]
        for corner in corners
    ]
    return max(math.pi * float(np.ptp(one)) / found.wave for one in phase_errors)


def _fourier(found: EvenField, places: Floats) -> NDArray[np.complex128]:
    """Field at points (rows, columns, 3) of an untilted plane by a Fourier transform, up to a phase factor."""
    turn = 2j * math.pi / found.wave
    across = np.exp(turn * np.outer(found.side, places[0, :, 0]))
    along = np.exp(turn * np.outer(places[:, 0, 1], found.side))
    return np.asarray(along @ found.values.T @ across)


def _huygens(found: EvenField, places: Floats) -> NDArray[np.complex128]:
    """Field at any points (rows, columns, 3) by Huygens summation."""
    lit = np.isfinite(found.opd)
    light, toward = found.values[lit], found.toward[lit]
    sums = [huygens_sum(light, toward, found.radius, found.wave, place) for place in places.reshape(-1, 3)]
    return np.array(sums).reshape(places.shape[:2])
