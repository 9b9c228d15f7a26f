import pickle

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import plenoptic as pl

POINT = st.tuples(*[st.floats(-1e3, 1e3)] * 3)


@settings(max_examples=50, deadline=None)
@given(POINT, POINT, st.floats(0.1, 100), st.floats(0.1, 100))
def test_a_light_that_faces_a_point_does(center, target, width, height):
    towards = np.subtract(target, center)
    assume(np.linalg.norm(towards) > 1e-3)
    light = pl.QuadLight.facing(center, target, (width, height), radiance=2)
    # A direction of a few eps per product.
    np.testing.assert_allclose(light.normal, towards / np.linalg.norm(towards), atol=1e-12)
    assert light.area == pytest.approx(width * height, rel=1e-12)
    assert np.linalg.norm(light.edge_u) == pytest.approx(width, rel=1e-12)
    np.testing.assert_array_equal(light.center, center)


@pytest.mark.parametrize("target", [(0, 0, 5), (5, 0, 0), (3, 4, 5)])
def test_the_width_is_horizontal(target):
    assert pl.QuadLight.facing((0, 0, 0), target, (4, 2)).edge_u[1] == 0


@pytest.mark.parametrize("down", [-1, 1])
def test_straight_up_and_down_work(down):
    light = pl.QuadLight.facing((0, 0, 0), (0, down, 0), (4, 2))
    np.testing.assert_allclose(light.normal, [0, down, 0])


def test_the_mesh_winds_counter_clockwise_from_the_emitting_side():
    light = pl.QuadLight((1, 2, 3), (4, 0, 1), (0, 2, 0), radiance=(1, 2, 3), two_sided=True)
    mesh = light.mesh()
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    assert (cross @ light.normal > 0).all()
    assert 0.5 * np.linalg.norm(cross, axis=1).sum() == pytest.approx(light.area)
    np.testing.assert_allclose(mesh.vertices.mean(axis=0), light.center)
    assert mesh.material == pl.Emissive((1, 2, 3), two_sided=True)


def test_lights_compare_and_pickle():
    light = pl.QuadLight((0, 0, 0), (1, 0, 0), (0, 1, 0))
    assert pickle.loads(pickle.dumps(light)) == light
    assert light != pl.QuadLight((0, 0, 0), (1, 0, 0), (0, 2, 0))


@pytest.mark.parametrize(
    ("arguments", "kind", "said"),
    [
        (((0, 0, 0), (1, 0, 0), (2, 0, 0)), pl.SceneError, "parallel"),
        (((0, 0, 0), (0, 0, 0), (2, 0, 0)), pl.SceneError, "no area"),
        (((0, 0, np.nan), (1, 0, 0), (0, 1, 0)), pl.SceneError, "finite"),
        (((0, 0, 0), (1e300, 0, 0), (0, 1e300, 0)), pl.SceneError, "within"),
        (((0, 0), (1, 0, 0), (0, 1, 0)), pl.InvalidValueError, "shape"),
        (((0, 0, 0), (1, 0, 0), (0, 1, 0), -1), pl.SceneError, "0 or more"),
    ],
)
def test_impossible_lights_are_refused(arguments, kind, said):
    with pytest.raises(kind, match=said):
        pl.QuadLight(*arguments)


@pytest.mark.parametrize(
    ("target", "size", "said"),
    [((0, 0, 0), (1, 1), "above 0"), ((0, 0, 1), (0, 1), "width"), ((0, 0, 1), 3.0, "size"), ((0, 0), (1, 1), "shape")],
)
def test_a_light_cannot_face_its_own_middle_or_be_without_size(target, size, said):
    with pytest.raises(pl.InvalidValueError, match=said):
        pl.QuadLight.facing((0, 0, 0), target, size)


@pytest.mark.parametrize("two_sided", ["no", 1, None, [True]])
def test_two_sided_is_yes_or_no(two_sided):
    with pytest.raises(pl.InvalidValueError, match="two_sided is .*; it must be True or False"):
        pl.QuadLight((0, 0, 0), (1, 0, 0), (0, 1, 0), two_sided=two_sided)
    with pytest.raises(pl.InvalidValueError, match="two_sided is .*; it must be True or False"):
        pl.QuadLight.facing((0, 0, 0), (0, 0, 1), (4, 2), two_sided=two_sided)
    assert pl.QuadLight((0, 0, 0), (1, 0, 0), (0, 1, 0), two_sided=np.bool_(True)).two_sided is True
