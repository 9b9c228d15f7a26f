"""Arguments of `render` and `estimate`: scene, camera, region and the end of the render."""

from __future__ import annotations

import argparse
import dataclasses
import re
from typing import TYPE_CHECKING, Any, NamedTuple

from plenoptic.command.open_file import load_camera, load_scene, load_settings
from plenoptic.command.tiles import parse_tile, tile_region
from plenoptic.errors import InvalidValueError

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.rendering.settings import RenderSettings
    from plenoptic.scene.scene import Scene

Slices = tuple[slice, slice]

_OF_SCENES = ("background", "unit", "view", "truth", "max_bounces", "clamp", "caustics")
"""Options that a white image does not have."""


class Request(NamedTuple):
    """Render that was asked for."""

    scene: Scene | None
    """None: a white image."""
    camera: PlenopticCamera
    region: Slices | None
    settings: RenderSettings
    options: argparse.Namespace

    def arguments(self, *names: str) -> dict[str, Any]:
        """Arguments of `render`: the options of these names that are not None, region, settings and truth."""
        arguments = _options(self.options, *names)
        arguments |= {"region": self.region, "sampler": self.settings.sampler}
        if self.scene is not None:
            arguments |= {name: getattr(self.settings, name) for name in ("max_bounces", "clamp", "caustics", "ghosts")}
            arguments |= {} if self.options.truth is None else {"truth": _parse_truth(self.options.truth)}
        return arguments


def fill_render_options(parser: argparse.ArgumentParser) -> None:
    """Add the common arguments."""
    add = parser.add_argument
    add("scene", metavar="SCENE", nargs="?", help="glTF, OBJ, PLY or STL; none with --white")
    add("camera", metavar="CAMERA", help="JSON of pl.package.save_value, or an image or package that holds a camera")
    add("--white", action="store_true", help="a white image: no scene, radiance 1 everywhere")
    add("--background", type=float, metavar="RADIANCE", help="of the surroundings of the scene (0)")
    text = "length of one unit of the scene's file: um, mm, cm, m, km, inch or foot (glTF: m, others: mm)"
    add("--unit", metavar="UNIT", help=text)
    add("--view", metavar="NAME", help="put the camera where a camera of the scene's file is, by its name or number")
    text = "bend light at microlenses, or at these and the iris"
    add("--diffraction", choices=("microlenses", "iris"), help=text)
    ends = parser.add_argument_group("end of the render, whichever comes first; at least one is needed")
    ends.add_argument("--samples", type=int, metavar="N", help="paths per pixel")
    ends.add_argument("--target-error", type=float, metavar="E", help="relative error, such as 0.02")
    ends.add_argument("--time-limit", type=float, metavar="SECONDS", help="from the start on")
    parts = parser.add_argument_group("a part of the sensor").add_mutually_exclusive_group()
    parts.add_argument("--region", type=parse_region, metavar="R0:R1,C0:C1", help="rows R0 to R1 - 1 and columns alike")
    text = "the K-th of N parts, counted from 1 row by row, that are as square as can be and make up the whole"
    parts.add_argument("--tile", type=parse_tile, metavar="K/N", help=text)
    group = parser.add_argument_group("settings")
    group.add_argument("--seed", type=int, help="of the random numbers (0)")
    group.add_argument("--replicates", type=int, metavar="N", help="independent parts of the samples, for errors (2)")
    text = "ground truth beside the image (depth), such as depth,normal,object; none; all"
    group.add_argument("--truth", metavar="NAME[,NAME]", help=text)
    group.add_argument("--max-bounces", type=int, metavar="N", help="of a path (8)")
    group.add_argument("--clamp", type=float, metavar="RADIANCE", help="the most that a path may bring")
    group.add_argument("--caustics", choices=("kept", "left-out"), help="light thrown by mirrors and glass (kept)")
    group.add_argument("--settings", metavar="FILE", help="RenderSettings as JSON; other options override them")
    group.add_argument("--threads", type=int, metavar="N", help="of the render (one for each processor)")
    group.add_argument(
        "--checkpoint", metavar="FILE", help="file that keeps the state of the render; the same call resumes from it"
    )
    add_progress(group)


