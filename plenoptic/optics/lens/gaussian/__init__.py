"""Gaussian optics of a lens."""
