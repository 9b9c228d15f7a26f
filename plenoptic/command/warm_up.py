"""Compile ahead, so that no render has to wait for it."""

from __future__ import annotations

import argparse
import dataclasses
from typing import TYPE_CHECKING

from plenoptic.command.open_file import load_camera, load_scene
from plenoptic.command.render_options import add_progress

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.scene.scene import Scene


def fill_parser(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument("--scene", metavar="FILE", help="a scene (glTF, OBJ, PLY, STL); otherwise the bundled kinds")
    text = "a camera (JSON), or an image or package that holds one; otherwise the bundled kinds"
    parser.add_argument("--camera", metavar="FILE", help=text)
    parser.add_argument("--depth", action="store_true", help="also what views and depth need")
    add_progress(parser)


def run(options: argparse.Namespace) -> None:
    """Compile, and print the kernels and the time they took."""
    from plenoptic.rendering.warm_up import warm_up

    cameras = {options.camera: load_camera(options.camera)} if options.camera else _cameras()
    scenes = {options.scene: load_scene(options.scene)} if options.scene else _scenes()
    for scene_name, scene in scenes.items():
        for name, camera in cameras.items():
            done = warm_up(scene, camera, depth=options.depth, progress=options.progress)
            print(f"{scene_name}, {name}: {done}", flush=True)


def _scenes() -> dict[str, Scene]:
    from plenoptic.scene.shapes.procedural import check_scene, objects_scene
    from plenoptic.scene.shapes.still_life import still_life

    return {"a textured wall": check_scene(), "bodies under a lamp": objects_scene(), "the still life": still_life()}


def _cameras() -> dict[str, PlenopticCamera]:
    from plenoptic.camera.design.example import example_camera
    from plenoptic.optics.microlens.models import MicrolensModel

    camera = example_camera()
    assert camera.microlenses is not None
    refracting = dataclasses.replace(camera.microlenses, model=MicrolensModel.SPHERICAL)
    return {
        "thin microlenses": camera,
        "plano-convex microlenses": dataclasses.replace(camera, microlenses=refracting),
        "no microlenses": dataclasses.replace(camera, microlenses=None, microlenses_to_sensor=0.0),
    }
