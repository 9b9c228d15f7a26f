"""Paraxial colour: sizes known from the glasses, sums as the first order of shifts."""

import itertools
import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.aberrations import seidel_sums

GAUSS = pl.load_lens("double-gauss-100mm-f2")
LENSES = (GAUSS, pl.load_lens("topogon-100mm-f6.3"))


def test_sums_of_colour_are_the_first_order_of_the_shifts():
    for lens, (z_object, field) in itertools.product(LENSES, ((-math.inf, 0.1), (-400.0, 40.0))):
        left = []
        for half in (4.0, 2.0):
            lines = (587.6 - half, 587.6, 587.6 + half)
            where = {"field": field, "z_object": z_object}
            found = pl.aberrations.chromatic_shift(lens, wavelengths=lines, **where)
            axial, lateral = pl.aberrations.colour_sums(lens, wavelengths=lines, **where).sum(axis=0)
            aperture = seidel_sums(lens, **where).aperture
            assert axial / aperture**2 == pytest.approx(found.axial, rel=1e-3), (lens.name, z_object)
            assert -lateral / aperture == pytest.approx(found.lateral, rel=1e-3), (lens.name, z_object)
            left.append([axial / aperture**2 - found.axial, -lateral / aperture - found.lateral])
        # Differences about a middle are wrong in the third order.
        assert np.divide(*left) == pytest.approx(8.0, rel=0.1), (lens.name, z_object)


def test_lateral_colour_vanishes_on_the_axis_and_at_a_thin_stop():
    found = pl.aberrations.chromatic_shift(GAUSS)
    assert not found.height.any() and found.reference == found.wavelengths[1]
    assert found.wavelengths == pytest.approx([486.1327, 587.5618, 656.2725], abs=1e-3)
    medium = pl.ModelGlass(1.5, 60.0)
    surfaces = [pl.Surface(50.0, 0.0, medium, semi_diameter=9.0), pl.Surface(-150.0, semi_diameter=9.0)]
    at_lens, before = (pl.LensStack([pl.CircularStop(2.0, gap), *surfaces]) for gap in (0.0, 10.0))
    assert pl.aberrations.chromatic_shift(at_lens, field=0.2).lateral == pytest.approx(0.0, abs=1e-13)
    # A chief ray that meets a collecting lens below the axis is bent up, blue more: its (negative) height is less.
    assert pl.aberrations.chromatic_shift(before, field=0.2).lateral < -1e-3


def test_a_shift_keeps_the_order_and_the_reference():
    lines = [656.0, 500.0, 587.6]
    shift = pl.aberrations.chromatic_shift(GAUSS, wavelengths=lines, reference=656.0, field=0.2)
    assert shift.wavelengths.tolist() == lines and shift.reference == 656.0
    for w, focus in zip(lines, shift.focus, strict=True):
        assert focus == pl.paraxial.image_position(GAUSS, -math.inf, w)
    ideal = -pl.paraxial.cardinal_points(GAUSS, 656.0).efl * math.tan(0.2)
    assert shift.height[0] == pytest.approx(ideal, rel=1e-13) and shift.axial == shift.focus[2] - shift.focus[0]
    assert shift.secondary_spectrum == pytest.approx(np.mean(shift.focus[[0, 2]]) - shift.focus[0], rel=1e-9)


def test_impossible_questions_of_colour_are_refused():
    shift = pl.aberrations.chromatic_shift
    front = pl.Surface(math.inf, 4.0, pl.ModelGlass(1.5, 60.0), semi_diameter=9.0)
    plate = pl.LensStack([pl.CircularStop(5.0, 1.0), front, pl.Surface(math.inf, semi_diameter=9.0)])
    for call, message in (
        (lambda: shift(GAUSS, reference=500.0), "one of the wavelengths"),
        (lambda: shift(GAUSS, wavelengths=[]), "wavelength is an empty sequence"),
        (lambda: shift(GAUSS, wavelengths=["blue"]), "wavelength is .blue.; it must be a number"),
        (lambda: shift(GAUSS, wavelengths=[100.0]), "100"),
        (lambda: pl.aberrations.colour_sums(GAUSS, field=0.1, wavelengths=(500.0,)), "must be three"),
        (lambda: shift(plate, field=0.1), "the emerging light is collimated"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            call()
