"""Kernels: regions that feed pixels, and the paths that start on them."""
