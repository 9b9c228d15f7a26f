"""OBJ and PLY files against areas by the shoelace formula, and corners and colours written down by hand."""

import math
import re
import struct
import warnings

import numpy as np
import pytest
from scene_helpers import area, area_vectors, corners_of

import plenoptic as pl
from plenoptic.errors import FileError, FileWarning

L_SHAPE = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
STAR = [(math.cos(k * math.pi / 5) * r, math.sin(k * math.pi / 5) * r) for k, r in enumerate([2, 0.7] * 5)]
ARROW = [(0, 0), (3, -1), (1, 0), (3, 1)]
COMB = [(x, 1 + 3 * (x % 2)) for x in range(12, -1, -1)] + [(0, 0), (12, 0)]
# A wall with a hole, which a bridge joins to its rim: the bridge is passed twice.
WALL = [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)]
TURNS = [1 + 11 * k / 59 for k in range(60)]
SPIRAL = [(t * math.cos(t), t * math.sin(t)) for t in TURNS]
SPIRAL += [((t + 1) * math.cos(t), (t + 1) * math.sin(t)) for t in TURNS[::-1]]
SHAPES = {"L": L_SHAPE, "star": STAR, "arrow": ARROW, "comb": COMB, "wall": WALL, "spiral": SPIRAL}
LOW_TRIANGLE, HIGH_TRIANGLE = [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 5], [1, 0, 5], [0, 1, 5]]
CORNERS = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def write(path, content):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def shoelace(points):
    x, y = np.array(points, dtype=float).T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def ply(vertices, faces, kind="ascii", more="", face_more="", length="uchar", number="int"):
    """Rows of numbers; a face is a list, and further numbers of 8 bits."""
    names = ["x", "y", "z", "red", "green", "blue"][: len(vertices[0])]
    head = f"ply\nformat {kind} 1.0\ncomment made by hand\nelement vertex {len(vertices)}\n"
    head += "".join(f"property {'uchar' if name > 'a' and name < 'x' else 'double'} {name}\n" for name in names)
    head += f"element face {len(faces)}\nproperty list {length} {number} vertex_indices\n{face_more}{more}end_header\n"
    if kind == "ascii":
        rows = [" ".join(map(str, row)) for row in vertices]
        rows += [" ".join(map(str, [len(face), *face, *others])) for face, *others in faces]
        return (head + "\n".join(rows) + "\n").encode()
    order, codes = "<>"["big" in kind], {"uchar": "B", "int": "i", "ushort": "H", "uint": "I"}
    body = b"".join(struct.pack(f"{order}3d{len(row) - 3}B", *row) for row in vertices)
    for face, *others in faces:
        layout = f"{order}{codes[length]}{len(face)}{codes[number]}{len(others)}B"
        body += struct.pack(layout, len(face), *face, *others)
    return head.encode() + body


@pytest.mark.parametrize("start", [0, 1, 3])
@pytest.mark.parametrize("shape", SHAPES)
def test_concave_polygons_keep_their_area_front_and_corners(tmp_path, shape, start):
    points = SHAPES[shape][start:] + SHAPES[shape][:start]
    turn = np.linalg.qr(np.random.default_rng(start).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    places = np.array([(*point, 0.0) for point in points]) @ turn.T
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in places.tolist()] + [f"vt {u!r} {v!r}" for u, v in points]
    for order in (1, -1):
        numbers = range(1, len(points) + 1)[::order]
        face = "f " + " ".join(f"{k}/{k}" for k in numbers)
        (mesh,) = pl.load_meshes(write(tmp_path / "a.obj", "\n".join([*lines, face])))
        normals = area_vectors(mesh)
        # A rotation and a sum of some 100 products of numbers up to 13: 100 x 169 eps.
        assert abs(shoelace(points)) == pytest.approx(area(mesh), abs=4e-12)
        np.testing.assert_allclose(normals.sum(axis=0), order * shoelace(points) * turn[:, 2], atol=4e-12)
        uv = np.array([(*row, 0.0) for row in mesh.uv])
        np.testing.assert_allclose(mesh.vertices, uv @ turn.T, atol=1e-14)
        (mesh,) = pl.load_meshes(write(tmp_path / "a.ply", ply(places.tolist(), [([k - 1 for k in numbers],)])))
        assert abs(shoelace(points)) == pytest.approx(area(mesh), abs=4e-12)


