"""Arguments of `render` and `estimate`: what is looked at by which camera, and what ends it."""

from __future__ import annotations

import argparse
import dataclasses
import re
import sys
from typing import TYPE_CHECKING, Any, NamedTuple

from plenoptic.command.files import camera_in, scene_in, settings_in
from plenoptic.command.tiles import Tile, tile_of, tile_region
from plenoptic.errors import InvalidValueError

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.rendering.settings import RenderSettings
    from plenoptic.scene.scene import Scene

Slices = tuple[slice, slice]
_OF_SCENES = ("background", "truth", "max_bounces", "clamp", "caustics")
"""Options that say nothing about a white image."""


class Request(NamedTuple):
    """What is to be rendered."""

    scene: Scene | None
    """None: a white image."""
    camera: PlenopticCamera
    region: Slices | None
    settings: RenderSettings
    options: argparse.Namespace

    def arguments(self, *names: str) -> dict[str, Any]:
        """Those of these names that were given, the region, and what belongs to scenes, as `render` takes them."""
        given = {name: found for name in names if (found := getattr(self.options, name)) is not None}
        given |= {"region": self.region, "sampler": self.settings.sampler}
        if self.scene is not None:
            given |= {name: getattr(self.settings, name) for name in ("max_bounces", "clamp", "caustics")}
            given |= {} if self.options.truth is None else {"truth": _truth(self.options.truth)}
        return given


def fill_render_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that both have."""
    add = parser.add_argument
    add("scene", metavar="SCENE", nargs="?", help="glTF, OBJ, PLY or STL; none with --white")
    add("camera", metavar="CAMERA", help="JSON of pl.package.save_value, or an image or package that holds a camera")
    add("--white", action="store_true", help="a white image: no scene, radiance 1 everywhere")
    text = "of what is around the scene; 1 where the file has no lights, otherwise 0"
    add("--background", type=float, metavar="RADIANCE", help=text)
    ends = parser.add_argument_group("what ends it, whichever comes first; at least one is needed")
    ends.add_argument("--samples", type=int, metavar="N", help="paths per pixel")
    ends.add_argument("--target-error", type=float, metavar="E", help="relative error, such as 0.02")
    ends.add_argument("--time-limit", type=float, metavar="SECONDS", help="from the start on")
    parts = parser.add_argument_group("a part of the sensor").add_mutually_exclusive_group()
    parts.add_argument("--region", type=region_of, metavar="R0:R1,C0:C1", help="rows R0 to R1 - 1 and columns alike")
    text = "the K-th of N parts, counted from 1 row by row, that are as square as can be and make up the whole"
    parts.add_argument("--tile", type=tile_of, metavar="K/N", help=text)
    how = parser.add_argument_group("how")
    how.add_argument("--seed", type=int, help="of the random numbers (0)")
    how.add_argument("--replicates", type=int, metavar="N", help="independent parts of the samples, for errors (2)")
    text = "what is found beside the image (depth), such as depth,normal,object; none; all"
    how.add_argument("--truth", metavar="NAME[,NAME]", help=text)
    how.add_argument("--max-bounces", type=int, metavar="N", help="of a path (8)")
    how.add_argument("--clamp", type=float, metavar="RADIANCE", help="the most that a path may bring")
    how.add_argument("--caustics", choices=("kept", "left-out"), help="light thrown by mirrors and glass (kept)")
    how.add_argument("--settings", metavar="FILE", help="RenderSettings as JSON; options beside it count more")
    how.add_argument("--threads", type=int, metavar="N", help="one for each processor, if not told otherwise")
    how.add_argument("--checkpoint", metavar="FILE", help="is added to on the way; the same call goes on from there")
    show = argparse.BooleanOptionalAction
    how.add_argument("--progress", action=show, default=sys.stderr.isatty(), help="in terminals")


def request_of(options: argparse.Namespace) -> Request:
    """What was asked for, with its files read; an error where it fits ill."""
    if options.white and options.scene is not None:
        raise InvalidValueError(f"--white has no scene, and {options.scene!r} is one too many; give the camera alone")
    if not options.white and options.scene is None:
        raise InvalidValueError("there is one file only; give SCENE and CAMERA, or --white and CAMERA")
    for name in _OF_SCENES if options.white else ():
        if getattr(options, name) is not None:
            raise InvalidValueError(f"--{name.replace('_', '-')} is about a scene, and --white has none; leave it out")
    if options.truth is not None:
        _truth(options.truth)
    camera = camera_in(options.camera)
    tile: Tile | None = options.tile
    region = options.region if tile is None else tile_region(camera.sensor.shape, tile)
    settings = _settings(options)
    scene = None if options.white else scene_in(options.scene, options.background)
    return Request(scene, camera, region, settings, options)


def region_of(text: str) -> Slices:
    """Slices of rows and columns, for argparse."""
    found = re.fullmatch(r"(\d*):(\d*),(\d*):(\d*)", text)
    if found is None:
        raise argparse.ArgumentTypeError(f"{text!r} is no region; give rows and columns, such as 0:64,128:256")
    first_row, end_row, first_column, end_column = (int(number) if number else None for number in found.groups())
    return slice(first_row, end_row), slice(first_column, end_column)


def _settings(options: argparse.Namespace) -> RenderSettings:
    from plenoptic.rendering.settings import Caustics, RenderSettings

    kept = RenderSettings() if options.settings is None else settings_in(options.settings)
    given = {name: found for name in ("max_bounces", "clamp") if (found := getattr(options, name)) is not None}
    if options.caustics is not None:
        given["caustics"] = Caustics.INCLUDE if options.caustics == "kept" else Caustics.EXCLUDE
    return dataclasses.replace(kept, **given)


def _truth(names: str) -> Any:
    """The channels of these names."""
    from plenoptic.truth.channels import Truth

    known = {name.lower().replace("_", "-"): flag for name, flag in Truth.__members__.items()}
    found = Truth.NONE
    for name in names.split(","):
        flag = known.get(name.strip().lower().replace("_", "-"))
        if flag is None:
            raise InvalidValueError(f"--truth has {name!r}; it must be one or several of {', '.join(known)}")
        found |= flag
    return found
