import numpy as np
import PIL.Image
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scene_helpers import POINTS, area_vectors, corners_of, volume

import plenoptic as pl

RED, GREEN, BLUE, WHITE = (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255)
FOUR_COLOURS = PIL.Image.fromarray(np.array([[RED, GREEN], [BLUE, WHITE]], dtype=np.uint8))

CORNER = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\n"


def write_obj(folder, *, mtl="newmtl skin\nKd 1 1 1\nmap_Kd skin.png\n"):
    (folder / "quad.obj").write_text(f"mtllib quad.mtl\n{CORNER}usemtl skin\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n")
    (folder / "quad.mtl").write_text(mtl)
    FOUR_COLOURS.save(folder / "skin.png")
    return folder / "quad.obj"


def colour_at(mesh, corner):
    """The texel next to where the mesh has a corner, by the uv convention of `Texture`."""
    (vertex,) = np.flatnonzero((mesh.vertices == corner).all(axis=1))
    u, v = np.clip(mesh.uv[vertex], 0.01, 0.99)
    texels = getattr(mesh.material, "albedo" if isinstance(mesh.material, pl.Lambertian) else "base").texels
    return texels[int((1 - v) * texels.shape[0]), int(u * texels.shape[1])].tolist()


def assert_upright(mesh):
    colours = [colour_at(mesh, corner) for corner in POINTS]
    assert colours == [[0, 0, 1], [1, 1, 1], [0, 1, 0], [1, 0, 0]]


def test_the_textures_of_obj_glb_and_gltf_are_upright(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    assert_upright(*pl.load_meshes(write_obj(tmp_path)))
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=FOUR_COLOURS)
    visual = trimesh.visual.TextureVisuals(uv=np.array(POINTS)[:, :2], material=material)
    scene = trimesh.Scene(trimesh.Trimesh(POINTS, [[0, 1, 2], [0, 2, 3]], visual=visual, process=False))
    for name, content in trimesh.exchange.gltf.export_gltf(scene).items():
        (tmp_path / name).write_bytes(content)
    (tmp_path / "model.glb").write_bytes(scene.export(file_type="glb"))
    for ending in ("glb", "gltf"):
        assert_upright(*pl.load_meshes(tmp_path / f"model.{ending}", unit="mm"))


def test_the_texture_of_a_ply_is_upright(tmp_path):
    FOUR_COLOURS.save(tmp_path / "skin.png")
    rows = ["0 0 0 0 0", "1 0 0 1 0", "1 1 0 1 1", "0 1 0 0 1", "3 0 1 2", "3 0 2 3"]
    head = ["ply", "format ascii 1.0", "comment TextureFile skin.png", "element vertex 4"]
    head += [f"property float {name}" for name in "xyzst"]
    head += ["element face 2", "property list uchar int vertex_indices", "end_header"]
    (tmp_path / "quad.ply").write_text("\n".join(head + rows) + "\n")
    assert_upright(*pl.load_meshes(tmp_path / "quad.ply"))
    (tmp_path / "skin.png").write_bytes(b"no image")
    with pytest.raises(pl.errors.FileError, match=r"quad\.ply.*skin\.png"):
        pl.load_meshes(tmp_path / "quad.ply")
    assert pl.load_meshes(tmp_path / "quad.ply", material=pl.Emissive())[0].material == pl.Emissive()


def test_a_single_colour_without_a_material_is_decoded(tmp_path):
    import trimesh

    mesh = trimesh.creation.box()
    for code, linear in ((255, 1.0), (188, 0.5029)):
        mesh.visual.vertex_colors = [code, code, code, 255]
        mesh.export(tmp_path / "box.ply")
        (loaded,) = pl.load_meshes(tmp_path / "box.ply")
        np.testing.assert_allclose(loaded.material.albedo, linear, atol=1e-4)
    # That of a GLB is linear.
    mesh.visual.vertex_colors = [51, 102, 255, 255]
    (tmp_path / "box.glb").write_bytes(trimesh.Scene(mesh).export(file_type="glb"))
    (loaded,) = pl.load_meshes(tmp_path / "box.glb")
    np.testing.assert_allclose(loaded.material.albedo, [0.2, 0.4, 1.0], atol=1e-15)


