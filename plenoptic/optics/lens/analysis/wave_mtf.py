"""Contrast with diffraction: the autocorrelation of the light on the reference sphere."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.values import Floats, numbers, result, whole
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.analysis.wavefront import SphereRays, image_plane, rays_to_sphere
from plenoptic.optics.lens.pupil.beam import checked_point, checked_wavelengths, meridian
from plenoptic.optics.lens.pupil.iris_points import square_grid
from plenoptic.optics.lens.stack import LensStack

_COARSE, _DEGREE = 24, 8
"""Rays across the iris by which it is found where others must go, and the degree of the polynomials that say it."""
_BEYOND = 1.1
"""Of the iris's semi-diameter: where points need not be looked for."""


@result
class WaveMtf:
    """Modulation transfer function of one object point, diffraction and aberrations together. See `wave_mtf`.

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
    """Contrast of patterns in the image, with diffraction at the opening of the lens.

    Parameters
    ----------
    lens : LensStack
        As LensModel.EXACT.
    frequencies : (k,) array
        Cycles per mm on the image plane, not negative.
    field, z_object, z_image
        As for `spot_diagram`.
    wavelength : float or sequence of float, optional
        nm. Several add up where each has its image: with lateral and longitudinal colour.
    weights : (w,) array, optional
        Light of each wavelength; all alike if it is left out.
    grid : int, optional
        Points across the opening. An edge is found to a point: the error is about 1 / grid^1.5.

    Raises
    ------
    InvalidValueError
        As of `wavefront`; or a number is out of range.

    Notes
    -----
    The field of the point on the reference sphere, over the cosine to the chief ray's direction, is found on a grid
    that is even in direction cosines by aiming rays there. Its autocorrelation at a shift of wavelength times frequency
    is the transfer function, without loss in the tails of the point spread.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=6.0))
    >>> found = pl.aberrations.wave_mtf(lens, [0.0, 50.0, 500.0])
    >>> found.tangential.round(2).tolist()
    [1.0, 0.7, 0.0]
    """
    pair, z = checked_point(lens, field, z_object)
    waves = checked_wavelengths(wavelength)
    wanted = numbers(frequencies, "frequencies")
    if wanted.ndim != 1 or not (np.isfinite(wanted) & (wanted >= 0)).all():
        raise InvalidValueError("frequencies must be numbers that are finite and not negative, in cycles per mm")
    light = np.ones(len(waves)) if weights is None else numbers(weights, "weights")
    if light.shape != (len(waves),) or not (light >= 0).all() or not light.any():
        raise InvalidValueError(f"weights must be {len(waves)} numbers, not negative and not all 0")
    count = whole(grid, "grid", at_least=8, at_most=512)
    plane = image_plane(lens, z, z_image, waves[0])
    along = meridian(pair)
    axes = np.stack([along, [along[1], -along[0]]])
    total: NDArray[np.complex128] = np.zeros((2, len(wanted)), dtype=np.complex128)
    reference: Floats | None = None
    for wave, weight in zip(waves, light / light.sum(), strict=True):
        field_there, step, found = _even_field(lens, pair, z, plane, wave, count, axes)
        reference = found.image if reference is None else reference
        offset = axes @ (found.image - reference)[:2]
        shifts = wanted * 1e-6 * wave / found.refractive_index / step
        for k in (0, 1):
            moved = np.exp(-2j * math.pi * wanted * offset[k])
            total[k] += weight * moved * _autocorrelation(np.moveaxis(field_there, k, 0), shifts)
    return WaveMtf(wanted, np.abs(total[0]), np.abs(total[1]), np.array(pair), z, plane, waves)


def _even_field(
    lens: LensStack,
    field: tuple[float, float],
    z_object: float,
    z_image: float,
    wavelength: float,
    n: int,
    axes: Floats,
) -> tuple[NDArray[np.complex128], float, SphereRays]:
    """The field on a grid (n, n) of direction cosines along two axes, their step, and the coarse rays."""

    def traced(pupil: Floats) -> SphereRays:
        return rays_to_sphere(lens, field, z_object, z_image, wavelength, pupil)

    coarse = square_grid(_COARSE)
    found = traced(coarse)
    passes = np.isfinite(found.opd)
    if passes.sum() < 2 * _DEGREE**2:
        raise InvalidValueError(f"hardly a ray from the field {field} passes the lens; give a field that it images")
    there = (found.toward - found.middle)[passes, :2] @ axes.T
    # From the outermost coarse rays it may be a step to the edge.
    half = float(np.abs(there).max() + 2 / _COARSE * np.nanmax(np.abs(found.slopes[passes])))
    side = half * (2 * np.arange(n) + 1 - n) / n
    wanted = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
    fit = np.linalg.lstsq(_powers(there / half), coarse[passes], rcond=None)[0]
    pupil = _powers(wanted / half) @ fit
    for _ in range(2):
        near = np.hypot(pupil[:, 0], pupil[:, 1]) < _BEYOND
        rays = traced(pupil[near])
        missed = wanted[near] @ axes - (rays.toward - rays.middle)[:, :2]
        known = np.isfinite(rays.slopes).all(axis=(1, 2)) & np.isfinite(missed).all(axis=1)
        moves = np.zeros_like(missed)
        moves[known] = np.linalg.solve(rays.slopes[known], missed[known][:, :, None])[:, :, 0]
        pupil[near] += np.clip(moves, -0.1, 0.1)
    near = np.hypot(pupil[:, 0], pupil[:, 1]) < _BEYOND
    rays = traced(pupil[near])
    # Light of an area of the iris over the solid angle, and of that over the cosines' area.
    with np.errstate(invalid="ignore", divide="ignore"):
        size = np.sqrt(rays.light / rays.solid_angle) / np.abs(rays.toward[:, 2])
    values = size * np.exp(2j * math.pi * rays.opd)
    made = np.zeros(n * n, dtype=np.complex128)
    made[near] = np.where(np.isfinite(values), values, 0.0)
    return made.reshape(n, n), 2 * half / n, found


def _powers(points: Floats) -> Floats:
    """(n, terms): all products of powers of two coordinates up to the degree."""
    x, y = points.T
    return np.stack([x**i * y**j for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)], axis=1)


def _autocorrelation(field: NDArray[np.complex128], shifts: Floats) -> NDArray[np.complex128]:
    """Of a field (n, n) along its first axis, 1 at shift 0; between whole steps linear."""
    n = len(field)
    whole_steps = np.array([np.vdot(field[k:], field[: n - k]) for k in range(n)] + [0.0])
    places = np.minimum(shifts, n)
    real, imaginary = (np.interp(places, np.arange(n + 1), part) for part in (whole_steps.real, whole_steps.imag))
    return np.asarray((real + 1j * imaginary) / whole_steps[0].real)
