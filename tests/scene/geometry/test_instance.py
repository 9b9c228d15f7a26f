import numpy as np
import pytest
from scene_helpers import turned, volume

import plenoptic as pl
from plenoptic.scene.geometry.instance import Instances, instance_record


def test_impossible_places_are_named():
    good = np.eye(4)
    for matrices, said in (
        (np.zeros((0, 4, 4)), "at least one place"),
        ([good, np.diag([1, 1, np.nan, 1])], "matrix 1 .*finite"),
        ([good, good[[0, 1, 2, 2]]], "matrix 1 .*0, 0, 0, 1"),
        ([good, np.diag([1, 0, 1, 1])], "matrix 1 .*flattens"),
        ([np.diag([1e16, 1, 1, 1])], "within .*1e15 mm"),
        ([np.diag([1e308, 1e308, 1e-300, 1])], "within .*1e15 mm"),
        (good, r"matrices has shape \(4, 4\)"),
    ):
        with pytest.raises(pl.PlenopticError, match=said):
            Instances(pl.box(2), matrices)


def test_bounds_are_those_of_the_copies():
    rng = np.random.default_rng(2)
    far = pl.Mesh(np.vstack([pl.box(2).vertices, [[1e3, 0, 0]]]), pl.box(2).faces)  # the last vertex is in no triangle
    corner = pl.Mesh([[0, 0, 0], [5, 0, 0], [0, 5, 0], [0, 0, 5]], [[0, 1, 2], [0, 2, 3], [0, 3, 1]])
    for mesh in (pl.sphere(3, segments=(16, 8)), far, corner, pl.quad((1, 2, 3), (4, 0, 0), (0, 5, 0))):
        for reach in (100.0, 0.1):  # far apart, and all but at one place
            places = np.concatenate([turned(rng, 30, reach=reach), turned(rng, 30, reach=reach, mirrored=True)])
            some = Instances(mesh, places)
            boxes = np.array([copy.bounds for copy in some.meshes()])
            # Coordinates up to 100 with some ten roundings each.
            whole = [boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)]
            np.testing.assert_allclose(some.bounds, whole, rtol=0, atol=2e-13)


def test_mirrored_copies_keep_their_front_and_all_their_material():
    mesh = pl.sphere(3, segments=(16, 8))
    matrices = turned(np.random.default_rng(3), 5, mirrored=True)
    for copy, matrix in zip(Instances(mesh, matrices).meshes(), matrices, strict=True):
        # A volume scales with the determinant, whose sign is the mirror's.
        assert volume(copy) == pytest.approx(volume(mesh) * abs(np.linalg.det(matrix)), rel=1e-10)
        assert (((copy.vertices - matrix[:3, 3]) * copy.normals).sum(axis=1) > 0).all()
    lit = Instances(pl.box(2), turned(np.random.default_rng(5), 2)).with_material(pl.Emissive(2.0))
    assert {copy.material for copy in lit.meshes()} == {pl.Emissive(2.0)}


def test_moving_instances_moves_every_copy():
    rng = np.random.default_rng(4)
    some, matrix = Instances(pl.box((1, 2, 3)), turned(rng, 4)), turned(rng, 1, mirrored=True)[0]
    for moved, copy in zip(some.transformed(matrix).meshes(), some.meshes(), strict=True):
        twice = copy.transformed(matrix)
        assert moved.faces.tolist() == twice.faces.tolist()
        # Coordinates up to 300 after two maps of some ten roundings each.
        np.testing.assert_allclose(moved.vertices, twice.vertices, rtol=0, atol=1e-12)
    for moved, copy in zip(some.translated(1, -2, z=30).meshes(), some.meshes(), strict=True):
        np.testing.assert_allclose(moved.vertices, copy.vertices + np.array([1, -2, 30]), rtol=0, atol=1e-13)
    with pytest.raises(pl.errors.SceneError, match="flattens"):
        some.transformed(np.diag([1, 1, 0, 1]))


def test_a_record_names_the_triangles_of_each_place():
    rng = np.random.default_rng(6)
    box, ball = pl.box(2), pl.sphere(1, segments=(8, 4))
    many, mirrored, one = turned(rng, 2), turned(rng, 1, mirrored=True), turned(rng, 1)
    groups = [Instances(box, many), Instances(ball, mirrored), Instances(box, one)]
    record = instance_record(groups, [100, 112, 100])
    assert record.plain == 100
    assert record.first.tolist() == [100, 100, 112, 100]
    assert record.faces.tolist() == [12, 12, len(ball.faces), 12]
    rows = record.matrices.reshape(-1, 3, 4)
    for k, matrix in enumerate(matrix for group in groups for matrix in group.matrices):
        assert rows[k].tolist() == matrix[:3].tolist()
    assert all(not array.flags.writeable for array in record[:3])
    assert instance_record([], []) is None