def add_progress(parser: Any) -> None:
    """Add the switch for progress bars to a parser or a group of it."""
    show = argparse.BooleanOptionalAction
    parser.add_argument("--progress", action=show, default=True, help="in terminals")


def add_output(parser: argparse.ArgumentParser) -> None:
    """Add the image to write."""
    text = "image to write: .exr or .zarr keep everything, .tif and .png the picture"
    parser.add_argument("-o", "--output", metavar="OUT", required=True, help=text)


def request_of(options: argparse.Namespace) -> Request:
    """The render that the options describe, with its files read."""
    if options.white and options.scene is not None:
        raise InvalidValueError(f"--white has no scene, and {options.scene!r} is one too many; give the camera alone")
    if not options.white and options.scene is None:
        raise InvalidValueError("there is one file only; give SCENE and CAMERA, or --white and CAMERA")
    for name in _OF_SCENES if options.white else ():
        if getattr(options, name) is not None:
            raise InvalidValueError(f"--{name.replace('_', '-')} is about a scene, and --white has none; leave it out")
    if options.truth is not None:
        _parse_truth(options.truth)
    camera = load_camera(options.camera)
    region = options.region if options.tile is None else tile_region(camera.sensor.shape, options.tile)
    settings = _settings(options)
    scene = None if options.white else load_scene(options.scene, options.background, options.unit)
    return Request(scene, _camera(camera, options, scene), region, settings, options)


def _camera(camera: PlenopticCamera, options: argparse.Namespace, scene: Scene | None) -> PlenopticCamera:
    """The camera with diffraction, and at the place of a view of the scene, if these are asked for."""
    if options.diffraction is not None:
        from plenoptic.camera.diffraction import Diffraction

        camera = dataclasses.replace(camera, diffraction=Diffraction(iris=options.diffraction == "iris"))
    if options.view is None or scene is None:
        return camera
    views = {name: view for k, view in enumerate(scene.views) for name in (str(k), view.name)}
    if options.view not in views:
        names = ", ".join(repr(view.name) for view in scene.views) or "none"
        raise InvalidValueError(f"--view is {options.view!r}; the cameras of {options.scene!r} are {names}")
    view = views[options.view]
    return camera.posed(position=view.position, look_at=view.look_at, up=view.up)


def parse_region(text: str) -> Slices:
    """Slices of rows and columns, for argparse."""
    numbers = re.fullmatch(r"(\d*):(\d*),(\d*):(\d*)", text)
    if numbers is None:
        raise argparse.ArgumentTypeError(f"{text!r} is no region; give rows and columns, such as 0:64,128:256")
    first_row, end_row, first_column, end_column = (int(number) if number else None for number in numbers.groups())
    return slice(first_row, end_row), slice(first_column, end_column)


def _settings(options: argparse.Namespace) -> RenderSettings:
    from plenoptic.rendering.settings import Caustics, RenderSettings

    settings = RenderSettings() if options.settings is None else load_settings(options.settings)
    changes = _options(options, "max_bounces", "clamp")
    if options.caustics is not None:
        changes["caustics"] = Caustics.INCLUDE if options.caustics == "kept" else Caustics.EXCLUDE
    return dataclasses.replace(settings, **changes)


def _options(options: argparse.Namespace, *names: str) -> dict[str, Any]:
    """Options of these names that are not None."""
    return {name: value for name in names if (value := getattr(options, name)) is not None}


def _parse_truth(names: str) -> Any:
    """The channels of comma-separated names."""
    from plenoptic.truth.channels import Truth

    flags = {name.lower().replace("_", "-"): flag for name, flag in Truth.__members__.items()}
    truth = Truth.NONE
    for name in names.split(","):
        flag = flags.get(name.strip().lower().replace("_", "-"))
        if flag is None:
            raise InvalidValueError(f"--truth has {name!r}; it must be one or several of {', '.join(flags)}")
        truth |= flag
    return truth
