"""Water types against the model that their scattering was made with, and against each other."""

import numpy as np
import pytest

import plenoptic as pl

TYPES = ("I", "IA", "IB", "II", "III", "1C", "3C", "5C", "7C", "9C")
WAVELENGTHS = np.array([600.0, 530.0, 450.0])


def test_scattering_is_that_of_water_and_two_kinds_of_particles():
    # V. I. Haltrin's model (Appl. Opt. 38, 6826, 1999), with which the tables were made: 1/m, two concentrations.
    ratio = 400.0 / WAVELENGTHS
    particles = np.stack([1.513 * ratio**1.7, 0.341074 * ratio**0.3], axis=1)
    for water_type in TYPES:
        scattering = 1e3 * np.array(pl.materials.jerlov_water(water_type).scattering)
        rest = scattering - 0.005826 * ratio**4.322
        fit, *_ = np.linalg.lstsq(particles / scattering[:, None], rest / scattering, rcond=None)
        # Two concentrations leave one of three numbers to test: three digits, and the line from 525 to 550 nm.
        assert np.abs((particles @ fit - rest) / scattering).max() < 5e-3, water_type


def test_types_are_ordered_by_their_particles_and_contain_pure_water():
    media = [pl.materials.jerlov_water(water_type) for water_type in TYPES]
    absorption, scattering = (
        1e3 * np.array([getattr(m, name) for m in media]) for name in ("absorption", "scattering")
    )
    assert (absorption > 1e3 * np.array(pl.materials.pure_water().absorption)).all()
    # Within the ocean and along the coast, each is more turbid than the one before; I and II differ by particles only.
    for first, end in ((0, 5), (5, 10)):
        assert (np.diff(scattering[first:end], axis=0) > 0).all()
        assert (np.diff(absorption[first:end], axis=0) >= -3e-4).all()
    cosines = np.array([m.phase.g for m in media])
    assert (np.diff(cosines[:5]) > 0).all() and cosines[0] < 0.1 and 0.91 < cosines[4] < 0.924
    # In the clearest water blue goes farthest, off turbid coasts green.
    assert absorption[0].argmin() == 2 and absorption[-1].argmin() == 0 and absorption[5].argmin() == 1


def test_other_types_are_refused():
    for wrong in ("1", "IV", 1, None):
        with pytest.raises(pl.errors.InvalidValueError, match="one of I, IA, IB, II, III, 1C"):
            pl.materials.jerlov_water(wrong)
