"""glTF: triangles, the scene graph, instances, lights and cameras. Files are written here, number by number."""

import json

import numpy as np
import pytest
from scene_helpers import POINTS, Writer, area_vectors, corners_of

import plenoptic as pl
from plenoptic.scene.files.gltf.meshes import INSTANCED_FROM
from plenoptic.scene.files.load import load_file
from plenoptic.scene.geometry.instance import Instances


def test_a_file_in_one_text_or_with_arrays_beside_it(tmp_path):
    writer = Writer()
    writer.node(mesh=writer.mesh(POINTS, [[0, 1, 2], [0, 2, 3]]))
    (mesh,) = pl.load_meshes(writer.save(tmp_path / "quad.gltf"), unit="mm")
    assert corners_of(mesh).tolist() == np.array(POINTS, dtype=float)[[[0, 1, 2], [0, 2, 3]]].tolist()
    assert mesh.normals is None and mesh.uv is None and mesh.material == pl.Lambertian(0.5)
    assert mesh.name == "quad.gltf"
    # Arrays beside the file.
    writer = Writer()
    writer.node(mesh=writer.mesh(POINTS, [[0, 1, 2]], name="corner"))
    (tmp_path / "the arrays.bin").write_bytes(writer.bytes)
    path = writer.save(tmp_path / "a.gltf")
    header = json.loads(path.read_text())
    header["buffers"] = [{"uri": "the%20arrays.bin", "byteLength": len(writer.bytes)}]
    path.write_text(json.dumps(header))
    assert pl.load_meshes(path)[0].name == "corner"
    (tmp_path / "the arrays.bin").unlink()
    with pytest.raises(pl.errors.FileError, match=r"a\.gltf.*'the arrays\.bin'.*beside it"):
        pl.load_meshes(path)


def test_every_kind_of_index_strips_and_fans(tmp_path):
    for indices in ("<u1", "<u2", "<u4", None):
        writer = Writer()
        number = writer.mesh([*POINTS[:3], POINTS[0], *POINTS[2:]])
        if indices is not None:
            writer.header["meshes"][0]["primitives"][0]["indices"] = writer.array(range(6), indices)
        writer.node(mesh=number)
        (mesh,) = pl.load_meshes(writer.save(tmp_path / "a.gltf"), unit="mm")
        assert area_vectors(mesh).sum(axis=0).tolist() == [0, 0, 1]
    for mode, order in ((5, [0, 1, 3, 2]), (6, [0, 1, 2, 3])):
        writer = Writer()
        writer.node(mesh=writer.mesh(POINTS, order, mode=mode))
        for other in (0, 1, 2, 3):  # points and lines are left out
            writer.node(mesh=writer.mesh(POINTS, [0, 1, 2], mode=other))
        (mesh,) = pl.load_meshes(writer.save(tmp_path / "a.gltf"), unit="mm")
        assert area_vectors(mesh).tolist() == [[0, 0, 0.5]] * 2


