import math
import sys

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from plenoptic.errors import InvalidValueError, PrescriptionError
from plenoptic.optics.glass.media import ConstantMedium
from plenoptic.optics.surfaces.surface import Surface

EPS = np.finfo(float).eps
RADII = st.one_of(st.floats(1e-3, 1e9), st.floats(-1e9, -1e-3))


@given(radius=RADII, fraction=st.floats(0.0, 1.0))
def test_sag_lies_on_the_sphere(radius, fraction):
    r = fraction * abs(radius)
    z = float(Surface(radius, semi_diameter=abs(radius)).sag(r))
    # r^2 + (z - R)^2 = R^2, divided by R^2; a handful of roundings of terms not above 1.
    u, v = r / radius, z / radius
    assert u * u + v * (v - 2) == pytest.approx(0.0, abs=16 * EPS)
    assert z * radius >= 0


@given(radius=RADII, fraction=st.floats(0.0, 1e-3))
def test_sag_is_a_parabola_near_the_vertex(radius, fraction):
    r = fraction * abs(radius)
    # The next term of the series is (r / R)^2 / 4 of the first.
    assert float(Surface(radius, semi_diameter=abs(radius)).sag(r)) == pytest.approx(
        r * r / (2 * radius), rel=0.26e-6, abs=1e-300
    )


def test_impossible_surfaces_are_refused():
    for radius in (0.0, -0.0, math.nan, 5e-324, None, 10**400):
        with pytest.raises(PrescriptionError, match=r"radius is .*math\.inf"):
            Surface(radius, semi_diameter=1.0)
    for semi_diameter in (0.0, math.nan, math.inf, 10.0001):
        with pytest.raises(InvalidValueError, match="semi_diameter"):
            Surface(-10.0, semi_diameter=semi_diameter)
    with pytest.raises(InvalidValueError, match="thickness is"):
        Surface(10.0, -1e-9, semi_diameter=1.0)
    # Texts and lists have an index() too, and a class has one without an instance.
    for medium in (1.5, "BK7", [1.5], ConstantMedium):
        with pytest.raises(PrescriptionError, match=r"medium is .*ConstantMedium"):
            Surface(50, 5, medium, semi_diameter=10)
    with pytest.raises(PrescriptionError, match="r reaches 11 mm"):
        Surface(10.0, semi_diameter=5.0).sag([1.0, 11.0])


def test_sag_is_as_exact_at_the_ends_of_the_numbers():
    # Four times the radius would overflow; powers of two change no bit.
    small, large = Surface(1.3, semi_diameter=1.3), Surface(1.3 * 2.0**1023, semi_diameter=1.0)
    for fraction in (0.25, 0.75, 1.0):
        assert float(large.sag(1.3 * fraction * 2.0**1023)) == float(small.sag(1.3 * fraction)) * 2.0**1023
    plane = Surface(math.inf, semi_diameter=10.0)
    assert plane == Surface(-math.inf, semi_diameter=10.0) and plane.curvature == 0.0
    assert plane.sag([0.0, 5.0, 1e9]).tolist() == [0.0, 0.0, 0.0]


@example(radius=8.98846567431158e307, thickness=0.0, semi_diameter=8.98846567431158e307)
@example(radius=-sys.float_info.max, thickness=0.0, semi_diameter=sys.float_info.max)
@given(radius=st.floats(), thickness=st.floats(), semi_diameter=st.floats())
def test_what_is_accepted_is_usable(radius, thickness, semi_diameter):
    try:
        surface = Surface(radius, thickness, semi_diameter=semi_diameter)
    except InvalidValueError:
        return
    assert math.isfinite(surface.curvature)
    assert np.isfinite(surface.sag(surface.semi_diameter))
