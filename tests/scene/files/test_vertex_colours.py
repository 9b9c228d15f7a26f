"""Colours of vertices and faces as textures, looked up here by the definition of `Texture`."""

import warnings

import numpy as np
import pytest
from scene_helpers import POINTS, Writer

import plenoptic as pl
from plenoptic.errors import FileWarning
from plenoptic.scene.files import vertex_colours

HALF_A_CODE = 1 / 510
RGB = [(255, 0, 0), (0, 255, 0), (0, 0, 255)]
WEIGHTS = np.random.default_rng(2).dirichlet((0.5, 0.5, 0.5), 200)
"""Barycentric coordinates, many of them near the edges."""


def decode(codes):
    """IEC 61966-2-1, of codes from 0 to 255."""
    c = np.asarray(codes) / 255
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def looked_up(texels, uv):
    """(n, 3): bilinear interpolation between the centres of texels, whose row 0 is the top."""
    rows, columns = texels.shape[:2]
    x, y = uv[:, 0] * columns - 0.5, (1 - uv[:, 1]) * rows - 0.5
    i, j = (np.clip(np.floor(at), 0, n - 2).astype(int) for at, n in ((x, columns), (y, rows)))
    s, t = (x - i)[:, None], (y - j)[:, None]
    upper, lower = ((1 - s) * texels[k, i] + s * texels[k, i + 1] for k in (j, j + 1))
    return (1 - t) * upper + t * lower


def largest_error(mesh, texture, corner_colours):
    """Largest difference of looked up colours from those interpolated between corners (m, 3, 3), of all triangles."""
    pairs = zip(mesh.uv[mesh.faces], corner_colours, strict=True)
    return max(np.abs(looked_up(texture.texels, WEIGHTS @ uv) - WEIGHTS @ colours).max() for uv, colours in pairs)


def ply(path, vertices, faces, codes, *, of_faces=False):
    """An ASCII file with codes for its vertices or for its faces."""
    colours = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    head = f"ply\nformat ascii 1.0\nelement vertex {len(vertices)}\n" + "".join(f"property float {c}\n" for c in "xyz")
    head += f"{'' if of_faces else colours}element face {len(faces)}\nproperty list uchar int vertex_indices\n"
    head += f"{colours if of_faces else ''}end_header\n"
    rows = [[*row, *code] for row, code in zip(vertices, codes, strict=True)] if not of_faces else vertices
    lists = [[len(face), *face, *(codes[k] if of_faces else ())] for k, face in enumerate(faces)]
    path.write_text(head + "".join(" ".join(map(str, row)) + "\n" for row in [*rows, *lists]))
    return path


def silent(path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return pl.load_meshes(path, unit="mm")


def test_colours_of_vertices_are_interpolated_between_reflectances(tmp_path):
    rng = np.random.default_rng(1)
    places = rng.normal(size=(12, 3)).round(3)
    faces = np.array([rng.choice(12, 3, replace=False) for _ in range(19)])
    for codes, texels, tolerance in (
        # Alike: b + c - a is a reflectance for each triangle, and four texels are exact but for float32.
        (rng.integers(140, 180, (12, 3)), 10 * 8, 1e-6),
        (rng.integers(0, 256, (12, 3)), None, HALF_A_CODE),
        (rng.choice([0, 255], (12, 3)), None, HALF_A_CODE),
    ):
        (mesh,) = silent(ply(tmp_path / "a.ply", places, faces, codes))
        texture = mesh.material.albedo
        assert texels is None or texture.texels.shape[0] * texture.texels.shape[1] == texels
        np.testing.assert_array_equal(mesh.vertices[mesh.faces], np.float32(places)[faces])
        assert largest_error(mesh, texture, decode(codes)[faces]) < tolerance


def test_pure_colours_meet_in_a_triangle(tmp_path):
    """b + c - a is -1 in one channel or another, whatever corner is a: 2 x 2 texels are off by 1/4."""
    lines = [f"v {x} {y} 0 {r} {g} {b}\n" for (x, y), (r, g, b) in zip([(0, 0), (1, 0), (0, 1)], RGB, strict=True)]
    (tmp_path / "a.obj").write_text("".join(lines) + "f 1 2 3\n")
    for path in (ply(tmp_path / "a.ply", np.eye(3), [(0, 1, 2)], RGB), tmp_path / "a.obj"):
        (mesh,) = silent(path)
        assert largest_error(mesh, mesh.material.albedo, np.eye(3)[None]) < HALF_A_CODE
        corners = looked_up(mesh.material.albedo.texels, mesh.uv[mesh.faces[0]])
        np.testing.assert_allclose(corners, np.eye(3), atol=1e-12)


@pytest.mark.filterwarnings("ignore:.*in none of its material files")
def test_too_many_texels_are_not_made_and_the_error_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(vertex_colours, "_TEXELS", 8)
    with pytest.warns(FileWarning, match=r"a\.ply: interpolated colours are off by up to 0\.25 in 1 of 2 triangles"):
        (mesh,) = pl.load_meshes(ply(tmp_path / "a.ply", np.eye(3), [(0, 1, 2), (0, 2, 2)], RGB))
    assert mesh.material.albedo.texels.shape == (2, 4, 3)
    # All meshes of a file share them: 129 x 129 for the first.
    monkeypatch.setattr(vertex_colours, "_TEXELS", 129 * 129)
    lines = [f"v {r} {g} {b} {r} {g} {b}\n" for r, g, b in np.eye(3)]
    (tmp_path / "a.obj").write_text("".join(lines) + "f 1 2 3\nusemtl other\nf 1 3 2\n")
    with pytest.warns(FileWarning, match=r"a\.obj: interpolated colours are off by up to 0\.25 in 1 of 1 triangles"):
        meshes = pl.load_meshes(tmp_path / "a.obj")
    assert [len(mesh.material.albedo.texels) for mesh in meshes] == [129, 2]


def test_a_face_has_one_colour_and_polygons_have_theirs(tmp_path):
    places = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0)]
    (mesh,) = silent(
        ply(tmp_path / "a.ply", places, [(0, 1, 2, 3), (1, 4, 2)], [(188, 0, 255), (0, 99, 1)], of_faces=True)
    )
    colours = decode([(188, 0, 255), (188, 0, 255), (0, 99, 1)])
    assert largest_error(mesh, mesh.material.albedo, np.repeat(colours[:, None], 3, axis=1)) < 1e-6
    np.testing.assert_array_equal(mesh.vertices[mesh.faces[2]], np.array(places, dtype=float)[[1, 4, 2]])


