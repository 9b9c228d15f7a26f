"""Meshes from files: what trimesh reads, with what it would lose or get wrong in silence made good or refused."""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from plenoptic._values import file_path
from plenoptic.errors import FileError, InvalidValueError, PlenopticError
from plenoptic.scene.material import Emissive, Lambertian, Material, gltf_material, obj_material
from plenoptic.scene.mesh import Mesh, has_area
from plenoptic.scene.texture import Texture

UNITS = {"um": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1e3, "km": 1e6, "inch": 25.4, "foot": 304.8}
"""Millimetres in one unit of length."""
ENDINGS = (".glb", ".gltf", ".obj", ".ply", ".stl")

_REPLACE = "replace all materials by material="
_FLOAT32 = 5126
_TRIANGLE_FAN = 6
# Extensions that a glTF file may require and that change colours at most, which `gltf_material` looks after.
_HARMLESS = ("KHR_materials", "KHR_texture_transform", "EXT_texture_webp", "KHR_lights_punctual")


def load_meshes(
    path: str | PathLike[str], *, unit: str | None = None, material: Material | None = None
) -> tuple[Mesh, ...]:
    """Read all triangles of a file, one mesh for each part of it, in its place in the file's scene graph.

    Normals and texture coordinates are read where the file has them; triangles are flat where it has no normals.
    Materials become the nearest of what can be rendered: a base or diffuse colour, times its texture, becomes
    `Lambertian`, metals included; emitted light becomes `Emissive`; a part that has a single colour and no material
    takes that; all others are grey, `Lambertian(0.5)`. Textures repeat, transparency is left out. Parts without
    area, points, lines, cameras and light sources without surface are left out too.

    Parameters
    ----------
    path : str or path
        A .glb, .gltf, .obj, .ply or .stl file.
    unit : str, optional
        Length of one unit of the file: "um", "mm", "cm", "m", "km", "inch" or "foot". None: "m" for glTF files, whose
        standard says so, and "mm" for all others.
    material : Lambertian, Emissive or None
        Replaces all materials of the file, which are not looked at then.

    Returns
    -------
    tuple of Mesh

    Raises
    ------
    FileError
        A file that is missing, damaged, of another kind or without triangles; a material file or texture that is
        missing or not an image; a feature that would be rendered wrongly. The message names the file.
    InvalidValueError
        An unknown unit.

    Examples
    --------
    >>> import os, pathlib, tempfile
    >>> import plenoptic as pl
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "corner.obj"
    ...     _ = path.write_text(os.linesep.join(["v 0 0 0", "v 1 0 0", "v 0 2 0", "f 1 2 3"]))
    ...     meshes = pl.load_meshes(path, unit="cm", material=pl.Lambertian(0.8))
    >>> meshes
    (Mesh('corner.obj', 3 vertices, 1 triangle, Lambertian(albedo=0.8)),)
    >>> meshes[0].bounds[1].tolist()
    [10.0, 20.0, 0.0]
    """
    source = file_path(path)
    if unit is not None and (not isinstance(unit, str) or unit not in UNITS):
        raise InvalidValueError(f"unit is {unit!r}; it must be one of {', '.join(UNITS)}")
    if material is not None and not isinstance(material, Lambertian | Emissive):
        raise InvalidValueError(f"material is {material!r}; it must be Lambertian, Emissive or None")
    if not source.is_file():
        raise FileError(f"{source} is {'a folder' if source.is_dir() else 'missing'}; give the path of a mesh file")
    kind = source.suffix[1:].lower()
    if f".{kind}" not in ENDINGS:
        raise FileError(f"{source} ends in {source.suffix!r}; it must be one of {', '.join(ENDINGS)}, so convert it")
    try:
        content = source.read_bytes()
    except OSError as error:
        raise FileError(f"{source} cannot be opened ({error.strerror}); check the rights to read it") from error
    scale = UNITS[_standard_unit(kind) if unit is None else unit]
    try:
        meshes = tuple(_parts(source, kind, content, scale, material))
    except PlenopticError as error:
        raise FileError(f"{source}: {error}") from error
    except ImportError as error:  # trimesh asks for another package where text is not UTF-8
        raise FileError(f"{source} is cut off, or holds text that is not UTF-8; export it again") from error
    except Exception as error:  # trimesh and what it calls raise whatever the damage leads to
        raise FileError(
            f"{source} cannot be read as .{kind} ({error or type(error).__name__}); export it again"
        ) from error
    if not meshes:
        raise FileError(f"{source} holds no triangles that have an area; export a mesh")
    return meshes


