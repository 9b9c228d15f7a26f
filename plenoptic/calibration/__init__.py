"""Calibration of real cameras from their images: the lattice of the micro images."""

from plenoptic.camera.points.micro_image_grid import MicroImageGrid

__all__ = ["MicroImageGrid"]