def test_a_polygon_too_large_to_be_divided_is_refused(tmp_path):
    lines = [f"v {k} {k % 2 * 9} 0" for k in range(20_000)] + ["v 20000 -9 0", "v 0 -9 0"]
    path = write(tmp_path / "a.obj", "\n".join([*lines, "f " + " ".join(map(str, range(20_002, 0, -1)))]))
    with pytest.raises(FileError, match=r"concave faces of up to 20002 corners; divide them"):
        pl.load_meshes(path)


COUNTED_BACK = "v 0 0 0\nv 1 0 0\nv 0 1 0\n{}\nf {}\nv 0 0 5\nv 1 0 5\nv 0 1 5\n{}\nf {}\n"
UV = ("vt 0 0\nvt .1 0\nvt 0 .1", "vt .5 .5\nvt .9 .5\nvt .5 .9")
NORMALS = ("vn 0 0 1\nvn 0 0 1\nvn 0 0 1", "vn 0 1 0\nvn 0 1 0\nvn 0 1 0")


@pytest.mark.parametrize("form", ["{}/{}", "{}//{}", "{}/{}/{}", "{}", "+{}"])
@pytest.mark.parametrize("first", [1, -3])
def test_indices_count_from_the_line_they_stand_in(tmp_path, form, first):
    starts = first, first + 3 * (first > 0)
    faces = [" ".join(form.format(k, k, k) for k in range(start, start + 3)) for start in starts]
    if form == "+{}" and first < 0:
        pytest.skip("no number has two signs")
    blocks = ["\n".join(rows) for rows in zip(UV, NORMALS, strict=True)]
    (mesh,) = pl.load_meshes(write(tmp_path / "a.obj", COUNTED_BACK.format(blocks[0], faces[0], blocks[1], faces[1])))
    assert corners_of(mesh).tolist() == [LOW_TRIANGLE, HIGH_TRIANGLE]
    if "{}/{}" in form:
        expected = [[[0, 0], [0.1, 0], [0, 0.1]], [[0.5, 0.5], [0.9, 0.5], [0.5, 0.9]]]
        assert mesh.uv[mesh.faces].tolist() == expected
    if form in ("{}//{}", "{}/{}/{}"):
        assert mesh.normals[mesh.faces].tolist() == [[[0, 0, 1]] * 3, [[0, 1, 0]] * 3]


WRONG = {
    "f 0 2 3": "line 7 names v 0, out of bounds for 4",
    "f 1/0 2/1 3/1": "line 7 names vt 0",
    "f 1//1 2//0 3//1": "line 7 names vn 0, out of bounds for 1",
    "f 1 2 5": "line 7 names v 5, out of bounds for 4",
    "f -1 -2 -5": "line 7 names v -5",
    "f 1/2 2/1 3/1": "line 7 names vt 2, out of bounds for 1",
    "f 1 2 3.5": "in place of an index",
    "f 1 2-3": "in place of a number",
    "f 1/1/1/1 2 3": "in place of an index",
    "v 1 2\nf 1 2 3": "line 7 has 2 numbers; v takes 3",
    "vt 1 two\nf 1 2 3": "in place of a number",
}


@pytest.mark.parametrize("line", WRONG)
def test_wrong_indices_are_refused_by_their_line(tmp_path, line):
    with pytest.raises(FileError, match=rf"a\.obj.*({WRONG[line]})"):
        pl.load_meshes(write(tmp_path / "a.obj", f"{CORNERS}vt 0 0\nvn 0 0 1\n{line}\n"))


def test_marks_before_the_first_line(tmp_path):
    """Of UTF-8, UTF-16 and in a material file: the first line counts."""
    text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 5 5 5\nf 1 2 3\nf 1 3 4\n"
    expected = [[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]]
    for code in ("utf-8-sig", "utf-16", "latin-1"):
        (mesh,) = pl.load_meshes(write(tmp_path / "a.obj", text.encode(code)))
        assert corners_of(mesh).tolist() == expected, code
        write(tmp_path / "a.mtl", "newmtl rot glänzend\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n".encode(code))
        part = "mtllib a.mtl\nusemtl rot glänzend\n" + text.replace("f 1 3", "usemtl blue\nf 1 3")
        meshes = pl.load_meshes(write(tmp_path / "a.obj", part.encode(code)))
        assert [mesh.material.albedo for mesh in meshes] == [(1, 0, 0), (0, 0, 1)], code
    content = ply([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [([0, 1, 2],)])
    (mesh,) = pl.load_meshes(write(tmp_path / "a.ply", b"\xef\xbb\xbf" + content))
    assert corners_of(mesh).tolist() == [LOW_TRIANGLE]


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize(("length", "number"), [("uchar", "int"), ("int", "uint"), ("ushort", "ushort")])
def test_triangles_and_polygons_mixed(tmp_path, kind, length, number):
    if kind != "ascii" and length == "int":
        length = "uint"
    points = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (1, 3, 0)]
    for faces, expected in (
        ([([0, 1, 2, 3],), ([0, 1, 3],)], 6),
        ([([0, 1, 2],), ([0, 2, 3],), ([0, 1, 2, 4, 3],)], 9),
        ([([0, 1],), ([2, 4, 3],)], 1),
        ([([0, 1, 2, 3],), ([3, 2, 1, 0],)], 8),
    ):
        content = ply(points, faces, kind, length=length, number=number)
        (mesh,) = pl.load_meshes(write(tmp_path / "a.ply", content))
        assert area(mesh) == pytest.approx(expected, rel=1e-15)
        with pytest.raises(FileError, match=r"a\.ply"):
            pl.load_meshes(write(tmp_path / "a.ply", content[:-4]))
    with pytest.raises(FileError, match="out of bounds for 5"):
        pl.load_meshes(write(tmp_path / "a.ply", ply(points, [([0, 1, 5],)], kind)))


