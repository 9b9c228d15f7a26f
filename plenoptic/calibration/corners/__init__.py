"""Corners of boards in the micro images of a raw image."""
