"""Thin films against the package tmm (S. J. Byrnes), from 0 to 89 degrees, with films that absorb."""

import numpy as np
import pytest

import plenoptic as pl

pytestmark = pytest.mark.validation
tmm = pytest.importorskip("tmm", reason="the extra `validation` installs it")

FILMS = {
    "bare": [],
    "quarter wave": [(1.38, 99.6)],
    "broadband": [(1.38, 92.0), (2.35, 117.0), (1.62, 61.0), (2.35, 20.0)],
    "metal": [(1.38, 92.0), (3.18 + 3.33j, 12.0), (2.35, 50.0)],
    "silver": [(0.05 + 3.6j, 40.0)],
    "weak absorber": [(1.9 + 0.01j, 800.0), (1.45, 300.0)],
}


@pytest.mark.parametrize("films", FILMS.values(), ids=FILMS)
@pytest.mark.parametrize(("n_from", "n_to"), [(1.0, 1.7), (1.7, 1.0), (1.33, 1.5)])
def test_powers_are_those_of_tmm(films, n_from, n_to):
    layers = [(pl.optics.FilmMaterial(np.real(n), np.imag(n)), d) for n, d in films]
    coating = pl.optics.Coating(layers)
    angles = np.radians(np.linspace(0.0, 89.0, 90))
    if n_from > n_to:  # behind the critical angle, tmm warns of the evanescent wave
        angles = angles[np.sin(angles) < 0.999 * n_to / n_from]
    ordered = films if n_from <= n_to else films[::-1]
    indices, thicknesses = [n_from, *(n for n, _ in ordered), n_to], [np.inf, *(d for _, d in ordered), np.inf]
    for nm in (420.0, 550.0, 690.0):
        powers = pl.optics.surface_powers(coating, n_from, n_to, np.cos(angles), nm)
        for polarisation in "sp":
            theirs = [tmm.coh_tmm(polarisation, indices, thicknesses, angle, nm) for angle in angles]
            for name, key in (("reflectance", "R"), ("transmittance", "T")):
                ours = getattr(powers, f"{name}_{polarisation}")
                np.testing.assert_allclose(ours, [each[key] for each in theirs], atol=1e-10, rtol=0)
