"""Meshes and scenes made from numbers."""

from plenoptic.scene.shapes.procedural import (
    box,
    check_scene,
    checkerboard,
    objects_scene,
    quad,
    sphere,
    turned,
    white_plane,
)
from plenoptic.scene.shapes.still_life import still_life

__all__ = [
    "box",
    "check_scene",
    "checkerboard",
    "objects_scene",
    "quad",
    "sphere",
    "still_life",
    "turned",
    "white_plane",
]
