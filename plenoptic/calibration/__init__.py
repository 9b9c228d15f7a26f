"""Calibration of real cameras from their images: the lattice of the micro images, and cameras from boards."""

from plenoptic.calibration.calibration_result import Calibration, HeldOut
from plenoptic.calibration.compote_files import read_compote
from plenoptic.calibration.corners.find_corners import BoardCorners, find_corners, observe
from plenoptic.calibration.fitting.covariance import ErrorCluster
from plenoptic.calibration.fitting.geometry import Parameter
from plenoptic.calibration.grid_files import read_grid, write_grid
from plenoptic.calibration.micro_images import find_micro_images
from plenoptic.calibration.nominal import NominalCamera
from plenoptic.calibration.observations import Observations
from plenoptic.calibration.toolbox_corners import read_lftoolbox_corners, write_lftoolbox_corners
from plenoptic.camera.points.micro_image_grid import MicroImageGrid

__all__ = [
    "BoardCorners",
    "Calibration",
    "ErrorCluster",
    "HeldOut",
    "MicroImageGrid",
    "NominalCamera",
    "Observations",
    "Parameter",
    "find_corners",
    "find_micro_images",
    "observe",
    "read_compote",
    "read_grid",
    "read_lftoolbox_corners",
    "write_grid",
    "write_lftoolbox_corners",
]