STRIPS = {
    "3 0 1 2": [[0, 1, 2]],
    "4 0 1 2 3": [[0, 1, 2], [1, 3, 2]],
    "8 0 1 2 3 -1 0 2 1": [[0, 1, 2], [1, 3, 2], [0, 2, 1]],
    "6 0 1 2 -1 -1 0": [[0, 1, 2]],
    "3 0 1 2\n3 1 3 2": [[0, 1, 2], [1, 3, 2]],
}


@pytest.mark.parametrize("rows", STRIPS)
def test_strips_of_a_ply_beside_its_faces(tmp_path, rows):
    head = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face 1\nproperty list uchar int vertex_index\n"
    head += f"element tristrips {rows.count(chr(10)) + 1}\nproperty list int int vertex_indices\nend_header\n"
    path = write(tmp_path / "a.ply", f"{head}0 0 0\n1 0 0\n0 1 0\n1 1 0\n3 3 1 0\n{rows}\n")
    (mesh,) = pl.load_meshes(path)
    assert mesh.faces.tolist() == [[3, 1, 0], *STRIPS[rows]]


def test_a_ply_may_have_uv_for_the_corners_of_its_faces(tmp_path):
    texcoord = "property list uchar float texcoord\n"
    head = ply([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)], [], face_more=texcoord).replace(b"face 0", b"face 2")
    rows = b"3 0 1 2 6 0 0 .5 0 0 .5\n3 1 3 2 6 .5 0 1 1 0 1\n"
    (mesh,) = pl.load_meshes(write(tmp_path / "a.ply", head + rows))
    assert corners_of(mesh).tolist() == [LOW_TRIANGLE, [[1, 0, 0], [1, 1, 0], [0, 1, 0]]]
    assert mesh.uv[mesh.faces].tolist() == [[[0, 0], [0.5, 0], [0, 0.5]], [[0.5, 0], [1, 1], [0, 1]]]


FACES = [([0, 1, 2],), ([1, 3, 2],)]
PLACES = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)]


def coloured(colours, places=PLACES):
    return [(*place, *colour) for place, colour in zip(places, colours, strict=False)]


RGB = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
RED_VERTEX, GREEN_VERTEX = (255, 0, 0), (0, 255, 0)
COLOURED = {
    "a.ply": ply(coloured([RED_VERTEX, GREEN_VERTEX] * 2), FACES),
    "b.ply": ply(PLACES, [([0, 1, 2], *RED_VERTEX), ([1, 3, 2], *GREEN_VERTEX)], face_more=RGB),
    "c.ply": ply(coloured([RED_VERTEX, GREEN_VERTEX] * 2), FACES, "binary_big_endian"),
    "d.obj": b"v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nf 1 2 3\n",
    "e.obj": b"v 0 0 0 255 0 0\nv 1 0 0 0 255 0\nv 0 1 0 0 0 255\nf 1 2 3\n",
}


@pytest.mark.parametrize("name", COLOURED)
def test_a_single_colour_needs_no_texture_and_a_material_replaces_all(tmp_path, name):
    path = write(tmp_path / name, COLOURED[name])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert pl.load_meshes(path, material=pl.Lambertian(0.2))[0].material == pl.Lambertian(0.2)
        one = [(0, 255, 0)] * 4
        contents = {
            "a.ply": ply(coloured(one), FACES),
            "b.ply": ply(PLACES, [([0, 1, 2], 0, 255, 0)] * 2, face_more=RGB),
            "c.ply": ply(coloured(one), FACES, "binary_big_endian"),
            "d.obj": re.sub(rb"v (.) (.) 0 .*\n", rb"v \1 \2 0 0 1 0\n", COLOURED["d.obj"]),
            "e.obj": re.sub(rb"v (.) (.) 0 .*\n", rb"v \1 \2 0 0 255 0\n", COLOURED["e.obj"]),
        }
        assert pl.load_meshes(write(path, contents[name]))[0].material == pl.Lambertian((0.0, 1.0, 0.0))


