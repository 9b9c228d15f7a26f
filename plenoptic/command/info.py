"""Describe a file, or, without one, versions and processor."""

from __future__ import annotations

import argparse
import importlib.metadata
import platform
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from plenoptic import __version__
from plenoptic.command.open_file import open_file

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.optics.lens.stack import LensStack
    from plenoptic.rendering.exposure import Exposure
    from plenoptic.scene.files.load import FileContents

_LIBRARIES = (
    "numpy",
    "numba",
    "llvmlite",
    "embreex",
    "OpenImageIO",
    "trimesh",
    "plyfile",
    "mapbox_earcut",
    "pillow",
    "matplotlib",
)


def fill_parser(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    text = "image (EXR, TIFF, PNG, zarr), package (folder, zip), data set (folder), camera (JSON), lens (JSON, CSV, "
    text += "Zemax, or the name of a bundled one), scene (glTF, OBJ, PLY, STL) or folder of a light field"
    parser.add_argument("file", metavar="FILE", nargs="?", help=text)


def run(options: argparse.Namespace) -> None:
    """Print the description."""
    if options.file is None:
        print("\n".join(_installation()))
        return
    file = open_file(options.file)
    print("\n".join([f"{options.file}: {file.kind}", *_lines(file.content)]))


def _installation() -> list[str]:
    from plenoptic.core.numba.jit import processor
    from plenoptic.core.numba.kernel_cache import writable_folder
    from plenoptic.core.parallel import thread_count
    from plenoptic.optics.lens.files.library import lens_names

    versions = []
    for name in _LIBRARIES:
        try:
            versions.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            versions.append(f"no {name}")
    folder = writable_folder()
    if folder is None:
        cache = "nowhere: it cannot be written"
    else:
        sizes = [file.stat().st_size for file in folder.glob("*.nbc")]
        cache = f"{folder} ({len(sizes)} kernels, {sum(sizes) / 1e6:.0f} MB)"
    return [
        f"plenoptic {__version__}, Python {platform.python_version()}, {platform.platform()}",
        ", ".join(versions),
        f"processor: {processor()}, {thread_count(None)} threads",
        f"compiled code: {cache}",
        f"lenses: {', '.join(lens_names())}",
    ]


def _lines(content: Any) -> list[str]:
    """Text representation and key numbers, by the class of the content."""
    lines: dict[str, Callable[[Any], list[str]]] = {
        "PlenopticCamera": lambda camera: [str(camera.report())],
        "LensStack": _lens_lines,
        "FileContents": _scene_lines,
        "Package": lambda package: [str(package), "", *_image_lines(package.exposure)],
        "Exposure": _image_lines,
        "LightField": lambda field: [str(field), f"disparity 0 at z = {field.z_focus:.6g} mm"],
    }
    if isinstance(content, Path):
        return _store_lines(content)
    return lines.get(type(content).__name__, lambda content: [str(content)])(content)


def _store_lines(path: Path) -> list[str]:
    """Arrays and metadata of a store; no pixel is read."""
    from plenoptic.core.files.serialization import fields_from_metadata
    from plenoptic.core.files.zarr_files import attributes_of, summarize_store

    arrays, size = summarize_store(path)
    metadata = fields_from_metadata(attributes_of(path) or {}, ("samples", "replicates", "seed", "region", "camera"))
    camera = metadata.pop("camera", None)
    facts = [f"{size / 1e6:.3g} MB", *(f"{name} {fact}" for name, fact in metadata.items())]
    return [", ".join(facts), *(f"{name} {text}" for name, text in arrays.items()), *_report(camera)]


def _report(camera: PlenopticCamera | None) -> list[str]:
    return [] if camera is None else ["", str(camera.report())]


def _image_lines(exposure: Exposure) -> list[str]:
    import numpy as np

    low, middle, high = np.nanpercentile(exposure.image, [0, 50, 100])
    return [str(exposure), f"values {low:.4g} to {high:.4g}, median {middle:.4g}", *_report(exposure.camera)]


def _lens_lines(lens: LensStack) -> list[str]:
    from plenoptic.optics.lens.gaussian.paraxial import cardinal_points

    points = cardinal_points(lens)
    return [
        str(lens),
        f"focal length {points.efl:.6g} mm, f/{points.f_number:.3g}, back focal length {points.bfl:.6g} mm at "
        f"{points.wavelength:g} nm",
        *map(str, lens.check()),
    ]


def _scene_lines(contents: FileContents) -> list[str]:
    from plenoptic.scene.geometry.instance import Instances
    from plenoptic.scene.scene import Scene

    if not (contents.meshes or contents.lights):
        return ["no meshes and no lights"]
    scene = Scene(contents.meshes, contents.lights)
    lines = [str(scene)]
    if scene.bounds is not None:
        low, high = scene.bounds
        size = " x ".join(f"{length:.4g}" for length in high - low)
        lines.append(
            f"{size} mm, from ({low[0]:.4g}, {low[1]:.4g}, {low[2]:.4g}) to "
            f"({high[0]:.4g}, {high[1]:.4g}, {high[2]:.4g})"
        )
    parts = [part.mesh if isinstance(part, Instances) else part for part in scene.meshes]
    kinds = {type(part.material).__name__ for part in parts}
    return [*lines, *([f"materials: {', '.join(sorted(kinds))}"] if kinds else []), *map(str, contents.views)]
