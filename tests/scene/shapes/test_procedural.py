import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scene_helpers import area, area_vectors, corners_of, volume

from plenoptic.errors import InvalidValueError
from plenoptic.scene.materials.emissive import Emissive
from plenoptic.scene.shapes.procedural import box, check_scene, checkerboard, quad, sphere, turned, white_plane

LENGTH = st.floats(1e-3, 1e3)


def middles(mesh):
    return corners_of(mesh).mean(axis=1)


@settings(max_examples=30)
@given(LENGTH, LENGTH, LENGTH)
def test_quads_and_boxes_have_their_sizes_and_fronts(x, y, z):
    mesh = box((x, y, z))
    # Sums of twelve products.
    assert volume(mesh) == pytest.approx(x * y * z, rel=1e-13)
    assert area(mesh) == pytest.approx(2 * (x * y + y * z + z * x), rel=1e-13)
    assert ((middles(mesh) * area_vectors(mesh)).sum(axis=1) > 0).all()
    assert sorted(np.unique(mesh.uv)) == [0, 1]
    mesh = quad((1, 2, 3), (x, 0, 0), (0, y, 0))
    assert area(mesh) == pytest.approx(x * y, rel=1e-9)
    assert (area_vectors(mesh)[:, 2] > 0).all()
    np.testing.assert_array_equal(mesh.vertices[np.flatnonzero((mesh.uv == 0).all(axis=1))], [[1, 2, 3]])


@settings(max_examples=30)
@given(LENGTH, st.integers(3, 40), st.integers(2, 40))
def test_a_sphere_has_its_corners_and_normals_on_it(radius, around, along):
    mesh = sphere(radius, segments=(around, along))
    # Two roundings of cosine and sine each.
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), radius, rtol=1e-14)
    assert len(mesh.faces) == 2 * around * (along - 1)
    assert (np.linalg.norm(area_vectors(mesh), axis=1) > 0).all()
    assert ((middles(mesh) * area_vectors(mesh)).sum(axis=1) > 0).all()
    assert ((middles(mesh)[:, None] * mesh.normals[mesh.faces]).sum(axis=-1) > 0).all()
    assert mesh.uv.min() == 0 and mesh.uv.max() == 1


def test_a_sphere_has_radial_normals():
    mesh = sphere(2.5)
    assert len(mesh.faces) == 16128
    # Normals may come from differences of the outline, exact for evenly spaced points to rounding, except at the poles.
    ring = np.abs(mesh.vertices[:, 1]) < 2.5 * (1 - 1e-9)
    np.testing.assert_allclose(mesh.normals[ring], mesh.vertices[ring] / 2.5, atol=1e-12)
    np.testing.assert_allclose(mesh.normals[~ring], mesh.vertices[~ring] / 2.5, atol=0.03)
    # Facets come closer with the square of their number.
    lacks = [4 / 3 * np.pi - volume(sphere(1.0, segments=(2 * n, n))) for n in (32, 64)]
    assert lacks[0] / lacks[1] == pytest.approx(4, rel=0.01)
    # A turned outline fronts outside.
    for up in (0.0, 1.0):
        outline = np.array([[0.5, -1.0], [2.0, 0.0], [0.5, 1.0 + up]])
        mesh = turned(outline, segments=24)
        assert ((area_vectors(mesh) * middles(mesh) * [1, 0, 1]).sum(axis=1) > 0).all()
        np.testing.assert_allclose(mesh.bounds[:, 1], outline[[0, 2], 1])


@settings(max_examples=30)
@given(st.floats(2, 9), st.floats(2, 9), st.floats(0.5, 1.5), st.floats(-3, 3), st.floats(-3, 3))
def test_squares_are_where_floor_says(width, height, square, x, y):
    even, odd = checkerboard((width, height), square, offset=(x, y))
    assert area(even) + area(odd) == pytest.approx(width * height, rel=1e-12)
    for mesh, parity in ((even, 0), (odd, 1)):
        # Slivers at the border are thinner than rounding lets floor decide.
        whole = np.linalg.norm(area_vectors(mesh), axis=1) > 5e-10
        place = (middles(mesh)[whole, :2] - [x, y]) / square
        assert (np.floor(place).sum(axis=1) % 2 == parity).all()
        assert (area_vectors(mesh)[:, 2] > 0).all() and not mesh.vertices[:, 2].any()


def test_check_follows_its_formula_with_exact_edges():
    scene = check_scene()
    assert scene.tables().bsdf is None and scene.background is None
    total = 0.0
    for mesh in scene.meshes:
        x, y = middles(mesh)[:, 0], middles(mesh)[:, 1]
        bright = (np.floor(x + 0.05) + np.floor(0.1 - y)) % 2 == 1
        radiance = mesh.material.radiance if isinstance(mesh.material, Emissive) else 0.0
        assert (bright == (radiance == 1.0)).all()
        assert (area_vectors(mesh)[:, 2] > 0).all()
        total += area(mesh)
        for axis, offset in ((0, -0.05), (1, 0.1)):
            lines = np.unique(mesh.vertices[:, axis])
            inner = lines[np.abs(lines) < 200]
            # One rounding of offset + k, of size 200.
            np.testing.assert_allclose(inner, offset + np.round(inner - offset), rtol=0, atol=200 * np.finfo(float).eps)
    assert total == pytest.approx(160_000, rel=1e-12)
    np.testing.assert_array_equal(scene.bounds, [[-200, -200, -404], [200, 200, -404]])
    # White is a plane of radiance 1.
    (mesh,) = white_plane().meshes
    assert mesh.material == Emissive(1.0) and area(mesh) == 160_000
    assert mesh.bounds.tolist() == [[-200, -200, -404], [200, 200, -404]]
    assert (area_vectors(mesh)[:, 2] > 0).all()


def test_impossible_bodies_are_refused():
    for make, sentence in (
        (lambda: box((1, 2, -3)), None),
        (lambda: sphere(-1), None),
        (lambda: sphere(1, segments=(2, 8)), None),
        (lambda: sphere(1, segments=(8, 1)), None),
        (lambda: turned([[1, 0]]), None),
        (lambda: turned([[-1, 0], [1, 1]]), None),
        (lambda: checkerboard((4, 4), 0), None),
        (lambda: checkerboard((0, 4), 1), None),
        (lambda: checkerboard(4, 1), r"size is 4; it must be \(width, height\) in mm"),
        (lambda: checkerboard((4, 4), 1, offset=0.5), r"offset is 0.5; it must be \(x, y\) in mm"),
    ):
        with pytest.raises(InvalidValueError, match=sentence):
            make()
