"""Calibration targets whose points are known exactly, in the plane z = 0, centred on the origin and facing +z."""

from plenoptic.scene.shapes.targets.boards import checkerboard, point_grid, random_dots
from plenoptic.scene.shapes.targets.charts import siemens_star, slanted_edge
from plenoptic.scene.shapes.targets.marked_board import marked_checkerboard
from plenoptic.scene.shapes.targets.target import Target
from plenoptic.scene.shapes.targets.usaf import usaf_1951

__all__ = [
    "Target",
    "checkerboard",
    "marked_checkerboard",
    "point_grid",
    "random_dots",
    "siemens_star",
    "slanted_edge",
    "usaf_1951",
]
