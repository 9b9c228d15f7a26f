import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import plenoptic as pl

CORNERS = np.array([[0.0, 0, 0], [2, 0, 0], [0, 2, 0], [2, 2, 0]])
FACES = np.array([[0, 1, 2], [1, 3, 2]])
UV = np.array([[0.0, 0], [1, 0], [0, 1], [1, 1]])
LAMP = pl.QuadLight((0, 0, 9), (3, 0, 0), (0, 4, 0), radiance=2.0)
GREY = pl.Lambertian()


def square(material=GREY, **more):
    return pl.Mesh(CORNERS, FACES, material, **more)


def test_what_is_absent_is_none():
    nothing = pl.Scene(background=0.0).tables()
    assert nothing.channels == 1 and nothing.background.tolist() == [0.0]
    assert all(entry is None for entry in nothing[1:-1])

    dark = pl.Scene([square()]).tables()
    assert dark.background is None and dark.emission is None and dark.two_sided is None
    assert dark.normals is None and dark.uv is None and dark.texels is None and dark.light_triangles is None

    mapped = pl.Scene([square(uv=UV, normals=np.tile([0, 0, 1], (4, 1)))]).tables()
    assert mapped.uv is None and mapped.material_texture is None and mapped.normals is not None

    shining = pl.Scene([square(pl.Emissive(1.0)), square(pl.Lambertian(0.0))]).tables()
    assert shining.albedo is None and shining.light_triangles is None
    assert shining.emission.tolist() == [[1.0], [0.0]]


def test_lights_need_something_that_emits_and_something_that_reflects():
    assert pl.Scene([square()], [LAMP]).tables().light_triangles.tolist() == [2, 3]
    assert pl.Scene([square(pl.Lambertian(0.0))], [LAMP]).tables().light_triangles is None
    assert pl.Scene([square(pl.Emissive(0.0)), square()]).tables().light_triangles is None


def test_indices_are_global_and_lights_come_last():
    first, second = square(), square(pl.Lambertian(0.1)).translated(z=5)
    tables = pl.Scene([first, second], [LAMP]).tables()
    assert tables.triangles.dtype == np.int32 and tables.triangles.shape == (6, 3)
    np.testing.assert_array_equal(tables.vertices[tables.triangles[2:4]], second.vertices[second.faces])
    np.testing.assert_array_equal(tables.vertices[tables.triangles[4:]], LAMP.mesh().vertices[LAMP.mesh().faces])
    assert tables.triangle_mesh.tolist() == [0, 0, 1, 1, 2, 2]
    assert tables.triangle_material.tolist() == [0, 0, 1, 1, 2, 2]


def test_equal_materials_are_one_row():
    texture = pl.Lambertian(pl.Texture(np.full((2, 3, 1), 0.5)))
    copy = pl.Lambertian(pl.Texture(np.full((2, 3, 1), 0.5)))
    meshes = [square(texture, uv=UV), square(pl.Lambertian(0.2)), square(copy, uv=UV), square(pl.Lambertian(0.2))]
    tables = pl.Scene(meshes).tables()
    assert tables.triangle_material.tolist() == [0, 0, 1, 1, 0, 0, 1, 1]
    assert tables.albedo.tolist() == [[1.0], [0.2]]
    assert tables.texture_shape.tolist() == [[0, 2, 3]] and len(tables.texels) == 6


def test_textures_lie_one_after_the_other_row_by_row():
    one = np.arange(6, dtype=np.float32).reshape(2, 3, 1) / 10
    two = np.arange(12, dtype=np.float32).reshape(2, 2, 3) / 20
    meshes = [square(pl.Lambertian(pl.Texture(t)), uv=UV) for t in (one, two)] + [square(pl.Lambertian(0.3))]
    tables = pl.Scene(meshes).tables()
    assert tables.channels == 3 and tables.material_texture.tolist() == [0, 1, -1]
    assert tables.texture_shape.tolist() == [[0, 2, 3], [6, 2, 2]]
    np.testing.assert_array_equal(tables.texels[:6], np.repeat(one.reshape(-1, 1), 3, axis=1))
    np.testing.assert_array_equal(tables.texels[6:], two.reshape(-1, 3))
    np.testing.assert_array_equal(tables.uv, np.concatenate([UV, UV, np.zeros((4, 2))]))


def test_a_mesh_without_normals_has_rows_of_zeros():
    up = np.tile([0.0, 0.0, 1.0], (4, 1))
    tables = pl.Scene([square(), square(normals=up)]).tables()
    np.testing.assert_array_equal(tables.normals, np.concatenate([np.zeros((4, 3)), up]))


