"""Reflectance and transmittance of a stack of thin films between two media."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats


class FilmPowers(NamedTuple):
    """Fractions of the power of a plane wave, one for each wave, for the polarisations s and p."""

    reflectance_s: Floats
    reflectance_p: Floats
    transmittance_s: Floats
    transmittance_p: Floats


def film_powers(
    outer: tuple[Floats, Floats], films: Sequence[NDArray[Any]], phases: Sequence[Floats], cosine: Floats
) -> FilmPowers:
    """Fractions of the power of plane waves that a stack of films reflects and transmits.

    Tangential fields are those of the characteristic matrices, from the last film to the first. Each matrix is taken
    times the phase factor of its film, so that nothing overflows in films that absorb, and has its limit where light
    grazes a film at its critical angle. Above the critical angle of the last medium all light is reflected.

    Parameters
    ----------
    outer : (n_from, n_to)
        Real refractive indices of the media in front and behind, of one shape.
    films : sequence of arrays
        Complex indices n + i k of the films in the order of travel, each of the shape of `cosine`.
    phases : sequence of arrays
        2 pi times thickness over wavelength of each film.
    cosine : array
        Cosine of the angle of incidence in the first medium, 0 to 1.

    References
    ----------
    H. A. Macleod, Thin-Film Optical Filters, 4th ed. (CRC Press, 2010), sections 2.2 and 2.7.
    """
    n_from, n_to = outer
    projection = np.square(n_from * cosine)
    normal = [_normal(index, n_from, projection) for index in (*films, n_to)]
    sines = [_sine(component, phase) for component, phase in zip(normal, phases, strict=False)]
    powers = []
    for is_p in (False, True):
        # Ratios of the tangential fields are n cos for s, n cos / n^2 for p.
        scale = [np.square(index) if is_p else np.ones_like(cosine) for index in (n_from, *films, n_to)]
        admittance = [q / each for q, each in zip((n_from * cosine, *normal), scale, strict=True)]
        matrices = [
            (1.0 + 1j * q * sine, -1j * sine * each, -1j * sine * q * ratio, np.exp(1j * phase * q))
            for q, sine, each, ratio, phase in zip(normal, sines, scale[1:], admittance[1:], phases, strict=False)
        ]
        powers.append(_powers(admittance[0], admittance[-1], matrices))
    (reflected_s, passed_s), (reflected_p, passed_p) = powers
    return FilmPowers(reflected_s, reflected_p, passed_s, passed_p)


def _normal(index: NDArray[Any], n_from: Floats, projection: Floats) -> NDArray[Any]:
    """Component of the wave vector along the normal, over that in vacuum; its imaginary part is never negative.

    `projection` is the square of that in the first medium; differences of squares would cancel near 90 degrees.
    """
    n, k = index.real, index.imag
    return np.asarray(np.sqrt((n - n_from) * (n + n_from) - k * k + projection + 2j * n * k))


def _sine(normal: NDArray[Any], phase: Floats) -> NDArray[Any]:
    """sin(phase q) exp(i phase q) / q of a film, whose limit is its phase where the component q along the normal is 0.

    With x + i y = phase q it is sin(x) exp(i x - 2 y) / q + i exp(-y) sinh(y) / q, whose terms do not cancel.
    """
    x, y = (phase * normal).real, (phase * normal).imag
    sine = np.sin(x) * np.exp(1j * x - 2.0 * y) - 0.5j * np.expm1(-2.0 * y)
    return np.asarray(np.where(normal == 0.0, phase, sine / np.where(normal == 0.0, 1.0, normal)))


def _powers(first: Floats, last: NDArray[Any], matrices: Sequence[tuple[NDArray[Any], ...]]) -> tuple[Floats, Floats]:
    """Reflectance and transmittance of one polarisation, by the admittances of the outer media.

    `matrices` are cos, the sine over and times the admittance, and the phase factor of each film.
    """
    tangential, other, passed = np.ones_like(last), last, np.ones_like(last)
    for cos, over, times, factor in reversed(matrices):
        tangential, other = cos * tangential + over * other, cos * other + times * tangential
        size = np.abs(tangential) + np.abs(other)
        tangential, other, passed = tangential / size, other / size, passed * factor / size
    total = first * tangential + other
    # Grazing light between media of one index: without an interface, both are 0.
    is_passed = total == 0.0
    size = np.where(is_passed, 1.0, np.abs(total))
    reflectance = np.square(np.abs(first * tangential - other) / size)
    transmittance = 4.0 * (first / size) * (last.real / size) * np.square(np.abs(passed))
    return np.where(is_passed, 0.0, reflectance), np.where(is_passed, 1.0, transmittance)