def test_quantised_and_sparse_arrays(tmp_path):
    writer = Writer()
    more = {
        "NORMAL": writer.array([(0, 0, 127, 0)] * 4, "<i1", normalized=True, type="VEC3"),
        "TEXCOORD_0": writer.array([(0, 65535), (65535, 65535), (65535, 0), (0, 0)], "<u2", normalized=True),
    }
    # Bytes in threes lie four apart.
    view = writer.header["bufferViews"][writer.header["accessors"][0]["bufferView"]]
    view["byteStride"] = 4
    number = writer.mesh(POINTS, [[0, 1, 2], [0, 2, 3]], **more)
    attributes = writer.header["meshes"][0]["primitives"][0]["attributes"]
    attributes["POSITION"] = writer.array(np.array(POINTS) * 300, "<i2")
    writer.node(mesh=number, scale=[1 / 300] * 3)
    path = writer.save(tmp_path / "a.gltf", extensionsRequired=["KHR_mesh_quantization"])
    (mesh,) = pl.load_meshes(path, unit="mm")
    # The product of 300 and 1 / 300 is right to one rounding.
    np.testing.assert_allclose(mesh.bounds, [[0, 0, 0], [1, 1, 0]], atol=3e-16)
    np.testing.assert_array_equal(mesh.normals, [[0, 0, 1]] * 4)
    np.testing.assert_array_equal(mesh.uv, np.array(POINTS)[:, :2])
    # Arrays that lie between others, and sparse ones.
    writer = Writer()
    mixed = np.concatenate([np.array(POINTS), np.tile([0, 0, 1], (4, 1))], axis=1)
    number = writer.mesh(POINTS, [[0, 1, 2], [0, 2, 3]])
    view = writer.view(mixed.astype("<f4").tobytes(), byteStride=24)
    common = {"bufferView": view, "componentType": 5126, "count": 4, "type": "VEC3"}
    both = [{**common, "byteOffset": offset} for offset in (0, 12)]
    both[0]["sparse"] = {
        "count": 1,
        "indices": {"bufferView": writer.view(np.array([2], "<u2").tobytes()), "componentType": 5123},
        "values": {"bufferView": writer.view(np.array([5, 5, 0], "<f4").tobytes())},
    }
    writer.header["accessors"] += both
    count = len(writer.header["accessors"])
    writer.header["meshes"][0]["primitives"][0]["attributes"] = {"POSITION": count - 2, "NORMAL": count - 1}
    writer.node(mesh=number)
    (mesh,) = pl.load_meshes(writer.save(tmp_path / "a.gltf"), unit="mm")
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [5, 5, 0], [0, 1, 0]]
    assert mesh.normals.tolist() == [[0, 0, 1]] * 4


def test_parts_keep_only_the_vertices_that_they_use(tmp_path):
    writer = Writer()
    number = writer.mesh([(9, 9, 9), *POINTS], [[1, 2, 3]])
    first = writer.header["meshes"][0]["primitives"][0]
    writer.header["meshes"][0]["primitives"].append({**first, "indices": writer.array([1, 3, 4], "<u2")})
    writer.node(mesh=number)
    meshes = pl.load_meshes(writer.save(tmp_path / "a.gltf"), unit="mm")
    assert [len(mesh.vertices) for mesh in meshes] == [3, 3]
    assert corners_of(meshes[1]).tolist() == [[[0, 0, 0], [1, 1, 0], [0, 1, 0]]]


def turned(quarter):
    """A quaternion, x y z w: a quarter turn about z, so many times."""
    return [0.0, 0.0, float(np.sin(quarter * np.pi / 4)), float(np.cos(quarter * np.pi / 4))]


def test_scale_then_rotation_then_translation_then_the_parent(tmp_path):
    writer = Writer()
    placed = {"translation": [0, 0, 5], "rotation": turned(1), "scale": [2, 1, 1]}
    child = writer.node(mesh=writer.mesh(POINTS, [[0, 1, 2]]), **placed)
    # By columns: this shifts by x = 10 and doubles everything.
    writer.node(matrix=[2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 10, 0, 0, 1], children=[child])
    (mesh,) = pl.load_meshes(writer.save(tmp_path / "a.gltf"), unit="mm")
    # (1, 1, 0) is stretched to (2, 1, 0), turned to (-1, 2, 0), lifted to z = 5, doubled and shifted.
    np.testing.assert_allclose(corners_of(mesh)[0], [[10, 0, 10], [10, 4, 10], [8, 4, 10]], atol=1e-14)
    # One node may have many places.
    writer = Writer()
    places = {
        "TRANSLATION": writer.array([(0, 0, 0), (10, 0, 0), (20, 0, 0)]),
        "ROTATION": writer.array([turned(0), turned(1), turned(2)]),
    }
    instancing = {"EXT_mesh_gpu_instancing": {"attributes": places}}
    writer.node(mesh=writer.mesh(POINTS, [[0, 1, 2]]), extensions=instancing, translation=[0, 0, 7])
    found = pl.load_meshes(writer.save(tmp_path / "a.gltf"), unit="mm")
    # The lower right corner (1, 0) goes to (1, 0), (0, 1) and (-1, 0); float32 holds the quaternion to 6e-8.
    expected = [[1, 0, 7], [10, 1, 7], [19, 0, 7]]
    np.testing.assert_allclose([corners_of(mesh)[0, 1] for mesh in found], expected, atol=1e-6)


