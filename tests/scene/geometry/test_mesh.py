import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scene_helpers import volume

import plenoptic as pl

CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def tetrahedron(**more):
    return pl.Mesh(CORNERS, FACES, **more)


def test_impossible_meshes_are_refused():
    for vertices, faces, said in (
        (CORNERS, [], "no triangles"),
        (np.zeros((0, 3)), FACES, "vertex"),
        (CORNERS, [[0, 1, 4]], "vertex 4.*within 0 and 3"),
        (CORNERS, [[0, 1, -1]], "vertex -1"),
        (CORNERS * np.nan, FACES, "finite"),
        (CORNERS * 1e30, FACES, "unit"),
        (CORNERS, [[0, 0, 1], [2, 2, 2]], "all 2 triangles have zero area"),
        (CORNERS, [[0.5, 1, 2]], "whole numbers"),
        (CORNERS, [[0, 1, 2, 3]], "shape"),
    ):
        with pytest.raises(pl.PlenopticError, match=said):
            pl.Mesh(vertices, faces)
    # Some triangles may be without area.
    many = np.zeros((70_000, 3), dtype=int)
    many[-1] = [0, 1, 2]
    assert len(pl.Mesh(CORNERS, many).faces) == 70_000
    # A texture needs coordinates.
    textured = pl.Lambertian(pl.Texture(np.full((1, 1, 1), 0.5)))
    with pytest.raises(pl.errors.SceneError, match="uv is None"):
        tetrahedron().with_material(textured)
    assert tetrahedron(uv=CORNERS[:, :2]).with_material(textured).material == textured


@settings(max_examples=50)
@given(hnp.arrays(np.float64, (4, 3), elements=st.floats(-1e15, 1e15)))
def test_normals_come_to_unit_length_and_stay(given_normals):
    mesh = tetrahedron(normals=given_normals)
    length = np.linalg.norm(mesh.normals, axis=1)
    some = given_normals.any(axis=1)
    # Square root and division: 2 eps.
    np.testing.assert_allclose(length[some], 1, atol=1e-15)
    assert not mesh.normals[~some].any()
    assert np.array_equal(tetrahedron(normals=mesh.normals).normals, mesh.normals)


angles = st.floats(-7, 7)
axes = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda a: np.linalg.norm(a) > 1e-3)


@settings(max_examples=25)
@given(axes, angles)
def test_rotations_keep_lengths_and_turn_back(axis, angle):
    turned = tetrahedron(normals=CORNERS[::-1]).rotated(axis, angle)
    # Some ten products of numbers of size 1.
    np.testing.assert_allclose(np.linalg.norm(turned.vertices, axis=1), np.linalg.norm(CORNERS, axis=1), atol=1e-14)
    assert volume(turned) == pytest.approx(1 / 6, abs=1e-14)
    np.testing.assert_allclose(turned.rotated(axis, -angle).vertices, CORNERS, atol=1e-14)
    # Counter-clockwise.
    x_to_y = tetrahedron().rotated_deg((0, 0, 2), 90)
    np.testing.assert_allclose(x_to_y.vertices[1:3], [[0, 1, 0], [-1, 0, 0]], atol=1e-15)


@settings(max_examples=50)
@given(hnp.arrays(np.float64, (3, 3), elements=st.floats(-3, 3)).filter(lambda m: abs(np.linalg.det(m)) > 1e-2))
def test_fronts_stay_outside_and_normals_stay_across(linear):
    matrix = np.eye(4)
    matrix[:3, :3] = linear
    # The normal of the slanted face at all corners, for a law on that face.
    moved = tetrahedron(normals=np.ones((4, 3))).transformed(matrix)
    assert volume(moved) == pytest.approx(abs(np.linalg.det(linear)) / 6, rel=1e-9)
    a, b, c = moved.vertices[moved.faces[3]]
    # Both edges, up to 10 long, lie across the normal; the condition of `linear` is below 10^4.
    assert abs(moved.normals[0] @ (b - a)) < 1e-10 and abs(moved.normals[0] @ (c - a)) < 1e-10
    # ... and it points to where the front is.
    assert moved.normals[0] @ np.cross(b - a, c - a) > 0


def test_shifts_and_scales_are_exact():
    assert np.array_equal(tetrahedron().translated(1, 2, 3).vertices, CORNERS + np.array([1, 2, 3]))
    assert np.array_equal(tetrahedron().scaled(0.1).vertices, CORNERS * 0.1)
    assert np.array_equal(tetrahedron().transformed(np.eye(4)).vertices, CORNERS)
    mesh = tetrahedron(normals=CORNERS[::-1] + 1)
    for scale in (1e-100, 1e14):
        # Two normalisations of some eps each.
        moved = mesh.transformed(np.diag([scale, scale, scale, 1]))
        np.testing.assert_allclose(moved.normals, mesh.normals, atol=1e-15)
    # Bounds are those of the triangles.
    lonely = pl.Mesh(np.vstack([CORNERS, [[9, 9, 9]]]), FACES)
    assert lonely.bounds.tolist() == [[0, 0, 0], [1, 1, 1]]


def test_impossible_moves_are_refused():
    matrices = [np.eye(3), np.zeros((4, 4)), np.diag([1, 1, 0, 1]), np.eye(4) * np.nan, np.diag([1, 1, 1, 2])]
    moves = [("transformed", (matrix,)) for matrix in matrices] + [("translated", (0, 0, np.inf))]
    moves += [("rotated", values) for values in (((0, 0, 0), 1), ((0, 0, 1), np.nan), ((0, 1), 1))]
    moves += [("scaled", (scale,)) for scale in (0, -1, 1e-300)]
    for name, values in moves:
        with pytest.raises(pl.errors.InvalidValueError):
            getattr(tetrahedron(), name)(*values)
