"""Calibration targets whose points are known exactly, in the plane z = 0, centred on the origin and facing +z.

All of them in one place, for those who type `pl.targets`; each is described where it is made.
"""

from plenoptic.scene.shapes.targets.boards import checkerboard, point_grid, random_dots
from plenoptic.scene.shapes.targets.charts import siemens_star, slanted_edge
from plenoptic.scene.shapes.targets.usaf import usaf_1951

__all__ = ["checkerboard", "point_grid", "random_dots", "siemens_star", "slanted_edge", "usaf_1951"]
