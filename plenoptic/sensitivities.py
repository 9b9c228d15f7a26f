"""Sensitivities that come with the package: colour matching functions, and models of sensors."""

from plenoptic.core.color.sensitivities import cie_1931, colour_camera, linear_srgb, silicon

__all__ = ["cie_1931", "colour_camera", "linear_srgb", "silicon"]