def test_units(tmp_path):
    path = write_obj(tmp_path)
    lengths = {"um": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1e3, "km": 1e6, "inch": 25.4, "foot": 304.8}
    for unit, length in lengths.items():
        (mesh,) = pl.load_meshes(path, unit=unit)
        np.testing.assert_array_equal(mesh.bounds[1], [length, length, 0])
    # A scene has no light that the file has not.
    scene = pl.Scene.load(write_obj(tmp_path), unit="cm")
    assert scene.lights == () and scene.background is None and scene.tables().emission is None
    assert pl.Scene.load(write_obj(tmp_path), material=pl.Emissive(), background=0.5).background.radiance == 0.5


def test_every_kind_is_read_closed_and_outside_out(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    # glTF is in metres, and other files in millimetres, unless said otherwise.
    for kind, scale in (("obj", 1.0), ("ply", 1.0), ("stl", 1.0), ("glb", 1e3)):
        path = tmp_path / f"ball.{kind}"
        trimesh.creation.icosphere(subdivisions=2).export(path)
        (mesh,) = pl.load_meshes(path, unit="mm")
        assert len(mesh.faces) == 320 and volume(mesh) == pytest.approx(4.05, abs=0.03), kind
        assert mesh.material == pl.Lambertian(0.5), kind
        np.testing.assert_allclose(pl.load_meshes(path)[0].bounds, scale * mesh.bounds, rtol=1e-6)


def test_bytes_behind_the_triangles_of_an_stl_are_left_out_with_a_warning(tmp_path):
    """As in HalfDonut.stl of numpy-stl, which ends with one byte too many."""
    corners = np.float32([[(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(1, 0, 0), (1, 2, 0), (0, 1, 0)]])
    facets = b"".join(bytes(12) + triangle.tobytes() + bytes(2) for triangle in corners)
    (tmp_path / "a.stl").write_bytes(bytes(80) + (2).to_bytes(4, "little") + facets + b"\0")
    with pytest.warns(pl.errors.FileWarning, match=r"a\.stl: 1 bytes behind its last triangle are left out"):
        (mesh,) = pl.load_meshes(tmp_path / "a.stl")
    np.testing.assert_array_equal(corners_of(mesh), corners)


def test_names_of_solids_may_hold_keywords_and_lines_may_end_with_returns(tmp_path):
    facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    for name in ("", "vertex 1 2 3", "normal map", "solid", "endsolid", "facet", "H\u00fclle"):
        for end in ("\n", "\r", "\r\n"):
            text = f"solid {name}\n{facet}endsolid {name}\n  SOLID {name}\n{2 * facet.upper()}ENDSOLID".replace(
                "\n", end
            )
            (tmp_path / "a.stl").write_bytes(text.encode("latin-1"))
            meshes = pl.load_meshes(tmp_path / "a.stl")
            assert [len(mesh.faces) for mesh in meshes] == [1, 2], (name, end)
            assert corners_of(meshes[1])[1].tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


def test_a_ply_header_of_blender_2_4_has_a_line_without_a_keyword(tmp_path):
    head = "ply\nformat ascii 1.0\nCreated by Blender3D 247 - www.blender.org, source file: \nelement vertex 3\n"
    head += "property float x\nproperty float y\nproperty float z\nelement face 1\n"
    head += "property list uchar uint vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n"
    (mesh,) = pl.load_meshes(write(tmp_path / "a.ply", head + "3 0 1 2\n"))
    assert corners_of(mesh).tolist() == [[[0, 0, 0], [1, 0, 0], [0, 1, 0]]]
    for cut in ("", "3\n", "3 0 1\n"):
        with pytest.raises(pl.errors.FileError, match=r"a\.ply: it is cut off: rows are missing, or have too few"):
            pl.load_meshes(write(tmp_path / "a.ply", head + cut))


TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
BAD = {
    "empty.obj": (b"", "no triangles"),
    "broken.obj": (b"v 0 0 0\nv 1 0 0\nv 0 one 0\nf 1 2 3\n", "; "),
    "beyond.obj": (TRIANGLE + b"f 1 2 9\n", "line 4 names v 9, out of bounds"),
    "nan.obj": (b"v 0 0 0\nv 1 0 nan\nv 0 1 0\nf 1 2 3\n", "nan.*finite.*repair the mesh"),
    "flat.obj": (b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "no triangles that have an area"),
    "cut.ply": (b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n", "; "),
    "words.stl": (b"solid nothing\nendsolid", "no triangles"),
    "short_text.stl": (b"solid cube\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0", "it has no 'endsolid'"),
    "short.stl": (bytes(80) + (1000).to_bytes(4, "little") + bytes(50), "cut off.* 134 bytes instead of 50084"),
    "words.glb": (b"certainly no glTF file, but long enough to look at", "no binary glTF"),
    "nothing.gltf": (b'{"asset": {"version": "2.0"}}', "; "),
    "old.gltf": (b'{"asset": {"version": "1.0"}}', "only glTF 2"),
}


@pytest.mark.filterwarnings("ignore")
def test_a_bad_file_is_a_file_error_that_names_it(tmp_path):
    for name, (content, said) in BAD.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(pl.errors.FileError, match=name.replace(".", r"\.") + ".*" + said):
            pl.load_meshes(tmp_path / name)
    (tmp_path / "folder.obj").mkdir()
    (tmp_path / "mesh.blend").write_bytes(b"")
    for name, said in (("folder.obj", "is a folder"), ("mesh.blend", r"'\.blend'.*\.glb, \.gltf, \.obj")):
        with pytest.raises(pl.errors.FileError, match=said):
            pl.load_meshes(str(tmp_path / name))
    assert len(pl.load_meshes(write_obj(tmp_path).rename(tmp_path / "QUAD.OBJ"))) == 1


def test_what_an_obj_lacks_is_a_file_error(tmp_path):
    mapped, lacks = "newmtl skin\nmap_Kd skin.png\n", r"skin\.png.*material="
    for mtl, image, said in (
        (mapped, None, lacks),
        (mapped, b"no image", lacks),
        ("newmtl skin\nKd 0.5 0.4\n", b"", r"material file.*Kd 0\.5 0\.4.*correct it"),
    ):
        path = write_obj(tmp_path, mtl=mtl)
        (tmp_path / "skin.png").unlink() if image is None else (tmp_path / "skin.png").write_bytes(image)
        with pytest.raises(pl.errors.FileError, match=rf"quad\.obj.*{said}"):
            pl.load_meshes(path)
        (mesh,) = pl.load_meshes(path, material=pl.Lambertian(0.3))
        assert mesh.material == pl.Lambertian(0.3) and mesh.uv is not None


def write(path, text):
    path.write_text(text)
    return path


@settings(max_examples=25)
@given(st.lists(st.tuples(*[st.floats(-1e9, 1e9)] * 3), min_size=3, max_size=9, unique=True))
def test_an_obj_is_read_to_the_last_bit(tmp_path_factory, corners):
    lines = ["v " + " ".join(map(repr, c)) for c in corners] + [f"f 1 {k + 2} {k + 3}" for k in range(len(corners) - 2)]
    path = write(tmp_path_factory.mktemp("bits") / "fan.obj", "\n".join(lines) + "\n")
    fan = [[0, k + 1, k + 2] for k in range(len(corners) - 2)]
    expected = np.array(corners)[fan]
    if not np.cross(expected[:, 1] - expected[:, 0], expected[:, 2] - expected[:, 0]).any():
        with pytest.raises(pl.errors.FileError, match="area"):
            pl.load_meshes(path)
        return
    (mesh,) = pl.load_meshes(path)
    np.testing.assert_array_equal(corners_of(mesh), expected)


def test_polygons_keep_uv_and_order(tmp_path):
    for faces in ("f 1/1 2/2 3/3 4/4\n", "f 1/1/1 2/2/1 3/3/1 4/4/1\n", "f 1/1 2/2 3/3\nf 3/3 4/4 1/1\n"):
        (mesh,) = pl.load_meshes(write(tmp_path / "t.obj", CORNER + faces))
        assert len(mesh.faces) == 2 and (mesh.normals is not None) == ("/1/1" in faces)
        np.testing.assert_array_equal(mesh.uv, mesh.vertices[:, :2])
        assert mesh.material == pl.Lambertian(0.5)  # uv without a material makes no texture
        assert area_vectors(mesh)[:, 2].tolist() == [0.5, 0.5]
    # A seam splits vertices.
    (mesh,) = pl.load_meshes(write(tmp_path / "t.obj", CORNER + "f 1/1 2/2 3/3\nf 1/4 3/1 4/2\n"))
    assert mesh.uv[mesh.faces].tolist() == [[[0, 0], [1, 0], [1, 1]], [[0, 1], [0, 0], [1, 0]]]
    # Normals only where the file has them.
    (mesh,) = pl.load_meshes(write(tmp_path / "t.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0.6 0.8\nf 1//1 2//1 3//1\n"))
    np.testing.assert_allclose(mesh.normals, np.tile([0, 0.6, 0.8], (3, 1)), atol=1e-15)
    (mesh,) = pl.load_meshes(write(tmp_path / "t.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0.6 0.8\nf 1 2 3\n"))
    assert mesh.normals is None


def test_every_way_to_write_an_obj_is_read(tmp_path):
    for text in (
        CORNER + "f 1 2 3 # a comment\n",
        "# mtllib absent.mtl\n" + CORNER + "f 1 2 3\n",
        CORNER.replace(" ", "\t") + "\tf\t1\t2\t3\n",
        (CORNER + "f 1 2 3\n").replace("\n", "\r\n"),
        (CORNER + "f 1 2 3\n").replace("\n", "\r"),
        CORNER + "f -4 -3 -2\n",
        CORNER + "l 1 2\nf 1 2 3\np 1\n",
        CORNER + "g H\u00fclle\nf 1 2 3\n",
    ):
        (tmp_path / "t.obj").write_bytes(text.encode("latin-1"))
        (mesh,) = pl.load_meshes(tmp_path / "t.obj")
        assert corners_of(mesh).tolist() == [[[0, 0, 0], [1, 0, 0], [1, 1, 0]]], text


def test_each_part_of_an_obj_has_its_material(tmp_path):
    write(tmp_path / "two.mtl", "newmtl red one\nKd 1 0 0\nnewmtl lamp\nKe 5 5 5\n")
    text = "mtllib two.mtl\n" + CORNER + "usemtl red one\nf 1 2 3\nusemtl lamp\nf 1 3 4\nusemtl (null)\nf 2 3 4\n"
    meshes = pl.load_meshes(write(tmp_path / "two.obj", text))
    found = {tuple(mesh.vertices[mesh.faces[0]].ravel()): mesh.material for mesh in meshes}
    assert found == {
        (0, 0, 0, 1, 0, 0, 1, 1, 0): pl.Lambertian((1.0, 0.0, 0.0)),
        (0, 0, 0, 1, 1, 0, 0, 1, 0): pl.Emissive(5.0),
        (1, 0, 0, 1, 1, 0, 0, 1, 0): pl.Lambertian(0.5),
    }
    # Several files of materials.
    write(tmp_path / "one.mtl", "newmtl a\nKd 0.1 0.1 0.1\n")
    write(tmp_path / "two.mtl", "newmtl b\nKd 0.2 0.2 0.2\n")
    for named in ("mtllib one.mtl\nmtllib two.mtl\n", "mtllib one.mtl two.mtl\n"):
        path = write(tmp_path / "t.obj", named + CORNER + "usemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\n")
        assert {mesh.material for mesh in pl.load_meshes(path)} == {pl.Lambertian(0.1), pl.Lambertian(0.2)}