def test_the_scene_to_show_is_shown(tmp_path):
    writer = Writer()
    number = writer.mesh(POINTS, [[0, 1, 2]])
    for x in (0, 10, 20):
        writer.node(mesh=number, translation=[x, 0, 0])
    scenes = {"scenes": [{"nodes": [0]}, {"nodes": [1, 2]}], "scene": 1}
    found = pl.load_meshes(writer.save(tmp_path / "a.gltf", **scenes), unit="mm")
    assert [mesh.bounds[0, 0] for mesh in found] == [10, 20]
    assert len(pl.load_meshes(writer.save(tmp_path / "all.gltf"))) == 3
    # A skinned mesh is shown unbent.
    writer = Writer()
    writer.node(mesh=writer.mesh(POINTS, [[0, 1, 2]]), skin=0, name="arm")
    with pytest.warns(UserWarning, match=r"'arm' bends its mesh"):
        pl.load_meshes(writer.save(tmp_path / "a.gltf"))


@pytest.mark.parametrize(
    ("of_mesh", "of_node", "heights"),
    [
        (None, None, [0.0]),
        ([0.5, 0.0], None, [4.0]),  # of the mesh, where the node has none
        ([0.5, 0.0], [0.0, 0.25], [0.5]),  # of the node, where both have some
        (None, [0.5, -1.0], [2.0]),
        ([0.0, 1.0], [None, [1.0, 1.0]], [2.0, 10.0]),  # two nodes of one mesh
    ],
)
def test_weights_of_morph_targets(tmp_path, of_mesh, of_node, heights):
    """glTF 2.0, 3.7.2.2: z is 8 w[0] + 2 w[1] at the third corner, and the normal (0, 0, 1) + (2, 0, 0) w[0]."""
    writer = Writer()
    number = writer.mesh(POINTS[:3], NORMAL=writer.array([(0, 0, 1)] * 3))
    primitive = writer.header["meshes"][number]["primitives"][0]
    high, low = ([(0, 0, 0), (0, 0, 0), (0, 0, height)] for height in (8, 2))
    turned = writer.array([(2, 0, 0)] * 3)
    primitive["targets"] = [{"POSITION": writer.array(high), "NORMAL": turned}, {"POSITION": writer.array(low)}]
    writer.header["meshes"][number] |= {} if of_mesh is None else {"weights": of_mesh}
    for weights in of_node if of_node and isinstance(of_node[-1], list) else [of_node]:
        writer.node(mesh=number, **({} if weights is None else {"weights": weights}))
    meshes = pl.load_meshes(writer.save(tmp_path / "a.gltf"), unit="mm")
    assert [corners_of(mesh)[0, 2].tolist() for mesh in meshes] == [[1, 1, height] for height in heights]
    used = [weights or of_mesh for weights in (of_node if len(heights) > 1 else [of_node])]
    for mesh, weights in zip(meshes, used, strict=True):
        slope = 2 * (weights or [0])[0]
        np.testing.assert_allclose(mesh.normals[0], np.array([slope, 0, 1]) / np.hypot(slope, 1), atol=1e-7)
    writer.header["nodes"][0]["weights"] = [1.0]
    with pytest.raises(pl.errors.FileError, match="1 weights for 2 morph targets"):
        pl.load_meshes(writer.save(tmp_path / "a.gltf"))


