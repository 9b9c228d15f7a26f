"""OBJ, PLY and STL files, read by trimesh; its silent losses and errors are corrected or refused."""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Iterator, Mapping
from io import BytesIO
from typing import Any

import numpy as np

from plenoptic.core.color.srgb import srgb_to_linear
from plenoptic.core.files.file_limits import FileReader
from plenoptic.errors import FileError, PlenopticError
from plenoptic.scene.files.file_materials import REPLACE, colour_of, file_texture
from plenoptic.scene.files.obj import obj_material, read_mtl
from plenoptic.scene.geometry.mesh import Mesh, has_area
from plenoptic.scene.materials.diffuse import Lambertian
from plenoptic.scene.materials.registry import Material

_PLY_LISTS = 16
_PARTS = 4000
"""Parts without names of their own: trimesh takes time by their square, here 3 s."""


def trimesh_meshes(
    file_name: str, kind: str, content: bytes, reader: FileReader, scale: float, material: Material | None
) -> Iterator[Mesh]:
    """All that is visible in a file of the kind "obj", "ply" or "stl", whose unit is `scale` mm, in mm.

    Other files that it names are read by `reader`. A material replaces those of the file.
    """
    import trimesh

    materials: Mapping[str, Material] = {}
    if kind == "obj":
        content = _plain_obj(content)
        materials = {} if material is not None else _obj_materials(content, reader)
        if len(materials) < 2:
            _check_parts(len(set(re.findall(rb"^usemtl [^\n]*", content, re.MULTILINE))))
    elif kind == "ply":
        header = _ply_header(content)
        material = _ply_texture(header, reader) if material is None else material
    elif kind == "stl":
        _check_stl(content)
    for key, part in _parts(file_name, kind, content, materials).items():
        visible = isinstance(part, trimesh.Trimesh) and len(part.faces) > 0
        if not visible or not has_area(np.asarray(part.vertices), np.asarray(part.faces)):
            continue
        label = str(getattr(getattr(part.visual, "material", None), "name", None) or "")
        chosen = material
        if chosen is None:
            chosen = materials[label] if label in materials else _vertex_colour(part.visual)
        # trimesh makes up normals when asked for them; only the file's are there before.
        normals = part.vertex_normals if "vertex_normals" in part._cache else None
        uv = getattr(part.visual, "uv", None)
        yield Mesh(scale * part.vertices, part.faces, chosen, normals, uv, key if kind == "obj" else file_name)


class _Names:
    """Substitute for a material file that gives trimesh no more than names, by which it groups the triangles."""

    def __init__(self, file_name: str, names: Mapping[str, Any]) -> None:
        self.file_name = file_name
        self._text = "".join(f"newmtl {name}\nKd 1 1 1\n" for name in names).encode()

    def get(self, name: str) -> bytes:
        return self._text

    __getitem__ = get


def _parts(file_name: str, kind: str, content: bytes, names: Mapping[str, Any]) -> Mapping[str, Any]:
    """Read a mesh by trimesh. It separates vertices that differ in uv or normal, unless told to keep their order."""
    import trimesh

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        # NumPy only warns, and trimesh goes on, where text stops being numbers.
        warnings.filterwarnings("error", message="string or file could not be read")
        resolver: Any = _Names(file_name, names)
        loaded = trimesh.load_scene(BytesIO(content), file_type=kind, resolver=resolver, process=False)
    parts: Mapping[str, Any] = loaded.geometry
    return parts