def _standard_unit(kind: str) -> str:
    return "m" if kind in ("glb", "gltf") else "mm"


def _parts(source: Path, kind: str, content: bytes, scale: float, material: Material | None) -> Iterator[Mesh]:
    """All that is visible, in mm, in the frame of the file."""
    import trimesh

    described: Sequence[Mapping[str, Any]] = ()
    images: Mapping[str, str | None] = {}
    if kind in ("glb", "gltf"):
        described, content = _with_numbered_materials(content, kind)
    elif kind == "obj":
        content = _plain_obj(content)
        images = {} if material is not None else _obj_images(content, source.parent)
    elif kind == "ply" and material is None:
        material = _ply_texture(content, source.parent)
    loaded = _scene(source, kind, content)
    if images and not any(_label(part) in images for part in loaded.geometry.values()):
        raise FileError(f"its material file cannot be understood; correct it, or {_REPLACE}")
    known: dict[str, Material] = {}
    for node in loaded.graph.nodes_geometry:
        matrix, key = loaded.graph[node]
        matrix = np.diag([scale, scale, scale, 1.0]) @ matrix
        part = loaded.geometry[key]
        visible = isinstance(part, trimesh.Trimesh) and len(part.faces) > 0 and np.linalg.det(matrix[:3, :3]) != 0
        if not visible or not has_area(np.asarray(part.vertices), np.asarray(part.faces)):
            continue
        label = _label(part)
        if material is not None:
            chosen = material
        elif label in known:
            chosen = known[label]
        elif label in images:
            chosen = known[label] = obj_material(part.visual.material, images[label])
        elif described and label:
            chosen = known[label] = gltf_material(described[int(label)], part.visual.material)
        else:
            chosen = _coloured(part.visual, encoded=kind not in ("glb", "gltf"))
        # trimesh makes up normals when asked for them; only the file's are there before.
        normals = part.vertex_normals if "vertex_normals" in part._cache else None
        uv = getattr(part.visual, "uv", None)
        name = source.name if kind in ("ply", "stl") else str(key)
        yield Mesh(part.vertices, part.faces, chosen, normals, uv, name).transformed(matrix)


def _scene(source: Path, kind: str, content: bytes) -> Any:
    """What trimesh reads. It keeps vertices apart that differ in uv or normal, unless told to maintain their order."""
    import trimesh

    resolver = trimesh.resolvers.FilePathResolver(str(source))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        # NumPy only warns, and trimesh goes on, where text stops being numbers.
        warnings.filterwarnings("error", message="string or file could not be read")
        return trimesh.load_scene(BytesIO(content), file_type=kind, resolver=resolver, process=False)


def _label(part: Any) -> str:
    """The name of the part's material; empty where it has none."""
    return str(getattr(getattr(part.visual, "material", None), "name", None) or "")


