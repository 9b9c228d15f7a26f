"""Colour: spectra, sensor sensitivities, sRGB codes."""
