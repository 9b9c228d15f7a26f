"""Open files of any kind that the package knows, by their endings and contents."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from plenoptic.errors import FileError

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.rendering.exposure import Exposure
    from plenoptic.rendering.settings import RenderSettings
    from plenoptic.scene.scene import Scene

Kind = TypeVar("Kind")


class OpenFile(NamedTuple):
    """A file that has been read."""

    kind: str
    """In words, such as "an image"."""
    content: Any
    """An Exposure, RawImage, Package, LightField, LensStack, FileContents, any value that `save_value` wrote, or the
    Path of a zarr store, which may be large and is not read."""


def open_file(name: str) -> OpenFile:
    """Open a file or folder, or a lens that comes with the package; FileError if it is none of these."""
    from plenoptic.optics.lens.files.library import lens_names, load_lens
    from plenoptic.scene.files.load import ENDINGS, load_file

    path = Path(name)
    if not path.exists():
        if name in lens_names():
            return OpenFile("a lens that comes with the package", load_lens(name))
        raise FileError(f"{name!r} does not exist; check the path")
    if path.is_dir():
        return _open_folder(path)
    readers = {
        **dict.fromkeys((".exr", ".tif", ".tiff", ".png"), _open_image),
        **dict.fromkeys((".csv", ".seq", ".txt", ".zmx"), lambda file: OpenFile("a lens", load_lens(file))),
        **dict.fromkeys(ENDINGS, lambda file: OpenFile("a scene", load_file(file))),
        ".json": _open_json,
        ".zip": _open_package,
    }
    ending = path.suffix.lower()
    if ending not in readers:
        raise FileError(f"{name!r} ends in {ending!r}; files that can be opened end in {', '.join(sorted(readers))}")
    return readers[ending](path)


def load_scene(name: str, background: float | None = None, unit: str | None = None) -> Scene:
    """The scene of a file, as `Scene.load` reads it."""
    from plenoptic.scene.files.load import ENDINGS
    from plenoptic.scene.scene import Scene

    if Path(name).exists() and Path(name).suffix.lower() not in ENDINGS:
        raise FileError(f"{name!r} is {open_file(name).kind}; give a scene, such as a glTF or OBJ file")
    return Scene.load(name, unit=unit, background=background)


def load_settings(name: str) -> RenderSettings:
    """The settings of a file."""
    from plenoptic.rendering.settings import RenderSettings

    return _load(name, RenderSettings, "RenderSettings that pl.package.save_value wrote")


def load_camera(name: str) -> PlenopticCamera:
    """The camera of a file, or of an image, store or package."""
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.core.files.serialization import fields_from_metadata
    from plenoptic.core.files.zarr_files import attributes_of

    kind, content = open_file(name)
    camera = content if isinstance(content, PlenopticCamera) else getattr(content, "camera", None)
    if isinstance(content, Path):
        camera = fields_from_metadata(attributes_of(content) or {}, ("camera",)).get("camera")
    if not isinstance(camera, PlenopticCamera):
        raise FileError(f"{name!r} is {kind} and holds no camera; give one that pl.package.save_value wrote")
    return camera


def _load(name: str, wanted: type[Kind], remedy: str) -> Kind:
    kind, content = open_file(name)
    if not isinstance(content, wanted):
        raise FileError(f"{name!r} is {kind}; give {remedy}")
    return content


def exposure_of(file: OpenFile) -> Exposure | None:
    """The exposure of an image, a store or a package; None if it is something else."""
    from plenoptic.package.reading import Package
    from plenoptic.rendering.exposure import Exposure

    content = file.content.exposure if isinstance(file.content, Package) else file.content
    if isinstance(content, Path):
        content = Exposure.load(content)
    return content if isinstance(content, Exposure) else None


def _open_folder(path: Path) -> OpenFile:
    from plenoptic.core.files.zarr_files import METADATA, attributes_of
    from plenoptic.dataset.contents import MANIFEST, read
    from plenoptic.package.reading import PROVENANCE
    from plenoptic.rendering.exposure_files import EXPOSURE, KIND, SEQUENCE

    kinds = {EXPOSURE: "an exposure in a zarr store", SEQUENCE: "a sequence of exposures in a zarr store"}
    if (attributes := attributes_of(path)) is not None:
        return OpenFile(kinds.get(str(attributes.get(KIND)), "a zarr store of another origin"), path)
    if (path / "parameters.cfg").is_file():
        from plenoptic.lightfield.reading import read_hci

        return OpenFile("a light field of the HCI benchmark's form", read_hci(path))
    if (path / PROVENANCE).is_file():
        return _open_package(path)
    if (path / MANIFEST).is_file():
        return OpenFile("a data set", read(path))
    raise FileError(
        f"{str(path)!r} is no folder that can be opened: a package has a {PROVENANCE}, a data set a {MANIFEST}, a "
        "light field of the HCI benchmark's form has parameters.cfg, a zarr store "
        f"{METADATA}; give one of them, or a file"
    )


def _open_package(path: Path) -> OpenFile:
    from plenoptic.package.reading import read

    return OpenFile("a package", read(path))


def _open_image(path: Path) -> OpenFile:
    from plenoptic.core.files.images import read_channels
    from plenoptic.readout.raw import RawImage
    from plenoptic.rendering.exposure import Exposure

    if path.suffix.lower().startswith(".tif") and "plenoptic:model" in read_channels(path)[1]:
        return OpenFile("a raw image of a sensor", RawImage.load(path))
    return OpenFile("an image", Exposure.load(path))


def _open_json(path: Path) -> OpenFile:
    from plenoptic.core.files.file_limits import read_file
    from plenoptic.core.files.serialization import FORMAT, load_value
    from plenoptic.optics.lens.files.library import load_lens

    try:
        head = json.loads(read_file(path))
    except (ValueError, RecursionError) as error:
        raise FileError(f"{str(path)!r} is not JSON: {error}") from None
    if isinstance(head, dict) and head.get("format") == FORMAT:
        value = load_value(path)
        return OpenFile(f"a value of the kind {type(value).__name__}", value)
    return OpenFile("a lens", load_lens(path))
