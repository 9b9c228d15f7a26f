"""Colour by wavelength and as codes of images."""
