"""Diffraction at openings."""
