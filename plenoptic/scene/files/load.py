"""Scenes from files."""

from __future__ import annotations

from codecs import BOM_UTF8
from collections.abc import Iterable
from os import PathLike

from plenoptic.core.files.file_limits import DEFAULT, FileLimits, FileReader
from plenoptic.core.values import Given, check_kind, file_path, set_field, value
from plenoptic.errors import FileError, InvalidValueError, PlenopticError
from plenoptic.scene.file_cameras import View
from plenoptic.scene.files.gltf.file import read_gltf
from plenoptic.scene.files.gltf.lights import gltf_lights, gltf_views
from plenoptic.scene.files.gltf.meshes import gltf_meshes
from plenoptic.scene.files.gltf.nodes import placed_nodes
from plenoptic.scene.files.obj_meshes import obj_meshes
from plenoptic.scene.files.ply_meshes import ply_meshes
from plenoptic.scene.files.stl_meshes import stl_meshes
from plenoptic.scene.geometry.instance import Instances
from plenoptic.scene.geometry.mesh import Mesh
from plenoptic.scene.lights.registry import Light
from plenoptic.scene.materials.registry import MATERIALS, Material

UNITS = {"um": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1e3, "km": 1e6, "inch": 25.4, "foot": 304.8}
"""Millimetres in one unit of length."""
ENDINGS = (".glb", ".gltf", ".obj", ".ply", ".stl")


@value
class FileContents:
    """Content of a scene file, in mm.

    Parameters
    ----------
    meshes : sequence of Mesh or Instances
        Its surfaces, in their places; `Instances` where one of many triangles stands in several.
    lights : sequence of PointLight, SpotLight or SunLight
        Its light sources beside surfaces that emit.
    views : sequence of View
        Its cameras.

    Examples
    --------
    >>> import plenoptic as pl
    >>> contents = pl.scene.FileContents([pl.box(4)])
    >>> pl.Scene(contents.meshes, contents.lights)
    Scene(1 mesh, 12 triangles)
    """

    meshes: Given[tuple[Mesh | Instances, ...], Iterable[Mesh | Instances]] = Given(default=())
    lights: Given[tuple[Light, ...], Iterable[Light]] = Given(default=())
    views: Given[tuple[View, ...], Iterable[View]] = Given(default=())

    def __post_init__(self) -> None:
        for name in ("meshes", "lights", "views"):
            set_field(self, name, tuple(getattr(self, name)))


def load_file(
    path: str | PathLike[str],
    *,
    unit: str | None = None,
    material: Material | None = None,
    limits: FileLimits = DEFAULT,
) -> FileContents:
    """Read all that a file holds of a scene.

    Everything stands in its place in the file's scene graph. Normals and texture coordinates are read where the file
    has them, else triangles are flat. Meshes of 1000 triangles or more that stand in several places become `Instances`.

    Materials of glTF files become `MetallicRoughness` with all their textures; `Dielectric` or, without a volume,
    `ThinGlass` where they transmit all light; `Emissive` where they are unlit (KHR_materials_unlit). Sheen, occlusion
    maps, normal maps of clear coats and others beyond these are left out. Normal maps go by the directions of the
    texture; a warning says where a file has tangents that differ. Those of OBJ files are converted by the table of
    `plenoptic.scene.files.obj.obj_material`. Parts without a material take the colours of their vertices or faces, by a
    texture where these vary: OBJ and PLY files have them in sRGB, and reflectances are interpolated between vertices,
    to half a code of 8 bits or with a warning; their opacity is left out. Those of glTF files are linear and multiply
    the material, where it has no textures. All others are grey, `Lambertian(0.5)`, with a warning where an OBJ file
    names a material file or material that is missing, or where facets of an STL file have attributes. Images are
    decoded by their use, sRGB for colours and linear for all other data, whatever they state of themselves, such as a
    PNG's gAMA. Morph targets have the weights of their node, else of their mesh. Concave polygons keep their area.

    Lights (KHR_lights_punctual) and cameras are those of glTF files. The file's candela and lux are taken as scene
    units: irradiance is I / d^2 at the distance d in the file's unit of length.

    Parameters
    ----------
    path : str or path
        A .glb, .gltf, .obj, .ply or .stl file.
    unit : str, optional
        Length of one unit of the file: "um", "mm", "cm", "m", "km", "inch" or "foot". None: "m" for glTF files, whose
        standard says so, and "mm" for all others.
    material : Material, optional
        Replaces all materials of the file, which are not looked at then.
    limits : FileLimits
        Where other files may lie that this one names, and how much it may ask for: by default they lie beside or below
        it, and the scene takes at most 512 MiB, or 256 times its size.

    Raises
    ------
    FileError
        A file that is missing, damaged, of another kind, or with neither triangles nor lights; a texture that is
        missing or not an image; another file that is out of bounds; violations of the glTF standard; a feature that
        would be rendered wrongly. The message names the file.
    InvalidValueError
        An unknown unit.

    References
    ----------
    Wavefront, "Object Files (.obj)", version 4.2 (1995), appendix B1; G. Turk, "The PLY Polygon File Format" (1994);
    Khronos Group, glTF 2.0 Specification (ISO/IEC 12113:2022), and its extensions KHR_lights_punctual,
    KHR_texture_transform, KHR_mesh_quantization, EXT_mesh_gpu_instancing, EXT_texture_webp,
    KHR_materials_clearcoat, _emissive_strength, _ior, _transmission, _unlit and _volume.

    Examples
    --------
    A scene with the lights of its file, seen as its first camera does:

    >>> import plenoptic as pl
    >>> contents = pl.load_file("hall.glb")  # doctest: +SKIP
    >>> scene = pl.Scene(contents.meshes, contents.lights)  # doctest: +SKIP
    >>> contents.views[0].position.tolist()  # doctest: +SKIP
    [0.0, 1700.0, 4000.0]
    """
    contents = _contents(path, unit, material, limits)
    if not contents.meshes and not contents.lights:
        raise FileError(f"{path} holds no triangles that have an area, and no lights; export a mesh")
    return contents


