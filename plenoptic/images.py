"""Reading and writing images: the only module that knows OpenImageIO, which it loads on first use."""

from plenoptic.core.color.srgb import Encoding, linear_to_srgb, srgb_to_linear
from plenoptic.core.files.images import read_channels, read_linear, write_16bit, write_channels
from plenoptic.core.files.reading import FileLimits

__all__ = [
    "Encoding",
    "FileLimits",
    "linear_to_srgb",
    "read_channels",
    "read_linear",
    "srgb_to_linear",
    "write_16bit",
    "write_channels",
]
