"""Pictures of a point with diffraction: by Fourier transform, and by direct summation."""

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
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.lens.waves.even_field import EvenField, checked_shares, even_field
from plenoptic.optics.lens.waves.wavefront import aberrated_point, farther, huygens_sum

MOST_PIXELS, MOST_GRID = 1 << 20, 512
FAR_ENOUGH = 5e-3
"""Radians: phase that a Fourier transform may leave out in the picture's corners, 1 % of the perfect peak at most."""


class SpreadMethod(enum.IntEnum):
    """Method for the field of a point in its image.

    FOURIER: the picture is small against its distance from the exit pupil, so that it is the Fourier transform of the
    field there, as two products of matrices (R. Soummer et al., Opt. Express 15, 15935, 2007). HUYGENS: spherical waves
    from all points of the reference sphere add up, with their true distances.

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
    """Point-spread function with diffraction and aberrations as a picture. See `wave_spread`, which makes it.

    Attributes
    ----------
    image : (rows, columns) array
        Part of the light that falls on each pixel, by the field in its middle; row 0 is at the largest y, column 0 at
        the smallest x.
    outside : float
        Part of the light that misses the picture.
    perfect : float
        Value of the pixel in the image point without aberrations.
    method : SpreadMethod
    pixel_size : float
        mm.
    centre : (3,) array
        Where the chief ray of the first wavelength meets the image plane, mm in the lens frame: the picture's middle.
    tilt : (float, float)
        By which the picture is turned there about x and y, radians.
    field, z_object, z_image, wavelengths
        As in `SpotDiagram`.
    """

    image: Floats
    outside: float
    perfect: float
    method: SpreadMethod
    pixel_size: float
    centre: Floats
    tilt: tuple[float, float]
    field: Floats
    z_object: float
    z_image: float
    wavelengths: tuple[float, ...]

    @property
    def strehl(self) -> float:
        """The brightest pixel over `perfect`."""
        return float(self.image.max() / self.perfect)

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
    """Find the picture of an object point, with diffraction at the opening of the lens.

    Parameters
    ----------
    lens : LensStack
        As LensModel.EXACT.
    field, z_object, z_image
        As for `spot_diagram`.
    tilt : (float, float), optional
        Of the image plane about x and y, radians, where the chief ray meets it.
    wavelength : float or sequence of float, optional
        nm. Several add up where each has its image: with lateral and longitudinal colour.
    weights : (w,) array, optional
        Light of each wavelength; all alike if it is left out.
    shape : (int, int), optional
        Rows and columns; odd numbers put a pixel's middle on the image point.
    pixel_size : float, optional
        mm; if it is left out, half the finest period of a fringe, so that the picture has all there is.
    grid : int, optional
        Points across the opening, at most 512.
    method : SpreadMethod, optional
        None: FOURIER for a plane across the axis where the phase that it leaves out is below 5e-3 radians everywhere,
        which changes the result by 1 % of `perfect` at most; otherwise HUYGENS, which takes seconds.

    Raises
    ------
    InvalidValueError
        As of `wavefront`; where neighbouring points of the grid differ by half a wave or more as seen from a corner of
        the picture, so that ghosts would be found there; FOURIER for a tilted plane; or a number out of range.

    Notes
    -----
    The known field is that of `wave_mtf`. Light on the picture is ``|U|^2 dx dy``, and all of it by Parseval's
    theorem wavelength^2 times the sum of squares over direction cosines in the plane.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=6.0))
    >>> pl.aberrations.wave_spread(lens)
    <WaveSpread: 65 x 65 pixels of 1.711 um by FOURIER, Strehl 0.808, 1.1 % outside>
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
    places = _places(rows, columns, size) @ turn.T + fields[0].image
    corners = places[[0, 0, -1, -1], [0, -1, 0, -1]]
    for one_field in fields:
        _check_sampling(one_field, corners - one_field.image)
    if chosen is None:
        near = not any(turned) and all(
            _left_out(one_field, corners - one_field.image) <= FAR_ENOUGH for one_field in fields
        )
        chosen = SpreadMethod.FOURIER if near else SpreadMethod.HUYGENS
    elif chosen is SpreadMethod.FOURIER and any(turned):
        raise InvalidValueError("a Fourier transform is that on a plane across the axis; leave tilt or method out")
    image, perfect = np.zeros((rows, columns)), 0.0
    for one_field, weight_of_field in zip(fields, shares, strict=True):
        scale = weight_of_field * size**2 / _whole_light(one_field, turn[:, 2])
        light = _fourier if chosen is SpreadMethod.FOURIER else _huygens
        image += scale * np.abs(light(one_field, places - one_field.image)) ** 2
        perfect += scale * float(np.abs(one_field.values).sum()) ** 2
    return WaveSpread(
        image=image,
        outside=max(1.0 - float(image.sum()), 0.0),
        perfect=perfect,
        method=chosen,
        pixel_size=size,
        centre=np.array(fields[0].image),
        tilt=(turned[0], turned[1]),
        **point.result_fields,
    )


