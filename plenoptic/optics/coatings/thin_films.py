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

    Amplitudes are those of the characteristic matrices. They are computed from the last interface to the first, so that
    no factor exceeds 1 in a film that absorbs. Above the critical angle all light is reflected.

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
    H. A. Macleod, Thin-Film Optical Filters, 4th ed. (CRC Press, 2010), sections 2.2 and 2.7. P. Yeh, Optical Waves in
    Layered Media (Wiley, 1988), section 4.1, for the recursion.
    """
    n_from, n_to = outer
    sine2 = n_from * n_from * (1.0 - cosine) * (1.0 + cosine)
    squares = [np.square(index.astype(np.complex128)) for index in (*films, n_to)]
    # Component of the wave vector along the normal, over that in vacuum; its imaginary part is never negative.
    normal = [n_from * cosine, *(np.sqrt(square - sine2) for square in squares)]
    powers = []
    for is_p in (False, True):
        admittance = list(normal)
        if is_p:
            admittance = [q / square for q, square in zip(normal, (n_from * n_from, *squares), strict=True)]
        powers.append(_powers(admittance, normal[1:-1], phases))
    (reflected_s, passed_s), (reflected_p, passed_p) = powers
    return FilmPowers(reflected_s, reflected_p, passed_s, passed_p)


def _powers(
    admittance: Sequence[NDArray[Any]], normal: Sequence[NDArray[Any]], phases: Sequence[Floats]
) -> tuple[Floats, Floats]:
    """Reflectance and transmittance of one polarisation; the transmitted amplitude is that over the first admittance.

    `admittance` is the ratio of the tangential fields in each medium: n cos for s, cos / n for p.
    """
    first, last = admittance[0], admittance[-1]
    with np.errstate(invalid="ignore", divide="ignore"):
        reflection, transmission = _interface(admittance[-2], last)
        for j in range(len(phases) - 1, -1, -1):
            front, entering = _interface(admittance[j], admittance[j + 1])
            phase = np.exp(1j * phases[j] * normal[j])
            resonance = 1.0 + front * reflection * phase * phase
            reflection = (front + reflection * phase * phase) / resonance
            transmission = entering * (admittance[j + 1] * transmission) * phase / resonance
        reflectance = np.square(np.abs(reflection))
        transmittance = first * last.real * np.square(np.abs(transmission))
    # Admittances of grazing light between media of one index are 0 / 0: there is no interface.
    no_interface = np.isnan(reflectance)
    return np.where(no_interface, 0.0, reflectance), np.where(no_interface, 1.0, transmittance)


def _interface(before: NDArray[Any], behind: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Amplitude that an interface reflects, and the transmitted one over the admittance in front."""
    total = before + behind
    return (before - behind) / total, 2.0 / total
