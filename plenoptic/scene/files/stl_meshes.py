"""The meshes of STL files, read by trimesh."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from io import BytesIO

import numpy as np

from plenoptic.core.warn import warn
from plenoptic.errors import FileError, FileWarning
from plenoptic.scene.geometry.mesh import Mesh, has_area
from plenoptic.scene.materials.diffuse import Lambertian
from plenoptic.scene.materials.registry import Material

_PARTS = 4000
"""Parts without names of their own: trimesh takes time by their square, here 3 s."""

_NAMES = re.compile(rb"(?im)^([ \t]*(?:end)?solid\b)(?:(?!facet\s+normal)[^\n])*")


def stl_meshes(file_name: str, content: bytes, scale: float, material: Material | None) -> Iterator[Mesh]:
    """The meshes of an STL file whose unit is `scale` mm, in mm, of a material or grey."""
    import trimesh

    content = _whole_stl(file_name, content)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        # NumPy only warns, and trimesh goes on, where text stops being numbers.
        warnings.filterwarnings("error", message="string or file could not be read")
        parts = trimesh.load_scene(BytesIO(content), file_type="stl", process=False).geometry
    for part in parts.values():
        if isinstance(part, trimesh.Trimesh) and has_area(np.asarray(part.vertices), np.asarray(part.faces)):
            # trimesh makes up normals when asked for them; only the file's are there before.
            normals = part.vertex_normals if "vertex_normals" in part._cache else None
            if material is None and np.any(part.face_attributes.get("stl", 0)):
                said = "the attributes of its facets, which some programs use for colours, are left out"
                warn(f"{file_name}: {said}", FileWarning)
            chosen = Lambertian() if material is None else material
            yield Mesh(scale * part.vertices, part.faces, chosen, normals, name=file_name)


def _whole_stl(file_name: str, content: bytes) -> bytes:
    """An STL file as trimesh reads it: a text without names, in which it looks for keywords; a binary one cut to size.

    A `FileError` for a file that is not whole.
    """
    announced = 84 + 50 * int.from_bytes(content[80:84], "little")
    if b"endsolid" in content.lower() and len(content) != announced:
        text = _NAMES.sub(rb"\1", content.replace(b"\r\n", b"\n").replace(b"\r", b"\n"))
        count = text.lower().count(b"endsolid")
        if count > _PARTS:
            raise FileError(f"it has {count} parts; at most {_PARTS} are read: join them, or write several files")
        return text
    if content.lstrip().lower().startswith(b"solid") and content.isascii() and b"\0" not in content:
        raise FileError("it is cut off: it has no 'endsolid'; export it again")
    if len(content) < announced:
        raise FileError(
            f"it is cut off, or no STL file: it has {len(content)} bytes instead of {announced}; export it again"
        )
    if len(content) > announced:
        warn(f"{file_name}: {len(content) - announced} bytes behind its last triangle are left out", FileWarning)
    return content[:announced]
