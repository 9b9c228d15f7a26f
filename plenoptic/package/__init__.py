"""Packages: a raw image with its white image, truth and camera, in a folder or zip file, as docs/package.md says."""

from plenoptic.core.files.serialization import load_value, save_value
from plenoptic.package.calibration import CalibrationPoints, calibration_points
from plenoptic.package.reading import Package, read
from plenoptic.package.writing import write

__all__ = ["CalibrationPoints", "Package", "calibration_points", "load_value", "read", "save_value", "write"]
