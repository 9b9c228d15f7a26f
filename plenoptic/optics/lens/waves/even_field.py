"""Field of an object point on the reference sphere, on a grid uniform in direction cosines."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.values import Floats, numbers
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.pupil.beam import ImagedPoint
from plenoptic.optics.lens.pupil.iris_points import square_grid
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.lens.waves.sphere_rays import rays_to_sphere

_COARSE, _DEGREE = 24, 8
"""Rays across the iris for the fit of iris points against direction cosines, and the degree of its polynomials."""
_BEYOND = 1.1
"""Radius in units of the iris's semi-diameter outside of which no points are aimed at."""


class EvenField(NamedTuple):
    """Field on the reference sphere, in directions from the image point that are uniform in two direction cosines."""

    values: NDArray[np.complex128]
    """(n, n): amplitude over the cosine to the z axis, so sums over directions are diffraction integrals; 0 outside."""
    opd: Floats
    """(n, n): optical path difference in waves; nan if the ray is vignetted."""
    toward: Floats
    """(n, n, 3): unit vectors from the image point along the traced rays."""
    side: Floats
    """(n,): direction cosines along either axis, relative to the chief ray's."""
    image: Floats
    radius: float
    wave: float
    """Wavelength in the image space medium, mm."""

    @property
    def step(self) -> float:
        """Step of the direction cosines."""
        return float(self.side[1] - self.side[0])


def even_field(lens: LensStack, point: ImagedPoint, wavelength: float, n: int, axes: Floats) -> EvenField:
    """Field of an object point on a grid (n, n) of direction cosines along axes (2, 2), by ray aiming."""
    coarse = square_grid(_COARSE)
    coarse_rays = rays_to_sphere(lens, point, wavelength, coarse)
    passes = np.isfinite(coarse_rays.opd)
    if passes.sum() < 2 * _DEGREE**2:
        raise InvalidValueError(f"too few rays from the field {point.field} pass the lens; give a smaller field")
    directions = (coarse_rays.toward - coarse_rays.middle)[passes, :2] @ axes.T
    # The edge may lie one step outside the outermost coarse rays.
    half = float(np.abs(directions).max() + 2 / _COARSE * np.nanmax(np.abs(coarse_rays.slopes[passes])))
    side = half * (2 * np.arange(n) + 1 - n) / n
    nodes = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
    fit = np.linalg.lstsq(_powers(directions / half), coarse[passes], rcond=None)[0]
    pupil = _powers(nodes / half) @ fit
    for _ in range(2):
        near = np.hypot(pupil[:, 0], pupil[:, 1]) < _BEYOND
        rays = rays_to_sphere(lens, point, wavelength, pupil[near])
        missed = nodes[near] @ axes - (rays.toward - rays.middle)[:, :2]
        solvable = np.isfinite(rays.slopes).all(axis=(1, 2)) & np.isfinite(missed).all(axis=1)
        moves = np.zeros_like(missed)
        moves[solvable] = np.linalg.solve(rays.slopes[solvable], missed[solvable][:, :, None])[:, :, 0]
        pupil[near] += np.clip(moves, -0.1, 0.1)
    near = np.hypot(pupil[:, 0], pupil[:, 1]) < _BEYOND
    rays = rays_to_sphere(lens, point, wavelength, pupil[near])
    # Light per area of the iris over solid angle, times solid angle over area of direction cosines.
    with np.errstate(invalid="ignore", divide="ignore"):
        size = np.sqrt(rays.light / rays.solid_angle) / np.abs(rays.toward[:, 2])
    values = size * np.exp(2j * np.pi * rays.opd)
    amplitude, opd, toward = np.zeros(n * n, np.complex128), np.full(n * n, np.nan), np.full((n * n, 3), np.nan)
    amplitude[near] = np.where(np.isfinite(values), values, 0.0)
    opd[near], toward[near] = np.where(np.isfinite(values), rays.opd, np.nan), rays.toward
    wave = 1e-6 * wavelength / rays.refractive_index
    return EvenField(
        amplitude.reshape(n, n), opd.reshape(n, n), toward.reshape(n, n, 3), side, rays.image, rays.radius, wave
    )


def _powers(points: Floats) -> Floats:
    """(n, terms): all monomials of two coordinates up to the degree."""
    x, y = points.T
    return np.stack([x**i * y**j for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)], axis=1)


def checked_shares(weights: ArrayLike | None, wavelengths: tuple[float, ...]) -> Floats:
    """Check and normalise the weights of wavelengths; None means equal weights."""
    radiance = np.ones(len(wavelengths)) if weights is None else numbers(weights, "weights")
    if radiance.shape != (len(wavelengths),) or not (radiance >= 0).all() or not radiance.any():
        raise InvalidValueError(f"weights must be {len(wavelengths)} numbers, not negative and not all 0")
    return np.asarray(radiance / radiance.sum())