def _with_numbered_materials(content: bytes, kind: str) -> tuple[Sequence[Mapping[str, Any]], bytes]:
    """The materials as a glTF file describes them, and the file with their numbers in place of their names.

    Cameras are taken out: trimesh drops what hangs on them.
    """
    if kind == "glb" and content[:4] != b"glTF":
        raise FileError("it is no binary glTF file, whatever its name says; export it again")
    end = 20 + int.from_bytes(content[12:16], "little")
    header = json.loads(content[20:end] if kind == "glb" else content)
    needed = [e for e in header.get("extensionsRequired", ()) if not e.startswith(_HARMLESS)]
    if needed:
        raise FileError(f"it needs the extensions {', '.join(needed)}, which are not read; export without them")
    for primitive in (p for mesh in header.get("meshes", ()) for p in mesh["primitives"]):
        _check_primitive(primitive, header["accessors"])
    for node in header.get("nodes", ()):
        node.pop("camera", None)
    described = header.get("materials", [])
    header["materials"] = [{**material, "name": str(number)} for number, material in enumerate(described)]
    text = json.dumps(header).encode()
    if kind == "gltf":
        return described, text
    text += b" " * (-len(text) % 4)
    rest = content[end:]
    lengths = [(20 + len(text) + len(rest)).to_bytes(4, "little"), len(text).to_bytes(4, "little")]
    return described, content[:8] + b"".join(lengths) + content[16:20] + text + rest


def _check_primitive(primitive: Mapping[str, Any], accessors: Sequence[Mapping[str, Any]]) -> None:
    """Refuse what trimesh would read wrongly or leave out in silence."""
    if primitive.get("mode") == _TRIANGLE_FAN:
        raise FileError("it holds triangle fans, which are not read; export triangles")
    attributes = primitive["attributes"]
    for name in {"POSITION", "NORMAL", "TEXCOORD_0"} & set(attributes):
        if accessors[attributes[name]]["componentType"] != _FLOAT32:
            raise FileError(f"its {name} are not float32; export without quantisation")
        if "sparse" in accessors[attributes[name]]:
            raise FileError(f"its {name} are sparse, which are not read; export without sparse accessors")


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


def _obj_images(content: bytes, folder: Path) -> Mapping[str, str | None]:
    """The materials that an OBJ file uses and its material file describes, with the image that each names."""
    text = content.decode(errors="replace")
    libraries = set(re.findall(r"^mtllib\s+(.+?)\s*$", text, re.MULTILINE))
    if not libraries:
        return {}
    if len(libraries) > 1:
        raise FileError(f"it names {len(libraries)} material files; join them, or {_REPLACE}")
    library = folder / libraries.pop()
    if not library.is_file():
        raise FileError(f"its material file {library.name!r} is missing; put it beside the file, or {_REPLACE}")
    images: dict[str, str | None] = {}
    material = ""
    for line in library.read_text(errors="replace").splitlines():
        word, *rest = line.split(maxsplit=1)[:2] or [""]
        said = " ".join(rest).strip()
        if word.lower() == "newmtl":
            material = " ".join(said.split())
            images[material] = None
        elif word.lower() == "map_kd":
            images[material] = said
    used = set(re.findall(r"^usemtl\s+(.+?)\s*$", text, re.MULTILINE))
    return {name: image for name, image in images.items() if name in used}


def _ply_texture(content: bytes, folder: Path) -> Lambertian | None:
    """The texture that the header of a PLY file names, if it does."""
    header = content[: content.find(b"end_header")].decode(errors="replace")
    named = re.search(r"^comment\s+texturefile\s+(.+?)\s*$", header, re.MULTILINE | re.IGNORECASE)
    if named is None:
        return None
    try:
        return Lambertian(Texture.load(folder / named[1]))
    except PlenopticError as error:
        raise FileError(f"its texture cannot be used: {error}, or {_REPLACE}") from None


def _coloured(visual: Any, *, encoded: bool) -> Lambertian:
    """The one colour of a part without material, sRGB-encoded outside glTF files; grey where it has many or none."""
    from plenoptic import images

    if visual.kind not in ("vertex", "face"):
        return Lambertian()
    codes = np.asarray(visual.vertex_colors if visual.kind == "vertex" else visual.face_colors)[:, :3]
    if np.any(codes != codes[0]):
        return Lambertian()
    colour = codes[0] / 255
    return Lambertian(tuple(images.srgb_to_linear(colour) if encoded else colour))