def many(writer, triangles, **more):
    """A mesh of so many triangles: a strip."""
    points = [(k // 2, 1 - k % 2, 0.1 * (k % 3)) for k in range(triangles + 2)]
    return writer.mesh(points, mode=5, **more)


def test_several_places_of_a_large_mesh_are_kept_and_of_small_ones_copied(tmp_path):
    writer = Writer()
    number = many(writer, INSTANCED_FROM)
    writer.node(mesh=number)
    writer.node(mesh=number, scale=[1, 1, -2], translation=[0, 0, 50])
    writer.node(mesh=number, scale=[1, 0, 1])  # flattened: it cannot be seen
    (found,) = pl.load_meshes(writer.save(tmp_path / "a.gltf"), unit="cm")
    assert isinstance(found, Instances) and len(found) == 2 and len(found.mesh.faces) == INSTANCED_FROM
    one, other = found.meshes()
    x = (INSTANCED_FROM + 1) // 2 * 10
    np.testing.assert_allclose(one.bounds, [[0, 0, 0], [x, 10, 2]], atol=1e-6)
    np.testing.assert_allclose(other.bounds, [[0, 0, 496], [x, 10, 500]], atol=1e-4)
    # The front stays the front: what faced +z faces -z in the mirror.
    assert (area_vectors(one)[:, 2] > 0).all() and (area_vectors(other)[:, 2] < 0).all()
    # Small meshes are copied.
    writer = Writer()
    number = many(writer, INSTANCED_FROM - 1, material=0)
    writer.node(mesh=number)
    writer.node(mesh=number, scale=[1, 1, -1], translation=[0, 0, 3])
    found = pl.load_meshes(writer.save(tmp_path / "a.gltf", materials=[{}]), unit="mm")
    assert [type(one) for one in found] == [pl.Mesh] * 2
    np.testing.assert_allclose([one.bounds[:, 2] for one in found], [[0, 0.2], [2.8, 3]], atol=1e-6)
    assert (area_vectors(found[0])[:, 2] > 0).all() and (area_vectors(found[1])[:, 2] < 0).all()
    assert found[0].material is found[1].material


def lit(tmp_path, light, **node):
    writer = Writer()
    writer.node(extensions={"KHR_lights_punctual": {"light": 0}}, **node)
    return writer.save(tmp_path / "a.gltf", extensions={"KHR_lights_punctual": {"lights": [light]}})


def test_the_irradiance_of_a_point_light_is_intensity_over_distance_squared_in_the_units_of_the_file(tmp_path):
    path = lit(tmp_path, {"type": "point", "intensity": 8.0, "color": [1.0, 0.5, 0.25]}, translation=[1, 2, 3])
    for unit, mm in ((None, 1000.0), ("mm", 1.0), ("inch", 25.4)):
        (light,) = load_file(path, unit=unit).lights
        assert isinstance(light, pl.lights.PointLight)
        distance = 2.0 * mm
        np.testing.assert_allclose(np.array(light.intensity) / distance**2, [2.0, 1.0, 0.5], rtol=1e-15)
        np.testing.assert_allclose(light.position, [mm, 2 * mm, 3 * mm], rtol=1e-15)


def test_a_spot_shines_along_the_minus_z_of_its_node_whatever_its_scale(tmp_path):
    about_y = [0.0, float(np.sin(np.pi / 4)), 0.0, float(np.cos(np.pi / 4))]  # -z goes to -x
    cone = {"innerConeAngle": 0.1, "outerConeAngle": 0.3}
    path = lit(tmp_path, {"type": "spot", "spot": cone}, rotation=about_y, scale=[3, 4, 5])
    (light,) = load_file(path, unit="mm").lights
    assert isinstance(light, pl.lights.SpotLight)
    np.testing.assert_allclose(light.direction, [-1, 0, 0], atol=1e-15)
    assert (light.intensity, light.inner_angle, light.outer_angle) == (1.0, 0.1, 0.3)
    # One without angles has those of the standard, and a sharp one is read.
    (light,) = load_file(lit(tmp_path, {"type": "spot"})).lights
    assert (light.inner_angle, light.outer_angle) == (0.0, np.pi / 4)
    cone = {"innerConeAngle": 0.5, "outerConeAngle": 0.5}
    (light,) = load_file(lit(tmp_path, {"type": "spot", "spot": cone})).lights
    assert light.outer_angle == 0.5 and light.inner_angle == pytest.approx(0.5, rel=2e-4)
    # A directional light is parallel and the same in all units.
    path = lit(tmp_path, {"type": "directional", "intensity": 3.0})
    for unit in (None, "mm"):
        assert load_file(path, unit=unit).lights == (pl.SunLight((0, 0, -1), 3.0, 0.0),)


def test_dark_lights_are_left_out_and_lights_alone_are_contents(tmp_path):
    with pytest.raises(pl.errors.FileError, match=r"a\.gltf holds no triangles.*no lights"):
        load_file(lit(tmp_path, {"type": "point", "intensity": 0.0}))
    path = lit(tmp_path, {"type": "point"})
    assert load_file(path).meshes == ()
    with pytest.raises(pl.errors.FileError, match=r"a\.gltf holds no triangles"):
        pl.load_meshes(path)
    # What would be read wrongly is refused.
    with pytest.raises(pl.errors.FileError, match=r"a\.gltf.*'laser'"):
        load_file(lit(tmp_path, {"type": "laser"}))
    with pytest.raises(pl.errors.FileError, match=r"b\.gltf.*EXT_meshopt_compression"):
        load_file(Writer().save(tmp_path / "b.gltf", extensionsRequired=["EXT_meshopt_compression"]))


def test_a_view_puts_a_camera_where_the_node_of_the_file_stands(tmp_path):
    rotation = np.array([0.3, -0.2, 0.5, 0.7])
    rotation /= np.linalg.norm(rotation)
    writer = Writer()
    writer.node(mesh=writer.mesh(POINTS, [[0, 1, 2]]))
    writer.node(camera=0, translation=[1, 2, 3], rotation=rotation.tolist(), scale=[2, 2, 2])
    described = [{"name": "left", "type": "perspective", "perspective": {"yfov": 0.6, "aspectRatio": 1.5, "znear": 1}}]
    (view,) = load_file(writer.save(tmp_path / "a.gltf", cameras=described), unit="cm").views
    assert (view.name, view.vertical_field_of_view, view.aspect_ratio) == ("left", 0.6, 1.5)
    pose = pl.Pose.look_at(view.position, view.look_at, view.up)
    axis, w = rotation[:3], rotation[3]

    def turn(vector):  # v + 2 w (q x v) + 2 q x (q x v)
        return vector + 2 * w * np.cross(axis, vector) + 2 * np.cross(axis, np.cross(axis, vector))

    expected = np.stack([turn(column) for column in np.eye(3)], axis=1)
    # look_at is 10 mm ahead of 37 mm: the direction keeps 4 eps.
    np.testing.assert_allclose(pose.rotation, expected, atol=2e-15)
    np.testing.assert_allclose(pose.position, [10, 20, 30], rtol=1e-15)
    assert np.linalg.norm(view.look_at - view.position) == pytest.approx(10, rel=1e-14)
    # An orthographic view has no angle.
    writer = Writer()
    writer.node(mesh=writer.mesh(POINTS, [[0, 1, 2]]))
    writer.node(camera=0, name="map")
    described = [{"type": "orthographic", "orthographic": {"xmag": 3.0, "ymag": 2.0, "znear": 0, "zfar": 1}}]
    (view,) = load_file(writer.save(tmp_path / "a.gltf", cameras=described)).views
    assert (view.name, view.vertical_field_of_view, view.aspect_ratio) == ("map", None, 1.5)
