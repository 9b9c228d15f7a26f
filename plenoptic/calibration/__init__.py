"""Calibration of real cameras from their images: the lattice of the micro images."""

from plenoptic.calibration.grid_files import read_grid
from plenoptic.camera.points.micro_image_grid import MicroImageGrid

__all__ = ["MicroImageGrid", "read_grid"]
