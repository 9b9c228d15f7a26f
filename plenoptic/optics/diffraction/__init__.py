"""Diffraction of light at openings."""
