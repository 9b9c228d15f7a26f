"""Raw images and light fields in the formats of other programs; each states the limits of its program."""

from plenoptic.export.to_compote import compote, compote_calibration
from plenoptic.export.to_hci import hci
from plenoptic.export.to_jpeg_pleno import jpeg_pleno
from plenoptic.export.to_lftoolbox import lftoolbox
from plenoptic.export.to_microscopy import napari_lf, napari_lf_patterns, pyolaf, pyolaf_patterns
from plenoptic.export.to_plenoptic_toolbox import plenoptic_toolbox
from plenoptic.export.to_plenopticam import plenopticam
from plenoptic.export.to_plenoptomos import VoxFile, plenoptomos, read_plenoptomos
from plenoptic.export.to_plenpy import plenpy

__all__ = [
    "VoxFile",
    "compote",
    "compote_calibration",
    "hci",
    "jpeg_pleno",
    "lftoolbox",
    "napari_lf",
    "napari_lf_patterns",
    "plenopticam",
    "plenoptic_toolbox",
    "plenoptomos",
    "plenpy",
    "pyolaf",
    "pyolaf_patterns",
    "read_plenoptomos",
]