def _plain_obj(content: bytes) -> bytes:
    """An OBJ file without comments, indents and tabs, which mislead trimesh; refused where others still would."""
    content = content.decode(errors="replace").encode()
    content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n").replace(b"\t", b" ")
    content = re.sub(rb"^ +", b"", content, flags=re.MULTILINE)
    content = re.sub(rb"^((?:(?:f|v|vt|vn) [^#\n]*)?)#[^\n]*", rb"\1", content, flags=re.MULTILINE)
    relative = re.search(rb"^f [^\n]*-\d", content, re.MULTILINE)
    if relative is not None and content.find(b"\nv ", relative.start()) >= 0:
        raise FileError("its faces count vertices backwards while more follow; export with absolute indices")
    if re.search(rb"^f +\d+//", content, re.MULTILINE) and re.search(rb"^f +\d+/\d+(?: |$)", content, re.MULTILINE):
        raise FileError("some of its faces have uv only and some normals only; export all of them alike")
    return content


def _check_stl(content: bytes) -> None:
    """Refuse an STL file that is not whole: trimesh takes a binary one for text, in which it finds nothing."""
    if b"endsolid" in content.lower():
        return _check_parts(content.lower().count(b"endsolid"))
    if content.lstrip().lower().startswith(b"solid") and content.isascii() and b"\0" not in content:
        raise FileError("it is cut off: it has no 'endsolid'; export it again")
    announced = 84 + 50 * int.from_bytes(content[80:84], "little")
    if len(content) != announced:
        raise FileError(
            f"it is cut off, or no STL file: it has {len(content)} bytes instead of {announced}; export it again"
        )


def _said(text: str, keyword: str) -> list[str]:
    """Texts that follow a keyword at the beginning of lines, each once. (A pattern that strips is quadratic.)"""
    lines = (line.split(maxsplit=1) for line in re.findall(rf"^{keyword}[^\n]*", text, re.MULTILINE))
    return list(dict.fromkeys(words[1].rstrip() for words in lines if len(words) > 1 and words[0] == keyword))


def _check_parts(count: int) -> None:
    if count > _PARTS:
        raise FileError(f"it has {count} parts; at most {_PARTS} are read: join them, or write them to several files")


def _obj_materials(content: bytes, reader: FileReader) -> Mapping[str, Material]:
    """The materials that an OBJ file uses and its material files describe."""
    text = content.decode(errors="replace")
    described: dict[str, dict[str, str]] = {}
    for library_name in _said(text, "mtllib"):
        # A name may hold spaces, and a line several names.
        names = library_name.split()
        for name in [library_name] if len(names) < 2 or reader.resolve(library_name).is_file() else names:
            library = reader.resolve(name)
            if not os.path.lexists(library):
                raise FileError(f"its material file {name!r} is missing; put it beside the file, {REPLACE}")
            described |= read_mtl(reader.read(library).decode(errors="replace"))
    used = dict.fromkeys(" ".join(name.split()) for name in _said(text, "usemtl"))
    return {name: obj_material(name, described[name], reader) for name in used if name in described}


def _ply_header(content: bytes) -> str:
    """The text before the data; refused where trimesh would take quadratic time for it."""
    header = content[: content.find(b"end_header")].decode(errors="replace")
    lists = header.count("property list")
    if lists > _PLY_LISTS:
        raise FileError(
            f"its header has {lists} lists; at most {_PLY_LISTS} are read: export triangles and points only"
        )
    return header


def _ply_texture(header: str, reader: FileReader) -> Lambertian | None:
    """The texture that the header of a PLY file names, if it does."""
    said = [[*line.split(maxsplit=1), ""] for line in _said(header, "comment")]
    name = next((words[1] for words in said if words[0].lower() == "texturefile"), "")
    if not name:
        return None
    try:
        return Lambertian(file_texture(reader, name))
    except PlenopticError as error:
        raise FileError(f"its texture cannot be used: {error}, {REPLACE}") from None


def _vertex_colour(visual: Any) -> Lambertian:
    """The one colour of a part without material, sRGB-encoded; grey where it has many or none."""
    if visual.kind not in ("vertex", "face"):
        return Lambertian()
    codes = np.asarray(visual.vertex_colors if visual.kind == "vertex" else visual.face_colors)[:, :3]
    return Lambertian() if np.any(codes != codes[0]) else Lambertian(colour_of(srgb_to_linear(codes[0] / 255)))