@pytest.mark.parametrize("form", ["{0}/{0}", "{0}//{0}", "{0}/{0}/{0}"])
def test_uv_and_normals_that_an_obj_names_and_has_not(tmp_path, form):
    face = " ".join(form.format(k) for k in (1, 2, 3))
    with pytest.warns(FileWarning, match=r"a\.obj: its faces name v[tn], of which it has none"):
        (mesh,) = pl.load_meshes(write(tmp_path / "a.obj", f"{CORNERS}f {face}\n"))
    assert (mesh.normals, mesh.uv, area(mesh)) == (None, None, 0.5)


def test_rows_of_a_ply_end_with_their_line(tmp_path):
    """Numbers that the header does not name are left out, as MeshLab writes them for the colours of corners."""
    content = ply([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)], [([0, 1, 2], 9, 1), ([1, 3, 2], 7)])
    (mesh,) = pl.load_meshes(write(tmp_path / "a.ply", content.replace(b"\n", b"\r\n")))
    assert mesh.faces.tolist() == [[0, 1, 2], [1, 3, 2]]
    for short in (content.replace(b"3 1 3 2 7", b"3 1 3"), content.replace(b"\n1 0 0\n", b"\n1 0\n")):
        with pytest.raises(FileError, match="rows are missing, or have too few numbers"):
            pl.load_meshes(write(tmp_path / "a.ply", short))


@pytest.mark.parametrize("shape", [[(0, 0), (1, 1), (1, 0), (0, 2)], [(-1, 1), (1, 1), (1, -1), (-1, -1), (0, -1, 1)]])
def test_polygons_that_cross_themselves_or_fold_keep_their_vector_area(tmp_path, shape):
    points = np.array([(*point, 0.0)[:3] for point in shape], dtype=float)
    (mesh,) = pl.load_meshes(write(tmp_path / "a.ply", ply(points.tolist(), [(list(range(len(points))),)])))
    expected = 0.5 * np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0)
    np.testing.assert_allclose(area_vectors(mesh).sum(axis=0), expected, atol=1e-15)


LIBRARY = "newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("mtllib a.mtl\nusemtl green\n", "'green' is in none of its material files"),
        ("mtllib a.mtl\nusemtl Red\n", "'Red' is in none .*though they have 'red'; correct the name"),
        ("usemtl red\n", "'red' is in none of its material files"),
        ("mtllib absent.mtl\nusemtl red\n", r"material file 'absent\.mtl' is missing.*put it beside.*material="),
        ("mtllib a.mtl absent.mtl\nusemtl green\n", r"'absent\.mtl' is missing"),
        ("mtllib a.mtl\nusemtl (null)\n", None),
        ("mtllib a.mtl\nusemtl None\n", None),
    ],
)
def test_materials_that_are_missing_are_told(tmp_path, text, said):
    write(tmp_path / "a.mtl", LIBRARY)
    path = write(tmp_path / "a.obj", f"{text}{CORNERS}f 1 2 3\n")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        (mesh,) = pl.load_meshes(path)
        pl.load_meshes(path, material=pl.Lambertian())
    assert mesh.material == pl.Lambertian()
    texts = [str(one.message) for one in caught]
    assert texts == [] if said is None else len(texts) == 1 and re.search(rf"a\.obj: .*{said}", texts[0]), texts


def test_faces_of_different_forms_share_a_mesh(tmp_path):
    """Faces without normals are flat, and those without uv show a texel."""
    text = CORNERS + "vt .5 .5\nvn 0 0 1\nf 1/1 2/1 3/1\nf 1//1 3//1 4//1\nf 1/1/1 2/1/1 3/1/1\nf 1/ 2// 4\n"
    (mesh,) = pl.load_meshes(write(tmp_path / "a.obj", text))
    assert corners_of(mesh)[3].tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert mesh.normals[mesh.faces][:, :, 2].tolist() == [[0] * 3, [1] * 3, [1] * 3, [0] * 3]
    assert mesh.uv[mesh.faces][:, 0].tolist() == [[0.5, 0.5], [0, 0], [0.5, 0.5], [0, 0]]
