"""MTF with diffraction: autocorrelation of the field on the reference sphere."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.display import picture_of
from plenoptic.core.values import Floats, result, whole
from plenoptic.optics.lens.analysis.mtf import checked_frequencies
from plenoptic.optics.lens.pupil.beam import meridian
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.lens.waves.even_field import checked_shares, even_field
from plenoptic.optics.lens.waves.wavefront import aberrated_point


@result
class WaveMtf:
    """Modulation transfer function of one object point, with diffraction and aberrations. Made by `wave_mtf`.

    Attributes
    ----------
    frequencies : (k,) array
        Cycles per mm on the image plane.
    tangential, sagittal : (k,) array
        Modulus of the transfer function for patterns that vary along the field (y on the axis), and across it.
    field, z_object, z_image, wavelengths
        As in `SpotDiagram`.
    """

    frequencies: Floats
    tangential: Floats
    sagittal: Floats
    field: Floats
    z_object: float
    z_image: float
    wavelengths: tuple[float, ...]

    _repr_html_ = picture_of


def wave_mtf(  # noqa: PLR0913
    lens: LensStack,
    frequencies: ArrayLike,
    *,
    field: Sequence[float] = (0.0, 0.0),
    z_object: float = -math.inf,
    z_image: float | None = None,
    wavelength: float | Sequence[float] = 587.6,
    weights: ArrayLike | None = None,
    grid: int = 96,
) -> WaveMtf:
    """Modulation transfer function with diffraction at the exit pupil and aberrations.

    Parameters
    ----------
    lens : LensStack
        Must have LensModel.EXACT.
    frequencies : (k,) array
        Cycles per mm on the image plane, not negative.
    field, z_object, z_image
        As for `spot_diagram`.
    wavelength : float or sequence of float, optional
        nm. Images of several wavelengths add up, with lateral and axial colour.
    weights : (w,) array, optional
        Weight of each wavelength; equal by default.
    grid : int, optional
        Points across the pupil. Edges are resolved to one point: the error is about 1 / grid^1.5.

    Raises
    ------
    InvalidValueError
        As for `wavefront`, or if a number is out of range.

    Notes
    -----
    Rays are aimed at a grid uniform in direction cosines. They give the field on the reference sphere, over
    the cosine to the chief ray's direction. Its autocorrelation at a shift of wavelength times frequency is the
    transfer function, without truncation of the tails of the point-spread function.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=6.0))
    >>> contrast = pl.aberrations.wave_mtf(lens, [0.0, 50.0, 500.0])
    >>> contrast.tangential.round(2).tolist()
    [1.0, 0.7, 0.0]
    """
    point = aberrated_point(lens, field, z_object, z_image, wavelength)
    checked, shares = checked_frequencies(frequencies), checked_shares(weights, point.wavelengths)
    count = whole(grid, "grid", at_least=8, at_most=512)
    along = meridian(point.field)
    axes = np.stack([along, [along[1], -along[0]]])
    total: NDArray[np.complex128] = np.zeros((2, len(checked)), dtype=np.complex128)
    reference: Floats | None = None
    for wave, weight in zip(point.wavelengths, shares, strict=True):
        field_of_point = even_field(lens, point, wave, count, axes)
        reference = field_of_point.image if reference is None else reference
        offset = axes @ (field_of_point.image - reference)[:2]
        shifts = checked * field_of_point.wave / field_of_point.step
        for k in (0, 1):
            moved = np.exp(-2j * math.pi * checked * offset[k])
            total[k] += weight * moved * _autocorrelation(np.moveaxis(field_of_point.values, k, 0), shifts)
    return WaveMtf(checked, np.abs(total[0]), np.abs(total[1]), **point.result_fields)


def _autocorrelation(field: NDArray[np.complex128], shifts: Floats) -> NDArray[np.complex128]:
    """Autocorrelation of a field (n, n) along its first axis, 1 at shift 0; linear between whole steps."""
    n = len(field)
    whole_steps = np.array([np.vdot(field[k:], field[: n - k]) for k in range(n)] + [0.0])
    places = np.minimum(shifts, n)
    real, imaginary = (np.interp(places, np.arange(n + 1), part) for part in (whole_steps.real, whole_steps.imag))
    return np.asarray((real + 1j * imaginary) / whole_steps[0].real)