def test_colours_of_a_gltf_are_linear_and_multiply_its_material(tmp_path):
    colours, factor = [(0.5, 0.25, 1), (0.5, 0.5, 0.75), (0.25, 0.5, 1), (0.25, 0.25, 2.0)], (0.5, 1.0, 0.8)
    material = {"pbrMetallicRoughness": {"baseColorFactor": [*factor, 1], "roughnessFactor": 0.5}}
    unlit = {"extensions": {"KHR_materials_unlit": {}}, **material}
    expected = np.clip(colours, 0, 1)[[[0, 1, 2], [0, 2, 3]]]
    for described, field, times in (
        (material, "base", factor),
        (unlit, "radiance", factor),
        (None, "albedo", (1, 1, 1)),
    ):
        writer = Writer()
        more = {} if described is None else {"materials": [described]}
        number = writer.mesh(POINTS, [[0, 1, 2], [0, 2, 3]], described and 0, COLOR_0=writer.array(colours))
        writer.node(mesh=number)
        (mesh,) = silent(writer.save(tmp_path / "a.gltf", **more))
        assert largest_error(mesh, getattr(mesh.material, field), expected * times) < 1e-6
        assert described is not material or mesh.material.roughness == 0.5


def test_colours_that_cannot_be_shown_are_told(tmp_path):
    corners = ["v 0 0 0", "v 1 0 0", "v 0 1 0"]
    for colours, said in (
        (("0 0 0", "0 nan 0", "1 1 1"), "are not all within 0 and 1"),
        (("0 0 0", "0 -1 0", "255 1 1"), "are not all within 0 and 255"),
        (("0 0 0", "", "1 1 1"), "which only some of its vertices have"),
    ):
        lines = [f"{corner} {colour}\n" for corner, colour in zip(corners, colours, strict=True)]
        (tmp_path / "a.obj").write_text("".join(lines) + "f 1 2 3\n")
        with pytest.warns(FileWarning, match=rf"a\.obj: .*left out.*{said}"):
            assert pl.load_meshes(tmp_path / "a.obj")[0].material == pl.Lambertian()
    attributes = {"normal": np.float32([0, 0, 1]), "corners": np.float32([(0, 0, 0), (1, 0, 0), (0, 1, 0)])}
    triangle = attributes["normal"].tobytes() + attributes["corners"].tobytes()
    (tmp_path / "a.stl").write_bytes(bytes(80) + b"\1\0\0\0" + triangle + b"\x1f\x80")
    with pytest.warns(FileWarning, match=r"a\.stl: the attributes of its facets, which some programs use for colours"):
        assert pl.load_meshes(tmp_path / "a.stl")[0].material == pl.Lambertian()