def load_meshes(
    path: str | PathLike[str],
    *,
    unit: str | None = None,
    material: Material | None = None,
    limits: FileLimits = DEFAULT,
) -> tuple[Mesh | Instances, ...]:
    """Read all triangles of a file: the meshes of `load_file`, which see.

    Its parameters and errors are those of `load_file`; a file without triangles is a `FileError`.

    Examples
    --------
    >>> import os, pathlib, tempfile, plenoptic as pl
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "corner.obj"
    ...     _ = path.write_text(os.linesep.join(["v 0 0 0", "v 1 0 0", "v 0 2 0", "f 1 2 3"]))
    ...     meshes = pl.load_meshes(path, unit="cm", material=pl.Lambertian(0.8))
    >>> meshes
    (Mesh('corner.obj', 3 vertices, 1 triangle, Lambertian(albedo=0.8)),)
    >>> meshes[0].bounds[1].tolist()
    [10.0, 20.0, 0.0]
    """
    meshes = _contents(path, unit, material, limits).meshes
    if not meshes:
        raise FileError(f"{path} holds no triangles that have an area; export a mesh")
    return meshes


def _contents(
    path: str | PathLike[str], unit: str | None, material: Material | None, limits: FileLimits
) -> FileContents:
    source = file_path(path)
    check_kind(limits, "limits", FileLimits, "pl.images.FileLimits(memory=2**32)")
    if unit is not None and (not isinstance(unit, str) or unit not in UNITS):
        raise InvalidValueError(f"unit is {unit!r}; it must be one of {', '.join(UNITS)}")
    if material is not None and type(material) not in MATERIALS:
        raise InvalidValueError(f"material is {material!r}; it must be a material or None")
    kind = source.suffix[1:].lower()
    if f".{kind}" not in ENDINGS:
        raise FileError(f"{source} ends in {source.suffix!r}; it must be one of {', '.join(ENDINGS)}, so convert it")
    reader = FileReader(source, limits)
    content = reader.read(source)
    gltf = kind in ("glb", "gltf")
    scale = UNITS[unit] if unit is not None else UNITS["m" if gltf else "mm"]
    try:
        if gltf:
            file = read_gltf(content, kind, reader)
            nodes = placed_nodes(file)
            meshes = gltf_meshes(nodes, file, scale, material, source.name)
            return FileContents(meshes, gltf_lights(nodes, file, scale), gltf_views(nodes, file, scale))
        content = content.removeprefix(BOM_UTF8)
        if kind == "stl":
            return FileContents(stl_meshes(source.name, content, scale, material))
        meshes_of = obj_meshes if kind == "obj" else ply_meshes
        return FileContents(meshes_of(source.name, content, reader, scale, material))
    except PlenopticError as error:
        raise FileError(f"{source}: {error}") from error
    except ImportError as error:  # trimesh asks for another package where an STL file is not UTF-8
        raise FileError(f"{source} is cut off, or holds text that is not UTF-8; export it again") from error
    except Exception as error:  # plyfile, trimesh, json and NumPy raise whatever the damage leads to
        raise FileError(
            f"{source} cannot be read as .{kind} ({error or type(error).__name__}); export it again"
        ) from error
