"""Light fields and raw images as one HTML file that needs nothing else: moved about in, and read pixel by pixel."""

from plenoptic.viewer.page import Viewer

__all__ = ["Viewer"]