@pytest.mark.parametrize(
    ("scene", "channels"),
    [
        (pl.Scene([square(pl.Lambertian((0.5, 0.5, 0.5)))], background=(1, 1, 1)), 1),
        (pl.Scene([square(pl.Lambertian(pl.Texture(np.full((2, 2, 3), 0.25))), uv=UV)]), 1),
        (pl.Scene([square()], background=(1, 1, 0.9)), 3),
        (pl.Scene([square(pl.Emissive((1, 2, 3)))]), 3),
        (pl.Scene([square()], [pl.QuadLight((0, 0, 9), (1, 0, 0), (0, 1, 0), (1, 0, 0))]), 3),
        (pl.Scene([square(pl.Lambertian(pl.Texture(np.array([[[0, 0, 0.1]]]))), uv=UV)]), 3),
    ],
)
def test_three_channels_only_where_something_is_coloured(scene, channels):
    tables = scene.tables()
    assert tables.channels == channels
    for table in (tables.albedo, tables.emission, tables.texels):
        assert table is None or table.shape[1] == channels
    assert tables.background is None or tables.background.shape == (channels,)


# Far from where a power that is computed by hand underflows.
radiance = st.just(0.0) | st.floats(1e-100, 1e3)
radiances = st.lists(
    st.tuples(radiance | st.tuples(*[radiance] * 3), st.booleans(), st.floats(0.1, 10)),
    min_size=1,
    max_size=5,
)


@settings(max_examples=50, deadline=None)
@given(radiances)
def test_lights_are_drawn_by_the_power_they_emit(kinds):
    meshes = [square(pl.Lambertian(0.5))]
    meshes += [square(pl.Emissive(radiance, two_sided)).scaled(size) for radiance, two_sided, size in kinds]
    tables = pl.Scene(meshes).tables()
    # By hand: two triangles of area 2 size^2 each.
    power = [np.mean(r) * 2 * s**2 * (2 if both else 1) for r, both, s in kinds for _ in range(2)]
    if not any(power):
        assert tables.light_triangles is None
        return
    lit = np.flatnonzero(power)
    assert tables.light_triangles.tolist() == (lit + 2).tolist()
    expected = np.array(power)[lit] / sum(power)
    # A sum of some ten terms, a few eps each.
    np.testing.assert_allclose(tables.light_pdf, expected, rtol=1e-13)
    np.testing.assert_allclose(np.diff(tables.light_cdf, prepend=0), expected, atol=1e-14)
    assert tables.light_cdf[-1] == 1.0
    areas = np.array([2 * s**2 for _, _, s in kinds for _ in range(2)])[lit]
    np.testing.assert_allclose(tables.light_area_pdf * areas, expected, rtol=1e-13)


def test_triangles_without_area_can_be_met_but_are_no_lights():
    mesh = pl.Mesh(CORNERS, [[0, 1, 1], [0, 1, 2], [3, 3, 3]], pl.Emissive(1.0))
    tables = pl.Scene([square(), mesh]).tables()
    assert len(tables.triangles) == 5
    assert tables.light_triangles.tolist() == [3] and tables.light_cdf.tolist() == [1.0]


def test_extreme_radiances_give_finite_probabilities():
    tables = pl.Scene([square(), square(pl.Emissive(1e308)), square(pl.Emissive(1e308, True))]).tables()
    np.testing.assert_allclose(tables.light_pdf, [1 / 6, 1 / 6, 1 / 3, 1 / 3])


def test_tables_are_read_only_and_contiguous():
    meshes = [square(pl.Lambertian(pl.Texture(np.full((1, 1, 1), 0.5))), uv=UV, normals=np.tile([0, 0, 1], (4, 1)))]
    for table in pl.Scene(meshes, [LAMP], 0.1).tables()[1:]:
        assert table is not None
        assert table.flags.c_contiguous and not table.flags.writeable


def test_a_large_mesh_compiles_without_a_loop_per_triangle():
    # 500 000 triangles, far below a second; a Python loop over them is not.
    side = 501
    x, y = np.meshgrid(np.arange(side, dtype=float), np.arange(side, dtype=float))
    vertices = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    a = (side * np.arange(side - 1)[:, None] + np.arange(side - 1)).ravel()
    faces = np.concatenate([np.column_stack([a, a + 1, a + side]), np.column_stack([a + 1, a + side + 1, a + side])])
    tables = pl.Scene([pl.Mesh(vertices, faces, pl.Emissive(1.0)), square()]).tables()
    assert len(tables.light_triangles) == 500_000 and tables.light_cdf[-1] == 1.0
    np.testing.assert_allclose(tables.light_area_pdf, 1 / 250_000)
