"""Compile ahead, so that no render has to wait for it."""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING

from plenoptic.command.files import camera_in, scene_in

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.scene.scene import Scene


def fill_parser(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument("--scene", metavar="FILE", help="a scene (glTF, OBJ, PLY, STL); otherwise the bundled kinds")
    text = "a camera (JSON), or an image or package that holds one; otherwise the bundled kinds"
    parser.add_argument("--camera", metavar="FILE", help=text)
    show = argparse.BooleanOptionalAction
    parser.add_argument("--progress", action=show, default=sys.stderr.isatty(), help="in terminals")


def run(options: argparse.Namespace) -> None:
    """Compile, and print the number of kernels and the time."""
    from plenoptic.rendering.warm_up import warm_up

    cameras = {options.camera: camera_in(options.camera)} if options.camera else dict(_cameras())
    scenes = {options.scene: scene_in(options.scene)} if options.scene else dict(_scenes())
    for seen, scene in scenes.items():
        for name, camera in cameras.items():
            print(f"{seen}, {name}: {warm_up(scene, camera, progress=options.progress)}", flush=True)


def _scenes() -> Iterator[tuple[str, Scene]]:
    from plenoptic.scene.shapes.procedural import check_scene, objects_scene
    from plenoptic.scene.shapes.still_life import still_life

    yield "a textured wall", check_scene()
    yield "bodies under a lamp", objects_scene()
    yield "the still life", still_life()


def _cameras() -> Iterator[tuple[str, PlenopticCamera]]:
    from plenoptic.camera.design.example import example_camera
    from plenoptic.optics.microlens.models import MicrolensModel

    camera = example_camera()
    assert camera.microlenses is not None
    yield "thin microlenses", camera
    refracting = dataclasses.replace(camera.microlenses, model=MicrolensModel.SPHERICAL)
    yield "plano-convex microlenses", dataclasses.replace(camera, microlenses=refracting)
    yield "no microlenses", dataclasses.replace(camera, microlenses=None, microlenses_to_sensor=0.0)
