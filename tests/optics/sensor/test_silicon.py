"""Reflectance of silicon below air and glass."""

import numpy as np
import pytest

import plenoptic as pl


def test_silicon_reflects_by_its_complex_index():
    """At a wavelength of the table: index 4.294 and extinction 0.0442 at 500 nm."""
    expected = ((4.294 - 1.0) ** 2 + 0.0442**2) / ((4.294 + 1.0) ** 2 + 0.0442**2)
    assert pl.sensor.silicon_reflectance(500.0) == pytest.approx(expected, rel=1e-12)


def test_a_cover_glass_adds_all_reflections_between_its_faces():
    glass = pl.ConstantMedium(1.5)
    front, rear = 0.04, abs((complex(4.294, 0.0442) - 1.5) / (complex(4.294, 0.0442) + 1.5)) ** 2
    total = front + sum((1 - front) ** 2 * rear * (front * rear) ** k for k in range(30))
    assert pl.sensor.silicon_reflectance(500.0, cover=glass) == pytest.approx(total, rel=1e-12)
    assert pl.sensor.silicon_reflectance(500.0, cover=pl.optics.AIR) == pl.sensor.silicon_reflectance(500.0)


def test_reflectance_falls_with_the_wavelength():
    wavelengths = np.arange(400.0, 1101.0, 25.0)
    assert (np.diff([pl.sensor.silicon_reflectance(w) for w in wavelengths]) < 0).all()


def test_bad_input_is_answered_by_a_sentence():
    with pytest.raises(pl.errors.InvalidValueError, match="wavelength 350 nm is outside 400 to 1100 nm, where silicon"):
        pl.sensor.silicon_reflectance(350.0)
    with pytest.raises(pl.errors.PrescriptionError, match="cover is 1.5"):
        pl.sensor.silicon_reflectance(500.0, cover=1.5)
