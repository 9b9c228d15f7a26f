"""What files are: opened by what they hold, as far as that is of this package."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from plenoptic.errors import FileError

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.rendering.exposure import Exposure
    from plenoptic.rendering.settings import RenderSettings
    from plenoptic.scene.scene import Scene

PICTURES = (".exr", ".tif", ".tiff", ".png")
LENSES = (".csv", ".zmx")


class Opened(NamedTuple):
    """What a file holds."""

    kind: str
    """In words."""
    content: Any
    """An Exposure, RawImage, Package, LightField, LensStack, FileContents, any value that `save_value` wrote, or the
    Path of a zarr store, which may be large and is not read."""


def opened(name: str) -> Opened:
    """Open a file or folder, or a lens that comes with the package; FileError where it is nothing of these."""
    from plenoptic.optics.lens.files.library import lens_names, load_lens
    from plenoptic.scene.files.load import ENDINGS, load_file

    path = Path(name)
    if not path.exists():
        if name in lens_names():
            return Opened("a lens that comes with the package", load_lens(name))
        raise FileError(f"{name!r} does not exist; check the path")
    if path.is_dir():
        return _folder(path)
    ending, readers = path.suffix.lower(), dict[str, Callable[[Path], Opened]]()
    readers |= dict.fromkeys(PICTURES, _picture) | {".json": _json, ".zip": _package}
    readers |= dict.fromkeys(LENSES, lambda file: Opened("a lens", load_lens(file)))
    readers |= dict.fromkeys(ENDINGS, lambda file: Opened("a scene", load_file(file)))
    if ending not in readers:
        raise FileError(f"{name!r} ends in {ending!r}; what can be opened ends in {', '.join(sorted(readers))}")
    return readers[ending](path)


def scene_in(name: str, background: float | None = None) -> Scene:
    """The scene of a file; without lights and `background` it has a background of radiance 1."""
    from plenoptic.scene.files.load import FileContents
    from plenoptic.scene.scene import Scene

    found = opened(name)
    if not isinstance(found.content, FileContents):
        raise FileError(f"{name!r} is {found.kind}; give a scene, such as a glTF or OBJ file")
    lights = found.content.lights
    return Scene(found.content.meshes, lights, 1.0 if background is None and not lights else background)


def camera_in(name: str) -> PlenopticCamera:
    """The camera that a file is or holds."""
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.core.files.serialization import fields_from_metadata
    from plenoptic.core.files.zarr_reading import attributes_of

    found = opened(name)
    camera = found.content if isinstance(found.content, PlenopticCamera) else getattr(found.content, "camera", None)
    if isinstance(found.content, Path):
        camera = fields_from_metadata(attributes_of(found.content) or {}, ("camera",)).get("camera")
    if not isinstance(camera, PlenopticCamera):
        raise FileError(f"{name!r} is {found.kind} and holds no camera; give one that pl.package.save_value wrote")
    return camera


def settings_in(name: str) -> RenderSettings:
    """The settings that a file holds."""
    from plenoptic.rendering.settings import RenderSettings

    found = opened(name)
    if not isinstance(found.content, RenderSettings):
        raise FileError(f"{name!r} is {found.kind}; give RenderSettings that pl.package.save_value wrote")
    return found.content


def exposure_of(found: Opened) -> Exposure | None:
    """The exposure of an image, a store or a package; None where it is something else."""
    from plenoptic.package.contents import Package
    from plenoptic.rendering.exposure import Exposure

    content = found.content.exposure if isinstance(found.content, Package) else found.content
    if isinstance(content, Path):
        content = Exposure.load(content)
    return content if isinstance(content, Exposure) else None


def _folder(path: Path) -> Opened:
    from plenoptic.core.files.zarr_reading import METADATA, attributes_of
    from plenoptic.dataset.contents import MANIFEST
    from plenoptic.dataset.reading import read
    from plenoptic.package.contents import PROVENANCE
    from plenoptic.rendering.stores import EXPOSURE, KIND, SEQUENCE

    kinds = {EXPOSURE: "an exposure in a zarr store", SEQUENCE: "a sequence of exposures in a zarr store"}
    if (attributes := attributes_of(path)) is not None:
        return Opened(kinds.get(str(attributes.get(KIND)), "a zarr store of another origin"), path)
    if (path / "parameters.cfg").is_file():
        from plenoptic.lightfield.reading import read_hci

        return Opened("a light field of the HCI benchmark's form", read_hci(path))
    if (path / PROVENANCE).is_file():
        return _package(path)
    if (path / MANIFEST).is_file():
        return Opened("a data set", read(path))
    raise FileError(
        f"{str(path)!r} is no folder that can be opened: a package has a {PROVENANCE}, a data set a {MANIFEST}, a "
        "light field of the HCI benchmark's form has parameters.cfg, a zarr store "
        f"{METADATA}; give one of them, or a file"
    )


def _package(path: Path) -> Opened:
    from plenoptic.package.reading import read

    return Opened("a package", read(path))


def _picture(path: Path) -> Opened:
    from plenoptic.core.files.images import read_channels
    from plenoptic.readout.raw import RawImage
    from plenoptic.rendering.exposure import Exposure

    if path.suffix.lower().startswith(".tif") and "plenoptic:model" in read_channels(path)[1]:
        return Opened("a raw image of a sensor", RawImage.load(path))
    return Opened("an image", Exposure.load(path))


def _json(path: Path) -> Opened:
    from plenoptic.core.files.file_limits import read_file
    from plenoptic.core.files.value_files import FORMAT, load_value
    from plenoptic.optics.lens.files.library import load_lens

    try:
        head = json.loads(read_file(path))
    except (ValueError, RecursionError) as error:
        raise FileError(f"{str(path)!r} is not JSON: {error}") from None
    if isinstance(head, dict) and head.get("format") == FORMAT:
        value = load_value(path)
        return Opened(f"a value of the kind {type(value).__name__}", value)
    return Opened("a lens", load_lens(path))
