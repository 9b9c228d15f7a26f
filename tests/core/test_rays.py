import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import plenoptic as pl
from plenoptic.core.rays import UNIT_TOLERANCE

EPS = np.finfo(float).eps


@settings(max_examples=100)
@given(direction=st.tuples(*[st.floats(-1e300, 1e300, allow_subnormal=False)] * 3).filter(lambda d: any(d)))
def test_directions_get_unit_length(direction):
    rays = pl.RayBundle([[0, 0, 0]], [direction])
    unit = rays.direction[0]
    # Three squares, a root and a division: below 4 roundings of a number near 1.
    assert np.linalg.norm(unit) == pytest.approx(1.0, abs=max(4 * EPS, UNIT_TOLERANCE))
    assert rays.status.tolist() == [pl.RayStatus.OK]
    # Parallel: each component keeps its share of the largest one.
    largest = max(map(abs, direction))
    scaled = np.array(direction) / largest
    assert unit / np.abs(unit).max() == pytest.approx(scaled, abs=4 * EPS)


@settings(max_examples=100)
@given(azimuth=st.floats(0, 6.3), cos=st.floats(-1, 1), off=st.floats(-7, 7))
def test_what_is_unit_to_a_few_eps_is_left_alone(azimuth, cos, off):
    sin = math.sqrt(1 - cos * cos)
    direction = np.array([[sin * math.cos(azimuth), sin * math.sin(azimuth), cos]]) * (1 + off * EPS)
    if abs(np.sqrt(np.einsum("ij,ij->i", direction, direction))[0] - 1) > UNIT_TOLERANCE:
        return
    assert pl.RayBundle([[0, 0, 0]], direction).direction.tobytes() == direction.tobytes()
    # Only rows that need it are normalised: 3 / 5 and 4 / 5 by way of 3 / 4 and a root, a rounding or two each.
    rays = pl.RayBundle(np.zeros((2, 3)), [direction[0], [0.0, 3.0, 4.0]])
    assert rays.direction[0].tobytes() == direction.tobytes()
    assert rays.direction[1] == pytest.approx([0, 0.6, 0.8], rel=4 * EPS)


def test_the_given_arrays_are_neither_kept_nor_changed():
    origin, direction = np.zeros((1, 3)), np.array([[0.0, 0.0, 2.0]])
    rays = pl.RayBundle(origin, direction)
    assert direction[0, 2] == 2.0
    origin[0, 0] = 9.0
    assert rays.origin[0, 0] == 0.0
    for array in (rays.origin, rays.direction, rays.weight, rays.status, rays.lost_at):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


def test_impossible_rows_are_lost_and_no_error():
    for origin, direction in (
        ([math.nan, 0, 0], [0, 0, 1]),
        ([0, math.inf, 0], [0, 0, 1]),
        ([0, 0, 0], [0, 0, 0]),
        ([0, 0, 0], [0, math.nan, 1]),
        ([0, 0, 0], [0, -math.inf, 1]),
    ):
        rays = pl.RayBundle([origin, [0, 0, 0]], [direction, [0, 0, 1]])
        assert rays.status.tolist() == [pl.RayStatus.NOT_FINITE, pl.RayStatus.OK], (origin, direction)
        assert rays.weight.tolist() == [0.0, 1.0], (origin, direction)
    # A lost ray keeps its cause.
    rays = pl.RayBundle([[math.nan, 0, 0], [0, 0, 0]], [[0, 0, 1]] * 2, weight=[3, 4], status=[2, 0], lost_at=[5, -1])
    assert rays.status.tolist() == [pl.RayStatus.CLIPPED, pl.RayStatus.OK]
    assert (rays.weight.tolist(), rays.lost_at.tolist()) == ([0, 4], [5, -1])


def test_what_is_no_bundle_is_refused():
    for changes, message in (
        ({"origin": [0, 0, 0]}, r"origin has shape \(3,\); it must have shape \(n, 3\)"),
        ({"direction": [[0, 1]]}, r"direction has shape \(1, 2\); it must have shape \(1, 3\)"),
        ({"origin": [["a", 0, 0]]}, "origin is not an array of numbers"),
        ({"weight": [1.0, 2.0]}, r"weight has shape \(2,\); it must have shape \(1"),
        ({"weight": [-math.inf]}, "weight holds a number that is not finite"),
        ({"status": [0, 0]}, r"status has shape \(2,\)"),
        ({"status": [77]}, "status 77 is not one of RayStatus"),
        ({"lost_at": [[0]]}, r"lost_at has shape \(1, 1\)"),
        ({"wavelength": 0.0}, "wavelength is 0 nm; it must be above 0"),
        ({"wavelength": math.nan}, "wavelength is nan; it must be finite"),
        ({"wavelength": 0.5876}, "wavelengths are in nanometres"),
        ({"wavelength": 1e7}, "wavelengths are in nanometres"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            pl.RayBundle(**({"origin": [[0, 0, 0]], "direction": [[0, 0, 1]]} | changes))


def test_points_on_rays():
    rays = pl.RayBundle([[1, 2, -10], [0, 0, 0]], [[0, 0.6, 0.8], [1, 0, 0]])
    assert rays.at(5.0).tolist() == [[1, 5, -6], [5, 0, 0]]
    assert rays.at([5.0, -1.0]).tolist() == [[1, 5, -6], [-1, 0, 0]]
    # Backwards too; exactly on the plane; a ray along the plane meets it nowhere.
    crossing = rays.at_z(-18.0)
    assert crossing[0] == pytest.approx([1, -4, -18], rel=4 * EPS) and crossing[:, 2].tolist() == [-18, -18]
    assert not np.isfinite(crossing[1]).all()


def test_selection_by_mask_and_index():
    rays = pl.RayBundle(np.arange(9.0).reshape(3, 3), [[0, 0, 1]] * 3, 500.0, status=[0, 2, 0], lost_at=[-1, 4, -1])
    arrived = rays.selected(rays.status == pl.RayStatus.OK)
    assert arrived.origin.tolist() == [[0, 1, 2], [6, 7, 8]] and arrived.wavelength == 500.0
    turned = rays.selected([2, 1])
    assert (turned.status.tolist(), turned.lost_at.tolist(), turned.weight.tolist()) == ([0, 2], [-1, 4], [1, 0])


def test_equality_pickling_and_repr():
    rays = pl.RayBundle([[0, 0, 1.0], [math.nan, 0, 0]], [[0, 0, 1], [0, 1, 0]])
    assert rays != pl.RayBundle(rays.origin, rays.direction, 500.0)
    assert repr(rays) == "RayBundle(2 rays, 1 OK, 587.6 nm)"
    out = pl.load_lens("singlet-100mm-f4").trace(pl.RayBundle([[0, 0, -50.0], [0, 90.0, -50.0]], [[0, 0, 1.0]] * 2))
    assert pickle.loads(pickle.dumps(out)) == out and hash(out) and not out.origin.flags.writeable
