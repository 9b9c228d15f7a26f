"""Kernels: representative rays of pixels, and the images of the points that they hit."""
