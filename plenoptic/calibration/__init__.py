"""Calibration of real cameras from their images: the lattice of the micro images of a white image."""

from plenoptic.calibration.grid_files import read_grid
from plenoptic.calibration.micro_images import find_micro_images
from plenoptic.camera.points.micro_image_grid import MicroImageGrid

__all__ = ["MicroImageGrid", "find_micro_images", "read_grid"]
