"""Bundled cases of the study of costs: the reference camera with its scenes."""

from __future__ import annotations

from collections.abc import Callable

from plenoptic.camera.design.example import example_camera
from plenoptic.rendering.plan.plan import plan
from plenoptic.rendering.plan.stages import Plan
from plenoptic.scene.shapes.procedural import check_scene, objects_scene
from plenoptic.scene.shapes.still_life import still_life

COST_CASES: dict[str, Callable[[], Plan]] = {
    "white": lambda: plan(None, example_camera()),
    "check": lambda: plan(check_scene(), example_camera()),
    "objects": lambda: plan(objects_scene(), example_camera()),
    "still_life": lambda: plan(still_life(), example_camera()),
}
"""Makers of the plans of the bundled cases."""
