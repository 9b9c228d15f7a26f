import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from plenoptic.errors import InvalidValueError
from plenoptic.optics.stops.circle import CircularStop
from plenoptic.optics.stops.polygon import PolygonStop

EPS = np.finfo(float).eps
POLYGONS = st.builds(
    PolygonStop, blades=st.integers(3, 40), semi_diameter=st.floats(1e-3, 1e3), rotation=st.floats(-7.0, 7.0)
)
STOPS = st.one_of(st.builds(CircularStop, st.floats(1e-3, 1e3)), POLYGONS)


def enclosed_area(points):
    x, y = points.T
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


@given(stop=STOPS)
def test_the_outline_is_the_border(stop):
    outline = stop.outline(50)
    # Points on the border are off by a few eps of the size and of the angle, at most 7 + 2 pi.
    assert stop.contains(*(outline * (1 - 64 * EPS)).T).all()
    assert not stop.contains(*(outline * (1 + 64 * EPS)).T).any()


@given(stop=POLYGONS)
def test_a_polygon_has_the_area_of_its_triangles(stop):
    area = 0.5 * stop.blades * stop.semi_diameter**2 * math.sin(2 * math.pi / stop.blades)
    # Sums of `blades` terms, and angles of up to 14 that are good to an eps of 14.
    assert enclosed_area(stop.outline(3)) == pytest.approx(area, rel=2000 * EPS)
    assert len(stop.outline(3)) == stop.blades
    assert stop.area == pytest.approx(area, rel=16 * EPS)


@given(stop=POLYGONS)
def test_edges_lie_an_apothem_away_along_their_unit_normals(stop):
    assert np.linalg.norm(stop.normals, axis=1) == pytest.approx(1.0, rel=4 * EPS)
    corners = stop.outline(3)
    for corner in (corners, np.roll(corners, -1, axis=0)):
        distance = np.sum(corner * stop.normals, axis=1)
        assert distance == pytest.approx(np.full(stop.blades, stop.apothem), abs=64 * EPS * stop.semi_diameter)


def test_many_blades_are_a_circle():
    # cos(pi / n) = 1 - pi^2 / (2 n^2).
    assert PolygonStop(1000, 5.0).apothem == pytest.approx(5.0, rel=math.pi**2 / 2e6 * 1.001)
    assert enclosed_area(CircularStop(5.0).outline(10000)) == pytest.approx(25 * math.pi, rel=1e-6)
    # sin(x) / x = 1 - x^2 / 6 with x = 2 pi / 1000.
    assert PolygonStop(1000, 5.0).area == pytest.approx(
        CircularStop(5.0).area, rel=(2 * math.pi / 1000) ** 2 / 6 * 1.001
    )


def test_the_first_corner_is_at_the_rotation():
    assert PolygonStop(5, 2.0, rotation=0.3).outline(5)[0] == pytest.approx([2 * math.cos(0.3), 2 * math.sin(0.3)])
    hexagon = PolygonStop(6, 1.0)
    assert hexagon.contains(1.0, 0.0)
    assert not hexagon.contains(0.0, 0.9)


def test_shapes_broadcast():
    for stop in (CircularStop(1.0), PolygonStop(6, 1.0)):
        assert stop.contains(np.zeros((4, 1)), np.zeros(3)).shape == (4, 3)
        assert stop.contains(0.0, 0.0).shape == ()
        assert not stop.contains(math.nan, 0.0)


@given(stop=STOPS)
def test_stops_are_values(stop):
    assert pickle.loads(pickle.dumps(stop)) == stop
    assert hash(pickle.loads(pickle.dumps(stop))) == hash(stop)
    assert eval(repr(stop)) == stop


def test_impossible_stops_are_refused():
    for make, text in (
        (lambda: CircularStop(0.0), "semi_diameter is"),
        (lambda: PolygonStop(6, math.nan), "semi_diameter is"),
        (lambda: PolygonStop(2, 5.0), "blades is"),
        (lambda: PolygonStop(6.0, 5.0), "blades is"),
        (lambda: CircularStop(5.0, -1.0), "thickness is"),
        (lambda: PolygonStop(6, 5.0, thickness=math.inf), "thickness is"),
        (lambda: CircularStop(5.0).outline(2), "n is 2"),
    ):
        with pytest.raises(InvalidValueError, match=text):
            make()
