"""Reading and writing images, through OpenImageIO, which is loaded on first use; statistics of their pixels."""

from plenoptic.core.color.srgb import Encoding, linear_to_srgb, srgb_to_linear
from plenoptic.core.files.file_limits import FileLimits
from plenoptic.core.files.float_maps import read_pfm
from plenoptic.core.files.images import read_channels, read_linear, write_16bit, write_channels
from plenoptic.readout.raw_files import read_lytro, read_raw
from plenoptic.truth.channels import PixelState

__all__ = [
    "Encoding",
    "FileLimits",
    "PixelState",
    "linear_to_srgb",
    "read_channels",
    "read_linear",
    "read_lytro",
    "read_pfm",
    "read_raw",
    "srgb_to_linear",
    "write_16bit",
    "write_channels",
]
