"""Kernels: the representative rays of pixels, and the image points of what they meet."""