def _places(rows: int, columns: int, size: float) -> Floats:
    """(rows, columns, 3): middles of pixels, mm from that of the picture."""
    x, y = size * (np.arange(columns) - 0.5 * (columns - 1)), -size * (np.arange(rows) - 0.5 * (rows - 1))
    return np.stack([*np.meshgrid(x, y), np.zeros((rows, columns))], axis=-1)


def _width(found: EvenField) -> float:
    """Width of the opening, in direction cosines."""
    lit = np.isfinite(found.opd)
    return found.step * max(int(np.ptp(np.flatnonzero(lit.any(axis=k)))) + 1 for k in (0, 1))


def _whole_light(found: EvenField, normal: Floats) -> float:
    """All light on a plane, as the sum over pixels has it, over the square of the grid's step."""
    lit = np.isfinite(found.opd)
    toward = found.toward[lit]
    cosines = np.abs(toward[:, 2] / (toward @ normal))
    return float(np.abs(found.values[lit]) ** 2 @ cosines) * (found.wave / found.step) ** 2


def _check_sampling(found: EvenField, corners: Floats) -> None:
    """Refuse grids on which light seen from a corner (4, 3) of the picture turns by half a wave from point to point."""
    largest = 0.0
    for corner in corners:
        phase = found.opd - farther(found.toward, found.radius, corner) / found.wave
        largest = max(largest, *(float(np.nanmax(np.abs(np.diff(phase, axis=k)))) for k in (0, 1)))
    if largest >= 0.5:
        n, first = len(found.side), "give a smaller picture"
        needed = math.floor(2.0 * largest * n) + 1
        raise InvalidValueError(
            f"seen from the picture's corner, neighbouring points of the grid differ by {largest:.2g} waves, and the "
            "limit is a half; " + (f"{first}, or grid={needed}" if needed <= MOST_GRID else first)
        )


def _left_out(found: EvenField, corners: Floats) -> float:
    """Radians: by how much at most the phase is not that of a Fourier transform, seen from corners (4, 3)."""
    n, lit = len(found.side), np.isfinite(found.opd)
    axes = [np.broadcast_to(side, (n, n))[lit] for side in (found.side[:, None], found.side)]
    off = [
        farther(found.toward[lit], found.radius, corner) + axes[0] * corner[0] + axes[1] * corner[1]
        for corner in corners
    ]
    return max(math.pi * float(np.ptp(one)) / found.wave for one in off)


def _fourier(found: EvenField, places: Floats) -> NDArray[np.complex128]:
    """The field at places (rows, columns, 3) of a plane across the axis, but for a phase."""
    turn = 2j * math.pi / found.wave
    across = np.exp(turn * np.outer(found.side, places[0, :, 0]))
    along = np.exp(turn * np.outer(places[:, 0, 1], found.side))
    return np.asarray(along @ found.values.T @ across)


def _huygens(found: EvenField, places: Floats) -> NDArray[np.complex128]:
    """The field at any places (rows, columns, 3)."""
    lit = np.isfinite(found.opd)
    light, toward = found.values[lit], found.toward[lit]
    sums = [huygens_sum(light, toward, found.radius, found.wave, place) for place in places.reshape(-1, 3)]
    return np.array(sums).reshape(places.shape[:2])
